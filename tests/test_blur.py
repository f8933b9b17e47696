"""Blur: the twin's values on every device, and what a blur must keep."""

import numpy as np
import pytest

import clfur
from clfur.stages.blur import blur, blur_radius
from clfur.twin import blur as twin


def picture(height, width, seed=0):
    """Noise in a disc, premultiplied, on nothing."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    inside = np.hypot(y - height / 2, x - width / 2) < 0.4 * min(height, width)
    image = np.concatenate([rng.uniform(0, 3, (height, width, 3)), np.ones((height, width, 1))], 2)
    return (image * inside[..., None]).astype(np.float32)


@pytest.mark.small
@pytest.mark.parametrize("sigma", [0.1, 0.7, 1])
@pytest.mark.parametrize("edges", [False, True])
def test_twin_small(gpu, sigma, edges):
    image = picture(13, 17)
    soft = blur(gpu, gpu.upload(image), sigma, edges).get()
    np.testing.assert_allclose(soft, twin.blur(image, sigma, edges), atol=1e-6)


@pytest.mark.parametrize("sigma", [2.5, 16])
@pytest.mark.parametrize("edges", [False, True])
def test_twin(gpu, sigma, edges):
    image = picture(50, 71)
    soft = blur(gpu, gpu.upload(image), sigma, edges).get()
    np.testing.assert_allclose(soft, twin.blur(image, sigma, edges), atol=2e-6)


def test_light_is_neither_lost_nor_made(gpu):
    image = np.zeros((41, 61, 4), np.float32)
    image[18:22, 25:30] = np.random.default_rng(1).uniform(0, 1, (4, 5, 4))
    soft = blur(gpu, gpu.upload(image), 3, False).get()
    np.testing.assert_allclose(soft.sum((0, 1)), image.sum((0, 1)), rtol=1e-6)
    flat = np.full((20, 30, 4), 0.7, np.float32)
    np.testing.assert_allclose(blur(gpu, gpu.upload(flat), 3, False).get(), flat, rtol=1e-6)


def test_edges_leave_the_interior_untouched(gpu):
    image = picture(90, 90)
    image[image[..., 3] > 0, 3] -= np.random.default_rng(2).uniform(0, 1 / 256, (image[..., 3] > 0).sum())
    soft = blur(gpu, gpu.upload(image), 2, True).get()
    y, x = np.mgrid[:90, :90]
    from_edge = np.abs(np.hypot(y - 45, x - 45) - 36)
    np.testing.assert_array_equal(soft[from_edge > 9], image[from_edge > 9])
    np.testing.assert_allclose(soft[from_edge < 1], twin.blur(image, 2, False)[from_edge < 1], atol=1e-6)


@pytest.mark.parametrize("edges", [False, True])
def test_rows_are_the_same_bits(gpu, edges):
    image, sigma = picture(60, 40), 1.5
    whole, radius = blur(gpu, gpu.upload(image), sigma, edges).get(), blur_radius(sigma)
    for top, end in ((0, 7), (7, 30), (30, 60)):
        low, high = max(top - radius, 0), min(end + radius, 60)
        strip = blur(gpu, gpu.upload(image[low:high]), sigma, edges, (top - low, end - low)).get()
        np.testing.assert_array_equal(strip, whole[top:end])


@pytest.mark.parametrize("raster", ["samples", "coverage"])
@pytest.mark.parametrize("kind", ["all", "edges"])
def test_a_blurred_frame(gpu, another, sphere, kind, raster):
    """A frame is blurred once, whole, however many bands it is drawn in; and what isn't colour is not."""
    scene = clfur.Scene(sphere, clfur.Strands(inner=3, outer=3), camera=clfur.Camera(eye=(0, .4, 3.2), size=(121, 83)))
    sharp = clfur.draw(scene, gpu, clfur.Settings(raster=raster, grid=32, shadow_map=64), ("color", "depth"))
    settings = clfur.Settings(raster=raster, grid=32, shadow_map=64, blur=kind, blur_sigma=2)
    soft = clfur.draw(scene, gpu, settings, ("color", "depth"))
    np.testing.assert_array_equal(soft.images["depth"], sharp.images["depth"])
    np.testing.assert_allclose(soft.images["color"], twin.blur(sharp.images["color"], 2, kind == "edges"), atol=1e-6)
    assert "blur" in soft.stages and "blur" not in sharp.stages

    memory = 1_000_000 if raster == "samples" else 3_000_000
    small = another(memory)
    banded = clfur.draw(scene, small, settings, ("color", "depth"))
    assert banded.memory <= memory
    np.testing.assert_array_equal(banded.images["color"], soft.images["color"])
