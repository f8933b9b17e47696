"""Several devices on one frame: the same bits as one, shares by speed, and what happens when one fails."""

import threading
import warnings
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support.devices import DEVICES
from support.pictures import same
from support.scenes import scene_of

import clfur
from clfur.device.team import Team, shares_of
from clfur.render import OUTPUTS, _tell_same, schedulers
from clfur.stages import strands

SETTINGS = clfur.Settings(raster="samples", samples=4, grid=32, shadow_map=64)


@pytest.fixture
def team(gpu, another):
    """This device, and the next there is, or itself once more."""
    return [another(), another(device=DEVICES[(DEVICES.index(gpu.device) + 1) % len(DEVICES)])]


WAYS = {"length": {}, "binary": {"shadows": "binary"}, "lod": {"lod": 1}, "lod-binary": {"lod": 1, "shadows": "binary"}}


@pytest.mark.parametrize("kind, way", [("faces", "length"), (9001, "length"), ("curves", "length"), (9001, "binary"),
                                       ("faces", "lod"), ("curves", "lod"), ("faces", "lod-binary")])
def test_a_team_gives_the_bits_of_one(gpu, team, sphere, kind, way):
    """How strands are shared out does not hang on how their shadow is counted."""
    keys = WAYS[way]
    scene, settings = scene_of(kind, sphere), attrs.evolve(SETTINGS, **keys)
    whole = clfur.draw(scene, gpu, settings, tuple(OUTPUTS), hashes=True)
    for _ in range(2):
        frame = clfur.draw(scene, team, settings, tuple(OUTPUTS), hashes=True)
        same(whole, frame)
        assert all({"rasterize", "accumulate"} <= set(one.pace) for one in team)
        assert frame.device == " + ".join(one.name for one in team)


def test_small_devices_in_a_team(gpu, another, sphere):
    scene = scene_of(9001, sphere)
    small = [another(memory) for memory in (1_300_000, 1_700_000)]
    same(clfur.draw(scene, gpu, SETTINGS, hashes=True), clfur.draw(scene, small, SETTINGS, hashes=True))


def test_devices_by_name(gpu, sphere):
    scene = scene_of("faces", sphere)
    np.testing.assert_array_equal(clfur.render(scene, [gpu.device], SETTINGS), clfur.render(scene, gpu, SETTINGS))
    for wrong in ([], [gpu, gpu], [gpu.device, gpu.device]):
        with pytest.raises(clfur.Error, match="allowed: .*, or a list of different ones"):
            clfur.render(scene, wrong)


@pytest.mark.parametrize("paces, shares", [
    ([1, 1], [(10, 60), (60, 110)]), ([3, 1], [(10, 85), (85, 110)]), ([1], [(10, 110)]),
    ([1e-9, 1, 1], [(10, 10), (10, 60), (60, 110)])])
def test_shares_are_in_proportion_to_speed(paces, shares):
    assert shares_of(10, 110, paces) == shares


