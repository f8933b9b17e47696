"""voxelize against its twin, exactly, and what must hold for any hair: mass is kept, no counter can overflow."""

import numpy as np
import pytest
from support.plans import recorded
from support.stages import strands_on

import clfur
from clfur import layout
from clfur.pipeline.views import grid_of
from clfur.scene import hair_bounds
from clfur.stages.strands import arrays, grow, upload_curves
from clfur.stages.tessellate import tessellate
from clfur.stages.voxelize import METHODS, crossing_unit_for, depths_for, most_of, voxelize
from clfur.twin import voxelize as twin

WEIGHTS = np.array([65536, 777, 3, 0], np.uint32)       # of four types


def plain_grid(size=(16, 32, 48)):
    """A `layout.Grid` whose cells are the world's units, so that borders are whole numbers."""
    grid = np.zeros((), layout.Grid)
    grid["to_grid"] = np.eye(4)
    grid["light"][2] = -1
    grid["size"][:3] = size
    grid["face"][:3] = 1
    return grid


def scene_of(curves, **light):
    """The strands around a unit ball, so that the ball sets the grid."""
    p = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
    faces = np.array([(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)])
    return clfur.Scene(mesh=clfur.Mesh(p, faces=faces), fur=curves, light=clfur.Light(**light))


def before(grid, least):
    """A grid in whose first layer counts what lies before it, to this w."""
    grid["size"][3], grid["face"][3] = 1, least
    return grid


def turned_grid():
    return grid_of(scene_of(None, direction=(-1, -2, .5)), 32)


def spot_grid(inside=False):
    position = (.2, .1, -.3) if inside else (1, 2, 3)
    return grid_of(scene_of(None, direction=(-1, -2, -3), position=position, angle=50), 32)


def counted(gpu, grid, strands, method, weights=WEIGHTS):
    """Cells of (points, spans, kinds) on the device: [nz, ny, nx] uint32."""
    return voxelize(gpu, grid, strands_on(gpu, *strands), method, weights).get()


