"""--map, --on, --comb and what the file of --types says of the skin."""

import json

import numpy as np
import pytest
from PIL import Image
from support.command import wrong
from support.named import OBJ

from clfur import load_curves

SMALL = "-o", "a.png", "--size", "24x18", "--grid", "16", "--shadow-map", "16", "--samples", "1"


@pytest.fixture
def files(tmp_path):
    """A mesh of three faces with names, grey pictures, tiles, and numbers by vertex and by face."""
    (tmp_path / "a.obj").write_text(OBJ, encoding="utf-8")
    Image.fromarray(np.full((4, 4), 128, np.uint8)).save(tmp_path / "half.png")
    Image.fromarray(np.full((2, 2), 255, np.uint8)).save(tmp_path / "ones.1001.png")
    Image.fromarray(np.uint8([[(255, 0, 0), (0, 255, 0)]])).save(tmp_path / "color.png")
    Image.fromarray(np.uint8([[(255, 0, 0), (120, 130, 9)]])).save(tmp_path / "keys.png")
    np.save(tmp_path / "faces.npy", [1, 0, 0])
    np.save(tmp_path / "vertices.npy", np.arange(7) / 7)
    np.save(tmp_path / "ways.npy", np.tile((1, 0, 0), (7, 1)))
    return tmp_path


def strands(clfur, *options):
    """Strands that the command grows."""
    code, _, err = clfur("grow", *options, "-o", "a.npz", "--variation", 0)
    assert (code, err) == (0, ""), err
    return load_curves("a.npz")


def test_maps_of_options(clfur, files):
    all_there = strands(clfur, "sphere", "--roots", 4000)
    half = strands(clfur, "sphere", "--roots", 4000, "--map", "density=half.png", "--map", "width=ones.<UDIM>.png")
    there = len(half.counts)   # without those that are bald
    assert abs(there - 4000 * 128 / 255) < 4 * (4000 / 4)**.5
    assert len(all_there.counts) == 4000 and half.width.max() == all_there.width.max()
    none = strands(clfur, "a.obj", "--map", "length=faces.npy", "--surface", "flat")
    assert 0 < len(none.counts) < len(strands(clfur, "a.obj", "--surface", "flat").counts)


def test_where_hair_grows(clfur, files):
    head = strands(clfur, "a.obj", "--on", "head", "--surface", "flat")
    both = strands(clfur, "a.obj", "--on", "head", "--on", "Fell weiß", "--on", "tail", "--surface", "flat")
    roots = head.points[np.cumsum(head.counts) - head.counts]
    everywhere = strands(clfur, "a.obj", "--surface", "flat")
    assert (roots[:, 0] < 1).all() and 0 < len(head.counts) < len(both.counts) == len(everywhere.counts)


@pytest.mark.parametrize("way", ["1,0,0", "ways.npy"])
def test_hair_is_combed(clfur, files, way):
    hair = strands(clfur, "a.obj", "--comb", way, "--comb-weight", 1, "--force", "0,0,0", "--surface", "flat",
                   "--tufts", "off")
    first = np.cumsum(hair.counts) - hair.counts
    steps = hair.points[first + 1] - hair.points[first]
    ways = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    np.testing.assert_allclose(ways, np.tile((1, 0, 0), (len(first), 1)), atol=1e-2)


def test_all_of_it_in_the_file_of_types(clfur, files):
    groom = {"types": [{"key": [255, 0, 0], "segments": 3}, {"key": [0, 255, 0], "segments": 5}],
             "type_map": "keys.png", "maps": {"density": "half.png", "length": [1, .5, .5]},
             "comb": {"direction": "ways.npy", "weight": .4}, "on": ["head", "tail"]}
    (files / "groom.json").write_text(json.dumps(groom))
    flat = "a.obj", "--surface", "flat", "--inner", 9, "--outer", 9
    maps = "--map", "density=half.png", "--on", "head", "--on", "tail", "--comb", "ways.npy", "--comb-weight", .4
    (files / "types.json").write_text(json.dumps(groom["types"]))
    np.save(files / "lengths.npy", groom["maps"]["length"])
    with_uv = (files / "a.obj").read_text().replace("vn 0 1 0", "vt 0.2 0.5\nvn 0 1 0").replace("//", "/1/")
    (files / "a.obj").write_text(with_uv)
    one = strands(clfur, *flat, "--types", "groom.json")
    other = strands(clfur, *flat, "--types", "types.json", "--type-map", "keys.png", "--map", "length=lengths.npy",
                    *maps)
    for name in "points", "counts":
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert set(one.counts) == {4} and (one.points[np.cumsum(one.counts) - 4, 0] < 2).all()
    (files / "only.json").write_text('{"maps": {"length": [1, 0, 0]}}')
    both = [len(strands(clfur, *flat, "--types", "only.json", *more).counts)
            for more in ((), ("--map", "length=lengths.npy"))]
    assert both[0] < both[1]   # the option counts more
    _, out, _ = clfur("render", *flat, "--types", "groom.json", *SMALL)
    assert "    1 of 2 pixels of the type map are no key: they took the nearest\n" in out
    _, out, _ = clfur("render", *flat, "--types", "groom.json", *SMALL, "--json")
    assert json.loads(out)["inexact"] == 1


