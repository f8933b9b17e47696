"""Folders for kernels: those that cannot be written, and those that a crash or a full disk has spoilt."""

import errno
import os
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
from pathlib import Path
from types import SimpleNamespace

import pyopencl as cl
import pytest
from support.devices import DEVICES

import clfur
from clfur import cache
from clfur.device import caches, programs, source
from clfur.device.scheduler import Scheduler

ROOT = Path(__file__).resolve().parents[1]
DRAW = ("import clfur; f = clfur.draw(clfur.Scene(mesh=clfur.load_mesh('sphere'), "
        "camera=clfur.Camera(size=(16, 12))), 'cpu'); print(f.device, f.images['color'].any())")


@pytest.fixture
def place(monkeypatch, tmp_path):
    """An empty folder in which PoCL is to keep kernels, and clfur its marks -> PoCL's."""
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(cache, "folder", tmp_path.joinpath)
    monkeypatch.setattr(caches, "notes", [])
    (tmp_path / "kernels").mkdir()
    return tmp_path / "kernels"


def in_a_process(code, **environment):
    """A process without the variables for caches, but for these -> (exit code, stdout, stderr)."""
    kept = {name: value for name, value in os.environ.items()
            if name not in ("HOME", "XDG_CACHE_HOME", "POCL_CACHE_DIR", "MESA_SHADER_CACHE_DIR")}
    done = subprocess.run([sys.executable, "-c", code], env={**kept, "PYTHONPATH": str(ROOT), **environment},
                          capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout, done.stderr


def test_a_home_that_cannot_be_written(tmp_path):
    """A picture all the same, a line that names the folder and why, and nothing is left."""
    (tmp_path / "home").write_text("a file")
    (tmp_path / "temporary").mkdir()
    code, out, err = in_a_process(DRAW, HOME=str(tmp_path / "home" / "inner"), TMPDIR=str(tmp_path / "temporary"))
    assert code == 0 and out.endswith("True\n"), err
    kernels = tmp_path / "home" / "inner" / ".cache" / "pocl" / "kcache"
    assert f"kernels are not kept in {kernels}: Not a directory" in err
    assert f"this process keeps them in {tmp_path}/temporary/clfur-" in err
    assert not list((tmp_path / "temporary").iterdir())


def test_what_the_user_has_set_stays(place):
    caches.prepare()
    assert os.environ["POCL_CACHE_DIR"] == str(place) and caches.notes == []


def test_a_folder_of_the_user_that_does_not_work(place, monkeypatch):
    (place / "file").write_text("")
    monkeypatch.setenv("POCL_CACHE_DIR", str(place / "file" / "inner"))
    caches.prepare()
    new = Path(os.environ["POCL_CACHE_DIR"])
    assert new.is_dir() and new.parent == caches.private()
    line, = caches.notes
    assert line == (f"kernels are not kept in {place / 'file' / 'inner'}: Not a directory; "
                    f"this process keeps them in {new}")
    caches.prepare()   # again, as in a child: it works now
    assert os.environ["POCL_CACHE_DIR"] == str(new) and caches.notes == [line]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES])
def test_the_reason_is_the_systems(place, monkeypatch, number):
    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))
    monkeypatch.setattr(caches.tempfile, "TemporaryFile", refuse)
    assert caches.trouble(place / "not" / "there") == os.strerror(number)


def test_a_disk_that_is_almost_full(place, monkeypatch):
    for free, words in (caches.ROOM, ""), (caches.ROOM - 1, "16.0 MiB are free there; allowed: 16 or more"):
        monkeypatch.setattr(caches.shutil, "disk_usage", lambda _, free=free: SimpleNamespace(free=free))
        assert caches.trouble(place) == words
    assert not list(place.iterdir())


