"""strands against its twin and against what holds for every head of hair."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import HairType, PointForce, Strands, layout
from clfur.layout import CONSTANTS
from clfur.stages import strands
from clfur.stages.tessellate import Surface, as_float4, tessellate
from clfur.twin import strands as twin

# Errors against float64 on a mesh of radius 1.3, in float32 steps of 2^-23 = 1.2e-7; in brackets the largest
# measured on four drivers.  A position is rounded by half a step up to 20 times [7.9e-7].  A tangent is
# judged on the device's own points, so only its own square root and division are rounded [1.4e-7].  A root
# By the law it is so up to 64 times, as are directions [2.5e-6].  A root
# and its uv are sums of three products [2.0e-7], a colour is one of four, times two factors [2.3e-7].
POSITION, LAW, UNIT, ROOT, COLOR = 20 * 2.0**-24, 64 * 2.0**-24, 1.6e-7, 2.5e-7, 3e-7


def lumpy():
    """A closed mesh without symmetry, 320 faces with uv: a dented sphere."""
    positions, faces = icosphere(2)
    x, y, z = positions.T
    radius = 1 + 0.3 * np.sin(5 * x + 1) * np.cos(4 * y - 3 * z)
    return clfur.Mesh(positions * radius[:, None], uv=positions[faces][:, :, :2] * 1.7, faces=faces)


def surface_of(gpu, positions, normals, uv, triangles):
    """A `Surface` from arrays [V, 3], [V, 3], [V, 2], [T, 3]."""
    rows = [gpu.upload(as_float4(np.array(a, np.float32))) for a in (positions, normals, uv)]
    return Surface(*rows, triangles=gpu.upload(as_float4(np.array(triangles, np.uint32))),
                   area_scale=np.float32(2.0**15))


def tufts(gpu, normals, uv=None, roots=None):
    """A `Surface` of a triangle around each root (the origin), with one normal [N, 3] and uv [N, 2] each."""
    normals = np.asarray(normals, float)
    n = len(normals)
    uv, roots = (np.zeros((n, k)) if a is None else np.asarray(a, float) for a, k in ((uv, 2), (roots, 3)))
    corners = np.array([(-1, 0, -1), (1, 0, -1), (0, 0, 2)]) / 8            # their sum is exactly zero
    positions = roots.repeat(3, 0) + np.tile(corners, (n, 1))
    return surface_of(gpu, positions, normals.repeat(3, 0), uv.repeat(3, 0), np.arange(3 * n).reshape(-1, 3))


def random_units(n, seed):
    return twin.unit_or(np.random.default_rng(seed).normal(size=(n, 3)), 0)


UP = [(0, 1, 0)]


def grow(gpu, surface, fur, traits=None):
    """The device's strands on the host: points [N, S, 3], NaN after each strand's last point."""
    grown = strands.grow(gpu, surface, fur, traits_of=traits_of(gpu, traits))
    first, counts = grown.spans.get().astype(int).T
    stride = max(t.segments for t in fur.types) + 1
    points = grown.points.get().reshape(-1, stride, 4)
    unused = np.arange(stride) >= counts[:, None]
    np.testing.assert_array_equal(first, np.arange(len(counts)) * stride)
    for each in grown.strand_of, grown.numbers:
        np.testing.assert_array_equal(each.get(), np.arange(len(counts)))
    np.testing.assert_array_equal(grown.stored.get(), first)
    assert grown.run == stride and not grown.shifts.get().any()
    points[unused] = math.nan
    points, uv = points.astype(float), grown.uv.get()
    return SimpleNamespace(points=points[..., :3], width=points[..., 3], counts=counts,
                           colors=grown.colors.get()[:, :3].astype(float), uv=uv[:, :2].astype(float),
                           kind=uv[:, 2].astype(int))


def traits_of(gpu, traits):
    return None if traits is None else lambda roots: gpu.upload(traits[:len(roots)])


def one_strand(gpu, normal=(0, 1, 0), count=1, force=(0, 0, 0), point_forces=(), seed=0, **hair):
    """The only strand (or all of `count`) from the origin."""
    result = grow(gpu, tufts(gpu, [normal] * count),
                  Strands(types=HairType(**hair), force=force, point_forces=point_forces, seed=seed))
    return result.points if count > 1 else result.points[0]


def on_host(surface):
    """Positions, normals, uv and triangles of a `Surface` as the twin takes them."""
    return (surface.positions.get()[:, :3].astype(float), surface.normals.get()[:, :3].astype(float),
            surface.uv.get()[:, :2].astype(float), surface.triangles.get()[:, :3].astype(int))


def running_areas(gpu, surface):
    """The device's own running sums of areas, uint64 [T]."""
    n = len(surface.triangles)
    blocks = -(-n // CONSTANTS["SCAN"])
    sums, areas = gpu.empty(blocks, np.uint64), gpu.empty(n, np.uint64)
    mesh = {"positions": surface.positions, "triangles": surface.triangles, "n": n,
            "area_scale": surface.area_scale, "sums": sums}
    gpu.launch("strands.sum_areas", blocks, **mesh)
    gpu.launch("strands.scan_sums", 1, n=blocks, sums=sums, total=gpu.empty(1, np.uint64))
    gpu.launch("strands.scan_areas", blocks, areas=areas, **mesh)
    return areas.get()


def twin_of(gpu, surface, fur, kind_uv, traits=None):
    """What the twin grows from the device's surface, sums of areas and root uv (which choose the type)."""
    host = on_host(surface)
    if fur.roots == "faces":
        root, frame, uv = twin.roots_on_faces(*host)
    else:
        root, frame, uv, _ = twin.roots_by_area(
            *host, running_areas(gpu, surface), fur.roots, fur.seed)
    points, _, counts, colors, kind = twin.grow(
        root, frame, kind_uv, fur.types, fur.type_indices, fur.force, fur.point_forces, fur.seed, traits)
    return SimpleNamespace(root=root, uv=uv, points=points, counts=counts, colors=colors, kind=kind)


def random_types(rows, columns, seed=8):
    """Types of all kinds, bald ones among them, and a map of them [rows, columns]."""
    rng = np.random.default_rng(seed)
    types = [HairType(segments=3 * i, segment_length=0.01 * i, width=0.001 * i, curl=(0.01 * i, i - 3),
                      force_weight=0.1 * i, length_variation=0.1 * i, color=rng.random(3), key=(i, 7, 9),
                      color_texture=rng.random((3 + i, 6 - i, 3)).astype(np.float32) if i % 2 else None)
             for i in range(6)]
    picture = np.full((rows, columns, 3), (0, 7, 9), np.uint8)
    picture[..., 0] = rng.integers(0, 6, (rows, columns))
    return {"types": types, "type_map": picture}


CURLY = {"segments": 20, "force_weight": 0.1, "curl": (0.03, 3), "wave": (0.05, -1.5)}
VARIED = {"length_variation": 0.5, "direction_variation": 0.5, "color_variation": 1}
FURS = {
    "straight": {"types": HairType(force_weight=0)},
    "report": {"types": HairType(segments=10, segment_length=0.05), "force": (0.3, -1, 0.2)},
    "point forces": {
        "types": HairType(segments=20, force_weight=0.4), "force": (0, 0, 0),
        "point_forces": [PointForce((2, 0, 0)), PointForce((0, 1, 3), -0.5), PointForce((0, -1, 0), 0.7),
                         PointForce((90, 0, 0), -5)]},
    "law": {"types": HairType(segments=9, length=.5, stiffness=.3), "force": (0.3, -1, 0.2)},
    "soft by law": {"types": HairType(segments=3, length=.5, stiffness=1e-6, curl=(.03, 2)),
                    "force": (0, -2, 0)},
    "stiff by law": {"types": HairType(segments=40, length=.5, stiffness=1e6, wave=(.03, 2),
                                       direction_variation=.5)},
    "point forces by law": {
        "types": HairType(segments=20, length=.5, stiffness=.2, curl=(.02, 3), direction_variation=.5),
        "point_forces": [PointForce((2, 0, 0)), PointForce((0, 1, 3), -0.5), PointForce((90, 0, 0), -5)]},
    "two rules": {"types": [HairType(key=(0, 0, 0), segments=20, force_weight=.1, curl=(.03, 3)),
                            HairType(key=(255, 0, 0), segments=7, length=.5, stiffness=.4, curl=(.03, 3),
                                     wave=(.02, 1)),
                            HairType(key=(0, 255, 0), segments=0, length=.5)],
                  "type_map": np.array([[(0, 0, 0), (255, 0, 0)], [(0, 255, 0), (255, 0, 0)]], np.uint8),
                  "roots": 5001},
    "curl": {"types": HairType(segments=20, curl=(0.03, 3), force_weight=0.1)},
    "wave": {"types": HairType(segments=20, wave=(0.05, 2), force_weight=0.1)},
    "all": {"types": HairType(**CURLY, **VARIED), "seed": 2**32 - 1},
    "one by area": {"types": HairType(**CURLY, **VARIED), "roots": 1, "seed": 5},
    "many by area": {"types": HairType(**CURLY, **VARIED), "roots": 50_001, "seed": 6},
    "types": {**random_types(7, 5), "roots": 20_011},
}


@pytest.mark.parametrize("name", FURS)
def test_everything_equals_the_twin(gpu, name):
    fur = Strands(inner=3, outer=2, **FURS[name])
    surface = tessellate(gpu, lumpy(), fur.inner, fur.outer, fur.surface)
    device = grow(gpu, surface, fur)
    host = twin_of(gpu, surface, fur, device.uv)
    np.testing.assert_array_equal(device.kind, host.kind)
    np.testing.assert_array_equal(device.counts, host.counts)
    np.testing.assert_allclose(device.uv, host.uv, rtol=0, atol=ROOT)
    np.testing.assert_allclose(device.colors, host.colors, rtol=0, atol=COLOR)
    tolerance = LAW if any(kind.stiffness for kind in fur.types) else POSITION
    np.testing.assert_allclose(device.points, host.points, rtol=0, atol=tolerance)
    hairy = device.counts > 0
    np.testing.assert_allclose(device.points[hairy, 0], host.root[hairy], rtol=0, atol=ROOT)
    widths = np.array([t.width for t in fur.types], np.float32)[device.kind, None]
    np.testing.assert_array_equal(device.width, np.where(np.isnan(device.width), math.nan, widths))


def random_traits(n, seed=9):
    """Factors of all sizes, 0 among them, and combs along and across the skin."""
    rng = np.random.default_rng(seed)
    traits = np.zeros(n, layout.Traits)
    traits["scale"] = rng.random((n, 4)) * (2, 2, 3, 2) * (rng.random((n, 4)) > .1)
    traits["comb"] = np.column_stack([random_units(n, seed) * rng.random((n, 1)), rng.random(n)])
    return traits


@pytest.mark.small
@pytest.mark.parametrize("hair", [{}, {**CURLY, **VARIED}, {"tip_width": .1, "force_weight": 2**-12},
                                  {"length": .3, "stiffness": .5, "curl": (.03, 2)}])
def test_traits_equal_the_twins(gpu, hair):
    """Length, width, stiffness, curl and wave of each strand, and where it is combed."""
    fur = Strands(types=HairType(**hair), point_forces=PointForce((0, 2, 0), -.3))
    surface, traits = tufts(gpu, random_units(20, 3)), random_traits(20)
    device = grow(gpu, surface, fur, traits)
    host = twin_of(gpu, surface, fur, device.uv, traits)
    np.testing.assert_allclose(device.points, host.points, rtol=0, atol=POSITION)
    np.testing.assert_array_equal(device.counts == 0, traits["scale"][:, 0] == 0)   # without a length it does not stand
    widths = np.where(device.counts[:, None] > 0, traits["scale"][:, 1:2] * twin.widths_along(fur.types[0]), math.nan)
    np.testing.assert_allclose(device.width, widths, rtol=0, atol=4e-7 * fur.types[0].widest)   # times up to 2
    plain, traits["scale"], traits["comb"] = grow(gpu, surface, fur), 1, 0
    for name in "points", "width":
        np.testing.assert_array_equal(getattr(plain, name), getattr(grow(gpu, surface, fur, traits), name))


@pytest.mark.small
def test_a_comb_lays_hair_along_the_skin(gpu):
    traits = np.zeros(3, layout.Traits)
    traits["scale"], traits["comb"] = 1, [(1, 0, 0, 1), (0, 0, 1, .5), (1, 0, 0, 0)]
    fur = Strands(types=HairType(segments=1, segment_length=2), force=(0, 0, 0))
    points = grow(gpu, tufts(gpu, UP * 3), fur, traits).points
    np.testing.assert_allclose(points[:, 1], [(2, 0, 0), (0, 2**.5, 2**.5), (0, 2, 0)], rtol=0, atol=3e-7)


def test_rounding_grows_slowly_over_the_longest_strands(gpu):
    """255 steps, each of which may add half a float32 step: 1.5e-5 at worst, 2.3e-6 measured."""
    fur = Strands(types=HairType(segments=255, segment_length=0.004, force_weight=0.01, curl=(0.05, 20)))
    surface = tessellate(gpu, lumpy(), 1, 1)
    device = grow(gpu, surface, fur)
    np.testing.assert_allclose(device.points, twin_of(gpu, surface, fur, device.uv).points, rtol=0, atol=4e-6)


# --- roots ----------------------------------------------------------------------------------------------


def scattered_triangles(n=700, seed=11):
    """Triangles of areas over four orders of magnitude, every tenth without any; uv tells the triangle."""
    rng = np.random.default_rng(seed)
    size = 10 ** rng.uniform(-2, 0, (n, 1, 1))
    corners = rng.uniform(-1, 1, (n, 1, 3)) + size * rng.normal(size=(n, 3, 3)) / 3
    corners[::10, 2] = corners[::10, 1]
    uv = np.repeat(np.stack([np.arange(n), np.zeros(n)], 1), 3, axis=0)
    normals = np.repeat(random_units(n, seed), 3, axis=0)
    return corners.reshape(-1, 3).astype(np.float32), normals, uv, np.arange(3 * n).reshape(-1, 3)


def test_one_strand_for_every_triangle(gpu, sphere):
    surface = tessellate(gpu, sphere, 5, 5)
    hair = grow(gpu, surface, Strands(types=HairType(segments=1)))
    assert len(hair.counts) == 37 * len(sphere.faces) == 11840
    positions, _, _, triangles = on_host(surface)
    np.testing.assert_allclose(hair.points[:, 0], positions[triangles].mean(1), rtol=0, atol=ROOT)


@pytest.mark.small
def test_running_sums_of_areas(gpu):
    """A mesh of three blocks of the scan and a bit; areas are whole numbers, cut off below one."""
    for n in (1, CONSTANTS["SCAN"], 3 * CONSTANTS["SCAN"] + 1):
        corners, normals, uv, triangles = scattered_triangles(n)
        surface = surface_of(gpu, corners, normals, uv, triangles)
        areas = np.diff(running_areas(gpu, surface).astype(np.int64), prepend=0)
        expected = np.linalg.norm(twin.twice_areas(corners, triangles), axis=1) * float(surface.area_scale) ** 2
        # Thin triangles cancel in the cross product: 2^-24 of their longest sides' square is lost.
        sides = (corners[triangles] - corners[np.roll(triangles, 1, axis=1)]).astype(float)
        lost = 4e-7 * (sides**2).sum((1, 2)) * float(surface.area_scale) ** 2 + 1
        assert (np.abs(areas - expected) <= lost).all()
        assert (areas[::10] == 0).all()


@pytest.mark.parametrize("count", [1, 999, 50_001])
def test_roots_by_area_are_uniform_in_strata(gpu, count):
    """Of `count` strands, the triangles 0..t have their share of the area to within one strand."""
    corners, normals, uv, triangles = scattered_triangles()
    hair = grow(gpu, surface_of(gpu, corners, normals, uv, triangles),
                Strands(types=HairType(segments=1), roots=count, seed=3))
    assert len(hair.counts) == count
    chosen = np.rint(hair.uv[:, 0]).astype(int)
    cross = twin.twice_areas(corners, triangles)
    area = np.linalg.norm(cross, axis=1)
    share = np.cumsum(area) / area.sum()
    so_far = np.searchsorted(np.sort(chosen), np.arange(len(area)), side="right")
    assert np.abs(so_far - count * share).max() <= 1 + 1e-6 * count
    assert (area[chosen] > 0).all()
    # Each root lies in its triangle: in its plane, and no corner's weight is negative.
    root, normal = hair.points[:, 0], cross[chosen] / area[chosen, None]
    corner = corners[triangles[chosen]].astype(float)
    np.testing.assert_allclose(((root - corner[:, 0]) * normal).sum(1), 0, rtol=0, atol=ROOT)
    for i in range(3):
        a, b = corner[:, i - 2], corner[:, i - 1]
        weight = (np.cross(a - root, b - root) * normal).sum(1)
        assert (weight > -1e-6 * np.linalg.norm(a - b, axis=1)).all()


def test_roots_by_area_go_by_the_seed(gpu):
    surface = surface_of(gpu, *scattered_triangles())
    first, again, other = (
        grow(gpu, surface, Strands(types=HairType(segments=1), roots=2_001, seed=seed)).points[:, 0]
        for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any(1).all()


@pytest.mark.small
def test_as_many_roots_as_equal_triangles_is_one_in_each(gpu):
    """The finest case of whole-numbered areas: each is 1, and those between without area get no strand."""
    corners = [(x, y, 0) for i in range(600) for x, y in ((0, i), (i % 2, i), (0, i + 1))]
    normals, uv = np.tile(UP, (1800, 1)), np.repeat(np.arange(600), 3)[:, None] * (1, 0)
    surface = surface_of(gpu, corners, normals, uv, np.arange(1800).reshape(-1, 3))
    surface = replace(surface, area_scale=np.float32(1))
    np.testing.assert_array_equal(running_areas(gpu, surface), np.arange(1, 601) // 2)
    chosen = grow(gpu, surface, Strands(types=HairType(segments=1), roots=300)).uv[:, 0]
    np.testing.assert_array_equal(np.rint(chosen), np.arange(1, 600, 2))


@pytest.mark.parametrize("seed", [0, 1, 2**32 - 1])
def test_roots_are_uniform_in_a_triangle(gpu, seed):
    """Chi-square over 64 equal parts of one triangle: 63 degrees of freedom, so 120 is 5 deviations away."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    surface = surface_of(gpu, corners, UP * 3, np.array(corners)[:, :2], [(0, 1, 2)])
    hair = grow(gpu, surface, Strands(types=HairType(segments=1), roots=50_001, seed=seed))
    a, b = hair.points[:, 0, 0], hair.points[:, 0, 1]
    np.testing.assert_allclose(hair.uv, hair.points[:, 0, :2], rtol=0, atol=1e-7)
    assert min(a.min(), b.min()) >= 0 and (a + b).max() <= 1 + 1e-7
    upper = (8 * a) % 1 + (8 * b) % 1 > 1                       # of the two triangles in a square
    found = np.unique(np.stack([8 * a // 1, 8 * b // 1, upper], 1), axis=0, return_counts=True)[1]
    assert len(found) == 64
    assert 20 < ((found - 50_001 / 64) ** 2).sum() / (50_001 / 64) < 120


def test_a_single_root_is_uniform_over_seeds(gpu):
    """Triangles of areas 1:2:3:4; chi-square with 3 degrees of freedom exceeds 16.3 once in a thousand."""
    corners = [(x, y, 0) for i in range(4) for x, y in ((2 * i, 0), (2 * i + 1, 0), (2 * i, i + 1))]
    surface = surface_of(gpu, corners, UP * 12, np.zeros((12, 2)), np.arange(12).reshape(4, 3))
    fur = [Strands(types=HairType(segments=1), roots=1, seed=seed) for seed in range(300)]
    x = [strands.grow(gpu, surface, each).points.get()[0, 0] for each in fur]
    found, expected = np.bincount(np.array(x, int) // 2, minlength=4), 300 * np.arange(1, 5) / 10
    assert ((found - expected) ** 2 / expected).sum() < 16.3


def test_a_strand_is_the_same_in_any_company(gpu):
    """The same bits in two runs and for the same strand among fewer: random numbers go by strand alone."""
    n = 301
    normals, roots, uv = random_units(n, 1), random_units(n, 2), random_units(n, 3)[:, :2]
    fur = Strands(**random_types(4, 4), force=(1, 2, 3), seed=77)
    hair, again = (grow(gpu, tufts(gpu, normals, uv, roots), fur) for _ in range(2))
    fewer = grow(gpu, tufts(gpu, normals[:100], uv[:100], roots[:100]), fur)
    for name in ("points", "colors", "kind"):
        np.testing.assert_array_equal(getattr(hair, name), getattr(again, name))
        np.testing.assert_array_equal(getattr(hair, name)[:100], getattr(fewer, name))


@pytest.mark.parametrize("scale", [1e-8, 1e-6, 1e6, 1e9])
def test_small_and_large_worlds(gpu, scale):
    """A scaled mesh has its strands at the scaled places."""
    base = lumpy()
    hair, scaled = (
        grow(gpu, tessellate(gpu, clfur.Mesh(base.positions * s, base.normals, base.uv, base.faces), 2, 2),
             Strands(types=HairType(segment_length=0.02 * s, curl=(0.01 * s, 2)), roots=501))
        for s in (1.0, scale))
    # Integer areas differ in their last places, so a root may move a little along the order of triangles.
    near = np.abs(scaled.points / scale - hair.points).max((1, 2)) < 1e-5
    assert near.mean() > 0.99


# --- growth ---------------------------------------------------------------------------------------------


@pytest.mark.small
def test_the_reports_loop_by_hand(gpu):
    """Up, then a unit force to the right: 45 degrees, then half: two unit vectors add on their bisector."""
    points = one_strand(gpu, segments=3, segment_length=1, force_weight=1, force=(1, 0, 0))
    diagonal, flat = (np.array([math.cos(a), math.sin(a), 0]) for a in (math.pi / 4, math.pi / 8))
    up = np.array([0, 1, 0])
    np.testing.assert_allclose(points, [0 * up, up, up + diagonal, up + diagonal + flat], rtol=0, atol=2e-7)


def test_half_the_weight_is_half_the_force(gpu):
    points = [one_strand(gpu, segments=6, force_weight=weight, force=force)
              for weight, force in ((0.5, (2, 1, 0)), (1, (1, 0.5, 0)))]
    np.testing.assert_array_equal(*points)
    assert np.ptp(points[0][:, 0]) > 0.01


@pytest.mark.parametrize("forces", [{"force": (3, -2, 1)},
                                    {"force": (0, 0, 0), "point_forces": PointForce((1, 1, 0), 3)}])
def test_segments_keep_their_length(gpu, forces):
    """Without curl and wave; the segment is 0.4 long, so that rounding its ends (below 4) is 6e-7 of it."""
    normals = random_units(200, 4)
    hair = grow(gpu, tufts(gpu, normals), Strands(types=HairType(segments=9, segment_length=0.4), **forces))
    lengths = np.linalg.norm(np.diff(hair.points, axis=1), axis=2)
    np.testing.assert_allclose(lengths, 0.4, rtol=1e-6)
    assert np.ptp(np.diff(hair.points, axis=1), axis=1).max() > 0.04             # they do bend


def test_without_force_strands_are_straight_along_the_normal(gpu):
    normals = random_units(200, 5)
    for hair_type, force in (HairType(segments=5, segment_length=0.3, force_weight=0), (9, 9, 9)), (
            HairType(segments=5, segment_length=0.3), (0, 0, 0)):
        hair = grow(gpu, tufts(gpu, normals), Strands(types=hair_type, force=force))
        expected = 0.3 * np.arange(6)[:, None] * normals[:, None]
        np.testing.assert_allclose(hair.points, expected, rtol=0, atol=3e-7)


@pytest.mark.small
def test_bald_and_without_length(gpu):
    assert grow(gpu, tufts(gpu, UP), Strands(types=HairType(segments=0))).counts.tolist() == [0]
    normals = random_units(50, 6)
    hair = grow(gpu, tufts(gpu, normals),
                Strands(types=HairType(segments=4, segment_length=0), force=(0, 0, 0)))
    assert (hair.points == hair.points[:, :1]).all()


@pytest.mark.small
def test_no_roots(gpu, sphere):
    surface = tessellate(gpu, sphere, 1, 1)
    assert len(grow(gpu, surface, Strands(roots=0)).counts) == 0


@pytest.mark.small
def test_a_force_that_cancels_the_direction_leaves_it(gpu):
    points = one_strand(gpu, segments=5, segment_length=0.5, force_weight=1, force=(0, -1, 0))
    np.testing.assert_array_equal(points, [(0, 0.5 * k, 0) for k in range(6)])


@pytest.mark.small
def test_point_force_pushes_by_exp_of_the_distance(gpu):
    """From (1, 1, 0) at the first point (0, 1, 0): e^-1 to the left, and attraction the same to the right."""
    for strength in (1, -2):
        points = one_strand(gpu, segments=2, segment_length=1, force_weight=1,
                            point_forces=PointForce((1, 1, 0), strength))
        turned = twin.unit_or(np.array([-strength * math.exp(-1), 1, 0]), 0)
        np.testing.assert_allclose(points[2] - points[1], turned, rtol=0, atol=1.5e-7)


@pytest.mark.small
def test_point_force_at_the_strands_own_point_is_none(gpu):
    """And takes nothing from the other forces: up, then turned to the right by 45 degrees."""
    half = math.sqrt(1 / 8)
    for force, second in ((0, 0, 0), (0, 1, 0)), ((1, 0, 0), (half, 0.5 + half, 0)):
        points = one_strand(gpu, segments=2, segment_length=0.5, force_weight=1, force=force,
                            point_forces=PointForce((0, 0.5, 0), 4))
        np.testing.assert_allclose(points, [(0, 0, 0), (0, 0.5, 0), second], rtol=0, atol=1.5e-7)


# --- curl and wave --------------------------------------------------------------------------------------


@pytest.mark.parametrize("turns", [3, 2.5, -1])
def test_a_curl_is_a_helix_that_starts_on_the_skin(gpu, turns):
    """Each strand's axis is a radius away from its root, to a side of its own; it turns about the normal."""
    radius, segments, length = 0.5, 48, 0.02
    points = one_strand(gpu, count=20, segments=segments, segment_length=length, curl=(radius, turns))
    assert (points[:, 0] == 0).all()
    height = np.tile(length * np.arange(segments + 1), (20, 1))
    np.testing.assert_allclose(points[:, :, 1], height, rtol=0, atol=1e-6)
    across = points[:, :, [2, 0]]                     # z then x: counter-clockwise about y
    third = round(segments / abs(turns) / 3)
    two = across[:, [third, 2 * third]]               # a circle through the origin and two points of a turn
    centre = np.linalg.solve(two, (two**2).sum(2)[..., None] / 2)[..., 0]
    np.testing.assert_allclose(np.linalg.norm(centre, axis=1), radius, rtol=0, atol=1e-6)
    spoke = (across - centre[:, None]) @ (1, 1j)
    np.testing.assert_allclose(np.abs(spoke), radius, rtol=0, atol=1.5e-6)
    angles = np.angle(spoke[:, 1:] / spoke[:, :-1])
    np.testing.assert_allclose(angles, 2 * np.pi * turns / segments, rtol=0, atol=1e-6)
    assert np.ptp(np.angle(spoke[:, 0])) > 3          # the centres lie all around the roots


def test_a_curl_keeps_its_distance_from_the_strand_without_it(gpu):
    """2 R sin(angle / 2) from the bent axis, square to it: the chord of the circle that touches the axis."""
    bent = {"segments": 40, "segment_length": 0.1, "force_weight": 0.1}
    forces = {"count": 20, "force": (1, -1, 0.5), "point_forces": PointForce((0, 2, 0), 2)}
    axis = one_strand(gpu, **bent, **forces)
    away = one_strand(gpu, **bent, **forces, curl=(0.3, 2)) - axis
    chord = 0.6 * np.abs(np.sin(np.pi * 2 * np.arange(41) / 40))
    np.testing.assert_allclose(np.linalg.norm(away, axis=2), np.tile(chord, (20, 1)), rtol=0, atol=1e-6)
    ahead = twin.unit_or(np.diff(axis, axis=1), 0)
    np.testing.assert_allclose((away[:, 1:] * ahead).sum(2), 0, rtol=0, atol=1e-6)
    assert np.ptp(ahead, axis=1).max() > 0.5


def test_a_wave_is_a_sine_in_a_plane(gpu):
    """On a straight strand; each strand has a plane of its own."""
    normal = random_units(1, 7)[0]
    points = one_strand(gpu, normal, count=20, segments=30, segment_length=0.1, wave=(0.4, 2.5))
    away = points - 0.1 * np.arange(31)[:, None] * normal
    side = twin.unit_or(away[:, 3], 0)                              # the crest: a quarter of a period
    sine = 0.4 * np.sin(2 * np.pi * 2.5 * np.arange(31) / 30)
    np.testing.assert_allclose(away, sine[:, None] * side[:, None], rtol=0, atol=1.5e-6)
    np.testing.assert_allclose(side @ normal, 0, rtol=0, atol=3e-7)
    assert np.linalg.svd(side)[1][1] > 1                            # not all in one plane


@pytest.mark.small
def test_curl_and_wave_add_up(gpu):
    plain, curl, wave, both = (
        one_strand(gpu, count=9, force=(1, 0, 0), segments=12, segment_length=0.1, force_weight=0.2, **extra)
        for extra in ({}, {"curl": (0.2, 1)}, {"wave": (0.1, 3)}, {"curl": (0.2, 1), "wave": (0.1, 3)}))
    np.testing.assert_allclose(both, curl + wave - plain, rtol=0, atol=2e-7)


# --- variations, colours and types ----------------------------------------------------------------------


def test_variations_stay_in_their_range_and_fill_it(gpu):
    """Uniform in 1 +- variation: a mean of 1, a deviation of variation / sqrt(3), and independent."""
    n = 4001
    normals = random_units(n, 9)
    hair_type = HairType(segments=1, segment_length=0.5, color=(0.5, 1, 2), **VARIED)
    fur = Strands(types=hair_type, force=(0, 0, 0), seed=12)
    hair = grow(gpu, tufts(gpu, normals), fur)
    length = np.linalg.norm(hair.points[:, 1], axis=1) / 0.5
    tint = hair.colors / (0.5, 1, 2)
    np.testing.assert_allclose(tint, tint[:, :1].repeat(3, 1), rtol=1e-6)       # brightness, not hue
    for factor, variation in (length, 0.5), (tint[:, 1], 1):
        assert 1 - variation - 1e-6 <= factor.min() < 1 - 0.99 * variation
        assert 1 + 0.99 * variation < factor.max() <= 1 + variation + 1e-6
        assert abs(factor.mean() - 1) < 4 * variation / math.sqrt(3 * n)
        assert abs(factor.std() - variation / math.sqrt(3)) < 4 * variation / math.sqrt(3 * n)
    for a, b in (length, tint[:, 1]), (length[1:], length[:-1]):
        assert abs(np.corrcoef(a, b)[0, 1]) < 4 / math.sqrt(n)
    # Directions lean to all sides alike: the vector added is in half the cube, half whose diagonal is 0.87.
    ahead = twin.unit_or(hair.points[:, 1], 0)
    assert 0.7 < np.linalg.norm(np.cross(ahead, normals), axis=1).max() < 0.5 * math.sqrt(3)
    assert np.abs((ahead - (ahead * normals).sum(1, keepdims=True) * normals).mean(0)).max() < 0.03

    other = grow(gpu, tufts(gpu, normals), Strands(types=hair_type, force=(0, 0, 0), seed=13))
    assert (other.points[:, 1] != hair.points[:, 1]).any(1).all()
    assert abs(np.corrcoef(np.linalg.norm(other.points[:, 1], axis=1), length)[0, 1]) < 4 / math.sqrt(n)


def test_without_variation_the_seed_changes_nothing(gpu):
    one, other = (one_strand(gpu, count=30, force=(1, 0, 0), seed=seed, segments=4) for seed in (0, 1))
    np.testing.assert_array_equal(one, other)
    assert (one == one[:1]).all()


def map_of_all(rows, columns):
    """A map where every texel is a type of its own, row by row; type k has k % 3 segments."""
    keys = [(k, 200, 10) for k in range(rows * columns)]
    types = [HairType(segments=k % 3, key=key) for k, key in enumerate(keys)]
    return {"types": types, "type_map": np.array(keys, np.uint8).reshape(rows, columns, 3)}


@pytest.mark.parametrize("rows, columns", [(1, 1), pytest.param(3, 5, marks=pytest.mark.small), (8, 16)])
def test_the_type_is_that_of_the_nearest_texel(gpu, rows, columns):
    """Inside texels to a thousandth from their borders; v runs up from the last row; the picture repeats."""
    inside = [(c + dx, r + dy, r * columns + c) for c in range(columns) for r in range(rows)
              for dx in (0.001, 0.5, 0.999) for dy in (0.001, 0.5, 0.999)]
    x, y, kind = np.array(inside).T
    uv = np.stack([x / columns, 1 - y / rows], 1)
    fur = Strands(**map_of_all(rows, columns))
    for repeat in (0, 0), (1, 0), (-1, 2), (0, -3):
        hair = grow(gpu, tufts(gpu, UP * len(uv), uv + repeat), fur)
        np.testing.assert_array_equal(hair.kind, kind)
        np.testing.assert_array_equal(hair.counts, np.array([0, 2, 3])[hair.kind % 3])


@pytest.mark.small
def test_texel_borders(gpu):
    """On a border the texel right of it and below it; the picture's own border is its left and lower edge."""
    x, y = (a.ravel() for a in np.meshgrid([0.0, 1, 2, 4, 8], [1.0, 2, 4]))
    uv = np.stack([x / 8, 1 - y / 4], 1)
    uv = np.concatenate([uv, [(0, 0), (1, 1), (0, 1), (-1e-9, 0.5), (0.5, -1e-9)]])
    fur = Strands(**map_of_all(4, 8))
    hair = grow(gpu, tufts(gpu, UP * len(uv), uv), fur)
    np.testing.assert_allclose(hair.uv, uv, rtol=0, atol=1e-15)      # not rounded: or this tests nothing
    row, column = np.divmod(hair.kind, 8)
    # v = 0 and v = 1 are both the lower edge, so in the last row; a hair's breadth below is the first again.
    np.testing.assert_array_equal(column, np.append(x % 8, [0, 0, 0, 7, 4]))
    np.testing.assert_array_equal(row, np.append(np.minimum(y, 3), [3, 3, 3, 2, 0]))


def test_random_uv_choose_the_twins_texel(gpu):
    uv = np.random.default_rng(3).uniform(-3, 3, (20_001, 2))
    fur = Strands(**map_of_all(13, 11))
    hair = grow(gpu, tufts(gpu, UP * len(uv), uv), fur)
    kind = twin.nearest(np.arange(13 * 11).reshape(13, 11), hair.uv, hair.uv, 0)
    # float32 may put a uv on the other side of a border no further away than 2^-24 of the picture.
    scaled = hair.uv * (11, 13)
    inner = (np.abs(scaled - np.rint(scaled)) > 2e-6).all(1)
    assert inner.mean() > 0.999
    np.testing.assert_array_equal(hair.kind[inner], kind[inner])


@pytest.mark.small
def test_colour_texture_is_bilinear_and_repeats(gpu):
    picture = np.random.default_rng(4).random((2, 4, 3)).astype(np.float32)
    fur = Strands(types=HairType(color=(1, 2, 0.5), color_texture=picture, segments=1))
    centres = [((c + 0.5) / 4, 1 - (r + 0.5) / 2) for r in range(2) for c in range(4)]
    between = [(0.25, 0.75), (0, 0.75), (0.125, 0.5), (0.125, 0), (1, 1)]
    colors = grow(gpu, tufts(gpu, UP * 13, centres + between), fur).colors / (1, 2, 0.5)
    np.testing.assert_allclose(colors[:8], picture.reshape(-1, 3), rtol=0, atol=COLOR)
    p = picture.astype(float)
    expected = [(p[0, 0] + p[0, 1]) / 2, (p[0, 3] + p[0, 0]) / 2, (p[0, 0] + p[1, 0]) / 2,
                (p[1, 0] + p[0, 0]) / 2, (p[0, 0] + p[0, 3] + p[1, 0] + p[1, 3]) / 4]
    np.testing.assert_allclose(colors[8:], expected, rtol=0, atol=COLOR)


# --- strands that the user brings -----------------------------------------------------------------------


def upload_curves(gpu, curves):
    """The device's points [P, 4], strand of each [P] and spans [strands, 2], as they came."""
    brought = strands.upload_curves(gpu, curves)
    rows, spans = np.arange(len(brought.points)), brought.spans.get()
    rows = brought.stored.get()[rows // brought.run] + rows % brought.run
    spans[:, 0] += brought.shifts.get()
    spans[brought.numbers.get()] = spans.copy()
    return brought.points.get()[rows], brought.numbers.get()[brought.strand_of.get()[rows // brought.run]], spans


def ragged(counts, seed):
    return np.random.default_rng(seed).normal(size=(sum(counts), 3)).astype(np.float32)


MANY = np.random.default_rng(1).integers(0, 6, 50_001).tolist()


@pytest.mark.parametrize("width", ["all", "strand", "point"])
@pytest.mark.parametrize("counts", [
    pytest.param([4], id="one"), pytest.param([1], id="point"), pytest.param([0], id="empty"),
    pytest.param([0, 1, 5, 2, 0, 3, 0], id="ragged", marks=pytest.mark.small),
    pytest.param([7] * 19, id="uniform"), pytest.param(MANY, id="many")])
def test_curves_are_kept(gpu, counts, width):
    points = ragged(counts, 2)
    sizes = {"all": (), "strand": (len(counts),), "point": (len(points),)}
    curves = clfur.Curves(points, counts, width=np.random.default_rng(3).random(sizes[width]))
    there, strand_of, spans = upload_curves(gpu, curves)
    _, expected_width, expected_strands = twin.unpack_curves(points, counts, curves.width)
    np.testing.assert_array_equal(there[:, :3], points)
    np.testing.assert_array_equal(there[:, 3], expected_width)
    np.testing.assert_array_equal(strand_of, expected_strands)
    np.testing.assert_array_equal(spans, np.stack([np.cumsum(counts) - counts, counts], 1))


def test_tangents_of_a_straight_line_a_corner_and_a_standstill():
    """The twin's; those of the device are held against it where they are used."""
    lines = [[(0, 0, 0), (2, 0, 0), (3, 0, 0)], [(0, 0, 0), (0, 0, 1), (0, 1, 1)],
             [(0, 0, 0), (0, 0, 3), (0, 0, 3), (0, 0, 3), (5, 0, 3)], [(1, 1, 1)] * 2,
             [(0, 0, 0), (0, 2, 0), (0, 0, 0)]]
    half, spans = math.sqrt(0.5), np.array([(0, 3)] * 2 + [(3, 3)] * 2 + [(6, 5)] * 4 + [(11, 2)] + [(13, 3)] * 2)
    k = np.array([0, 1, 3, 4, 6, 7, 8, 9, 11, 13, 14])
    starts, ends = twin.tangents_at(np.concatenate(lines), spans, k)
    x, y, z = np.eye(3)
    corner = (0, half, half)
    np.testing.assert_allclose(starts, [x, x, z, corner, z, z, y, x, y, y, -y], rtol=0, atol=1e-15)
    np.testing.assert_allclose(ends, [x, x, corner, y, z, y, x, x, y, y, -y], rtol=0, atol=1e-15)
    for line in lines[:2]:
        one, other = (np.array(each) for each in twin.tangents_at(line, [(0, 3)] * 2, np.arange(2)))
        np.testing.assert_allclose([*one, other[1]], twin.tangents_of(np.array([line], float), x)[0], atol=1e-15)


@pytest.mark.small
def test_uniform_curves_are_the_same_as_counted_ones(gpu):
    points = ragged([5] * 30, 4)
    uniform, counted = clfur.Curves(points.reshape(30, 5, 3)), clfur.Curves(points, [5] * 30)
    for a, b in zip(upload_curves(gpu, uniform), upload_curves(gpu, counted)):
        np.testing.assert_array_equal(a, b)


@pytest.mark.small
def test_no_curves(gpu):
    points, strand_of, spans = upload_curves(gpu, clfur.Curves(np.zeros((0, 4, 3))))
    assert len(points) == len(strand_of) == len(spans) == 0


def test_curves_in_another_order_are_the_same_bits(gpu):
    counts = np.array(MANY[:5001])
    order = np.random.default_rng(5).permutation(len(counts))
    points, width = ragged(counts, 6), np.random.default_rng(7).random(len(counts))
    ends = np.cumsum(counts)
    rows = np.concatenate([np.arange(ends[i] - counts[i], ends[i]) for i in order])
    there, *_ = upload_curves(gpu, clfur.Curves(points, counts, width))
    there_too, *_ = upload_curves(gpu, clfur.Curves(points[rows], counts[order], width[order]))
    np.testing.assert_array_equal(there[rows].view(np.uint32), there_too.view(np.uint32))
