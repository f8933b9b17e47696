"""Strands as transparent as they are thin, what they cover: the twin's pieces on every device, and the laws of area.

How pieces hide each other, their light, whole frames and parts have tests of their own: test_coverage_*.py.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from support.coverage import NONE, counted, pieces_of, wild
from support.plans import recorded
from support.stages import strands_on
from support.views import flat, pack, perspective

from clfur import layout
from clfur.pipeline.views import band_of, columns_of
from clfur.stages import coverage
from clfur.twin import coverage as twin

DEPTH_ONE, BODY, TILE = (layout.CONSTANTS[name] for name in ("DEPTH_ONE", "BODY", "TILE"))


pytestmark = pytest.mark.usefixtures("plain")


def gathered(gpu, view, points, spans, visible=None):
    """`Segments` of strands as from `pack`, and their pieces that the body does not hide, see `pieces_of`."""
    width, samples, rows = int(view["size"][0]), int(view["size"][2]), int(view["rows"][1] - view["rows"][0])
    if visible is None:
        visible = np.full((rows, width, samples), NONE)
    _, segments = counted(gpu, view, strands_on(gpu, points, spans), gpu.upload(visible))
    pieces = pieces_of(gpu, view, segments)
    pieces = pieces[pieces["depth"] < (visible >> np.uint64(32)).max(2).ravel()[pieces["pixel"]].astype(np.int64)]
    lists = listed(segments)
    assert not {(tile_of(p, width), k) for p, k in pieces[["pixel", "id"]].tolist()} - lists, "a tile lacks a segment"
    return segments, pieces


def tile_of(pixel, width):
    across, _ = coverage.tiles_of(width, 1)
    return pixel // width // TILE * across + pixel % width // TILE


def listed(segments):
    """{(tile, id)} of all entries, of which none may be there twice."""
    starts, numbers, ids = segments.starts.get(), segments.entries.get()[:, 1], segments.ids.get()
    ids = ids & 0x7FFFFFFF   # the highest bit tells that they are clipped
    pairs = list(zip(np.repeat(np.arange(len(starts) - 1), np.diff(starts)).tolist(), ids[numbers].tolist()))
    assert len(set(pairs)) == len(pairs) and len(set(ids.tolist())) == len(ids)
    return set(pairs)


def areas(gpu, view, strands):
    """Sum of each segment's shares [points]."""
    points, spans = pack(strands)
    _, pieces = gathered(gpu, view, points, spans)
    return np.bincount(pieces["id"], pieces["share"].astype(float), len(points))


def compare_pieces(view, points, spans, pieces, off, steps):
    """Share and depth of all pieces against the twin's; those below ``off`` may be missing."""
    width = int(view["size"][0])
    meant = {((y - int(view["rows"][0])) * width + x - int(view["rows"][2]), k): (depth, share)
             for y, x, depth, k, share in twin.fragments(view, points, spans)}
    there = {(p, k): (depth, share) for p, k, depth, share, _ in pieces.tolist()}
    assert len(there) == len(pieces)
    for place in meant.keys() | there.keys():
        (depth, share), (meant_depth, meant_share) = there.get(place, (None, 0)), meant.get(place, (None, 0))
        assert abs(share - meant_share) < off, (place, share, meant_share)
        if depth is not None and meant_depth is not None:
            assert abs(depth - meant_depth) < steps, (place, depth, meant_depth)
    return len(there)


@pytest.mark.parametrize("width, height, n", [pytest.param(13, 9, 20, marks=pytest.mark.small), (61, 47, 150)])
@pytest.mark.parametrize("eye", [(0, .4, 3.2), (.1, .1, .9)], ids=["before", "within"])
def test_pieces_are_the_twins(gpu, width, height, n, eye):
    """A place of float32 is wrong by a few times 2^-24 of the picture's size, and an edge and so a share by as much.

    Measured: 1.3e-5 of a pixel.  Depths: 6 roundings of e near 1 (64 steps each), where a strand looks at the eye.
    """
    view = perspective(width, height, 1, eye=eye)
    points, spans = pack(wild(n, 1))
    _, pieces = gathered(gpu, view, points, spans)
    assert compare_pieces(view, points, spans, pieces, 3e-5, 640) > n


