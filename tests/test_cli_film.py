"""The command `clfur film`."""

import json

import numpy as np
import pytest
from support.command import wrong

import clfur as library
from clfur.command.waiting import _left

SMALL = ["--size", "32x24", "--roots", "60", "--samples", "1", "--shadows", "off", "--frames", "0:3"]
FILE = """
import clfur, numpy as np
mesh = clfur.load_mesh("sphere")
def scene(t):
    there = clfur.Mesh(positions=mesh.positions + (t, 0, 0), faces=mesh.faces)
    return clfur.Scene(mesh=there, fur=clfur.Strands(roots=60), camera=clfur.Camera(eye=(0, 0, 4), size=(32, 24)))
settings = clfur.Settings(samples=1, shadows="off")
"""


def _pictures(folder, suffix=".png"):
    return [library.load(path)["color"] for path in sorted(folder.glob(f"*{suffix}"))]


def test_film(clfur, tmp_path):
    """A video by default; told: what is behind it, and how large the mesh is taken to be."""
    code, out, err = clfur("film", "sphere", *SMALL, "--wind", "3,0,0")
    assert (code, err) == (0, "") and len(out.splitlines()) == 3
    assert out.startswith("sphere.mp4: 3 frames of 32x24 in ")
    assert "laid over black, as .mp4 holds no alpha: --background sets another colour" in out
    assert "as if the mesh were 50 cm long: --units-per-metre 4\n" in out
    assert [file.name for file in tmp_path.iterdir()] == ["sphere.mp4"]
    assert clfur("film", "sphere", *SMALL[:-1], "2:3", "-o", "%d.png")[1].endswith(
        "s\n    nothing moves: --wind, --turntable or a scene file can move it\n")
    code, out, _ = clfur("film", "sphere", *SMALL, "-o", "a.webm", "--json")
    told = json.loads(out)
    assert (told.pop("seconds") > 0, code) == (True, 0)
    assert told == {"file": "a.webm", "size": [32, 24], "frames": 3, "there": 0, "fps": 24, "moves": False,
                    "units_per_metre": None, "background": None}


def test_frames_go_on(clfur, tmp_path):
    frames = ["-o", "f/%02d.png", "--bend-length", ".3"]
    assert clfur("film", "sphere", *SMALL, *frames)[0] == 0
    (tmp_path / "f/01.png").unlink()
    assert "    2 of them were there\n" in clfur("film", "sphere", *SMALL, *frames)[1]
    wrong(clfur("film", "sphere", *SMALL, *frames, "--gust", "0", "--wind", "1,0,0"), "f holds another film's frames: "
          "they differ in motion; allowed: another folder, or overwriting them (overwrite=True, --overwrite)")
    assert clfur("film", "sphere", *SMALL, *frames, "--gust", "0", "--wind", "1,0,0", "--overwrite")[0] == 0


@pytest.mark.parametrize("output, there, frames", [
    ("f/%02d.png", "f/%02d.png", "0:3"), ("f/%02d.png", "f/%02d.png", "4:5"), ("a.gif", "a.gif.frames/%06d.png", "0:3")
])
def test_a_frame_that_is_read_stays(clfur, tmp_path, output, there, frames):
    """One of another film, in whose place this one comes, whatever its numbers."""
    assert clfur("film", "sphere", *SMALL, "-o", there)[0] == 0
    name = there % 1
    before = (tmp_path / name).read_bytes()
    wrong(clfur("film", "sphere", *SMALL[:-1], frames, "-o", output, "--body-texture", name, "--overwrite"),
          f"{name} is read by this command and would be overwritten")
    assert (tmp_path / name).read_bytes() == before


def test_motion_and_wind(clfur, tmp_path):
    """Wind moves hair, more of it more; options are those of `Motion`."""
    still, windy, stiff = (_films(clfur, tmp_path, name, *more) for name, more in [
        ("still", []), ("windy", ["--wind", "9,0,0", "--gust", "0", "--units-per-metre", "4"]),
        ("stiff", ["--wind", "9,0,0", "--gust", "0", "--units-per-metre", "4", "--bend-length", ".5"])])
    assert (still[0] == still[2]).all()
    moved, less = (np.abs(one[2] - still[2]).mean() for one in (windy, stiff))
    assert moved > 2 * less > 0


def _films(clfur, folder, name, *more):
    assert clfur("film", "sphere", *SMALL, "-o", f"{name}/%d.png", *more)[0] == 0
    return _pictures(folder / name)


