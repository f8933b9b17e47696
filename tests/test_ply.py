"""PLY files of every form that exporters write."""

import itertools
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import mesh_files
from support.mesh_files import ply

from clfur.errors import Error
from clfur.files import ply as reader
from clfur.files.meshes import load_mesh

FORMS = ["ascii", "binary_little_endian", "binary_big_endian"]
POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0), (3, 0, 0)]
XYZ = ["float x", "float y", "float z"]
VERTEX = "vertex", XYZ, POINTS
QUAD = "face", ["list uchar int vertex_indices"], [[(0, 1, 2, 3)]]
MIXED = "face", ["list uchar int vertex_indices"], [
    [(0, 1, 2, 3)], [(1, 4, 5)], [(1, 5, 2)], [(4, 6, 5)], [(6, 4)], [()]]


def load(folder, data):
    (folder / "a.ply").write_bytes(data)
    return load_mesh(folder / "a.ply")


def area(mesh):
    corners = mesh.positions.astype(float)[mesh.faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].sum() / 2


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", mesh_files.CODES)
def test_every_type_of_number(tmp_path, form, kind):
    """Of positions, of indices, and of lists' lengths where it is whole."""
    vertex = "vertex", [f"{kind} {axis}" for axis in "xyz"], POINTS
    mesh = load(tmp_path, ply(vertex, ("face", [f"list uchar {kind} vertex_index"], MIXED[2]), form=form))
    assert area(mesh) == 2.5 and mesh.degenerate_faces == 2 and len(mesh.faces) == 5
    length = ply(VERTEX, ("face", [f"list {kind} int vertex_indices"], MIXED[2]), form=form)
    if mesh_files.CODES[kind] in "fd":
        with pytest.raises(Error, match="length is no whole number"):
            load(tmp_path, length)
    else:
        assert area(load(tmp_path, length)) == 2.5


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("form", FORMS)
def test_line_ends_and_comments(tmp_path, form, end):
    """The first vertex begins with the byte of a line feed, or of a space: nothing of it is taken for a line's end."""
    rows = [(10, 32, 0), (11, 32, 0), (11, 33, 0)]
    comments = ["comment end_header", "obj_info format ascii", "comment", "comment caf\xe9 element x"]
    data = ply(("vertex", ["uchar x", "uchar y", "uchar z"], rows), ("face", QUAD[1], [[(0, 1, 2)]]), form=form,
               end=end, comments=comments)
    assert load(tmp_path, data).positions.tolist() == [list(map(float, row)) for row in rows]


@pytest.mark.parametrize("form", FORMS)
def test_elements_that_are_not_read_are_passed_over(tmp_path, form):
    """Edges, unknown ones with lists of several lengths, empty ones, ones without properties; faces first."""
    others = [("edge", ["int vertex1", "int vertex2", "uchar red"], [(0, 1, 9), (1, 2, 9)]),
              ("thing", ["float a", "list uchar float b", "list short double c", "uchar d"],
               [(1, (2,), (), 3), (1, (), (5, 6, 7), 3), (1, (1, 2, 3), (4,), 3)]),
              ("empty", ["float a", "list uchar float b"], []), ("bare", [], [(), ()])]
    for order in (range(6), [5, 4, 3, 2, 1, 0], [2, 5, 0, 1, 3, 4]):
        elements = [*others, VERTEX, MIXED]
        assert area(load(tmp_path, ply(*(elements[k] for k in order), form=form))) == 2.5


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("rows, expected", [(MIXED[2], 2.5), (MIXED[2][1:4], 1.5), (MIXED[2][:1], 1)])
def test_lists_among_other_properties(tmp_path, form, rows, expected):
    """Of the face, before and behind; also lists of the vertices, of one length and of several."""
    rng = np.random.default_rng(2)
    faces = [(1, list(row[0]), 2.5, list(rng.integers(0, 9, rng.integers(0, 3))), 7) for row in rows]
    face = "face", ["uchar flags", "list ushort uint vertex_indices", "double weight", "list char short other",
                    "int n"], faces
    for lengths in ([1] * 7, range(7)):
        vertex = "vertex", ["float x", "list uchar float weights", "float y", "uchar red", "float z"], [
            (x, [.5] * n, y, 255, z) for (x, y, z), n in zip(POINTS, lengths, strict=True)]
        mesh = load(tmp_path, ply(vertex, face, form=form))
        assert area(mesh) == expected
        assert set(map(tuple, mesh.positions.tolist())) <= set(POINTS)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t")])
