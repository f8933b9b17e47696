"""Strands as transparent as they are thin: the twin's values on every device, and the laws of area, order and light."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import icosphere
from test_parts import same
from test_raster import flat, pack, perspective
from test_shade import host
from test_shadows import squares, strands_of

import clfur
from clfur import layout
from clfur.parts import Work
from clfur.render import OUTPUTS
from clfur.shadows import cast_shadows
from clfur.stages import coverage, shade
from clfur.stages.raster import raster
from clfur.stages.tessellate import no_surface, tessellate
from clfur.twin import coverage as twin
from clfur.views import band_of, light_of, view_of

DEPTH_ONE, BODY, GUARD = (layout.CONSTANTS[name] for name in ("DEPTH_ONE", "BODY", "GUARD"))
NONE = np.uint64(twin.NONE)
SETTINGS = clfur.Settings(raster="coverage", samples=4, grid=16, shadow_map=32)
OFF = clfur.Settings(raster="coverage", samples=1, shadows="off")


def gathered(gpu, view, points, spans, visible=None):
    """`Fragments` of strands as from `pack`, and [n] (pixel, id, depth, share) of them, in the order of pixels and ids."""
    width, samples, rows = int(view["size"][0]), int(view["size"][2]), int(view["rows"][1] - view["rows"][0])
    if visible is None:
        visible = np.full((rows, width, samples), NONE)
    strands = SimpleNamespace(points=gpu.upload(points), spans=gpu.upload(spans), first_point=0)
    pixels = coverage.bound(gpu, gpu.upload(visible))
    coverage.count(gpu, view, strands, pixels)
    counted = pixels.get()
    fragments = coverage.room_for(gpu, counted)
    coverage.gather(gpu, view, strands, fragments)
    written = fragments.pixels.get()[..., 1] - fragments.starts.get()
    assert (written <= counted[..., 1]).all(), "more was gathered than counted"
    return fragments, told(fragments)


def told(fragments, used=None):
    """Structured [n] of `Fragments`, of which only the last are ``used``."""
    ends, listed = fragments.pixels.get()[..., 1].ravel().astype(np.int64), fragments.list.get()
    starts = fragments.starts.get().ravel().astype(np.int64) if used is None else ends - used.get().ravel()
    counts = ends - starts
    at = np.repeat(starts, counts) + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    result = np.zeros(len(at), [("pixel", "i8"), ("id", "i8"), ("depth", "i8"), ("share", "f4")])
    key, share = listed[at, 0], listed[at, 1].astype(np.uint32).view(np.float32)
    result["pixel"], result["share"] = np.repeat(np.arange(len(counts)), counts), share
    result["id"], result["depth"] = key & np.uint64(0xFFFFFFFF), key >> np.uint64(32)
    return np.sort(result, order=("pixel", "id"))


def areas(gpu, view, strands):
    """Sum of each segment's shares [points]."""
    points, spans = pack(strands)
    _, pieces = gathered(gpu, view, points, spans)
    return np.bincount(pieces["id"], pieces["share"].astype(float), len(points))


def wild(n, seed, reach=1.4, width=.1):
    """Strands through all that a camera sees, behind it too: [n, 5, 4]."""
    rng = np.random.default_rng(seed)
    steps = np.concatenate([rng.uniform(-reach, reach, (n, 1, 3)), rng.normal(size=(n, 4, 3)) * .25], 1)
    return np.concatenate([steps.cumsum(1), rng.uniform(0, width, (n, 5, 1))], 2)


# --- what a strand covers -------------------------------------------------------------------------------


def compare_pieces(view, points, spans, pieces, off, steps):
    """Share and depth of all pieces against the twin's; those below ``off`` may be missing."""
    width = int(view["size"][0])
    meant = {((y - int(view["rows"][0])) * width + x, k): (depth, share)
             for y, x, depth, k, share in twin.fragments(view, points, spans)}
    there = {(p, k): (depth, share) for p, k, depth, share in pieces.tolist()}
    assert len(there) == len(pieces)
    for place in meant.keys() | there.keys():
        (depth, share), (meant_depth, meant_share) = there.get(place, (None, 0)), meant.get(place, (None, 0))
        assert abs(share - meant_share) < off, (place, share, meant_share)
        if depth is not None and meant_depth is not None:
            assert abs(depth - meant_depth) < steps, (place, depth, meant_depth)
    return len(there)


