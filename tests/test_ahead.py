"""Kernels that are built ahead of their first launch, by this process and, where they are not kept, by others."""

import os
import re
import signal
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pyopencl as cl
import pytest

import clfur
from clfur.device import ahead, caches, signature, source
from clfur.device.ahead import Ahead, Builder, starts
from clfur.device.caches import POCL, unheard
from clfur.device.scheduler import Scheduler

FILES = ["one", "two", "three", "four", "five"]
COLD, WARM = 0.6, 0.0   # seconds that a file takes
KERNELS = {file: [f"{file}.a", f"{file}.b"] for file in FILES}
JOBS = {*FILES, *(kernel for kernels in KERNELS.values() for kernel in kernels)}


class Work:
    """What is done where: a stand-in for drivers, which take a while for each of `JOBS`."""

    def __init__(self, takes=COLD / 20, first=COLD, fails=(), dies=False):
        self.here, self.there, self.takes, self.first, self.fails, self.dies = [], [], takes, first, fails, dies
        self.started = self.ended = 0

    def build(self, job):
        time.sleep(self.first if job == "one" else self.takes)
        self.here.append(job)
        if job in self.fails:
            raise clfur.DeviceError(f"{job} does not build")

    def start(self):
        self.started += 1
        return There(self)

    def begin(self, number=1):
        return Ahead(FILES, self.build, KERNELS.get, [self.start] * number)


class There:
    """A stand-in for another process."""

    def __init__(self, work):
        self.work = work

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.work.ended += 1

    def build(self, job):
        time.sleep(self.work.takes)
        self.work.there.append(job)
        return not self.work.dies


def finished(job):
    """Wait till all is done, without asking for anything."""
    for thread in job._threads:
        thread.join(30)
        assert not thread.is_alive()


def test_each_thing_is_done_once_by_one_of_two():
    """Files before kernels, this process from the first on, the other from the last."""
    work = Work()
    finished(work.begin())
    assert sorted(work.here + work.there) == sorted(JOBS) and work.started == work.ended == 1
    assert work.here[0] == "one" and work.there[:2] == ["five", "four"]
    kernels = [kernel for file in FILES for kernel in KERNELS[file]]
    assert work.here == [job for job in FILES + kernels if job in work.here]
    assert work.there[:4] == FILES[:0:-1] and set(work.there[4:]) <= set(kernels)


def test_no_process_is_started_where_the_first_file_is_kept():
    """And who launches a kernel makes it, as that takes no time."""
    work = Work(first=WARM)
    job = work.begin()
    job.wait_for("five.b")
    finished(job)
    assert sorted(work.here) == sorted(FILES) and not work.started


def test_a_process_is_started_where_a_later_file_is_not_kept(monkeypatch):
    monkeypatch.setattr(ahead, "FEW", 1)
    work = Work(first=WARM)
    work.build = lambda job: (time.sleep(COLD * (job == "two")), work.here.append(job))
    finished(work.begin())
    assert work.started == 1 and work.there[0] == "five"


def test_no_process_is_started_for_few_files():
    work = Work()
    finished(Ahead(FILES[:ahead.FEW], work.build, KERNELS.get, [work.start]))
    assert len(work.here) == 3 * ahead.FEW and not work.started


def test_no_process_is_started_for_what_was_left():
    work, begun = Work(takes=0, first=3 * ahead.LONG), threading.Event()
    job = Ahead(FILES, lambda file: (begun.set(), work.build(file)), KERNELS.get, [work.start])
    begun.wait()
    job.leave()
    assert work.here == ["one"] and not work.started
    with pytest.raises(clfur.Stopped):
        job.wait_for("five.a")


def test_what_cannot_be_read_fails_and_holds_nobody_up():
    def unreadable(file):
        raise OSError("too many open files")
    job = Ahead(["one"], lambda file: time.sleep(2 * ahead.LONG), unreadable)
    with pytest.raises(OSError, match="too many"):
        job.wait_for("one.a")
    finished(job)


def test_what_others_build_is_building(monkeypatch):
    """It is told where one waits."""
    work, told, build = Work(), [], There.build

    def spied(self, job):
        told.append(caches.are_taken())
        return build(self, job)
    monkeypatch.setattr(There, "build", spied)
    finished(work.begin())
    assert told and all(told) and not caches.are_taken()


@pytest.mark.parametrize("dies", [False, True])
def test_several_processes_and_some_that_die(dies, monkeypatch):
    """What one was at when it died counts as done: it is built where it is launched."""
    monkeypatch.setattr(ahead, "FEW", 1)
    work = Work(dies=dies)
    finished(work.begin(3))
    assert sorted(work.here + work.there) == sorted(JOBS) and work.started == work.ended == 3
    assert (len(work.there) == 3) == dies


def test_where_no_process_starts_all_is_done_here():
    def start():
        raise OSError("no more processes")
    work = Work()
    finished(Ahead(FILES, work.build, KERNELS.get, [start]))
    assert sorted(work.here) == sorted(JOBS)


def test_what_fails_is_told_to_who_waits_for_it():
    """A file's error; a kernel fails anew where it is launched.  The others are done."""
    work = Work(fails=["two", "three.a"])
    job = work.begin(0)
    with pytest.raises(clfur.DeviceError, match="two does not build"):
        job.wait_for("two.b")
    finished(job)
    assert set(work.here) == JOBS - {"two.a", "two.b"}
    job.wait_for("three.a")


def test_what_is_waited_for_is_done_next():
    work = Work(takes=0.05, first=2 * ahead.LONG)
    job = work.begin(0)
    job.wait_for("four.b")
    assert len(work.here) < 7 and "four.a" not in work.here
    job.wait_for("five.rare")   # its file, for it is none of these
    assert len(work.here) < 9 and "five.a" not in work.here
    finished(job)
    assert sorted(work.here) == sorted(JOBS)


