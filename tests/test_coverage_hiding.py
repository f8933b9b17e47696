"""Pieces of strands in a pixel, one behind the other: the twin's values on every device, and the laws of order."""

import dataclasses

import numpy as np
import pytest
from support.coverage import NONE, pieces_of

from clfur import layout
from clfur.stages import coverage
from clfur.twin import coverage as twin

DEPTH_ONE, BODY = layout.CONSTANTS["DEPTH_ONE"], layout.CONSTANTS["BODY"]


def piled(gpu, rng, counts, order=None, spread=1 << 20, share=.15):
    """`Fragments` made up: ``counts`` [rows, width] in each pixel, some of one strand, some at equal depths."""
    counts = np.asarray(counts)
    ends = counts.cumsum().reshape(counts.shape)
    n = int(counts.sum())
    ids = np.concatenate([rng.permutation(4 * c)[:c] for c in counts.ravel()]).astype(np.uint64)
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


def resolved_bits(gpu, fragments, visible, shell_transmittance=None, shell_front=None):
    """What `resolve` gives: {name: array} but the weights, and the pieces that are seen, with their weights."""
    both = (None, None) if shell_front is None else (gpu.upload(shell_transmittance), gpu.upload(shell_front))
    resolved = coverage.resolve(gpu, gpu.upload(visible), fragments, *both)
    arrays = {f.name: getattr(resolved, f.name).get() for f in dataclasses.fields(resolved) if f.name != "weights"}
    return arrays, pieces_of(fragments, resolved)


@pytest.mark.parametrize("samples, has_shells, counts", [
    *[pytest.param(s, f, [[0, 1, 3], [9, 40, 70]], marks=pytest.mark.small) for s, f in ((1, False), (4, True))],
    (1, True, np.arange(120).reshape(8, 15)), (4, False, np.arange(120).reshape(8, 15)),
    (16, False, np.full((9, 9), 30)), (16, True, np.full((9, 9), 30)), (4, True, [[63, 64, 65, 66, 200, 1000]])])
@pytest.mark.parametrize("share", [.15, 1.0])
def test_hiding_is_the_twins(gpu, samples, has_shells, counts, share):
    """Measured: 8e-8 of the pixel's light; a product of n factors is wrong by n roundings of 2^-24 at most."""
    rng, counts = np.random.default_rng(samples + has_shells), np.asarray(counts)
    fragments = piled(gpu, rng, counts, share=share)
    shape = (*counts.shape, samples)
    visible, front, transmittance = keys_at(rng, shape, .5), None, None   # these of shells
    visible[counts % 3 == 0] = NONE
    if has_shells:
        front = keys_at(rng, shape, .6)
        transmittance = np.where(rng.random(shape) < .7, rng.random(shape), 1).astype(np.float32)
        transmittance[counts % 5 == 0] = 1
        transmittance[counts % 7 == 0] *= np.float32(.01)            # hardly anything is left for strands behind
    before = pieces_of(fragments)
    arrays, after = resolved_bits(gpu, fragments, visible, transmittance, front)
    weights = {(p, d << 32 | k): w for p, k, d, w in after.tolist()}
    for pixel in range(counts.size):
        y, x = divmod(pixel, counts.shape[1])
        pieces = {d << 32 | k: float(a) for _, k, d, a in before[before["pixel"] == pixel].tolist()}
        meant = twin.resolve(pieces, visible[y, x].tolist(), front if front is None else front[y, x].tolist(),
                             transmittance if transmittance is None else transmittance[y, x])
        mine = {key: w for (p, key), w in weights.items() if p == pixel}
        assert mine.keys() == meant["weights"].keys()
        for key, weight in meant["weights"].items():
            assert abs(mine[key] - weight) < 1e-6
        on = visible[y, x] != NONE
        np.testing.assert_allclose(arrays["body_transmittance"][y, x][on], meant["body_transmittance"][on],
                                   rtol=0, atol=2e-6)
        assert abs(arrays["alpha"][y, x] - meant["alpha"]) < 2e-6
        off = arrays["strand_transmittance"][y, x] - meant["strand_transmittance"]
        assert abs(off) < 2e-5                                     # a quotient of small ones
        assert abs(sum(mine.values()) + meant["body"] + meant["shells"] - meant["alpha"]) < 3e-6   # no light is lost
        # The winner fills as much as any, but for roundings.
        best = max([0, *meant["weights"].values(), meant["body"],
                    meant["shells"] * (front is not None and (front[y, x] != NONE).any())])
        key, shell_key = int(arrays["front"][y, x, 0]), int(arrays["shell_front"][y, x, 0])
        if shell_key != twin.NONE:
            assert shell_key == front[y, x].min() and key == twin.NONE and meant["shells"] > best - 2e-6
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
        listed, behind = fragments.areas.get(), np.zeros((more, 2), np.uint64)
        behind[:, 0] = (DEPTH_ONE - 5 << 32) + 9000 + 2 * np.arange(more)
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


def layers(gpu, *pieces, visible=(twin.NONE,), shell_transmittance=None, shell_front=None):
    """`resolved_bits` of one pixel of pieces (depth, id, share), and its weights {id: share of light}."""
    listed = np.array([(d << 32 | k, int(np.float32(a).view(np.uint32))) for d, k, a in pieces], np.uint64)
    listed = listed.reshape(-1, 2)
    fragments = coverage.Fragments(
        gpu.upload(np.zeros((1, 1), np.uint32)), gpu.upload(np.array([[[0xFFFFFFFF, len(pieces)]]], np.uint32)),
        gpu.upload(listed))
    shells = () if shell_front is None else (np.array([[shell_transmittance]], np.float32),
                                             np.array([[shell_front]], np.uint64))
    arrays, left = resolved_bits(gpu, fragments, np.array([[visible]], np.uint64), *shells)
    return arrays, dict(zip(left["id"].tolist(), left["share"].tolist()))