@pytest.mark.parametrize("width, height, n", [pytest.param(13, 9, 5, marks=pytest.mark.small), (61, 47, 150)])
@pytest.mark.parametrize("eye", [(0, .4, 3.2), (.1, .1, .9)], ids=["before", "within"])
def test_pieces_are_the_twins(gpu, width, height, n, eye):
    """A place of float32 is wrong by a few times 2^-24 of the picture's size over what is nearest, and a share by that.

    Measured: 1.3e-5 from before, 8e-5 within, where strands that graze the near plane are thousands of pixels long.
    Depths are one or two roundings of e (64 steps each), or of an end far outside.
    """
    view = perspective(width, height, 1, eye=eye)
    points, spans = pack(wild(n, 1))
    _, pieces = gathered(gpu, view, points, spans)
    within = eye[2] < 1
    assert compare_pieces(view, points, spans, pieces, 2e-4 if within else 2e-5, 2000 if within else 300) > 3 * n


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
    """Whatever the place, slope, length and width.  The thinnest have an edge's rounding, 2^-24, over a width of 0.01."""
    segments = random_segments(400, 3, width, height, .01, 5)
    np.testing.assert_allclose(areas(gpu, flat(width, height, 1), segments)[::2], area_of(segments), rtol=1e-5)


def test_a_tapered_strand_has_its_area(gpu):
    segments = random_segments(200, 4, 64, 48, .1, 3)
    segments[:, 0, 3] *= np.random.default_rng(5).uniform(0, 1, 200)
    np.testing.assert_allclose(areas(gpu, flat(64, 48, 1), segments)[::2], area_of(segments), rtol=1e-5)


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


@pytest.mark.parametrize("y, rows, shares", [(10, {9: .25, 10: .25}, None), (10.25, {10: .5}, None), (10.75, {10: .5}, None),
                                             (0, {0: .25}, None), (48, {47: .25}, None), (-1, {}, None), (49, {}, None)])
def test_on_the_borders_of_pixels(gpu, y, rows, shares):
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
    seen = {x: set(pieces["id"][pieces["pixel"] % 20 == x].tolist()) for x in range(20)}
    assert seen[0] == seen[12] == seen[19] == {0, 2, 4} and seen[7] == {4} and seen[11] == {4}


# --- one behind the other -------------------------------------------------------------------------------


