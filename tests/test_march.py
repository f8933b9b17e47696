"""Rays through shell fur: the twin's values on every device."""

import dataclasses

import numpy as np
import pytest
from support.furred import BENT, FUR, MESHES, SINE, noise_shape

import clfur
from clfur import layout
from clfur.pipeline.views import light_of, view_of
from clfur.scene import frame
from clfur.stages import march as stage
from clfur.stages import shells, sky
from clfur.stages.lighting import lighting_of, unshadowed
from clfur.stages.raster import raster
from clfur.stages.tessellate import tessellate
from clfur.twin import march as twin
from clfur.twin import sky as sky_twin

LIGHT = clfur.Light((1, -1, -0.6))
SPOT = clfur.Light((-1, -1, -1), position=(2, 2, 2), angle=35)


@dataclasses.dataclass
class Drawn:
    """What the device has drawn, and what it was drawn from."""

    view: np.ndarray
    packed: np.ndarray
    shell: shells.Shell
    visible: np.ndarray
    rounds: list
    image: np.ndarray
    shell_transmittance: np.ndarray
    shell_front: np.ndarray
    lights: list


def drawn(gpu, monkeypatch, mesh, fur, size=(24, 18), samples=1, filtered=True, bare=False, light=LIGHT, camera=None,
          lighting=None, sky=None):
    mesh = clfur.Mesh(*MESHES[mesh]) if isinstance(mesh, str) else mesh
    camera = camera or frame(mesh, fur, size, direction=(0.3, 0.5, 1))
    scene = clfur.Scene(mesh=mesh, fur=fur, camera=camera, light=light)
    view, lights = view_of(scene, samples), [light_of(light) for light in scene.lights]
    packed = shells.pack(fur, mesh, bare, filtered)
    topology = shells.topology_of(mesh.faces)
    shell = shells.bend(gpu, mesh, packed, shells.lay(gpu, mesh, packed, topology), topology)
    body = None if bare else tessellate(gpu, mesh, 1, 1, "flat")
    visible = raster(gpu, view, None, body) if body else gpu.full((size[1], size[0], samples), np.uint64, twin.NONE)
    rounds = []

    def watched(*arguments, **named):
        rounds.append(raster(*arguments, **named))
        return rounds[-1]
    monkeypatch.setattr(stage, "raster", watched)
    image, transmittance, front = stage.march(gpu, view, shell, packed, lighting or unshadowed(gpu, *lights), visible,
                                               sky)
    return Drawn(view, packed, shell, visible.get(), [entries.get() for entries in rounds], image.get(),
                 transmittance.get(), front.get(), lights)


def by_twin(it, direct=1.0, sky=None):
    """The twin's picture of what the device's stages have prepared."""
    pattern, packed, slabs = it.shell.pattern, it.packed, int(it.packed["kind"][2])
    return twin.march(
        it.view, packed, it.lights, it.visible, it.rounds, it.shell.border.get(),
        pattern.faces.get(), it.shell.curves.get()[:, :3].reshape(-1, slabs + 1, 3), it.shell.normals.get()[:, :3],
        pattern.lattice.get().reshape(-1, 8, 4), pattern.noise.get().reshape(*noise_shape(packed), 2),
        pattern.means.get(), direct, sky)


# --- the twin's values ----------------------------------------------------------------------------------

# The kernel's root is right to 5e-6, and so are its rays: hairs' edges are some hundred times as steep.
CLOSE = 1e-3
# Where a rounding error decides (a ray by another way past an edge, a step that is left out as too far from hair).
FLIPS, FLIP = 0.01, 0.5

