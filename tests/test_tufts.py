"""tufts against its twin, and against what holds for all hair that gathers."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import layout
from clfur.judge import truth
from clfur.judge.geometry import geometry_of, middles_of
from clfur.scene.bounds import fur_extent, hair_bounds
from clfur.scene.tufts import spots_of
from clfur.stages import strands, tufts
from clfur.stages.tessellate import as_float4, tessellate
from clfur.twin import strands as strands_twin
from clfur.twin import tufts as twin

HAIR = {"length": .5, "stiffness": .4, "width": .01, "segments": 10, "direction_variation": .3, "length_variation": .3}
CURLY = {"curl": (.04, 2), "wave": (.02, 1.5)}
WILD = {"tufts": clfur.Tufts(200, within=clfur.Tufts(30)), "frizz": (.01, 5), **CURLY}
# Of places on a mesh of radius 1, each a sum of a dozen float32 numbers or so [largest error measured, in tests].
PLACE = 10 * 2.0**-24


def ball(level=1):
    positions, faces = icosphere(level)
    return clfur.Mesh(positions, positions, np.abs(positions[faces][..., :2]), faces)


def furred(mesh=None, roots=400, size=48, **hair):
    given = {**HAIR, **hair}
    return clfur.Scene(mesh or ball(), clfur.Strands(types=clfur.HairType(**given), roots=roots, inner=1, outer=1),
                       clfur.Camera(eye=(.2, .3, 4), size=(size, size)))


def points_of(gpu, scene):
    """[strands, points, 3] of a scene of one type."""
    grown = clfur.grow(scene, gpu)
    return grown.points.reshape(len(grown.counts), -1, 3)


def lengths_of(points):
    return np.linalg.norm(np.diff(points, axis=1), axis=2)


def lines(n, points, seed):
    """Random strands [n, points, 3] on the ground about the origin, none like another."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(n, points - 1, 3)) * .05 + (0, .1, 0)
    root = rng.uniform(-1, 1, (n, 1, 3)) * (1, .05, 1)
    return np.concatenate([root, root + np.cumsum(steps, 1)], 1).astype(np.float32)


def on_device(gpu, points, kind=0, types=None, normals=None):
    """`DeviceStrands` of strands [n, P, 3] of types by their numbers, a number or [n]."""
    n, count, _ = points.shape
    rows = np.concatenate([points, np.full((n, count, 1), .01, np.float32)], 2).reshape(-1, 4)
    spans = np.stack([np.arange(n) * count, np.full(n, count)], 1)
    up = np.tile(np.float32([0, 1, 0]), (n, 1)) if normals is None else normals
    uv = np.column_stack([np.zeros((n, 2)), np.broadcast_to(kind, n), np.zeros(n)])
    packed, *_ = strands.pack_types(types or [clfur.HairType()])
    empty = strands.no_strands(gpu)
    return strands.DeviceStrands(
        points=gpu.upload(rows), spans=gpu.upload(spans.astype(np.uint32)), shifts=empty.shifts,
        numbers=gpu.upload(np.arange(n, dtype=np.uint32)), strand_of=empty.strand_of, stored=empty.stored,
        colors=empty.colors, normals=gpu.upload(as_float4(up.astype(np.float32))), uv=gpu.upload(uv.astype(np.float32)),
        types=gpu.upload(packed), first_strand=3)


def read(gpu, there, count):
    return gpu.download(there.points)[:, :3].reshape(-1, count, 3).astype(float)


def spots(n, seed=2, spacing=.3):
    rng = np.random.default_rng(seed)
    return SimpleNamespace(faces=np.zeros(n, int), sizes=rng.uniform(.3, 1.9, n), spacing=spacing,
                           turns=rng.normal(size=(n, 3)).astype(np.float32))


# --- each kernel ----------------------------------------------------------------------------------------


