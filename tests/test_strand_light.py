"""Light of strands at places along them: the twin's values on every device, and how much is lost between the places."""

import functools

import numpy as np
import pytest
from support.coverage import LIGHT, furry
from support.scenes import squares, strands_of
from support.stages import on_host

import clfur
from clfur.pipeline.shadows import cast_shadows
from clfur.pipeline.views import light_of, view_of
from clfur.stages import strand_light
from clfur.stages.lighting import unshadowed
from clfur.stages.tessellate import no_surface, tessellate
from clfur.twin import strand_light as twin

SPOT = clfur.Light((-1, -1, -1), position=(1, 1, 1), angle=30)


def obstacles_of(lighting):
    """What stands before each light, on the host: [shadows, grids, views, crossings, shadow_maps]."""
    there, crossings, maps = on_host(lighting), [], []
    for shadow, grid, view in zip(there.shadows, there.grids, there.light_views):
        (nx, ny, nz, _), (width, height, *_) = grid["size"], view["size"]
        cells, texels = shadow["place"].view(np.uint64)
        crossings.append(there.crossings[int(cells):][:(nz + 1) * ny * nx].reshape(-1, ny, nx) if nx else None)
        maps.append(there.shadow_maps[int(texels):][:width * height].reshape(height, width) if width else None)
    return there.shadows, there.grids, there.light_views, crossings, maps


@pytest.mark.parametrize("n, settings", [
    pytest.param(4, clfur.Settings(grid=16, shadow_map=16), marks=pytest.mark.small),
    (500, clfur.Settings(grid=32, shadow_map=64, pcf=2)),
    (500, clfur.Settings(shadows="count", grid=16, shadow_map=32)),
    (500, clfur.Settings(grid=48, shadow_map=0))])
@pytest.mark.parametrize("lights", [[LIGHT], [SPOT, LIGHT]], ids=["far", "both"])
def test_transmittances_are_the_twins(gpu, n, settings, lights):
    """All but where rounding takes a place into the next texel, or a texel from one side of the plane to the other: of
    100 places one at most.  Sums of crossings in float32: 3e-6 of a transmittance."""
    scene = furry("strand", n, light=lights)
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, settings, strands, tessellate(gpu, scene.mesh))
    there = strand_light.transmittance(gpu, strands, lighting).get()
    meant = twin.transmittance(on_host(lighting).lights, on_host(strands), *obstacles_of(lighting))
    assert (np.abs(there - meant) > 3e-6).mean() < .01
    assert there.shape == (len(lights), len(strands.points)) and ((meant > 0) & (meant < .9)).any()


@pytest.mark.parametrize("kind, form, n, shadowed", [
    pytest.param("point", "kajiya-kay", 4, True, marks=pytest.mark.small), ("all", "kajiya-kay", 60, False),
    ("strand", "half-vector", 60, True), ("grown", "kajiya-kay", 0, True)])
@pytest.mark.parametrize("lights", [[LIGHT], [SPOT], [LIGHT, SPOT]], ids=["far", "spot", "both"])
@pytest.mark.parametrize("listed", [False, True])
def test_places_are_the_twins(gpu, kind, form, n, shadowed, lights, listed):
    """At the places where light is known: 2e-5 as for samples, see test_shade.py, and 2^-14 as it is packed."""
    scene, lights = furry(kind, n, highlight=form), [light_of(light) for light in lights]
    strands, view = strands_of(gpu, scene), view_of(scene, 1)
    there, rng = on_host(strands), np.random.default_rng(3)
    transmittances = rng.random((len(lights), len(strands.points))).astype(np.float32) if shadowed else None
    k = np.concatenate([first + np.arange(max(int(count) - 1, 0)) for first, count in there.spans]).astype(int)
    if listed:
        k = rng.permutation(k)[:len(k) // 2 + 1]
    lit = strand_light.radiance(gpu, view, unshadowed(gpu, *lights), strands,
                                gpu.upload(transmittances) if shadowed else None,
                                gpu.upload(k.astype(np.uint32)) if listed else None)
    places, more = lit.places.get(), lit.more.get()
    number = np.arange(len(k)) if listed else k
    of = functools.partial(twin.sent, view, lights, k, strands=there, transmittances=transmittances)
    many = places[number, 0] >> np.uint64(63) > 0
    assert len(more) == many.sum() and (many.any() or n == 4)
    for j in range(15):                    # at each place; at the others of few light is between
        here = many | (j % 7 == 0)
        found = twin.between(places, more, number, np.full(len(k), j / 14))[here]
        np.testing.assert_allclose(found, of(at=np.full(len(k), j / 14))[here], rtol=2e-4, atol=5e-5)


def test_light_in_64_bits_keeps_its_digits():
    values = np.random.default_rng(1).uniform(0, 1, (1000, 3)).astype(np.float32) ** 8 * 1e9
    bits = (values.view(np.uint32) + np.uint32(512) >> np.uint32(10)).astype(np.uint64)
    packed = bits[:, 0] << np.uint64(42) | bits[:, 1] << np.uint64(21) | bits[:, 2]
    np.testing.assert_allclose(twin.unpacked(packed), values, rtol=2.0**-14)


@pytest.mark.small
@pytest.mark.parametrize("color", [-0.0, -1, np.nan])
def test_what_is_no_light_is_none(gpu, color):
    """Its sign must not be taken for the mark of segments that have more places: these would be looked for anywhere."""
    line = clfur.Curves([[(-.1, 0, 0), (.1, 0, 0)]], specular=0, exponent=1)   # straight and dull: it needs few places
    scene, light = clfur.Scene(fur=line), light_of(clfur.Light((0, -1, 0), ambient=0))
    light["color"] = color, 1, 1, -0.0
    strands, view = strands_of(gpu, scene), view_of(scene, 1)
    places = strand_light.radiance(gpu, view, unshadowed(gpu, light), strands).places.get()
    assert not (places >> np.uint64(63)).any() and not twin.unpacked(places)[..., 0].any()
    assert twin.unpacked(places)[0, :, 1].all()


def test_transmittance_is_whole_where_nothing_stands_before(gpu):
    """Above a plate all of it, below none; below a coat of hair some."""
    places = [(0, 1, 0), (0, .5, 0), (0, -.5, 0), (0, -1, 0)]
    line = clfur.Curves(np.array([places]) + (.01, 0, .013), width=.001)
    settings = clfur.Settings(shadow_map=64, grid=32)
    scene = clfur.Scene(squares((.8, 0)), line, light=clfur.Light((0, -1, 0)))
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, settings, strands, tessellate(gpu, scene.mesh))
    transmittances = strand_light.transmittance(gpu, strands, lighting).get()
    np.testing.assert_allclose(transmittances, [[1, 1, 0, 0]], atol=1e-3)
    rng = np.random.default_rng(5)
    coat = rng.uniform((-1, .7, -1), (1, .8, 1), (2000, 1, 3)) + rng.normal(size=(2000, 2, 3)) * (.1, 0, .1)
    hair = np.concatenate([coat, np.array([places[:2], places[2:]])])
    scene = clfur.Scene(fur=clfur.Curves(hair, width=.01, alpha=.5), light=clfur.Light((0, -1, 0)))
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, settings, strands, no_surface(gpu))
    above, *below = strand_light.transmittance(gpu, strands, lighting).get()[0, -4:]
    assert above > .98 and .1 < max(below) < .9 and max(below) - min(below) < .2


