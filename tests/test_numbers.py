"""Whatever a user gives in place of anything: it is taken, and then works, or refused in one line."""

import datetime
import decimal
import fractions
import math
import warnings

import attrs
import numpy as np
import pytest

import clfur
from clfur.errors import shown
from clfur.scene import frame
from clfur.scene.curves import Bounds


def failing(*methods):
    """An object whose methods of these names raise what is no error of clfur's."""
    def fail(self, *_, **__):
        raise RuntimeError("fails")
    return type("Failing", (), dict.fromkeys(methods, fail))()


FAILING = [failing(f"__{name}__") for name in (
    "array", "float", "index", "int", "len", "eq", "bool", "repr", "str", "iter", "hash", "getattr", "array_interface",
    "getitem", "fspath")]
FAILING.append(failing("__float__", "__index__", "__array__", "__len__", "__repr__", "__str__"))
ODD = [math.nan, math.inf, -math.inf, 5e-324, 1e-300, 179.9999999, 1e300, 10**5000, -10**5000, 2**63, 2**64,
       1j, np.complex64(1), decimal.Decimal("sNaN"), np.longdouble("1e400"), np.float32("nan"), None, ...,
       NotImplemented, int, object(), print, "", "x", "1", "\0", b"1", bytearray(b"1"), np.str_("pn"), np.bytes_(b"a"),
       datetime.datetime(2020, 1, 1), datetime.timedelta(1), np.datetime64(1, "ns"), np.timedelta64(1, "ns"),
       [], (), {}, {1: 2}, set(), [[]], [1, [2, 3]], range(3), iter([1, 2, 3]), [10**5000] * 3, [2**70, 0, 0],
       [1e300] * 3, [5e-324] * 3, [True] * 3, ["1"] * 3, [1j] * 3, [math.nan] * 3, [None] * 3]
MASKED = [np.ma.masked, np.ma.array(3.0, mask=True), np.ma.array([1.0, 2, 3], mask=[0, 1, 0]), [np.ma.masked, 1, 2],
          [np.ma.array([1, 2, 3], mask=[0, 1, 0])] * 3, (np.ma.array([[1, 2, 0]], mask=[[0, 1, 0]]),)]
ARRAYS = [np.array(3), np.array(3.0), np.array([3]), np.array([3.0]), np.zeros(3, object),
          np.array([1, None, 2], object), np.zeros(3, "V8"),
          np.zeros((), "V8"), np.zeros(3, [("a", float), ("b", int)]), np.zeros((0, 3), "M8[s]"),
          np.zeros(0, object), np.zeros(0), np.array("pn"), np.array(["a"]), np.zeros((3, 0)), np.zeros((1, 0, 3)),
          np.zeros((2, 2, 3)), np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2, 2)), np.zeros((2, 3, 3), np.float16),
          np.zeros(10**6)]
KINDS = bool, np.bool_, int, float, np.int8, np.uint64, np.longdouble
GIVEN = [*FAILING, *ODD, *MASKED, *ARRAYS, *(kind(1) for kind in KINDS)]

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
MESH = clfur.Mesh(TRIANGLE, faces=[[0, 1, 2]], uv=[[0, 0], [1, 0], [0, 1]])
SCENE = clfur.Scene(MESH, camera=clfur.Camera(size=(4, 4)))
NEEDED = {clfur.Mesh: {"positions": TRIANGLE, "faces": [[0, 1, 2]]}, clfur.Curves: {"points": np.eye(3)[None]},
          clfur.PointForce: {"position": (0, 0, 0)}, clfur.Scene: {"mesh": MESH},
          Bounds: {"center": (0, 0, 0), "radius": 1, "segments": 1, "length": 1, "area": 1}}
CLASSES = [clfur.Mesh, clfur.Camera, clfur.Light, clfur.HairType, clfur.Kajiya, clfur.Strands, clfur.PointForce,
           clfur.Curves, Bounds, clfur.Shells, clfur.Scene, clfur.Settings]
FIELDS = [(kind, field.alias) for kind in CLASSES for field in attrs.fields(kind) if field.init]
FUNCTIONS = {
    clfur.Camera.calibrated: {"pose": np.eye(4), "intrinsics": np.eye(3), "size": (4, 4)},
    clfur.Camera.from_opencv: {"K": np.eye(3), "R": np.eye(3), "t": (0, 0, 1), "size": (4, 4), "dist": None},
    clfur.Camera.on_sphere: {"n": 1, "center": (0, 0, 0), "radius": 1, "seed": 0, "elevation": (0, 1), "up": (0, 1, 0),
                             "fov": 45, "size": (4, 4)},
    frame: {"mesh": MESH, "fur": None, "size": (4, 4), "fov": 45, "direction": (0, 0, 1)},
    clfur.Scheduler: {"device": None, "memory": None},
    clfur.load_mesh: {"path": None}}
ARGUMENTS = [(function, name) for function, names in FUNCTIONS.items() for name in names]