@pytest.mark.small
@pytest.mark.parametrize("surface", ["pn", "flat"])
def test_middles_stand_where_the_twins_do(gpu, surface):
    mesh = ball(0)
    there = spots_of(clfur.Tufts(50), mesh, mesh, 3)
    made = tufts.surface_of(gpu, mesh, there, surface)
    corners = mesh.faces[there.faces]
    place, up = twin.stand(mesh.positions[corners], mesh.normals[corners], there.weights, surface == "pn")
    positions, normals, uv = (gpu.download(each).reshape(50, 3, 4).astype(float)
                              for each in (made.positions, made.normals, made.uv))
    np.testing.assert_allclose(positions[..., :3].mean(1), place, rtol=0, atol=PLACE)
    np.testing.assert_allclose(normals[..., :3], np.repeat(up[:, None], 3, 1), rtol=0, atol=PLACE)
    at = np.einsum("nc,ncx->nx", there.weights.astype(float), mesh.uv[there.faces])
    np.testing.assert_allclose(uv.mean(1), np.column_stack([at, there.weights[:, :2]]), rtol=0, atol=PLACE)
    np.testing.assert_array_equal(gpu.download(made.triangles), np.column_stack(
        [np.arange(150).reshape(50, 3), there.faces]))
    edge = positions[:, 1, :3] - positions[:, 0, :3]
    flat = mesh.positions[corners[:, 1]] - mesh.positions[corners[:, 0]]
    np.testing.assert_allclose(edge, flat / 16, rtol=0, atol=4 * PLACE)
    steps = np.diff(mesh.uv[there.faces], axis=1) / 16
    np.testing.assert_allclose(np.diff(uv, axis=1)[..., :2], steps, rtol=0, atol=4 * PLACE)


@pytest.mark.small
@pytest.mark.parametrize("n, spacing", [(1, .3), (2, .01), (70, .2), (70, .02), (70, 5)])
def test_the_nearest_middle_is_found(gpu, n, spacing):
    """Whatever the cells are like; some strands and middles are of another type, and some look another way."""
    rng = np.random.default_rng(4)
    kind, of_middle = rng.integers(0, 2, 300), np.arange(n) % 3 == 1
    up, of_skin = (strands_twin.unit_or(rng.normal(size=(k, 3)) + (0, .5, 0), 0).astype(np.float32) for k in (300, n))
    hair, there = lines(300, 2, 5), spots(n, spacing=spacing)
    made = middles(gpu, lines(n, 2, 6), there, of_middle, of_skin)
    found = gpu.download(tufts.assign(gpu, on_device(gpu, hair, kind, normals=up), made, 0))
    mine = ~of_middle
    expected, two = twin.nearest(hair[:, 0], up, lines(n, 2, 6)[mine, 0], of_skin[mine], there.sizes[mine], spacing)
    assert (found[kind == 1] == twin.NONE).all()
    clear = (kind == 0) & (two[:, 0] < (1 - 1e-5) * two[:, 1])
    np.testing.assert_array_equal(found[clear], np.flatnonzero(mine)[expected[clear]])
    assert clear.sum() > 120


def middles(gpu, hair, there, kind, normals=None):
    """`Middles` of hair [n, P, 3] as if each stood on a triangle of its own."""
    n = len(hair)
    up = np.tile(np.float32([0, 1, 0]), (n, 1)) if normals is None else normals
    surface = SimpleNamespace(positions=gpu.upload(as_float4(np.repeat(hair[:, 0], 3, 0))),
                              normals=gpu.upload(as_float4(np.repeat(up, 3, 0))))
    return tufts.middles_of(gpu, on_device(gpu, hair, kind), surface, there, 0)


@pytest.mark.small
def test_places_at_rest_are_the_twins(gpu):
    mesh, rng = ball(0), np.random.default_rng(2)
    surface = tessellate(gpu, mesh, 1, 1)
    weights, number = rng.dirichlet(np.ones(3), 30).astype(np.float32), rng.integers(0, 20, 30).astype(np.uint32)
    made = tufts.at_rest(gpu, surface, gpu.upload(np.column_stack([number, weights.view(np.uint32)])))
    corners = mesh.faces[number]
    place, frame, _ = strands_twin.roots_at(mesh.positions, mesh.normals, np.zeros((12, 2)), corners, weights)
    np.testing.assert_allclose(gpu.download(made.places)[:, :3], place, rtol=0, atol=PLACE)
    np.testing.assert_allclose(gpu.download(made.place_normals)[:, :3], frame[:, 2], rtol=0, atol=PLACE)