def body(depth):
    return depth << 32 | BODY


def test_strands_hide_what_is_behind_them(gpu):
    arrays, weights = layers(gpu, (30, 20, .5), (10, 10, .25), (20, 0, .5))
    assert weights == {10: .25, 0: .375, 20: .1875} and arrays["alpha"][0, 0] == 1 - .1875
    assert int(arrays["front"][0, 0, 0]) == 20 << 32


def test_pieces_of_a_strand_lie_beside_each_other(gpu):
    """Also with another strand between them; what goes beyond the whole pixel counts no more."""
    arrays, weights = layers(gpu, (10, 4, .25), (20, 50, .5), (30, 5, .25), (40, 6, .75))
    assert weights == {4: .25, 50: .375, 5: .125, 6: .25} and arrays["alpha"][0, 0] == 1


def test_equal_depths_go_by_number(gpu):
    arrays, weights = layers(gpu, (10, 8, .5), (10, 4, .5), (10, 0, .5))
    assert weights == {0: .5, 4: .25, 8: .125} and int(arrays["front"][0, 0, 0]) == 10 << 32
    arrays, weights = layers(gpu, (10, 8, .5), (10, 4, .5), visible=[body(10)])      # the body first
    assert weights == {} and arrays["body_transmittance"][0, 0, 0] == 1


def test_a_tie_goes_to_the_body_and_then_to_the_nearest(gpu):
    arrays, weights = layers(gpu, (10, 8, .5), (20, 0, 1), visible=[body(15), twin.NONE])
    assert weights == {8: .5, 0: .25} and int(arrays["front"][0, 0, 0]) == 10 << 32 | 8
    arrays, _ = layers(gpu, (10, 8, .5), (20, 0, 1), visible=[body(15)])
    assert int(arrays["front"][0, 0, 0]) == body(15)


def test_where_hardly_any_light_is_left_the_last_one_takes_it(gpu):
    wall = [(10 + i, 3 * i, .5) for i in range(30)]
    arrays, weights = layers(gpu, *wall, visible=[body(900)])
    assert sorted(weights) == [3 * i for i in range(8)] and arrays["used"][0, 0] == 8
    assert weights[21] == 2 * 2.0**-8 and sum(weights.values()) == arrays["alpha"][0, 0] == 1
    assert arrays["body_transmittance"][0, 0, 0] == 0


@pytest.mark.parametrize("near", [0, 1, 3, 4])
def test_or_the_body_behind_them(gpu, near):
    """Samples that the body fills are opaque, also where it leaves too little room for strands."""
    visible = [body(50)] * near + [body(70)] * (4 - near)
    wall = [(10 + i, 3 * i, .5) for i in range(6)]
    arrays, weights = layers(gpu, *wall, (60, 90, .5), (65, 93, .5), visible=visible)
    assert arrays["alpha"][0, 0] == 1
    assert sum(weights.values()) + arrays["body_transmittance"][0, 0].sum() / 4 == 1


def test_body_before_among_and_behind_strands(gpu):
    pieces = (10, 0, .5), (20, 10, .5), (30, 20, .5)
    for at, weights, transmittance in ((5, {}, 1), (15, {0: .5}, .5), (25, {0: .5, 10: .25}, .25),
                                 (35, {0: .5, 10: .25, 20: .125}, .125)):
        arrays, mine = layers(gpu, *pieces, visible=[body(at)])
        assert mine == weights and arrays["body_transmittance"][0, 0, 0] == transmittance and arrays["alpha"][0, 0] == 1


@pytest.mark.parametrize("samples", [4, 16])
def test_samples_of_the_body_hide_their_share(gpu, samples):
    half = [body(15), twin.NONE] * (samples // 2)
    arrays, weights = layers(gpu, (10, 0, .5), (20, 10, .5), visible=half)
    assert weights == {0: .5, 10: .125} and arrays["alpha"][0, 0] == 1 - .125
    assert arrays["body_transmittance"][0, 0].tolist()[::2] == [.5] * (samples // 2)


def test_shells_hide_strands_and_are_hidden(gpu):
    face = 15 << 32 | 3
    arrays, weights = layers(gpu, (10, 0, .5), (20, 10, .5), shell_front=[face], shell_transmittance=[.5])
    assert weights == {0: .5, 10: .125} and arrays["alpha"][0, 0] == 1 - .125
    assert arrays["strand_transmittance"][0, 0] == .5
    assert int(arrays["front"][0, 0, 0]) == 10 << 32 and int(arrays["shell_front"][0, 0, 0]) == twin.NONE
    arrays, weights = layers(gpu, (10, 0, .125), (20, 10, .5), shell_front=[face],
                             shell_transmittance=[.25], visible=[body(40)])
    assert arrays["strand_transmittance"][0, 0] == .875 and arrays["body_transmittance"][0, 0, 0] == .875 * .25 * .5
    assert int(arrays["front"][0, 0, 0]) == twin.NONE and int(arrays["shell_front"][0, 0, 0]) == face
