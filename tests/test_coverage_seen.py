"""Strands of which only those segments get light that are seen: the same picture."""

import attrs
import numpy as np
import pytest
from support.coverage import LIGHT, SETTINGS, ball, furry
from support.plans import recorded

import clfur
from clfur.pipeline import plan
from clfur.render import OUTPUTS
from clfur.stages import coverage

OPEN = attrs.evolve(SETTINGS, shadows="off")
SKY = clfur.Environment([(.6, .75, 1), (.8, .8, .8), (.2, .15, .1)])
SPOT = clfur.Light(position=(2, 2, 3), direction=(-2, -2, -3), angle=30)
LONG = clfur.Strands(roots=1500, types=clfur.HairType(segments=4, segment_length=.08, width=.02, curl=(.05, 3),
                                                      look=clfur.Kajiya(exponent=300)))


def scene_of(fur=LONG, **known):
    return clfur.Scene(ball(.8, 1), fur, clfur.Camera(size=(83, 61)), **known)


def drawn(gpu, monkeypatch, scene, settings, dense, bundles=coverage.BUNDLES, lists=plan.LISTS):
    """(Frame, names of its kernels), where light is asked for from so many segments a pixel on."""
    monkeypatch.setattr(plan, "LISTS", lists)
    monkeypatch.setattr(plan, "DENSE", dense)
    monkeypatch.setattr(coverage, "BUNDLES", bundles)
    gpu.forget()
    with monkeypatch.context() as patch:
        patch.setattr(gpu, "launch", gpu.launch)   # undone at the end
        names = recorded(gpu)
        return clfur.draw(scene, gpu, settings, tuple(OUTPUTS), hashes=True), names


def check(gpu, monkeypatch, scene, settings):
    at_once, _ = drawn(gpu, monkeypatch, scene, settings, np.inf)
    for bundles in coverage.BUNDLES, 60, 1:
        seen, names = drawn(gpu, monkeypatch, scene, settings, 0, bundles)
        assert seen.hashes == at_once.hashes
        for name, image in at_once.images.items():
            np.testing.assert_array_equal(seen.images[name], image, err_msg=name)
        in_lanes = max(gpu.lanes, gpu.hinted) > 1
        assert ("coverage.choose" in names) == in_lanes
        assert names.count("coverage.choose") > 1 or bundles > 60 or not in_lanes


@pytest.mark.parametrize("settings", [SETTINGS, attrs.evolve(SETTINGS, masks=4), OPEN], ids=["default", "masks", "off"])
@pytest.mark.parametrize("scene", [
    scene_of(light=LIGHT), scene_of(light=[LIGHT, SPOT]), scene_of(environment=SKY),
    scene_of(light=SPOT, environment=SKY), furry("point", 900, size=(61, 47)),
    scene_of([LONG, clfur.Shells(length=.1, frequency=6, layers=4)])],
    ids=["one", "two", "sky", "both", "curves", "shells"])
def test_a_picture_keeps_its_bits(gpu, monkeypatch, scene, settings):
    """Also where some tiles, or all, have no room for their pieces."""
    check(gpu, monkeypatch, scene, settings)


@pytest.mark.parametrize("look, settings, light", [
    (clfur.Chiang(), attrs.evolve(SETTINGS, scattering="grid"), LIGHT),
    (clfur.Kajiya(), attrs.evolve(SETTINGS, shadows="deep", masks=4), [LIGHT, SPOT]),
    (clfur.Kajiya(), attrs.evolve(SETTINGS, shadows="deep"), LIGHT)], ids=["scattering", "deep and masks", "deep"])
def test_light_of_any_kind_does(gpu, monkeypatch, look, settings, light):
    fur = clfur.Strands(roots=900, types=clfur.HairType(segments=4, segment_length=.08, width=.02, look=look))
    check(gpu, monkeypatch, scene_of(fur, light=light), settings)


def test_windows_of_tiles_do(gpu, monkeypatch):
    """Each draws its own tiles alone."""
    at_once, _ = drawn(gpu, monkeypatch, scene_of(light=LIGHT), SETTINGS, np.inf)
    seen, names = drawn(gpu, monkeypatch, scene_of(light=LIGHT), SETTINGS, 0, lists=200_000)
    assert seen.hashes == at_once.hashes and names.count("coverage.fill") > 2
    np.testing.assert_array_equal(seen.images["color"], at_once.images["color"])


@pytest.mark.small
@pytest.mark.parametrize("n", [1, 8, 1021])
def test_marked_segments_get_slots(gpu, n):
    """Each its own, from 0 on; then none is marked any more."""
    rng = np.random.default_rng(n)
    ids, marks = rng.permutation(n).astype(np.uint32), np.zeros(-(-n // 8) * 8, np.uint8)
    for share in .3, 0, 1:
        marks[:n] = rng.random(n) < share
        rows = {"bundle": 0, "tile": 0, "survivor": n, "counter": 1}
        seen = coverage.Seen.empty(gpu, rows, marks=gpu.upload(marks.view(np.uint64)))
        chosen, slots = coverage.choose(gpu, seen, gpu.upload(ids)).get(), seen.slots.get()
        which = np.flatnonzero(marks)
        np.testing.assert_array_equal(np.sort(slots[which]), np.arange(marks.sum()))
        np.testing.assert_array_equal(chosen[slots[which]], ids[which])
        assert not seen.marks.get().any()
