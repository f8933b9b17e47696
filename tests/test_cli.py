"""The `clfur` command: what it draws and says, and one line for what the user got wrong."""

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import attrs
import numpy as np
import pytest
from support import gltf
from support.command import wrong

from clfur import Settings, load, load_header, save

SMALL = ["--size", "64x48", "--inner", "2", "--outer", "2", "--samples", "1"]


def test_render(clfur, tmp_path):
    code, out, err = clfur("render", "sphere", *SMALL)
    assert (code, err) == (0, "")
    told = out.splitlines()
    assert re.fullmatch(r"sphere\.png: 7,680 strands in \d+\.\d\d s on \S.*", told[0]) and len(told[0]) <= 100
    assert all(re.fullmatch(r"    of these \d+\.\d\d s to build kernels", line) for line in told[1:])
    assert (tmp_path / "sphere.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    assert [file.name for file in tmp_path.iterdir()] == ["sphere.png"]


@pytest.mark.parametrize("fur", ["shells", "both"])
def test_shells(clfur, fur):
    sparse = ("--roots", 300) if fur == "both" else ()
    code, out, err = clfur("render", "sphere", "--fur", fur, "--size", "64x48", "--samples", 1, "--frequency", 9,
                           "--layers", 7, "--json", "--outputs", "color,id", "-o", "fur.npz", *sparse)
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert (result["shells"]["layers"], result["shells"]["frequency"], result["shells"]["pattern"]) == (7, 9, "cells")
    assert (result["strands"] > 0) == (fur == "both") and {"shells", "entries", "march"} <= set(result["stages"])
    with np.load("fur.npz") as drawn:
        assert (drawn["id"] == -3).any() and drawn["color"][..., 3].max() > .9
    code, out, err = clfur("render", "sphere", "--fur", fur, "--size", "32x24", "--samples", 1)
    assert (code, err) == (0, "") and "30 layers of shells" in out and ("strands" in out) == (fur == "both")


def test_json(clfur, tmp_path):
    code, out, err = clfur("render", "sphere", *SMALL, "--roots", 500, "--segments", 3, "--json",
                           "-o", "a.png")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert {"file", "size", "device", "triangles", "strands", "segments", "seconds", "stages",
            "skipped"} <= set(result)
    assert (result["file"], result["size"]) == ("a.png", [64, 48])
    assert (result["strands"], result["segments"]) == (500, 1500)
    assert result["triangles"] > 0 and result["seconds"] > 0 and all(s >= 0 for s in result["stages"].values())
    assert result["skipped"] == {"degenerate": 0, "zero_normal": 0, "doubled": 0}
    assert (tmp_path / "a.png").stat().st_size > 500


FURRY = ["--size", "64x48", "--inner", "1", "--outer", "1", "--roots", "500"]


def test_max_error(clfur):
    """What was chosen, how wrong it is and why; the same as the settings given one by one."""
    code, out, err = clfur("render", "sphere", *FURRY, "--max-error", ".07", "--blur", "edges", "-o", "a.npz", "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert 0.02 < result["error"] <= 0.07 and result["why"].startswith("tried ")
    assert result["settings"]["max_error"] is None
    assert set(result["settings"]) == {field.name for field in attrs.fields(Settings)}
    assert result["options"]["grid"] == result["settings"]["grid"] and result["settings"]["blur"] == "edges"
    given = [part for name in ("samples", "raster", "lod", "grid", "shadow_map", "pcf", "blur")
             for part in (f"--{name.replace('_', '-')}", result["settings"][name])]
    assert clfur("render", "sphere", *FURRY, *given, "-o", "b.npz")[0] == 0
    with np.load("a.npz") as one, np.load("b.npz") as other:
        assert np.array_equal(one["color"], other["color"])
    code, out, err = clfur("render", "sphere", *FURRY, "--max-error", "0.3")
    assert (code, err) == (0, "") and "    1 sample, shadow grid 48, map 256, pcf 0, lod 0.5: error about 0." in out
    code, out, err = clfur("render", "sphere", *FURRY, "--json")
    result = json.loads(out)
    assert (result["error"], result["why"], result["settings"]["samples"]) == (None, "", 4)


def test_budget(clfur, tmp_path):
    code, out, err = clfur("render", "sphere", *FURRY, "--budget", "100", "--json")
    result = json.loads(out)
    assert (code, err) == (0, "") and result["why"].startswith("its frame took 0.")
    assert result["settings"]["shadows"] == "deep"
    code, out, err = clfur("render", "sphere", *FURRY, "--budget", "1e-6", "--json")
    assert code == 0 and json.loads(out)["settings"]["samples"] == 1
    assert err.startswith("clfur: warning: Settings.seconds is 1e-06, but the fastest") and err.count("\n") == 1
    code, _, err = clfur("render", "sphere", *FURRY, "--max-error", "1e-6")
    assert code == 0 and err.startswith("clfur: warning: Settings.max_error is 1e-06, but the best there is errs by ")
    (tmp_path / "fur.py").write_text(SCENE_FILE + "settings = clfur.Settings(max_error=0.2)")
    code, out, _ = clfur("render", "fur.py", "--json")
    assert code == 0 and json.loads(out)["error"] <= 0.2


@pytest.mark.parametrize("file", ["a.exr", "a.npz"])
def test_transparent_strands(clfur, tmp_path, file):
    code, out, err = clfur("render", "sphere", *SMALL, "--raster", "coverage", "--width", .002, "--json", "-o", file,
                           "--outputs", "color,depth,id,coverage")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["options"]["raster"] == "coverage" and "coverage" in result["stages"]
    assert (tmp_path / file).stat().st_size > 500
    if file == "a.npz":
        with np.load(tmp_path / file) as saved:
            np.testing.assert_allclose(saved["color"][..., 3], saved["coverage"], atol=1e-5)
            partly = (saved["coverage"] > 0) & (saved["coverage"] < 1)
            assert partly.any() and saved["id"].max() > 0


def test_outputs_in_exr_are_read_back(clfur, tmp_path):
    """With the camera and the settings that they were drawn with; of a region that which sees it."""
    names = "color,id,hair_alpha,type_alpha,matte_id,matte_alpha,position"
    for region, size in ((), (64, 48)), (("--region", "9,7,20,30"), (20, 30)):
        code, _, err = clfur("render", "sphere", *SMALL, "--samples", "1", "-o", "a.exr", "--outputs", names, *region)
        assert (code, err) == (0, "")
        found, about = load(tmp_path / "a.exr"), load_header(tmp_path / "a.exr")
        assert set(found) == set(names.split(",")) and found["hair_alpha"].max() > .5
        assert about["camera"].size == size and about["settings"]["samples"] == 1
        seen = np.isfinite(found["position"]).all(2)
        row, column = np.nonzero(seen)
        camera = about["camera"]
        there = (found["position"][seen] - camera.pose[:3, 3]) @ camera.pose[:3, :3]
        (focal, _, cx), (_, _, cy), _ = camera.intrinsics
        np.testing.assert_allclose(-there[:, 0] / there[:, 2] * focal + cx, column + .5, atol=1e-3)
        np.testing.assert_allclose(there[:, 1] / there[:, 2] * focal + cy, row + .5, atol=1e-3)


def test_outputs(clfur, tmp_path):
    code, _, err = clfur("render", "sphere", *SMALL, "-o", "a.npz", "--outputs", "color,depth,id")
    assert (code, err) == (0, "")
    with np.load(tmp_path / "a.npz") as saved:
        assert {name: saved[name].shape for name in saved} == {
            "color": (48, 64, 4), "depth": (48, 64), "id": (48, 64)}
        assert np.isfinite(saved["depth"]).any() and np.isfinite(saved["color"]).all()


def test_same_picture_for_the_same_colour(clfur, tmp_path):
    for name, color in ("a", "#ff0000"), ("b", "1,0,0"):
        assert clfur("render", "sphere", *SMALL, "-o", f"{name}.png", "--color", color)[0] == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_camera(clfur, tmp_path):
    for name, options in {
        "framed": (), "above": ("--eye", "0,5,0"), "aside": ("--target", "9,0,0"), "wide": ("--fov", "90"),
    }.items():
        assert clfur("render", "sphere", *SMALL, "-o", f"{name}.npz", *options)[0] == 0
    coverage = {file.stem: np.load(file)["color"][..., 3] for file in tmp_path.iterdir()}
    assert coverage["above"].any() and coverage["framed"].any()
    assert not coverage["aside"].any()                                   # it looks past the sphere
    assert not np.array_equal(coverage["above"], coverage["framed"])
    # Whatever the field of view, the sphere is framed.
    assert 0.6 < coverage["wide"].sum() / coverage["framed"].sum() < 1.4


def test_hair_types(clfur, tmp_path):
    """A map of one colour means the type of that colour; what the type leaves out is the options'."""
    import imageio.v3 as imageio
    imageio.imwrite(tmp_path / "map.png", np.full((2, 2, 3), (0, 255, 0), np.uint8))
    (tmp_path / "types.json").write_text(json.dumps([
        {"key": [255, 0, 0], "segments": 0}, {"key": [0, 255, 0], "segments": 5, "color": "#ff0000"}]))
    fur = "--type-map", "map.png", "--types", "types.json", "--json"
    code, out, err = clfur("render", "sphere", *SMALL, *fur)
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["segments"] == 5 * result["strands"] > 0


SCENE_FILE = """
import clfur
print("making the scene")
scene = clfur.Scene(mesh=clfur.load_mesh("sphere"), fur=clfur.Strands(inner=1, outer=1, roots=50),
                    camera=clfur.Camera(size=(40, 30)))
"""


def test_scene_file(clfur, tmp_path):
    """What it prints goes to stderr: stdout is the command's."""
    (tmp_path / "fur.py").write_text(SCENE_FILE)
    code, out, err = clfur("render", "fur.py", "--samples", "16", "--json")
    assert (code, err) == (0, "making the scene\n")
    result = json.loads(out)
    assert (result["file"], result["size"], result["strands"]) == ("fur.png", [40, 30], 50)
    assert result["options"] == {"samples": 16, "raster": "coverage", "shadows": "length", "grid": 96, "lod": 0.0}
    assert result["camera"] == {"eye": pytest.approx([0, 0.4, 3.2]), "target": [0, 0, 0]}


def test_scene_file_with_settings_and_no_mesh(clfur, tmp_path):
    (tmp_path / "fur.py").write_text(
        "import clfur, numpy\nsettings = clfur.Settings(samples=1, shadows='off')\n"
        "scene = clfur.Scene(fur=clfur.Curves(numpy.eye(3, dtype='f4')[None], width=0.1), camera=clfur.Camera."
        "calibrated(clfur.Camera().pose, clfur.Camera().intrinsics, (40, 30)))\n"
        "if __name__ == '__main__':\n    raise SystemExit\n")
    code, out, err = clfur("render", "fur.py", "--json")
    assert (code, err) == (0, "clfur: warning: nothing of the scene is to be seen in the picture\n")
    result = json.loads(out)
    assert result["options"] == {"samples": 1, "raster": "coverage", "shadows": "off", "grid": 96, "lod": 0.0}
    assert (result["strands"], result["camera"]["target"]) == (1, None)
    assert result["skipped"] == {"degenerate": 0, "zero_normal": 0, "doubled": 0}


MOVING_FILE = """import clfur
ball = clfur.load_mesh("sphere")
def scene(t):
    print(f"at {t}")
    mesh = clfur.Mesh(positions=ball.positions + (t / 2, 0, 0), faces=ball.faces)
    fur = clfur.Strands(roots=50, types=clfur.HairType(length=.4, stiffness=4, width=.05))
    return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(size=(40, 30)))
"""


def test_a_scene_file_of_time(clfur, tmp_path):
    """Its function at --time; with `motion` hair lags behind, as clfur.Motion says, drawn and grown."""
    (tmp_path / "still.py").write_text(MOVING_FILE)
    (tmp_path / "moving.py").write_text(MOVING_FILE + "motion = {'units_per_metre': 2, 'rate': 60}\n")
    drawn = {}
    for name, options in ("still", ["--time", ".6"]), ("moving", ["--time", ".6"]), ("moving", []):
        code, out, err = clfur("render", f"{name}.py", "--json", "-o", "a.npz", *options)
        assert code == 0 and ("at 0.6\n" in err) == bool(options)
        drawn[name, bool(options)] = json.loads(out)["steps"], load("a.npz")["color"]
    assert [steps for steps, _ in drawn.values()] == [0, 15, 0]   # 14 frames of a 24th of a second, and what is left
    assert np.abs(drawn["moving", True][1] - drawn["still", True][1]).max() > .05
    _, out, _ = clfur("render", "moving.py", "--time", ".5")
    assert "    moved by 0.5 s in 12 steps\n" in out
    for name in "still", "moving":
        assert clfur("grow", f"{name}.py", "--time", ".5", "-o", f"{name}.npz")[0] == 0
    import clfur as library
    there = runpy.run_path("moving.py")
    motion = library.Motion(there["scene"], **there["motion"]).at(12)
    found = {name: library.load_curves(f"{name}.npz").points for name in ("still", "moving")}
    np.testing.assert_allclose(found["moving"], motion.strands.on_host.points, atol=1e-6)
    assert .005 < np.abs(found["still"] - found["moving"]).max() < .8


def test_a_shutter(clfur, tmp_path):
    """The mean of a scene file at the middles of parts of the time before --time, with `motion` and without."""
    (tmp_path / "still.py").write_text(text := MOVING_FILE.replace("print", "str"))
    (tmp_path / "moving.py").write_text(text + "motion = {'units_per_metre': 2}\n")
    import clfur as library
    there = runpy.run_path("moving.py")
    motion = library.Motion(there["scene"], **there["motion"])
    motion.at(11)
    motion.step(.5 - 11 / 24 - 1 / 48)
    motion.step(1 / 48)
    for name, at in ("still", lambda share: there["scene"](.5 - (1 - share) / 48)), ("moving", motion.between):
        options = ["render", f"{name}.py", "--time", ".5", "--shutter", "180", "--shadows", "off", "-o", "a.npz"]
        code, out, _ = clfur(*options, "--subframes", "2")
        assert code == 0 and "    the mean of 2 pictures\n" in out and ("13 steps" in out) == (name == "moving")
        meant = library.blurred([at(.25), at(.75)], settings=library.Settings(shadows="off")).images["color"]
        np.testing.assert_allclose(load("a.npz")["color"], meant, atol=1e-5)
        code, out, _ = clfur(*options, "--fps", "1", "--json")
        assert code == 0 and json.loads(out)["pictures"] == library.subframes(there["scene"](0), at(1))
        assert clfur(*options[:4], "--fps", "48", "--outputs", "id,motion_vector", "-o", "a.exr")[0] == 0
        found, meant = load("a.exr"), library.render(at(1), outputs=("id", "motion_vector"), before=at(0))
        on = (found["id"] == meant["id"]) & (found["id"] != -1)
        assert on.mean() > .1
        np.testing.assert_allclose(found["motion_vector"][on], meant["motion_vector"][on], atol=1e-3)


@pytest.mark.parametrize("text, options, words", [
    (MOVING_FILE, ["--shutter", "180"], ["--time is 0, but what is asked for begins 0.0208333 s before"]),
    (SCENE_FILE, ["--shutter", "180"], ["--shutter and motion_vector are of what moves; allowed: a scene"]),
    (SCENE_FILE, ["--outputs", "motion_vector", "-o", "a.exr"], ["--shutter and motion_vector are of what moves"]),
    (MOVING_FILE, ["--time", "1", "--shutter", "9", "--outputs", "motion_vector", "-o", "a.exr"], [
        "motion_vector is of pictures without --shutter"]),
    (MOVING_FILE, ["--subframes", "2"], ["--subframes is of a shutter, but there is none; allowed: with --shutter\n"]),
    (MOVING_FILE, ["--fps", "30"], ["--fps is of a shutter", "allowed: with --shutter or --outputs motion_vector"]),
    (MOVING_FILE, ["--shutter", "361"], ["--shutter", "'361' is not a number from 0 to 360"]),
    (MOVING_FILE, ["--shutter", "1", "--subframes", "65"], ["'65' is not auto or a whole number from 1 to 64"]),
    (MOVING_FILE.replace("return ", ""), [], ["fur.py: scene(0) is None; allowed: a clfur.Scene"]),
    (MOVING_FILE.replace("print(", "1 / (t - .5); ("), ["--time", ".5"], [
        "fur.py, line 4, scene(0.5): ZeroDivisionError: float division by zero"]),
    (MOVING_FILE.replace("(t)", "()"), [], ["fur.py sets scene as a function, but too many positional arguments"]),
    (MOVING_FILE + "motion = {'winds': 3}", [], ["fur.py sets motion['winds']; allowed: motion = {...} of hair,"]),
    (MOVING_FILE + "motion = {'fps': 3}", [], ["fur.py sets motion['fps']"]),
    (MOVING_FILE + "motion = 3", [], ["fur.py sets motion = 3; allowed: motion = {...} of hair, rate,"]),
    (MOVING_FILE + "motion = {'rate': 0}", ["--time", "1"], ["fur.py: Motion.rate is 0; allowed"]),
    (MOVING_FILE + "motion = {}", ["--time", "-1"], ["--time is -1; allowed: from 0, as fur.py sets motion"]),
    (SCENE_FILE, ["--time", "1"], ["--time", "fur.py sets this itself"]),
    (SCENE_FILE, ["--size", "64x48"], ["--size", "fur.py sets this itself"]),
    (SCENE_FILE, ["--seed", "0"], ["--seed", "fur.py sets this itself"]),
    (SCENE_FILE + "settings = clfur.Settings()", ["--samples", "16"], ["--samples", "fur.py sets this itself"]),
    (SCENE_FILE + "settings = clfur.Settings()", ["--preset", "draft"], ["--preset", "fur.py sets this itself"]),
    (SCENE_FILE + "settings = clfur.Settings()", ["--max-error", ".1"], ["--max-error", "fur.py sets this itself"]),
    ("", [], ["fur.py sets no scene; allowed: scene = clfur.Scene(...)"]),
    ("scene = 'fur'", [], ["fur.py sets scene = 'fur'; allowed: scene = clfur.Scene(...)"]),
    (SCENE_FILE + "settings = 16", [], ["fur.py sets settings = 16; allowed: settings = clfur.Settings(...)"]),
    ("import clfur\n\nclfur.Light(direction=\n(0, 0, 0))", [], ["fur.py, line 3: Light.direction"]),
    ("def f():\n    return 1 / 0\n\nf()", [], ["fur.py, line 2: ZeroDivisionError: division by zero"]),
    ("x = 1\nscene = (", [], ["fur.py, line 2: SyntaxError: '(' was never closed"]),
    ("x = 1\nimport sys; sys.exit('bye')", [], ["fur.py, line 2: SystemExit: bye"]),
    ("import clfur\nclfur.Light(dirction=(0, 0, 1))", [], [
        "fur.py, line 2: TypeError: ", "keyword argument 'dirction'", "allowed: direction, color, ambient, position"]),
    ("class Light:\n    pass\nLight(dirction=3)", [], ["fur.py, line 3: TypeError: Light() takes no arguments\n"]),
    ("x = 1\nimport nowhere", [], ["fur.py, line 2: ModuleNotFoundError: No module named 'nowhere'"]),
    (None, [], ["fur.py: no such file"]),
])
def test_wrong_scene_file(clfur, tmp_path, text, options, words):
    if text is not None:
        (tmp_path / "fur.py").write_text(text.replace("print", "str"))
    wrong(clfur("render", "fur.py", *options), *words)
    assert [file.name for file in tmp_path.iterdir()] == ["fur.py"] * (text is not None)


def test_skipped_faces_are_counted(clfur, tmp_path):
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 3\nf 1 2 4\n")
    code, out, err = clfur("render", "m.obj", *SMALL)
    assert (code, err) == (0, "") and out.splitlines()[-1] == "    skipped faces: 1 degenerate"


def test_faces_that_are_inside_out_or_doubled_are_told(clfur, tmp_path):
    """A tetrahedron wound inwards, and one face of it a second time, from both sides."""
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
                                    "f 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\nf 2 3 4\nf 2 4 3\n")
    code, out, err = clfur("render", "m.obj", "--size", "8x8", "--roots", 9, "-o", "a.png")
    assert (code, err) == (0, "")
    assert out.splitlines()[-2:] == ["    skipped faces: 2 doubled", "    turned 3 faces that were inside out"]
    code, out, err = clfur("render", "m.obj", "--size", "8x8", "--roots", 9, "-o", "a.png", "--json")
    result = json.loads(out)
    assert (result["skipped"]["doubled"], result["turned"], result["one_sided"]) == (2, 3, 0)


@pytest.mark.parametrize("arguments, words", [
    (["rendr"], ["rendr"]),
    (["render"], ["MESH"]),
    (["render", "sphere", "--szie", "64x48"], ["--szie", "--size"]),
    (["render", "sphere", "teapot"], ["teapot"]),
    (["render", "sphere", "--size"], ["--size"]),
    (["render", "sphere", "--size", "64"], ["--size", "'64'", "640x480"]),
    (["render", "sphere", "--size", "0x48"], ["--size", "0x48"]),
    (["render", "sphere", "--size", "-4x48"], ["--size", "-4x48"]),
    (["render", "sphere", "--size", "99999x99999"], ["99999"]),
    (["render", "sphere", "--inner", "0"], ["--inner", "64"]),
    (["render", "sphere", "--outer", "65"], ["--outer", "64"]),
    (["render", "sphere", "--inner", "2.5"], ["--inner", "2.5"]),
    (["render", "sphere", "--segments", "256"], ["--segments", "255"]),
    (["render", "sphere", "--length", "-1"], ["--length"]),
    (["render", "sphere", "--width", "nan"], ["width", "nan"]),
    (["render", "sphere", "--color", "#12345"], ["--color", "#12345"]),
    (["render", "sphere", "--color", "1,2"], ["--color", "1,2"]),
    (["render", "sphere", "--force", "0,-1,inf"], ["force", "inf"]),
    (["render", "sphere", "--roots", "many"], ["--roots", "many", "faces"]),
    (["render", "sphere", "--variation", "2"], ["--variation"]),
    (["render", "sphere", "--samples", "3"], ["--samples", "16"]),
    (["render", "sphere", "--specular", "none"], ["--specular", "half-vector"]),
    (["render", "sphere", "--eye", "0,0,0", "--target", "0,0,0"], ["Camera.target"]),
    (["render", "sphere", "--fov", "180"], ["fov", "180"]),
    (["render", "sphere", "--light", "0,0,0"], ["direction"]),
    (["render", "sphere", "--light", "lamp"], ["--light", "lamp", "sun, point or spot"]),
    (["render", "sphere", "--light", "sun colour=1"], ["light sun has no 'colour'", "color, intensity"]),
    (["render", "sphere", "--light", "sun size=wide"], ["size is 'wide'", "a number"]),
    (["render", "sphere", "--light", "spot angle=3"], ["position=X,Y,Z"]),
    (["render", "sphere", "--light", "sun shadows=no"], ["on or off"]),
    (["render", "sphere", "--light", "sun color=#12"], ["#rrggbb"]),
    (["render", "sphere", "--seed", "-1"], ["seed", "-1"]),
    (["render", "sphere", "--outputs", "colour", "-o", "a.npz"], ["colour", "color"]),
    (["render", "sphere", "--outputs", "hair_alfa", "-o", "a.exr"], ["there is no output 'hair_alfa'", "hair_alpha"]),
    (["render", "sphere", "--outputs", "strand_area", "-o", "a.exr"], ["--outputs", "cannot hold strand_area", ".npz"]),
    (["render", "sphere", "--outputs", "color,matte_id", "-o", "a.exr"], ["--outputs", "cannot hold matte_id alone"]),
    (["render", "sphere", "--outputs", "color,depth"], ["a.png", "npz"]),
    (["render", "sphere", "--device", "abacus"], ["abacus", "allowed: auto, "]),
    (["render", "sphere", "--type-map", "map.png"], ["--types"]),
    (["render", "sphere", "--types", "types.json"], ["types.json"]),
    (["render", "sphere", "--preset", "best"], ["--preset", "draft", "reference"]),
    (["render", "sphere", "--max-error", "0"], ["--max-error", "above 0"]),
    (["render", "sphere", "--max-error", "0.1", "--samples", "4"], ["--max-error chooses what --samples sets"]),
    (["render", "sphere", "--raster", "samples", "--budget", "1"], ["--budget chooses what --raster sets"]),
    (["render", "sphere", "--budget", "1", "--max-error", "0.1", "--lod", "0"], ["--budget", "--lod"]),
    (["render", "sphere", "--budget", "1", "--shadows", "length"], ["--budget", "--shadows"]),
    (["render", "sphere", "--budget", "1", "--grid", "48"], ["--budget", "--grid"]),
    (["render", "sphere", "--budget", "1", "--preset", "final"], ["--budget", "--preset"]),
    (["render", "missing.obj"], ["missing.obj"]),
    (["render", "cow"], ["cow"]),
])
def test_wrong_arguments(clfur, tmp_path, arguments, words):
    named = any(flag in arguments for flag in ("-o", "rendr")) or arguments == ["render"]
    wrong(clfur(*arguments, *([] if named else ["-o", "a.png"])), *words)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name, content", [
    ("mesh.txt", "hello"),
    ("mesh.obj", ""),
    ("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n"),
    ("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1e999 0\nf 1 2 3\n"),
    ("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n"),
    ("mesh.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"),
    ("mesh.glb", "glTF"),
    ("mesh.stl", "solid nothing\nendsolid"),
    ("mesh.ply", "ply\nformat ascii 1.0\nelement vertex 9\n"),
])
def test_wrong_mesh(clfur, tmp_path, name, content):
    (tmp_path / name).write_text(content)
    wrong(clfur("render", name, *SMALL), "mesh")
    assert [file.name for file in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("output", ["missing/a.png", "folder", "folder/", "folder/a.txt", "a", "a.png/b.png"])
def test_output_that_cannot_be_written(clfur, tmp_path, output):
    """Tested before anything is loaded or drawn."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.png").write_text("mine")
    wrong(clfur("render", "missing.obj", "-o", output), output.rstrip("/"))
    assert sorted(file.name for file in tmp_path.rglob("*")) == ["a.png", "folder"]
    assert (tmp_path / "a.png").read_text() == "mine"


@pytest.mark.parametrize("content, words", [
    ("{", ["not JSON"]),
    ("{}", ["list"]),
    ("[1]", ["list"]),
    ("[]", ["types"]),
    ('[{"segmnets": 3}]', ["type 0", "segmnets", "segments"]),
    ('[{"segments": 0.5}]', ["type 0", "HairType.segments"]),
    ('[{"color": "#zzzzzz"}]', ["type 0", "#zzzzzz"]),
    ('[{"color": null}]', ["type 0", "color"]),
    ('[{"color_texture": "missing.png"}]', ["type 0", "missing.png"]),
    ('[{}, {}]', ["type_map"]),
])
def test_wrong_hair_types(clfur, tmp_path, content, words):
    (tmp_path / "types.json").write_text(content)
    wrong(clfur("render", "sphere", "--types", "types.json", *SMALL), *words)
    assert [file.name for file in tmp_path.iterdir()] == ["types.json"]


@pytest.mark.parametrize("command, output", [
    ("render skin.gltf", "skin.png"),   # the mesh's own picture, by the output's usual name
    ("render sphere --sky sky.png -o sky.png", "sky.png"), ("render sphere --guides hair.npz -o hair.npz", "hair.npz"),
    ("render sphere --background 4by3.png -o ./4by3.png", "4by3.png"), ("render fur.py -o sky.png", "sky.png"),
    ("grow flat.ply -o flat.ply", "flat.ply"), ("grow sphere --guides hair.npz -o hair.npz", "hair.npz"),
    ("film sphere --sky sky.png -o sky.png", "sky.png"), ("chart sphere --sky sky.png -o sky.png", "sky.png")])
def test_an_input_is_never_overwritten(clfur, tmp_path, command, output):
    """None of a mesh, of an option or of what a scene file reads. What else has that name is, as by any tool."""
    np.savez(tmp_path / "hair.npz", points=np.zeros((20, 3, 3)) + np.arange(3)[:, None])
    for name, height in {"sky.png": 8, "4by3.png": 12, "skin.png": 16}.items():
        save(tmp_path / name, np.ones((height, 16, 4), np.float32))
    (tmp_path / "flat.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    (tmp_path / "fur.py").write_text(
        "import clfur\nclfur.load_picture('sky.png')\n" + SCENE_FILE.replace("print", "str"))
    skin = gltf.File(images=[{"uri": "skin.png"}], textures=[{"source": 0}],
                     materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}])
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    skin.add("nodes", mesh=skin.mesh({"POSITION": skin.accessor(corners), "TEXCOORD_0": skin.accessor(corners[:, :2])},
                                     material=0))
    (tmp_path / "skin.gltf").write_bytes(skin.gltf())
    before = (tmp_path / output).read_bytes()
    wrong(clfur(*command.split()), f"{output} is read by this command and would be overwritten")
    assert (tmp_path / output).read_bytes() == before


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_disk_on_stdout_is_one_line(tmp_path, unbuffered):
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "clfur", "render", "sphere", *SMALL, "-o", str(tmp_path / "a.png")]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=120,
                              env={**os.environ, "PYTHONUNBUFFERED": unbuffered})
    assert done.returncode == 2 and done.stderr == "clfur: error: No space left on device\n"


def test_interrupted(clfur, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt
    monkeypatch.setattr("clfur.command.render.draw", interrupt)
    code, out, err = clfur("render", "sphere")
    assert (code, out, err.strip()) == (130, "", "clfur: interrupted")
    assert not list(tmp_path.iterdir())


def test_help(clfur):
    for arguments in ([], ["--help"], ["render", "--help"]):
        code, out, err = clfur(*arguments)
        assert (code, err) == (0, "") and out.startswith("Usage: clfur")


def test_as_a_process(tmp_path):
    """The same from a shell: exit code 2, one line, no traceback."""
    command = "from clfur.command.main import main; main()"
    checkout = str(Path(__file__).parents[1])   # where clfur is when it is not installed
    done = subprocess.run([sys.executable, "-c", command, "render", "missing.obj"], check=False,
                          cwd=tmp_path, env=os.environ | {"PYTHONPATH": checkout},
                          capture_output=True, text=True, timeout=60)
    wrong((done.returncode, done.stdout, done.stderr), "missing.obj")

@pytest.mark.skipif(os.name == "nt", reason="a shell's")
def test_stdout_and_stderr_may_be_closed(tmp_path):
    line = '"$0" -m clfur render sphere -o "$1" --size 16x12 --roots 50 >&- 2>&-'
    done = subprocess.run(["sh", "-c", line, sys.executable, str(tmp_path / "a.png")], cwd=Path(__file__).parents[1],
                          timeout=300, check=False)
    assert done.returncode == 0 and (tmp_path / "a.png").is_file()
