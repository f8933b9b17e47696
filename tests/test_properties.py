"""What holds for whatever the host's pure functions are given: hypothesis looks for what breaks it.

It looks at the same examples in every run (conftest.py), so that a failure is no chance and comes back.
"""

import math
from itertools import pairwise
from pathlib import Path

import click
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from support.views import CUBE

import clfur
from clfur import budget, layout
from clfur.color import linear_to_srgb, srgb_to_linear
from clfur.command import types
from clfur.device.team import shares_of
from clfur.files.images import png_bytes
from clfur.files.output import output_path
from clfur.pipeline import dividing
from clfur.pipeline.views import Rig, band_of, columns_of, grid_of, light_view_of
from clfur.scene import Camera, Curves, Light, Mesh, Scene, Shells, checks, extent

COORDINATES = st.floats(-1e6, 1e6, width=32)
PACES = st.lists(st.floats(1e-9, 1e12), min_size=1, max_size=8)


# --- parts, bands and shares ----------------------------------------------------------------------------------


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 3)), max_size=40), st.integers(1, 30), st.integers(1, 12))
@example([(3, 0), (1, 0), (1, 0), (15, 0), (1, 0), (0, 0)], 8, 1)
def test_runs_are_as_long_as_every_limit_lets_them(counts, most, fewest):
    """They hold all in order, none is empty, and only what is alone exceeds a limit."""
    limits = [(dividing.before([count[k] for count in counts]), limit) for k, limit in enumerate((most, fewest))]
    runs = dividing.runs(*limits)
    assert [n for first, end in runs for n in range(first, end)] == list(range(len(counts)))

    def fits(first, end):
        return all(sums[end] - sums[first] <= limit for sums, limit in limits)
    for first, end in runs:
        assert end - first == 1 or fits(first, end)
        assert end == len(counts) or not fits(first, end + 1)


@given(st.integers(0, 200), st.integers(0, 200), st.integers(1, 300))
def test_pieces_hold_all_in_order(first, end, most):
    pieces = dividing.pieces(first, end, most)
    assert [n for a, b in pieces for n in range(a, b)] == list(range(first, end))
    assert all(0 < b - a <= most for a, b in pieces) and len(pieces) == -(-max(end - first, 0) // most)


@given(st.integers(-10, 5000), st.dictionaries(st.sampled_from("abcdef"), st.integers(0, 2000), min_size=1))
@example(100, {"a": 10, "b": 20, "c": 30})
@example(100, {"a": 10, "b": 200, "c": 300})
@example(-5, {"a": 10})
def test_memory_is_shared_fairly(room, need):
    """No more than there is, none more than it needs; and who goes short has no less than the others, but a byte."""
    given_to = dividing.share(room, need)
    assert given_to.keys() == need.keys() and all(0 <= given_to[name] <= need[name] for name in need)
    assert sum(given_to.values()) <= max(room, 0)
    short = [name for name in need if given_to[name] < need[name]]
    assert not short or sum(given_to.values()) > room - len(need)
    assert all(given_to[name] >= max(given_to.values()) - len(need) for name in short)


@given(st.integers(0, 10**9), st.integers(0, 10**9), PACES)
def test_shares_cover_all_once_in_proportion_to_speed(first, n, paces):
    shares = shares_of(first, first + n, paces)
    assert shares[0][0] == first and shares[-1][1] == first + n
    assert all(one[1] == other[0] for one, other in pairwise(shares))
    for (begin, end), pace in zip(shares, paces):
        assert end >= begin and abs(end - begin - n * pace / sum(paces)) <= 1 + 1e-6 * n


@given(st.integers(1, 300), st.data())
def test_a_band_is_the_view_with_other_rows(height, data):
    camera = Camera(size=(7, height))
    view = Rig.of(Scene(fur=Curves(CUBE), camera=camera)).view
    first, end = sorted(data.draw(st.tuples(st.integers(0, height), st.integers(0, height))))
    band = band_of(view, first, end)
    assert band["rows"].tolist()[:2] == [first, end] and view["rows"].tolist()[:2] == [0, height]
    for name in set(view.dtype.names) - {"rows"}:
        np.testing.assert_array_equal(band[name], view[name])


@given(st.integers(1, 300), st.data())
def test_columns_are_the_view_with_others_left_out(width, data):
    view = Rig.of(Scene(fur=Curves(CUBE), camera=Camera(size=(width, 7)))).view
    first, end = sorted(data.draw(st.tuples(st.integers(0, width), st.integers(0, width))))
    some = columns_of(view, first, end)
    assert some["rows"].tolist() == [0, 7, first, width - end] and some["size"][0] == end - first
    assert some["size"][1:].tolist() == view["size"][1:].tolist()
    for name in set(view.dtype.names) - {"rows", "size"}:
        np.testing.assert_array_equal(some[name], view[name])


@given(st.integers(1, 2000), st.tuples(COORDINATES, COORDINATES, COORDINATES))
def test_rows_to_be_timed_are_in_the_picture(height, eye):
    """About a tenth, in order."""
    assume(math.dist(eye, (0, 0, 0)) > 1e-3)
    scene = Scene(fur=Curves(CUBE), camera=Camera(eye=eye, target=(0, 0, 0), up=(.1, .2, .97), size=(8, height)))
    rows = [row for first, end in budget.bands(Rig.of(scene)) for row in range(first, end)]
    assert rows and rows == sorted(set(rows)) and rows[0] >= 0 and rows[-1] < height
    assert len(rows) <= max(.1 * height + budget.BANDS / 2, budget.BANDS)


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(1, 9)), min_size=1, max_size=9), st.floats(0, 1))
def test_the_fastest_is_found_on_the_way_down(rungs, seconds):
    """It asks for each time once, and never for a dearer one than before."""
    asked, ladder = [], [budget.Rung(place, cost, 0) for place, (_, cost) in enumerate(rungs)]

    def time(rung):
        asked.append(rung.settings)
        return rungs[rung.settings][0]
    place, took = budget.fastest(ladder, seconds, time)
    assert took == rungs[place][0] and (took <= seconds or place == 0)
    assert asked[1:] == sorted(asked[1:], reverse=True) and len(set(asked)) == len(asked)


