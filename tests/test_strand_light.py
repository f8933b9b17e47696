"""Light of strands at places along them: the twin's values on every device, and how much is lost between the places."""

import functools
import itertools

import attrs
import numpy as np
import pytest
from support.coverage import LIGHT, ball, furry
from support.scenes import squares, strands_of
from support.stages import on_host

import clfur
from clfur.color import linear_to_srgb
from clfur.pipeline.shadows import cast_shadows
from clfur.pipeline.views import light_of, view_of
from clfur.scene import highlighted
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
@pytest.mark.parametrize("lights", [[LIGHT], [SPOT, LIGHT], [
    attrs.evolve(SPOT, size=.2), attrs.evolve(LIGHT, size=30)]], ids=["far", "both", "discs"])
def test_transmittances_are_the_twins(gpu, n, settings, lights):
    """All but where rounding takes a place into the next texel, or a texel from one side of the plane to the other: of
    100 places one at most.  Sums of crossings in float32: 3e-6 of a transmittance."""
    scene = furry("strand", n, light=lights)
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, settings, strands, tessellate(gpu, scene.mesh))
    there = strand_light.transmittance(gpu, strands, lighting).get()
    meant = twin.transmittance(on_host(lighting).lights, on_host(strands), *obstacles_of(lighting))
    off = (np.abs(there - meant) > 3e-6).mean()
    assert off < (.01 if not lights[0].size else .03)   # of discs 128 texels are asked for, not 9
    assert there.shape == (len(lights), len(strands.points)) and ((meant > 0) & (meant < .9)).any()


@pytest.mark.parametrize("kind, n", [pytest.param("strand", 4, marks=pytest.mark.small), ("grown", 0), ("strand", 300)])
def test_transmittances_of_ends_are_those_of_points(gpu, kind, n):
    """The same bits."""
    scene = furry(kind, n, light=[SPOT, LIGHT])
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, clfur.Settings(grid=16, shadow_map=16), strands, tessellate(gpu, scene.mesh))
    spans = on_host(strands).spans
    starts = np.concatenate([first + np.arange(points - 1) for first, points in spans])[::-2].astype(np.uint32)
    ends = strand_light.transmittance(gpu, strands, lighting, gpu.upload(starts | np.uint32(1 << 31))).get()
    there = strand_light.transmittance(gpu, strands, lighting).get()
    np.testing.assert_array_equal(ends.reshape(2, -1, 2), np.stack([there[:, starts], there[:, starts + 1]], 2))
    assert (ends < .9).any()


@pytest.mark.parametrize("kind, size", [pytest.param("strand", 3, marks=pytest.mark.small), *itertools.product(
    ["strand", "grown"], [4, 50, 128, 130, 300])])
@pytest.mark.parametrize("light", [LIGHT, SPOT, attrs.evolve(LIGHT, size=30)], ids=["far", "spot", "disc"])
def test_ranges_of_depths_change_nothing(gpu, monkeypatch, kind, size, light):
    """The same bits, whether blocks of the map tell that all texels around a point hide it, or none, or nobody asks
    them: of strands in any place, and of those that stand on the body, whose slopes count."""
    scene = furry(kind, 4 if size == 3 else 2000, light=light)
    if kind == "grown":
        scene = attrs.evolve(scene, fur=attrs.evolve(scene.fur, roots=4000))
    strands = strands_of(gpu, scene)
    lighting = cast_shadows(gpu, scene, clfur.Settings(grid=16, shadow_map=size), strands, tessellate(gpu, scene.mesh))
    found, launch = [], gpu.launch

    def spoilt(name, size, /, **arguments):
        launch(name, size, **arguments)
        if name == "strand_light.depth_ranges":
            arguments["ranges"].set(np.zeros_like(arguments["ranges"].get()))
    for least in 0, 1 << 31, 0:
        monkeypatch.setattr(strand_light, "LEAST", least)
        if len(found) == 2:
            monkeypatch.setattr(gpu, "launch", spoilt)
        found.append(strand_light.transmittance(gpu, strands, lighting).get())
    np.testing.assert_array_equal(*found[:2])
    if size >= 50:
        assert (found[0] == 0).any() and (found[0] > .5).any()
        assert (found[2] != found[0]).any() == (gpu.lanes > 1 and light.size == 0)   # discs do not ask them


