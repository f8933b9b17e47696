"""Ctrl-C, SIGTERM and SIGHUP: the command's exit codes, its one line, and nothing left, whatever it was doing."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.command import wrong

import clfur as library
from clfur.command import endings
from clfur.files import images

ROOT = Path(__file__).resolve().parents[1]
CODES = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129}
LINES = {"SIGINT": "interrupted", "SIGTERM": "ended by SIGTERM", "SIGHUP": "ended by SIGHUP"}
SIGNALS = [name for name in CODES if hasattr(signal, name)]
pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no signals between processes")

# Marks that it is there, by a file, and waits: put in the place of what the command does.
WAIT = "import pathlib, time; pathlib.Path({mark!r}).touch(); time.sleep(60)"
SCENE = """
import clfur
scene = clfur.Scene(mesh=clfur.load_mesh("sphere"), fur=clfur.Strands(roots={roots}), camera=clfur.Camera(size={size}))
"""


class Running:
    """The command in a process of its own, in an empty folder with a folder of its own for what is temporary."""

    def __init__(self, folder, *arguments, path=(), start=("-m", "clfur"), places=(), **options):
        self.folder, self.temporary = folder / "here", folder / "temporary"
        self.mark = folder / "mark"
        for each in (self.folder, self.temporary):
            each.mkdir(exist_ok=True)
        path = os.pathsep.join(map(str, (*path, ROOT)))
        self.process = subprocess.Popen(
            [sys.executable, *map(str, start), *arguments], cwd=self.folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": path, "TMPDIR": str(self.temporary)} | dict(places), **options)

    def wait_for(self, there):
        began = time.monotonic()
        while not there():
            assert self.process.poll() is None and time.monotonic() - began < 120, self.process.communicate()
            time.sleep(0.02)

    def ends(self, name, times=1):
        """Send a signal, and see it end as it must."""
        asked = time.monotonic()
        for _ in range(times):
            self.process.send_signal(getattr(signal, name))
        out, err = self.process.communicate(timeout=60)
        assert time.monotonic() - asked < 10
        # PoCL's compiler, interrupted, and what `devices --check` may have begun with, are no part of the end.
        lines = [line for line in err.splitlines() if "error generated" not in line and ": checking " not in line]
        assert (self.process.returncode, out, lines) == (CODES[name], "", [f"clfur: {LINES[name]}"])
        assert list(self.temporary.iterdir()) == []

    def children(self):
        threads = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return [child for each in threads for child in each.read_text().split()]


def waiting(running):
    running.wait_for(running.mark.exists)
    return running


@pytest.fixture
def slow(tmp_path):
    """A folder with a module, in the place of one that clfur imports early, that takes a minute to import."""
    folder = tmp_path / "slow"
    folder.mkdir()
    (folder / "attrs.py").write_text(WAIT.format(mark=str(tmp_path / "mark")))
    return folder


@pytest.mark.parametrize("name", SIGNALS)
def test_while_it_imports(tmp_path, slow, name):
    waiting(Running(tmp_path, "render", "sphere", path=[slow])).ends(name)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks /proc for children")
@pytest.mark.parametrize("name", SIGNALS)
def test_while_it_imports_and_asks_drivers(tmp_path, slow, name):
    """In a first run, with a child, which imports slowly too, and with a folder for what that says."""
    running = Running(tmp_path, "render", "sphere", path=[slow],
                      places={"XDG_CACHE_HOME": str(tmp_path), "POCL_CACHE_DIR": str(tmp_path)})
    waiting(running).wait_for(running.children)
    time.sleep(0.3)
    child = running.children()[0]
    assert list(running.temporary.iterdir())
    running.ends(name)
    assert not Path(f"/proc/{child}").exists()


def test_while_the_installed_script_imports(tmp_path, slow):
    script = tmp_path / "clfur"
    script.write_text("import sys\nfrom clfur.command.main import main\nsys.exit(main())\n")
    waiting(Running(tmp_path, "devices", path=[slow], start=[script])).ends("SIGTERM")


@pytest.mark.parametrize("arguments, original, ours", [
    (["/bin/clfur", "render"], ["python", "/bin/clfur", "render"], True), ([r"clfur.exe"], [], True),
    (["-m"], ["python", "-m", "clfur", "render"], True), (["-m"], ["python", "-mclfur"], True),
    (["-m"], ["python", "-m", "pytest"], False), (["-c"], ["python", "-c", "import clfur"], False),
    (["fur.py"], ["python", "fur.py", "clfur"], False), ([""], ["python"], False), ([], [], False)])
def test_which_process_is_the_command(arguments, original, ours):
    assert endings.is_command(arguments, original) == ours


def test_others_keep_their_handlers(tmp_path):
    """Python's own, and those that a program has set, before and after `import clfur`."""
    code = ("import signal\nmine = lambda *_: None\nsignal.signal(signal.SIGTERM, mine)\nimport clfur\n"
            "clfur.Scene(clfur.load_mesh('sphere'))\n"
            "assert signal.getsignal(signal.SIGTERM) is mine\n"
            "assert signal.getsignal(signal.SIGINT) is signal.default_int_handler\n"
            "assert signal.getsignal(signal.SIGHUP) == signal.SIG_DFL\n")
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"PYTHONPATH": str(ROOT)})


