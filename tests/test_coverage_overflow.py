"""Thousands of strands in a tile: the bits of pieces in exact order, wherever they wait, and no segment drawn again."""

import attrs
import numpy as np
import pytest
from support.coverage import LIGHT, NONE, SETTINGS, ball, counted, hidden, pieces_of
from support.stages import strands_on
from support.views import pack, perspective

import clfur
from clfur import layout
from clfur.render import OUTPUTS
from clfur.stages import coverage, masks
from clfur.twin import coverage as twin

BODY, SLOTS, TILE = (layout.CONSTANTS[name] for name in ("BODY", "SLOTS", "TILE"))
pytestmark = pytest.mark.usefixtures("plain")
LONG, SHORT, WITHOUT = "long", "short", "without"   # lists


def crowd(n, depth=.6, width=.02, seed=1):
    """n strands of two segments about the middle of a picture: [n, 3, 4]."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(n, 3, 3)) * (.08, .08, depth / 8)
    steps[:, 0] = rng.uniform(-1, 1, (n, 3)) * (.6, .6, depth / 2)
    return np.concatenate([steps.cumsum(1), np.full((n, 3, 1), width)], 2)


def let(monkeypatch, lists):
    """Lists are as short as they may be, or there are none."""
    least, most = {LONG: (2048, 1 << 18), SHORT: (256, 256), WITHOUT: (1 << 50, 1 << 50)}[lists]
    monkeypatch.setattr(coverage, "LEAST_LEFT", least)
    monkeypatch.setattr(coverage, "MOST_LEFT", most)


def watched(gpu, monkeypatch):
    """How often segments of tiles are gone through once more from here on, launch by launch: a list that grows."""
    again, launch = [], gpu.launch

    def launched(name, size, /, **arguments):
        launch(name, size, **arguments)
        if "again" in arguments:
            again.append(int(gpu.download(arguments["again"])[0]))
            assert not gpu.download(arguments["busy"]).any()   # each tile gave its list back
    monkeypatch.setattr(gpu, "launch", launched)
    return again


def covered(gpu, view, strands, visible, kernels=coverage):
    """(`Segments`, {name: what is seen of strands, as ``hidden`` tells it})."""
    points, spans = pack(strands)
    _, segments = counted(gpu, view, strands_on(gpu, points, spans), gpu.upload(visible))
    result = coverage.nothing(gpu, visible)
    kernels.cover(gpu, view, gpu.upload(visible), segments, result)
    return segments, {"alpha": result.alpha.get(), "front": result.front.get()[..., 0],
                      "body_transmittance": result.body_transmittance.get()}


@pytest.mark.parametrize("n, depth, width", [
    pytest.param(80, .6, .1, marks=pytest.mark.small), (3000, .6, .004), (3000, 0, .004), (3000, .6, 1e-4)],
    ids=["few", "many", "one depth", "thin"])
@pytest.mark.parametrize("lists", [LONG, SHORT, WITHOUT])
def test_the_bits_are_those_of_pieces_in_order(gpu, monkeypatch, n, depth, width, lists):
    """Against a kernel that takes all pieces of a pixel as `pieces_of` tells them."""
    let(monkeypatch, lists)
    view, visible = perspective(5, 7, 4, eye=(0, 0, 2.2)), np.full((7, 5, 4), NONE)
    visible[3, :, :3] = np.uint64(int(layout.CONSTANTS["DEPTH_ONE"] * .96) << 32 | BODY)
    segments, seen = covered(gpu, view, crowd(n, depth, width), visible)
    pieces = pieces_of(gpu, view, segments)
    assert np.bincount(pieces["pixel"]).max() > 2 * SLOTS or n < 100
    meant = hidden(gpu, pieces, visible)
    for name, image in seen.items():
        np.testing.assert_array_equal(image, meant[name], err_msg=name)


def test_they_are_the_twins(gpu):
    """Exactly sorted, in float64.  Measured: 1e-7; each of some thousand factors is rounded."""
    view, visible = perspective(3, 3, 1, eye=(0, 0, 2.2)), np.full((3, 3, 1), NONE)
    segments, seen = covered(gpu, view, crowd(4000, width=.002), visible)
    pieces = pieces_of(gpu, view, segments)
    for pixel in range(9):
        here = pieces[pieces["pixel"] == pixel]
        keys = (here["depth"] << 32 | here["id"]).tolist()
        meant = twin.resolve(dict(zip(keys, here["share"].astype(float).tolist())), [twin.NONE])
        y, x = divmod(pixel, 3)
        assert len(keys) > 100 and meant["alpha"] > .1
        assert abs(seen["alpha"][y, x] - meant["alpha"]) < 1e-5
        weight = meant["weights"].get(int(seen["front"][y, x]), 0)
        assert weight > max(meant["weights"].values()) - 1e-5


@pytest.mark.parametrize("lists", [LONG, SHORT, WITHOUT])
@pytest.mark.parametrize("kernels", [coverage, masks], ids=["plain", "masks"])
def test_any_order_of_strands_gives_the_same_bits(gpu, monkeypatch, kernels, lists):
    view, visible, strands = perspective(8, 8, 4, eye=(0, 0, 2.2)), np.full((8, 8, 4), NONE), crowd(2500, width=.004)
    results = []
    for order, kind in (np.arange(2500), LONG), (np.random.default_rng(2).permutation(2500), lists):
        let(monkeypatch, kind)
        _, seen = covered(gpu, view, strands[order], visible, kernels)
        back = np.repeat(order * 3, 3) + np.tile(np.arange(3), 2500)   # points as they were
        ids = (seen["front"] & np.uint64(0xFFFFFFFF)).astype(np.int64)
        there = ids != 0xFFFFFFFF
        seen["front"] = np.where(there, back[np.where(there, ids, 0)], -1)
        results.append(seen)
    for name, image in results[0].items():
        np.testing.assert_array_equal(results[1][name], image, err_msg=name)


@pytest.mark.parametrize("depth, width", [(.6, .004), (0, .004), (.6, 1e-4)], ids=["many", "one depth", "thin"])
def test_no_segment_is_drawn_again(gpu, monkeypatch, depth, width):
    """However many share a tile: work grows as they do.  Without lists all are, for 31 pieces that wait in a pixel."""
    if max(gpu.lanes, gpu.hinted) == 1:
        pytest.skip("pixels go one by one")
    again, view, visible = watched(gpu, monkeypatch), perspective(8, 8, 1, eye=(0, 0, 2.2)), np.full((8, 8, 1), NONE)
    for lists in LONG, SHORT, WITHOUT:
        let(monkeypatch, lists)
        for n in 500, 4000:
            segments, _ = covered(gpu, view, crowd(n, depth, width), visible)
    (few, many), (_, short), (_, without) = again[:2], again[2:4], again[4:]
    # A list holds as many pieces as a tile's segments are.  All at one depth wait together: each time the nearer half
    # of a list is done, or more, as segments of the same depth come in any order.
    most = 1 if depth else 2 * len(pieces_of(gpu, view, segments)["pixel"]) // segments.longest
    assert not few and many <= most < 4
    assert short > 20 and without > 5


def test_a_list_is_for_one_tile_at_a_time(gpu, monkeypatch):
    """One list, and some tiles: those that find none do without."""
    picture, known = {}, coverage._overflows
    view, visible = perspective(31, 23, 1, eye=(0, 0, 2.2)), np.full((23, 31, 1), NONE)
    for tiles in 1, 12:
        monkeypatch.setattr(coverage, "_overflows", lambda gpu, longest, _, kernels, n=tiles: known(
            gpu, longest, n, kernels))
        picture[tiles] = covered(gpu, view, crowd(9000, width=.004), visible)[1]
    for name, image in picture[1].items():
        np.testing.assert_array_equal(image, picture[12][name], err_msg=name)


@pytest.mark.parametrize("settings", [
    SETTINGS, attrs.evolve(SETTINGS, masks=4, samples=16), attrs.evolve(SETTINGS, shadows="off", samples=1)],
    ids=["default", "masks", "off"])
@pytest.mark.parametrize("with_shells", [False, True])
def test_a_picture_keeps_its_bits(gpu, monkeypatch, settings, with_shells):
    """Light as well, which waits for what is seen."""
    hair = clfur.Strands(roots=4000, types=clfur.HairType(segments=4, segment_length=.08, width=.004))
    fur = [hair, clfur.Shells(length=.1, frequency=6, layers=4)] if with_shells else hair
    scene = clfur.Scene(ball(.8, 1), fur, clfur.Camera(size=(13, 11)), light=LIGHT)
    frames = {}
    for lists in LONG, SHORT, WITHOUT:
        let(monkeypatch, lists)
        gpu.forget()
        frames[lists] = clfur.draw(scene, gpu, settings, tuple(OUTPUTS), hashes=True)
    for lists in SHORT, WITHOUT:
        assert frames[lists].hashes == frames[LONG].hashes
        for name, image in frames[LONG].images.items():
            np.testing.assert_array_equal(frames[lists].images[name], image, err_msg=name)