def taken(make):
    """What make() gives, or None where it is refused in one line."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return make()
        except clfur.Error as error:
            assert "\n" not in str(error) and len(str(error)) < 420, str(error)
            assert "allowed" in str(error) or "no such file" in str(error) or "there is no" in str(error), str(error)
    return None


@pytest.mark.parametrize("kind, name", FIELDS, ids=lambda each: getattr(each, "__name__", each))
def test_a_field_takes_or_refuses_anything(kind, name):
    for value in GIVEN:
        taken(lambda: kind(**{**NEEDED.get(kind, {}), name: value}))


@pytest.mark.parametrize("function, name", ARGUMENTS, ids=lambda each: getattr(each, "__name__", each))
def test_an_argument_takes_or_refuses_anything(function, name, gpu):
    arguments = {**FUNCTIONS[function], **({"device": gpu.device} if function is clfur.Scheduler else {})}
    for value in GIVEN:
        taken(lambda: function(**{**arguments, name: value}))


@pytest.mark.parametrize("name", ["scene", "device", "settings", "outputs"])
def test_drawing_takes_or_refuses_anything(name, gpu):
    for draw in clfur.draw, clfur.render, clfur.grow:
        if draw is clfur.grow and name in ("settings", "outputs"):
            continue
        for value in GIVEN:
            taken(lambda: draw(**{"scene": SCENE, "device": gpu, name: value}))


@pytest.mark.parametrize("name", ["picture.png", "picture.exr", "picture.npz"])
def test_saving_takes_or_refuses_anything(name, tmp_path):
    for value in GIVEN:
        taken(lambda: clfur.save(value, np.zeros((2, 2, 4))))
        taken(lambda: clfur.save(tmp_path / name, value))
        taken(lambda: clfur.save(tmp_path / name, {"color": np.zeros((2, 2, 4)), "id": value}))


@pytest.mark.parametrize("kind", [np.int8, np.int32, np.int64, np.uint8, np.uint64, np.array])
def test_whole_numbers_of_numpy_are_whole_numbers(kind, gpu):
    assert clfur.Settings(samples=kind(4), grid=kind(64), shadow_map=kind(96), pcf=kind(2)) == clfur.Settings(
        grid=64, shadow_map=96, pcf=2)
    assert clfur.Camera(size=(kind(3), kind(4))).size == (3, 4)
    assert type(clfur.Strands(roots=kind(7), seed=kind(5)).roots) is int
    assert clfur.HairType(key=(kind(1), kind(2), kind(3))).key == (1, 2, 3)
    assert clfur.Scheduler(gpu.device, memory=kind(100)).memory == 100


def test_flags_and_texts_of_numpy_are_taken():
    settings = clfur.Settings(filtered=np.bool_(False), raster=np.str_("samples"))
    assert settings.filtered is False and type(settings.raster) is str
    for value in (0, 1, None, "True", np.array([True])):
        with pytest.raises(clfur.Error, match="Settings.filtered is .*; allowed: True or False"):
            clfur.Settings(filtered=value)


@pytest.mark.parametrize("kind", [decimal.Decimal, fractions.Fraction, np.float16, np.float32, np.longdouble, np.int8,
                                  np.array])
def test_numbers_of_other_kinds_are_numbers(kind):
    assert clfur.Camera(fov=kind(30), eye=[kind(3)] * 3).fov == 30
    assert clfur.Light(direction=(kind(0), kind(0), kind(-2))).direction.tolist() == [0, 0, -1]
    assert clfur.Curves([[[kind(1)] * 3] * 2], width=kind(2)).width.tolist() == [2]


@pytest.mark.parametrize("value", MASKED, ids=range(len(MASKED)))
def test_masked_values_are_refused(value):
    """NumPy shows what is masked as soon as it makes a plain array of it."""
    for make in (lambda: clfur.Light(color=value), lambda: clfur.Curves(value), lambda: clfur.Camera(fov=value),
                 lambda: clfur.Mesh(value, faces=[[0, 1, 2]]), lambda: clfur.Mesh(TRIANGLE, faces=value),
                 lambda: clfur.Settings(samples=value), lambda: clfur.Curves(np.eye(3)[None], width=value)):
        with pytest.raises(clfur.Error):
            make()
    unmasked = np.ma.array([1.0, 2, 3])
    assert clfur.Light(color=unmasked).color.tolist() == [1, 2, 3]


@pytest.mark.parametrize("value, text", [
    (10**5000, "a whole number of 16610 bits"), (failing("__repr__"), "an object of class Failing"),
    ("a\nb", "'a\\nb'"), (np.zeros(5), "an array of float64 [5]"), ([0] * 10**7, f"[{'0, ' * 25}0..."),
    ("x" * 10**7, f"'{'x' * 76}...")], ids=["int", "object", "text", "array", "list", "long text"])
def test_what_is_wrong_is_shown_in_short(value, text):
    assert shown(value) == text
