"""`clfur grow`, and `clfur render` with strands of a file."""

import json

import numpy as np
import pytest
from support.command import wrong


def test_grown_strands_come_back(clfur, tmp_path):
    code, out, _ = clfur("grow", "sphere", "-o", "hair.npz", "--inner", 1, "--outer", 1, "--segments", 3)
    assert code == 0 and out == "hair.npz: 1,280 strands, 5,120 points\n"
    code, out, _ = clfur("render", "sphere", "--hair", "hair.npz", "--size", "32x32", "--inner", 2, "--outer", 1,
                         "--json")
    told = json.loads(out)
    assert (code, told["strands"], told["segments"]) == (0, 1280, 3840)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hair.npz", "sphere.png"]


@pytest.mark.parametrize("arguments, says", [
    (["render", "sphere", "--hair", "hair.np"], "hair.np: no such file"),
    (["render", "sphere", "--hair", "bad.hair"], "bad.hair: is no .hair file: it does not begin with HAIR"),
    (["render", "sphere", "--hair", "bad.hair", "--curl", "1,2"], "--curl is for hair that grows, but --hair has its "
                                                              "own; allowed: one of them"),
    (["render", "sphere", "--hair", "bad.hair", "--length", 1], "--length is for hair that grows"),
    (["render", "sphere", "--hair", "bad.hair", "--fur", "shells"], "--hair is for strands, but --fur is shells"),
    (["grow", "sphere", "-o", "a.abc"], "a.abc: .abc is not supported; allowed: .hair, "),
    (["grow", "sphere", "-o", "a.hair", "--fur", "shells"], "sphere grows no strands; allowed: with --fur strands"),
    (["grow", "sphere", "-o", "a.hair", "--hair", "bad.hair"], "bad.hair"),
    (["grow", "sphere", "-o", "a.tfx", "--segments", 100, "--inner", 1, "--outer", 1],
     "a.tfx: strands have 101 to 101 points; allowed in .tfx: 2 to 64"),
    (["grow", "sphere"], "Missing option '-o'"),
])
def test_a_wrong_use_is_one_line_and_leaves_nothing(clfur, tmp_path, arguments, says):
    (tmp_path / "bad.hair").write_bytes(bytes(200))
    wrong(clfur(*arguments), says)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.hair"]


def test_grow_has_no_options_of_pictures_and_tells_in_json(clfur, tmp_path):
    code, out, _ = clfur("grow", "--help")
    assert code == 0 and "--curl" in out
    unused = "eye", "light", "sky", "size", "ground", "layers", "raster", "camera"
    assert not any(f"--{name} " in out for name in unused)
    code, out, _ = clfur("grow", "sphere", "-o", "hair.npz", "--inner", 1, "--outer", 1, "--json")
    told = json.loads(out)
    assert code == 0 and (told["file"], told["strands"], told["points"]) == ("hair.npz", 1280, 11520)
    wrong(clfur("grow", "sphere", "-o", "b.npz", "--eye", "0,0,9"), "No such option")


def test_hair_is_given_once(clfur, tmp_path):
    wrong(clfur("render", "sphere", "--hair", "a.npz", "--hair", "b.npz"), "--hair is given 2 times; allowed: once")


def test_strands_of_one_point_are_told(clfur, tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((4, 1, 3)))
    code, _, err = clfur("render", "sphere", "--hair", "a.npy", "--size", "16x16", "--inner", 1)
    assert code == 0 and err == "clfur: warning: strands of a file have one point each, and nothing of them is drawn\n"


def test_a_file_of_guides_shapes_as_many_strands_as_there_are_roots(clfur):
    clfur("grow", "sphere", "-o", "guides.npz", "--roots", 80, "--segments", 12, "--variation", 0)
    code, out, _ = clfur("render", "sphere", "--guides", "guides.npz", "--roots", 3000, "--size", "32x32",
                         "--reach", 0, "--json")
    told = json.loads(out)
    assert (code, told["strands"], told["segments"]) == (0, 3000, 36000)
    code, out, _ = clfur("grow", "sphere", "--guides", "guides.npz", "--roots", 500, "--segments", 4, "-o", "all.npz")
    assert code == 0 and out == "all.npz: 500 strands, 2,500 points\n"
    _, grown = np.load("guides.npz")["points"], np.load("all.npz")["points"].reshape(500, 5, 3)
    reach = np.linalg.norm(grown - grown[:, :1], axis=2).max(1)
    assert reach.max() < .0801 * 3**.5 and reach.min() > .02   # half of the diagonal of the sphere's box, cut by .3


@pytest.mark.parametrize("arguments, message", [
    (["--guides", "no.npz"], "--guides: no.npz: no such file"),
    (["--guides", "far.npz", "--roots", 9], "--guides: Strands.guides has 5 of 5 roots more than 0.0346 away from"),
    (["--guides", "bald.npz"], "--guides: Strands.guides has 5 strands, none of two points or more"),
    (["--guides", "far.npz", "--stiffness", 2], "--stiffness has no say where --guides give strands their shapes"),
    (["--guides", "far.npz", "--hair", "far.npz"], "--hair has no say where --guides give strands their shapes"),
    (["--guides", "far.npz", "--parting", 200], "--parting"),
    (["--parting", 20], "--parting is for strands between --guides"),
    (["--reach", 2], "--reach is for strands between --guides"),
    (["--guides", "far.npz", "--fur", "shells"], "--guides is for strands, but --fur is shells")])
def test_what_guides_cannot_be_is_one_line(clfur, arguments, message):
    np.savez("far.npz", points=np.arange(30).reshape(5, 2, 3) + 5.0)
    np.savez("bald.npz", points=np.zeros((5, 1, 3)))
    for command in ("render", "sphere"), ("grow", "sphere", "-o", "out.npz"):
        code, out, err = clfur(*command, *arguments)
        assert code == 2 and not out and message in err and "Traceback" not in err
