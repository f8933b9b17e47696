"""The self-test: right on every device here, and wrong when anything is."""

import time

import attrs
import numpy as np
import pytest

from clfur.command import devices as cli_devices
from clfur.judge import selftest

RIGHT = selftest.expected()


def test_every_device_passes(gpu):
    wrong = selftest.differences(selftest.picture(gpu), RIGHT)
    assert not wrong, (f"{', '.join(wrong)}: this driver is wrong, or the kernels have changed.  If they were "
                       "meant to, run tools/selftest.py and say so in CHANGELOG.md")


def test_every_stage_takes_part(gpu):
    furry, names = selftest.scene(), set()
    for raster, only in (("samples", set()), ("coverage", {"coverage", "strand_light"})):
        gpu.forget()
        drawn = selftest.draw(furry, gpu, attrs.evolve(selftest.SETTINGS, raster=raster), ("color", "id"), hashes=True)
        assert set(drawn.stages) == only | {"tessellate", "strands", "raster", "voxelize", "zscan", "shadow_map",
                                            "shade"}
        assert set(drawn.hashes) == {"visibility", "voxels", "shadow_map"}
        names |= {f"{name} ({raster})" for name in ("color", *drawn.hashes)}
        shown = drawn.images["id"]
        assert (shown == -1).mean() > .2 and (shown == -2).mean() > .02 and (shown >= 0).mean() > .2
    assert set(RIGHT) == names


@pytest.mark.parametrize("name, words", [
    ("visibility (samples)", "other bits in visibility (samples)"),
    ("visibility (coverage)", "other bits in visibility (coverage)"),
    ("voxels (samples)", "other bits in voxels (samples)"),
    ("shadow_map (samples)", "other bits in shadow map (samples)")])
def test_other_bits_are_wrong(name, words):
    assert selftest.differences({**RIGHT, name: "0" * 64}, RIGHT) == [words]


@pytest.mark.parametrize("raster", ["samples", "coverage"])
@pytest.mark.parametrize("pixels, off, wrong", [
    (0, 0, False), (3, 1, False), (4, 1, True), (4, np.nan, True), (4, np.inf, True), (3072, .0008, False),
    (3072, .0012, True)])
def test_other_colours_are_wrong(pixels, off, wrong, raster):
    name = f"color ({raster})"
    color = RIGHT[name].copy()
    color.reshape(-1, 4)[:pixels, 1] += off
    found = selftest.differences({**RIGHT, name: color}, RIGHT)
    assert bool(found) == wrong
    assert not found or f"of the pixels have another {name}" in found[0]


def test_it_is_small_and_quick(gpu):
    """The command waits for it in silence."""
    began = time.perf_counter()
    selftest.picture(gpu)
    assert time.perf_counter() - began < cli_devices.CHECKING / 4
    assert RIGHT["color (coverage)"].shape == RIGHT["color (samples)"].shape == (48, 64, 4)
