"""Light on strands by area: the twin's values on every device, and the laws of light."""

import numpy as np
import pytest
from support.coverage import LIGHT, OFF, SETTINGS, furry, pieces_of
from support.scenes import squares, strands_of
from support.stages import on_host

import clfur
from clfur.pipeline.shadows import cast_shadows
from clfur.pipeline.views import light_of, view_of
from clfur.stages import coverage, shade
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import raster
from clfur.stages.tessellate import no_surface, tessellate
from clfur.twin import coverage as twin

SPOT = clfur.Light((-1, -1, -1), position=(1, 1, 1), angle=30)


def stages_of(gpu, scene, samples=4):
    """(view, the body's visible, strands, `Fragments`, `Resolved`) of a scene."""
    view, strands = view_of(scene, samples), strands_of(gpu, scene)
    visible = raster(gpu, view, None, tessellate(gpu, scene.mesh) if scene.body_color is not None else no_surface(gpu))
    pixels = coverage.bound(gpu, visible)
    coverage.count(gpu, view, strands, pixels)
    fragments = coverage.allocate(gpu, pixels, int(pixels.get()[..., 1].sum()))
    coverage.gather(gpu, view, strands, fragments)
    return view, visible, strands, fragments, coverage.resolve(gpu, visible, fragments)


@pytest.mark.parametrize("kind, form, n, shadowed", [
    pytest.param("point", "kajiya-kay", 4, True, marks=pytest.mark.small), ("all", "kajiya-kay", 60, False),
    ("strand", "half-vector", 60, True), ("grown", "kajiya-kay", 0, True)])
@pytest.mark.parametrize("lights", [[LIGHT], [SPOT], [LIGHT, SPOT]], ids=["far", "spot", "both"])
def test_light_is_the_twins(gpu, kind, form, n, shadowed, lights):
    """Measured: 9e-7; a highlight's power and strands seen from their ends may give 2e-5, see test_shade.py."""
    scene = furry(kind, n, (13, 11) if n == 4 else (41, 31), form)
    view, _, strands, fragments, resolved = stages_of(gpu, scene)
    shape, lights = (len(lights), len(strands.points)), [light_of(light) for light in lights]
    transmittances = np.random.default_rng(3).random(shape).astype(np.float32) if shadowed else None
    sums = coverage.light(gpu, view, unshadowed(gpu, *lights), fragments, resolved, strands,
                          gpu.upload(transmittances) if shadowed else None)
    image = shade.blend(gpu, sums, strand_transmittance=resolved.strand_transmittance).get()
    pieces, there = pieces_of(fragments, resolved), on_host(strands)
    meant = np.zeros_like(image, float)
    for pixel in np.unique(pieces["pixel"]):
        y, x = divmod(int(pixel), image.shape[1])
        weights = {d << 32 | k: w for _, k, d, w in pieces[pieces["pixel"] == pixel].tolist()}
        meant[y, x] = twin.light(view, lights, y, x, weights, there, transmittances)
    assert (meant[..., 3] > 0).mean() > .05 and meant[..., :3].max() > .05
    np.testing.assert_allclose(image, meant, rtol=0, atol=2e-5)


def test_light_beyond_all_bounds_stays_positive(gpu):
    """Sums of 64 bits hold what all pieces of a pixel can send together."""
    rng = np.random.default_rng(4)
    strands = rng.uniform(-1, 1, (300, 2, 3)) * (1, .02, 1)
    scene = clfur.Scene(fur=clfur.Curves(strands, width=.002, color=(1, 1, 0)), camera=clfur.Camera(size=(24, 16)),
                        light=clfur.Light((-1, -1, -1), (9e8, 1, 1), 5.0))
    image = clfur.render(scene, gpu, OFF)
    assert np.isfinite(image).all() and (image >= 0).all() and 1e7 < image.max() < 1.01e8
    assert (image[..., 1][image[..., 3] > .01] > 0).all()


def test_ambient_light_alone_is_the_colour_times_alpha(gpu):
    scene = furry("all", body_color=None, light=clfur.Light((0, -1, 0), (0, 0, 0), 1.0))
    out = clfur.render(scene, gpu, SETTINGS, ["color", "coverage"])
    np.testing.assert_allclose(out["color"][..., :3], out["coverage"][..., None] * scene.strands.color, atol=2e-6)
    np.testing.assert_allclose(out["color"][..., 3], out["coverage"], rtol=0, atol=2e-6)
    assert 0 < (out["coverage"] > .2).mean() < 1


def test_transmittance_is_whole_where_nothing_stands_before(gpu):
    """Above a plate all of it, below none; below a coat of hair some."""
    places = [(0, 1, 0), (0, .5, 0), (0, -.5, 0), (0, -1, 0)]
    line = clfur.Curves(np.array([places]) + (.01, 0, .013), width=.001)
    settings = clfur.Settings(shadow_map=64, grid=32)
    scene = clfur.Scene(squares((.8, 0)), line, light=clfur.Light((0, -1, 0)))
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, settings, strands, tessellate(gpu, scene.mesh))
    transmittances = coverage.transmittance(gpu, strands, lighting).get()
    np.testing.assert_allclose(transmittances, [[1, 1, 0, 0]], atol=1e-3)
    rng = np.random.default_rng(5)
    coat = rng.uniform((-1, .7, -1), (1, .8, 1), (2000, 1, 3)) + rng.normal(size=(2000, 2, 3)) * (.1, 0, .1)
    hair = np.concatenate([coat, np.array([places[:2], places[2:]])])
    scene = clfur.Scene(fur=clfur.Curves(hair, width=.01, alpha=.5), light=clfur.Light((0, -1, 0)))
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, settings, strands, no_surface(gpu))
    above, *below = coverage.transmittance(gpu, strands, lighting).get()[0, -4:]
    assert above > .98 and .1 < max(below) < .9 and max(below) - min(below) < .2


@pytest.mark.parametrize("shadows", ["off", "length"])
def test_wide_strands_are_lit_as_by_samples(gpu, shadows):
    """Of strands three pixels wide both ways show the same picture, but for what is half hidden."""
    scene = furry("strand", 40, camera=clfur.Camera(eye=(0, .4, 2.2), size=(160, 120)))
    keys = dict(samples=16, shadows=shadows, grid=32, shadow_map=128)
    one, other = (clfur.render(scene, gpu, clfur.Settings(raster=name, **keys)) for name in ("samples", "coverage"))
    assert np.abs(one - other).mean() < .008 and np.abs((one - other).mean((0, 1))).max() < .004 < one.mean() / 10