def test_no_temporary_folder(place, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(caches, "_private", [])
    monkeypatch.setattr(caches.tempfile, "mkdtemp", refuse)
    monkeypatch.setattr(caches.tempfile, "TemporaryFile", refuse)
    caches.prepare()
    assert os.environ["POCL_CACHE_DIR"] == str(place)
    assert caches.notes == [f"kernels are not kept in {place}: No space left on device; "
                            f"nor is there a temporary folder: No space left on device"]


DIES = ("import os, sys; from pathlib import Path; from clfur import cache; from clfur.device import caches\n"
        "cache.folder = Path(sys.argv[1]).joinpath\n"
        "with caches.taking_kernels(caches.POCL):\n    os.kill(os.getpid(), {signal})")


def dies(place, number=signal.SIGSEGV):
    """A process that dies while its driver takes kernels."""
    code = DIES.replace("sys.argv[1]", repr(str(cache.folder("")))).format(signal=int(number))
    code, _, err = in_a_process(code, POCL_CACHE_DIR=str(place), HOME=str(place))
    assert code == -number, err


def prepared(place, monkeypatch):
    """Whether kernels stay where they were in a process that starts now."""
    monkeypatch.setenv("POCL_CACHE_DIR", str(place))
    monkeypatch.setattr(caches, "notes", [])
    caches.prepare()
    stays = os.environ["POCL_CACHE_DIR"] == str(place)
    assert stays == (not caches.notes)
    assert stays or f"{place}: a process died while PoCL took kernels from there" in caches.notes[0]
    return stays


def test_a_death_is_told_once_a_second_one_till_the_folder_is_deleted(place, monkeypatch):
    assert prepared(place, monkeypatch)
    dies(place)
    assert [prepared(place, monkeypatch) for _ in range(3)] == [False, True, True]
    dies(place)
    assert [prepared(place, monkeypatch) for _ in range(3)] == [False, False, False]
    place.rename(place.parent / "old")   # keeps its number, so that the new one has another
    place.mkdir()
    assert prepared(place, monkeypatch) and prepared(place, monkeypatch)
    assert not list(caches._marks(place).iterdir())


def test_kernels_are_kept_elsewhere_where_they_may_be_spoilt(place, monkeypatch):
    """The same folder in every later process, so that they aren't built at each start; another if that is spoilt."""
    def kept():
        stays = prepared(place, monkeypatch)
        return place if stays else Path(os.environ["POCL_CACHE_DIR"])
    dies(place)
    first = kept()
    assert first.is_dir() and first.parent == place.parent / "kernels" and kept() == place
    dies(place)
    assert [kept() for _ in range(3)] == [first] * 3
    dies(first)
    second = kept()
    assert second not in (place, first) and second.is_dir() and [kept(), kept()] == [first, first]
    dies(first)
    assert [kept(), kept()] == [second, second]
    monkeypatch.setattr(caches, "OTHERS", 1)
    assert kept().parent == caches.private()
    monkeypatch.setattr(caches, "trouble", lambda folder: "" if folder == place else "full")
    assert kept().parent == caches.private()


LEAVES = ("from clfur.device import caches; print(caches.private(), flush=True); {}; import os; "
          "os.kill(os.getpid(), {signal})")


def test_folders_of_killed_processes_are_removed(tmp_path, monkeypatch):
    """By the next one that makes such a folder: not those of processes that live, new ones or others' folders."""
    code = LEAVES.replace("{signal}", str(int(signal.SIGKILL)))
    made = [Path(in_a_process(code.format(more), TMPDIR=str(tmp_path))[1].split()[0])
            for more in ("pass", "kept = caches.temporary(); kept.__enter__()")]
    (tmp_path / "clfur-others").mkdir()
    left = set(tmp_path.glob("clfur-*"))
    assert len(left) == 4 and left > set(made)   # the second has a temporary one, too
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with caches.temporary() as living:
        monkeypatch.setattr(caches, "YOUNG", -1)
        with caches.temporary():
            assert Path(living).is_dir()
            assert not os.listdir(living)   # drivers are to find nothing there
            assert len(list(tmp_path.glob("clfur-*"))) == 3   # two that live, and what has no lock
            assert not any(each.exists() for each in left - {tmp_path / "clfur-others"})
    assert list(tmp_path.iterdir()) == [tmp_path / "clfur-others"]


@pytest.mark.skipif(caches.fcntl is None, reason="files have no locks here, so nothing is removed")
def test_what_others_call_clfur_stays(tmp_path, monkeypatch):
    """A folder with a file of another kind that is called lock, a link to one, and a folder whose lock is a link."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(caches, "YOUNG", -1)
    ours = tmp_path / "elsewhere"
    for folder in tmp_path / "clfur-work", tmp_path / "clfur-linked", ours:
        folder.mkdir()
    (tmp_path / "clfur-work" / "lock").write_bytes(caches.OURS + b"and more")
    (ours / "lock").write_bytes(caches.OURS)
    (tmp_path / "clfur-linked" / "lock").symlink_to(ours / "lock")
    (tmp_path / "clfur-link").symlink_to(ours)
    before = sorted(tmp_path.rglob("*"))
    with caches.temporary():
        pass
    assert sorted(tmp_path.rglob("*")) == before
    ours.rename(tmp_path / "clfur-ours")
    with caches.temporary():
        pass
    assert not (tmp_path / "clfur-ours").exists() and (tmp_path / "clfur-work").exists()


def test_without_locks_folders_of_others_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "clfur-old").mkdir()
    (tmp_path / "clfur-old" / "lock").touch()
    monkeypatch.setattr(caches, "YOUNG", -1)
    monkeypatch.setattr(caches, "fcntl", None)
    with caches.temporary() as made:
        assert Path(made).is_dir()
    assert [each.name for each in tmp_path.iterdir()] == ["clfur-old"]


def test_what_ends_well_leaves_no_mark(place, monkeypatch):
    with caches.taking_kernels(caches.POCL):
        assert len(list(caches._marks(place).iterdir())) == 1
        assert prepared(place, monkeypatch)   # this process lives
    with pytest.raises(ZeroDivisionError), caches.taking_kernels(caches.POCL):
        raise ZeroDivisionError
    assert not list(caches._marks(place).iterdir())
    with caches.taking_kernels("another driver"):
        assert not list(caches._marks(place).iterdir())


def test_marks_need_no_cache(place, monkeypatch):
    def none(_):
        raise clfur.Error("there is no cache folder")
    monkeypatch.setattr(cache, "folder", none)
    with caches.taking_kernels(caches.POCL):
        assert prepared(place, monkeypatch)


class Driver:
    """`cl.Program` for a driver whose kept programs are spoilt: those of ``spoilt`` texts fail as ``how`` says."""

    def __init__(self, spoilt, how):
        self.spoilt, self.how, self.built = spoilt, how, []

    def __call__(self, *given):
        program = Made(*given)
        program.driver, program.text = self, given[1]
        return program


class Made(cl.Program):
    def how(self):
        return self.driver.how if self.driver.spoilt(self.text) else ""

    def build(self, options):
        self.driver.built.append(self.text)
        if self.how() == "error":
            raise cl.RuntimeError("clBuildProgram failed: BUILD_PROGRAM_FAILURE")
        return super().build(options)

    def get_info(self, what):
        without = self.how() == "no kernels" and what == cl.program_info.KERNEL_NAMES
        return "" if without else super().get_info(what)


@pytest.fixture
def unkept(monkeypatch):
    monkeypatch.setattr(programs, "KEEPS", False)


@pytest.mark.parametrize("how", ["error", "no kernels"])
def test_a_spoilt_program_is_built_anew(gpu, monkeypatch, unkept, how):
    driver = Driver(lambda source: "built_again" not in source, how)
    monkeypatch.setattr(programs.cl, "Program", driver)
    fresh = Scheduler(gpu.device)
    with pytest.warns(RuntimeWarning, match=r"keeps of zscan\.cl.* is spoilt"):
        assert "zscan.columns" in fresh._build("zscan")
    assert len(driver.built) == 3   # its own text twice
    if gpu.device.platform.name == caches.POCL:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            fresh._build("zscan")
        assert str(caches.folder()) in str(said[-1].message)


def test_a_build_that_is_cut_short_tells_of_nothing_spoilt(gpu, monkeypatch, unkept, recwarn):
    """As a signal does while PoCL's compiler runs: the same text is built once more."""
    driver = Driver(lambda _: len(driver.built) == 1, "error")
    monkeypatch.setattr(programs.cl, "Program", driver)
    assert "zscan.columns" in Scheduler(gpu.device)._build("zscan")
    assert len(driver.built) == 2 and driver.built[0] == driver.built[1] and not list(recwarn)


@pytest.mark.parametrize("how, words", [("error", "BUILD_PROGRAM_FAILURE"),
                                        ("no kernels", "the program lacks its kernels ")])
def test_a_program_that_stays_spoilt_is_an_error_of_the_device(gpu, monkeypatch, unkept, how, words):
    monkeypatch.setattr(programs.cl, "Program", Driver(lambda _: True, how))
    with pytest.raises(clfur.DeviceError, match=rf"does not build zscan\.cl: .*{words}"):
        Scheduler(gpu.device)._build("zscan")


def test_a_disk_that_is_full_by_now_is_in_the_message(gpu, monkeypatch, unkept):
    monkeypatch.setattr(programs.cl, "Program", Driver(lambda _: True, "error"))
    monkeypatch.setattr(caches, "trouble", lambda _: "No space left on device")
    fresh = Scheduler(gpu.device)
    with pytest.raises(clfur.DeviceError) as caught:
        fresh._build("zscan")
    ends = f"; it keeps kernels in {caches.folder()}: No space left on device"
    assert str(caught.value).endswith(ends) == (gpu.device.platform.name == caches.POCL)


@pytest.fixture
def kept(monkeypatch, tmp_path):
    """Programs are kept in an empty folder, also those of drivers that keep them themselves."""
    monkeypatch.setattr(cache, "folder", tmp_path.joinpath)
    monkeypatch.setattr(programs, "KEEPS", True)
    monkeypatch.setattr(programs, "has_src_build_cache", lambda _: False)
    driver = Driver(lambda _: False, "")
    monkeypatch.setattr(programs.cl, "Program", driver)
    return SimpleNamespace(folder=tmp_path / "programs", built=driver.built)


def test_programs_are_kept(gpu, kept):
    Scheduler(gpu.device)._build("zscan")
    assert len(kept.built) == 1 and isinstance(kept.built[0], str)
    Scheduler(gpu.device)._build("zscan")
    assert len(kept.built) == 2 and isinstance(kept.built[1], list)   # from binaries
    file, = kept.folder.iterdir()
    whole = file.read_bytes()
    for content in (b"", whole[:32], whole[:len(whole) // 2], bytes(len(whole)), whole[:-1] + b"\0" + whole[-1:]):
        kept.built.clear()
        file.write_bytes(content)
        Scheduler(gpu.device)._build("zscan")
        assert [type(source) for source in kept.built] == [str]   # what is damaged no driver sees
        assert cache.recall_bytes(file)


def test_nothing_is_kept_where_nothing_can_be(gpu, kept):
    kept.folder.write_text("a file where the folder should be")
    assert Scheduler(gpu.device)._build("zscan")


def test_pyopencl_keeps_nothing():
    """Its database and its lock file would break later starts."""
    assert cl._PYOPENCL_NO_CACHE


LEAK = """
import gc, sys
import psutil, clfur
from clfur.device.scheduler import Scheduler
device = clfur.device.find()[int(sys.argv[1])]

def some(number):
    for _ in range(number):
        gpu = Scheduler(device)
        for stem in "raster", "shade", "zscan":
            for kernel in gpu._build(stem).values():
                assert kernel.run.reference_count == 1
        gpu.full(1000, "f4", 1).get()
    del gpu, kernel
    gc.collect()
    return psutil.Process().memory_info().rss

before = some(6)
print((some(10) - before) / 10 / 2**20)
"""


def test_a_scheduler_leaves_little(gpu):
    """5 to 20 MiB each while a kernel was held once too often, 0.1 to 0.4 since (of the text of calls)."""
    code, out, err = in_a_process(LEAK.replace("sys.argv[1]", str(DEVICES.index(gpu.device))),
                                  HOME=os.environ.get("HOME", ""),
                                  **{name: os.environ[name] for name in ("XDG_CACHE_HOME", "POCL_CACHE_DIR")
                                     if name in os.environ})
    assert code == 0, err
    assert float(out.split()[-1]) < 1.5


def test_kernels_give_no_warnings(gpu):
    """Programs are built with -w: what it hides are remarks on how vectors are passed, for some processors."""
    from clfur import layout
    for stem in sorted(path.stem for path in source.kernel_dir().iterdir() if path.name.endswith(".cl")):
        text = source.read(stem)
        whole = layout.preamble(gpu.int64_atomics, lanes=gpu.lanes) + (source.once(text) if gpu.lanes > 1 else text)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)
            program = cl.Program(gpu.context, whole).build(["-cl-std=CL1.2"])
        log = program.get_build_info(gpu.device, cl.program_build_info.LOG)
        lines = [line for line in log.splitlines() if "warning" in line.lower()]
        assert not [line for line in lines if "changes the ABI" not in line and "warnings generated" not in line]


def test_a_first_run_is_quiet(tmp_path):
    code, out, err = in_a_process(DRAW, HOME=str(tmp_path))
    assert (code, err) == (0, "") and out.endswith("True\n")


HEARD = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="Windows")
def test_signals_wait_while_a_driver_builds():
    """Programs that it starts, such as PoCL's linker, do not hear them; this process does, afterwards."""
    def blocked():
        return subprocess.run([sys.executable, "-c", HEARD], capture_output=True, text=True, check=True).stdout.strip()
    assert blocked() == "False"
    reached = []
    with pytest.raises(KeyboardInterrupt), caches.taking_kernels(caches.POCL):
        reached.append(blocked())
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)   # others of this process may take one for all
        reached.append("after it")
    assert reached == ["True", "after it"] and blocked() == "False"


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks /proc for threads")
@pytest.mark.skipif(all(each.platform.name != caches.POCL for each in DEVICES), reason="no PoCL")
def test_threads_of_pocl_hear_no_signal():
    """They link kernels: their linker would end at Ctrl-C on a terminal, and the process with it."""
    done = subprocess.run([sys.executable, "-c", """
import os, signal, threading, time, clfur
gpu = clfur.Scheduler("pocl")
clfur.render(clfur.Scene(clfur.load_mesh("sphere"), camera=clfur.Camera(size=(8, 8))), gpu)
time.sleep(0.3)   # to the system a thread of Python's is there for a moment after it has been joined
ours = {str(each.native_id) for each in threading.enumerate()}
for thread in set(os.listdir("/proc/self/task")) - ours:
    status = dict(line.split(":", 1) for line in open(f"/proc/self/task/{thread}/status"))
    if thread != str(os.getpid()):
        print(status["Name"].strip(), int(status["SigBlk"], 16) >> signal.SIGINT - 1 & 1)
"""], capture_output=True, text=True, check=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
    threads = done.stdout.splitlines()
    assert threads and all(line.endswith(" 1") for line in threads), threads