@pytest.mark.parametrize("size", [pytest.param(5, marks=pytest.mark.small), 129, 300])
def test_ranges_are_of_the_texels_around_a_block(gpu, size):
    """Of these at least, and of four more columns at most."""
    scene = furry("strand", 4)
    lighting = cast_shadows(gpu, scene, clfur.Settings(grid=16, shadow_map=size), strands_of(gpu, scene),
                            tessellate(gpu, scene.mesh))
    blocks = strand_light.BLOCKS
    ranges = gpu.full(blocks**2, np.uint32, 0)
    gpu.launch("strand_light.depth_ranges", blocks, shadows=lighting.shadows, ranges=ranges,
               light_views=lighting.light_views, shadow_maps=lighting.shadow_maps)
    told, side = gpu.download(ranges).reshape(blocks, blocks), -(-size // blocks)
    depths = np.minimum((gpu.download(lighting.shadow_maps).ravel() >> np.uint64(32 + 15)), 0xFFFF).reshape(size, size)
    assert len(np.unique(depths)) > 2
    for y in range(0, size, side):
        rows = depths[max(y - 1, 0):y + side + 1]
        for x in range(0, size, side):
            nearest, furthest = told[y // side, x // side] & 0xFFFF, told[y // side, x // side] >> 16
            around, more = rows[:, max(x - 1, 0):x + side + 1], rows[:, max(x - 5, 0):x + side + 5]
            assert more.min() <= nearest <= around.min() and around.max() <= furthest <= more.max()


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
    number, least = np.arange(len(k)) if listed else k, np.uint64(2**63)
    every = lit.places.get().reshape(-1, len(lights), 5)[number]
    few = every[:, :, 0] < least
    assert len(lit.more) == (~few.all(1)).sum() and (few.any() or kind != "grown") and not few.all()
    for n, light in enumerate(lights):
        one, places = few[:, n], every[few[:, n], n]
        of = functools.partial(twin.sent, view, [light], strands=there,
                               transmittances=transmittances[n:n + 1] if shadowed else None)
        for j in range(5):
            at = np.full(len(places), j / 4)
            np.testing.assert_allclose(twin.between(places, np.arange(len(at)), at), of(k[one], at), rtol=2e-4,
                                       atol=5e-5)
    rows = np.where(few, least - np.uint64(1), every[:, :, 0] - least)   # of a segment the same for all lights
    rows = [set(row[~known]) for row, known in zip(rows, few) if not known.all()]
    assert {len(row) for row in rows} <= {1} and set().union(*rows) == set(range(len(rows)))


def fur_of(**keys):
    given = {"width": .01, "segment_length": .05, "segments": 4} | keys
    return clfur.Strands(inner=2, outer=2, types=clfur.HairType(**given))


def passing(n=80):
    """Segments that pass the eye at (0, 0, 1) closely, of strands that turn back too."""
    rng = np.random.default_rng(6)
    middle, length = rng.normal(size=(n, 1, 3)) * .1 + (0, 0, .8), np.repeat((.4, .002), n // 2)[:, None, None]
    way = rng.normal(size=(n, 3, 3)) * length
    return clfur.Curves(middle + np.cumsum(way, 1) - way[:, :1], width=.01, exponent=20, specular=1)


SCENES = {   # fur, camera, light
    "default": (clfur.Strands(inner=2, outer=2), {}, LIGHT),
    "curls": (fur_of(curl=(.02, 3), segments=8), {}, LIGHT),
    "2 bent": (fur_of(segments=2, segment_length=.2, force_weight=1), {}, LIGHT),
    "3 bent": (fur_of(segments=3, segment_length=.1, force_weight=1), {}, LIGHT),
    "4 bent": (fur_of(force_weight=1), {}, LIGHT),
    "narrow highlight": (fur_of(look=clfur.Kajiya(exponent=500, specular=1)), {}, LIGHT),
    "very narrow": (fur_of(segments=1, segment_length=.3, look=clfur.Kajiya(exponent=10000, specular=1)), {}, LIGHT),
    "half vector": (highlighted(fur_of(force_weight=1, look=clfur.Kajiya(exponent=200)), "half-vector"), {}, LIGHT),
    "close": (fur_of(), {"eye": (.4, .4, .5)}, LIGHT),
    "passing": (passing(), {"eye": (0, 0, 1)}, LIGHT),
    "wide": (fur_of(width=.3), {}, LIGHT),
    "spot": (fur_of(), {}, attrs.evolve(SPOT, angle=12)),
    "narrow spot": (passing(), {}, clfur.Light((-1, -1, -1), position=(1, 1, 1), angle=2)),
    "both": (fur_of(), {}, [SPOT, LIGHT])}


@pytest.mark.parametrize("name", SCENES)
def test_few_places_are_enough_where_there_are_no_more(gpu, name):
    """The bound of light: .002 (rms, sRGB) and no bias beyond 4e-4; segments that turn more are lit by piece."""
    fur, camera, light = SCENES[name]
    scene = clfur.Scene(ball(), fur, camera=clfur.Camera(size=(64, 48), **camera), light=light)
    strands, view, lights = strands_of(gpu, scene), view_of(scene, 1), [light_of(each) for each in scene.lights]
    there, rng = on_host(strands), np.random.default_rng(1)
    k = np.concatenate([first + np.arange(max(int(count) - 1, 0)) for first, count in there.spans]).astype(int)
    k = np.repeat(k, 9)
    at, places = rng.random(len(k)), strand_light.radiance(gpu, view, unshadowed(gpu, *lights), strands).places.get()
    places, found, meant = places.reshape(-1, len(lights), 5)[k], 0, twin.sent(view, lights, k, at, there)
    few = places[:, :, 0] >> np.uint64(63) == 0
    for n, light in enumerate(lights):
        one = few[:, n, None]
        found = found + np.where(one, twin.between(np.where(one, places[:, n], 0), np.arange(len(k)), at),
                                 twin.sent(view, [light], k, at, there))
    off = linear_to_srgb(np.clip(found, 0, 1)) - linear_to_srgb(np.clip(meant, 0, 1))
    assert np.sqrt((off**2).mean()) < .002 and np.abs(off.mean()) < 4e-4 and meant.max() > .05
    assert few.any() or name in ("curls", "2 bent", "very narrow")
    assert not few.all() or name in ("default", "close", "wide")


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