def piled(gpu, rng, counts, order=None, spread=1 << 20, share=.15):
    """`Fragments` made up: ``counts`` [rows, width] in each pixel, in runs of one strand, some at equal depths."""
    counts = np.asarray(counts)
    ends = counts.cumsum().reshape(counts.shape)
    n = int(counts.sum())
    ids = np.concatenate([np.arange(0, 2 * c, 2) // 3 + 7 for c in counts.ravel()] + [np.zeros(0)]).astype(np.uint64)
    ids = np.concatenate([rng.permutation(4 * c)[:c] for c in counts.ravel()] + [ids[:0]]).astype(np.uint64)
    depths = ((DEPTH_ONE // 2) + rng.integers(0, 200, n) * (spread // 200)).astype(np.uint64)
    shares = (share * rng.random(n) ** 2).astype(np.float32)
    listed = np.stack([depths << np.uint64(32) | ids, shares.view(np.uint32).astype(np.uint64)], 1)
    if order is not None:
        pixel = np.repeat(np.arange(counts.size), counts.ravel())
        listed = listed[np.lexsort((order.random(n), pixel))]
    starts = (ends - counts).astype(np.uint32)
    pixels = np.stack([np.full(counts.shape, 0xFFFFFFFF, np.uint32), ends.astype(np.uint32)], -1)
    return coverage.Fragments(gpu.upload(starts), gpu.upload(pixels), gpu.upload(listed))


def keys_at(rng, shape, share, spread=1 << 20):
    """Random keys of body or shells about the depth of `piled` ones; nothing but in a share of the samples."""
    depths = DEPTH_ONE // 2 + rng.integers(-spread // 4, spread, shape)
    return np.where(rng.random(shape) < share, depths.astype(np.uint64) << np.uint64(32) | np.uint64(BODY | 5), NONE)


def resolved_bits(gpu, fragments, visible, through=None, fur=None):
    """What `resolve` gives: {name: array}, and the pieces that are seen."""
    both = (None, None) if fur is None else (gpu.upload(through), gpu.upload(fur))
    resolved = coverage.resolve(gpu, gpu.upload(visible), fragments, *both)
    arrays = {f.name: getattr(resolved, f.name).get() for f in dataclasses.fields(resolved)}
    return arrays, told(fragments, resolved.used)


@pytest.mark.parametrize("samples, furry, counts", [
    *[pytest.param(s, f, [[0, 1, 3], [9, 40, 70]], marks=pytest.mark.small) for s, f in ((1, False), (4, True))],
    (1, True, np.arange(120).reshape(8, 15)), (4, False, np.arange(120).reshape(8, 15)),
    (16, False, np.full((9, 9), 30)), (16, True, np.full((9, 9), 30)), (4, True, [[63, 64, 65, 66, 200, 1000]])])
@pytest.mark.parametrize("share", [.15, 1.0])
def test_hiding_is_the_twins(gpu, samples, furry, counts, share):
    """Measured: 4e-7 of the pixel's light; a product of n factors is wrong by n roundings of 2^-24 at most."""
    rng, counts = np.random.default_rng(samples + furry), np.asarray(counts)
    fragments = piled(gpu, rng, counts, share=share)
    shape = (*counts.shape, samples)
    visible, fur, through = keys_at(rng, shape, .5), None, None
    visible[counts % 3 == 0] = NONE
    if furry:
        fur = keys_at(rng, shape, .6)
        through = np.where(rng.random(shape) < .7, rng.random(shape), 1).astype(np.float32)
        through[counts % 5 == 0] = 1
        through[counts % 7 == 0] *= np.float32(.01)            # hardly anything is left for strands behind
    before = told(fragments)
    arrays, after = resolved_bits(gpu, fragments, visible, through, fur)
    seen_weights = {(p, d << 32 | k): w for p, k, d, w in after.tolist()}
    for pixel in range(counts.size):
        y, x = divmod(pixel, counts.shape[1])
        pieces = {d << 32 | k: float(a) for _, k, d, a in before[before["pixel"] == pixel].tolist()}
        meant = twin.resolve(pieces, visible[y, x].tolist(), fur if fur is None else fur[y, x].tolist(),
                             through if through is None else through[y, x])
        mine = {key: w for (p, key), w in seen_weights.items() if p == pixel}
        assert mine.keys() == meant["weights"].keys()
        for key, weight in meant["weights"].items():
            assert abs(mine[key] - weight) < 2e-6
        on = visible[y, x] != NONE
        np.testing.assert_allclose(arrays["through"][y, x][on], meant["through"][on], rtol=0, atol=2e-6)
        assert abs(arrays["alpha"][y, x] - meant["alpha"]) < 2e-6
        assert abs(arrays["veil"][y, x] - meant["veil"]) < 2e-5    # a quotient of small ones
        assert abs(sum(mine.values()) + meant["body"] + meant["fur"] - meant["alpha"]) < 3e-6   # no light is lost
        # The winner fills as much as any, but for roundings.
        best = max([0, *meant["weights"].values(), meant["body"],
                    meant["fur"] * (fur is not None and (fur[y, x] != NONE).any())])
        key, fur_key = int(arrays["seen"][y, x, 0]), int(arrays["seen_fur"][y, x, 0])
        if fur_key != twin.NONE:
            assert fur_key == fur[y, x].min() and key == twin.NONE and meant["fur"] > best - 2e-6
        elif key != twin.NONE:
            is_body = bool(key & BODY)
            assert (meant["body"] if is_body else meant["weights"][key]) > best - 2e-6
            assert not is_body or key == visible[y, x].min()
        else:
            assert best < 2e-6


@pytest.mark.parametrize("n", [1, 60, 64])
def test_both_ways_of_sorting_give_the_same_bits(gpu, n):
    """The same pieces alone, and with so many without any area behind them that they are sorted by a heap."""
    results = []
    for more in (0, 1, 2, 5, 200):
        rng = np.random.default_rng(11)
        fragments = piled(gpu, rng, [[n]])
        listed, behind = fragments.list.get(), np.zeros((more, 2), np.uint64)
        behind[:, 0] = np.uint64(DEPTH_ONE - 5 << 32) | (np.arange(more, dtype=np.uint64) * np.uint64(2) + np.uint64(9000))
        listed = np.random.default_rng(more).permutation(np.concatenate([listed, behind]))
        ends = np.array([[[0xFFFFFFFF, n + more]]], np.uint32)
        fragments = coverage.Fragments(fragments.starts, gpu.upload(ends), gpu.upload(listed))
        arrays, pieces = resolved_bits(gpu, fragments, keys_at(rng, (1, 1, 4), .5))
        del arrays["used"]
        pieces = pieces[pieces["id"] < 9000]
        results.append((pieces.tobytes(), *(array.tobytes() for array in arrays.values())))
    assert len(set(results)) == 1 and len(results[0][0])


def test_any_order_gives_the_same_bits(gpu):
    results = set()
    for seed in range(6):
        rng = np.random.default_rng(12)
        fragments = piled(gpu, rng, [[5, 63, 64, 65, 200]], np.random.default_rng(seed))
        arrays, pieces = resolved_bits(gpu, fragments, keys_at(rng, (1, 5, 4), .3))
        results.add((pieces.tobytes(), *(array.tobytes() for array in arrays.values())))
    assert len(results) == 1


def layers(gpu, *pieces, visible=(twin.NONE,), through=None, fur=None):
    """`resolved_bits` of one pixel of pieces (depth, id, share), and its weights {id: share of light}."""
    listed = np.array([(d << 32 | k, int(np.float32(a).view(np.uint32))) for d, k, a in pieces], np.uint64).reshape(-1, 2)
    fragments = coverage.Fragments(
        gpu.upload(np.zeros((1, 1), np.uint32)), gpu.upload(np.array([[[0xFFFFFFFF, len(pieces)]]], np.uint32)),
        gpu.upload(listed))
    shells = (None, None) if fur is None else (np.array([[through]], np.float32), np.array([[fur]], np.uint64))
    arrays, left = resolved_bits(gpu, fragments, np.array([[visible]], np.uint64), *shells)
    return arrays, dict(zip(left["id"].tolist(), left["share"].tolist()))


def body(depth):
    return depth << 32 | BODY


def test_strands_hide_what_is_behind_them(gpu):
    arrays, weights = layers(gpu, (30, 20, .5), (10, 10, .25), (20, 0, .5))
    assert weights == {10: .25, 0: .375, 20: .1875} and arrays["alpha"][0, 0] == 1 - .1875
    assert int(arrays["seen"][0, 0, 0]) == 20 << 32


def test_pieces_of_a_strand_lie_beside_each_other(gpu):
    """Also with another strand between them; what goes beyond the whole pixel counts no more."""
    arrays, weights = layers(gpu, (10, 4, .25), (20, 50, .5), (30, 5, .25), (40, 6, .75))
    assert weights == {4: .25, 50: .375, 5: .125, 6: .25} and arrays["alpha"][0, 0] == 1


def test_equal_depths_go_by_number(gpu):
    arrays, weights = layers(gpu, (10, 8, .5), (10, 4, .5), (10, 0, .5))
    assert weights == {0: .5, 4: .25, 8: .125} and int(arrays["seen"][0, 0, 0]) == 10 << 32
    arrays, weights = layers(gpu, (10, 8, .5), (10, 4, .5), visible=[body(10)])      # the body first
    assert weights == {} and arrays["through"][0, 0, 0] == 1


def test_a_tie_goes_to_the_body_and_then_to_the_nearest(gpu):
    arrays, weights = layers(gpu, (10, 8, .5), (20, 0, 1), visible=[body(15), twin.NONE])
    assert weights == {8: .5, 0: .25} and int(arrays["seen"][0, 0, 0]) == 10 << 32 | 8
    arrays, _ = layers(gpu, (10, 8, .5), (20, 0, 1), visible=[body(15)])
    assert int(arrays["seen"][0, 0, 0]) == body(15)


def test_where_hardly_any_light_is_left_the_last_one_takes_it(gpu):
    wall = [(10 + i, 3 * i, .5) for i in range(30)]
    arrays, weights = layers(gpu, *wall, visible=[body(900)])
    assert sorted(weights) == [3 * i for i in range(8)] and arrays["used"][0, 0] == 8
    assert weights[21] == 2 * 2.0**-8 and sum(weights.values()) == arrays["alpha"][0, 0] == 1
    assert arrays["through"][0, 0, 0] == 0


@pytest.mark.parametrize("near", [0, 1, 3, 4])
def test_or_the_body_behind_them(gpu, near):
    """Samples that the body fills are opaque, also where it leaves too little room for strands."""
    visible = [body(50)] * near + [body(70)] * (4 - near)
    wall = [(10 + i, 3 * i, .5) for i in range(6)]
    arrays, weights = layers(gpu, *wall, (60, 90, .5), (65, 93, .5), visible=visible)
    assert arrays["alpha"][0, 0] == 1
    assert sum(weights.values()) + arrays["through"][0, 0].sum() / 4 == 1


def test_body_before_among_and_behind_strands(gpu):
    pieces = (10, 0, .5), (20, 10, .5), (30, 20, .5)
    for at, weights, through in ((5, {}, 1), (15, {0: .5}, .5), (25, {0: .5, 10: .25}, .25),
                                 (35, {0: .5, 10: .25, 20: .125}, .125)):
        arrays, mine = layers(gpu, *pieces, visible=[body(at)])
        assert mine == weights and arrays["through"][0, 0, 0] == through and arrays["alpha"][0, 0] == 1


@pytest.mark.parametrize("samples", [4, 16])
def test_samples_of_the_body_hide_their_share(gpu, samples):
    half = [body(15), twin.NONE] * (samples // 2)
    arrays, weights = layers(gpu, (10, 0, .5), (20, 10, .5), visible=half)
    assert weights == {0: .5, 10: .125} and arrays["alpha"][0, 0] == 1 - .125
    assert arrays["through"][0, 0].tolist()[::2] == [.5] * (samples // 2)


def test_shells_hide_strands_and_are_hidden(gpu):
    face = 15 << 32 | 3
    arrays, weights = layers(gpu, (10, 0, .5), (20, 10, .5), fur=[face], through=[.5])
    assert weights == {0: .5, 10: .125} and arrays["veil"][0, 0] == .5 and arrays["alpha"][0, 0] == 1 - .125
    assert int(arrays["seen"][0, 0, 0]) == 10 << 32 and int(arrays["seen_fur"][0, 0, 0]) == twin.NONE
    arrays, weights = layers(gpu, (10, 0, .125), (20, 10, .5), fur=[face], through=[.25], visible=[body(40)])
    assert arrays["veil"][0, 0] == .875 and arrays["through"][0, 0, 0] == .875 * .25 * .5
    assert int(arrays["seen"][0, 0, 0]) == twin.NONE and int(arrays["seen_fur"][0, 0, 0]) == face
