"""The self-test: right on every device here, and wrong when anything is."""

import numpy as np
import pytest

from clfur import cli_devices, selftest

RIGHT = selftest.expected()


def test_every_device_passes(gpu):
    wrong = selftest.differences(selftest.picture(gpu), RIGHT)
    assert not wrong, (f"{', '.join(wrong)}: this driver is wrong, or the kernels have changed.  If they were "
                       "meant to, run tools/selftest.py and say so in CHANGELOG.md")


def test_every_stage_takes_part(gpu):
    drawn = selftest.draw(selftest.scene(), gpu, selftest.SETTINGS, ("color", "id"), hashes=True)
    assert set(drawn.stages) == {"tessellate", "strands", "raster", "voxelize", "zscan", "shadow_map", "shade"}
    assert set(drawn.hashes) == set(RIGHT) - {"color"} == {"visibility", "voxels", "shadow_map"}
    shown = drawn.images["id"]
    assert (shown == -1).mean() > .2 and (shown == -2).mean() > .02 and (shown >= 0).mean() > .2


@pytest.mark.parametrize("name, words", [
    ("visibility", "other bits in visibility"), ("voxels", "other bits in voxels"),
    ("shadow_map", "other bits in shadow map")])
def test_other_bits_are_wrong(name, words):
    assert selftest.differences({**RIGHT, name: "0" * 64}, RIGHT) == [words]


@pytest.mark.parametrize("pixels, off, wrong", [
    (0, 0, False), (3, 1, False), (4, 1, True), (4, np.nan, True), (4, np.inf, True), (3072, .0008, False),
    (3072, .0012, True)])
def test_other_colours_are_wrong(pixels, off, wrong):
    color = RIGHT["color"].copy()
    color.reshape(-1, 4)[:pixels, 1] += off
    told = selftest.differences({**RIGHT, "color": color}, RIGHT)
    assert bool(told) == wrong
    assert not told or "of the pixels have another colour" in told[0]


def test_it_is_small_and_quick(gpu):
    """The command waits for it in silence."""
    drawn = selftest.draw(selftest.scene(), gpu, selftest.SETTINGS)
    assert drawn.seconds < cli_devices.CHECKING / 4
    assert RIGHT["color"].shape == (48, 64, 4)
