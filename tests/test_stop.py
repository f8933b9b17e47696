"""What is stopped half way leaves all as it was: `stop=`, and Ctrl-C at any launch."""

import itertools
import threading
import warnings
from contextlib import suppress
from functools import partial

import attrs
import numpy as np
import pytest
from support.devices import DEVICES
from support.pictures import same
from support.scenes import icosphere, scene_of

import clfur

QUICK = clfur.Settings(samples=1, grid=16, shadow_map=16)


class Asked:
    """A ``stop`` that says True once, when it is asked for the ``at``-th time, and counts."""

    def __init__(self, at=0):
        self.times, self.at, self.lock = 0, at, threading.Lock()

    def __call__(self):
        with self.lock:
            self.times += 1
            return self.times == self.at


def _scene(kind=300, **more):
    positions, faces = icosphere(1)
    scene = scene_of(kind, clfur.Mesh(positions, positions, faces=faces))
    return attrs.evolve(scene, camera=clfur.Camera(eye=(0, .4, 3.2), size=(40, 30)), **more)


def _look(scene, look):
    return attrs.evolve(scene, fur=attrs.evolve(scene.fur, types=attrs.evolve(scene.fur.types[0], look=look)))


def _both(scene):
    return attrs.evolve(scene, fur=(clfur.Shells(length=.15, layers=6), scene.fur))


WAYS = {
    "default": (_scene(), {}),
    "samples": (_scene(), {"settings": attrs.evolve(QUICK, raster="samples", lod=1.0, blur="all")}),
    "curves": (_scene("curves"), {"region": (8, 4, 20, 16), "outputs": ("color", "depth", "matte_id", "strand_area")}),
    "shells": (_both(_scene()), {"before": _both(_scene()), "outputs": ("color", "motion_vector", "uv")}),
    "sky": (_scene(environment=clfur.Environment((.4, .5, .6)), ground=clfur.Ground(-1.2)), {}),
    "scattering": (_look(_scene(), clfur.Chiang()), {"settings": attrs.evolve(QUICK, scattering="grid")}),
    "deep": (_scene(), {"settings": attrs.evolve(QUICK, shadows="deep", masks=4)}),
    "error": (_scene(), {"settings": clfur.Settings(max_error=.2)})}