def test_handlers_are_given_back(clfur, monkeypatch):
    before = [signal.getsignal(number) for number in endings.SIGNALS]
    during = []
    monkeypatch.setattr("clfur.command.render.check_writable",
                        lambda _: during.extend(map(signal.getsignal, endings.SIGNALS)) or os.kill(os.getpid(), 15))
    code, out, err = clfur("render", "sphere")
    assert (code, out, err) == (143, "", "clfur: ended by SIGTERM\n")
    assert len(during) == len(before) and not set(during) & set(before)
    assert before == [signal.getsignal(number) for number in endings.SIGNALS]


@pytest.mark.parametrize("command, does, size, name", [("render", "draw", (4000, 3000), name) for name in SIGNALS] + [
    ("chart", "frontier", (320, 240), "SIGTERM")])
def test_during_a_frame(tmp_path, command, does, size, name):
    """Frames of many seconds, and the truth of them; the scene's file tells when they begin."""
    (tmp_path / "fur.py").write_text(SCENE.format(roots=10**6, size=size) + f"""
import sys, threading
command = sys.modules["clfur.command.{command}"]
does = command.{does}
def marked(*arguments, **options):
    threading.Timer(1, open, [{str(tmp_path / 'mark')!r}, "w"]).start()
    return does(*arguments, **options)
command.{does} = marked
""")
    running = Running(tmp_path, command, "../fur.py", "-o", "a.png")
    waiting(running).ends(name)
    assert list(running.folder.iterdir()) == []


@pytest.mark.parametrize("name, times", [(name, 1) for name in SIGNALS] + [("SIGTERM", 2)])
def test_while_it_writes(tmp_path, name, times):
    """Half of a picture is written: the one that was there stays.  `timeout` sends its signal twice."""
    (tmp_path / "fur.py").write_text(SCENE.format(roots=50, size=(40, 30)) + f"""
from clfur.files import images
def half(path, outputs, about):
    path.write_bytes(b"half a picture")
    {WAIT.format(mark=str(tmp_path / 'mark'))}
images.WRITERS[".png"] = half
""")
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "a.png").write_text("mine")
    running = waiting(Running(tmp_path, "render", "../fur.py", "-o", "a.png"))
    assert len(list(running.folder.iterdir())) == 2
    running.ends(name, times)
    assert [(file.name, file.read_text()) for file in running.folder.iterdir()] == [("a.png", "mine")]


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_while_it_films(tmp_path, name):
    """Whole frames stay, and nothing that was half written."""
    running = Running(tmp_path, "film", "sphere", "--roots", "20000", "--size", "96x64", "--frames", "0:9999", "--wind",
                      "3,0,0", "-o", "f/%d.png")
    running.wait_for((running.folder / "f" / "1.png").exists)
    running.ends(name)
    there = sorted((running.folder / "f").iterdir())
    assert {path.name for path in there} == {*(f"{k}.png" for k in range(len(there) - 1)), "film.json"}
    assert all(library.load(path)["color"].shape == (64, 96, 4) for path in there if path.suffix == ".png")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks /proc for children")