def test_turntable(clfur, tmp_path):
    """Half way it sees the other side, by light that has gone with it; all of it is in the picture from all sides."""
    options = ["--turntable", "--size", "48x36", "--samples", "1", "--roots", "99", "--length", ".4", "--grid", "16"]
    assert clfur("film", "teapot", *options, "--frames", "0:8:2", "-o", "t/%d.png")[0] == 0
    assert _names(tmp_path / "t") == ["0.png", "2.png", "4.png", "6.png"]
    seen = np.stack(_pictures(tmp_path / "t"))
    assert seen[:, [0, -1]].max() == 0 and seen[:, :, [0, -1]].max() == 0 and (seen[..., 3].sum((1, 2)) > 140).all()
    assert np.abs(seen[0] - seen[2]).mean() > 0.01
    light = ["--frames", "0:2", "--light", "sun direction=0,0,-1"]
    for name, more in ("lit", []), ("unlit", ["--turntable", "0"]):
        assert clfur("film", "sphere", *options, *light, *more, "-o", f"{name}/%d.png")[0] == 0
    lit, unlit = (np.stack(_pictures(tmp_path / name))[..., :3].mean((1, 2, 3)) for name in ("lit", "unlit"))
    assert lit[1] < 0.7 * lit[0] and np.ptp(unlit) == 0   # from behind, a light of its own place


def _names(folder):
    return sorted((path.name for path in folder.glob("*.png")), key=lambda name: int(name.partition(".")[0]))


def test_a_scene_file(clfur, tmp_path):
    """Its function, its motion; options have no say in what it sets."""
    (tmp_path / "fur.py").write_text(FILE)
    (tmp_path / "moving.py").write_text(FILE + "motion = {'wind': clfur.Wind((5, 0, 0)), 'units_per_metre': 4}\n")
    for name in ("fur", "moving"):
        code, out, err = clfur("film", f"{name}.py", "--frames", "0:5:4", "-o", f"{name}/%d.exr", "--json")
        assert (code, err, json.loads(out)["moves"]) == (0, "", name == "moving")
    still, moving = (_pictures(tmp_path / name, ".exr") for name in ("fur", "moving"))
    assert np.abs(still[0] - moving[0]).mean() < 1e-4 < np.abs(still[1] - moving[1]).mean()
    assert np.abs(still[0] - still[1]).mean() > 1e-3   # the mesh has moved
    wrong(clfur("film", "moving.py", "--wind", "1,0,0"), "--wind: moving.py sets motion itself; change it there")
    wrong(clfur("film", "fur.py", "--roots", "9"), "--roots: fur.py sets this itself")
    (tmp_path / "hair.py").write_text(FILE + "motion = {'hair': 3}\n")
    wrong(clfur("film", "hair.py", "-o", "bad/%d.png"), "hair.py: Motion.hair is 3; allowed: one HairMotion")
    (tmp_path / "sizes.py").write_text(FILE.replace("(32, 24)", "(32, 24) if t < .05 else (24, 32)"))
    wrong(clfur("film", "sizes.py", "-o", "a.mp4"), "sizes.py: scene(0.0833333) has a picture of 24 x 32, but others")
    (tmp_path / "bad.py").write_text(FILE.replace("(t, 0, 0)", "(1 / (t - 1 / 24), 0, 0)"))
    wrong(clfur("film", "bad.py", "-o", "bad/%d.png"), "bad.py, line 5, scene(0.0416667): ZeroDivisionError")


@pytest.mark.parametrize("options, words", [
    (["--frames", "5"], "'5' is not A:B or A:B:STEP"), (["--frames", "3:3"], "is not A:B or A:B:STEP"),
    (["--frames", "0:9:0"], "is not A:B or A:B:STEP"), (["--frames", "-3:4"], "is not A:B or A:B:STEP"),
    (["--fps", "0"], "'0' is not a number from 1 to 1000"), (["--subframes", "0"], "'0' is not auto or a whole number"),
    (["--gust", "1"], "--gust is how strong gusts of the wind are, but there is none; allowed: with --wind"),
    (["-o", "a.avi"], "a.avi: .avi is not supported; allowed: .mp4, .webm, .mov, .gif, .png, or pictures with a place"),
    (["-o", "a.exr"], "has no place for the number"),
    (["-o", "f/%d%d.png"], "is no name for frames"), (["--shutter", "361"], "'361' is not a number from 0 to 360"),
    (["--subframes", "4"], "--subframes is of a shutter, but there is none; allowed: with --shutter"),
    (["--background", "red"], "'red'"), (["--time", "3"], "No such option"),
    (["-o", "no/f/%d.png"], "there is no folder")])
def test_what_is_wrong(clfur, tmp_path, options, words):
    wrong(clfur("film", "sphere", *SMALL, *options), words)
    assert not list(tmp_path.iterdir())


def test_the_time_left():
    """By the median of the last ones, without the first, of which kernels are built."""
    counted = [("frames", moment) for moment in (0, 40)]
    assert _left(counted, 10) == ""
    counted += [("frames", moment) for moment in (41, 42, 43.5, 44)]
    assert _left(counted, 100) == "about 1:40 left" and _left(counted, 0) == ""
    assert _left(counted[:3], 100) == ""