def test_uv_and_normals_of_vertices(tmp_path, form, names):
    properties = [*XYZ, "float nx", "float ny", "float nz", f"float {names[0]}", f"double {names[1]}", "uchar red"]
    rows = [(*point, 0, .6, .8, point[0] / 4, point[1] / 2, 9) for point in POINTS]
    mesh = load(tmp_path, ply(("vertex", properties, rows), MIXED, form=form))
    assert np.array_equal(mesh.uv, mesh.positions[mesh.faces][..., :2] / [4, 2])
    assert np.allclose(mesh.normals, (0, .6, .8), atol=1e-7)


@pytest.mark.parametrize("form", FORMS)
def test_uv_of_corners(tmp_path, form):
    """Two numbers for each corner of any polygon, none where a face has none; another number is an error."""
    rows = [[face, [part for k in face for part in (POINTS[k][0] / 4, POINTS[k][1] / 4)] if k != 2 else []]
            for k, (face,) in enumerate(MIXED[2])]
    properties = ["list uchar int vertex_indices", "list uchar float texcoord"]
    mesh = load(tmp_path, ply(VERTEX, ("face", properties, rows), form=form))
    expected = mesh.positions[mesh.faces][..., :2] / 4
    expected[1] = 0   # the triangle without; quads' halves stand behind the triangles
    assert mesh.has_uv and np.array_equal(mesh.uv, expected)
    bare = [[face, []] for (face,) in MIXED[2]]
    assert not load(tmp_path, ply(VERTEX, ("face", properties, bare), form=form)).has_uv
    with pytest.raises(Error, match="face 1 has 5 values of texcoord for 3 corners"):
        load(tmp_path, ply(VERTEX, ("face", properties, [bare[0], [(0, 1, 2), [0] * 5]]), form=form))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", ["int", "uint", "short", "ushort"])
def test_strips(tmp_path, form, kind):
    """Every other triangle is turned; -1 begins a new strip, in numbers without a sign as the largest."""
    again = -1 if kind in ("int", "short") else {"uint": 2**32 - 1, "ushort": 2**16 - 1}[kind]
    if form == "ascii":
        again = -1
    strips = [[(0, 1, 3, 2)], [(again, 1, 4, 2, again, again, 4, 5, 2, again, 0, 1)], [()], [(4, 6, 5)]]
    element = "tristrips", [f"list int {kind} vertex_indices"], strips
    mesh = load(tmp_path, ply(VERTEX, element, form=form))
    assert mesh.faces.tolist() == [[0, 1, 3], [3, 1, 2], [1, 4, 2], [4, 5, 2], [4, 6, 5]] and area(mesh) == 2.5
    both = load(tmp_path, ply(VERTEX, QUAD, ("tristrips", element[1], strips[1:]), form=form))
    assert area(both) == 2.5 and both.faces.tolist()[0] == [0, 1, 2]


def test_a_byte_order_mark_and_other_encodings(tmp_path):
    data = ply(VERTEX, MIXED)
    for coded in (b"\xef\xbb\xbf" + data, data.decode().encode("utf-16")):
        assert area(load(tmp_path, coded)) == 2.5


def test_values_that_are_none(tmp_path):
    """Vertices that no face uses may be anything, and normals are computed where they are none."""
    rows = [(*point, 0, 0, 1) for point in POINTS] + [("nan", "-inf", "-nan", "-nan(ind)", 0, "1.#INF")]
    rows[1] = (1, 0, 0, "-nan(ind)", "-1.#IND", "nan")
    mesh = load(tmp_path, ply(("vertex", [*XYZ, "float nx", "float ny", "float nz"], rows), MIXED))
    assert len(mesh.positions) == 7 and (mesh.normals == [0, 0, 1]).all()
    rows[4] = ("nan", *rows[4][1:])
    with pytest.raises(Error, match="is nan"):
        load(tmp_path, ply(("vertex", [*XYZ, "float nx", "float ny", "float nz"], rows), MIXED))


@given(st.lists(st.tuples(st.lists(st.integers(0, 6), max_size=6), st.lists(st.integers(0, 9), max_size=3),
                          st.integers(0, 255)), max_size=12), st.sampled_from(FORMS))
def test_lists_of_any_length_come_back(rows, form):
    stated = ("vertex_indices", "i4", "u1"), ("skipped", "i2", "u4"), ("s", "u1", None)
    element = reader.Element("face", len(rows), [reader.Property(*each) for each in stated])
    properties = ["list uchar int vertex_indices", "list uint short skipped", "uchar s"]
    data = b"".join(mesh_files.row_of(properties, row, form) for row in rows) + b" "
    order = reader.ORDERS[form]
    if form == "ascii":
        data, element = reader._numbers(data), reader._as_doubles(element)
    table, end = reader._rows(data, 0, element, order, reader.WANTED)
    assert end == len(data) - (form != "ascii")
    lengths, values = table["vertex_indices"]
    assert lengths.tolist() == [len(row[0]) for row in rows]
    assert values.tolist() == list(itertools.chain.from_iterable(row[0] for row in rows))
    assert table["s"].tolist() == [row[2] for row in rows]