@pytest.mark.parametrize("command", [["devices", "--check"], ["compare", "sphere", "--repeat", "9999", "-o", "a.html"]])
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_with_a_child(tmp_path, command, name):
    # A child that is ended while it takes kernels from the user's cache would make that one suspect.
    running = Running(tmp_path, *command, places={"XDG_CACHE_HOME": str(tmp_path), "POCL_CACHE_DIR": str(tmp_path)})
    running.wait_for(running.children)
    child = running.children()[0]
    time.sleep(0.3)
    running.ends(name)
    assert not Path(f"/proc/{child}").exists() and list(running.folder.iterdir()) == []


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks /proc for children")
def test_a_child_ends_with_a_parent_that_is_killed(tmp_path):
    running = Running(tmp_path, "compare", "sphere", "--devices", "auto", "--repeat", "9999",
                      places={"XDG_CACHE_HOME": str(tmp_path), "POCL_CACHE_DIR": str(tmp_path)})   # as above
    running.wait_for(running.children)
    child = Path(f"/proc/{running.children()[0]}")
    running.process.kill()
    running.process.communicate(timeout=60)
    began = time.monotonic()
    while child.exists():
        assert time.monotonic() - began < 30
        time.sleep(0.05)


def test_a_signal_that_is_ignored_stays_ignored(tmp_path):
    """As under nohup."""
    running = Running(tmp_path, "render", "../fur.py", "-o", "a.png",
                      preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    (tmp_path / "fur.py").write_text(SCENE.format(roots=50, size=(40, 30)) + "import os\nos.kill(os.getpid(), 1)\n")
    out, err = running.process.communicate(timeout=120)
    assert (running.process.returncode, err) == (0, "") and out.startswith("a.png: ")


@pytest.mark.parametrize("lost", [
    "class Lost:\n    def __del__(self):\n        hear()\nLost()",
    "class Lost: pass\nlost = Lost()\nref = weakref.ref(lost, hear)\ndel lost",
    "try:\n    hear()\nexcept BaseException:\n    pass"])
def test_a_signal_is_not_lost(lost):
    """What is raised in a destructor, or as an import lets go of its lock, goes nowhere; some code catches all."""
    code = ("import os, time, weakref\nfrom clfur.command import endings\n"
            "def hear(*_):\n    os.kill(os.getpid(), 15)\n    time.sleep(0.01)\n"
            "def undo():\n    try:\n        1 / 0\n    except ZeroDivisionError:\n        time.sleep(1)\n"
            "    print('undone')\n"
            f"def command():\n    try:\n        exec({lost!r})\n        print('lost')\n"
            "        for _ in range(500):\n            time.sleep(0.1)\n    finally:\n        undo()\n"
            "raise SystemExit(endings.run(command))\n")
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, timeout=40,
                          env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert (done.returncode, done.stdout, done.stderr) == (143, "lost\nundone\n", "clfur: ended by SIGTERM\n")


def test_other_things_that_are_lost_are_told(monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)

    class Wrong:
        def __del__(self):
            raise ValueError
    endings.run(lambda: Wrong() and None)
    assert [each.exc_type for each in told] == [ValueError] and sys.unraisablehook == told.append


def test_signals_that_come_while_one_is_undone_are_none(capfd):
    undone = []

    def command():
        try:
            os.kill(os.getpid(), 15)
            time.sleep(1)
        finally:
            for number in (15, 2):
                os.kill(os.getpid(), number)
                time.sleep(0.01)
                undone.append(number)
    assert endings.run(command) == 143 and undone == [15, 2] and "SIGTERM" in capfd.readouterr().err


@pytest.mark.parametrize("number, line", [(2, "ended"), (15, "ended by SIGTERM")])
def test_what_serves_ends_without_an_error(capfd, number, line):
    """Once it does: what is interrupted before has not done what it was asked for."""
    def command(serves):
        if serves:
            endings.serves()
        os.kill(os.getpid(), number)
        time.sleep(1)
    assert endings.run(lambda: command(True)) == 0 and capfd.readouterr().err == f"clfur: {line}\n"
    assert endings.run(lambda: command(False)) == 128 + number
    assert capfd.readouterr().err == f"clfur: {LINES[signal.Signals(number).name]}\n"


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux's C library for the handlers of signals")
@pytest.mark.parametrize("mine", [True, False])
def test_a_driver_puts_no_handler_before_pythons(mine):
    """A compiler's lets a second signal at the same time end the process at once, with half a picture left."""
    code = ("import ctypes, signal, sys\nmine = lambda *_: None\n"
            + "signal.signal(signal.SIGTERM, mine)\n" * mine +
            "def handlers():\n    action = (ctypes.c_uint64 * 32)()\n    for number in (15, 2):\n"
            "        ctypes.CDLL(None).sigaction(number, None, action)\n        yield action[0]\n"
            "before = list(handlers())\nimport clfur\n"
            "scene = clfur.Scene(clfur.load_mesh('sphere'), clfur.Strands(roots=50), clfur.Camera(size=(40, 30)))\n"
            "clfur.render(scene)\nafter = list(handlers())\n"
            "assert before[1] == after[1], (before, after)\n"
            + "assert before[0] == after[0] and signal.getsignal(15) is mine, (before, after)\n" * mine)
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"PYTHONPATH": str(ROOT)})