ERRORS = st.lists(st.floats(1e-3, 1), min_size=6, max_size=6)


@given(ERRORS, ERRORS, st.lists(st.floats(1e-3, 1), min_size=2, max_size=9))
def test_a_smaller_error_never_means_a_cheaper_rung(predicted, found, goals):
    preview = object.__new__(budget.Preview)
    preview.expected, preview.error = predicted, found.__getitem__
    tried = [preview.cheapest(goal, 5) for goal in sorted(goals, reverse=True)]
    assert [max(each) for each in tried] == sorted(max(each) for each in tried)
    for goal, each in zip(sorted(goals, reverse=True), tried):
        assert list(each) == sorted(each) and all(error > goal for error in list(each.values())[:-1])


# --- what a user gives ----------------------------------------------------------------------------------------

NUMBERS = st.one_of(st.integers(), st.floats(), st.booleans(), st.decimals(), st.fractions(), st.complex_numbers(),
                    arrays.from_dtype(np.dtype("c8")), arrays.from_dtype(np.dtype("f4")),
                    arrays.from_dtype(np.dtype("u8")), arrays.from_dtype(np.dtype("M8[s]")))
ANYTHING = st.recursive(
    st.one_of(NUMBERS, st.none(), st.text(max_size=9), st.binary(max_size=9), st.just(object()), st.just(int),
              arrays.arrays(arrays.scalar_dtypes(), arrays.array_shapes(min_dims=0, max_side=4, min_side=0))),
    lambda inner: st.lists(inner, max_size=4) | st.tuples(inner, inner, inner), max_leaves=6)
CONVERTERS = {
    "real": checks.real(low=-1, below=5), "whole": checks.whole(-3, 9), "choice": checks.choice("a", "b"),
    "instance": checks.instance(Light, none=True), "tuple": checks.tuple_of(Light), "vector": checks.vector(3),
    "color": checks.color, "total": checks.total, "optional": checks.optional(checks.real()), "rows": checks.rows(3),
    "faces": checks.rows(3, kinds="iu"), "direction": checks.direction}


# NumPy's words for an array of one number in place of a number: it refuses it one day, and so will we.
QUIET = pytest.mark.filterwarnings("error", "ignore:Conversion of an array with ndim > 0:DeprecationWarning")


@QUIET
@pytest.mark.parametrize("name", CONVERTERS)
@given(value=ANYTHING)
@example(value=np.complex64(1 + 1j))
@example(value=np.timedelta64(3, "s"))
def test_anything_is_taken_or_refused_in_one_line(name, value):
    try:
        CONVERTERS[name](value, "Thing.field")
    except clfur.Error as error:
        text = str(error)
        assert text.startswith("Thing.field is ") and "; allowed: " in text and "\n" not in text and len(text) < 250


