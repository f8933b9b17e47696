"""Strands by area that do not fit the device at once: parts, bands and teams give the same bits."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support.coverage import OFF, SETTINGS, ball
from support.pictures import same
from support.plans import bands_of, plan_of, recorded
from support.scenes import scene_of

import clfur
from clfur.pipeline import build
from clfur.pipeline.plan import ENTRY
from clfur.render import OUTPUTS
from clfur.stages.coverage import TILE

NO_LIMIT = 1 << 63, ""   # of the process, for devices that are made up


@pytest.mark.parametrize("kind, lod, memory", [("faces", 0, 2), (9001, 0, 3), ("curves", 0, 2), ("curves", 1, 2)])
def test_parts_and_bands_are_the_same_bits(gpu, another, sphere, kind, lod, memory):
    scene, settings = scene_of(kind, sphere), attrs.evolve(SETTINGS, grid=32, shadow_map=64, lod=lod)
    whole = clfur.draw(scene, gpu, settings, tuple(OUTPUTS), hashes=True)
    assert np.isfinite(whole.images["depth"]).mean() > .2 and whole.images["color"].std() > .05
    small = another()
    names = recorded(small)
    for small.memory in (memory * 1_250_000, memory * 1_000_000):
        small.forget()
        names.clear()
        frame = clfur.draw(scene, small, settings, tuple(OUTPUTS), hashes=True)
        same(whole, frame)
        assert 0 < frame.memory <= small.memory
        bands = bands_of(names)
        assert 1 < bands < names.count("coverage.fill")   # several parts in each


def test_parts_of_strands_over_shells(gpu, another, sphere):
    scene = scene_of("faces", sphere)
    scene = clfur.Scene(sphere, [scene.strands, clfur.Shells(length=.1, frequency=9, layers=5)], scene.camera)
    whole = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    small = another(1_900_000)
    assert len(plan_of(scene, SETTINGS).parts(small)) > 1
    same(whole, clfur.draw(scene, small, SETTINGS, tuple(OUTPUTS), hashes=True))


@pytest.mark.parametrize("n, width", [(2500, 1e-4), (9000, .02)])
def test_thousands_of_strands_in_a_pixel_are_all_there(gpu, another, n, width):
    """Also where a driver ends long loops, as Mesa's llvmpipe does without a word."""
    middle = np.random.default_rng(1).normal(size=(n, 1, 3)) * .02
    way = np.random.default_rng(2).normal(size=(n, 1, 3)) * .2
    fur = clfur.Curves(middle + way * np.array([-1, 1])[:, None], width=width)
    scene = clfur.Scene(fur=fur, camera=clfur.Camera(eye=(0, 0, 6), size=(12, 9)))
    right = clfur.draw(scene, settings=OFF, hashes=True)
    single = another(lanes=1, steps=65_535)
    for one in (gpu, single):
        drawn = clfur.draw(scene, one, OFF, hashes=True)
        assert drawn.hashes == right.hashes and np.allclose(drawn.images["color"], right.images["color"], atol=1e-5)


@pytest.mark.parametrize("size, n, steps",
                         [pytest.param((5, 3), 200, 8, marks=pytest.mark.small), ((21, 15), 9000, 64)])
def test_long_lists_are_cut_into_launches(gpu, another, size, n, steps):
    """Where a driver ends long loops: here very short ones."""
    rng = np.random.default_rng(5)
    middle, way = rng.normal(size=(n, 1, 3)) * (.4, .3, .3), rng.normal(size=(n, 1, 3)) * .1
    scene = clfur.Scene(ball(.2, 0), clfur.Curves(middle + way * np.array([-1, 1])[:, None], width=.02),
                        clfur.Camera(eye=(0, 0, 6), size=size))
    right = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    cut = another(lanes=1, hinted=1, steps=steps)
    names = recorded(cut)
    same(right, clfur.draw(scene, cut, SETTINGS, tuple(OUTPUTS), hashes=True))
    assert names.count("coverage.sort") > 6 and names.count("coverage.pixels") > 4   # else nothing is cut


def dense(size, n=3000):
    """Strands all over each other: hundreds in each pixel."""
    rng = np.random.default_rng(14)
    points = rng.uniform((-1, -.1, -1), (1, .1, 1), (n, 2, 3)) * (1, 1, .5)
    return clfur.Scene(fur=clfur.Curves(points, width=.01), camera=clfur.Camera(eye=(0, 0, 3), size=size))


@pytest.mark.parametrize("others", [("color",), tuple(OUTPUTS)])
def test_bands_are_cut_by_what_was_counted(gpu, another, others):
    """And windows of tiles."""
    scene, cuts, small, bands = dense((64, 45)), set(), another(), []
    whole, launch = clfur.draw(scene, gpu, OFF, others, hashes=True), small.launch

    def noted(name, size, /, **arguments):
        if name in ("coverage.tiles", "coverage.sort"):
            drawn = arguments.get("window", (0, 0))
            bands.append((len(arguments["starts"]) - 1, *map(int, drawn)))
        launch(name, size, **arguments)
    small.launch = noted
    for small.memory in range(1_000_000, 2_500_000, 100_000):
        small.forget()
        bands.clear()
        frame = clfur.draw(scene, small, OFF, others, hashes=True)
        assert frame.memory <= small.memory and frame.hashes == whole.hashes
        for name in others:
            np.testing.assert_array_equal(frame.images[name], whole.images[name])
        cuts.add(len(bands))
    assert len(cuts) > 2 and 1 in cuts