@pytest.mark.parametrize("options, words", [
    (["--map", "hair=half.png"], ["--map", "'hair=half.png' is not NAME=FILE; allowed names: density, length"]),
    (["--map", "density"], ["--map", "NAME=FILE"]),
    (["--map", "density=no.png"], ["--map: no.png: no such file"]),
    (["--map", "density=no.<UDIM>.png"], ["--map: no.<UDIM>.png: no such tiles"]),
    (["--map", "density=color.png"], ["--map: Maps.density", "this one has colours"]),
    (["--map", "length=half.png"], ["--map: Maps.length is a picture, looked up by uv"]),
    (["--map", "length=ways.npy"], ["--map: Maps.length"]),
    (["--map", "length=a.obj"], ["--map: a.obj: cannot be read as a picture"]),
    (["--on", "foot"], ["--on: the mesh has no group", "'foot'; allowed: head, ear, tail, body"]),
    (["--comb", "1,2"], ["--comb: 1,2: no such file"]),
    (["--comb", "0,nan,0"], ["--comb: Comb.direction[1]"]),
    (["--comb", "vertices.npy"], ["--comb: Comb.direction"]),
    (["--comb-weight", "0.5"], ["--comb-weight", "--comb"]),
    (["--comb-weight", "2"], ["--comb-weight", "0 to 1"]),
    (["--map", "density=half.png", "--fur", "both"], ["--map is for strands alone, shells do not follow maps"]),
    (["--on", "head", "--fur", "both"], ["--on is for strands alone"]),
    (["--on", "head", "--hair", "a.npz"], ["--on is for hair that grows"]),
])
def test_what_is_wrong_is_one_line(clfur, files, options, words):
    wrong(clfur("render", "a.obj", *options, *SMALL), *words)


@pytest.mark.parametrize("groom, words", [
    ({"mapp": {}}, ["unknown name 'mapp'", "types, type_map, maps, comb, on"]),
    ({"maps": {"hair": "half.png"}}, ["maps has 'hair'", "density"]),
    ({"maps": [1]}, ["maps has [1]"]),
    ({"maps": {"length": "no.png"}}, ["no.png: no such file"]),
    ({"maps": {"length": [1, 2]}}, ["Maps.length has 2 numbers"]),
    ({"comb": {"weight": 1}}, ["comb has 'weight'; allowed: direction"]),
    ({"comb": [1, 0]}, ["Comb.direction"]),
    ({"on": 3}, ["on is 3; allowed: a name"]),
    ({"on": "foot"}, ["--types: the mesh has no group", "'foot'"]),
    ({"type_map": "keys.png"}, ["HairType.key"]),
    ({"type_map": 3}, ["3: no such file"]),
])
def test_what_is_wrong_in_the_file_is_one_line(clfur, files, groom, words):
    (files / "groom.json").write_text(json.dumps(groom))
    wrong(clfur("render", "a.obj", "--types", "groom.json", *SMALL), *words)


def test_a_map_is_never_overwritten(clfur, files):
    before = (files / "half.png").read_bytes()
    wrong(clfur("render", "sphere", "-o", "half.png", "--map", "density=half.png"), "would be overwritten")
    wrong(clfur("render", "sphere", "-o", "ones.1001.png", "--map", "density=ones.<UDIM>.png"), "would be overwritten")
    assert (files / "half.png").read_bytes() == before
