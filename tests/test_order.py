"""order against its twin, and what strands in order may not change."""

import numpy as np
import pytest
from support.plans import plan_of

import clfur
from clfur.layout import CONSTANTS
from clfur.stages import strands
from clfur.stages.order import order
from clfur.twin import order as twin

BITS = CONSTANTS["CELL_BITS"]


def placed(gpu, points, counts):
    """[strands, 2] where strands go, on the host, of points [P, 3]."""
    counts = np.asarray(counts, np.uint32)
    spans = np.stack([np.cumsum(counts) - counts, counts], 1).astype(np.uint32)
    return order(gpu, gpu.upload(np.asarray(points, np.float32)), gpu.upload(spans)).placed.get()


def in_cells(n, seed):
    """Roots [n, 3] that lie clear of all borders of cells, of a box with sides as 4 : 2 : 1, which two of them span."""
    rng = np.random.default_rng(seed)
    sides = np.array([1 << BITS, 1 << BITS - 1, 1 << BITS - 2])
    roots = rng.integers(0, sides, (n, 3)) + rng.uniform(.01, .99, (n, 3))
    roots[rng.choice(n, 2, replace=False)] = 0 * sides, sides
    return roots.astype(np.float32)


@pytest.mark.parametrize("n", [*(pytest.param(n, marks=pytest.mark.small) for n in (2, 700)), 70_000])
def test_strands_follow_the_cells_of_their_roots(gpu, n):
    rng = np.random.default_rng(1)
    counts = rng.integers(1, 5, n)
    roots = in_cells(n, 2)
    points = rng.normal(size=(counts.sum(), 3))
    points[np.cumsum(counts) - counts] = roots
    there = placed(gpu, points, counts)
    assert twin.is_order(there, counts)
    cells = twin.cells(roots, BITS)
    assert len(set(cells)) > min(n, 1 << 3 * BITS - 3) / 3
    in_order = np.argsort(there[:, 0])
    assert (np.diff(cells[in_order]) >= 0).all()
    assert (np.diff(cells[np.argsort(there[:, 1])]) >= 0).all()


@pytest.mark.small
@pytest.mark.parametrize("roots", [
    np.zeros((70, 3)), np.full((70, 3), np.nan), np.full((70, 3), np.inf), np.full((70, 3), 3e38),
    np.r_[np.full((35, 3), -np.inf), np.full((35, 3), np.nan)], np.r_[np.zeros((69, 3)), [(1e38, -1e38, 3e38)]]],
    ids=["one place", "nan", "infinite", "large", "both", "far"])
def test_any_places_are_put_in_an_order(gpu, roots):
    """Arrays on a device are not checked."""
    counts = np.arange(70) % 3
    assert twin.is_order(placed(gpu, roots[np.repeat(np.arange(70), counts)], counts), counts)


@pytest.mark.small
def test_strands_without_points(gpu):
    assert twin.is_order(placed(gpu, np.zeros((0, 3)), [0] * 300), [0] * 300)
    assert placed(gpu, np.zeros((0, 3)), []).shape == (0, 2)


def on_sphere(n, seed, ragged):
    """(points [P, 3], counts [n]) of strands upright on a sphere."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 6, n) if ragged else np.full(n, 5)
    roots = rng.normal(size=(n, 3))
    roots /= np.linalg.norm(roots, axis=1, keepdims=True)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return (np.repeat(roots, counts, 0) * (1 + .06 * within)[:, None]).astype(np.float32), counts


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize("settings", [{"samples": 4}, {"raster": "samples", "samples": 4}, {"samples": 1, "lod": 2.0}],
                         ids=["coverage", "samples", "lod"])
def test_no_output_knows_the_order(gpu, monkeypatch, ragged, settings):
    """Colours for each point, widths for each strand, and types: all that is looked up by strand or point."""
    n = 5000
    assert n > strands.SORTED_FROM
    points, counts = on_sphere(n, 3, ragged)
    rng = np.random.default_rng(4)
    fur = clfur.Curves(points, counts, width=rng.random(n) * .01, color=rng.random((len(points), 3)),
                       root_uv=rng.random((n, 2)), types=[clfur.HairType(alpha=.3), clfur.HairType(alpha=.8)],
                       type_of=rng.integers(0, 2, n))
    scene = clfur.Scene(clfur.load_mesh("sphere"), fur, clfur.Camera(size=(120, 90)))
    wanted = "color", "depth", "id", "tangent", "normal", "uv", "coverage"
    frames = []
    for least in strands.SORTED_FROM, n + 1:
        monkeypatch.setattr(strands, "SORTED_FROM", least)
        gpu.forget()
        frames.append(clfur.draw(scene, gpu, clfur.Settings(**settings), wanted, hashes=True))
    assert frames[0].hashes == frames[1].hashes
    for name in wanted:
        np.testing.assert_array_equal(frames[0].images[name], frames[1].images[name])
    assert len(np.unique(frames[0].images["id"])) > 100


@pytest.mark.parametrize("ragged", [False, True])
def test_parts_are_put_in_order_each(gpu, another, monkeypatch, ragged):
    """The same bits as of one part whose strands lie as they came."""
    points, counts = on_sphere(6000, 8, ragged)
    fur = clfur.Curves(points, counts, width=.004, color=np.random.default_rng(9).random((6000, 3)))
    scene = clfur.Scene(fur=fur, camera=clfur.Camera(size=(64, 48)))
    settings, wanted = clfur.Settings(grid=16, shadow_map=16, samples=1), ("color", "depth", "id", "coverage")
    small = another()
    for small.memory in range(3_000_000, 500_000, -100_000):   # the first that holds several parts alone
        if len(plan_of(scene, settings).parts(small)) > 1:
            break
    else:
        pytest.fail("never more than one part")
    monkeypatch.setattr(strands, "SORTED_FROM", 7000)
    gpu.forget()
    whole = clfur.draw(scene, gpu, settings, wanted, hashes=True)
    monkeypatch.setattr(strands, "SORTED_FROM", 0)
    cut = clfur.draw(scene, small, settings, wanted, hashes=True)
    assert whole.hashes == cut.hashes
    for name in wanted:
        np.testing.assert_array_equal(whole.images[name], cut.images[name])


def test_a_strand_is_found_by_what_it_came_as(gpu):
    """In any order points[stored[p / run] + p % run] is the point that came as p, and of its strand."""
    for ragged in False, True:
        points, counts = on_sphere(5000, 5, ragged)
        there = strands.upload_curves(gpu, clfur.Curves(points, counts))
        came = np.arange(len(points))
        rows = there.stored.get()[came // there.run] + came % there.run
        np.testing.assert_array_equal(there.points.get()[rows, :3], points)
        strand = there.strand_of.get()[rows // there.run]
        np.testing.assert_array_equal(there.numbers.get()[strand], np.repeat(np.arange(5000), counts))
        np.testing.assert_array_equal((rows + there.shifts.get()[strand]).astype(np.uint32), came)
        assert (rows != came).any()
        assert there.run == (1 if ragged else 5)


def test_an_order_that_is_wrong_is_seen(gpu):
    points, counts = on_sphere(300, 6, True)
    there = placed(gpu, points, counts)
    assert twin.is_order(there, counts)
    assert not twin.is_order(np.roll(there, 1, 0), counts)
    assert not twin.is_order(there[:, ::-1], counts)