@pytest.mark.parametrize("form", FORMS)
def test_a_file_cut_anywhere_is_an_error(tmp_path, form):
    data = ply(VERTEX, ("edge", ["int vertex1", "int vertex2"], [(0, 1)]), MIXED, form=form).rstrip(b"\n0").rstrip()
    for end in range(0, len(data) - 3, 3):
        with pytest.raises(Error) as caught:
            load(tmp_path, data[:end])
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("data, words", [
    (ply(VERTEX, QUAD).replace(b"vertex 7", b"vertex 99999999999999999999"), "states 9999"),
    (ply(VERTEX, QUAD, form=FORMS[1]).replace(b"face 1", b"face 4294967295"), "4294967295 face rows"),
    (ply(VERTEX, QUAD).replace(b"face 1", b"face -1"), "header line 'element face -1'"),
    (ply(VERTEX, QUAD).replace(b"float x", b"half x"), "header line 'property half x'"),
    (ply(VERTEX, QUAD).replace(b"float y", b"float x"), "a property of vertex twice"),
    (ply(VERTEX, QUAD).replace(b"element face", b"element vertex"), "header line"),
    (ply(VERTEX, QUAD).replace(b"ascii", b"ebcdic"), "header line 'format ebcdic"),
    (ply(VERTEX, QUAD).replace(b"format ascii 1.0\n", b""), "no format"),
    (ply(VERTEX, QUAD).replace(b"float z", b"float w"), "no vertices with x, y and z"),
    (ply(VERTEX, QUAD).replace(b"vertex_indices", b"corners"), "face rows without a list vertex_indices"),
    (ply(VERTEX, QUAD) + b"1 2\n", "2 numbers more than its header states"),
    (ply(VERTEX, QUAD).replace(b"1 1 0\n", b"1 one 0\n"), "something else than numbers"),
    (ply(VERTEX, ("face", ["list uchar float vertex_indices"], [[(0, 1, 1.5)]])), "index 1.5"),
    (ply(VERTEX, ("face", ["list char char vertex_indices"], [[(0, 1, -1)]]), form=FORMS[1]), "index -1; allowed: 0"),
    (ply(VERTEX, QUAD).replace(b"4 0 1", b"-4 0 1"), "list of -4"),
    (ply(VERTEX, QUAD).replace(b"4 0 1", b"1e300 0 1"), "cut short"),
    (ply(VERTEX, QUAD).replace(b"4 0 1", b"nan 0 1"), "cut short"),
    (ply(VERTEX, QUAD).replace(b"4 0 1", b"3.5 0 1"), "list of 3.5"),
    (ply(VERTEX), "no faces"), (ply(VERTEX, ("face", QUAD[1], [[()], [()]])), "no faces"),
    (ply(QUAD), "no vertices"), (b"ply\nformat ascii 1.0\n", "no PLY header")])
def test_what_is_damaged_is_refused(tmp_path, data, words):
    with pytest.raises(Error, match=words) as caught:
        load(tmp_path, data)
    assert "\n" not in str(caught.value)


def test_a_claim_takes_no_memory(tmp_path):
    data = ply(VERTEX, QUAD, form=FORMS[1]).replace(b"vertex 7", b"vertex 50000000")
    tracemalloc.start()
    with pytest.raises(Error, match="states 50000000 vertex rows"):
        load(tmp_path, data)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20


def test_a_quarter_of_a_million_triangles_and_quads_in_turn():
    """No more than a few seconds for a million: here a quarter of it, on a machine that does other things too."""
    n = 125000
    points = np.random.default_rng(0).random((1000, 3)).astype("<f4")
    two = np.zeros(n, [("a", "u1"), ("three", "<i4", 3), ("b", "u1"), ("four", "<i4", 4)])
    two["a"], two["b"], two["three"], two["four"] = 3, 4, [0, 1, 2], [1, 2, 3, 4]
    head = (f"ply\nformat binary_little_endian 1.0\nelement vertex 1000\nproperty float x\nproperty float y\n"
            f"property float z\nelement face {2 * n}\nproperty list uchar int vertex_indices\nend_header\n").encode()
    data = head + points.tobytes() + two.tobytes()
    began = time.perf_counter()
    fields = reader.ply(data, None)
    seconds = time.perf_counter() - began
    assert len(fields["faces"]) == 3 * n and (fields["faces"][:n] == [0, 1, 2]).all()
    assert seconds < 10
