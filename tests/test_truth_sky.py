"""The truth's sky against what can be worked out by hand and its own lights, and the grid's light against it."""

import attrs
import numpy as np
import pytest

import clfur
from clfur import truth
from clfur.device.scheduler import Scheduler
from clfur.judge.geometry import geometry_of
from clfur.judge.lights import Light
from clfur.judge.sky import Sky, spread
from clfur.scene import frame
from clfur.stages import sky as stage
from clfur.twin.vectors import unit

N = 3000


def furry(mesh, strands=300, length=.3, **fields):
    kind = clfur.HairType(segments=4, segment_length=length / 4, width=.01, alpha=.4, direction_variation=.3)
    return clfur.Scene(mesh=mesh, fur=clfur.Strands(types=[kind], roots=strands, inner=1, outer=1), **fields)


def geometry(scene):
    """(hair, body, places [N, 3] on hair, their tangents, strands)."""
    hair, body = geometry_of(scene)
    random = np.random.default_rng(2)
    k, share = random.integers(0, len(hair.first), N), random.random((N, 1))
    a, d = hair.points[hair.first[k], :3], hair.points[hair.first[k] + 1, :3] - hair.points[hair.first[k], :3]
    return hair, body, a + share * d, unit(d), hair.owner[k]


@pytest.mark.parametrize("towards", [(0, 1, 0), (.3, -.8, .5), (-1, .02, .01)])
def test_rays_of_any_direction_see_what_a_light_s_rays_see(sphere, towards):
    scene = furry(sphere, 3000, environment=clfur.Environment())
    hair, body, p, _, strand = geometry(scene)
    w, none = unit(np.array(towards, float)), np.full(N, -1)
    light = Light(scene, clfur.Light(direction=-w), hair, body)
    sky = Sky(scene, hair, body)
    expected = light._transmittance(p, none, strand)
    given = sky.space.light_left(p, np.broadcast_to(w, p.shape), strand, none, sky.bias)
    np.testing.assert_allclose(given, expected, atol=2e-6)   # less than a millionth is taken for nothing
    assert .05 < (expected == 0).mean() < .95 and len(np.unique(expected)) > 5


@pytest.mark.parametrize("sky", [(1, 1, 1), [(2, 2, 2), (1, 1, 1), (0, 0, 0)], np.eye(9)[:, :, None] * np.ones(3)])
@pytest.mark.parametrize("surface", [True, False])
def test_where_nothing_hides_a_sky_it_is_its_mean(sky, surface):
    """A mixture of two ways to choose directions has no bias: the sum over all places of the sky, by the kernel."""
    environment = clfur.Environment(sky, rotation=30)
    scene = clfur.Scene(fur=clfur.Curves([np.array([(0, 0, 0), (0, 1e-3, 0)])], width=1e-4), environment=environment)
    judge = Sky(scene, *geometry_of(scene))
    axis = np.broadcast_to(unit(np.array([.3, .5, -.8])), (N, 3))
    random = spread(N, np.random.default_rng(1).random((1, 2)))
    none = np.full(N, -1)
    given = judge.light(np.ones((N, 3)), axis, np.full(N, surface), none, none, random)[:, 0].mean()
    rows = np.repeat(np.repeat(environment.picture, 7, 0), 14, 1)[:7 * 64]
    towards, light, angles = clfur.Environment(rows, rotation=30).places
    cosine = towards @ axis[0]
    kernel = np.maximum(cosine, 0) / np.pi if surface else np.sqrt(1 - cosine**2) / np.pi**2
    assert given == pytest.approx((kernel * light[:, 0] * angles).sum(), rel=.01)


def test_a_bald_sphere_under_a_white_sky_is_its_color(sphere):
    """Nothing of a convex body hides what its cosine weighs."""
    scene = clfur.Scene(mesh=sphere, environment=clfur.Environment(), light=clfur.Light(color=(0, 0, 0)),
                        body_color=(.5, .3, .1), camera=clfur.Camera(eye=(0, 0, 4), target=(0, 0, 0), size=(9, 9)))
    np.testing.assert_allclose(truth.picture(scene, 16)[3:6, 3:6, :3].mean((0, 1)), (.5, .3, .1), rtol=.01)


def test_a_sky_replaces_the_default_ambient_alone(sphere):
    scene = furry(sphere, 100, environment=clfur.Environment((0, 0, 0)), light=clfur.Light(color=(0, 0, 0)))
    scene = attrs.evolve(scene, camera=frame(sphere, scene.fur, (12, 9)))
    assert not truth.picture(scene, 2)[..., :3].any()
    some = truth.picture(attrs.evolve(scene, light=clfur.Light(color=(0, 0, 0), ambient=.2)), 2)
    assert some[..., :3].any()


@pytest.fixture(scope="module")
def figures():
    import sys
    sys.path.insert(0, "tools")
    import figures_sky
    sys.path.pop(0)
    return figures_sky


def test_irradiance_of_the_grid_is_nearly_the_truth_s(figures):
    """The bounds of docs/light.md, at 200 places each; their mean error is known to a tenth of it."""
    options = type("", (), {"hairs": 200, "bodies": 200, "rays": 128})
    scene = attrs.evolve(figures.furry("sphere", 18000, .25, .25), environment=figures.skies()["gradient"])
    found, flat, noise, _ = figures.errors(scene, Scheduler(), options, [stage.CELLS])
    (hair, _), (body, _) = found[stage.CELLS]
    assert hair < .03 and body < .03 and max(noise) < .02
    assert min(flat) > .08   # what a constant would miss
