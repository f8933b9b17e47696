"""OBJ files as people have them."""

import numpy as np
import pytest

from clfur.errors import Error
from clfur.files.meshes import load_mesh

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
UV = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"


def load(folder, data):
    (folder / "a.obj").write_bytes(data.encode() if isinstance(data, str) else data)
    return load_mesh(folder / "a.obj")


@pytest.mark.parametrize("encoded", [
    b"\xef\xbb\xbf" + (QUAD + "f 1 2 3 4\n").encode(),
    ("\ufeff" + QUAD + "f 1 2 3 4\n").encode("utf-16-le"), ("\ufeff" + QUAD + "f 1 2 3 4\n").encode("utf-16-be"),
    ("\ufeff" + QUAD + "f 1 2 3 4\n").encode("utf-32-le"), ("\ufeff" + QUAD + "f 1 2 3 4\n").encode("utf-32-be"),
    (QUAD + "f 1 2 3 4\n").encode("utf-16-le"), (QUAD + "f 1 2 3 4\n").encode("utf-16-be"),
    (QUAD + "f 1 2 3 4\n").replace("\n", "\r").encode(), (QUAD + "f 1 2 3 4").replace("\n", "\r\n").encode(),
    (QUAD + "f 1 2 3 4\n").replace(" ", "\t").encode(), (QUAD + "\x0c\nf 1 2\x0b 3 4\x0c\n").encode(),
    (QUAD + "f 1 2 \\\n 3 4").encode(), (QUAD + "f 1 2 \\\r 3 4").replace("\n", "\r").encode(),
    (QUAD + "f 1 2 \\\r\n3 4\r\n").encode(), b"o \xff\xfe\x85\xa0\n" + (QUAD + "f 1 2 3 4 # a quad\n").encode(),
    (QUAD.replace(" 0\n", " 0 1.0\n") + "f 1 2 3 4\n").encode(),
    (QUAD.replace(" 0\n", " 0 1 .5 .2\n") + "f 1 2 3 4\n").encode(),
    (QUAD.replace(" 0\n", " 0 1 1 .5 .2\n") + "f 1 2 3 4\n").encode(), (QUAD + "fo 1 2 3 4\n").encode(),
    (QUAD + "f 1// 2// 3// 4//\n").encode(), (QUAD + "f 1/ 2/ 3/ 4/\n").encode(),
    (QUAD + "f 1/0/0 2/0/0 3//0 4/0\n").encode(),
    (QUAD + "l 1 2\np 1 2 3\nvp .5\ncstype bezier\ncurv 0 1 1 2\ncurv2 1 2\nend\nmg 1 .5\nf 1 2 3 4\n").encode(),
    ("v nan nan nan\nv 1e999 0 0\n" + QUAD + "f 3 4 5 6\n").encode(),
    (QUAD + "vt nan inf\nvn nan 0 0\nf 1 2 3 4\n").encode()])
def test_a_quad_as_people_have_it(tmp_path, encoded):
    mesh = load(tmp_path, encoded)
    assert mesh.positions.tolist() == CORNERS and mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert not mesh.has_uv and (mesh.normals == [0, 0, 1]).all() and not mesh.degenerate_faces


@pytest.mark.parametrize("word", ["nan nan nan", "-nan(ind) -nan(ind) 0", "nan(snan) 0 0", "inf 0 1", "-inf 0 1",
                                  "-1.#IND -1.#IND -1.#IND", "1.#QNAN 0 0", "1.#INF 0 0", "0 0 0", "1e999 0 0"])
def test_normals_that_are_none_are_computed(tmp_path, word):
    mesh = load(tmp_path, QUAD + f"vn 0 0.6 0.8\nvn {word}\nf 1//2 2//1 3//1 4//1\n")
    assert np.allclose(mesh.normals, [[0, 0, 1]] + 3 * [[0, .6, .8]], atol=1e-7)


def test_faces_of_less_than_three_corners_are_counted(tmp_path):
    mesh = load(tmp_path, QUAD + "f 1 2\nf\nf 1 2 3 4\nf 4\nf 2 3\n")
    assert mesh.degenerate_faces == 4 and len(mesh.faces) == 2


def test_what_a_corner_has_not_is_left_out(tmp_path):
    """uv alone for some, normals alone for others, none, and both; 0 and nothing mean the same."""
    text = QUAD + UV + "vn 0 .6 .8\nf 1/1/0 2//1 3\nf 1/1/ 3/3/1 4/0/1\n"
    mesh = load(tmp_path, text)
    assert mesh.uv.tolist() == [[[0, 0], [0, 0], [0, 0]], [[0, 0], [1, 1], [0, 0]]] and mesh.has_uv
    assert np.allclose(mesh.normals, [[0, 0, 1], *3 * [[0, .6, .8]]], atol=1e-7)
    assert not load(tmp_path, QUAD + UV + "f 1 2 3 4\n").has_uv   # vt lines that no face uses


def test_one_number_of_uv_and_three(tmp_path):
    assert load(tmp_path, QUAD + "vt .5\nvt .25 .5 9\nf 1/1 2/2 3/2\n").uv.tolist() == [[[.5, 0], [.25, .5], [.25, .5]]]


@pytest.mark.parametrize("text, words", [
    (QUAD + "surf 0 1 0 1 1 2 3 4\nf 1 2 3\n", "line 5: 'surf' is not read"), (QUAD + "bzp 1 2 3 4\n", "'bzp'"),
    (QUAD + "bsp 1 2 3 4\n", "'bsp'"), (QUAD + "cdp 1 2 3 4\n", "'cdp'"), (QUAD + "call other.obj\nf 1 2 3\n",
    "'call'"),
    ("v nan 0 0\n" + QUAD + "f 1 2 3\n", "is nan"), (QUAD + "f 1 2 3/\n", "'3/' is no corner"),
    (QUAD + "f /1 2 3\n", "'/1' is no corner"), (QUAD + "f 0 2 3\n", "'0' is no corner"),
    (QUAD + "f 1/1/1/1 2 3\n", "no corner"), (QUAD + "f 1.5 2 3\n", "no corner"),
    (QUAD + "f 1 2 99999999999\n", "v index"),
    (QUAD + f"f 1 2 {10**30}\n", "no corner"), (QUAD + f"f 1 2 {'9' * 5000}\n", "no corner"),
    (QUAD + "f 1/7 2 3\n", "vt index 7; allowed: 1 to 0"), (QUAD + "f 1/-1 2 3\n", "counts back"),
    (QUAD + "f\nf\n", "no faces"),
    (QUAD + "v 1,5 2 3\n", "line 5"), (QUAD + "v 1 2\n", "line 5")])
def test_what_is_not_read_is_refused_by_name(tmp_path, text, words):
    with pytest.raises(Error, match=words) as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300 + len(str(tmp_path))