@pytest.mark.small
def test_of_equally_near_middles_the_first_counts(gpu):
    there, place = spots(4), np.repeat(lines(1, 2, 1), 4, 0)
    there.sizes[:] = 1
    made = middles(gpu, place, there, [1, 0, 0, 0])
    assert (gpu.download(tufts.assign(gpu, on_device(gpu, lines(20, 2, 3)), made, 0)) == 1).all()


@pytest.mark.small
def test_without_a_middle_there_is_no_tuft(gpu):
    made = middles(gpu, lines(3, 2, 1), spots(3), 1)
    hair = on_device(gpu, lines(20, 5, 3))
    tuft_of = tufts.assign(gpu, hair, made, 0)
    tufts.gather(gpu, hair, made, 0, tuft_of, clfur.Tufts(3))
    assert (gpu.download(tuft_of) == twin.NONE).all() and (read(gpu, hair, 5) == lines(20, 5, 3)).all()


@pytest.mark.small
@pytest.mark.parametrize("strength, profile, factors", [(1, .5, False), (.7, .2, False), (1, .9, True), (0, .5, False)])
def test_strands_gather_as_the_twins_do(gpu, strength, profile, factors):
    """[3e-7]"""
    hair, middle = lines(60, 9, 7), lines(5, 6, 8)
    middle[3, 1:] = middle[3, :1]      # of no length
    middle[4, 4:] = middle[4, 3:4]     # which ends early
    rng = np.random.default_rng(1)
    tuft = np.append(rng.integers(0, 5, 59), twin.NONE).astype(np.uint32)
    traits = np.zeros(60, layout.Traits)
    traits["tuft"][:, 0] = rng.random(60) * (rng.random(60) > .2)
    there = on_device(gpu, hair)
    kind = clfur.Tufts(5, strength=strength, profile=profile)
    tufts.gather(gpu, there, middles(gpu, middle, spots(5), 0), 0, gpu.upload(tuft), kind,
                 traits=gpu.upload(traits) if factors else None)
    whole = strength * traits["tuft"][:, 0].astype(float) if factors else strength
    expected = twin.gather(hair, tuft, middle, whole, profile)
    made = read(gpu, there, 9)
    np.testing.assert_allclose(made, expected, rtol=0, atol=2 * PLACE)
    assert (lengths_of(made) - lengths_of(hair)).max() < 4 * PLACE
    assert (made[-1] == hair[-1]).all() and (strength == 0) == (made == hair).all()


@pytest.mark.small
@pytest.mark.parametrize("has_tufts", [True, False])
@pytest.mark.parametrize("frizz", [(0, 0), (.05, 3.7), (.1, 60)])
def test_strands_curl_as_the_twins_do(gpu, has_tufts, frizz):
    """[4e-7]"""
    kind = clfur.HairType(segments=8, frizz=frizz, tufts=clfur.Tufts(5) if has_tufts else None, **CURLY)
    hair, rng = lines(40, 9, 7), np.random.default_rng(1)
    hair[3, 4] = hair[3, 3]
    hair[4] = hair[4, :1]
    turns = rng.normal(size=(5, 3)).astype(np.float32)
    tuft = np.append(rng.integers(0, 5, 39), twin.NONE).astype(np.uint32)
    traits = np.zeros(40, layout.Traits)
    traits["tuft"][:, 1], traits["scale"][:, 3] = rng.random((2, 40))
    there = on_device(gpu, hair, types=[kind])
    tufts.curl(gpu, there, 0, 11, *[gpu.upload(tuft), gpu.upload(as_float4(turns))] * has_tufts,
               traits=gpu.upload(traits))
    turn = np.append(turns, np.zeros((1, 3)), 0)[np.minimum(tuft, 5)] if has_tufts else np.zeros((40, 3))
    expected = twin.curl(hair, turn, kind, np.arange(40) + 3, 11, traits["scale"][:, 3], traits["tuft"][:, 1])
    made = read(gpu, there, 9)
    np.testing.assert_allclose(made, expected, rtol=0, atol=4 * PLACE)
    assert (made[:, 0] == hair[:, 0]).all() and (has_tufts or frizz[0] > 0) == (made != hair).any()


