"""Pictures laid over a background, and pictures at half their size."""

import imageio.v3 as imageio
import numpy as np
import pytest
from support.command import wrong

import clfur
from clfur.color import srgb_to_linear
from clfur.scene.mips import halved, levels_of


def picture(height=6, width=8, seed=0):
    image = np.random.default_rng(seed).random((height, width, 4)).astype(np.float32)
    image[..., :3] *= image[..., 3:]
    return image


def test_over_is_porter_and_duffs():
    image = picture()
    for behind in ((.2, .4, 3.), np.random.default_rng(1).random((6, 8, 3))):
        laid = clfur.over(image, behind)
        assert laid.dtype == np.float32 and laid.shape == (6, 8, 3)
        np.testing.assert_allclose(laid, image[..., :3] + (1 - image[..., 3:].astype(float)) * behind, atol=1e-6)
    np.testing.assert_array_equal(clfur.over(image, np.array((255, 0, 0), np.uint8)),
                                  clfur.over(image, (1, 0, 0)))


def test_nothing_before_it_leaves_the_background_at_its_size():
    behind = np.random.default_rng(1).integers(0, 256, (6, 8, 4), np.uint8)
    laid = clfur.over(np.zeros((6, 8, 4), np.float32), behind)
    np.testing.assert_array_equal(laid, srgb_to_linear(behind[..., :3]))


@pytest.mark.parametrize("size", [(3, 4), (12, 16), (48, 64), (51, 68)])
def test_another_size_keeps_the_mean_and_slopes(size):
    """A slope stays one, but at the border; a fine checker becomes its mean, in linear light."""
    empty = np.zeros((*size, 4), np.float32)
    slope = np.broadcast_to(np.linspace(0, 1, 16)[None, :, None], (12, 16, 3))
    laid = clfur.over(empty, slope)
    middle = laid[:, size[1] // 4:-size[1] // 4]
    assert np.abs(np.diff(middle, axis=1) - 16 / 15 / size[1]).max() < 1e-5
    checker = np.broadcast_to((np.indices((96, 128)).sum(0) % 2 * 255).astype(np.uint8)[..., None], (96, 128, 3))
    np.testing.assert_allclose(clfur.over(empty, checker).mean(), .5, atol=1e-5)


@pytest.mark.parametrize("pixels", [1, 2, 3, 4, 5, 7, 31, 64])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_half_has_the_mean_of_what_it_covers(pixels, axis):
    """By area: each of n halves covers pixels / n of the whole ones."""
    values = np.random.default_rng(pixels).random((pixels, 1, 2))
    half = halved(values if axis == 0 else values.swapaxes(0, 1), axis)
    half = half if axis == 0 else half.swapaxes(0, 1)
    n = max(pixels // 2, 1)
    sums = np.concatenate([np.zeros((1, 1, 2)), values.cumsum(0)])
    edges = np.arange(n + 1) * pixels / n
    low = np.minimum(edges.astype(int), pixels - 1)
    along = sums[low] + (edges - low)[:, None, None] * values[low]
    np.testing.assert_allclose(half, np.diff(along, axis=0) * n / pixels, atol=1e-12)


def test_levels_end_in_the_mean():
    values = np.random.default_rng(0).random((37, 12, 3))
    levels = levels_of(values)
    assert [each.shape[:2] for each in levels] == [(37, 12), (18, 6), (9, 3), (4, 1), (2, 1), (1, 1)]
    np.testing.assert_allclose(levels[-1][0, 0], values.mean((0, 1)), atol=1e-12)


@pytest.mark.parametrize("image, behind, words", [
    (np.zeros((6, 8, 3), np.float32), (1, 1, 1), "over image"), (picture(), (1, 1), "over background"),
    (picture(), np.zeros((6, 9, 3)), "9 x 6 pixels; allowed: the aspect of the picture, 8 x 6"),
    (picture(), (-1, 0, 0), "over background"), (picture(), "red", "over background"),
    (picture(), np.full((3, 4, 3), np.nan), "over background")])
def test_what_does_not_fit_is_refused(image, behind, words):
    with pytest.raises(clfur.Error, match=words):
        clfur.over(image, behind)


def test_command(clfur, tmp_path):
    imageio.imwrite("blue.png", np.broadcast_to(np.array((0, 0, 255), np.uint8), (12, 16, 3)))
    common = "render", "sphere", "--size", "32x24", "--roots", 100, "-o"
    assert clfur(*common, "a.png", "--background", "blue.png")[0] == 0
    assert clfur(*common, "b.png", "--background", "#0000ff")[0] == 0
    assert clfur(*common, "c.exr", "--background", "0,0,1")[0] == 0
    one, other = imageio.imread("a.png"), imageio.imread("b.png")
    assert one.shape == (24, 32, 3) and (one[0, 0] == (0, 0, 255)).all() and one.std() > 10
    np.testing.assert_array_equal(one, other)
    before = (tmp_path / "blue.png").read_bytes()
    wrong(clfur(*common, "blue.png", "--background", "blue.png"), "blue.png is read by this command")
    assert (tmp_path / "blue.png").read_bytes() == before
    wrong(clfur("render", "sphere", "--size", "33x24", "-o", "d.png", "--background", "blue.png"),
          "--background: blue.png has 16 x 12 pixels; allowed: the aspect of the picture, 33 x 24")
    wrong(clfur(*common, "d.png", "--background", "0,0,9"), "'0,0,9'")
    wrong(clfur(*common, "d.png", "--background", "blu.png"), "blu.png: no such file")
    wrong(clfur(*common, "d.npz", "--outputs", "depth", "--background", "0,0,1"),
          "--background is for the output color")
