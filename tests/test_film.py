"""clfur.film and `clfur film`: frames whole or not at all, restarts to the same bits, and what is refused."""

import gc
import pickle
import sys
import tracemalloc

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.files.images import pixels
from clfur.film import jobs as library
from clfur.film import moments
from clfur.film.turntable import turntable

MOTION = {"wind": clfur.Wind((3, 0, 1), 0.5, 0.5), "units_per_metre": 2}
QUICK = clfur.Settings(shadows="off", shadow_map=0, samples=1)


@pytest.fixture(scope="module")
def device():
    """A Scheduler of the first device: what is drawn is judged elsewhere."""
    return clfur.Scheduler()


def _scene(seconds=0.0, roots=40):
    positions, faces = icosphere(1)
    mesh = clfur.Mesh(positions=positions + (np.sin(seconds), 0, 0), faces=faces)
    fur = clfur.Strands(roots=roots, types=clfur.HairType(length=0.4, segments=4, width=0.02))
    return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=(0, 0.5, 4), size=(19, 13)))


def _film(folder, device, frames=range(7), scene=_scene, name="%03d.png", **given):
    given = {"motion": MOTION, "settings": QUICK} | given
    return clfur.film(scene, folder / name, frames, device=device, **given)


def _bytes(folder, suffix=".png"):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.suffix == suffix}


def test_frames_are_those_that_render_gives(tmp_path, device):
    """Of moving hair and of a scene without motion, by the seconds of each frame; EXR holds its camera."""
    _film(tmp_path / "a", device, range(1, 6, 2), fps=12)
    motion = clfur.Motion(_scene, device=device, fps=12, **MOTION)
    for number in (1, 3, 5):
        clfur.save(tmp_path / "one.png", clfur.render(motion.at(number), device, QUICK))
        assert (tmp_path / f"a/{number:03}.png").read_bytes() == (tmp_path / "one.png").read_bytes()
    _film(tmp_path / "b", device, [3], name="%d.exr", motion=None)
    assert sorted(path.name for path in (tmp_path / "b").iterdir()) == ["3.exr", "film.json"]
    scene = _scene(3 / 24)
    np.testing.assert_array_equal(clfur.load(tmp_path / "b/3.exr")["color"], clfur.render(scene, device, QUICK))
    assert np.abs(clfur.load_header(tmp_path / "b/3.exr")["camera"].pose - scene.camera.pose).max() < 1e-15


def test_a_film_goes_on_where_it_stopped(tmp_path, device, monkeypatch):
    """With motion and wind, from a state that is kept; the same bytes as of a film that nothing has stopped."""
    monkeypatch.setattr(moments, "EVERY", 3)
    _film(tmp_path / "whole", device, range(13))
    drawn, steps = [], []
    draw, step = library.Job.draw, clfur.Motion.step
    monkeypatch.setattr(clfur.Motion, "step", lambda self, *of, **how: steps.append(1) or step(self, *of, **how))

    def failing(self, gpu, stop):
        drawn.append(self.number)
        if len(drawn) == 9:
            raise KeyboardInterrupt
        return draw(self, gpu, stop)
    monkeypatch.setattr(library.Job, "draw", failing)
    with pytest.raises(KeyboardInterrupt):
        _film(tmp_path / "cut", device, range(13))
    there = sorted(path.name for path in (tmp_path / "cut").iterdir())
    assert there == [*(f"{k:03}.png" for k in range(8)), "film.json", "motion-000003.npz", "motion-000006.npz"]
    (tmp_path / "cut/.007.png.999999.tmp").touch()   # of a process that is gone
    (tmp_path / "cut/004.png").unlink()
    drawn.clear(), steps.clear()
    _film(tmp_path / "cut", device, range(13))
    assert drawn == [4, *range(8, 13)] and len(steps) == 12 - 3
    assert _bytes(tmp_path / "cut") == _bytes(tmp_path / "whole")
    assert sorted(path.name for path in (tmp_path / "cut").iterdir()) == [*_bytes(tmp_path / "whole"), "film.json"]
    drawn.clear()
    told = []
    _film(tmp_path / "cut", device, range(4, 13), progress=lambda *of: told.append(of))
    assert not drawn and told == [("frames", 9, 9)]
    told.clear()
    _film(tmp_path / "late", device, range(3, 6), progress=lambda *of: told.append(of))
    assert told == [("frames", 0, 3), *(("motion", k, 3) for k in (1, 2, 3)), *(("frames", k, 3) for k in (1, 2, 3))]