# --- all of it ------------------------------------------------------------------------------------------


def twin_points(scene):
    """What the twins grow: points [strands, P, 3]."""
    kind, = scene.strands.types
    hair = geometry_of(scene)[0]
    return np.asarray(hair.points)[:, :3].reshape(-1, kind.segments + 1, 3)


@pytest.mark.parametrize("hair", [
    {"tufts": clfur.Tufts(30)}, {"tufts": clfur.Tufts(80, within=clfur.Tufts(9, strength=.6), strength=1), **CURLY},
    {"frizz": (.02, 8)}, {"tufts": clfur.Tufts(density=4.0, size_variation=1, profile=.1), "frizz": (.01, 5), **CURLY},
    {"tufts": clfur.Tufts(30), "length": None, "stiffness": None, "segment_length": .05, "force_weight": .2}])
def test_all_equals_the_twins(gpu, hair):
    """[1.2e-6]; a strand whose two nearest middles are as near, to the last bits, could have either."""
    scene = furred(**hair)
    np.testing.assert_allclose(points_of(gpu, scene), twin_points(scene), rtol=0, atol=4 * PLACE)


def test_the_picture_is_the_truths(gpu):
    scene = furred(roots=1500, tufts=clfur.Tufts(40, strength=1), frizz=(.01, 5), **CURLY)
    seen, true = clfur.render(scene, gpu), truth.picture(scene, samples=4)
    plain = clfur.render(furred(roots=1500, **CURLY), gpu)
    off, far = (np.sqrt(((each - true)[..., 3]**2).mean()) for each in (seen, plain))
    assert off < .06 and far > 2 * off


@pytest.mark.parametrize("hair", [
    {"frizz": (0, 7)}, {"tufts": clfur.Tufts(30, strength=0)}, {"frizz": (0, 7), **CURLY},
    {"tufts": clfur.Tufts(30, strength=0, within=clfur.Tufts(5, strength=0))}])
def test_none_of_it_is_the_same_bits(gpu, hair):
    plain = {name: value for name, value in hair.items() if name in CURLY}
    np.testing.assert_array_equal(points_of(gpu, furred(**hair)), points_of(gpu, furred(**plain)))


def guided(**hair):
    """A ball whose hair goes between guides, curly ones."""
    scene = furred(**hair)
    place = strands_twin.unit_or(np.random.default_rng(3).normal(size=(60, 1, 3)), 0)
    t = np.linspace(0, .5, 12)[:, None]
    guides = place * (1 + t) + .05 * np.concatenate([np.sin(20 * t), np.cos(20 * t) - 1, 0 * t], 1)
    return attrs.evolve(scene, fur=attrs.evolve(scene.strands, guides=clfur.Curves(guides)))


@pytest.mark.filterwarnings("ignore:Strands.guides has")   # its faces are flat
def test_hair_between_guides_gathers_too(gpu):
    """Two numbers that decide which of the nearest guides counts may be as near, to the last bits."""
    scene = guided(length=None, stiffness=None, **WILD)
    grown = points_of(gpu, scene)
    apart = np.abs(grown - twin_points(scene)).max((1, 2))
    assert (apart > 1e-5).sum() <= 2
    assert (np.linalg.norm(grown - grown[:, :1], axis=2).max() < fur_extent(scene.strands)).all()
    loose = points_of(gpu, guided(length=None, stiffness=None))
    assert np.median(np.abs(grown - loose).max((1, 2))) > .05


