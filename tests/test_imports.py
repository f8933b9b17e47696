"""What is imported when: names of `clfur` and commands when they are first used, drivers asked for before all else."""

import ast
import os
import pickle
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete
from support.command import wrong

import clfur as library
from clfur.command import devices
from clfur.command.main import COMMANDS
from clfur.command.main import clfur as group
from clfur.device import caches

ROOT = Path(__file__).resolve().parents[1]
DEAR = {"numpy", "pyopencl", "attrs", "PIL", "OpenEXR", "imageio", "asyncio", "rich"}


def fresh(code, *arguments, **environment):
    """What a fresh process prints."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", code, *arguments], text=True, capture_output=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT)} | environment, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def imported(code):
    """Names of all modules after a line in a fresh process."""
    return set(fresh(f"{code}\nimport sys; print(*sys.modules)").split())


@pytest.mark.parametrize("code, others", [
    ("import clfur", DEAR | {"psutil", "logging", "clfur.scene", "clfur.device", "clfur.files"}),
    ("import clfur.command.main, clfur.judge.isolated", DEAR | {"clfur.scene", "clfur.device.selection"}),
    ("import clfur.device.scheduler", {
        "numpy.ma", "asyncio", "clfur.scene", "clfur.files", "clfur.judge", "clfur.film", "clfur.command.main"}),
    ("from clfur import Scene, Strands, load_mesh", {"pyopencl", "clfur.files.gltf", "clfur.files.usd", "numpy.ma"}),
    ("from clfur.command.main import clfur\nclfur.get_command(None, 'render')", {
        "numpy.ma", "asyncio", "rich", "clfur.twin", "clfur.film", "clfur.motion", "clfur.judge.truth",
        "clfur.judge.report", "clfur.viewer", "clfur.files.gltf", "clfur.files.curves", "clfur.files.scenes"})])
def test_what_is_not_needed_is_not_imported(code, others):
    there = imported(code)
    assert "clfur" in there and there & others == set()


def test_a_picture_is_drawn_without(tmp_path):
    """Of all that is imported late nothing is needed after all."""
    code = ("import sys\nfrom clfur.command import main\n"
            "try:\n    main.main(sys.argv[1:])\nexcept SystemExit as end:\n    print(end.code, *sys.modules)\n")
    code, *there = fresh(code, "render", "sphere", "-o", str(tmp_path / "a.png"), "--size", "16x12", "--roots",
                         "50").splitlines()[-1].split()
    assert code == "0" and "PIL.Image" in there and "clfur.render" in there
    assert set(there) & {"numpy.ma", "asyncio", "rich", "clfur.judge.truth", "clfur.film", "clfur.motion",
                         "clfur.files.gltf", "clfur.files.curves"} == set()


def test_public_names():
    """All are there, those that the stub tells of, and no others."""
    stub = ast.parse((ROOT / "clfur/__init__.pyi").read_text())
    told = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    listed = next(ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign))
    assert len(library.__all__) > 50 and set(library.__all__) == told == set(listed) == set(dir(library))
    assert all(getattr(library, name) is getattr(library, name) for name in library.__all__)
    everything: dict = {}
    exec("from clfur import *", everything)
    assert everything.keys() - {"__builtins__"} == told
    for name in told - {"PRESETS", "truth"}:   # found by their own modules, as pickle does
        assert pickle.loads(pickle.dumps(everything[name])) is everything[name]
    assert set(library.device.__all__) == set(dir(library.device)) and callable(library.device.survey)


def test_a_name_that_is_not_there():
    for name in ("abacus", "_abacus", "fur"):
        with pytest.raises(AttributeError, match=f"module 'clfur' has no attribute '{name}'"):
            getattr(library, name)
    with pytest.raises(ImportError, match="abacus"):
        exec("from clfur import abacus")


def test_functions_are_not_hidden_by_modules():
    """`clfur.film` and `clfur.render` are functions, whatever was imported before or after them."""
    code = ("import clfur.film.jobs, clfur.render, clfur\nassert callable(clfur.film) and callable(clfur.render)\n"
            "import clfur.film.moments\nfrom clfur.render import OUTPUTS\nimport clfur.film\n"
            "assert callable(clfur.film) and callable(clfur.render) and OUTPUTS\n"
            "assert clfur.files.images.READERS if clfur.load else None\n"
            "assert clfur.device.selection.find and clfur.errors.Error is clfur.Error and clfur.budget.LADDER\n")
    fresh(code)
    modules = [path.stem for path in (ROOT / "clfur").iterdir() if path.stem not in ("film", "render", "py")
               and (path.suffix == ".py" or path.is_dir()) and not path.stem.startswith("_")]
    assert len(modules) > 15 and all(isinstance(getattr(library, name), types.ModuleType) for name in modules)


def test_help(clfur):
    """Of all commands: their names, their first lines, and what each takes."""
    code, out, _ = clfur("--help")
    lines = [line.split(maxsplit=1) for line in out.split("Commands:\n")[1].splitlines()]
    assert code == 0 and [name for name, _ in lines] == list(COMMANDS) == sorted(COMMANDS)
    for name, line in lines:
        command = group.get_command(None, name)
        assert command.name == name and command.help.startswith(line.removesuffix("..."))
        code, out, _ = clfur(name, "--help")
        assert code == 0 and out.startswith(f"Usage: clfur {name} ") and command.help.split("\n")[0][:60] in out
    wrong(clfur("rende"), "No such command 'rende'")


@pytest.fixture
def first(tmp_path, monkeypatch):
    """As in the first run on a machine; and a list of what was asked in other processes, in the place of drivers."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    isolated, asked = devices.isolated, []

    def spied(function, *_, **options):
        asked.append(function)
        return isolated("time:sleep", 600, **options)
    monkeypatch.setattr(devices, "isolated", spied)
    return asked


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks /proc for children")
@pytest.mark.parametrize("arguments, words", [
    (["cow"], "cow: no such file"), (["teapot", "--size", "0x1"], "--size"), (["a.py"], "a.py: no such file")])
