"""Light on strands by area: the twin's values on every device, and the laws of light."""

import numpy as np
import pytest
from support.coverage import LIGHT, NONE, OFF, SETTINGS, counted, furry, pieces_of, wild
from support.scenes import strands_of
from support.stages import on_host, strands_on
from support.views import pack, perspective

import clfur
from clfur.pipeline.views import light_of, view_of
from clfur.stages import coverage, strand_light
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import raster
from clfur.stages.tessellate import no_surface, tessellate
from clfur.twin import coverage as twin
from clfur.twin import strand_light as lights_twin

SPOT = clfur.Light((-1, -1, -1), position=(1, 1, 1), angle=30)


pytestmark = pytest.mark.usefixtures("plain")


@pytest.mark.parametrize("kind, form, n, shadowed", [
    pytest.param("point", "kajiya-kay", 4, True, marks=pytest.mark.small), ("all", "kajiya-kay", 60, False),
    ("strand", "half-vector", 60, True), ("grown", "kajiya-kay", 0, True)])
@pytest.mark.parametrize("lights", [[LIGHT], [SPOT], [LIGHT, SPOT]], ids=["far", "spot", "both"])
def test_light_is_the_twins(gpu, kind, form, n, shadowed, lights):
    """Of all pieces, hidden by the twin, at the places that it finds on their segments: known to 1/65535 of these,
    along which light changes by itself a few times."""
    scene = furry(kind, n, (13, 11) if n == 4 else (41, 31), form)
    view, strands, lights = view_of(scene, 4), strands_of(gpu, scene), [light_of(light) for light in lights]
    visible = raster(gpu, view, None, tessellate(gpu, scene.mesh) if scene.body_color is not None else no_surface(gpu))
    _, segments = counted(gpu, view, strands, visible)
    shape = len(lights), len(strands.points)
    transmittances = np.random.default_rng(3).random(shape).astype(np.float32) if shadowed else None
    lit = strand_light.radiance(gpu, view, unshadowed(gpu, *lights), strands,
                                gpu.upload(transmittances) if shadowed else None, segments.ids)
    image = gpu.empty((*visible.shape[:2], 4), np.float32)
    coverage.cover(gpu, view, visible, segments, coverage.nothing(gpu, visible), lit, image)
    image, visible, pieces = image.get(), visible.get(), pieces_of(gpu, view, segments)
    pieces["at"] = twin.places(view, pieces, strands.points.get(), image.shape[1])
    number = np.empty(len(strands.points), int)
    number[segments.ids.get() & 0x7FFFFFFF] = np.arange(len(segments.ids))
    places, number = lit.places.get(), number[pieces["id"]]
    sent = np.zeros((len(number), 3))
    for n, light in enumerate(lights):
        one, its = lights_twin.sent(view, [light], pieces["id"], pieces["at"], on_host(strands),
                                    transmittances[n:n + 1] if shadowed else None), places[n::len(lights)]
        few = its[number, 0] >> np.uint64(63) == 0   # the others are lit by piece
        one[few] = lights_twin.between(its, number[few], pieces["at"][few])
        sent += one
    meant = np.zeros(image.shape)
    for pixel in np.unique(pieces["pixel"]):
        y, x = divmod(int(pixel), image.shape[1])
        here = {int(d) << 32 | int(k): i for i in np.flatnonzero(pieces["pixel"] == pixel)
                for k, d in [pieces[["id", "depth"]][i]]}
        found = twin.resolve({key: float(pieces["share"][i]) for key, i in here.items()}, visible[y, x].tolist())
        meant[y, x, :3] = sum((w * sent[here[key]] for key, w in found["weights"].items()), np.zeros(3))
        meant[y, x, 3] = found["alpha"]
    assert (meant[..., 3] > 0).mean() > .05 and meant[..., :3].max() > .05
    off = np.abs(image - meant)[meant[..., :3].any(-1)]
    assert off[:, 3].max() < 1e-5 and off.max() < 2e-4 and off.mean() < 2e-6


@pytest.mark.parametrize("eye", [(0, .4, 3.2), (.1, .1, .9)], ids=["before", "within"])
def test_places_are_the_twins(gpu, eye):
    """Where on its segment a piece is lit, of clipped ones too: but for 1/65535 and float32's rounding."""
    view, (points, spans) = perspective(61, 47, 1, eye=eye), pack(wild(150, 1))
    visible = np.full((47, 61, 1), NONE)
    _, segments = counted(gpu, view, strands_on(gpu, points, spans), gpu.upload(visible))
    pieces = pieces_of(gpu, view, segments)
    meant = twin.places(view, pieces, points, 61)
    off = np.abs(pieces["at"] - meant)
    assert len(off) > 1000 and np.quantile(off, .999) < 2e-4 and off.max() < .01
    if eye[2] < 1:
        assert (segments.cuts.get() != 0xFFFF0000).any()


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
    # Light of segments that turn far is packed, to 2^-14 of itself.
    np.testing.assert_allclose(out["color"][..., :3], out["coverage"][..., None] * scene.strands.color, rtol=2.0**-14,
                               atol=2e-6)
    np.testing.assert_allclose(out["color"][..., 3], out["coverage"], rtol=0, atol=2e-6)
    assert 0 < (out["coverage"] > .2).mean() < 1


@pytest.mark.parametrize("shadows", ["off", "length"])
def test_wide_strands_are_lit_as_by_samples(gpu, shadows):
    """Of strands three pixels wide both ways show the same picture, but for what is half hidden."""
    scene = furry("strand", 40, camera=clfur.Camera(eye=(0, .4, 2.2), size=(160, 120)))
    keys = dict(samples=16, shadows=shadows, grid=32, shadow_map=128)
    one, other = (clfur.render(scene, gpu, clfur.Settings(raster=name, **keys)) for name in ("samples", "coverage"))
    assert np.abs(one - other).mean() < .008 and np.abs((one - other).mean((0, 1))).max() < .004 < one.mean() / 10