@pytest.mark.parametrize("kind", [WILD, {"tufts": clfur.Tufts(40, strength=1), "frizz": (.01, 4)}])
@pytest.mark.parametrize("comb", [{"direction": (1, 0, 0)}, {"direction": np.full((4, 4, 3), (255, 128, 0), np.uint8)}])
def test_maps_and_combs_count_in_tufts(gpu, kind, comb):
    """Middles are combed and as stiff as the skin says, but neither shorter nor bald; clump is of each strand."""
    rng, scene = np.random.default_rng(5), furred(**kind)
    maps = {name: rng.random(len(scene.mesh.faces)) for name in ("density", "length", "stiffness", "curl")}
    maps["clump"] = rng.random(scene.mesh.numbering.vertices)
    fur = attrs.evolve(scene.strands, maps=clfur.Maps(**maps), comb=clfur.Comb(**comb))
    scene = attrs.evolve(scene, fur=fur)
    grown, true = clfur.grow(scene, gpu), geometry_of(scene)[0]
    np.testing.assert_array_equal(grown.counts, true.counts)
    apart = np.abs(grown.points - true.points[:, :3]).reshape(-1, 11, 3).max((1, 2))
    assert (apart > 1e-5).sum() <= 2 and len(apart) > 100
    points = grown.points.reshape(-1, 11, 3)
    assert (np.linalg.norm(points - points[:, :1], axis=2).max(1) < fur_extent(fur)).all()


@pytest.mark.parametrize("profile, within", [(.1, .2), (.5, .1), (.9, .1)])
def test_the_tips_of_a_tuft_meet(gpu, profile, within):
    """Of hair .5 long that stands .1 away at most, at full strength: within .1 of the middle's tip, or .2 where it is
    drawn late; but for one in twenty, that falls off the other side of the ball or has too long a way."""
    scene, loose = (furred(roots=4000, tufts=each, length_variation=0) for each in (
        clfur.Tufts(200, strength=1, profile=profile), None))
    points = points_of(gpu, scene)
    made = middles_of(scene.strands, scene.mesh, 0, scene.strands.types[0].tufts)
    tuft = twin.find(made, points[:, 0].astype(float), points[:, 0].astype(float))
    away, tips, free = (np.linalg.norm(each - made.lines[tuft, k], axis=1) for each, k in (
        (points[:, 0], 0), (points[:, -1], -1), (points_of(gpu, loose)[:, -1], -1)))
    near = away < .1
    assert near.sum() > 1000
    assert np.quantile(tips[near], .95) < within and np.median(tips[near]) < within / 2
    assert np.median(free[near]) > 2 * np.median(tips[near])


@pytest.mark.parametrize("around, most", [(None, .9), (clfur.Tufts(40, strength=.7), .8)])
def test_no_segment_gets_longer(gpu, around, most):
    """And strands lose little, but where those of a tuft fall apart."""
    tufted, loose = (lengths_of(points_of(gpu, furred(roots=4000, tufts=each))) for each in (
        clfur.Tufts(300, strength=1, within=around), None))
    assert (tufted - loose).max() < 6 * PLACE
    kept = tufted.sum(1) / loose.sum(1)
    assert np.quantile(kept, .1) > most and np.median(kept) > .98 and kept.min() > .4


def test_frizz_and_curls_lengthen_no_more_than_their_bounds_say(gpu):
    scene = furred(roots=2000, tufts=clfur.Tufts(40, strength=1), frizz=(.1, 30), **CURLY)
    grown = clfur.grow(scene, gpu)
    points = grown.points.reshape(2000, -1, 3)
    _, length, _ = hair_bounds(scene.strands, 2000)
    assert lengths_of(points).sum() < length
    assert (np.linalg.norm(points - points[:, :1], axis=2).max(1) < fur_extent(scene.strands)).all()


