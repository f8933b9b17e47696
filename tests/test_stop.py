"""What is stopped half way leaves all as it was: `stop=`, and Ctrl-C at any launch."""

import threading
from functools import partial

import attrs
import numpy as np
import pytest
from support.devices import DEVICES
from support.pictures import same
from support.scenes import icosphere, scene_of

import clfur
from clfur.files.images import load
from clfur.motion import motion as moving

QUICK = clfur.Settings(samples=1, grid=16, shadow_map=16)


class Asked:
    """A ``stop`` that says True once, when it is asked for the ``at``-th time, and counts."""

    def __init__(self, at=0):
        self.times, self.at, self.lock = 0, at, threading.Lock()

    def __call__(self):
        with self.lock:
            self.times += 1
            return self.times == self.at


def _scene(kind=300, **more):
    positions, faces = icosphere(1)
    scene = scene_of(kind, clfur.Mesh(positions, positions, faces=faces))
    return attrs.evolve(scene, camera=clfur.Camera(eye=(0, .4, 3.2), size=(40, 30)), **more)


def _look(scene, look):
    return attrs.evolve(scene, fur=attrs.evolve(scene.fur, types=attrs.evolve(scene.fur.types[0], look=look)))


def _both(scene):
    return attrs.evolve(scene, fur=(clfur.Shells(length=.15, layers=6), scene.fur))


WAYS = {
    "default": (_scene(), {}),
    "samples": (_scene(), {"settings": attrs.evolve(QUICK, raster="samples", lod=1.0, blur="all")}),
    "curves": (_scene("curves"), {"region": (8, 4, 20, 16), "outputs": ("color", "depth", "matte_id", "strand_area")}),
    "shells": (_both(_scene()), {"before": _both(_scene()), "outputs": ("color", "motion_vector", "uv")}),
    "sky": (_scene(environment=clfur.Environment((.4, .5, .6)), ground=clfur.Ground(-1.2)), {}),
    "scattering": (_look(_scene(), clfur.Chiang()), {"settings": attrs.evolve(QUICK, scattering="grid")}),
    "deep": (_scene(), {"settings": attrs.evolve(QUICK, shadows="deep", masks=4)}),
    "error": (_scene(), {"settings": clfur.Settings(max_error=.2)})}


def _stops(n, most=7):
    """So many of the n times that something is asked, first and last among them."""
    return sorted({1, *range(1, n, max(n // most, 1)), n})


def _all_ways(draw, gpus, want):
    """``draw(stop)`` is stopped at many places, of a first frame and of a later one; then it is as it was."""
    for gpu in gpus:
        gpu.forget()
    counted = Asked()
    same(want, draw(counted))
    assert counted.times > 10
    for first in (True, False):
        for at in _stops(counted.times if first else counted.times // 2):
            if first:
                for gpu in gpus:
                    gpu.forget()
            stop = Asked(at)
            try:
                draw(stop)
            except clfur.Stopped:
                pass
            else:
                assert stop.times < at or len(gpus) > 1   # warm frames ask less often
            same(want, draw(None))


@pytest.mark.parametrize("way", WAYS)
def test_a_frame_that_is_stopped_leaves_no_trace(gpu, way):
    scene, how = WAYS[way]
    draw = partial(clfur.draw, scene, gpu, hashes=True, **{"settings": QUICK} | how)
    _all_ways(lambda stop: draw(stop=stop), [gpu], draw())