def test_what_is_begun_is_waited_for_at_the_end_and_nothing_else():
    work, begun = Work(), threading.Event()
    job = Ahead(FILES, lambda file: (begun.set(), work.build(file)), KERNELS.get, [work.start])
    begun.wait()
    time.sleep(2 * ahead.LONG)
    job.leave()
    assert work.here == ["one"] and work.started == work.ended == 1 and 0 < len(work.there) < len(JOBS) - 1
    assert not any(thread.is_alive() for thread in job._threads)


def test_processes_are_started_for_processors_of_pocl_alone(monkeypatch):
    monkeypatch.setattr(ahead, "local_devices", lambda device: ["0:0"])
    monkeypatch.setattr(sys, "executable", "/usr/bin/python3")
    monkeypatch.delenv("POCL_KERNEL_CACHE", raising=False)
    plenty = 1 << 40

    def device(units=16, name=POCL, kind=cl.device_type.CPU):
        return SimpleNamespace(platform=SimpleNamespace(name=name), type=kind, max_compute_units=units)
    assert [len(starts(device(units), plenty)) for units in (1, 2, 3, 16)] == [0, 1, 2, 3]
    assert [len(starts(device(), gib << 30)) for gib in (1, 2, 4, 8)] == [0, 1, 2, 3]
    assert not starts(device(name="Intel(R) OpenCL"), plenty) and not starts(device(kind=cl.device_type.GPU), plenty)
    for program in "", None, "/opt/maya/bin/maya.bin", "/usr/bin/blender":   # which would start once more
        monkeypatch.setattr(sys, "executable", program)
        assert not starts(device(), plenty)
    monkeypatch.setattr(sys, "executable", r"Python.exe")
    assert starts(device(), plenty)
    monkeypatch.setenv("POCL_KERNEL_CACHE", "0")
    assert not starts(device(), plenty)


@pytest.fixture
def pocl(gpu):
    if not starts(gpu.device, 1 << 40):
        pytest.skip("a driver that builds by itself")
    return gpu


def kept(folder):
    return {path.stem for path in folder.rglob("*.so")}


def test_another_process_makes_kernels_that_the_driver_keeps(pocl, tmp_path, monkeypatch):
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    start, = starts(pocl.device, 2 << 30)
    with start() as builder:
        assert builder.build("zscan") and not kept(tmp_path) and list(tmp_path.rglob("program.bc"))
        assert builder.build("zscan.columns") and kept(tmp_path) == {"columns"}
    assert builder._child.returncode == 0
    with start() as builder:
        assert not builder.build("no such file") and not builder.build("zscan")
    assert builder._child.returncode == 1


def test_a_builder_that_has_died_says_so(pocl):
    with Builder("999:0") as builder:
        assert not builder.build("zscan") and not builder.build("zscan")


def test_a_picture_is_drawn_with_what_another_process_builds(pocl, sphere, monkeypatch):
    """It is begun at once, with what is needed last, and told nothing of the device but its number."""
    monkeypatch.setattr(ahead, "LONG", 0)
    monkeypatch.setattr(ahead, "FEW", 1)
    there, build, begun, here = [], Builder.build, threading.Event(), Scheduler._build

    def spied(self, job):
        there.append((job, build(self, job)))
        begun.set()
        return there[-1][1]
    monkeypatch.setattr(Builder, "build", spied)
    monkeypatch.setattr(Scheduler, "_build", lambda self, stem: begun.wait(60) and here(self, stem))
    scene = clfur.Scene(mesh=sphere, camera=clfur.Camera(size=(16, 12)), fur=clfur.Strands(roots=50))
    settings = clfur.Settings(grid=16, shadow_map=16)
    frame = clfur.draw(scene, Scheduler(pocl.device), settings)
    assert there[0] == ("coverage", True) and all(goes_on for _, goes_on in there)
    np.testing.assert_array_equal(frame.images["color"], clfur.draw(scene, pocl, settings).images["color"])


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="Windows")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_to_all_of_a_terminal_do_not_end_a_builder(pocl, tmp_path, monkeypatch, number):
    """It would leave what it builds half done; it ends when it is told to, also if another process holds its pipe."""
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    with unheard():
        builder, = [start() for start in starts(pocl.device, 2 << 30)]
    held = os.dup(builder._child.stdin.fileno())
    with builder:
        os.kill(builder._child.pid, getattr(signal, number))
        assert builder.build("zscan")
    os.close(held)
    assert builder._child.returncode == 0


def test_a_builder_takes_no_module_from_the_current_folder(pocl, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in "json", "subprocess", "numpy":
        (tmp_path / f"{name}.py").write_text("raise SystemExit(3)", encoding="utf-8")
    with starts(pocl.device, 2 << 30)[0]() as builder:
        assert builder.build("zscan")


def test_kernels_may_be_given_nothing(gpu):
    """Those that are made ahead are run over no work-items with null pointers: they end before they look at any."""
    for path in sorted(source.kernel_dir().glob("*.[ch]*")):
        text = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(encoding="utf-8"), flags=re.S)
        for name in signature.usual(text):
            body = re.search(rf"__kernel\s+void\s+{name}\s*\([^)]*\)\s*{{\s*(#if LANES [=><]+ 1\s*)?(\w+)", text)
            assert body and body[2] == "WORK_ITEM", f"{path.name}: {name}"
    fresh = Scheduler(gpu.device)
    for stem in "zscan", "lod":
        for name in fresh._to_make(stem):
            fresh.build(name)
            assert fresh._kernels[name].ran and fresh._kernels[name].nothing