@pytest.mark.parametrize("given, area", [({"count": 500}, 4 * np.pi), ({"density": 40.0}, 40)])
def test_as_many_tufts_as_were_asked_for(given, area):
    """On each part of the area its share, to one or two; and none where there is no skin."""
    mesh = ball(2)
    there = spots_of(clfur.Tufts(**given), mesh, mesh, 1)
    n = given.get("count") or round(given["density"] * mesh.area)
    assert len(there.faces) == n and there.spacing == pytest.approx(np.sqrt(mesh.area / n))
    corners = mesh.positions[mesh.faces].astype(float)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    share = np.cumsum(areas) / areas.sum()
    so_far = np.searchsorted(np.sort(there.faces), np.arange(len(areas)), side="right")
    assert np.abs(so_far - n * share).max() <= 1.01
    assert there.weights.min() >= 0 and np.abs(there.weights.sum(1) - 1).max() < 1e-6
    assert np.ptp(there.sizes) > .4 and np.ptp(spots_of(clfur.Tufts(9, size_variation=0), mesh, mesh, 1).sizes) == 0


def test_a_tuft_curls_as_one(gpu):
    """Away from its own axis each strand goes the way that all of them go; without tufts it goes its own."""
    hair = {"length_variation": 0, "direction_variation": 0, "stiffness": 1e5}
    given = {"tufts": clfur.Tufts(40, strength=0), **hair}
    curled, straight = (points_of(gpu, furred(**given, **more)) for more in ({"curl": (.04, 2)}, {}))
    scene = furred(**given)
    made = middles_of(scene.strands, scene.mesh, 0, scene.strands.types[0].tufts)
    tuft = twin.find(made, straight[:, 0].astype(float), straight[:, 0].astype(float))
    own = points_of(gpu, furred(curl=(.04, 2), **hair))

    def spread(points):   # of directions in which strands of a tuft have gone after a few segments: 0, all alike
        away = strands_twin.unit_or((points - straight)[:, 3], 0)
        means = np.array([away[tuft == each].mean(0) for each in np.unique(tuft) if (tuft == each).sum() > 4])
        return 1 - np.linalg.norm(means, axis=1).mean()
    assert spread(curled) < .1 and spread(own) > .4


def test_both_sides_of_a_sheet_are_not_in_one_tuft(gpu):
    """An ear: what grows on its back does not gather with what grows on its front."""
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    mesh = clfur.Mesh(np.concatenate([square, square - (0, 0, .01)]), faces=[
        (0, 1, 2), (0, 2, 3), (6, 5, 4), (7, 6, 4)])
    kind = clfur.HairType(tufts=clfur.Tufts(40, strength=1), **{**HAIR, "stiffness": 100, "length": .2})
    fur = clfur.Strands(types=kind, roots=2000, surface="flat", force=(0, 0, 0))
    points = points_of(gpu, clfur.Scene(mesh, fur))
    front = points[:, 0, 2] > -.005
    assert .4 < front.mean() < .6 and (points[front, 1:, 2] > 0).all() and (points[~front, 1:, 2] < -.01).all()


# --- what must not matter -------------------------------------------------------------------------------


def test_parts_do_not_matter(gpu, another):
    scene, whole = furred(ball(3), roots=30_000, **WILD), clfur.Settings(grid=16, shadow_map=64)
    small = another(6_000_000)
    hashes = [clfur.draw(scene, device, whole, hashes=True).hashes for device in (gpu, small)]
    assert hashes[0] == hashes[1] and small.peak <= 6_000_000


def test_teams_do_not_matter(gpu, another):
    scene = furred(roots=3000, **WILD)
    hashes = [clfur.draw(scene, devices, clfur.Settings(grid=16, shadow_map=64), hashes=True).hashes
              for devices in (gpu, [gpu, another()])]
    assert hashes[0] == hashes[1]


