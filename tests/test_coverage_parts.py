"""Strands by area that do not fit the device at once: parts, bands and teams give the same bits."""

from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support.coverage import OFF, SETTINGS, ball
from support.pictures import same
from support.plans import DRAWN_ONCE, bands_of, plan_of, recorded
from support.scenes import scene_of

import clfur
from clfur.pipeline import build, sizes
from clfur.render import OUTPUTS
from clfur.stages.coverage import EVERY, TILE, slabs_of

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


@pytest.mark.parametrize("others", [("color",), DRAWN_ONCE])
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
        device = SimpleNamespace(name="made up", memory=memory, largest=memory // 2, allowed=NO_LIMIT, steps=None)
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
                pixels, each = TILE * rows * width * sizes.of_pixel(plan, True), sizes.of_survivor(plan)
                bytes_of = [pixels + sizes.ENTRY * e + each * s for e, s in zip(listed, seen)]
                largest = [max(8 * e, sizes.LIT * s) for e, s in zip(listed, seen)]
                if listed[0] <= plan.most_listed(device, cut, counts[top:top + rows], survivors):
                    assert bytes_of[0] <= cut.rows and largest[0] <= device.largest
                assert not more or bytes_of[1] > cut.rows or largest[1] > device.largest * .87
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


@pytest.mark.parametrize("others, built", [(("color",), {}), (DRAWN_ONCE, {}), (DRAWN_ONCE, {"lanes": 1})])
@pytest.mark.parametrize("width", [.0001, .001])
def test_a_tile_is_drawn_in_slabs_of_depth(gpu, another, width, others, built):
    """Where not all of its segments have room: thin ones hide nothing, of thick ones those behind are left out.  Not
    where too many of them reach into one depth."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-.2, .2, (5000, 1, 3)) + np.linspace(0, .2, 6)[:, None] * rng.normal(size=(5000, 1, 3))
    points += rng.uniform(-.06, .06, (5000, 6, 3))
    scene = clfur.Scene(fur=clfur.Curves(points, width=width), camera=clfur.Camera(eye=(0, 0, 6), size=(8, 8)))
    small, whole, drawn = another(**built), clfur.draw(scene, gpu, OFF, others, hashes=True), []
    names = recorded(small)
    for small.memory in (1_000_000, 1_400_000, 1_700_000, 2_500_000, 6_000_000, 26_000_000):
        small.forget()
        names.clear()
        try:
            frame = clfur.draw(scene, small, OFF, others, hashes=True)
        except clfur.Error as error:
            assert not drawn and "MiB has no room for" in str(error) and "segments of strands in 8 x 8" in str(error)
            continue
        assert frame.memory <= small.memory
        assert frame.hashes == whole.hashes
        assert all(np.array_equal(frame.images[name], whole.images[name]) for name in others)
        drawn.append(bands_of(names))
        assert names.count("coverage.fill") >= drawn[-1] - 1
    assert len(drawn) < 6 and drawn[-1] == 1 < drawn[-2] <= drawn[0]


def test_slabs_hold_what_fits():
    """Each as much as fits, of all that reach into it; none where too many share a depth."""
    rng = np.random.default_rng(3)
    for n, most in (1, 1), (1000, 40), (1000, 300), (1000, 1000):
        reaches = rng.integers(0, 1 << 20, (n, 1)) + rng.integers((0, 0), (1, 1 << 14), (n, 2))
        reaches = reaches.astype(np.uint32)
        slabs, at = slabs_of(reaches, most), 0
        assert slabs and (len(slabs) == 1) == (n == most)
        for (first, end), count in slabs:
            assert first == at < end
            assert count == ((reaches[:, 0] < end) & (reaches[:, 1] >= first)).sum() <= most
            at = end
        assert at == EVERY[1]
        assert n == 1 or not slabs_of(np.concatenate([reaches, np.full((most + 1, 2), 7 << 17, np.uint32)]), most)


def test_light_at_more_places_of_parts_stays_within_the_memory(gpu, another, sphere):
    """Of one part it is there when the next is made, and of that alone the strands."""
    hair = clfur.HairType(segments=8, segment_length=.04, curl=(.03, 6))
    scene = clfur.Scene(sphere, clfur.Strands(types=[hair], roots=30_000), camera=clfur.Camera(size=(96, 64)))
    settings, small = attrs.evolve(SETTINGS, grid=32, shadow_map=64), another()
    names, whole = recorded(small), clfur.draw(scene, gpu, settings, hashes=True)
    for small.memory in (14_000_000, 12_000_000):
        small.forget()
        names.clear()
        frame = clfur.draw(scene, small, settings, hashes=True)
        same(whole, frame)
        assert frame.memory <= small.memory and names.count("strand_light.further") > bands_of(names)


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
        name="large", memory=1 << 50, largest=1 << 50, allowed=NO_LIMIT, steps=None)
    monkeypatch.setattr("clfur.pipeline.plan.LISTS", 1 << 60)
    counts = np.full((4, 1), 2**31 - 1)
    cut = plan.cut_counted(large, counts, 9)
    assert plan.windows(large, cut, counts, 9) == [(0, 2), (2, 4)]
    assert plan.windows(large, plan.cut_counted(large, counts + 1, 9), counts + 1, 9) == [(k, k + 1) for k in range(4)]
    with pytest.raises(clfur.Error, match="4,294,967,296 segments of strands in 8 x 8 pixels"):
        plan.cut_counted(large, np.array([[1], [2**32]]), 9)


@pytest.mark.parametrize("memory", [600_000, 700_000])
def test_one_part_of_the_body_is_there_at_a_time(gpu, another, sphere, memory):
    hair = clfur.HairType(segments=1, segment_length=.05)
    scene = clfur.Scene(sphere, clfur.Strands(types=[hair], roots=100, inner=6, outer=6), clfur.Camera(size=(8, 8)))
    small = another(memory)
    assert len(plan_of(scene, OFF).parts(small)) > 1
    frame = clfur.draw(scene, small, OFF)
    np.testing.assert_array_equal(frame.images["color"], clfur.render(scene, gpu, OFF))
    assert frame.memory <= memory


def test_strands_grow_as_rarely_as_can_be(gpu, sphere):
    """Once for each part and step: all cast their shadow and are counted, and in each band they are written and lit.
    The last part of a step is there for the next; none grows to be told how many there are, none for the body."""
    scene = scene_of(9001, sphere)
    small = clfur.Scheduler(gpu.device, memory=3_000_000)
    names = recorded(small)
    for outputs in ("color",), DRAWN_ONCE:
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
        assert {"raster.body", "raster.bands"} & set(names) and not any(name.startswith("strands.") for name in names)
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


@pytest.mark.parametrize("kernel", ["coverage.bound", "coverage.fill", "strand_light.radiance", "raster"])
def test_a_device_that_fails_is_dropped(gpu, another, sphere, kernel):
    """What the lost one has seen of the body already is on it, and must not be used."""
    scene = scene_of("faces", sphere)
    whole = clfur.draw(scene, gpu, SETTINGS, hashes=True)
    team = [another(), another()]
    launch, last = team[0].launch, team[1].launch

    def fails(name, size, /, **arguments):
        if name == kernel or name.split(".")[0] == kernel:
            raise clfur.DeviceError("this device is lost")
        launch(name, size, **arguments)

    def checked(name, size, /, **arguments):
        assert all(array.queue is team[1].queue for array in arguments.values() if hasattr(array, "queue")), name
        last(name, size, **arguments)
    team[0].launch, team[1].launch = fails, checked
    with pytest.warns(RuntimeWarning, match="goes on without a device: this device is lost"):
        same(whole, clfur.draw(scene, team, SETTINGS, hashes=True))