CASES = {
    "cells": ("ball", FUR, {}),
    "cells, unfiltered": ("ball", FUR, {"filtered": False}),
    "cells, unfiltered, from far": ("ball", FUR | {"frequency": 40.0}, {"filtered": False}),
    "sine, unfiltered, from far": ("ball", SINE | {"frequency": 60.0}, {"filtered": False}),
    "cells, 4 samples": ("ball", FUR, {"samples": 4}),
    "cells, bent": ("ball", FUR | BENT, {}),
    "cells, no noise": ("ball", FUR | {"noise": (0, 8)}, {}),
    "cells, large noise": ("ball", FUR | {"noise": (2, 3)}, {}),
    "cells, turned, bent": ("ball", FUR | BENT | {"shading": "turned"}, {}),
    "cells, half vector": ("ball", FUR | {"look": clfur.Kajiya(highlight="half-vector")}, {}),
    "cells, from far": ("ball", FUR | {"frequency": 40.0}, {}),
    "cells, nearly far": ("ball", FUR | {"frequency": 9.0}, {"size": (32, 24)}),
    "cells, a crowd": ("ball", FUR | BENT | {"frequency": 4000.0}, {"samples": 4}),
    "sine, a crowd, turned": ("ball", SINE | {"frequency": 300.0, "shading": "turned"}, {}),
    "cells, thin, no skin": ("ball", FUR | {"density": 0.5}, {"bare": True}),
    "cells, long, no skin": ("ball", FUR | BENT | {"length": 0.6}, {"bare": True, "samples": 4}),
    "cells, spot light": ("ball", FUR, {"light": SPOT}),
    "cells, two lights": ("ball", FUR, {"light": [LIGHT, SPOT]}),
    "sine, turned, two lights": ("ball", SINE | {"shading": "turned"}, {"light": [SPOT, LIGHT]}),
    "sine": ("ball", SINE, {}),
    "sine, very thin, nearly far": ("ball", SINE | {"density": 0.11, "frequency": 16.0}, {}),
    "cells, very thin, nearly far": ("ball", FUR | {"density": 0.11, "frequency": 9.0}, {}),
    "sine, unfiltered, 4 samples": ("ball", SINE, {"filtered": False, "samples": 4}),
    "sine, bent, turned": ("ball", SINE | BENT | {"shading": "turned"}, {}),
    "sine, thin, no noise": ("ball", SINE | {"density": 0.5, "noise": (0, 8)}, {}),
    "open": ("quad", FUR, {}),
    "open, bent, no skin": ("quad", FUR | BENT, {"bare": True}),
    "open, sine": ("quad", SINE, {"samples": 4}),
    "two": ("pair", FUR | {"density": 0.6}, {}),
    "two, no skin": ("pair", FUR | {"density": 0.6}, {"bare": True}),
}


def agree(it, direct=1.0):
    """The device's picture is the twin's -> the twin's image."""
    image, transmittance, place, face = by_twin(it, direct)
    assert it.image.dtype == it.shell_transmittance.dtype == np.float32 and it.shell_front.dtype == np.uint64
    assert (image[..., 3] > 0).mean() > 0.1, "there is little fur in this picture"
    for mine, its in ((it.image, image), (it.shell_transmittance, transmittance)):
        off = np.abs(mine - its)
        assert (off > CLOSE).mean() <= FLIPS, f"{(off > CLOSE).sum()} of {off.size} differ, by up to {off.max():.3g}"
        assert off.max() <= FLIP and np.median(off) <= 2e-5
    # Where half of the light is gone: there or not, the depth of it, and on which face.
    halved = it.shell_front != twin.NONE
    assert (halved != (face >= 0)).mean() <= FLIPS / 2
    both = halved & (face >= 0)
    assert ((it.shell_front[both] & np.uint64(0xFFFFFFFF)).astype(int) != face[both]).mean() <= FLIPS
    off = np.abs((it.shell_front[both] >> np.uint64(32)).astype(float) - twin.depth_of(it.view, place[both]))
    assert (off > 3e-5 * twin.DEPTH_ONE).mean() <= FLIPS
    return image


@pytest.mark.parametrize("name", CASES)
def test_rays_equal_the_twin(gpu, monkeypatch, name):
    mesh, options, how = CASES[name]
    it = drawn(gpu, monkeypatch, mesh, clfur.Shells(**options), **how)
    if mesh == "pair" or (mesh == "ball" and "bare" in how):
        assert sum(entries.min() != twin.NONE for entries in it.rounds) > 1, "no ray comes in twice"
    agree(it)


