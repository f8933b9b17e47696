"""Shadows of lights that are discs: sums in the grid against their twin, and all of it against the truth."""

import functools

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import layout, truth
from clfur.color import linear_to_srgb
from clfur.stages import discs
from clfur.stages.zscan import zscan
from clfur.twin import discs as twin


@pytest.mark.parametrize("shape, wide", [pytest.param((3, 4, 4), 2.0, marks=pytest.mark.small), ((16, 16, 16), 3.0),
                                         ((12, 24, 16), 30.0)])
def test_sums_equal_the_twin(gpu, shape, wide):
    """Sums in float32 of up to 16 layers, the exponential to 1e-6 of itself: 1e-5 of a crossing and of the sum."""
    cells = np.random.default_rng(1).integers(0, 4000, shape).astype(np.uint32)
    cells[:, shape[1] // 2:] = 0
    shifts = (np.linspace(-.5, .5, 2 * shape[0] + 1) * wide).astype(np.float32)
    found = discs.discs(gpu, gpu.upload(cells), 1000, .5, shifts).get()
    points = discs.points_of(shifts)
    rounds = [[i * turn % 1 for turn in discs.TURNS] for i in range(len(points))]
    meant = twin.discs(cells, 1000, .5, shifts, points, rounds)
    np.testing.assert_allclose(found, meant, rtol=1e-5, atol=1e-5)
    assert not found[0].any() and np.abs(found - zscan(gpu, gpu.upload(cells), 1000).get()).max() > .5


def test_a_point_is_no_disc(gpu):
    cells = gpu.upload(np.random.default_rng(1).integers(0, 4000, (8, 8, 16)).astype(np.uint32))
    none = np.zeros(17, np.float32)
    np.testing.assert_allclose(discs.discs(gpu, cells, 1000, .5, none).get(), zscan(gpu, cells, 1000).get(), rtol=1e-5,
                               atol=1e-5)


GROUND = np.array([[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]], float)
SUN, LAMP = clfur.Light((0, -1, 0), ambient=0), clfur.Light((0, -1, 0), ambient=0, position=(0, 5, 0), angle=120)


def ball_over_ground(height, light):
    ball, faces = icosphere(3)
    mesh = clfur.Mesh(np.concatenate([GROUND, .5 * ball + (0, height, 0)]), None, None,
                      np.concatenate([[[0, 1, 2], [0, 2, 3]], 4 + faces]))
    return clfur.Scene(mesh, None, clfur.Camera(eye=(0, 2.2, 4), fov=25, size=(64, 32)), light, body_color=(1, 1, 1))


@functools.lru_cache
def of_truth(height, light):
    return truth.picture(ball_over_ground(height, light), 6)[..., 0]


@pytest.mark.parametrize("light, size", [(SUN, 8), (SUN, 20), (LAMP, .2), (LAMP, .5)], ids=["8", "20", "lamp .2", ".5"])
def test_penumbras_widen_with_the_distance_as_the_truths(gpu, light, size):
    """Of a ball that is .05 to 1.5 above the ground: the share of the picture in which light is between a tenth and
    nine tenths of all is that of the truth, up to half more at the ball, whose nearer side counts as its distance; and
    light there errs half as much as that of a light without a size, at least from a distance of a radius on."""
    settings, widths = clfur.Settings(shadow_map=512, samples=16), []
    for height in (.55, 1.2, 2.0):
        disc = attrs.evolve(light, size=size)
        scene = ball_over_ground(height, disc)
        all_of_it, ground = (clfur.render(each, gpu, attrs.evolve(settings, shadows="off"))[..., 0] for each in (
            scene, attrs.evolve(scene, mesh=clfur.Mesh(GROUND, None, None, np.array([[0, 1, 2], [0, 2, 3]])))))
        bare = (np.abs(all_of_it - ground) < 1e-5) & (ground > .5)
        soft, hard, meant = (each[bare] / ground[bare] for each in (
            clfur.render(scene, gpu, settings)[..., 0],
            clfur.render(attrs.evolve(scene, light=light), gpu, settings)[..., 0], of_truth(height, disc)))
        wide, meant_wide = (((each > .1) & (each < .9)).mean() for each in (soft, meant))
        assert .85 * meant_wide - .003 < wide < (1.5 if height < 1 else 1.3) * meant_wide + .003
        off, off_hard = (np.sqrt(((each - meant)**2).mean()) for each in (soft, hard))
        assert off < (.8 if height < 1 else .55) * off_hard + .004
        widths.append(wide)
    assert widths[2] > 1.2 * widths[1] > 1.2 * 1.2 * widths[0]


def test_hair_errs_no_more_than_under_a_light_without_a_size(gpu):
    """Root mean square of sRGB to the truth, under a sun and a spot."""
    hair = clfur.HairType(segments=4, segment_length=.1, width=.02, alpha=.4)
    ball, faces = icosphere(2)
    scene = clfur.Scene(clfur.Mesh(ball, ball, None, faces), clfur.Strands(roots=1500, types=[hair], seed=3),
                        clfur.Camera(size=(48, 36)))
    for light, size in ((clfur.Light((1, -1, -.6)), 20), (clfur.Light((-1, -1, -1), position=(2, 2, 2), angle=70), .5)):
        errors = []
        for each in (light, attrs.evolve(light, size=size)):
            scene = attrs.evolve(scene, light=each)
            meant, found = truth.picture(scene, 6)[..., :3], clfur.render(scene, gpu)[..., :3]
            off = linear_to_srgb(found.clip(0, 1)) - linear_to_srgb(meant.clip(0, 1))
            errors.append(np.sqrt((off**2).mean()))
        assert errors[1] < 1.03 * errors[0]


LOOKS = {"kajiya": clfur.Kajiya(exponent=30), "half vector": clfur.Kajiya(highlight="half-vector", exponent=30),
         "chiang": clfur.Chiang()}


@pytest.mark.parametrize("name", LOOKS)
@pytest.mark.parametrize("light, size", [(clfur.Light((1, -1, -.6)), 40), (clfur.Light((1, -1, -.6)), 8),
                                         (clfur.Light((-1, -1, -1), position=(2, 2, 2), angle=80), 1.0)])
def test_hair_under_a_disc_sends_the_mean_of_its_points(gpu, name, light, size):
    """Highlights widen and weaken; root mean square of linear light, and how much nearer than the middle alone."""
    hair = clfur.HairType(segments=4, segment_length=.1, width=.02, alpha=.4, look=LOOKS[name], color=(.4, .25, .1))
    ball, faces = icosphere(2)
    light = attrs.evolve(light, shadows=False, ambient=0, size=size)
    scene = clfur.Scene(clfur.Mesh(ball, ball, None, faces), clfur.Strands(roots=1500, types=[hair], seed=3),
                        clfur.Camera(size=(48, 36)), light, body_color=(1, 1, 1))
    z = light.direction
    x = np.cross(z, (0, 0, 1)) / np.linalg.norm(np.cross(z, (0, 0, 1)))
    points = []
    for a, b in layout.disc(24).astype(float) * (size if light.position is not None else np.tan(np.radians(size) / 2)):
        aside = a * x + b * np.cross(z, x)
        where = {"direction": z + aside} if light.position is None else {"position": light.position + aside}
        points.append(attrs.evolve(light, size=0, intensity=1 / 24, **where))
    meant, found, middle = (clfur.render(attrs.evolve(scene, light=each), gpu)[..., :3]
                            for each in (points, light, attrs.evolve(light, size=0)))
    off, off_middle = (np.sqrt(((each - meant)**2).mean()) for each in (found, middle))
    assert off < (.45 if size != 8 else .65) * off_middle


def test_a_penumbra_goes_on_beside_the_map(gpu):
    """Of a ball's shadow on a ground no part is cut off where the light's map of the ball ends."""
    scene = clfur.Scene(clfur.load_mesh("sphere"), None,
                        clfur.Camera(eye=(1.5, 12, -.9), target=(1.5, 0, -.9), up=(0, 0, -1), fov=25, size=(96, 96)),
                        light=clfur.Light((1, -1, -.6), size=20, ambient=0), ground=clfur.Ground(), body="holdout")
    drawn = clfur.render(scene, gpu, clfur.Settings(shadow_map=256), ("color", "id"))
    ground, alpha = drawn["id"] == -4, drawn["color"][..., 3]
    aside, down = (np.abs(np.diff(alpha, axis=axis)) for axis in (1, 0))
    steps = np.concatenate([aside[ground[:, 1:] & ground[:, :-1]], down[ground[1:] & ground[:-1]]])
    assert steps.max() < .2   # .46 where it was cut off; its own steps are those of 64 points