def _stops(n, most=4):
    """So many of the n times that something is asked, first and last among them."""
    return sorted({1, *range(1, n, max(n // most, 1)), n})


def _all_ways(draw, gpus, want):
    """``draw(stop)`` is stopped at many places, of a first frame and of later ones; then it is as it was."""
    for first in (True, False):
        for gpu in gpus[:first * len(gpus)]:
            gpu.forget()
        counted = Asked()
        same(want, draw(counted))
        for at in _stops(counted.times):
            for gpu in gpus[:first * len(gpus)]:
                gpu.forget()
            stop = Asked(at)
            with suppress(clfur.Stopped) if at > 1 else pytest.raises(clfur.Stopped):   # pieces hang on the clock
                draw(stop)
            assert stop.times <= at or len(gpus) > 1   # nothing runs on, but what another device is asked meanwhile
            same(want, draw(None))


@pytest.mark.parametrize("way", WAYS)
def test_a_frame_that_is_stopped_leaves_no_trace(gpu, way):
    scene, how = WAYS[way]
    draw = partial(clfur.draw, scene, gpu, hashes=True, **{"settings": QUICK} | how)
    _all_ways(lambda stop: draw(stop=stop), [gpu], draw())


def test_parts_and_bands(another):
    """Of a scene that does not fit the device at once."""
    gpu, scene = another(1_500_000), _scene(4000)
    draw = partial(clfur.draw, scene, gpu, QUICK, hashes=True)
    assert draw().memory <= 1_500_000 < clfur.draw(scene, another(), QUICK).memory
    _all_ways(lambda stop: draw(stop=stop), [gpu], draw())


@pytest.mark.parametrize("raster", ["samples", "coverage"])
def test_a_team(gpu, another, raster):
    """One device that is asked stops all, and they go on together: none is dropped."""
    scene, settings = _scene(4000), attrs.evolve(QUICK, raster=raster)
    team = [another(), another(device=DEVICES[(DEVICES.index(gpu.device) + 1) % len(DEVICES)])]
    want = clfur.draw(scene, gpu, settings, hashes=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.filterwarnings("ignore", ".* are the same processor", RuntimeWarning)
        _all_ways(lambda stop: clfur.draw(scene, team, settings, hashes=True, stop=stop), team, want)


def test_a_team_that_was_stopped_gives_what_it_holds(another):
    """No Scheduler of it takes what is asked of it later, out of any frame, for the frame that was stopped."""
    team = [another(), another()]
    held = [gpu.upload(np.arange(3)) for gpu in team]
    for gpu in team:
        with pytest.raises(clfur.Stopped), gpu.frame():
            gpu.stop()
            gpu.download(held[0])
    assert [gpu.download(array).tolist() for gpu, array in zip(team, held, strict=True)] == 2 * [[0, 1, 2]]


def _interrupted(monkeypatch, gpu, at):
    """Ctrl-C comes at the launch number ``at`` from now on."""
    launch, count = type(gpu).launch, itertools.count(1)

    def interrupted(self, name, *given, **arguments):
        if next(count) == at:
            raise KeyboardInterrupt
        launch(self, name, *given, **arguments)
        if next(count) == at:
            raise KeyboardInterrupt
    monkeypatch.setattr(type(gpu), "launch", interrupted)


@pytest.mark.parametrize("way", ["default", "scattering", "shells"])
def test_ctrl_c_at_any_launch_leaves_no_trace(gpu, way, monkeypatch):
    scene, how = WAYS[way]
    draw = partial(clfur.draw, scene, gpu, hashes=True, **{"settings": QUICK} | how)
    want = draw()
    for at in (1, 2, 9, 16, 25, 36):
        gpu.forget()
        with monkeypatch.context() as patch:
            _interrupted(patch, gpu, at)
            with pytest.raises(KeyboardInterrupt):
                draw()
        same(want, draw())


def test_frames_and_blurred(gpu):
    scenes, cameras = [_scene(), _scene(400), _scene()], [clfur.Camera(size=(20, 16))] * 3
    draw = partial(clfur.blurred, scenes, gpu, QUICK, ("color", "depth"), True)
    _all_ways(lambda stop: draw(stop=stop), [gpu], draw())
    stop = Asked()
    frames = clfur.frames(scenes[0], cameras, gpu, QUICK, stop=stop)
    first = next(frames).images["color"]
    stop.at = stop.times + 3
    with pytest.raises(clfur.Stopped):
        next(frames)
    np.testing.assert_array_equal(clfur.render(attrs.evolve(scenes[0], camera=cameras[0]), gpu, QUICK), first)


def _moving(gpu, **more):
    def scene(seconds):
        still = _both(_scene(50))
        return attrs.evolve(still, mesh=attrs.evolve(still.mesh, positions=still.mesh.positions + (seconds, 0, 0)))
    fur = {"wind": clfur.Wind((3, 0, 1), .5, .5, shelter=.5), "units_per_metre": 2, "body": True}
    return clfur.Motion(scene, device=gpu, **fur | more)


@pytest.mark.parametrize("ctrl_c", [False, True])
def test_a_step_is_done_or_has_not_begun(gpu, ctrl_c, monkeypatch):
    """With body, undercoat, wind and hair on hair: what is stopped is done again, to the same bits, as are states."""
    whole, broken = _moving(gpu, hair_on_hair=.1), _moving(gpu, hair_on_hair=.1)
    times = 0   # that a step asks
    for frame in (1, 2, 3):
        scene, before = whole.at(frame), broken.state()
        counted = Asked()
        for at in _stops(times - 4, 3) if times else ():
            with monkeypatch.context() as patch:
                if ctrl_c:
                    _interrupted(patch, gpu, at)
                with pytest.raises(KeyboardInterrupt if ctrl_c else clfur.Stopped):
                    broken.at(frame, None if ctrl_c else Asked(at))
            for name, value in broken.state().items():
                np.testing.assert_array_equal(value, before[name], err_msg=name)
        again = broken.at(frame, counted)
        times = counted.times
        assert times > 10 and broken.time == whole.time
        for name, value in whole.state().items():
            np.testing.assert_array_equal(broken.state()[name], value, err_msg=name)
        for one, other in zip(again.fur, scene.fur):
            name = "points" if isinstance(one, clfur.Curves) else "lean"
            np.testing.assert_array_equal(getattr(one.on_host, name), getattr(other.on_host, name))
        np.testing.assert_array_equal(*(gpu.download(each.between(.4).strands.points) for each in (broken, whole)))


def test_a_film_goes_on_where_it_was_stopped(gpu, tmp_path):
    def scene(seconds):
        return _scene(50)
    film = partial(clfur.film, scene, motion={}, settings=QUICK, device=gpu, shutter=180, subframes=2)
    film(path=tmp_path / "whole/%d.png", frames=range(5))
    counted = Asked()
    film(path=tmp_path / "count/%d.png", frames=range(5), stop=counted)
    for at in _stops(counted.times, 3):
        with suppress(clfur.Stopped):
            film(path=tmp_path / f"{at}/%d.png", frames=range(5), stop=(stop := Asked(at)))
        there = [path.name for path in (tmp_path / f"{at}").glob("*")] if (tmp_path / f"{at}").exists() else []
        done = sum(name.endswith(".png") for name in there) == 5   # pieces hang on the clock
        assert stop.times == at or (stop.times < at and done)
        assert not [name for name in there if name.endswith("tmp")]
        film(path=tmp_path / f"{at}/%d.png", frames=range(5))
        for k in range(5):
            assert (tmp_path / f"{at}/{k}.png").read_bytes() == (tmp_path / f"whole/{k}.png").read_bytes()


def test_a_video_is_not_half_written(gpu, tmp_path):
    pytest.importorskip("av")
    told = []
    film = partial(clfur.film, _scene(), tmp_path / "a.gif", range(3), settings=QUICK, device=gpu)
    with pytest.raises(clfur.Stopped):
        film(progress=lambda *of: told.append(of), stop=lambda: told[-1:] == [("video", 1, 3)])
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif.frames"]
    assert film() == tmp_path / "a.gif" and [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_strands_that_are_grown_and_saved(gpu, tmp_path):
    """Given up half way no file is there, and what is grown later is the same."""
    scene, counted = _scene(), Asked()
    want = clfur.grow(scene, gpu, counted)
    for at in _stops(counted.times, 3):
        with pytest.raises(clfur.Stopped):
            clfur.grow(scene, gpu, Asked(at))
        np.testing.assert_array_equal(clfur.grow(scene, gpu).points, want.points)
    for suffix, most in (".npz", 2), (".txt", 300), (".pbrt", 300):   # strands, and once more
        clfur.save_curves(tmp_path / f"whole{suffix}", want, counted := Asked())
        assert counted.times >= most
        for at in _stops(counted.times, 3):
            with pytest.raises(clfur.Stopped):
                clfur.save_curves(tmp_path / f"half{suffix}", want, Asked(at))
    assert sorted(each.suffix for each in tmp_path.iterdir()) == [".npz", ".pbrt", ".txt"]


def test_what_stop_is(gpu):
    scene, flag = _scene(), threading.Event()
    assert issubclass(clfur.Stopped, Exception) and not issubclass(clfur.Stopped, clfur.Error)
    clfur.render(scene, gpu, QUICK, stop=flag.is_set)
    flag.set()
    with pytest.raises(clfur.Stopped, match="^it was stopped, as its caller wanted$"):
        clfur.render(scene, gpu, QUICK, stop=flag.is_set)
    with pytest.raises(ZeroDivisionError):   # its own errors are its caller's
        clfur.render(scene, gpu, QUICK, stop=lambda: 1 / 0)
    for call in (clfur.draw, clfur.render, clfur.film, clfur.grow, lambda scene, **stop: clfur.blurred([scene], **stop),
                 lambda scene, **stop: clfur.save_curves("a.npz", clfur.Curves(np.zeros((1, 2, 3))), **stop),
                 lambda scene, **stop: list(clfur.frames(scene, [scene.camera], **stop)),
                 lambda scene, **stop: clfur.Motion(scene).step(1, **stop)):
        given = {"path": "a/%d.png"} if call is clfur.film else {}
        with pytest.raises(clfur.Error, match="stop is True; allowed: None, or a function without arguments"):
            call(scene, stop=True, **given)
