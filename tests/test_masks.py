"""Pieces that hide each other patch by patch of a pixel: the twin's values, and the laws of area and order."""

import numpy as np
import pytest
from support.coverage import NONE, ball, counted, furry, wild
from support.plans import plan_of
from support.scenes import scene_of
from support.stages import strands_on
from support.views import flat, pack, perspective

import clfur
from clfur import measures, truth
from clfur.stages import coverage, masks
from clfur.twin import masks as twin

pytestmark = pytest.mark.usefixtures("plain")


def alpha_of(gpu, view, points, spans):
    width, rows = int(view["size"][0]), int(view["rows"][1] - view["rows"][0])
    visible = gpu.upload(np.full((rows, width, int(view["size"][2])), NONE))
    _, segments = counted(gpu, view, strands_on(gpu, points, spans), visible)
    covered = coverage.nothing(gpu, visible)
    masks.cover(gpu, view, visible, segments, covered)
    return covered.alpha.get()


@pytest.mark.parametrize("n, width", [pytest.param(12, .02, marks=pytest.mark.small), (100, .02),
                                      pytest.param(6, .5, marks=pytest.mark.small), (40, .3)])
def test_alpha_is_the_twins(gpu, n, width):
    """An edge's place is wrong by some 2^-24 of the picture's size, four times as much of a patch; all may add up.
    Pieces whose depths rounding brings into another order leave the same alpha, but for those of one strand."""
    view, (points, spans) = perspective(23, 19, 1, eye=(0, .4, 3.2)), pack(wild(n, 1, width=width))
    pixels = {}
    for y, x, key, areas in twin.pieces(view, points, spans):
        pixels.setdefault((y, x), {})[key] = areas
    alpha, meant = alpha_of(gpu, view, points, spans), np.zeros((19, 23))
    for place, layers in pixels.items():
        meant[place] = twin.resolve(layers)[1]
    assert (meant > 0).sum() > n
    np.testing.assert_allclose(alpha, meant, rtol=0, atol=1e-4)


@pytest.mark.parametrize("low, high", [pytest.param(.01, .05, marks=pytest.mark.small), (.1, .7)])
def test_alpha_of_one_strand_adds_up_to_its_area(gpu, low, high):
    """Of each alone; alpha is 1 less what is left: 2^-24 in each pixel. None is nearly filled."""
    rng, view = np.random.default_rng(3), flat(32, 24, 1)
    for _ in range(8):
        a, b = rng.uniform(6, (26, 18), (2, 2))
        width = rng.uniform(low, high)
        alpha = alpha_of(gpu, view, *pack(np.array([[(*a, .5, width), (*b, .5, width)]], np.float32)))
        area = np.hypot(*(b - a)) * width
        assert abs(alpha.sum(dtype=float) - area) < 1e-5 * area + 2**-24 * np.count_nonzero(alpha)


def test_strands_hide_each_other_where_they_lie(gpu):
    """Two in the same half of a pixel cover half of it, in both halves all; at random it would be 3/4."""
    for y, meant in (10.25, .5), (10.75, 1):
        strands = np.array([[(4, 10.25, .5, .5), (40, 10.25, .5, .5)], [(4, y, .25, .5), (40, y, .25, .5)]])
        np.testing.assert_array_equal(alpha_of(gpu, flat(48, 24, 1), *pack(strands))[10, 4:40], meant)


def test_any_order_gives_the_same_bits(gpu):
    found = set()
    for seed in range(3):
        scene = furry("strand")
        fur = scene.strands
        order = np.random.default_rng(seed).permutation(len(fur.counts))
        points = fur.points.reshape(len(order), -1, 3)[order]
        again = clfur.Curves(points, width=fur.width.reshape(len(order), -1)[order], color=fur.color[order])
        picture = clfur.render(clfur.Scene(scene.mesh, again, camera=scene.camera, light=scene.light), gpu,
                               clfur.Settings(masks=4, grid=16, shadow_map=32))
        found.add(picture[..., 3].tobytes())
    assert len(found) == 1


@pytest.mark.parametrize("ways", [{}, {"shadows": "deep"}], ids=["masks", "deep"])
def test_parts_bands_and_lanes_give_the_same_bits(gpu, another, sphere, ways):
    """Of alpha and depth on any device; of colours, in which lights add up in other orders, to 1e-5."""
    scene = scene_of(2000, sphere)
    settings = clfur.Settings(masks=4, grid=32, shadow_map=64, **ways)
    whole = clfur.draw(scene, gpu, settings, ("color", "depth", "id"), hashes=True)
    assert whole.images["color"].std() > .05
    few = another(lanes=1, hinted=1, steps=60_000)
    small = another()
    small.memory = plan_of(scene, settings)._fixed * 16 // 15 + (1_100_000 if ways else 600_000)
    for other in few, small:
        frame = clfur.draw(scene, other, settings, ("color", "depth", "id"), hashes=True)
        assert frame.hashes == whole.hashes
        np.testing.assert_array_equal(frame.images["id"], whole.images["id"])
        np.testing.assert_allclose(frame.images["color"], whole.images["color"], rtol=0, atol=1e-5)
    assert len(plan_of(scene, settings).parts(small)) > 1


def test_a_team_gives_the_same_bits(gpu, another, sphere):
    scene, settings = scene_of(1500, sphere), clfur.Settings(masks=4, grid=32, shadow_map=64)
    one = clfur.draw(scene, gpu, settings, hashes=True)
    team = clfur.draw(scene, [gpu, another()], settings, hashes=True)
    assert team.hashes == one.hashes
    np.testing.assert_allclose(team.images["color"], one.images["color"], rtol=0, atol=1e-5)


def test_masks_are_nearer_to_the_truth(gpu):
    """Hair without shadows: above the noise of two pictures .006 where pieces hidden at random have .013."""
    kind = clfur.HairType(width=.02, segment_length=.03, segments=8, force_weight=.2, color=(.5, .28, .12))
    scene = clfur.Scene(ball(subdivisions=2), clfur.Strands(inner=1, outer=1, roots=1500, types=kind),
                        clfur.Camera(size=(48, 36)), clfur.Light((-1, -.3, -.5), shadows=False))
    one, other = (measures.shown(truth.picture(scene, 3, seed)) for seed in (0, 1))
    errors = []
    for side in 0, 4:
        shown = measures.shown(clfur.render(scene, gpu, clfur.Settings(masks=side)))
        errors.append(np.sqrt(((shown - one) * (shown - other)).mean()))
    assert errors[1] < .7 * errors[0], errors


def test_masks_are_for_coverage():
    for keys in {"masks": 3}, {"masks": True}, {"masks": 4, "raster": "samples"}:
        with pytest.raises(clfur.Error, match=r"Settings\.masks"):
            clfur.Settings(**keys)