def test_strands_that_are_made_anew_lie_in_another_order(team, monkeypatch):
    """A team's first device counts where all strands show, makes its share of them for shadows, and then all again."""
    rng = np.random.default_rng(2)
    points = np.linspace(0, .2, 4)[:, None] * rng.normal(size=(5000, 1, 3))
    points += (20, 0, 0) * (rng.random((5000, 1, 1)) < .5)   # half are out of sight
    scene = clfur.Scene(fur=clfur.Curves(points, width=.01, alpha=.7),
                        camera=clfur.Camera(eye=(0, 0, 3), size=(90, 70)))
    settings = attrs.evolve(SETTINGS, raster="coverage")
    whole = clfur.draw(scene, team[0], settings, tuple(OUTPUTS))

    def any_order(gpu, packed, spans):
        order = rng.permutation(gpu.download(spans))
        placed = np.stack([order[:, 0] // 4, np.cumsum(order[:, 1]) - order[:, 1]], 1)
        return SimpleNamespace(placed=gpu.upload(placed.astype(np.uint32)))
    monkeypatch.setattr(strands, "order", any_order)
    team[0].forget()
    frame = clfur.draw(scene, team, settings, tuple(OUTPUTS))
    assert all(np.array_equal(frame.images[name], whole.images[name]) for name in OUTPUTS)


def test_the_faster_device_gets_more(gpu, team):
    given = []

    def draw(one, strands, body):
        given.append((one, strands[1] - strands[0], body))
        return [one.upload(np.array([strands[1] - strands[0]]))]
    team[0].pace["rasterize"], team[1].pace["rasterize"] = 3e6, 1e6
    assert Team(team).gather("rasterize", draw, [np.add], 1000)[0] == 1000
    assert sorted((one is team[0], n, body) for one, n, body in given) == [(False, 250, False), (True, 750, True)]


def test_arrays_are_not_left_on_another_device(gpu, team):
    """Who asks for them may have been dropped: then the one that is left must begin anew."""
    one, other = team
    together = Team(team)
    together.gpus.remove(one)

    def draw(gpu, strands, body):
        return [gpu.full(1, np.uint64, 7)]
    assert together.gather("rasterize", draw, [np.add], 10, other)[0].get()[0] == 7
    with pytest.raises(clfur.DeviceError, match="was lost"):
        together.gather("rasterize", draw, [np.add], 10, one)


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("kernel", ["voxelize.lengths", "raster.lines", "shade.color", "zscan.columns", "strands.grow",
                                    "coverage.fill", "strand_light.transmittance"])
def test_a_device_that_fails_is_dropped_and_its_share_redone(gpu, team, sphere, kernel, which):
    scene = scene_of("faces", sphere)
    stage = kernel.split(".")[0]
    settings = attrs.evolve(SETTINGS, raster="coverage" if stage in ("coverage", "strand_light") else "samples")
    whole = clfur.draw(scene, gpu, settings, hashes=True)
    clfur.draw(scene, team, settings)
    broken, launch = team[which], team[which].launch

    def fails(name, size, /, **arguments):
        if name == kernel:
            raise clfur.DeviceError("this device is lost")
        launch(name, size, **arguments)
    broken.launch = fails
    for one in team:
        one.forget()
    if which == 1 and stage in ("shade", "zscan", "coverage", "strand_light"):   # what only the first one does
        same(whole, clfur.draw(scene, team, settings, hashes=True))
        return
    with pytest.warns(RuntimeWarning, match="goes on without a device: this device is lost"):
        frame = clfur.draw(scene, team, settings, hashes=True)
    assert frame.hashes == whole.hashes
    # Drivers round exp and log differently: the colours are those of whichever device has shaded.
    del broken.launch
    alone = [clfur.render(scene, one, settings) for one in (gpu, team[1])]
    assert any(np.array_equal(frame.images["color"], image) for image in alone)


@pytest.mark.parametrize("kind", ["faces", 9001])
@pytest.mark.parametrize("which", [0, 1])
def test_a_lost_device_is_asked_nothing_more(team, monkeypatch, sphere, which, kind):
    """As after a GPU's reset, when even waiting for it fails; also while the parts of a small one are planned."""
    for one in team:
        monkeypatch.setattr(one, "memory", 1_000_000)
    scene, lost = scene_of(kind, sphere), team[which]

    def fails(*_, **__):
        raise clfur.DeviceError("this device is lost")
    lost.launch = lost.empty = lost.upload = lost.download = lost.seconds = fails
    with pytest.warns(RuntimeWarning, match="goes on without a device: this device is lost"):
        frame = clfur.draw(scene, team, SETTINGS, hashes=True)
    left = team[1 - which]   # whose colours these are
    left.forget()
    monkeypatch.undo()
    same(clfur.draw(scene, left, SETTINGS, hashes=True), frame)
    assert frame.device == team[1 - which].name


@pytest.mark.filterwarnings("ignore:goes on without")
def test_when_all_fail_the_error_is_told(team, sphere):
    def fails(*_, **__):
        raise clfur.DeviceError("no power")
    for one in team:
        one.launch = fails
    with pytest.raises(clfur.DeviceError, match="no power"):
        clfur.draw(scene_of("faces", sphere), team, SETTINGS)


def test_one_frame_at_a_time(another, sphere):
    """A scheduler that draws in one thread is refused to another, and is free again afterwards."""
    scene, inside, go = scene_of("faces", sphere), threading.Event(), threading.Event()
    one = another()
    launch = one.launch

    def slow(name, size, /, **arguments):
        inside.set()
        assert go.wait(60)
        launch(name, size, **arguments)
    one.launch = slow
    thread = threading.Thread(target=clfur.render, args=(scene, one, SETTINGS))
    thread.start()
    assert inside.wait(60)
    try:
        with pytest.raises(clfur.Error, match="is drawing in another thread; allowed: one for each thread"):
            clfur.render(scene, one, SETTINGS)
    finally:
        go.set()
        thread.join()
    assert clfur.render(scene, one, SETTINGS).std() > 0


def test_one_processor_is_told_to_gain_nothing(gpu, another):
    """Once, not for each frame; a single device is no team."""
    _tell_same.cache_clear()
    gpus = [gpu, another()]
    with pytest.warns(RuntimeWarning, match="^.* and .* are the same processor: together they are no faster than one$"):
        assert schedulers(gpus) == gpus
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert schedulers(gpus) == gpus and schedulers(gpu) == [gpu]
