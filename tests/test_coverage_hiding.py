"""Pieces of strands in a pixel, one behind the other: the twin's values on every device, and the laws of order."""

import numpy as np
import pytest
from support.coverage import NONE, PIECE, hidden

from clfur import layout
from clfur.twin import coverage as twin

DEPTH_ONE, BODY = layout.CONSTANTS["DEPTH_ONE"], layout.CONSTANTS["BODY"]
pytestmark = pytest.mark.usefixtures("plain")


def piled(rng, counts, order=None, spread=1 << 20, share=.15):
    """Pieces made up: ``counts`` [rows, width] in each pixel, some of one strand, some at equal depths."""
    counts = np.asarray(counts)
    n = int(counts.sum())
    pieces = np.zeros(n, PIECE)
    pieces["pixel"] = np.repeat(np.arange(counts.size), counts.ravel())
    pieces["id"] = np.concatenate([rng.permutation(4 * c)[:c] for c in counts.ravel()])
    pieces["depth"] = (DEPTH_ONE // 2) + rng.integers(0, 200, n) * (spread // 200)
    pieces["share"] = share * rng.random(n) ** 2
    return pieces if order is None else pieces[order.permutation(n)]


def keys_at(rng, shape, share, spread=1 << 20):
    """Random keys of body or shells about the depth of `piled` ones; nothing but in a share of the samples."""
    depths = DEPTH_ONE // 2 + rng.integers(-spread // 4, spread, shape)
    return np.where(rng.random(shape) < share, depths.astype(np.uint64) << np.uint64(32) | np.uint64(BODY | 5), NONE)


@pytest.mark.parametrize("samples, has_shells, counts", [
    *[pytest.param(s, f, [[0, 1, 3], [9, 40, 70]], marks=pytest.mark.small) for s, f in ((1, False), (4, True))],
    (1, True, np.arange(120).reshape(8, 15)), (4, False, np.arange(120).reshape(8, 15)),
    (16, False, np.full((9, 9), 30)), (16, True, np.full((9, 9), 30)), (4, True, [[63, 64, 65, 66, 200, 1000]])])
@pytest.mark.parametrize("share", [.15, 1.0])
def test_hiding_is_the_twins(gpu, samples, has_shells, counts, share):
    """Measured: 8e-8 of the pixel's light; a product of n factors is wrong by n roundings of 2^-24 at most."""
    rng, counts = np.random.default_rng(samples + has_shells), np.asarray(counts)
    pieces = piled(rng, counts, share=share)
    shape = (*counts.shape, samples)
    visible, front, transmittance = keys_at(rng, shape, .5), None, None   # these of shells
    visible[counts % 3 == 0] = NONE
    if has_shells:
        front = keys_at(rng, shape, .6)
        transmittance = np.where(rng.random(shape) < .7, rng.random(shape), 1).astype(np.float32)
        transmittance[counts % 5 == 0] = 1
        transmittance[counts % 7 == 0] *= np.float32(.01)            # hardly anything is left for strands behind
    colors = rng.random((len(pieces), 3)).astype(np.float32) * np.float32([1, 1, 0])
    colors = (colors.astype(np.float32).view(np.uint32) & np.uint32(0x7FFFFC00)).view(np.float32)   # as they are packed
    arrays = hidden(gpu, pieces, visible, transmittance, front, colors, behind=1)
    for pixel in range(counts.size):
        y, x = divmod(pixel, counts.shape[1])
        here = np.flatnonzero(pieces["pixel"] == pixel)
        keys = {int(d) << 32 | int(k): i for i, (k, d) in zip(here, pieces[here][["id", "depth"]].tolist())}
        meant = twin.resolve({key: float(pieces["share"][i]) for key, i in keys.items()}, visible[y, x].tolist(),
                             front if front is None else front[y, x].tolist(),
                             transmittance if transmittance is None else transmittance[y, x])
        light = sum((w * colors[keys[key]] for key, w in meant["weights"].items()), np.zeros(3))
        through = meant["strand_transmittance"] if has_shells else 0
        np.testing.assert_allclose(arrays["image"][y, x, :3], light + through, rtol=0,
                                   atol=2e-5 if has_shells else 2e-6)   # of shells it is a quotient of small ones
        on = visible[y, x] != NONE
        np.testing.assert_allclose(arrays["body_transmittance"][y, x][on], meant["body_transmittance"][on],
                                   rtol=0, atol=2e-6)
        assert abs(arrays["alpha"][y, x] - meant["alpha"]) < 2e-6
        assert arrays["image"][y, x, 3] == arrays["alpha"][y, x]
        # The winner fills as much as any, but for roundings.
        best = max([0, *meant["weights"].values(), meant["body"],
                    meant["shells"] * (front is not None and (front[y, x] != NONE).any())])
        key, shell_key = int(arrays["front"][y, x]), int(arrays["shell_front"][y, x]) if has_shells else twin.NONE
        if shell_key != twin.NONE:
            assert shell_key == front[y, x].min() and key == twin.NONE and meant["shells"] > best - 2e-6
        elif key != twin.NONE:
            is_body = bool(key & BODY)
            assert (meant["body"] if is_body else meant["weights"][key]) > best - 2e-6
            assert not is_body or key == visible[y, x].min()
        else:
            assert best < 2e-6


@pytest.mark.parametrize("n", [1, 31, 32, 33, 64])
def test_however_many_wait_the_bits_are_the_same(gpu, n):
    """The same pieces alone, and with some without any area behind them."""
    results = []
    for more in (0, 1, 2, 5, 200):
        rng = np.random.default_rng(11)
        pieces, behind = piled(rng, [[n]]), np.zeros(more, PIECE)
        behind["depth"], behind["id"] = DEPTH_ONE - 5, 9000 + 2 * np.arange(more)
        pieces = np.random.default_rng(more).permutation(np.concatenate([pieces, behind]))
        arrays = hidden(gpu, pieces, keys_at(rng, (1, 1, 4), .5), light=pieces["id"][:, None] * np.ones(3))
        results.append(tuple(array.tobytes() for array in arrays.values()))
    assert len(set(results)) == 1 and np.any(arrays["image"])


def test_any_order_gives_the_same_bits(gpu):
    results = set()
    for seed in range(6):
        rng = np.random.default_rng(12)
        pieces = piled(rng, [[5, 31, 32, 33, 63, 64, 65, 200]], np.random.default_rng(seed))
        arrays = hidden(gpu, pieces, keys_at(rng, (1, 8, 4), .3), light=pieces["id"][:, None] * np.ones(3))
        results.add(tuple(array.tobytes() for array in arrays.values()))
    assert len(results) == 1


def layers(gpu, *pieces, visible=(twin.NONE,), shell_transmittance=None, shell_front=None):
    """What `hidden` gives of a pixel of pieces (depth, id, share), and the weights of those that are seen {id: share of
    light}: a row of such pixels, in each of which another piece shines."""
    n = len(pieces)
    listed = np.zeros((n, n), PIECE)
    listed["pixel"] = np.arange(n)[:, None]
    for name, values in zip(("depth", "id", "share"), zip(*pieces)):
        listed[name] = values
    row = [np.array([[visible] * n], np.uint64)]
    if shell_front is not None:
        row += [np.array([[shell_transmittance] * n], np.float32), np.array([[shell_front] * n], np.uint64)]
    arrays = hidden(gpu, listed.ravel(), *row, light=np.eye(n).reshape(-1, 1) * [1, 0, 0], behind=1)
    arrays["strand_transmittance"] = arrays["image"][..., 2]
    seen = arrays["image"][0, :, 0] - arrays["strand_transmittance"][0]
    weights = {k: w for (_, k, _), w in zip(pieces, seen.tolist()) if w}
    return arrays, weights


def body(depth):
    return depth << 32 | BODY


def test_strands_hide_what_is_behind_them(gpu):
    arrays, weights = layers(gpu, (30, 20, .5), (10, 10, .25), (20, 0, .5))
    assert weights == {10: .25, 0: .375, 20: .1875} and arrays["alpha"][0, 0] == 1 - .1875
    assert int(arrays["front"][0, 0]) == 20 << 32


def test_pieces_of_a_strand_lie_beside_each_other(gpu):
    """Also with another strand between them; what goes beyond the whole pixel counts no more."""
    arrays, weights = layers(gpu, (10, 4, .25), (20, 50, .5), (30, 5, .25), (40, 6, .75))
    assert weights == {4: .25, 50: .375, 5: .125, 6: .25} and arrays["alpha"][0, 0] == 1


def test_equal_depths_go_by_number(gpu):
    arrays, weights = layers(gpu, (10, 8, .5), (10, 4, .5), (10, 0, .5))
    assert weights == {0: .5, 4: .25, 8: .125} and int(arrays["front"][0, 0]) == 10 << 32
    arrays, weights = layers(gpu, (10, 8, .5), (10, 4, .5), visible=[body(10)])      # the body first
    assert weights == {} and arrays["body_transmittance"][0, 0, 0] == 1


def test_a_tie_goes_to_the_body_and_then_to_the_nearest(gpu):
    arrays, weights = layers(gpu, (10, 8, .5), (20, 0, 1), visible=[body(15), twin.NONE])
    assert weights == {8: .5, 0: .25} and int(arrays["front"][0, 0]) == 10 << 32 | 8
    arrays, _ = layers(gpu, (10, 8, .5), (20, 0, 1), visible=[body(15)])
    assert int(arrays["front"][0, 0]) == body(15)


def test_where_hardly_any_light_is_left_the_last_one_takes_it(gpu):
    wall = [(10 + i, 3 * i, .5) for i in range(30)]
    arrays, weights = layers(gpu, *wall, visible=[body(900)])
    assert sorted(weights) == [3 * i for i in range(8)]
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
    assert int(arrays["front"][0, 0]) == 10 << 32 and int(arrays["shell_front"][0, 0]) == twin.NONE
    arrays, weights = layers(gpu, (10, 0, .125), (20, 10, .5), shell_front=[face],
                             shell_transmittance=[.25], visible=[body(40)])
    assert arrays["strand_transmittance"][0, 0] == .875 and arrays["body_transmittance"][0, 0, 0] == .875 * .25 * .5
    assert int(arrays["front"][0, 0]) == twin.NONE and int(arrays["shell_front"][0, 0]) == face
