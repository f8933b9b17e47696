"""`clfur grow`, and `clfur render` with strands of a file."""

import json

import numpy as np
import pytest
from support.command import wrong


def test_grown_strands_come_back(clfur, tmp_path):
    code, out, _ = clfur("grow", "sphere", "-o", "hair.npz", "--inner", 1, "--outer", 1, "--segments", 3)
    assert code == 0 and out == "hair.npz: 1,280 strands, 5,120 points\n"
    code, out, _ = clfur("render", "sphere", "--hair", "hair.npz", "--size", "32x32", "--inner", 2, "--outer", 1)
    assert code == 0 and "1,280 strands, 3,840 segments" in out
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
