"""Folders for kernels: those that cannot be written, and those that a crash or a full disk has spoilt."""

import errno
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import pyopencl as cl
import pytest

import clfur
from clfur import cache
from clfur.device import caches, programs, scheduler
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
    code = DIES.replace("sys.argv[1]", repr(str(place.parent))).format(signal=int(number))
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
        self.spoilt, self.how, self.built, self.real = spoilt, how, [], cl.Program

    def __call__(self, context, source, *binaries):
        return Made(self, self.real(context, source, *binaries), source)


class Made:
    def __init__(self, driver, program, source):
        self.driver, self.program, self.source = driver, program, source

    def build(self, options):
        self.driver.built.append(self.source)
        if self.how == "error":
            raise cl.RuntimeError("clBuildProgram failed: BUILD_PROGRAM_FAILURE")
        return self.program.build(options)

    @property
    def how(self):
        return self.driver.how if self.driver.spoilt(self.source) else ""

    def all_kernels(self):
        return [] if self.how == "no kernels" else self.program.all_kernels()

    def get_info(self, what):
        return self.program.get_info(what)


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
    assert len(driver.built) == 2
    if gpu.device.platform.name == caches.POCL:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            fresh._build("zscan")
        assert str(caches.folder()) in str(said[-1].message)


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


def test_kernels_give_no_warnings(gpu):
    """Programs are built with -w: what it hides are remarks on how vectors are passed, for some processors."""
    from clfur import layout
    for stem in sorted(path.stem for path in scheduler.kernel_dir().iterdir() if path.name.endswith(".cl")):
        source = layout.preamble(gpu.int64_atomics, lanes=gpu.lanes) + scheduler._text("common.h") + scheduler._text(
            f"{stem}.cl")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)
            program = cl.Program(gpu.context, source).build(["-cl-std=CL1.2"])
        log = program.get_build_info(gpu.device, cl.program_build_info.LOG)
        lines = [line for line in log.splitlines() if "warning" in line.lower()]
        assert not [line for line in lines if "changes the ABI" not in line and "warnings generated" not in line]


def test_a_first_run_is_quiet(tmp_path):
    code, out, err = in_a_process(DRAW, HOME=str(tmp_path))
    assert (code, err) == (0, "") and out.endswith("True\n")