def random_strands(seed, low, high, step, n=150, points=6):
    """Random walks -> (points, spans, kinds); some leave the box, lengths and widths vary, some lie with others."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(2, points + 1, n)
    start = rng.uniform(low, high, (n, 1, 3))
    walk = np.cumsum(np.concatenate([start, rng.normal(0, step, (n, points - 1, 3))], 1), 1)
    walk = np.concatenate([walk, rng.uniform(0, .2 * step, (n, points, 1))], 2)
    return walk.reshape(-1, 4), np.stack([np.arange(n) * points, counts], 1), rng.integers(0, len(WEIGHTS), n)


def border_strands():
    """Every kind of segment between corners, edges and middles of cells of `plain_grid`, and a hair beside them."""
    at = np.array([-1, -.5, 0, 1 / 512, .5 - 1 / 512, .5, .5 + 1 / 256, 1, 15, 15.5, 16, 17])
    rng = np.random.default_rng(9)
    ends = rng.choice(at, (400, 2, 3))
    ends[:60, 1, 1:] = ends[:60, 0, 1:]               # along x
    ends[60:120, 1, [0, 2]] = ends[60:120, 0, [0, 2]]      # along y
    ends[120:180, 1, :2] = ends[120:180, 0, :2]       # along the light
    ends[180:240, 1, 1] = ends[180:240, 0, 1] + ends[180:240, 1, 0] - ends[180:240, 0, 0]      # |dx| = |dy|
    points = np.concatenate([ends, np.full((400, 2, 1), .3)], 2).reshape(-1, 4)
    return points, np.stack([2 * np.arange(400), np.full(400, 2)], 1), np.arange(400) % 3


def odd_strands():
    """No length, no segment, no points, far away, behind everything; the middle strand is an ordinary one."""
    points = [(3, 3, 3, .1), (3, 3, 3, .1), (4, 4, 4, .1), (0, 0, 0, 0), (1, 9.3, 2, .1), (9.7, 2, 8, .2),
              (9, 9, 9, .1), (1e5, 0, 0, .1), (2, 2, 2, .1), (1e30, -1e30, 1e30, .1), (5, 5, 5, .1),
              (32768, 5, 5, .1), (5, 5, 5, 3e38)]
    spans = [(0, 2), (2, 1), (3, 0), (4, 3), (6, 3), (8, 3), (10, 2), (11, 2)]
    return np.array(points), np.array(spans), np.zeros(len(spans), int)


CASES = {
    "random": (plain_grid, lambda: random_strands(1, (-3, -3, -3), (19, 35, 51), 4)),
    "turned": (turned_grid, lambda: random_strands(2, -1, 1, .1)),
    "spot": (spot_grid, lambda: random_strands(3, -1, 1, .1)),
    "spot inside": (lambda: spot_grid(True), lambda: random_strands(4, -1, 1, .2)),
    "short": (plain_grid, lambda: random_strands(5, 0, 16, .3)),
    "borders": (plain_grid, border_strands),
    "odd": (plain_grid, odd_strands),
    "before": (lambda: before(plain_grid(), 1), lambda: random_strands(13, (-3, -3, -60), (19, 35, 51), 9)),
    "far before": (lambda: before(plain_grid(), 1), lambda: random_strands(14, (0, 0, -900), (16, 32, 51), 300)),
    "odd before": (lambda: before(plain_grid(), 1), odd_strands),
    "spot before": (lambda: before(spot_grid(), .1), lambda: random_strands(15, -1, 3, .4)),
    "long": (plain_grid, lambda: random_strands(16, -60, 80, 150)),
    "long from a spot": (lambda: before(spot_grid(), .05), lambda: random_strands(17, -9, 9, 20)),
    "one": (plain_grid, lambda: tuple(each[k] for each, k in zip(odd_strands(), (slice(0, 7), [3], [3])))),
    "none": (plain_grid, lambda: (np.zeros((0, 4)), np.zeros((0, 2), int), np.zeros(0, int))),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", [
    pytest.param(case, marks=[pytest.mark.small] * (case in ("spot inside", "borders", "odd", "odd before", "none")))
    for case in CASES])
def test_cells_equal_the_twin(gpu, case, method):
    grid, strands = CASES[case][0](), CASES[case][1]()
    cells = counted(gpu, grid, strands, method)
    assert cells.shape == tuple(grid["size"][2::-1]) and cells.dtype == np.uint32
    assert cells.any() == (case != "none")
    np.testing.assert_array_equal(cells, twin.voxelize(grid, *strands, method, WEIGHTS))


@pytest.mark.parametrize("case", ["random", "spot inside", "odd before", "spot before", "long from a spot"])
@pytest.mark.parametrize("lanes", [1, 8, 16])
def test_cells_are_the_same_side_by_side(another, case, lanes):
    """As GPUs and CPUs take them: one strand a work-item, or all of a group by one of them, several at once."""
    grid, strands = CASES[case][0](), CASES[case][1]()
    for built in {"lanes": lanes}, {"lanes": lanes, "int64_atomics": False}:
        cells = counted(another(**built), grid, strands, "length")
        np.testing.assert_array_equal(cells, twin.voxelize(grid, *strands, "length", WEIGHTS))


@pytest.mark.small
@pytest.mark.parametrize("method", METHODS)
def test_cells_are_the_same_without_64_bit_atomics(another, method):
    grid, strands = plain_grid(), border_strands()
    cells = counted(another(int64_atomics=False), grid, strands, method)
    np.testing.assert_array_equal(cells, twin.voxelize(grid, *strands, method, WEIGHTS))


@pytest.mark.parametrize("held", [8, 96, 4096])
def test_cells_are_the_same_in_blocks_of_any_size(another, monkeypatch, held):
    """8 cells have room for no strand, 96 for short ones; some hair lies beside its block."""
    monkeypatch.setattr(layout, "HELD", held)
    points, spans, kinds = random_strands(18, 1, 15, .3, n=200)
    points[600:606, :3] += 9
    gpu = clfur.Scheduler(another().device)
    gpu.lanes = 8
    cells = counted(gpu, plain_grid(), (points, spans, kinds), "length")
    np.testing.assert_array_equal(cells, twin.voxelize(plain_grid(), points, spans, kinds, "length", WEIGHTS))


@pytest.mark.parametrize("method", METHODS)
def test_neither_order_nor_groups_nor_runs_change_a_count(gpu, method):
    grid, (points, spans, kinds) = plain_grid(), random_strands(6, 0, 16, 3, n=700)
    cells = counted(gpu, grid, (points, spans, kinds), method)
    order = np.random.default_rng(7).permutation(len(spans))
    np.testing.assert_array_equal(cells, counted(gpu, grid, (points, spans[order], kinds[order]), method))
    np.testing.assert_array_equal(cells, counted(gpu, grid, (points, spans, kinds), method))
    # Strand by strand, in batches and backwards (fragments have no direction, a length's rounding has).
    parts = [counted(gpu, grid, (points, spans[part], kinds[part]), method)
             for part in (slice(0, 1), slice(1, 50), slice(50, None))]
    together = np.max(parts, 0) if method == "binary" else np.sum(parts, 0, dtype=np.uint32)
    np.testing.assert_array_equal(cells, together)
    if method != "length":
        back = points.reshape(-1, 6, 4)[:, ::-1].reshape(-1, 4)
        back_spans = np.stack([spans[:, 0] + 6 - spans[:, 1], spans[:, 1]], 1)
        np.testing.assert_array_equal(cells, counted(gpu, grid, (back, back_spans, kinds), method))
    # Work-groups of any size.
    for group in (1, 7, 30):
        again, there = gpu.full(cells.shape, np.uint32, 0), strands_on(gpu, points, spans, kinds)
        kernel = gpu._kernels["voxelize.lengths" if method == "length" else "voxelize.fragments"]
        given = {"grid": grid, "stretch": (0, 2**32 - 1), "weights": gpu.upload(WEIGHTS), "cells": again,
                 **arrays(there, "points", "spans", "strand_uv")}
        given |= {"method": METHODS.index(method)} if method != "length" else {
            "rests": gpu.empty(0, np.float32), "n_strands": len(spans)}
        kernel.run(gpu.queue, (-(-len(spans) // group) * group,), (group,), 0, len(spans), *kernel.bind(given))
        np.testing.assert_array_equal(cells, again.get())


@pytest.mark.small
def test_what_lies_before_the_grid_counts_in_its_first_layer(gpu):
    points = [(5.5, 3.2, -7, .1), (5.5, 3.9, -6.5, .1), (5.5, 4.6, -9000, .1), (5.5, 5.3, 2.5, .1)]
    strands, weights = (points, [(0, 2), (2, 2)], [0, 0]), np.array([4096], np.uint32)
    for method in METHODS:
        assert counted(gpu, plain_grid(), ([points[0], points[1]], [(0, 2)], [0]), method, weights).sum() == 0
        cells = counted(gpu, before(plain_grid(), 1), strands, method, weights)
        assert cells[0].sum() > 0 and cells[:, :3].sum() == cells[:, 7:].sum() == 0


@pytest.mark.small
def test_of_a_long_strand_what_is_in_the_grid_counts(gpu):
    points, weights = [(-1e4, 3.5, 4.5, .1), (1e4, 3.5, 4.5, .1)], np.array([4096], np.uint32)
    cells = counted(gpu, plain_grid(), (points, [(0, 2)], [0]), "length", weights)
    within = cells[4, 3, 1:15]
    assert within.sum() == cells.sum() - cells[4, 3, [0, 15]].sum()
    assert within.sum() / 4096 == pytest.approx(14 * .1, rel=.01)
    np.testing.assert_allclose(within / 4096, .1, atol=.012)   # steps are 3/4 of a cell


# --- what must hold whatever the twin says -----------------------------------------------------------------


@pytest.mark.small
def test_count_puts_one_fragment_into_each_column_that_a_strand_passes(gpu):
    """Along the longer axis, cells whose middle lies in [start, end): the rule of the raster."""
    for points, expected in [
        ([(2.5, 3.2, 4.7), (9.5, 3.2, 4.7)], [(4, 3, x) for x in range(2, 9)]),
        ([(9.5, 3.2, 4.7), (2.5, 3.2, 4.7)], [(4, 3, x) for x in range(2, 9)]),
        ([(2.6, 3.2, 4.7), (9.4, 3.2, 4.7)], [(4, 3, x) for x in range(3, 9)]),
        ([(5.2, 0, 1), (5.2, 4, 5)], [(y + 1, y, 5) for y in range(4)]),
        ([(5.2, 5.2, 1), (5.2, 5.2, 9)], []),                    # along the light: no fragment
        ([(-9, 3, 2), (4, 3, 2)], [(2, 3, x) for x in range(4)]),
    ]:
        cells = counted(gpu, plain_grid(), (np.c_[points, [.1, .1]], [(0, 2)], [0]), "count", np.array([5], np.uint32))
        assert sorted(zip(*(axis.tolist() for axis in np.nonzero(cells)))) == expected
        assert set(np.unique(cells)) <= {0, 5}


@pytest.mark.small
def test_binary_counts_a_cell_once_however_many_strands_pass(gpu):
    points, spans, _ = random_strands(8, 2, 14, 2)
    zeros = np.zeros(len(spans), int)
    count = counted(gpu, plain_grid(), (points, spans, zeros), "count", np.array([3], np.uint32))
    binary = counted(gpu, plain_grid(), (points, spans, zeros), "binary", np.array([3], np.uint32))
    assert count.max() > 9
    np.testing.assert_array_equal(binary, 3 * (count > 0))


@pytest.mark.parametrize("weight", [1, 2, 3, 255, 256, 777, 65536])
def test_trilinear_keeps_the_mass_of_every_fragment(gpu, weight):
    grid = plain_grid((32, 32, 32))
    strands = random_strands(10, 12, 20, 1)              # far from the border: all parts fall inside
    strands = *strands[:2], np.zeros(150, int)
    count, trilinear = (counted(gpu, grid, strands, m, np.array([weight], np.uint32)) for m in ("count", "trilinear"))
    assert count[[0, -1]].sum() == count[:, [0, -1]].sum() == count[:, :, [0, -1]].sum() == 0
    assert trilinear.sum(dtype=np.uint64) == count.sum(dtype=np.uint64) > 0


def test_trilinear_keeps_the_centre_of_mass(gpu):
    """Parts of a fragment weigh out its place across and along the light, to 1/256 cell and a part in 65536."""
    rng = np.random.default_rng(11)
    for _ in range(20):
        y, z = rng.uniform(2, 14, 2)
        points = [(3.5, y, z, .1), (4.5, y, z, .1)]
        cells = counted(gpu, plain_grid(), (points, [(0, 2)], [0]), "trilinear", np.array([65536], np.uint32)) / 65536
        k, j, i = np.indices(cells.shape) + .5
        assert (cells * j).sum() == pytest.approx(y, abs=1 / 256) and (cells * k).sum() == pytest.approx(z, abs=1 / 256)
        assert (cells * i).sum() == 3.5


@pytest.mark.parametrize("turn", [0, 1])
def test_length_deposits_the_expected_crossings(gpu, turn):
    """Length · width · sine / area of a face, in all to half a unit per strand and float32's 3e-7."""
    points, spans, _ = random_strands(12, -.4, .4, .05, n=300)
    grid = turned_grid() if turn else plain_grid((32, 32, 32))
    if not turn:
        points[:, :3] = 16 + 16 * points[:, :3]
    cells = counted(gpu, grid, (points, spans, np.zeros(300, int)), "length", np.array([4096], np.uint32))
    points = points.astype(np.float32).astype(float)
    towards, expected = grid["light"][:3].astype(float), 0.0
    for first, n in spans:
        d = np.diff(points[first:first + n, :3], axis=0)
        width = (points[first:first + n - 1, 3] + points[first + 1:first + n, 3]) / 2
        expected += (np.linalg.norm(np.cross(d, towards), axis=1) * width).sum() / float(grid["face"][0])
    assert cells.sum(dtype=float) / 4096 == pytest.approx(expected, rel=1e-6, abs=.5 * len(spans) / 4096)