@pytest.mark.parametrize("change, words", [
    ({"settings": clfur.Settings(shadows="off", shadow_map=0, samples=4)}, "differ in settings"),
    ({"motion": MOTION | {"wind": clfur.Wind((3, 0, 1), 0.5, 0.6)}, "fps": 25}, "differ in motion, fps"),
    ({"background": (0, 0, 0)}, "differ in background"),
    ({"scene": lambda t: _scene(t, roots=41)}, "frame 0 shows another scene"),
    ({"scene": lambda t: _scene(t if t < 0.05 else t + 1e-3)}, "frame 2 shows another scene"),
    ({"name": "%04d.png"}, "differ in names of files")])
def test_a_folder_of_another_film_is_refused(tmp_path, device, change, words):
    _film(tmp_path / "a", device, range(3))
    before = _bytes(tmp_path / "a")
    with pytest.raises(clfur.Error, match=words):
        _film(tmp_path / "a", device, **change)
    assert _bytes(tmp_path / "a") == before
    _film(tmp_path / "a", device, range(1, 3), **change, overwrite=True)
    _film(tmp_path / "b", device, range(1, 3), **change)
    there = _bytes(tmp_path / "a")
    there.pop("000.png", None)
    assert there == _bytes(tmp_path / "b") != before


def test_frames_of_nobody_are_not_replaced(tmp_path, device):
    (tmp_path / "005.png").write_bytes(b"mine")
    with pytest.raises(clfur.Error, match="005.png, and no film.json that tells whose it is"):
        _film(tmp_path, device)
    assert [path.name for path in tmp_path.iterdir()] == ["005.png"]


def test_a_frame_that_fails_is_named_and_the_others_stay(tmp_path, device, monkeypatch):
    draw = library.Job.draw

    def failing(self, gpu, stop):
        if self.number == 2:
            raise clfur.DeviceError("out of memory")
        return draw(self, gpu, stop)
    with monkeypatch.context() as patch:
        patch.setattr(library.Job, "draw", failing)
        with pytest.raises(clfur.DeviceError, match="^frame 2: out of memory$"):
            _film(tmp_path / "a", device, range(4))
    assert [*_bytes(tmp_path / "a")] == ["000.png", "001.png"]
    _film(tmp_path / "a", device, range(4))
    _film(tmp_path / "b", device, range(4))
    assert _bytes(tmp_path / "a") == _bytes(tmp_path / "b")


def test_a_job_can_be_sent(device):
    """To another process; over its background; shells in motion and others too."""
    scene = _scene()
    shells = clfur.Shells(length=0.1, frequency=5, layers=4)
    for fur in (scene.fur, shells, (shells, scene.fur), clfur.grow(scene, device)):
        job = library.Job(3, (attrs.evolve(scene, fur=fur),), QUICK, ".png", np.array([0.2, 0.4, 0.6]))
        sent = pickle.loads(pickle.dumps(job))
        assert sent.number == 3 and sent.draw(device) == job.draw(device)
    picture = pixels(job.draw(device))
    assert picture.shape == (13, 19, 3) and picture[0, 0].tolist() == clfur.to_uint8(
        np.full((1, 1, 3), (0.2, 0.4, 0.6), np.float32))[0, 0].tolist()


def test_nothing_is_left_of_a_film_that_cannot_begin(tmp_path, device):
    with pytest.raises(clfur.Error, match="Motion.rate is 0"):
        _film(tmp_path, device, name="a.png", motion={"rate": 0})
    with pytest.raises(clfur.Error, match=r"scene\(0\) is 3; allowed: a clfur.Scene"):
        _film(tmp_path / "frames", device, scene=lambda t: 3)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("given, words", [
    ({"name": "a.avi"}, "a.avi: .avi is not supported; allowed: .mp4, .webm, .mov, .gif, .png"),
    ({"name": "a.exr"}, "a.exr: has no place for the number of a frame; allowed: one, such as .*a-%04d.exr"),
    ({"name": "%d-%d.png"}, "is no name for frames; allowed: one place for a number"),
    ({"name": "%s.png"}, "is no name for frames"), ({"name": "%d.mp4"}, "is no name for frames"),
    ({"name": "a/b/%d.png"}, "there is no folder .*a"), ({"frames": []}, r"frames is \[\]"),
    ({"frames": [1, 1]}, "in rising order"), ({"frames": [-1]}, "frames is -1"), ({"frames": 5}, "frames is 5"),
    ({"fps": 0}, "fps is 0"), ({"motion": 3}, "motion is 3"), ({"shutter": 361}, "shutter is 361"),
    ({"motion": {"winds": 3}}, "motion is {'winds': 3}; allowed: .* hair, rate"), ({"motion": {"fps": 3}}, "motion is"),
    ({"motion": {1: 2}}, "motion is"), ({"progress": 3}, "progress is 3"),
    ({"subframes": 65}, "subframes is 65; allowed: .auto., or"), ({"background": (1, 2)}, "background is"),
    ({"settings": 3}, "settings is 3"),
    ({"overwrite": 3}, "overwrite is 3")])