@QUIET
@pytest.mark.parametrize("make", [
    lambda value: Curves(value), lambda value: Curves(CUBE, width=value), lambda value: Mesh(CUBE[0], faces=value),
    lambda value: Mesh(value, faces=[(0, 1, 2)]), lambda value: Camera(eye=value), lambda value: Camera(size=value),
    lambda value: Scene(fur=value), lambda value: clfur.HairType(color_texture=value),
    lambda value: clfur.Strands(inner=value), lambda value: Shells(noise=value),
    lambda value: clfur.Settings(samples=value), lambda value: clfur.Settings(max_error=value)],
    ids=["points", "width", "faces", "positions", "eye", "size", "fur", "texture", "inner", "noise", "samples", "goal"])
@given(value=ANYTHING)
def test_objects_take_or_refuse_anything(make, value):
    try:
        make(value)
    except clfur.Error as error:
        assert "\n" not in str(error)


@given(st.integers(-10**12, 10**12), st.integers(-10**12, 10**12), st.integers(-10**12, 10**12))
def test_whole_numbers_are_taken_within_their_limits(low, high, value):
    if low <= value <= high:
        assert checks.whole(low, high)(value, "x") == value
    else:
        with pytest.raises(clfur.Error):
            checks.whole(low, high)(value, "x")


@given(st.floats(allow_nan=True), st.floats(-1e9, 1e9), st.floats(-1e9, 1e9))
def test_numbers_are_taken_within_their_limits(value, low, high):
    if math.isfinite(value) and abs(value) <= checks.LARGEST and low <= value < high:
        assert checks.real(low=low, below=high)(value, "x") == value
    else:
        with pytest.raises(clfur.Error):
            checks.real(low=low, below=high)(value, "x")


@given(arrays.arrays(np.float64, 3, elements=st.floats(-1e9, 1e9)))
def test_a_direction_has_length_one(vector):
    assume(np.any(vector))
    unit = checks.direction(vector, "x")
    largest = np.abs(vector).max()
    assert abs(np.linalg.norm(unit) - 1) < 1e-15 * 4 and not unit.flags.writeable
    # It points there: what is left of the vector beside it is rounding.
    scaled = vector / largest
    np.testing.assert_allclose(unit * np.linalg.norm(scaled), scaled, rtol=0, atol=4e-16 * 2)


@given(st.text(max_size=12))
@pytest.mark.parametrize("kind", [types.Size(), types.Color(), types.Numbers(3), types.Roots(), types.Names()],
                         ids=["size", "color", "numbers", "roots", "names"])
def test_an_option_is_taken_or_refused(kind, text):
    try:
        kind.convert(text, None, None)
    except click.BadParameter as error:
        assert repr(text) in error.message


@given(st.integers(1, 16384), st.integers(1, 16384))
def test_a_size_is_read_as_written(width, height):
    assert types.Size().convert(f"{width}x{height}", None, None) == (width, height)


@given(st.sampled_from(["", "/", "missing/"]), st.text(max_size=9), st.sampled_from(["", ".png", ".NPZ", ".jpg", "."]))
def test_an_output_file_has_a_suffix_and_a_folder(folder, name, suffix):
    suffixes = {".png": None, ".npz": None}
    path = Path(folder + name + suffix)
    if path.suffix.lower() in suffixes and path.parent.is_dir() and not path.is_dir():
        assert output_path(str(path), suffixes) == path
    else:
        with pytest.raises(clfur.Error, match="allowed|there is no folder|is a folder"):
            output_path(str(path), suffixes)


# --- where things are -----------------------------------------------------------------------------------------

POINTS = arrays.arrays(np.float32, st.tuples(st.integers(1, 5), st.integers(2, 4), st.just(3)),
                       elements=st.floats(-1e3, 1e3, width=32))


@given(POINTS, st.floats(0, 10), st.booleans())
def test_the_ball_around_a_scene_holds_it(points, width, body):
    """Points and half a width around them, and touches one of them at least."""
    mesh = Mesh([[0, 0, 0], [3, 0, 0], [0, 2, 1]], faces=[[0, 1, 2]]) if body else None
    center, radius = extent(mesh, Curves(points, width=width))
    there = points.reshape(-1, 3).astype(float)
    if body:
        there = np.concatenate([there, mesh.positions])
    away = np.linalg.norm(there - center, axis=1).max() + np.float32(width) / 2
    assert away <= radius * (1 + 1e-6) and radius <= away * (1 + 1e-6) + 1e-12