@pytest.mark.parametrize("options", [FUR, SINE, SINE | {"shading": "turned"}], ids=["cells", "sine", "turned"])
def test_a_step_where_bent_hair_turns_is_lit_by_either_side(gpu, monkeypatch, options):
    """Six layers are one and a half a slab: every third step ends where one slab of bent hair meets the next, and a
    rounding error decides which of them lights it.  What both give the twin tells, a little too early and too late.
    """
    it = drawn(gpu, monkeypatch, "ball", clfur.Shells(**options | BENT | {"layers": 6}), size=(48, 36))
    either = []
    for place in (0.5 - 1e-5, 0.5 + 1e-5):
        monkeypatch.setattr(twin, "FIRST", place)
        either.append(by_twin(it)[0])
    assert (np.abs(either[0] - either[1]).max(2) > CLOSE).mean() > 0.02, "no step ends where hair turns"
    outside = (it.image < np.minimum(*either) - CLOSE) | (it.image > np.maximum(*either) + CLOSE)
    assert outside.any(2).mean() <= 0.2 * FLIPS
    assert (np.abs(it.image[..., 3] - either[0][..., 3]) > CLOSE).mean() <= 0.2 * FLIPS   # there it is as much hair


@pytest.mark.parametrize("lanes", [1, 8, 16])
def test_rays_are_the_same_side_by_side(another, monkeypatch, lanes):
    """As GPUs and CPUs take them: one ray a work-item, or several; the other tests take as many as a scheduler does."""
    agree(drawn(another(lanes=lanes), monkeypatch, "ball", clfur.Shells(**FUR | BENT), size=(23, 17), samples=4))


def test_rays_side_by_side_go_as_far_as_one_alone(gpu, another, monkeypatch):
    """Thin fur of very many faces, along which each ray has a way of its own, longer than all rays' share of 20,000."""
    n, across = 600, 24
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-.3, .3, across + 1), np.linspace(-1, 1, n + 1)))
    i = (np.arange(across) + (across + 1) * np.arange(n)[:, None]).ravel()
    faces = np.concatenate([np.stack([i, i + across + 1, i + 1], 1),
                            np.stack([i + 1, i + across + 1, i + across + 2], 1)])
    positions = np.stack([x, 0 * x, z], 1)
    mesh = clfur.Mesh(positions, np.repeat([(0.0, 1, 0)], len(x), 0), None, faces)
    fur = clfur.Shells(length=.3, frequency=20, density=.03, layers=4, wind=(.2, 0, 0))
    camera, transmittances = clfur.Camera(eye=(0, .2, 2), target=(0, .1, 0), size=(16, 12), fov=10), []
    for lanes in (1, gpu.lanes if gpu.steps else 16):   # llvmpipe's 16 would be ended after 65,535 steps together
        it = drawn(another(lanes=lanes), monkeypatch, mesh, fur, size=(16, 12), camera=camera, bare=True)
        transmittances.append(it.shell_transmittance)
    assert (transmittances[0] < .9).mean() > .3
    assert (np.abs(transmittances[0] - transmittances[1]) > CLOSE).mean() <= FLIPS


def test_rays_that_meet_nothing(gpu, monkeypatch):
    """A camera that looks past all fur sees none; and what stands before the fur hides it."""
    fur, mesh = clfur.Shells(**FUR), clfur.Mesh(*MESHES["ball"])
    away = clfur.Camera(eye=(0, 0, 4), target=(0, 0, 8), size=(12, 9))
    it = drawn(gpu, monkeypatch, mesh, fur, camera=away, size=(12, 9), bare=True)
    assert not it.image.any() and (it.shell_transmittance == 1).all() and (it.shell_front == twin.NONE).all()
    camera = clfur.Camera(eye=(0, 0, 4), size=(12, 9))
    view = view_of(clfur.Scene(mesh=mesh, fur=fur, camera=camera), 1)
    before = gpu.full((9, 12, 1), np.uint64, 5 << 32)
    image, transmittance, front = stage.march(gpu, view, it.shell, it.packed, unshadowed(gpu, *it.lights), before)
    assert not image.get().any() and (transmittance.get() == 1).all() and (front.get() == twin.NONE).all()