def test_nobody_waits_for_drivers_in_vain(clfur, first, tmp_path, arguments, words):
    """An error before OpenCL is told at once, and whom drivers were asked of is gone."""
    began = time.monotonic()
    wrong(clfur("render", *arguments), words)
    assert first == ["clfur.device.selection:survey"] and time.monotonic() - began < 10
    children = [each.read_text() for each in Path("/proc/self/task").glob("*/children")]
    assert "".join(children).split() == [] and not any(
        thread.name.startswith("ThreadPool") for thread in threading.enumerate())
    assert not (tmp_path / "cache" / "clfur" / "loaded").exists()   # of these drivers nothing is known


def test_help_asks_no_drivers(clfur, first):
    for arguments in (["render", "--help"], ["film", "-h"], ["--help"], []):
        assert clfur(*arguments)[0] == 0
    assert first == []


def test_drivers_are_asked_first(tmp_path):
    """Before this process imports what takes long; and once.  NumPy's threads are told before not to spin."""
    code = ("import os, sys\nfrom clfur.command import devices, main\nisolated, asked = devices.isolated, []\n"
            "def spied(*arguments, **options):\n"
            "    asked.append('numpy' in sys.modules or os.environ['OPENBLAS_THREAD_TIMEOUT'])\n"
            "    return isolated(*arguments, **options)\n"
            "devices.isolated = spied\n"
            "for _ in range(2):\n    try:\n        main.main(sys.argv[1:])\n"
            "    except SystemExit as end:\n        print(end.code, asked)\n")
    told = fresh(code, "render", "sphere", "-o", str(tmp_path / "a.png"), "--size", "16x12", "--roots", "50",
                 XDG_CACHE_HOME=str(tmp_path / "cache"), POCL_CACHE_DIR=str(caches.folder())).splitlines()
    assert [line for line in told if line.startswith("0 ")] == ["0 ['4']"] * 2


def test_who_looks_at_all_modules_imports_none():
    """As `inspect` does, and tracebacks of IPython: clfur.truth and others are there from the start."""
    assert imported("import clfur, inspect; inspect.getmodule(compile('1', 'x', 'exec'))") & DEAR == set()


def test_completion_asks_no_drivers(monkeypatch):
    monkeypatch.setattr(sys.modules["clfur.command.main"], "asking_drivers", None)
    found = ShellComplete(group, {}, "clfur", "_CLFUR_COMPLETE").get_completions(["render"], "--de")
    assert "--device" in [each.value for each in found]


def test_drivers_are_asked_where_nobody_has_begun_to(monkeypatch, tmp_path):
    """Such as beside an option whose value looks like --help."""
    asked = []
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(devices.cache, "folder", lambda _: tmp_path / "file" / "cache")   # nothing is remembered
    monkeypatch.setattr(devices, "survey", asked.append)
    devices.ask_drivers()
    assert len(asked) == 1 and not devices._asked
    with devices.asking_drivers():
        devices.ask_drivers()
        devices.ask_drivers()
    assert len(asked) == 2
