"""Systems that are not Linux, as far as one can be made up: what they lack is taken away, or their names are given."""

import ast
import importlib.util
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace as Made

import pytest

import clfur as library
from clfur.command import devices as cli_devices
from clfur.command import endings
from clfur.device import pocl, selection, vendors
from clfur.judge import compare, isolated, report

ROOT = Path(__file__).resolve().parents[1]

# Run by each Python at its start: takes away what only some systems have, and /proc, but for what a driver must ask
# on Linux (see clfur/device/pocl.py) and for psutil, which does without on the others.
LESS = """
import os, psutil, signal, sys
for module, names in {os: ("fork", "forkpty", "killpg", "getpgrp", "setsid", "sched_getaffinity", "register_at_fork",
                           "getloadavg", "mkfifo"),
                      signal: ("SIGHUP", "SIGALRM", "SIGUSR1", "SIGXFSZ", "pthread_sigmask")}.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
for name in ("resource", "fcntl", "pwd", "grp", "termios"):
    sys.modules[name] = None

def hide(event, arguments):
    if event == "open" and str(arguments[0]).startswith("/proc") and arguments[0] not in (
            "/proc/self/mem", "/proc/cpuinfo"):
        frame = sys._getframe(1)
        while frame and "psutil" not in frame.f_code.co_filename:
            frame = frame.f_back
        if not frame:
            raise FileNotFoundError(2, "No such file or directory")
sys.addaudithook(hide)
"""


@pytest.fixture
def less(tmp_path):
    """Runs Python with less -> (exit code, stdout, stderr)."""
    (tmp_path / "start").mkdir()
    (tmp_path / "here").mkdir()
    (tmp_path / "start" / "sitecustomize.py").write_text(LESS, encoding="utf-8")
    path = os.pathsep.join([str(tmp_path / "start"), str(ROOT)])

    def run(*arguments):
        done = subprocess.run([sys.executable, *map(str, arguments)], cwd=tmp_path / "here", text=True,
                              capture_output=True, timeout=300, env=os.environ | {"PYTHONPATH": path})
        return done.returncode, done.stdout, done.stderr
    return run


def test_less_is_less(less):
    code = ("import os, signal\nassert not hasattr(os, 'fork') and not hasattr(signal, 'SIGHUP')\n"
            "try:\n    open('/proc/self/status')\nexcept FileNotFoundError:\n    print('gone')")
    assert less("-c", code) == (0, "gone\n", "")


@pytest.mark.parametrize("suffix", ["png", "exr", "npz"])
def test_a_picture_with_less(less, tmp_path, suffix):
    code, out, err = less("-m", "clfur", "render", "sphere", "--roots", 50, "--size", "40x30", "-o", f"a.{suffix}")
    assert (code, err) == (0, "") and out.startswith(f"a.{suffix}: ")
    assert [file.name for file in (tmp_path / "here").iterdir()] == [f"a.{suffix}"]


def test_devices_and_compare_with_less(less, tmp_path):
    """Their children end, and what nobody tells is a dash."""
    code, out, err = less("-m", "clfur", "devices")
    assert (code, err) == (0, "") and "auto takes" in out
    code, out, err = less("-m", "clfur", "compare", "sphere", "--devices", "auto", "--repeat", 1, "--size", "32x24",
                          "--roots", 50, "-o", "a.html")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    row = lines[next(n for n, line in enumerate(lines) if "process MiB" in line) + 1]
    assert row.split()[-1] == "–"
    assert "<td>–</td></tr>" in (tmp_path / "here" / "a.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("system, machine, words", [
    ("linux", "x86_64", "pip install pocl-binary-distribution"), ("linux", "aarch64", "apt install pocl-opencl-icd"),
    ("win32", "AMD64", "pip install intel-opencl-rt"), ("win32", "ARM64", "a graphics driver"),
    ("darwin", "arm64", "macOS has one of its own"), ("darwin", "x86_64", "conda-forge"),
    ("freebsd14", "amd64", "a graphics driver")])
def test_what_brings_a_driver(monkeypatch, system, machine, words):
    """And nothing is told that is not to be had there."""
    monkeypatch.setattr(vendors, "sys", Made(platform=system))
    monkeypatch.setattr(vendors, "platform", Made(machine=lambda: machine))
    said = vendors.advice()
    assert words in said and "\n" not in said
    assert ("pip install" in said) == ((system, machine) in [("linux", "x86_64"), ("win32", "AMD64")])
    with pytest.raises(library.Error, match="there is no OpenCL device; .*") as raised:
        selection.pick("auto", [])
    assert words in str(raised.value)


