"""STL and OFF files, and what files may be at all."""

import os
import tracemalloc

import numpy as np
import pytest
from support.mesh_files import binary_stl

from clfur.errors import Error
from clfur.files import input, meshes
from clfur.files.meshes import load_mesh

CORNERS = np.float32([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
FACET = "facet normal {0} {0} {0}\n outer loop\n vertex 0 0 0\n vertex 1 0 0\n vertex 1 1 0\n{1} endloop\nendfacet\n"
SOLID = "solid a vertex\n" + FACET.format("-nan(ind)", "") + "endsolid a\n"
POINTS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"


def load(folder, name, data):
    (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)
    return load_mesh(folder / name)


# --- STL ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [b"solid but binary", b"", b"\xff\xfe", b"\xef\xbb\xbfsolid", b"ply"])
@pytest.mark.parametrize("behind", [b"", b"\0", b"\r\n", bytes(50), b"endsolid facet"])
def test_binary_stl_with_anything_before_and_behind(tmp_path, header, behind):
    mesh = load(tmp_path, "a.stl", binary_stl(CORNERS, header, behind))
    assert np.array_equal(mesh.positions[mesh.faces], CORNERS)


@pytest.mark.parametrize("text", [
    SOLID, SOLID.upper(), SOLID.replace("\n", "\r"), SOLID.replace("\n", "\r\n"), SOLID.replace("\n", " "),
    "\n  " + SOLID, SOLID.replace("a vertex", ""), SOLID.replace("1 1 0", "1.0E+00 1e0 -0.0"),
    b"\xef\xbb\xbf" + SOLID.encode(), SOLID.encode("utf-16"), SOLID.replace("a vertex", "caf\xe9").encode("latin-1")])
def test_text_stl_as_people_have_it(tmp_path, text):
    assert load(tmp_path, "a.stl", text).positions.tolist() == CORNERS[0].tolist()


def test_text_stl_of_several_solids_and_of_polygons(tmp_path):
    four = FACET.format(0, " vertex 0 1 0\n")
    mesh = load(tmp_path, "a.stl", SOLID.replace(" 0\n", " 7\n") + "solid\n" + four + "endsolid\n"
                + SOLID.replace(" 0\n", " 5\n"))
    assert len(mesh.faces) == 4 and mesh.area == 2
    assert load(tmp_path, "b.stl", "solid\n" + four + "endsolid\n").area == 1


@pytest.mark.parametrize("data, words", [
    (binary_stl(CORNERS)[:-1], "states 2 faces, 184 bytes, but has 183"),
    (binary_stl(CORNERS)[:80] + b"\xff\xff\xff\xff" + bytes(100), "4294967295 faces"),
    (binary_stl(CORNERS)[:80] + bytes(4), "no faces"), (binary_stl(CORNERS)[:80] + bytes(54), "no faces"),
    (binary_stl(CORNERS * np.float32([np.nan, 1, 1])), "is nan"),
    (SOLID.replace("vertex 1 1 0", "vertex 1 nan 0"), "is nan"),
    (SOLID.replace("vertex 1 1 0", "vertex 1 one 0"), "one"),
    (SOLID.replace("vertex 1 1 0", "vertex 1 1"), "three numbers"),
    (SOLID.replace(" vertex 1 1 0\n", ""), "less than three vertices"), (SOLID.replace("endsolid", ""), "cut short"),
    (SOLID[:-40], "cut short"), (SOLID + FACET.format(0, "")[:-30], "cut short"),
    ("solid a\nendsolid a\n", "but has 19 bytes")])
def test_damaged_stl(tmp_path, data, words):
    with pytest.raises(Error, match=words) as caught:
        load(tmp_path, "a.stl", data)
    assert "\n" not in str(caught.value)


# --- OFF ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [
    f"OFF\n4 1 4\n{POINTS}4 0 1 2 3\n", f"OFF 4 1 4\n{POINTS}4 0 1 2 3\n", f"OFF 4 1\n{POINTS}4 0 1 2 3",
    f"off\n4 1 0\n{POINTS}4 0 1 2 3",
    f"4 1 0\n{POINTS}4 0 1 2 3\n", f"# a\nOFF # b\n\n # c\n4 1 0 # d\n\n{POINTS}\n4 0 1 2 3 # e\n# f",
    f"OFF\n4 1 4\n{POINTS}4 0 1 2 3\n".replace("\n", "\r"), f"OFF\n4 1 4\n{POINTS}4 0 1 2 3\n".replace("\n", "\r\n"),
    f"OFF\n4 1 4\n{POINTS}4 0 1 2 3\n".replace(" ", "\t"), f"\ufeffOFF\n4 1 4\n{POINTS}4 0 1 2 3\n",
    f"\ufeffOFF\n4 1 4\n{POINTS}4 0 1 2 3\n".encode("utf-16-le"),
    f"OFF\n4 1 4\n{POINTS}4 0 1 2 3 255 0 0\n", f"OFF\n4 1 4\n{POINTS}4 0 1 2 3 1 .5 0 1\n",
    f"OFF\n4 1 4\n{POINTS}4 0 1 2 3 17\n",
    "COFF\n4 1 0\n" + POINTS.replace(" 0\n", " 0 255 0 0 255\n") + "4 0 1 2 3\n",
    "COFF\n4 1 0\n" + POINTS.replace(" 0\n", " 0 1 0 0\n") + "4 0 1 2 3\n",
    "4OFF\n4 1 0\n0 0 0 2\n2 0 0 2\n1 1 0 1\n0 -3 0 -3\n4 0 1 2 3\n",
    f"OFF\n5 1 0\n{POINTS}nan nan inf\n4 0 1 2 3\n", f"OFF\n4 3 0\n{POINTS}4 0 1 2 3\n2 0 1\n1 3\n"])
