"""One rule for all colours: arrays of uint8 and uint16 are sRGB-coded, all other numbers are linear light."""

import numpy as np
import pytest

import clfur
from clfur.color import srgb_to_linear

CODED = np.array((255, 188, 51), np.uint8)
LINEAR = srgb_to_linear(CODED)                                    # 1, .503, .033: rather unlike 255, 188, 51
MESH = clfur.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces=[[0, 1, 2]], uv=[[0, 0], [1, 0], [0, 1]])
POINTS = np.zeros((2, 3, 3))


def textured(color):
    return clfur.HairType(color_texture=np.asarray(color)[None, None]).color_texture[0, 0]


TAKERS = {                                                        # what is stored of a colour, by who takes it
    "HairType.color": lambda color: clfur.HairType(color=color).color,
    "HairType.color_texture": textured,
    "Shells.color": lambda color: clfur.Shells(color=color).color,
    "Light.color": lambda color: clfur.Light(color=color).color,
    "Environment.sky": lambda color: clfur.Environment(color).sky,
    "Environment.sky, of three": lambda color: clfur.Environment([np.asarray(color)] * 3).sky[1],
    "Ground.color": lambda color: clfur.Ground(color=color).color,
    "Scene.body_color": lambda color: clfur.Scene(MESH, body_color=color).body_color,
    "Curves.color, one": lambda color: clfur.Curves(POINTS, color=color).color[0],
    "Curves.color, a strand's": lambda color: clfur.Curves(POINTS, color=np.asarray([[color]] * 2)).color[1],
    "Curves.color, a point's": lambda color: clfur.Curves(POINTS, color=np.asarray([[color] * 3] * 2)).color[5],
}
takers = pytest.mark.parametrize("stored", TAKERS.values(), ids=TAKERS)


@takers
@pytest.mark.parametrize("coded", [CODED, CODED.astype(np.uint16) * 257, (CODED.astype(np.uint16) * 257).astype(">u2")],
                         ids=["uint8", "uint16", "big-endian uint16"])
def test_the_colours_of_pictures_are_coded(stored, coded):
    """257 times as much of 65535 is as much of 255."""
    np.testing.assert_allclose(stored(coded), LINEAR, rtol=1e-7)


@takers
def test_floats_are_linear(stored):
    for dtype in (np.float16, np.float32, np.float64, np.longdouble):
        color = np.array((1, .5, .03), dtype)
        np.testing.assert_array_equal(stored(color), color.astype(stored(color).dtype))


@pytest.mark.parametrize("name", [name for name in TAKERS if name != "HairType.color_texture"])
def test_whole_numbers_are_linear(name):
    """As they stand in a list; of a picture of them nobody knows what is white, and it is refused."""
    for color in (1, 0, 2), [1, 0, 2], *(np.array((1, 0, 2), dtype) for dtype in (np.int64, np.int32, np.uint32)):
        np.testing.assert_array_equal(TAKERS[name](color), (1, 0, 2))


@pytest.mark.parametrize("dtype", [np.int64, np.int32, np.uint32, np.int8, bool])
def test_pictures_of_other_whole_numbers_are_refused(dtype):
    with pytest.raises(clfur.Error, match="HairType.color_texture .* allowed: .*uint8 or uint16"):
        clfur.HairType(color_texture=np.ones((1, 1, 3), dtype))


@pytest.mark.parametrize("color", [CODED, "#ffbc33"])
def test_the_shell_and_python_mean_the_same(color):
    """The command's '#ffbc33' are the numbers 255, 188, 51 of a picture."""
    from clfur.command.types import from_hex
    np.testing.assert_allclose(from_hex("#ffbc33"), clfur.HairType(color=CODED).color, rtol=1e-7)
    assert isinstance(color, str) or clfur.Curves(POINTS, color=color).color.dtype == np.float32


def test_a_stored_colour_can_be_given_again():
    """It is linear, and stays so."""
    for stored in TAKERS.values():
        np.testing.assert_array_equal(stored(stored(CODED)), stored(CODED))


def test_colours_on_a_device_are_linear(gpu):
    there = gpu.upload(LINEAR[None])
    np.testing.assert_array_equal(clfur.Curves(POINTS, color=there).on_host.color, LINEAR[None])
    with pytest.raises(clfur.Error, match=r"Curves.color is uint8 .* allowed there: float32"):
        clfur.Curves(POINTS, color=gpu.upload(CODED[None]))