@pytest.mark.parametrize("system, words", [("win32", "registry"), ("darwin", "OpenCL of macOS")])
def test_drivers_that_no_file_names(clfur, monkeypatch, system, words):
    """No word of .icd files or of /etc there, and no variable is set that has no meaning."""
    monkeypatch.setattr(vendors, "sys", Made(platform=system))
    monkeypatch.setattr(cli_devices, "sys", Made(platform=system))
    monkeypatch.setattr(vendors, "_intel", lambda: None)
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    monkeypatch.delenv("OCL_ICD_FILENAMES", raising=False)
    listed, lines = vendors.vendors()
    assert listed == [] and len(lines) == 1 and words in lines[0]
    assert not {"OCL_ICD_VENDORS", "OCL_ICD_FILENAMES"} & os.environ.keys()
    assert clfur("devices", "--why") == (0, lines[0] + "\n", "")


def test_intel_in_windows(monkeypatch, tmp_path):
    """Its wheel tells nobody of the library; the loader in pyopencl's wheel is told by a variable."""
    monkeypatch.setattr(vendors, "sys", Made(platform="win32"))
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    monkeypatch.setenv("OCL_ICD_FILENAMES", "before")   # so that it is as it was after the test
    monkeypatch.delenv("OCL_ICD_FILENAMES")
    library = tmp_path / "Library" / "bin" / "intelocl64.dll"
    library.parent.mkdir(parents=True)
    library.touch()
    files = {"intel-opencl-rt": [Made(name="OpenCL.dll", locate=lambda: library.with_name("OpenCL.dll")),
                                 Made(name="intelocl64.dll", locate=lambda: library)]}
    monkeypatch.setattr("importlib.metadata.files", files.get)
    assert vendors.prepare() is None and os.environ["OCL_ICD_FILENAMES"] == str(library)
    monkeypatch.setenv("OCL_ICD_FILENAMES", "mine.dll")
    assert vendors.prepare() is None and os.environ["OCL_ICD_FILENAMES"] == "mine.dll"
    assert "OCL_ICD_VENDORS" not in os.environ


def test_children_without_groups(monkeypatch):
    monkeypatch.delattr(os, "killpg")
    outcome = isolated.isolated("time:sleep", 600, seconds=2)
    assert (outcome.status, outcome.message) == ("hang", "no answer in 2 s")


@pytest.mark.parametrize("code, words", [
    (0xC0000005, "ended with code 0xc0000005"), (3, "ended with code 3"), (-11, "died of SIGSEGV")])
def test_how_a_process_ended(code, words):
    assert isolated._death(code) == words


def test_memory_without_proc(monkeypatch):
    def nothing(self):
        raise FileNotFoundError(2, "No such file or directory")
    here = compare.peak_memory()
    monkeypatch.setattr(Path, "read_bytes", nothing)
    assert here / 2 < compare.peak_memory() < here * 2
    monkeypatch.setattr(sys, "platform", "darwin")   # bytes there, KiB elsewhere
    assert compare.peak_memory() * 512 < here
    monkeypatch.setitem(sys.modules, "resource", None)
    assert compare.peak_memory() is None and report.mebibytes(None) == "–"


def test_processors_without_proc(monkeypatch):
    def nothing(*_, **__):
        raise FileNotFoundError(2, "No such file or directory")
    monkeypatch.setattr(os, "open", nothing)
    monkeypatch.setattr(Path, "read_text", nothing)
    assert pocl.rename(0) is None and pocl.features() == set()


def test_signals_that_are_not_there(monkeypatch):
    monkeypatch.delattr(signal, "SIGHUP")
    spec = importlib.util.spec_from_file_location("clfur.command.endings", endings.__file__)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.SIGNALS == [signal.SIGINT, signal.SIGTERM]


def undecided(source):
    """Lines of a text of Python that read or write text without saying in which encoding."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or "encoding" in {keyword.arg for keyword in node.keywords}:
            continue
        method = isinstance(node.func, ast.Attribute)
        name, place = (node.func.attr, 0) if method else (getattr(node.func, "id", ""), 1)
        given = node.args[place] if len(node.args) > place else ast.Constant("r")
        mode = given.value if isinstance(given, ast.Constant) else ""
        if name in ("read_text", "write_text") or (name == "open" and re.fullmatch("[rwax+t]+", str(mode))):
            found.append(node.lineno)
    return found


@pytest.mark.parametrize("path", sorted(path for folder in ("clfur", "tools", "examples")
                                        for path in (ROOT / folder).rglob("*.py")),
                         ids=lambda path: str(path.relative_to(ROOT)))
def test_texts_have_an_encoding(path):
    """Windows would take another for each country."""
    assert not undecided(path.read_text(encoding="utf-8"))


def test_texts_without_an_encoding_are_found():
    assert undecided("p.read_text()\np.write_text('a')\nopen(p)\nopen(p, 'w')\np.open()\np.open('a')\n"
                     "with open(p, 'w') as f: pass") == [1, 2, 3, 4, 5, 6, 7]
    assert not undecided("p.read_text(encoding='utf-8')\nopen(p, 'rb')\np.open('wb')\nImage.open(path)\n"
                         "os.open(path, os.O_RDONLY)\nopen(p, encoding='utf-8')")
