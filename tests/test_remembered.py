"""What is kept of scenes ends with them: no array stays on a device that nobody has any more."""

import gc
import weakref

import attrs
import numpy as np
import pytest

import clfur
from clfur.scene.remembered import remembered

QUICK = clfur.Settings(samples=1, grid=16, shadow_map=16)


class Thing:
    """What a function is of."""


def test_what_was_given_is_given_again_while_its_arguments_are_there():
    calls = []

    @remembered(2)
    def function(*given):
        calls.append(len(given))
        return object()
    one, other = Thing(), Thing()
    first = function(one, (other, 3), None)
    assert function(one, (other, 3), None) is first is function(one, (other, np.int64(3)), None) and calls == [3]
    assert function(one, (other, 4), None) is not first and function(other, (one, 3), None) is not first
    assert function(one, (other, 3), None) is not first and calls == [3] * 4   # two are kept, the newest ones
    there = weakref.ref(other)
    del other
    assert there() is None
    last, taken = function(one), id(one)
    one = Thing()
    while id(one) != taken and len(calls) < 1000:   # the next one may lie where the last one did
        one = None
        one = Thing()
        calls.append(0)
    assert function(one) is not last


def test_arguments_that_are_given_back_are_not_kept():
    @remembered(4)
    def function(thing, others):
        return thing, (*others, 5)
    one, two = Thing(), Thing()
    first, again = (function(one, (two, None)) for _ in range(2))
    assert first == again == (one, (two, None, 5))
    there = [weakref.ref(each) for each in (one, two)]
    del one, two, first, again
    assert [each() for each in there] == [None, None]

    @remembered(4)
    def center(thing):
        return np.zeros(3), 1.0
    one = Thing()
    assert center(one) is center(one)   # a tuple, too


def held(gpu, **fields):
    """Curves whose points are on a device, and the references of both."""
    roots = np.random.default_rng(0).normal(size=(80, 1, 3))
    roots /= np.linalg.norm(roots, axis=2, keepdims=True)
    points = gpu.upload((roots * np.linspace(1, 1.3, 4)[:, None]).astype(np.float32).reshape(-1, 3))
    curves = clfur.Curves(points=points, counts=np.full(80, 4), width=.02, **fields)
    return curves, [weakref.ref(points), weakref.ref(curves)]


def scene_of(fur, mesh, **more):
    camera = clfur.Camera(eye=(0, .3, 4), target=(0, 0, 0), size=(32, 24))
    return clfur.Scene(mesh, fur, **{"camera": camera, "ground": clfur.Ground(-2)} | more)


def plain(gpu, mesh):
    curves, there = held(gpu)
    clfur.draw(scene_of(curves, mesh), gpu, QUICK)
    return there


def alone(gpu, mesh):
    curves, there = held(gpu, look=clfur.Chiang())
    clfur.draw(scene_of(curves, None, environment=clfur.Environment((1, 1, 1))), gpu,
               attrs.evolve(QUICK, scattering="grid"))
    return there


def far_away(gpu, mesh):
    curves, there = held(gpu, origin=(1e5, 0, 0))
    mesh = clfur.Mesh(mesh.positions, faces=mesh.faces, origin=(1e5, 0, 0))
    camera = clfur.Camera(eye=(1e5, .3, 4), target=(1e5, 0, 0), size=(32, 24))
    clfur.draw(scene_of(curves, mesh, camera=camera), gpu, QUICK)
    return there


def beside_shells(gpu, mesh):
    curves, there = held(gpu)
    clfur.draw(scene_of([clfur.Shells(length=.1, layers=5), curves], mesh), gpu, attrs.evolve(
        QUICK, raster="samples", lod=1.0, shadows="count"))
    return there


def as_guides(gpu, mesh):
    curves, there = held(gpu)
    clfur.draw(scene_of(clfur.Strands(guides=curves, roots=50), mesh), gpu, QUICK)
    return there


def moving(gpu, mesh):
    motion = clfur.Motion(scene_of(clfur.Strands(roots=50), mesh), device=gpu)
    there = []
    for frame in range(3):
        scene = motion.at(frame)
        clfur.draw(scene, gpu, QUICK)
        there += map(weakref.ref, (scene.strands.points, scene.strands))
    return there


@pytest.mark.parametrize("draw", [plain, alone, far_away, beside_shells, as_guides, moving])
def test_arrays_on_a_device_go_with_their_scene(another, sphere, draw):
    gpu = another()
    there = draw(gpu, sphere)
    gpu.forget()   # what it keeps of its last frame
    gc.collect()
    assert [each() for each in there] == [None] * len(there)
