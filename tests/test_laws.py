"""What holds for every picture, whatever is in it: tried on scenes that are drawn by lot."""

import attrs
import pytest
from support.anything import RASTERS, any_scene, any_settings, drawn

import clfur


@pytest.mark.parametrize("seed", range(24))
def test_alpha_is_a_share(gpu, seed):
    """Of both rasters, with shells, strands, body and all of them; and what the output coverage says, to the bit."""
    images = drawn(any_scene(seed), gpu, any_settings(seed))
    alpha = images["color"][..., 3]
    assert alpha.max() <= 1 and images["coverage"].tobytes() == alpha.tobytes()
    assert ((images["id"] != -1) <= (alpha > 0)).all()


@pytest.mark.parametrize("raster", RASTERS)
@pytest.mark.parametrize("blur", ["all", "edges"])
def test_alpha_is_a_share_when_it_is_blurred(gpu, raster, blur):
    for seed in range(3):
        for sigma in (.1, .7, 16):
            settings = any_settings(seed, raster=raster, blur=blur, blur_sigma=sigma)
            assert drawn(any_scene(seed), gpu, settings)["color"][..., 3].max() <= 1
    flat = attrs.evolve(any_scene(1), camera=clfur.Camera(eye=(0, 0, 1.6), size=(37, 29)))   # all of it is covered
    assert drawn(flat, gpu, any_settings(1, raster=raster, blur=blur, blur_sigma=5))["color"][..., 3].max() <= 1