def test_types_keep_their_own_tufts(gpu):
    """One gathers, one is frizzy, one does neither: its bits are those without the others'."""
    keys = (0, 0, 0), (255, 0, 0), (0, 255, 0)
    picture = np.array([keys], np.uint8)
    more = {"tufts": clfur.Tufts(60)}, {"frizz": (.02, 5)}, {}

    def of(extras):
        kinds = [clfur.HairType(key=key, **{**HAIR, **extra}) for key, extra in zip(keys, extras)]
        return clfur.grow(clfur.Scene(ball(), clfur.Strands(types=kinds, type_map=picture, roots=900)), gpu)
    one, other = of(more), of([{}] * 3)
    moved = (one.points != other.points).reshape(900, -1).any(1)
    assert moved[one.type_of == 0].mean() > .9 and moved[one.type_of == 1].all() and not moved[one.type_of == 2].any()


def test_a_mesh_that_turns_takes_its_tufts_along(gpu):
    mesh = ball()
    turned = clfur.Mesh(mesh.positions[:, [1, 2, 0]], mesh.normals[:, [1, 2, 0]], mesh.uv, mesh.faces)
    one, other = (points_of(gpu, attrs.evolve(scene, fur=attrs.evolve(scene.fur, force=(0, 0, 0))))
                  for scene in (furred(mesh, **WILD), furred(turned, **WILD)))
    apart = np.abs(one[..., [1, 2, 0]] - other).max((1, 2))
    assert (apart > 1e-4).sum() <= 4


def test_tufts_stay_together_in_every_pose(gpu):
    """Assigned in rest: strands of a mesh that is stretched are of the tufts that they are of in rest."""
    rest = ball(2)
    posed = clfur.Mesh(rest.positions * (1, 2.5, .6), uv=rest.uv, faces=rest.faces)
    scene = furred(posed, roots=2000, **WILD)
    scene = attrs.evolve(scene, fur=attrs.evolve(scene.strands, rest=rest))
    np.testing.assert_allclose(points_of(gpu, scene), twin_points(scene), rtol=0, atol=12 * PLACE)
    # So that this can fail: in the pose alone some are of other tufts.
    level = WILD["tufts"]
    made, other = (middles_of(fur, posed, 0, level) for fur in (
        scene.strands, attrs.evolve(scene.strands, rest=None)))
    place = strands_twin.unit_or(np.random.default_rng(1).normal(size=(500, 3)), 0)
    normal = strands_twin.unit_or(place / (1, 2.5, .6), 0)
    at_rest, in_pose = twin.find(made, place, place), twin.find(other, place * (1, 2.5, .6), normal)
    assert (np.linalg.norm(made.places[at_rest] - place, axis=1) < .4).all() and (at_rest != in_pose).mean() > .2


def test_read_back_and_brought_they_give_the_same_picture(gpu):
    scene = furred(**WILD)
    np.testing.assert_array_equal(clfur.render(scene, gpu), clfur.render(attrs.evolve(
        scene, fur=clfur.grow(scene, gpu)), gpu))


def test_what_is_asked_for_wrongly():
    for make, words in (
            (lambda: clfur.Tufts(), "Tufts.count is None and Tufts.density is None; allowed: one of them"),
            (lambda: clfur.Tufts(3, density=1), "Tufts.count is 3 and Tufts.density is 1"),
            (lambda: clfur.Tufts(0), "Tufts.count is 0; allowed: a whole number from 1"),
            (lambda: clfur.Tufts(3, strength=2), "Tufts.strength is 2"),
            (lambda: clfur.Tufts(3, within=4), "Tufts.within is 4; allowed: None or Tufts"),
            (lambda: clfur.Tufts(3, within=clfur.Tufts(2, within=clfur.Tufts(1))), "without any within"),
            (lambda: clfur.HairType(tufts=3), "HairType.tufts is 3; allowed: an object of class Tufts or None"),
            (lambda: clfur.HairType(frizz=(1, -1)), "HairType.frizz is .*; allowed: two finite numbers, the first "),
            (lambda: clfur.render(furred(tufts=clfur.Tufts(density=1e9))), "Tufts.density is 1000000000.0, on an ")):
        with pytest.raises(clfur.Error, match=words):
            make()