@pytest.mark.small
@pytest.mark.parametrize("off", [0, 12, 25])
def test_length_deposits_what_a_spot_sees(gpu, off):
    """A fibre is a ribbon across the ray of light; seen in the plane at distance 1 it covers so many cells' faces."""
    light = dict(direction=(0, 0, -1), position=(0, 0, 2), angle=100)
    grid = grid_of(scene_of(None, **light), 64)
    middle = np.array([2 * np.tan(np.radians(off)), 0, 0])
    for half in np.eye(3) * .02:
        points = np.c_[[middle - half, middle + half], [.004, .004]]
        cells = counted(gpu, grid, (points, [(0, 2)], [0]), "length", np.array([65536], np.uint32))
        across = np.cross(half, middle - (0, 0, 2))
        across *= .002 / max(np.linalg.norm(across), 1e-9)
        corners = [middle + s * half + t * across - (0, 0, 2) for s, t in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
        x, y = np.array([(c[0] / -c[2], c[1] / -c[2]) for c in corners]).T
        area = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2 if across.any() else 0.0
        # The fibre along the axis is a fiftieth of its distance long: 1/w^2 over it is taken at its middle.
        assert cells.sum() / 65536 * float(grid["face"][0]) == pytest.approx(area, rel=2e-3, abs=1e-9)


@pytest.mark.small
def test_length_is_spread_evenly(gpu):
    """A strand across ten cells leaves a tenth in each; between borders, as much as lies in each."""
    cells = counted(gpu, plain_grid(), ([(2, 3.5, 4.5, .5), (12, 3.5, 4.5, .5)], [(0, 2)], [0]), "length",
                    np.array([1000], np.uint32))
    row = np.zeros(16)
    row[2:12] = 500
    # 21 steps over ten cells: two in a cell, or three; each unit comes to lie within half a step of its place.
    np.testing.assert_allclose(cells[4, 3], row, atol=5000 / 21 + 1)
    assert cells.sum() == 5000
    np.testing.assert_allclose(np.cumsum(cells[4, 3]), np.cumsum(row), atol=5000 / 42 + 1)


def test_what_rounding_leaves_goes_on_along_the_strand(gpu):
    """A strand of many segments far below a unit each still leaves its whole."""
    points = np.zeros((2001, 4))
    points[:, :3] = np.linspace((2, 3.3, 4), (12, 3.3, 4), 2001)
    points[:, 3] = .1                                       # a segment is worth .005 · .1 · 256 = .128 units
    cells = counted(gpu, plain_grid(), (points, [(0, 2001)], [0]), "length", np.array([256], np.uint32))
    assert cells.sum() == pytest.approx(256, abs=1)         # and float32's sums of 2000 segments


@pytest.mark.small
def test_nothing_along_the_light(gpu):
    points = [(3.3, 4.4, 1, .5), (3.3, 4.4, 9, .5)]
    for method in METHODS:
        assert not counted(gpu, plain_grid(), (points, [(0, 2)], [0]), method).any()


@pytest.mark.small
def test_types_weigh_their_own(gpu):
    points, spans, kinds = random_strands(13, 0, 16, 3)
    cells = counted(gpu, plain_grid(), (points, spans, kinds), "count").astype(np.int64)
    one = np.ones(1, np.uint32)
    alone = [counted(gpu, plain_grid(), (points, spans[kinds == k], np.zeros((kinds == k).sum(), int)), "count", one)
             for k in range(4)]
    np.testing.assert_array_equal(cells, sum(int(w) * c.astype(np.int64) for w, c in zip(WEIGHTS, alone)))


# --- no counter can overflow -------------------------------------------------------------------------------


def test_the_unit_is_the_largest_that_cannot_overflow():
    assert crossing_unit_for(0) == crossing_unit_for(65535) == 65536
    for most in (65536, 1e6, 3.3e7, 2**31, 2**32 - 1):
        assert 2**31 <= most * crossing_unit_for(most) < 2**32 or crossing_unit_for(most) == 65536
        assert np.log2(crossing_unit_for(most)) % 1 == 0
    assert crossing_unit_for(2**32) == crossing_unit_for(1e30) == crossing_unit_for(np.inf) == 0


def sums_and_bounds(gpu, scene, strands, cells):
    """{method: (all cells in units, most_of, crossing_unit)} of strands on the device."""
    grid, n, result = grid_of(scene, cells), len(strands.spans), {}
    for method in METHODS:
        most = most_of(grid, method, *hair_bounds(scene.fur, n))
        crossing_unit = crossing_unit_for(most)
        assert crossing_unit
        counted = voxelize(gpu, grid, strands, method, np.full(len(strands.types), crossing_unit, np.uint32)).get()
        result[method] = counted.sum(dtype=np.uint64) / crossing_unit, most, crossing_unit
    return result


FURS = {
    "straight": dict(),
    "curly": dict(curl=(.06, 3)),
    "wavy": dict(wave=(.1, -2.5)),
    "all": dict(curl=(.05, -2), wave=(.03, 4), length_variation=1, direction_variation=.5),
    "wide and coarse": dict(segments=2, segment_length=.3, width=.2, curl=(.3, .5)),
}


@pytest.mark.parametrize("cells", [16, 128])
@pytest.mark.parametrize("fur", FURS)
@pytest.mark.parametrize("pull", [0, -6])
def test_grown_hair_cannot_exceed_its_bound(gpu, sphere, fur, cells, pull):
    """Also where a force turns a strand back and forth, and with it the frame in which it curls."""
    hair = clfur.HairType(**dict(segments=200, segment_length=.01, width=.01) | FURS[fur])
    fur = clfur.Strands(types=hair, roots=60, point_forces=clfur.PointForce((0, 1.02, 0), pull))
    strands = grow(gpu, tessellate(gpu, sphere, 1, 1), fur)
    points = strands.points.get().reshape(60, -1, 4).astype(float)
    lengths = np.linalg.norm(np.diff(points[..., :3], axis=1), axis=2).sum()
    segments, length, area = hair_bounds(fur, 60)
    assert segments >= 60 * hair.segments
    assert lengths <= length * (1 + 1e-5) and lengths * hair.width <= area * (1 + 1e-5)
    scene = clfur.Scene(mesh=sphere, fur=fur)
    for method, (total, most, crossing_unit) in sums_and_bounds(gpu, scene, strands, cells).items():
        assert 0 < total <= most and most * crossing_unit < 2**32, method


def test_types_of_any_length_are_bounded_by_the_largest(gpu, sphere):
    types = [clfur.HairType(segments=n, segment_length=length, width=width, key=(n, 0, 0))
             for n, length, width in ((20, .001, .02), (2, .2, .001), (0, 9, 9))]
    fur = clfur.Strands(types=types, type_map=np.array([[(20, 0, 0), (2, 0, 0), (0, 0, 0)]], np.uint8), roots=300)
    strands = grow(gpu, tessellate(gpu, sphere, 1, 1), fur)
    scene = clfur.Scene(mesh=sphere, fur=fur)
    for method, (total, most, crossing_unit) in sums_and_bounds(gpu, scene, strands, 64).items():
        assert 0 < total <= most and most * crossing_unit < 2**32, method


LIGHTS = {
    "distant": dict(direction=(-1, -.2, .4)),
    "spot": dict(direction=(0, 0, -1), position=(0, 0, 3), angle=40),
    "wide spot": dict(direction=(0, 0, -1), position=(0, 0, 1.5), angle=150),
    "spot inside": dict(direction=(1, .3, -1), position=(.1, 0, 0), angle=90),
}


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("cells", [16, 128])
def test_strands_brought_along_cannot_exceed_their_bound(gpu, light, cells):
    points, spans, _ = random_strands(14, -.5, .5, .05, n=500)
    kept = np.concatenate([np.arange(first, first + n) for first, n in spans])
    curves = clfur.Curves(points[kept, :3], counts=spans[:, 1], width=points[kept, 3])
    scene = scene_of(curves, **LIGHTS[light])
    for method, (total, most, crossing_unit) in sums_and_bounds(gpu, scene, upload_curves(gpu, curves), cells).items():
        assert 0 < total <= most and most * crossing_unit < 2**32, method


def test_at_a_spots_border_strands_cannot_exceed_the_bound(gpu):
    """Where a wide cone is nearest, a strand crosses more cells than its length over their side: by 1/cos."""
    light = dict(direction=(0, 0, -1), position=(0, 0, 0), angle=150)
    near, tan = float(grid_of(scene_of(None, **light), 128)["face"][2]), np.tan(np.radians(75))
    # From beside the cone's border, just behind the nearest plane, to where x/w changes fastest.
    start = np.array([-.9 * tan * near, 0, -near * 1.01])
    end = start + .3 * near * np.array([1, 0, -tan]) / np.hypot(1, tan)
    curves = clfur.Curves(np.repeat([[start, end]], 200, 0), width=.001)
    scene = scene_of(curves, **light)
    assert grid_of(scene, 128)["face"][2] == pytest.approx(near, rel=1e-3)
    for method, (total, most, _) in sums_and_bounds(gpu, scene, upload_curves(gpu, curves), 128).items():
        assert 0 < total <= most, method


@pytest.mark.parametrize("near", [1e-1, 1e-3, 1e-5, 1e-9, 1e-20])
def test_hair_beside_the_lamp_adds_nothing_elsewhere(gpu, near):
    """What passes a spot nearer than the grid begins is outside; none of it may go on to the strand's next segment."""
    points = np.array([[(0, 0, -near), (near, 0, -2 * near), (0, 0, -.5)]])
    curves = clfur.Curves(points, width=.002)
    scene = scene_of(curves, direction=(0, 0, -1), position=(0, 0, 0))
    for method, (total, most, _) in sums_and_bounds(gpu, scene, upload_curves(gpu, curves), 64).items():
        assert total <= most, method
        assert total < 64, method                # the grid's diagonal; measured 24 crossings of the one strand at most


@pytest.mark.parametrize("method", METHODS)
def test_strands_where_a_driver_ends_long_loops(gpu, another, method):
    """A stretch of them in each launch: the same cells, with what rounding leaves from one to the next."""
    strands, grid = random_strands(11, -3, 40, 9, 30, 40), plain_grid((16, 32, 48))
    limited = another(lanes=1, hinted=1, steps=2000)
    launched = recorded(limited)
    cells = counted(limited, grid, strands, method)
    np.testing.assert_array_equal(cells, counted(gpu, grid, strands, method))
    assert cells.any() and len(launched) > (9 if method == "length" else 0)
    totals = []
    for n in 15_001, 30_001:
        long = np.column_stack([np.arange(n) % 2 * 15.5 + .2, *[np.full(n, 8.5)] * 2, np.ones(n)]).astype(np.float32)
        cells = counted(gpu, grid, (long, np.array([[0, n]]), np.zeros(1, int)), method, np.full(4, 500, np.uint32))
        totals.append(cells.sum(dtype=np.uint64))
    assert totals[0] > 0 and (method == "binary" or totals[1] == pytest.approx(2 * int(totals[0]), rel=1e-6))


def test_a_million_strands_in_one_column(gpu):
    """All of 10^6 strands in one cell: the sum is exact, as long as the crossing unit is that of the bound."""
    n = 10**6
    points = np.empty((n, 2, 3), np.float32)
    grid = grid_of(scene_of(None, direction=(0, 0, -1)), 64)
    side = float(grid["face"][1])
    points[:] = .5 * side
    points[:, 0, 0], points[:, 1, 0] = .4 * side, .6 * side       # across the middle of a cell
    curves = clfur.Curves(points, width=.01)
    strands = upload_curves(gpu, curves)
    scene = scene_of(curves, direction=(0, 0, -1))
    assert grid_of(scene, 64)["face"][1] == pytest.approx(side, rel=.01)
    for method in METHODS:
        most = most_of(grid, method, *hair_bounds(curves, n))
        crossing_unit = crossing_unit_for(most)
        assert most * crossing_unit < 2**32
        cells = voxelize(gpu, grid, strands, method, np.array([crossing_unit], np.uint32)).get()
        total = cells.sum(dtype=np.uint64)
        if method == "length":
            assert np.count_nonzero(cells) == 1
            assert total / crossing_unit == pytest.approx(n * .2 * .01 / side, rel=.5 / crossing_unit + 1e-3)
        else:
            assert total == (crossing_unit if method == "binary" else n * crossing_unit)


def test_hair_that_could_overflow_is_refused(gpu, sphere):
    """A spot so narrow, and a strand so often back and forth, that it could be counted 2^32 times."""
    curves = clfur.Curves([[((-1)**i / 2, 0, 0) for i in range(100_000)]], width=.1)
    light = clfur.Light(direction=(0, 0, -1), position=(0, 0, 3), angle=0.5)
    with pytest.raises(clfur.Error, match="Settings.grid"):
        clfur.render(clfur.Scene(mesh=sphere, fur=curves, light=light, camera=clfur.Camera(size=(8, 8))), gpu)


# --- what a count means ------------------------------------------------------------------------------------


def test_optical_depths():
    alphas = [0, .25, 1]
    np.testing.assert_allclose(depths_for(alphas, "length"), [1, .75, 0])
    for method in ("binary", "count", "trilinear"):
        depths = depths_for(alphas, method)
        np.testing.assert_allclose(np.exp(-depths[1:]), alphas[1:])
        assert 10 < depths[0] < np.inf