@given(POINTS, st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)), st.integers(1, 20))
def test_a_light_has_all_of_a_scene_before_it(points, direction, cells):
    """In its grid and in its map, wherever it shines from."""
    assume(np.linalg.norm(direction) > 1e-3)
    assume(np.ptp(points.reshape(-1, 3), axis=0).max() > 1e-3)
    scene = Scene(fur=Curves(points), light=Light(direction=direction))
    there = np.concatenate([points.reshape(-1, 3), np.ones((points.size // 3, 1))], 1).astype(float)
    in_grid = there @ grid_of(scene, 16 * cells)["to_grid"].astype(float)
    in_map = there @ light_view_of(scene, 64)["to_screen"].astype(float)
    # float32 of the matrix, with points as far away as 1,000.
    off = 1e-6 * 16 * cells * (1 + np.abs(points).max() / np.ptp(points.reshape(-1, 3), axis=0).max()) * 4
    assert (in_grid[:, [0, 1, 3]] >= -off).all() and (in_grid[:, [0, 1, 3]] <= 16 * cells + off).all()
    assert (in_map[:, :2] >= -off).all() and (in_map[:, :2] <= 64 + off).all()
    center = (*extent(None, scene.fur)[0], 1) @ grid_of(scene, 16 * cells)["to_grid"].astype(float)
    np.testing.assert_allclose(center, [8 * cells] * 3 + [1], rtol=0, atol=off)


# --- the contract with the device -----------------------------------------------------------------------------


@given(st.integers(-1000, 2**32 - 1) | st.floats(-1e9, 1e9, width=32))
def test_a_constant_is_the_same_number_in_c(value):
    assume(value >= 0 or isinstance(value, int))
    text = layout._c_number(value)
    assert float(text.strip("()uf") if isinstance(value, float) else int(text.strip("()u"), 0)) == value
    assert isinstance(value, float) or text.endswith("u") == (value >= 2**31)


@given(st.sampled_from(["f4", "u4", "u8", "i4"]), st.none() | st.integers(1, 8), st.integers(0, 99))
def test_declared_bytes_are_those_of_the_array(dtype, width, rows):
    declared = layout.Declared("row", dtype, width)
    assert declared.bytes * rows == np.zeros((rows, *[width] * bool(width)), dtype).nbytes


@pytest.mark.parametrize("samples", sorted(layout.PATTERNS))
def test_patterns_lie_one_after_another(samples):
    rows = [place for n in sorted(layout.PATTERNS) for place in layout.PATTERNS[n]]
    start = layout.pattern_start(samples)
    assert rows[start:start + samples] == layout.PATTERNS[samples] and len(set(layout.PATTERNS[samples])) == samples


# --- colours --------------------------------------------------------------------------------------------------


def test_coded_colors_come_back():
    coded = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(np.round(linear_to_srgb(srgb_to_linear(coded)) * 255), coded)


@given(arrays.arrays(np.float32, st.integers(1, 20), elements=st.floats(0, 1, width=32)))
def test_colors_come_back_and_keep_their_order(coded):
    """float32 linear light has 2^-24 of its value; the curve is no steeper than 12.92."""
    linear = srgb_to_linear(coded)
    np.testing.assert_allclose(linear_to_srgb(linear), coded, rtol=0, atol=5e-7)
    assert (np.diff(linear[np.argsort(coded)]) >= 0).all() and (linear <= coded).all() and (linear >= 0).all()


@QUIET
@given(arrays.arrays(np.float32, st.tuples(st.integers(1, 5), st.integers(1, 5), st.sampled_from([3, 4])),
                     elements=st.floats(width=32)))
@example(np.array([[[5e9, -5e9, 1, 1e-29]]], np.float32))
def test_any_picture_can_be_saved(image):
    """Infinities, NaN, negative light and alphas beyond 1 among them."""
    from imageio.v3 import imread
    read = imread(png_bytes(image), extension=".png")
    assert read.shape == image.shape and read.dtype == np.uint8
    if image.shape[2] == 3:
        assert (read[np.isnan(image) | (image <= 0)] == 0).all() and (read[image >= 1] == 255).all()


@given(arrays.arrays(np.uint8, st.tuples(st.integers(1, 5), st.integers(1, 5), st.just(3))))
def test_a_saved_picture_is_what_was_coded(coded):
    from imageio.v3 import imread
    np.testing.assert_array_equal(imread(png_bytes(srgb_to_linear(coded)), extension=".png"), coded)