@pytest.mark.parametrize("seed", [9, 12, 13])
def test_pieces_of_wide_strands_near_the_eye_are_the_twins(gpu, seed):
    """Their segments lean towards those before and behind them, which may be clipped, or stand in other batches.  A
    corner is known to half a step, 1 / 43690 of half its width: of the widest, 12 pixels, 2.7e-4."""
    view, rng = perspective(61, 47, 1, eye=(.1, .1, .9)), np.random.default_rng(seed)
    strands = []
    for n in rng.integers(8, 20, 40):
        steps = np.concatenate([rng.uniform(-1, 1, (1, 3)), rng.normal(size=(n - 1, 3)) * rng.choice([.1, .5])])
        strands.append(np.column_stack([steps.cumsum(0), rng.uniform(.01, .06, n)]))
    points, spans = pack(strands)
    _, pieces = gathered(gpu, view, points, spans)
    assert compare_pieces(view, points, spans, pieces, 3e-4, 640) > 1000


@pytest.mark.parametrize("n", [pytest.param(20, marks=pytest.mark.small), 400])
def test_slabs_of_depth_give_the_bits_of_all_at_once(gpu, n):
    """As many of a tile's segments at a time as a slab's count tells, each in every slab into which it reaches."""
    view, (points, spans), tile = perspective(13, 9, 4, eye=(0, .4, 3.2)), pack(wild(n, 1)), (0, 1)
    strands, visible = strands_on(gpu, points, spans), gpu.upload(np.full((9, 13, 4), NONE))
    tiles, segments = counted(gpu, view, strands, visible)
    whole, total = coverage.nothing(gpu, visible), int(tiles.counts.get()[0])
    coverage.cover(gpu, view, visible, segments, whole, window=tile)
    reaches, taken = coverage.REACH.empty(gpu, total), gpu.full(1, np.uint32, 0)
    coverage.reach(gpu, view, strands, tiles, reaches, taken, tile)
    assert int(taken.get()[0]) == total > n // 4
    slabs = coverage.slabs_of(reaches.get(), total * 2 // 3)
    parts, kept, counts = coverage.nothing(gpu, visible), coverage.KEPT.empty(gpu, coverage.OF_KEPT), np.zeros(4, int)
    for slab, counts[0] in slabs:
        segments = coverage.allocate(gpu, counts, counts[0])
        coverage.fill(gpu, view, strands, tiles, segments, tile, slab)
        assert int(segments.survivors.get()[0]) == counts[0] < total
        unfinished = coverage.cover(gpu, view, visible, segments, parts, window=tile, slab=slab, kept=kept).get()[0]
        assert slab[1] == coverage.EVERY[1] or 0 < unfinished <= TILE**2
    assert len(slabs) > 1 and (whole.alpha.get()[:TILE, :TILE] > 0).any()
    for name in "alpha", "front", "body_transmittance":
        one, other = (getattr(arrays, name).get()[:TILE, :TILE] for arrays in (whole, parts))
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("width, height, n, eye, first, end", [
    pytest.param(13, 9, 20, (0, .4, 3.2), 8, 13, marks=pytest.mark.small), (61, 47, 150, (.1, .1, .9), 0, 24),
    (61, 47, 150, (.1, .1, .9), 32, 61)])
def test_columns_are_the_twins_and_the_wholes(gpu, width, height, n, eye, first, end):
    """Within an eye's reach long segments cross many tiles: these list the same ones as in the whole picture."""
    view, (points, spans) = perspective(width, height, 1, eye=eye), pack(wild(n, 1))
    some = columns_of(view, first, end)
    _, whole = gathered(gpu, view, points, spans)
    segments, pieces = gathered(gpu, some, points, spans)
    assert compare_pieces(some, points, spans, pieces, 3e-5, 640) > n / 2
    inside = whole[(whole["pixel"] % width >= first) & (whole["pixel"] % width < end)]
    inside["pixel"] = inside["pixel"] // width * (end - first) + inside["pixel"] % width - first
    np.testing.assert_array_equal(np.sort(pieces), np.sort(inside))
    across, _ = coverage.tiles_of(end - first, 1)
    _, all_segments = counted(gpu, view, strands_on(gpu, points, spans), gpu.upload(np.full((height, width, 1), NONE)))
    of_all, most = listed(all_segments), coverage.tiles_of(width, 1)[0]
    assert listed(segments) == {(tile // most * across + tile % most - first // TILE, k) for tile, k in of_all
                                if first // TILE <= tile % most < first // TILE + across}


@pytest.mark.parametrize("first, end", [(0, 1), (5, 23), (46, 47)])
def test_a_band_is_what_the_whole_is_there(gpu, first, end):
    view, (points, spans) = perspective(61, 47, 1), pack(wild(100, 2))
    _, whole = gathered(gpu, view, points, spans)
    _, band = gathered(gpu, band_of(view, first, end), points, spans)
    inside = whole[(whole["pixel"] >= first * 61) & (whole["pixel"] < end * 61)]
    inside["pixel"] -= first * 61
    np.testing.assert_array_equal(band, inside)
    assert len(band)


def random_segments(n, seed, width, height, low, high, margin=8):
    """Segments inside a picture, in pixels, any slope and length, widths evenly in the exponent: [n, 2, 4]."""
    rng = np.random.default_rng(seed)
    a, b = (rng.uniform(margin, (width - margin, height - margin), (n, 2)) for _ in range(2))
    b = a + (b - a) * rng.uniform(.001, 1, (n, 1))
    w = np.exp(rng.uniform(np.log(low), np.log(high), (n, 1)))
    return np.stack([np.concatenate([end, np.full((n, 1), .5), w], 1) for end in (a, b)], 1).astype(np.float32)


def area_of(segments):
    d = np.diff(segments[:, :, :2].astype(float), axis=1)[:, 0]
    return np.hypot(*d.T) * segments.astype(float)[:, :, 3].mean(1)


@pytest.mark.parametrize("width, height", [(64, 48), (1000, 700)])
def test_shares_add_up_to_the_area(gpu, width, height):
    """Whatever the place, slope, length and width.  The thinnest have an edge's rounding, 2^-24, over 0.01."""
    segments = random_segments(400, 3, width, height, .01, 5)
    np.testing.assert_allclose(areas(gpu, flat(width, height, 1), segments)[::2], area_of(segments), rtol=1e-5)


def test_a_tapered_strand_has_its_area(gpu):
    segments = random_segments(200, 4, 64, 48, .1, 3)
    segments[:, 0, 3] *= np.random.default_rng(5).uniform(0, 1, 200)
    np.testing.assert_allclose(areas(gpu, flat(64, 48, 1), segments)[::2], area_of(segments), rtol=1e-5, atol=1e-5)


def test_neighbours_meet(gpu):
    """A line in one, two or five pieces covers the same of each pixel, and shifted within its pixel the same in all."""
    view, rng = flat(64, 48, 1), np.random.default_rng(6)
    for line in random_segments(30, 7, 64, 48, .05, 4):
        pictures = []
        for places in ([0, 1], [0, rng.uniform(), 1], [0, *sorted(rng.uniform(size=4)), 1]):
            way = np.array(places)[:, None]
            _, pieces = gathered(gpu, view, *pack([line[0] + way * (line[1] - line[0])]))
            pictures.append(np.bincount(pieces["pixel"], pieces["share"], 64 * 48))
        for other in pictures[1:]:
            np.testing.assert_allclose(other, pictures[0], rtol=0, atol=2e-5)


def within_pixel(corners, x, y):
    return twin.area_within(twin.cut(corners, 0, x), y)


def drawn_of(gpu, view, strand):
    """Sum of a strand's shares in each pixel [rows, width], and those of its segments [n, rows, width]."""
    width, rows = int(view["size"][0]), int(view["rows"][1])
    _, pieces = gathered(gpu, view, *pack([strand]))
    each = np.zeros((len(strand) - 1, rows * width))
    np.add.at(each, (pieces["id"], pieces["pixel"]), pieces["share"])
    return each.sum(0).reshape(rows, width), each.reshape(-1, rows, width)


@pytest.mark.parametrize("n", [pytest.param(2, marks=pytest.mark.small), 20])
def test_wide_strands_end_square(gpu, n):
    """Two pixels wide or more, a straight one is a rectangle, whatever its slope, length and points.  A corner is
    known to half a step: 4 / 21845 / 2 of a pixel."""
    view, rng = flat(40, 32, 1), np.random.default_rng(9)
    for _ in range(n):
        a, way = rng.uniform(12, (28, 20)), rng.normal(size=2)
        way, half, length = way / np.hypot(*way), rng.uniform(1, 4), rng.uniform(.2, 7)
        ends, across = (a, a + length * way), half * way[::-1] * (-1, 1)
        corners = [tuple(end + sign * across) for end, sign in zip((*ends, *ends[::-1]), (1, 1, -1, -1))]
        places = np.array([0, *sorted(rng.uniform(size=3)), 1])[:, None] * length
        strand = np.column_stack([a + places * way, np.full((5, 2), (.5, 2 * half))])
        meant = [[within_pixel(corners, x, y) for x in range(40)] for y in range(32)]
        np.testing.assert_allclose(drawn_of(gpu, view, strand)[0], meant, rtol=0, atol=1.2e-4)


@pytest.mark.parametrize("turn", [pytest.param(20, marks=pytest.mark.small), -50, 88])
def test_wide_strands_meet_at_bends(gpu, turn):
    """Each pixel is covered once: by the one, the other, or both together, and outside no wedge is left out.
    A corner is known to half a step, 3 / 21845 / 2 of a pixel, for each of both."""
    view, rng = flat(48, 48, 1), np.random.default_rng(10)
    for start in rng.uniform(0, 2 * np.pi, 4):
        middle, half = rng.uniform(22, 26, 2), 3.0
        ways = [np.array([np.cos(angle), np.sin(angle)]) for angle in (start, start + np.radians(turn))]
        ends = np.array([middle - 12 * ways[0], middle, middle + 12 * ways[1]])
        strand = np.column_stack([ends, np.full((3, 2), (.5, 2 * half))])
        whole, each = drawn_of(gpu, view, strand)
        assert whole.max() < 1 + 1.4e-4 and (each > 0).all(0).any()
        across, bent = (half * way[::-1] * (-1, 1) for way in (ways[0], ways[0] + ways[1]))
        bent = bent * half**2 / (bent @ across)
        for k, way in enumerate(ways):
            side = half * way[::-1] * (-1, 1)
            far = ends[2 * k]
            corners = [tuple(place) for place in (far + side, ends[1] + bent, ends[1] - bent, far - side)]
            meant = [[within_pixel(corners, x, y) for x in range(48)] for y in range(48)]
            np.testing.assert_allclose(each[k], meant, rtol=0, atol=1.2e-4)


def test_bends_keep_the_area_however_tight(gpu):
    """Of each segment, though it folds over itself."""
    rng = np.random.default_rng(11)
    strands = [np.column_stack([28 + rng.normal(size=(6, 2)).cumsum(0) * size, np.full(6, .5), np.full(6, width)])
               for size in (.3, 2) for width in (1.2, 3, 7) for _ in range(9)]
    found = areas(gpu, flat(64, 64, 1), strands)
    for k, strand in enumerate(strands):
        meant = area_of(np.stack([strand[:-1], strand[1:]], 1).astype(np.float32))
        np.testing.assert_allclose(found[6 * k:6 * k + 5], meant, rtol=2e-5, atol=2e-5)


def test_thin_strands_do_not_lean(gpu):
    """What is a pixel wide or less keeps its bits."""
    view, points = flat(64, 48, 1), random_segments(200, 12, 64, 48, .01, 2)
    _, segments = counted(gpu, view, strands_on(gpu, *pack(points)), gpu.upload(np.full((48, 64, 1), NONE)))
    wide, leans = segments.ends.get()[:, 3] > .5, segments.cuts.get() != 0
    assert not leans[~wide].any() and leans[wide].mean() > .9


def test_wide_and_flat_edges_have_their_share(gpu):
    """Edges far from a pixel, or that hardly rise, are where a difference of integrals would cancel."""
    view = flat(64, 48, 1)
    for slope in (0, 1e-6, 1e-4, 3e-3, 5e-3):
        _, pieces = gathered(gpu, view, *pack([[(-1e4, 20.25, .5, 3000), (1e4, 20.25 + 2e4 * slope, .5, 3000)]]))
        np.testing.assert_allclose(pieces["share"], 1, rtol=1e-6)
        assert len(pieces) == 64 * 48
        line = np.array([[(2, 20 - 30 * slope, .5, .3), (62, 20 + 30 * slope, .5, .3)]], np.float32)
        points, spans = pack(line)
        _, pieces = gathered(gpu, view, points, spans)
        compare_pieces(view, points, spans, pieces, 1e-6, 300)


@pytest.mark.parametrize("turned", [False, True])
def test_half_a_pixel_covers_half(gpu, turned):
    strand = np.array([(4, 10.5, .5, .5), (40, 10.5, .5, .5)])
    _, pieces = gathered(gpu, flat(48, 48, 1), *pack([strand[:, [1, 0, 2, 3]] if turned else strand]))
    np.testing.assert_array_equal(pieces["share"], .5)
    assert len(pieces) == 36


@pytest.mark.parametrize("y, rows", [(10, {9: .25, 10: .25}), (10.25, {10: .5}), (10.75, {10: .5}), (0, {0: .25}),
                                     (48, {47: .25}), (-1, {}), (49, {})])
def test_on_the_borders_of_pixels(gpu, y, rows):
    _, pieces = gathered(gpu, flat(48, 48, 1), *pack([[(3, y, .5, .5), (7, y, .5, .5)]]))
    there = {(p // 48, p % 48): share for p, share in zip(pieces["pixel"].tolist(), pieces["share"].tolist())}
    assert there == {(row, x): share for row, share in rows.items() for x in range(3, 7)}


def test_nothing_covers_nothing(gpu):
    view, rng = perspective(21, 17, 1), np.random.default_rng(8)
    still = np.repeat(rng.uniform(-1, 1, (9, 1, 4)), 3, 1)
    for strands in ([], [np.zeros((0, 4))] * 3, [np.ones((1, 4))], wild(20, 9) * (1, 1, 1, 0), still,
                    wild(20, 9) * (.1, .1, .1, 1) + (0, 0, 9, 0)):
        _, pieces = gathered(gpu, view, *pack(strands))
        assert len(pieces) == 0


def test_what_leaves_the_guard_band_is_cut(gpu):
    """Strands a million pixels long cover what short ones there do."""
    view = flat(64, 48, 1)
    far = np.array([[(-1e6, -1e6 + 5, .5, 2), (1e6, 1e6 + 5, .5, 2)], [(-2e5, 20, .5, 1), (3e5, 20, .5, 1)],
                    [(30, -4e4, .5, .1), (30, 9e5, .5, .1)], [(1e5, 20, .5, 9), (2e5, 21, .5, 9)]])
    near = np.array([[(-40, -35, .5, 2), (100, 105, .5, 2)], [(-99, 20, .5, 1), (99, 20, .5, 1)],
                     [(30, -99, .5, .1), (30, 99, .5, .1)]])
    cut, plain = areas(gpu, view, far), areas(gpu, view, near)
    # Ends that far away are known to 0.06 pixels.
    np.testing.assert_allclose(cut[:6], plain, rtol=2e-3)
    assert plain[::2].min() > 1 and cut[6] == 0


def test_the_body_bounds_what_is_gathered(gpu):
    """Of a pixel that it fills, what is behind; of others nothing."""
    points, spans = pack([[(0, 5.5, e, 1), (20, 5.5, e, 1)] for e in (.25, .5, .75)])
    visible = np.full((11, 20, 4), NONE)
    visible[:, 5:10] = (DEPTH_ONE // 2 << 32) | BODY            # e = .5 itself is hidden
    visible[:, 10:15] = (DEPTH_ONE * 3 // 8 << 32) | BODY
    visible[:, 12, 3] = NONE
    _, pieces = gathered(gpu, flat(20, 11, 4), points, spans, visible)
    found = {x: set(pieces["id"][pieces["pixel"] % 20 == x].tolist()) for x in range(20)}
    assert found[0] == found[12] == found[19] == {0, 2, 4} and found[7] == {4} and found[11] == {4}


@pytest.mark.parametrize("width", [.002, .1])
def test_boxes_of_all_sizes_are_looked_up_side_by_side(gpu, another, width):
    """Segments that touch one tile or many, eight at a time, some of them clipped, wide ones leaning towards those of
    the eight before: listed as where each is looked up by itself."""
    rng = np.random.default_rng(3)
    strands = []
    for n in rng.integers(2, 20, 150):
        steps = rng.normal(size=(n, 3)) * np.exp(rng.uniform(np.log(.005), np.log(.6), (n, 1)))
        steps[0] = rng.normal(size=3)
        strands.append(np.concatenate([np.cumsum(steps, 0), np.full((n, 1), width)], 1))
    points, spans = pack(strands)
    view, visible = perspective(300, 203, 1, eye=(0, .4, 2.1)), np.full((203, 300, 1), NONE)
    lists, of_each = [], []
    for one in gpu, another(lanes=1, hinted=1):
        tiles, segments = counted(one, view, strands_on(one, points, spans), one.upload(visible))
        lists.append((tiles.counts.get().tolist(), listed(segments)))
        rows = zip(segments.ids.get().tolist(), segments.ends.get().tolist(), segments.cuts.get().tolist())
        of_each.append({number: (end, cut) for number, end, cut in rows})
    assert lists[0] == lists[1] and of_each[0] == of_each[1]
    sizes = np.bincount([k for _, k in lists[0][1]])
    assert ((sizes > 0) & (sizes <= 4)).sum() > 50 and (sizes > 16).sum() > 10
    assert any(number >> 31 for number in of_each[0])
    assert any(cut for number, (_, cut) in of_each[0].items() if not number >> 31) == (width > .01)


@pytest.mark.parametrize("n", [pytest.param(12, marks=pytest.mark.small), 300])
def test_windows_list_what_shows_there(gpu, another, n):
    """Where strands are known to show elsewhere, where they are not, and where a driver ends long loops, so that they
    come to a stop; some show nowhere, one everywhere."""
    view, wide = perspective(45, 37, 1, eye=(0, .4, 3.2)), np.array([[-2, 0, .1, 3], [-1, .1, 0, 3], [2, .2, 0, 3]])
    points, spans = pack([*wild(n, 3), wide])
    points[:5 * (n // 4), :3] += (0, 0, 9)   # behind the eye
    limited, all_of = another(lanes=1, hinted=1, steps=16), []
    launched = recorded(limited)
    for one, known in (gpu, 0), (gpu, n + 1), (limited, n + 1):
        strands, visible = strands_on(one, points, spans), one.upload(np.full((37, 45, 1), NONE))
        tiles = coverage.bound(one, view, visible, known)
        coverage.count(one, view, strands, tiles)
        all_of.append((one, strands, tiles))
    counts, shown = all_of[0][2].counts.get(), all_of[1][2].shown.get()
    for _, _, tiles in all_of[1:]:
        np.testing.assert_array_equal(counts, tiles.counts.get())
        np.testing.assert_array_equal(shown, tiles.shown.get())
        assert tiles.survivors.get() == all_of[0][2].survivors.get()
    assert not (shown[:n // 5] >> 16).any() and (shown >> 16).max() == 5 and len(set(shown.tolist())) > 3
    for window in (0, 1), (3, 11), (17, 30), coverage.EVERY:
        within, found, reached = counts.copy(), [], []
        within[:window[0]] = within[window[1]:] = 0
        for one, strands, tiles in all_of:
            segments = coverage.allocate(one, within, int(within.sum()))
            coverage.fill(one, view, strands, tiles, segments, window)
            n_ids = int(segments.survivors.get()[0])
            found.append(listed(SimpleNamespace(**{**vars(segments), "ids": segments.ids[:n_ids]})))
            reaches, taken = coverage.REACH.empty(one, n_ids), one.full(1, np.uint32, 0)
            coverage.reach(one, view, strands, tiles, reaches, taken, window)
            reached.append(np.sort(reaches.get().view(np.uint64), 0))
        for other in reached[1:]:
            np.testing.assert_array_equal(reached[0], other)
        assert found[0] == found[1] == found[2] and len(found[0]) == within.sum()
    for kernel, once in ("count", 1), ("fill", 4), ("reach", 4):
        assert launched.count(f"coverage.{kernel}") > once, kernel
