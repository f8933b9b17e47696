"""Strands by area that do not fit the device at once: parts, bands and teams give the same bits."""

import warnings
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support.coverage import OFF, SETTINGS
from support.pictures import same
from support.plans import plan_of, recorded
from support.scenes import scene_of

import clfur
from clfur.pipeline import build
from clfur.render import OUTPUTS

NO_LIMIT = 1 << 63, ""   # of the process, for devices that are made up


@pytest.mark.parametrize("kind, lod", [("faces", 0), (9001, 0), ("curves", 0), ("curves", 1)])
def test_parts_and_bands_are_the_same_bits(gpu, another, sphere, kind, lod):
    scene, settings = scene_of(kind, sphere), attrs.evolve(SETTINGS, grid=32, shadow_map=64, lod=lod)
    whole = clfur.draw(scene, gpu, settings, tuple(OUTPUTS), hashes=True)
    assert np.isfinite(whole.images["depth"]).mean() > .2 and whole.images["color"].std() > .05
    small = another()
    names = recorded(small)
    for small.memory in (2_500_000, 1_900_000):
        small.forget()
        names.clear()
        frame = clfur.draw(scene, small, settings, tuple(OUTPUTS), hashes=True)
        same(whole, frame)
        assert 0 < frame.memory <= small.memory
        bands = names.count("coverage.resolve")
        assert 1 < bands < names.count("coverage.gather")   # several parts in each


def test_parts_of_strands_over_shells(gpu, another, sphere):
    scene = scene_of("faces", sphere)
    scene = clfur.Scene(sphere, [scene.strands, clfur.Shells(length=.1, frequency=9, layers=5)], scene.camera)
    whole = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    small = another(1_700_000)
    assert len(plan_of(scene, SETTINGS).parts(small)) > 1
    same(whole, clfur.draw(scene, small, SETTINGS, tuple(OUTPUTS), hashes=True))


@pytest.mark.parametrize("n, width, many", [(9000, 1e-4, True), (9000, .02, False), (1500, 1e-4, False)])
def test_more_pieces_than_a_driver_sorts_are_told(gpu, monkeypatch, n, width, many):
    """Mesa's llvmpipe ends loops without a word; pixels that are soon full need few."""
    middle = np.random.default_rng(1).normal(size=(n, 1, 3)) * .02
    way = np.random.default_rng(2).normal(size=(n, 1, 3)) * .2
    fur = clfur.Curves(middle + way * np.array([-1, 1])[:, None], width=width)
    scene = clfur.Scene(fur=fur, camera=clfur.Camera(eye=(0, 0, 6), size=(24, 18)))
    right = clfur.render(scene, settings=OFF)
    for steps in (gpu.steps, 65_535):
        monkeypatch.setattr(gpu, "steps", steps)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            drawn = clfur.render(scene, gpu, OFF)
        assert bool(caught) == bool(steps and many)
        assert caught or np.allclose(drawn, right, atol=1e-5)
        for one in caught:
            assert "ends long loops" in str(one.message) and one.filename == __file__


def dense(size, n=3000):
    """Strands all over each other: hundreds in each pixel."""
    rng = np.random.default_rng(14)
    points = rng.uniform((-1, -.1, -1), (1, .1, 1), (n, 2, 3)) * (1, 1, .5)
    return clfur.Scene(fur=clfur.Curves(points, width=.01), camera=clfur.Camera(eye=(0, 0, 3), size=size))