def test_what_is_refused(tmp_path, device, given, words):
    with pytest.raises(clfur.Error, match=words):
        _film(tmp_path, device, **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("motion", [None, MOTION])
def test_pictures_of_two_sizes_are_refused(tmp_path, device, motion):
    def scene(seconds):
        camera = clfur.Camera(eye=(0, 0.5, 4), size=(19, 13) if seconds < 0.06 else (13, 19))
        return attrs.evolve(_scene(seconds), camera=camera)

    with pytest.raises(clfur.Error, match=r"scene\(0.0833333\) has a picture of 13 x 19, but others of"):
        _film(tmp_path / "a", device, range(4), scene, motion=motion)
    assert [*_bytes(tmp_path / "a")] == ["000.png", "001.png"]


def test_folders_that_cannot_be_written(tmp_path, device):
    (tmp_path / "file").touch()
    with pytest.raises(clfur.Error, match="file: cannot be written: "):
        _film(tmp_path / "file", device)
    (tmp_path / "a.mp4.frames").touch()
    with pytest.raises(clfur.Error, match="a.mp4.frames: cannot be written: "):
        _film(tmp_path, device, name="a.mp4")


def test_pyav_is_asked_for(tmp_path, device, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(clfur.Error, match=r'pip install "clfur\[film\]"; allowed without it: frames of a folder'):
        _film(tmp_path, device, name="a.mp4")
    assert not list(tmp_path.iterdir())


def test_a_turntable_turns_all_but_the_scene(tmp_path, device):
    """The camera alone or with the lights; a quarter of the way it sees the side; what is drawn is the very same."""
    scene = attrs.evolve(_scene(), light=[clfur.Light((1, -1, 0)), clfur.Light(position=(0, 3, 0), angle=30)])
    at = turntable(scene, 360, 4)
    np.testing.assert_allclose(at(1).camera.eye, (4, 0.5, 0), atol=1e-6)
    np.testing.assert_allclose(at(1).camera.pose[:3, 2], (4, 0.5, 0) / np.sqrt(16.25), atol=1e-6)
    np.testing.assert_allclose(at(4).camera.pose, scene.camera.pose, atol=1e-12)
    assert at(1).mesh is scene.mesh and at(1).fur is scene.fur and at(1).light is scene.light
    lit = turntable(scene, 360, 4, lights=True)(1)
    np.testing.assert_allclose(lit.lights[0].direction, (0, -0.5**0.5, -0.5**0.5), atol=1e-6)
    # As if the scene had turned before them; where lights stay, it is another picture.
    positions = scene.mesh.positions @ np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    turned = attrs.evolve(scene, mesh=clfur.Mesh(positions=positions, faces=scene.mesh.faces), fur=None)
    one, other, unlit = (clfur.render(attrs.evolve(each, fur=None), device) for each in (turned, lit, at(1)))
    assert np.abs(one - other).mean() < 1e-4 and np.abs(one - unlit).mean() > 0.003


def test_memory_does_not_grow(tmp_path, device, monkeypatch):
    """On the host, where two hashes of a frame are 300 bytes and a picture or a state 10,000, and on the device."""
    took = {}

    def measure(what, done, of):
        if what == "frames" and done in (20, 60):
            gc.collect()
            took[done] = tracemalloc.get_traced_memory()[0], device._pool.managed_bytes
    monkeypatch.setattr(moments, "EVERY", 3)
    tracemalloc.start()
    try:
        _film(tmp_path / "a", device, range(60), progress=measure)
    finally:
        tracemalloc.stop()
    assert took[60][0] - took[20][0] < 40 * 2000 and took[60][1] < 1.1 * took[20][1]
