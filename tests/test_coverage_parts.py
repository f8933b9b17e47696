"""Strands by area that do not fit the device at once: parts, bands and teams give the same bits."""

import warnings
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support.coverage import OFF, SETTINGS
from support.pictures import same
from support.scenes import scene_of

import clfur
from clfur.parts import Work
from clfur.render import OUTPUTS


@pytest.mark.parametrize("kind, lod", [("faces", 0), (9001, 0), ("curves", 0), ("curves", 1)])
def test_parts_and_bands_are_the_same_bits(gpu, sphere, kind, lod):
    scene, settings = scene_of(kind, sphere), attrs.evolve(SETTINGS, grid=32, shadow_map=64, lod=lod)
    whole = clfur.draw(scene, gpu, settings, tuple(OUTPUTS), hashes=True)
    assert np.isfinite(whole.images["depth"]).mean() > .2 and whole.images["color"].std() > .05
    for memory in (3_000_000, 2_000_000):
        small = clfur.Scheduler(gpu.device, memory=memory)
        parts, rows = Work(small, scene).plan(small, settings, True)
        assert len(parts) > 1 and rows < 83
        frame = clfur.draw(scene, small, settings, tuple(OUTPUTS), hashes=True)
        same(whole, frame)
        assert 0 < frame.memory <= memory


def test_parts_of_strands_over_shells(gpu, sphere):
    scene = scene_of("faces", sphere)
    scene = clfur.Scene(sphere, [scene.strands, clfur.Shells(length=.1, frequency=9, layers=5)], scene.camera)
    whole = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    small = clfur.Scheduler(gpu.device, memory=3_000_000)
    assert len(Work(small, scene).plan(small, SETTINGS, True)[0]) > 1
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
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            drawn = clfur.render(scene, gpu, OFF)
        assert bool(told) == bool(steps and many)
        assert told or np.allclose(drawn, right, atol=1e-5)
        for one in told:
            assert "ends long loops" in str(one.message) and one.filename == __file__


def dense(size, n=3000):
    """Strands all over each other: hundreds in each pixel."""
    rng = np.random.default_rng(14)
    points = rng.uniform((-1, -.1, -1), (1, .1, 1), (n, 2, 3)) * (1, 1, .5)
    return clfur.Scene(fur=clfur.Curves(points, width=.01), camera=clfur.Camera(eye=(0, 0, 3), size=size))


def recorded(gpu):
    """Rows of each band that is begun."""
    bands, bound = [], gpu.launch

    def launch(name, size, /, **arguments):
        if name == "coverage.bound":
            bands.append(size)
        bound(name, size, **arguments)
    gpu.launch = launch
    return bands


@pytest.mark.parametrize("others", [("color",), tuple(OUTPUTS)])
def test_bands_of_too_many_pieces_are_cut(gpu, others):
    scene = dense((64, 48))
    whole, cut = clfur.draw(scene, gpu, OFF, others, hashes=True), 0
    for memory in range(1_300_000, 4_000_000, 300_000):
        small = clfur.Scheduler(gpu.device, memory=memory)
        bands = recorded(small)
        frame = clfur.draw(scene, small, OFF, others, hashes=True)
        assert frame.memory <= memory and frame.hashes == whole.hashes
        for name in others:
            np.testing.assert_array_equal(frame.images[name], whole.images[name])
        rows = Work(small, scene).plan(small, OFF, others != ("color",))[1]
        cut += len(bands) > -(-48 // rows)
    assert cut


def test_a_row_of_too_many_pieces_is_refused(gpu):
    scene = dense((64, 1), 20_000)
    scene = clfur.Scene(fur=scene.strands, camera=clfur.Camera(eye=(0, 0, 3), fov=5, size=(64, 1)))
    small = clfur.Scheduler(gpu.device, memory=1_000_000)
    with pytest.raises(clfur.Error, match="has no room for .* a row of 64 pixels with [0-9,]+ pieces of strands; "
                                          "allowed: smaller ones, or Settings.raster 'samples'"):
        clfur.render(scene, small, OFF)
    small = clfur.Scheduler(gpu.device)
    small.largest = 800_000
    with pytest.raises(clfur.Error, match="has no room for [0-9,]+ pieces of strands in a row of 64 pixels; allowed: "
                                          "a smaller picture, fewer strands, or Settings.raster 'samples'"):
        clfur.render(scene, small, OFF)


def test_parts_make_room_for_a_row_of_many_pieces(gpu, monkeypatch, sphere):
    """A small picture of much hair: what fits in parts at all is drawn, and again and again."""
    hair = clfur.HairType(segments=60, segment_length=.004)
    scene = clfur.Scene(sphere, clfur.Strands(types=[hair], roots=4000), camera=clfur.Camera(size=(32, 24)))
    whole, parts = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True), set()
    for memory in (6_000_000, 10_000_000, 16_000_000, 18_000_000):
        monkeypatch.setattr(gpu, "memory", memory)
        gpu.forget()
        parts.add(min(len(Work(gpu, scene).plan(gpu, SETTINGS, True)[0]), 2))
        for _ in range(2):
            frame = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
            assert frame.memory <= memory
            same(whole, frame)
    assert parts == {1, 2}


def test_pieces_beyond_32_bits_are_not_counted(gpu):
    """A device that holds more than 64 GiB of them would take their numbers for others."""
    scene = dense((2, 2), 5)
    work, large = Work(gpu, scene), SimpleNamespace(name="large", room=1 << 50, largest=1 << 50)
    counted = np.zeros((2, 2, 2), np.uint32)
    counted[..., 1] = 2**30 - 1
    plan = work.plan(gpu, OFF, False)
    assert not work.too_many(large, OFF, counted, plan, 0, 0)
    counted[..., 1] = 2**30
    assert work.too_many(large, OFF, counted, plan, 0, 0)
    counted[0, :, 1] = 2**31
    with pytest.raises(clfur.Error, match="4,294,967,296 pieces of strands in a row of 2 pixels"):
        work.too_many(large, OFF, counted[:1], plan, 0, 0)


def test_a_team_gives_the_bits_of_one(gpu, sphere):
    scene = scene_of("faces", sphere)
    whole = clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True)
    team = [clfur.Scheduler(gpu.device), clfur.Scheduler(gpu.device)]
    same(whole, clfur.draw(scene, team, SETTINGS, tuple(OUTPUTS), hashes=True))
    small = [clfur.Scheduler(gpu.device, memory=memory) for memory in (2_500_000, 3_000_000)]
    same(whole, clfur.draw(scene, small, SETTINGS, tuple(OUTPUTS), hashes=True))


@pytest.mark.parametrize("kernel", ["coverage.bound", "coverage.gather", "coverage.light", "raster.body"])
def test_a_device_that_fails_is_dropped(gpu, sphere, kernel):
    """What the lost one has seen of the body already is on it, and must not be used."""
    scene = scene_of("faces", sphere)
    whole = clfur.draw(scene, gpu, SETTINGS, hashes=True)
    team = [clfur.Scheduler(gpu.device), clfur.Scheduler(gpu.device)]
    launch, last = team[0].launch, team[1].launch

    def fails(name, size, /, **arguments):
        if name == kernel:
            raise clfur.DeviceError("this device is lost")
        launch(name, size, **arguments)

    def own(name, size, /, **arguments):
        assert all(array.queue is team[1].queue for array in arguments.values() if hasattr(array, "queue")), name
        last(name, size, **arguments)
    team[0].launch, team[1].launch = fails, own
    with pytest.warns(RuntimeWarning, match="goes on without a device: this device is lost"):
        same(whole, clfur.draw(scene, team, SETTINGS, hashes=True))
