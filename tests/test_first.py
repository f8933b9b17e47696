"""The first picture of a process: kernels are built beside what else is done, and what waited for them is told."""

import threading

import numpy as np
import pytest
from support.plans import plan_of

import clfur
from clfur.device import caches
from clfur.device.scheduler import CHECKER, Scheduler
from clfur.stages.strands import SORTED_FROM

CURVES = np.random.default_rng(1).random((SORTED_FROM, 3, 3))
FUR = {"none": None, "faces": clfur.Strands(inner=1, outer=1), "roots": clfur.Strands(roots=50),
       "curves": clfur.Curves(CURVES[:9]), "many": clfur.Curves(CURVES), "shells": clfur.Shells(),
       "both": (clfur.Shells(), clfur.Strands(roots=50))}
SETTINGS = [{}, {"raster": "samples"}, {"shadows": "off"}, {"shadows": "off", "shadow_map": 0}, {"lod": 1.0},
            {"blur": "all"}, {"shadows": "count", "raster": "samples", "lod": 0.5}, {"shadow_map": 0}]


@pytest.mark.parametrize("fur", FUR)
def test_the_plan_names_the_kernel_files_that_are_run(gpu, sphere, fur, monkeypatch):
    """All of them, so that none is waited for alone; no other, which would be built for nothing."""
    run, launch = set(), Scheduler.launch

    def spied(self, name, *rest, **arguments):
        run.add(name.split(".")[0])
        return launch(self, name, *rest, **arguments)
    monkeypatch.setattr(Scheduler, "launch", spied)
    # Thousands of strands in each pixel take half a minute a frame where drivers end long loops.
    for keys in SETTINGS[1:2] if fur == "many" else SETTINGS:
        for outputs in ("color",), ("depth",), ("color", "id"):
            for color in 1.0, 0.0:
                scene = clfur.Scene(mesh=sphere, fur=FUR[fur], camera=clfur.Camera(size=(16, 12)),
                                    light=clfur.Light(color=(color,) * 3))
                settings = clfur.Settings(grid=16, **{"shadow_map": 16, **keys})
                run.clear()
                gpu.forget()
                clfur.draw(scene, gpu, settings, outputs)
                assert set(plan_of(scene, settings, outputs).kernel_files) == run, (keys, outputs, color)


def test_kernels_are_built_in_another_thread(gpu, monkeypatch):
    if gpu.device.platform.name == CHECKER:
        pytest.skip("it is asked by one thread alone")
    fresh, threads, build = Scheduler(gpu.device), [], Scheduler._build

    def spied(self, stem):
        threads.append((stem, threading.current_thread()))
        return build(self, stem)
    monkeypatch.setattr(Scheduler, "_build", spied)
    with fresh.frame():
        fresh.prepare(["zscan", "blur"])
        fresh.prepare(["blur", "zscan"])
        sums, total = fresh.upload(np.arange(10, dtype=np.uint64)), fresh.empty(1, np.uint64)
        fresh.launch("strands.scan_sums", 1, n=10, sums=sums, total=total)   # which was not prepared
    here = [stem for stem, thread in threads if thread is threading.current_thread()]
    beside = [stem for stem, thread in threads if thread is not threading.current_thread()]
    assert here == ["strands"] and beside == ["zscan", "blur"][:len(beside)]   # what nobody needs may be left out
    assert fresh.download(total)[0] == 45 and not fresh._aheads


def test_what_does_not_build_beside_is_told_where_it_is_run(gpu, monkeypatch):
    fresh, build = Scheduler(gpu.device), Scheduler._build

    def fails(self, stem):
        if stem == "zscan":
            raise clfur.DeviceError("made up")
        return build(self, stem)
    monkeypatch.setattr(Scheduler, "_build", fails)
    with fresh.frame():
        fresh.prepare(["zscan"])   # nobody needs it
    with fresh.frame(), pytest.raises(clfur.DeviceError, match="made up"):
        fresh.prepare(["zscan"])
        fresh.launch("zscan.columns", 1)
    monkeypatch.setattr(Scheduler, "_build", build)
    with fresh.frame(), pytest.raises(TypeError, match="misses"):   # by now it is built
        fresh.prepare(["zscan"])
        fresh.launch("zscan.columns", 1)


def test_a_frame_tells_what_of_it_was_building(gpu, sphere):
    fresh = Scheduler(gpu.device)
    scene = clfur.Scene(mesh=sphere, camera=clfur.Camera(size=(16, 12)))
    first = clfur.draw(scene, fresh, clfur.Settings(shadow_map=16))
    fresh.forget()
    again = clfur.draw(scene, fresh, clfur.Settings(shadow_map=16))
    assert 0 < first.building < first.seconds and again.building == 0
    np.testing.assert_array_equal(first.images["color"], again.images["color"])


def test_threads_that_take_kernels_share_a_mark(tmp_path, monkeypatch):
    monkeypatch.setattr(caches.cache, "folder", tmp_path.joinpath)

    def marks():
        return list(caches._marks(caches.folder()).iterdir())
    assert not caches.are_taken()
    with caches.taking_kernels(caches.POCL):
        with caches.taking_kernels(caches.POCL):
            assert len(marks()) == 1
        assert len(marks()) == 1 and caches.are_taken()
        with caches.taking_kernels("another driver"):
            assert len(marks()) == 1
    assert not marks() and not caches.are_taken()
