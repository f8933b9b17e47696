"""A body that hides and shades hair but is not seen."""

import numpy as np
import pytest

import clfur
from clfur import truth

LIGHT = clfur.Light((1, -1, -.6))
CAMERA = clfur.Camera(eye=(2.2, 1.6, 3.4), target=(0, -.3, 0), size=(65, 49))
FUR = clfur.Strands(roots=700, types=clfur.HairType(segment_length=.04, width=.02, segments=4))
FURS = pytest.mark.parametrize("fur", [FUR, None, clfur.Shells(layers=8), [clfur.Shells(layers=8), FUR]],
                               ids=["strands", "bald", "shells", "both"])
SETTINGS = clfur.Settings(grid=32, shadow_map=64)


def scene(sphere, fur, **more):
    return clfur.Scene(**{"mesh": sphere, "fur": fur, "camera": CAMERA, "light": LIGHT} | more)


@pytest.mark.parametrize("raster", ["coverage", "samples"])
@FURS
def test_drawn_is_holdout_and_the_bodys_own_light(gpu, sphere, fur, raster):
    """A black body's light is none, a white one's is linear in its colour: what is between is its light by itself."""
    settings = clfur.Settings(raster=raster, grid=32, shadow_map=64)
    held, drawn, black, twice = (clfur.render(scene(sphere, fur, **more), gpu, settings, ("color", "coverage", "id"))
                                 for more in ({"body": "holdout"}, {"body_color": (.3, .2, .1)},
                                              {"body_color": (0, 0, 0)}, {"body_color": (.6, .4, .2)}))
    own = (twice["color"] - drawn["color"])[..., :3]
    np.testing.assert_allclose(held["color"][..., :3] + own, drawn["color"][..., :3], atol=1e-6)
    np.testing.assert_allclose(held["color"][..., :3], black["color"][..., :3], atol=1e-6)
    np.testing.assert_array_equal(held["coverage"], held["color"][..., 3])
    np.testing.assert_array_equal(held["id"], drawn["id"])
    # Where a white light shines alone the body's light is its share of the pixel, and alpha differs by that.
    flat = {"light": clfur.Light(color=(0, 0, 0), ambient=1)}
    one, other = (clfur.render(scene(sphere, fur, body_color=color, **flat), gpu, settings)
                  for color in ((1, 1, 1), (0, 0, 0)))
    share = (one - other)[..., 0]
    np.testing.assert_allclose(held["color"][..., 3], drawn["color"][..., 3] - share, atol=1e-6)
    if fur is None:
        assert not held["color"].any() and share.max() == 1


def test_it_hides_and_shades(gpu, sphere):
    """Hair behind it is not seen, and what it shades is as dark."""
    behind = clfur.Curves(np.array([[(-3, 0, -2), (3, 0, -2)], [(-3, -1.2, 0), (3, -1.2, 0)]]), width=.1)
    camera = clfur.Camera(eye=(0, 0, 6), size=(64, 48))
    light = clfur.Light((0, -1, 0), ambient=0)
    held = clfur.render(clfur.Scene(sphere, behind, camera, light, body="holdout"), gpu, SETTINGS)
    free = clfur.render(clfur.Scene(sphere, behind, camera, light, body_color=None), gpu, SETTINGS)
    assert not held[22:26, 28:36].any() and free[22:26, 28:36, 3].max() > .3
    row = int(np.argmax(held[30:, 4, 3])) + 30
    assert held[row, 4, 0] > .05 and held[row, 32, 0] == 0 and held[row, 32, 3] > .85


def test_truth(gpu, sphere):
    there = scene(sphere, FUR, body="holdout")
    one, other = clfur.render(there, gpu, clfur.Settings(samples=16)), truth.picture(there, 6)
    whole = clfur.render(scene(sphere, FUR), gpu, clfur.Settings(samples=16))
    assert one[..., 3].mean() == pytest.approx(other[..., 3].mean(), abs=.002)
    assert one[..., 3].mean() < whole[..., 3].mean()
    np.testing.assert_allclose(one.mean((0, 1)), other.mean((0, 1)), atol=.004)


def test_a_holdout_needs_a_body(sphere):
    with pytest.raises(clfur.Error, match="Scene.body is 'holdout' but no body is drawn"):
        scene(sphere, FUR, body="holdout", body_color=None)
    with pytest.raises(clfur.Error, match="Scene.body is 'none'; allowed: 'drawn' or 'holdout'"):
        scene(sphere, FUR, body="none")