@pytest.mark.parametrize("seed", range(20))
def test_bands_are_as_large_as_fits(gpu, seed):
    """And windows of tiles, whatever there is in each: each tile is drawn once, with its segments."""
    rng = np.random.default_rng(seed)
    plan, width = plan_of(dense((64, 96)), attrs.evolve(OFF, samples=(1, 4, 16)[seed % 3])), 64
    counts = rng.integers(0, 10 ** rng.integers(1, 5), (12, 8)) * (rng.random((12, 8)) < .7)
    survivors = int(counts.sum() * rng.random())
    for memory in 2_000_000, 8_000_000, 64_000_000:
        device = SimpleNamespace(name="made up", memory=memory, largest=memory // 2, allowed=NO_LIMIT)
        try:
            cut = plan.cut_counted(device, counts, survivors)
        except clfur.Error:
            assert counts.max() * 300 > memory // 16
            continue
        top = 0
        while top < 12:
            rows = plan.rows_counted(device, cut, counts, survivors, TILE * top) // TILE
            drawn = counts[top:top + rows].ravel()
            windows = plan.windows(device, cut, counts[top:top + rows], survivors)
            assert [at for window in windows for at in range(*window)] == list(range(len(drawn)))
            for (first, end), more in zip(windows, [1] * (len(windows) - 1) + [0]):
                listed = [int(drawn[first:end + n].sum()) for n in (0, more)]
                seen = [min(survivors, n) for n in listed]
                bytes_of = [TILE * rows * width * plan._pixel(True) + ENTRY * e + plan._survivor * s
                            for e, s in zip(listed, seen)]
                assert bytes_of[0] <= cut.rows and max(8 * listed[0], 32 * seen[0]) <= device.largest
                assert not more or bytes_of[1] > cut.rows or max(8 * listed[1], 32 * seen[1]) > device.largest * .87
            top += rows
        assert top == 12


def test_a_row_of_too_many_segments_is_refused(another):
    scene = dense((64, 1), 20_000)
    scene = clfur.Scene(fur=scene.strands, camera=clfur.Camera(eye=(0, 0, 3), fov=5, size=(64, 1)))
    small = another(1_500_000)
    with pytest.raises(clfur.Error, match="has no room for .* a row of 64 pixels with [0-9,]+ segments of strands "
                                          "in 8 x 8 of them; "
                                          "allowed: smaller ones, or Settings.raster 'samples'"):
        clfur.render(scene, small, OFF)
    small = another()
    small.largest = 60_000
    with pytest.raises(clfur.Error, match="has no room for [0-9,]+ segments of strands in 8 x 8 pixels; "
                                          "allowed: fewer strands, or Settings.raster 'samples'"):
        clfur.render(scene, small, OFF)


def test_parts_make_room_for_a_row_of_many_pieces(gpu, monkeypatch, sphere):
    """A small picture of much hair: what fits in parts at all is drawn, and again and again."""
    hair = clfur.HairType(segments=60, segment_length=.004)
    scene = clfur.Scene(sphere, clfur.Strands(types=[hair], roots=4000), camera=clfur.Camera(size=(32, 24)))
    whole, parts = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True), set()
    names = []
    launch = gpu.launch
    monkeypatch.setattr(gpu, "launch", lambda name, size, /, **rest: names.append(name) or launch(name, size, **rest))
    for memory in (14_000_000, 17_000_000, 36_000_000, 64_000_000):
        monkeypatch.setattr(gpu, "memory", memory)
        gpu.forget()
        for _ in range(2):
            names.clear()
            frame = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
            assert frame.memory <= memory
            same(whole, frame)
            parts.add(names.count("coverage.fill") > bands_of(names))
    assert parts == {False, True}


def test_entries_beyond_32_bits_are_not_listed(monkeypatch):
    """A device that holds more than 64 GiB of them would take their numbers for others."""
    plan, large = plan_of(dense((2, 32), 5), OFF), SimpleNamespace(
        name="large", memory=1 << 50, largest=1 << 50, allowed=NO_LIMIT)
    monkeypatch.setattr("clfur.pipeline.plan.LISTS", 1 << 60)
    counts = np.full((4, 1), 2**31 - 1)
    cut = plan.cut_counted(large, counts, 9)
    assert plan.windows(large, cut, counts, 9) == [(0, 2), (2, 4)]
    assert plan.windows(large, plan.cut_counted(large, counts + 1, 9), counts + 1, 9) == [(k, k + 1) for k in range(4)]
    with pytest.raises(clfur.Error, match="4,294,967,296 segments of strands in 8 x 8 pixels"):
        plan.cut_counted(large, np.array([[1], [2**32]]), 9)


def test_strands_grow_as_rarely_as_can_be(gpu, sphere):
    """Once for each part and step: all cast their shadow and are counted, and in each band they are written and lit.
    The last part of a step is there for the next; none grows to be told how many there are, none for the body."""
    scene = scene_of(9001, sphere)
    small = clfur.Scheduler(gpu.device, memory=3_000_000)
    names = recorded(small)
    for outputs in ("color",), tuple(OUTPUTS):
        for _ in range(2):
            names.clear()
            assert clfur.draw(scene, small, SETTINGS, outputs).memory <= 3_000_000
            bands = bands_of(names)
            parts, counted = names.count("coverage.fill") // bands, names.count("coverage.count")
            assert parts > 1 and bands > 1 and names.count("strand_light.radiance") == bands * parts
            assert names.count("strands.grow") <= names.count("voxelize.lengths") + counted + bands * (2 * parts - 1)


def test_the_body_is_drawn_without_growing_hair(gpu, sphere):
    """What needs the body alone never asks for hair, and hair that stands on nothing never for the body."""
    small = clfur.Scheduler(gpu.device, memory=1_100_000)
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


@pytest.mark.parametrize("kernel", ["coverage.bound", "coverage.fill", "strand_light.radiance", "raster.body"])
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