def test_a_quad_as_off_files_have_it(tmp_path, text):
    mesh = load(tmp_path, "a.off", text)
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2], [2, 3, 0]] and not mesh.has_uv
    assert mesh.degenerate_faces == (2 if "\n1 3\n" in str(text) else 0)


@pytest.mark.parametrize("word", ["NOFF", "STOFF", "STNOFF", "STCNOFF", "ST4OFF", "CN4OFF", "STCN4OFF"])
def test_normals_and_uv_of_off(tmp_path, word):
    """Each behind the position: w, the normal, the colour, uv, as Geomview defines them."""
    rows = []
    for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)):
        w = 4 if "4" in word else 1
        rows.append([x * w, y * w, 0] + [w] * ("4" in word) + [0, .6, .8] * ("N" in word) + [1, 0, 0, 1] * ("C" in word)
                    + [x / 2, y / 4] * ("ST" in word))
    text = f"{word}\n4 1 0\n" + "".join(" ".join(map(str, row)) + "\n" for row in rows) + "4 0 1 2 3\n"
    mesh = load(tmp_path, "a.off", text)
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert np.allclose(mesh.normals, (0, .6, .8) if "N" in word else (0, 0, 1), atol=1e-7)
    assert mesh.has_uv == ("ST" in word)
    if mesh.has_uv:
        assert np.array_equal(mesh.uv, mesh.positions[mesh.faces][..., :2] / [2, 4])


@pytest.mark.parametrize("data, words", [
    (b"OFF BINARY\n" + bytes(40), "OFF BINARY"), (f"nOFF\n3\n4 1 0\n{POINTS}4 0 1 2 3\n", "is nOFF"),
    (f"4nOFF\n3\n4 1 0\n{POINTS}4 0 1 2 3\n", "is 4nOFF"),
    (f"OFF\n4 1\n{POINTS}4 0 1 2 4\n", "index 4; allowed: 0 to 3"),
    (f"OFF\n4 1\n{POINTS}4 0 1 2 -1\n", "index -1"), (f"OFF\n4 1\n{POINTS}5 0 1 2 3\n", "face 0 is '5 0 1 2 3'"),
    (f"OFF\n4 1\n{POINTS}-1 0 1 2 3\n", "face 0"), (f"OFF\n4 1\n{POINTS}3 0 1 2.5\n", "face 0"),
    (f"OFF\n4 1\n{POINTS}3 0 1 2\n3 0 2 3\n", "more lines: its header states 5 .* there are 6"),
    (f"OFF\n4 2\n{POINTS}3 0 1 2\n", "cut short: its header states 6"), ("OFF\n99999999999 1\n", "states 99999999999"),
    (f"OFF\n4\n{POINTS}", "no OFF header"), ("OFF", "no OFF header"), ("", "is empty"), ("#", "no OFF header"),
    (f"OFF\n4 0\n{POINTS}", "no faces"),
    (f"OFF\n4 1\n{POINTS.replace('1 1 0', '1 1')}4 0 1 2 3\n", "vertex 2 has 2 numbers"),
    (f"OFF\n4 1\n{POINTS.replace('1 1 0', '1 x 0')}4 0 1 2 3\n", "no number"), (bytes(range(256)), "no OFF header"),
    ("4OFF\n3 1\n0 0 0 0\n1 0 0 1\n0 1 0 1\n3 0 1 2\n", "is nan")])
def test_damaged_off(tmp_path, data, words):
    with pytest.raises(Error, match=words) as caught:
        load(tmp_path, "a.off", data)
    assert "\n" not in str(caught.value)


# --- files ----------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes among files")
def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "a.obj")
    os.symlink("/dev/zero", tmp_path / "b.ply")
    for name in ("a.obj", "b.ply"):
        with pytest.raises(Error, match=f"{name}: is a pipe, a device or a folder; allowed: a file"):
            load_mesh(tmp_path / name)


def test_no_more_is_read_than_allowed(tmp_path, monkeypatch):
    """Nor more memory taken than a file has bytes; a file that is swapped for a pipe meanwhile is found out."""
    (tmp_path / "a.obj").write_bytes(b"v 0 0 0\n" * 4)
    with pytest.raises(Error, match="a.obj: has 32 bytes; allowed: at most 31"):
        input.read(tmp_path / "a.obj", 31)
    tracemalloc.start()
    assert len(input.read(tmp_path / "a.obj", 32)) == len(input.read(tmp_path / "a.obj")) == 32
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**17
    monkeypatch.setattr(input, "_open", lambda path, flags: os.open(os.devnull, flags))
    with pytest.raises(Error, match="a.obj: is a pipe, a device"):
        input.read(tmp_path / "a.obj")


def test_names_that_are_none(tmp_path):
    for name in ("a\0.obj", "x" * 300 + ".obj", "a.obj/b.obj"):
        with pytest.raises(Error, match="no such file"):
            load_mesh(tmp_path / name)
    assert meshes.READERS.keys() == {".obj", ".ply", ".stl", ".off", ".glb", ".gltf"}