def test_what_an_import_makes_of_it(capfd):
    """Libraries whose import is cut short raise an error of their own."""
    def command():
        try:
            os.kill(os.getpid(), 15)
            time.sleep(1)
        except BaseException as error:
            raise ImportError("initialization failed") from error
    assert endings.run(command) == 143 and capfd.readouterr().err == "clfur: ended by SIGTERM\n"
    with pytest.raises(ImportError, match="another"):
        endings.run(lambda: exec("raise ImportError('another')"))


def test_what_nobody_catches_is_told_but_of_signals(monkeypatch):
    """Python tells of a signal that came just before it was ignored; all else that nobody catches is told as ever."""
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    race = OSError(f"Signal {int(signal.SIGINT)} ignored due to race condition")
    lost = [SimpleNamespace(exc_type=type(each), exc_value=each) for each in (race, endings.Ended(), OSError("lost"))]
    endings.run(lambda: [sys.unraisablehook(each) for each in lost])
    assert told == lost[2:] and sys.unraisablehook == told.append


def test_a_hail_of_signals(tmp_path):
    """Wherever the next one comes, in the handler of the one before or as Python ends: one line, and its code."""
    for number in range(6):
        folder = tmp_path / str(number)
        folder.mkdir()
        script = folder / "clfur"
        script.write_text("import sys, time\nfrom clfur.command import endings\n"
                          f"def command():\n    open({str(folder / 'mark')!r}, 'w')\n    time.sleep(60)\n"
                          "sys.exit(endings.run(command) or 0)\n")
        running = waiting(Running(folder, start=[script]))
        for each in [signal.SIGTERM, signal.SIGINT] * 100:
            running.process.send_signal(each)
        out, err = running.process.communicate(timeout=60)
        assert (running.process.returncode, out, err) in [
            (143, "", "clfur: ended by SIGTERM\n"), (130, "", "clfur: interrupted\n")]


@pytest.mark.parametrize("suffix", ["png", "exr", "npz"])
def test_a_full_disk(tmp_path, suffix):
    """A limit on the size of files, met while the picture is written: one error, and the old file is kept."""
    code = ("import sys, resource, numpy, clfur\nfrom pathlib import Path\n"
            "noise = numpy.random.default_rng(1).random((90, 120, 4), numpy.float32)\n"
            "path = Path(sys.argv[1])\npath.write_text('mine')\nclfur.save(path.with_stem('b'), noise)\n"
            "resource.setrlimit(resource.RLIMIT_FSIZE, (10000, resource.RLIM_INFINITY))\n"
            "try:\n    clfur.save(path, noise)\nexcept clfur.Error as error:\n    print(error)\n")
    done = subprocess.run([sys.executable, "-c", code, f"a.{suffix}"], cwd=tmp_path, text=True, capture_output=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT)}, timeout=60)
    assert done.stdout.startswith(f"a.{suffix}: cannot be written: ") and done.stdout.count("\n") == 1, done
    assert done.returncode == 0 and sorted(file.name for file in tmp_path.iterdir()) == [f"a.{suffix}", f"b.{suffix}"]
    assert (tmp_path / f"a.{suffix}").read_text() == "mine"


def test_a_full_disk_in_the_command(clfur, tmp_path, monkeypatch):
    def full(path, outputs, about):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")
    monkeypatch.setitem(images.WRITERS, ".png", full)
    (tmp_path / "a.png").write_text("mine")
    wrong(clfur("render", "sphere", "--roots", 50, "--size", "40x30", "-o", "a.png"),
          "a.png: cannot be written: No space left on device")
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.png", "mine")]