def test_no_hair_where_the_eye_stands_in_the_fur(gpu, monkeypatch):
    """An eye within the fur sees no front of it: a picture all the same, and no number that is none."""
    camera = clfur.Camera(eye=(0, 0, 1.1), target=(0.3, 0.2, 0.9), size=(16, 12))
    it = drawn(gpu, monkeypatch, "ball", clfur.Shells(**FUR), camera=camera, size=(16, 12))
    assert np.isfinite(it.image).all() and (it.shell_transmittance >= 0).all() and (it.shell_transmittance <= 1).all()


def test_shadows_reach_the_fur(gpu, monkeypatch):
    """A grid of one cell with the same crossings everywhere leaves the same share of the light to all hairs."""
    light = clfur.Light((1, -1, -0.6), ambient=0.0)
    shadow, grid = np.zeros((), layout.Shadow), np.zeros((), layout.Grid)
    shadow["hair"][0] = 0.5
    grid["to_grid"][:3, :2] = 0
    grid["to_grid"][3] = 0.5, 0.5, 0.5, 1
    grid["size"][:3] = 1
    crossings = gpu.full((2, 1, 1), np.float32, 3)
    lighting = lighting_of(gpu, [light_of(light)], [shadow], [grid], [None], [crossings], [None])
    it = drawn(gpu, monkeypatch, "ball", clfur.Shells(**FUR), light=light, lighting=lighting)
    agree(it, direct=np.exp(-1.5))


# --- under Oclgrind --------------------------------------------------------------------------------------


@pytest.mark.small
@pytest.mark.parametrize("pattern", ["cells", "sine"])
def test_small(gpu, monkeypatch, pattern):
    """All that draws, as small as it can be."""
    monkeypatch.setattr(shells, "AROUND", 4)
    gpu = clfur.Scheduler(gpu.device)
    gpu.lanes = 1   # Oclgrind 21.10 takes parts of a vector for unset that are not
    fur = clfur.Shells(length=0.4, layers=2, frequency=1.0, pattern=pattern, noise=(0.3, 8), wind=(0.3, 0, 0))
    it = drawn(gpu, monkeypatch, "quad", fur, size=(5, 4), bare=True)
    image, transmittance, *_ = by_twin(it)
    assert image[..., 3].max() > 0.1
    np.testing.assert_allclose(it.image, image, atol=CLOSE)
    np.testing.assert_allclose(it.shell_transmittance, transmittance, atol=CLOSE)


@pytest.mark.small
@pytest.mark.parametrize("shading", ["kajiya-kay", "turned"])
def test_light_of_a_sky_is_the_twin_s(gpu, monkeypatch, shading):
    """Of three directions, with a share of its own in each cell."""
    monkeypatch.setattr(shells, "AROUND", 4)
    rng, n, towards = np.random.default_rng(1), 16, sky.spiral(3)
    shares, colors = rng.random((3, n, n, n)), 8 * rng.random((3, 3))
    packed = sky.sky_of((-1.5, -1.5, -1.5), (1.5, 1.5, 1.5), n)
    cells = np.einsum("dzyx,dj,dc->zyxjc", shares, sky.harmonics(towards), np.c_[colors, np.zeros(3)])
    lit = sky.SkyLight(packed, np.zeros((), layout.OnGround),
                       gpu.upload(np.ascontiguousarray(cells.reshape(-1, 4), dtype=np.float32)),
                       gpu.empty((0, 4), np.float32))

    def by_sky(p, h, t):
        place = packed["place"].astype(float)
        further = p + t * ((h - .5) * 2 / place[3])[:, None]
        return sky_twin.light(place[:3], place[3], shares, towards[:, None], colors[:, None], further, t,
                              (1, 0, -1 / 8))
    fur = clfur.Shells(length=0.4, layers=2, frequency=1.0, noise=(0.3, 8), wind=(0.3, 0, 0), shading=shading)
    it = drawn(gpu, monkeypatch, "quad", fur, size=(5, 4), bare=True, sky=lit)
    meant, without = by_twin(it, sky=by_sky)[0], by_twin(it)[0]
    np.testing.assert_allclose(it.image, meant, atol=CLOSE)
    assert np.abs(meant - without)[..., :3].max() > .05