@pytest.mark.parametrize("others", [("color",), tuple(OUTPUTS)])
def test_bands_are_cut_by_what_was_counted(gpu, another, others):
    """Each is tried once, and as large as fits: one more row and it would be too large."""
    scene, cuts, small, bands = dense((64, 48)), set(), another(), []
    whole, launch = clfur.draw(scene, gpu, OFF, others, hashes=True), small.launch

    def noted(name, size, /, **arguments):
        if name == "coverage.resolve":
            bands.append((size // 64, len(arguments["weights"])))
        launch(name, size, **arguments)
    small.launch = noted
    for small.memory in range(900_000, 4_000_000, 300_000):
        small.forget()
        bands.clear()
        frame = clfur.draw(scene, small, OFF, others, hashes=True)
        assert frame.memory <= small.memory and frame.hashes == whole.hashes
        for name in others:
            np.testing.assert_array_equal(frame.images[name], whole.images[name])
        assert sum(rows for rows, _ in bands) == 48
        cuts.add(len(bands))
    assert len(cuts) > 2 and 1 in cuts


@pytest.mark.parametrize("seed", range(20))
def test_bands_are_as_large_as_fits(gpu, seed):
    """And their pieces too, whatever there is in each row."""
    rng = np.random.default_rng(seed)
    plan, width = plan_of(dense((64, 48)), attrs.evolve(OFF, samples=(1, 4, 16)[seed % 3])), 64
    sums = rng.integers(0, 10 ** rng.integers(1, 6), 48) * (rng.random(48) < .7)
    for memory in 2_000_000, 8_000_000, 64_000_000:
        device = SimpleNamespace(name="made up", memory=memory, largest=memory // 2, allowed=NO_LIMIT)
        try:
            cut = plan.cut_counted(device, sums)
        except clfur.Error:
            assert sums.max() * 16 > memory // 8
            continue
        top = 0
        while top < 48:
            rows = plan.rows_counted(device, cut, sums, top)
            pieces = [16 * int(sums[top:top + n].sum()) for n in (rows, rows + 1)]
            bytes_of = [48 * width * 8 + n * width * plan._pixel(True) + p for n, p in zip((rows, rows + 1), pieces)]
            assert bytes_of[0] <= cut.rows and pieces[0] <= device.largest
            assert top + rows >= 48 or bytes_of[1] > cut.rows or pieces[1] > device.largest * .87
            top += rows
        assert top == 48


def test_a_row_of_too_many_pieces_is_refused(another):
    scene = dense((64, 1), 20_000)
    scene = clfur.Scene(fur=scene.strands, camera=clfur.Camera(eye=(0, 0, 3), fov=5, size=(64, 1)))
    small = another(1_000_000)
    with pytest.raises(clfur.Error, match="has no room for .* a row of 64 pixels with [0-9,]+ pieces of strands; "
                                          "allowed: smaller ones, or Settings.raster 'samples'"):
        clfur.render(scene, small, OFF)
    small = another()
    small.largest = 800_000
    with pytest.raises(clfur.Error, match="has no room for [0-9,]+ pieces of strands in a row of 64 pixels; allowed: "
                                          "a smaller picture, fewer strands, or Settings.raster 'samples'"):
        clfur.render(scene, small, OFF)


def test_parts_make_room_for_a_row_of_many_pieces(gpu, monkeypatch, sphere):
    """A small picture of much hair: what fits in parts at all is drawn, and again and again."""
    hair = clfur.HairType(segments=60, segment_length=.004)
    scene = clfur.Scene(sphere, clfur.Strands(types=[hair], roots=4000), camera=clfur.Camera(size=(32, 24)))
    whole, parts = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True), set()
    names = []
    launch = gpu.launch
    monkeypatch.setattr(gpu, "launch", lambda name, size, /, **rest: names.append(name) or launch(name, size, **rest))
    for memory in (6_000_000, 10_000_000, 16_000_000, 18_000_000):
        monkeypatch.setattr(gpu, "memory", memory)
        gpu.forget()
        for _ in range(2):
            names.clear()
            frame = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
            assert frame.memory <= memory
            same(whole, frame)
            parts.add(names.count("coverage.gather") > names.count("coverage.resolve"))
    assert parts == {False, True}


def test_pieces_beyond_32_bits_are_not_counted():
    """A device that holds more than 64 GiB of them would take their numbers for others."""
    plan, large = plan_of(dense((2, 4), 5), OFF), SimpleNamespace(
        name="large", memory=1 << 50, largest=1 << 50, allowed=NO_LIMIT)
    sums = np.full(4, 2**31 - 1)
    cut = plan.cut_counted(large, sums)
    assert plan.rows_counted(large, cut, sums, 0) == 2
    assert plan.rows_counted(large, plan.cut_counted(large, sums + 1), sums + 1, 0) == 1
    with pytest.raises(clfur.Error, match="4,294,967,296 pieces of strands in a row of 2 pixels"):
        plan.cut_counted(large, np.array([1, 2**32]))


def test_strands_grow_as_rarely_as_can_be(gpu, sphere):
    """Once for each part and step: all cast their shadow and are counted, and in each band they are written and lit.
    The last part of a step is there for the next; none grows to be told how many there are, none for the body."""
    scene = scene_of(9001, sphere)
    small = clfur.Scheduler(gpu.device, memory=2_500_000)
    names = recorded(small)
    for outputs in ("color",), tuple(OUTPUTS):
        for _ in range(2):
            names.clear()
            assert clfur.draw(scene, small, SETTINGS, outputs).memory <= 2_500_000
            bands = names.count("coverage.resolve")
            parts, counted = names.count("coverage.gather") // bands, names.count("coverage.count")
            assert parts > 1 and bands > 1 and names.count("coverage.light") == bands * parts
            assert names.count("strands.grow") <= names.count("voxelize.lengths") + counted + bands * (2 * parts - 1)


def test_the_body_is_drawn_without_growing_hair(gpu, sphere):
    """What needs the body alone never asks for hair, and hair that stands on nothing never for the body."""
    small = clfur.Scheduler(gpu.device, memory=2_000_000)
    names = recorded(small)
    for kind in "faces", 9001, "curves":
        plan = plan_of(scene_of(kind, sphere), SETTINGS)
        parts = plan.parts(small)   # asks for areas
        assert kind == "curves" or len(parts) > 1
        names.clear()
        build.rasterize_body(small, plan, plan.rig.view)
        assert "raster.body" in names and not any(name.startswith("strands.") for name in names)
    names.clear()
    for part in parts:
        build.hair(small, plan, part, 0)
    assert set(names) == {"strands.unpack_curves"}


def test_a_team_gives_the_bits_of_one(gpu, another, sphere):
    scene = scene_of("faces", sphere)
    whole = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    team = [another(), another()]
    same(whole, clfur.draw(scene, team, SETTINGS, tuple(OUTPUTS), hashes=True))
    small = [another(memory) for memory in (2_500_000, 3_000_000)]
    same(whole, clfur.draw(scene, small, SETTINGS, tuple(OUTPUTS), hashes=True))


@pytest.mark.parametrize("kernel", ["coverage.bound", "coverage.gather", "coverage.light", "raster.body"])
def test_a_device_that_fails_is_dropped(gpu, another, sphere, kernel):
    """What the lost one has seen of the body already is on it, and must not be used."""
    scene = scene_of("faces", sphere)
    whole = clfur.draw(scene, gpu, SETTINGS, hashes=True)
    team = [another(), another()]
    launch, last = team[0].launch, team[1].launch

    def fails(name, size, /, **arguments):
        if name == kernel:
            raise clfur.DeviceError("this device is lost")
        launch(name, size, **arguments)

    def checked(name, size, /, **arguments):
        assert all(array.queue is team[1].queue for array in arguments.values() if hasattr(array, "queue")), name
        last(name, size, **arguments)
    team[0].launch, team[1].launch = fails, checked
    with pytest.warns(RuntimeWarning, match="goes on without a device: this device is lost"):
        same(whole, clfur.draw(scene, team, SETTINGS, hashes=True))
