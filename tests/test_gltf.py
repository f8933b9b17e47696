"""glTF and GLB: every way in which a file may say where its triangles are, with values worked out by hand."""

import json
import os
import re
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from support.gltf import File, corners, data_uri, glb, load

from clfur.errors import Error
from clfur.files.gltf_data import MAX_ZEROS, Source

TRIANGLE = np.float32([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
QUAD = np.float32([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)])   # as a strip
HALF = 0.5**0.5
# Each integer type: some of its values, and what they mean where the accessor is normalized (3.6.2.2).
INTEGERS = [
    ("i1", [-128, -127, 0, 64, 127], [-1, -1, 0, 64 / 127, 1]),
    ("u1", [0, 51, 255], [0, .2, 1]),
    ("<i2", [-32768, -32767, 0, 16384, 32767], [-1, -1, 0, 16384 / 32767, 1]),
    ("<u2", [0, 13107, 65535], [0, .2, 1]),
]


def triangle(node=None, positions=TRIANGLE, **more):
    """A File of one triangle, by a node of its own."""
    file = File()
    mesh = file.mesh({"POSITION": file.accessor(positions)}, **more)
    file.add("nodes", **({"mesh": mesh} | (node or {})))
    return file


def refused(folder, file, words, name="x.glb"):
    """Check that a File, or bytes, is refused in one line that has these words."""
    with pytest.raises(Error) as caught:
        load(folder, file, name)
    text = str(caught.value)
    assert words in text and "\n" not in text and len(text) < 400, text
    return text


# --- accessors ---


def read(file, number, use):
    tree = file.finished()
    return Source(tree, Path(), memoryview(file.binary)).values({use: number}, use, "here")


@pytest.mark.parametrize("dtype, stored, meant", INTEGERS)
@pytest.mark.parametrize("use, width", [
    ("POSITION", 3), ("NORMAL", 3), ("TEXCOORD_0", 2), ("WEIGHTS", 4), ("ROTATION", 4)])
@pytest.mark.parametrize("padded", [False, True])
def test_integers(dtype, stored, meant, use, width, padded):
    """Normalized ones are fractions, others the whole numbers; where a type has no place it is refused by name."""
    array = np.repeat(np.array(stored)[:, None], width, axis=1)
    array[:, 0] = array[::-1, 0]
    allowed = {"NORMAL": "i", "ROTATION": "i", "WEIGHTS": "u"}.get(use, "iu")
    for normalized in (False, True):
        file = File()
        number = file.accessor(array, dtype, padded, normalized=normalized)
        if np.dtype(dtype).kind not in allowed:
            with pytest.raises(Error, match=re.escape(f"read as {use}, is 'VEC{width}' of componentType 51")):
                read(file, number, use)
            continue
        values = read(file, number, use)
        expected = np.array(meant if normalized else stored, float)
        assert values.dtype == np.float64 and np.array_equal(values[:, -1], expected)
        assert np.array_equal(values[:, 0], expected[::-1])


def test_quantized_positions_span_what_they_should(tmp_path):
    """int16, normalized, in a node of scale 2: 0 to 2, not 0 to 65534."""
    file = File()
    positions = file.accessor(TRIANGLE * 32767, "<i2", padded=True, normalized=True)
    file.add("nodes", mesh=file.mesh({"POSITION": positions}), scale=[2, 2, 2], translation=[5, 0, 0])
    assert np.array_equal(corners(load(tmp_path, file)), [TRIANGLE * 2 + (5, 0, 0)])
    file.tree["accessors"][0]["normalized"] = False
    assert load(tmp_path, file).positions.max() == 65534 + 5


@pytest.mark.parametrize("dtype, stored, meant", INTEGERS)
def test_uv_runs_up_and_never_wraps(tmp_path, dtype, stored, meant):
    for normalized in (False, True):
        file = File()
        uv = np.array([(stored[0], stored[-1]), (stored[-1], stored[1]), (stored[1], stored[0])])
        expected = np.array(meant if normalized else stored, float)
        file.add("nodes", mesh=file.mesh({"POSITION": file.accessor(TRIANGLE),
                                          "TEXCOORD_0": file.accessor(uv, dtype, True, normalized=normalized)}))
        mesh = load(tmp_path, file)
        u, v = expected[[0, -1, 1]], 1 - expected[[-1, 1, 0]]
        assert mesh.has_uv and np.array_equal(mesh.uv, np.float32([np.stack([u, v], 1)]))


@pytest.mark.parametrize("dtype", ["i1", "<i2"])
@pytest.mark.parametrize("normalized", [False, True])
def test_quantized_normals(tmp_path, dtype, normalized):
    file = File()
    most = np.iinfo(dtype).max
    normals = np.tile([0, most, most], (3, 1))
    file.add("nodes", mesh=file.mesh({"POSITION": file.accessor(TRIANGLE),
                                      "NORMAL": file.accessor(normals, dtype, True, normalized=normalized)}))
    assert np.allclose(load(tmp_path, file).normals, (0, HALF, HALF), atol=1e-7)


@pytest.mark.parametrize("change, words", [
    ({"componentType": 5124}, "allowed: 'VEC3' of 5120 (BYTE) or"), ({"componentType": 5130}, "componentType 5130"),
    ({"componentType": 5125}, "componentType 5125"), ({"componentType": None}, "componentType None"),
    ({"componentType": [5126]}, "componentType [5126]"), ({"type": "VEC2"}, "is 'VEC2'"), ({"type": None}, "is None"),
    ({"normalized": True}, "allowed: false, for POSITION of FLOAT"), ({"normalized": 1}, "normalized is 1"),
    ({"count": -3}, "count is -3"), ({"count": 2.5}, "count is 2.5"), ({"count": "3"}, "count is '3'"),
    ({"count": True}, "count is True"), ({"byteOffset": -4}, "byteOffset is -4"), ({"bufferView": 9}, "less than 1"),
    ({"bufferView": -1}, "bufferView is -1"), ({"byteOffset": 1}, "needs 37 bytes but bufferViews[0] has 36")])
def test_a_wrong_accessor_is_refused(tmp_path, change, words):
    file = triangle()
    file.tree["accessors"][0] |= change
    refused(tmp_path, file, words)


def test_least_and_greatest_are_ignored(tmp_path):
    """They are hints, and programs that edit files forget them."""
    file = triangle()
    file.tree["accessors"][0] |= {"min": [7, 7, 7], "max": "none"}
    assert np.array_equal(corners(load(tmp_path, file)), [TRIANGLE])


def test_whole_numbers_may_be_written_with_a_point(tmp_path):
    file = triangle()
    file.tree["accessors"][0] |= {"count": 3.0, "componentType": 5126.0}
    assert np.array_equal(corners(load(tmp_path, file)), [TRIANGLE])


@pytest.mark.parametrize("gap, start", [(0, 0), (4, 0), (8, 12), (3, 1)])
def test_interleaved(tmp_path, gap, start):
    """Positions and uv in turn, with a gap, and from a place that no processor would choose."""
    uv = np.float32([(0, 0), (1, .25), (.5, 1)])
    rows = b"".join(p.tobytes() + t.tobytes() + b"\xff" * gap for p, t in zip(TRIANGLE, uv, strict=True))
    rows = rows[:len(rows) - gap]   # the last one need not be followed by a gap
    file = File()
    view = file.view(b"\xff" * start + rows, byteStride=20 + gap)
    file.mesh({"POSITION": file.describe("<f4", 3, 3, bufferView=view, byteOffset=start),
               "TEXCOORD_0": file.describe("<f4", 3, 2, bufferView=view, byteOffset=start + 12)})
    file.add("nodes", mesh=0)
    mesh = load(tmp_path, file)
    assert np.array_equal(corners(mesh), [TRIANGLE]) and np.array_equal(mesh.uv, [uv * (1, -1) + (0, 1)])
    file.tree["bufferViews"][0]["byteStride"] = 8
    refused(tmp_path, file, "byteStride is 8; allowed: 12 or more")
    file.tree["bufferViews"][0]["byteStride"] = 0
    refused(tmp_path, file, "byteStride is 0")
    file.tree["bufferViews"][0]["byteStride"] = 21 + gap
    refused(tmp_path, file, "cut short")


def test_a_stride_of_what_is_no_attribute_is_refused(tmp_path):
    file = File()
    view = file.view(np.uint16([0, 0, 1, 0, 2, 0]).tobytes(), byteStride=4)
    file.mesh({"POSITION": file.accessor(TRIANGLE)}, file.describe("<u2", 3, 1, bufferView=view))
    file.add("nodes", mesh=0)
    refused(tmp_path, file, "byteStride is 4; allowed: 2, as accessors[1] needs")


def test_no_buffer_view_is_zeros(tmp_path):
    """Normals of zeros are computed from the faces; positions of zeros are a point, which has no face."""
    file = File()
    zeros = file.describe("<f4", 3, 3)
    file.mesh({"POSITION": file.accessor(TRIANGLE), "NORMAL": zeros})
    file.add("nodes", mesh=0)
    assert np.array_equal(load(tmp_path, file).normals, [(0, 0, 1)] * 3)
    file.tree["meshes"][0]["primitives"][0]["attributes"] = {"POSITION": zeros}
    refused(tmp_path, file, "1 are degenerate")


@pytest.mark.parametrize("dtype", ["u1", "<u2", "<u4"])
def test_sparse(tmp_path, dtype):
    """In place of some of what the view holds, or of zeros; of floats and of normalized integers."""
    for kind, one, values in (("<f4", 1, [(3, 0, 0), (0, 2, 0)]), ("i1", 127, [(95, 0, 0), (0, 63, 0)])):
        for base in (True, False):
            file = File()
            sparse = file.sparse([1, 2], np.array(values, kind), dtype)
            held = np.array([(0, 0, 0), (9, 9, 9), (9, 9, 9)], kind)
            view = {"bufferView": file.view(held.tobytes())} if base else {}
            file.mesh({"POSITION": file.describe(kind, 3, 3, sparse=sparse, normalized=one > 1, **view)})
            file.add("nodes", mesh=0)
            assert np.array_equal(corners(load(tmp_path, file)), np.float32([np.array([(0, 0, 0), *values]) / one]))


@pytest.mark.parametrize("change, words", [
    ({"count": 4}, "sparse.count is 4; allowed: at most 3"), ({"count": 2**40}, "sparse.count is"),
    ({"count": 3}, "sparse.indices needs 3 bytes but"), ({"indices": None}, "sparse.indices is None"),
    ({"values": {}}, "sparse.values.bufferView is None"),
    ({"indices": {"bufferView": 1, "componentType": 5122}}, "5122"),
    ({"indices": {"bufferView": 1, "componentType": 5121, "byteOffset": 1}}, "cut short"),
    ({"values": {"bufferView": 0, "byteOffset": 20}}, "sparse.values needs 44 bytes")])
def test_a_wrong_sparse_accessor_is_refused(tmp_path, change, words):
    file = triangle()
    file.tree["accessors"][0]["sparse"] = file.sparse([0, 2], TRIANGLE[:2]) | change
    refused(tmp_path, file, words)


@pytest.mark.parametrize("places", [[2, 0], [1, 1], [0, 3], [0, 255]])
def test_sparse_places_must_rise(tmp_path, places):
    file = triangle()
    file.tree["accessors"][0]["sparse"] = file.sparse(places, TRIANGLE[:2])
    refused(tmp_path, file, "do not rise from 0 to at most 2")


MANY = 3 * 2**30
CLAIMS = [   # which object of the file, what it claims, words of the error
    ("accessors", {"count": MANY}, "accessors[0] needs 38654705664 bytes but bufferViews[0] has 36"),
    ("accessors", {"count": 3 * 2**20}, "cut short"),
    ("accessors", {"count": MANY, "bufferView": None},
     f"without a bufferView; allowed there: at most {MAX_ZEROS // 3}"),
    ("accessors", {"count": MAX_ZEROS // 9 * 3 + 3, "bufferView": None}, "without a bufferView; allowed there"),
    ("accessors", {"byteOffset": MANY}, "cut short"),
    ("bufferViews", {"byteLength": MANY}, "bufferViews[0] needs 3221225472 bytes but buffers[0] has 36"),
    ("bufferViews", {"byteOffset": MANY}, "cut short"), ("bufferViews", {"byteStride": MANY}, "cut short"),
    ("buffers", {"byteLength": MANY}, "buffers[0] states 3221225472 bytes but has 36"),
    ("buffers", {"byteLength": MANY, "uri": "small.bin"}, "buffers[0] states 3221225472 bytes but has 100"),
    ("buffers", {"byteLength": MANY // 2, "uri": "huge.bin"},
     "huge.bin: has 2147483648 bytes; allowed: at most 1073741824"),
    ("nodes", {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"SCALE": 1}}}},
     "accessors[1].count is 3221225472"),
]


@pytest.mark.parametrize("kind, claim, words", CLAIMS)
def test_claims_are_refused_before_memory_is_taken(tmp_path, kind, claim, words):
    (tmp_path / "small.bin").write_bytes(bytes(100))
    with open(tmp_path / "huge.bin", "wb") as hole:
        hole.truncate(2**31)   # takes no room on most file systems
    file = triangle()
    file.describe("<f4", MANY, 3)
    file.tree["buffers"] = [{"byteLength": 36}]
    file.tree[kind][0] |= claim
    file.tree[kind][0] = {name: value for name, value in file.tree[kind][0].items() if value is not None}
    data = file.glb()
    load(tmp_path, triangle())   # what is imported and kept at the first call
    tracemalloc.start()
    try:
        refused(tmp_path, data, words)
        assert tracemalloc.get_traced_memory()[1] < 300_000
    finally:
        tracemalloc.stop()


def test_the_same_bytes_cannot_be_asked_for_on_and_on(tmp_path):
    """Many primitives of one large accessor are counted before the first is read."""
    file = triangle(positions=np.zeros((3 * 2**14, 3), np.float32))
    file.tree["meshes"][0]["primitives"] *= 2**13
    refused(tmp_path, file, "has 134217728 faces of 402653184 vertices; allowed: at most 67108864 of each")
    file = triangle()
    file.tree["nodes"] *= 600
    file.tree["meshes"][0]["primitives"] *= 600
    refused(tmp_path, file, "draws primitives more than 262144 times")
    file = triangle()
    file.tree["extras"] = [[0] * 99] * 90_000
    refused(tmp_path, file, "JSON of more than 8388608 values")


# --- primitives ---

SHAPES = [   # mode, corners, faces
    (4, [0, 1, 2, 2, 1, 3], [(0, 1, 2), (2, 1, 3)]),
    (5, [0, 1, 2, 3], [(0, 1, 2), (2, 1, 3)]),
    (5, [0, 1, 2, 3, 3, 4, 4, 5, 6], [(0, 1, 2), (2, 1, 3), (4, 5, 6)]),   # two strips stitched by faces without area
    (6, [0, 1, 3, 2], [(0, 1, 3), (0, 3, 2)]),
    (6, [7, 0, 1, 3, 2], [(7, 0, 1), (7, 1, 3), (7, 3, 2)]),
]
POINTS = np.float32([*QUAD, (5, 0, 0), (6, 0, 0), (5, 1, 0), (3, 4, 0)])


def same_faces(found, expected):
    """Whether faces are the same triangles, wound alike, in any order and from any corner."""
    def turned(face):
        face = [tuple(np.asarray(point, float).tolist()) for point in face]
        return min(tuple(face[k:] + face[:k]) for k in range(3))
    return sorted(map(turned, found)) == sorted(map(turned, expected))


@pytest.mark.parametrize("mode, numbers, faces", SHAPES)
@pytest.mark.parametrize("dtype", [None, "u1", "<u2", "<u4"])
def test_triangles_strips_and_fans(tmp_path, mode, numbers, faces, dtype):
    file = File()
    if dtype is None:
        file.mesh({"POSITION": file.accessor(POINTS[numbers])}, mode=mode)
    else:
        file.mesh({"POSITION": file.accessor(POINTS)}, file.accessor(numbers, dtype), mode=mode)
    file.add("nodes", mesh=0)
    mesh = load(tmp_path, file)
    assert same_faces(corners(mesh), POINTS[faces])
    assert mesh.degenerate_faces == max(len(numbers) - 2 - len(faces), 0) * (mode == 5)


def test_no_mode_is_triangles(tmp_path):
    assert same_faces(corners(load(tmp_path, triangle())), [TRIANGLE])


def test_points_and_lines_are_skipped(tmp_path):
    file = triangle()
    for mode in range(4):
        file.mesh({"POSITION": 0}, mesh=0, mode=mode)
    assert len(load(tmp_path, file).faces) == 1
    del file.tree["meshes"][0]["primitives"][0]
    refused(tmp_path, file, "has no faces, only LINES and LINE_LOOP and LINE_STRIP and POINTS")


@pytest.mark.parametrize("dtype, last", [("u1", 255), ("<u2", 65535), ("<u4", 2**32 - 1)])
def test_a_restart_is_refused(tmp_path, dtype, last):
    for mode, numbers in ((4, [0, 1, last]), (5, [0, 1, 2, last, 0, 1, 2])):
        file = File()
        file.mesh({"POSITION": file.accessor(TRIANGLE)}, file.accessor(numbers, dtype), mode=mode)
        file.add("nodes", mesh=0)
        refused(tmp_path, file, f"indices has {last}, a primitive's restart")


@pytest.mark.parametrize("change, words", [
    ({"mode": 7}, "mode is 7; allowed: 0 to 6"), ({"mode": "4"}, "mode is '4'"),
    ({"indices": 7}, "indices is 7; allowed: less"),
    ({"indices": 0}, "read as indices, is 'VEC3'"), ({"attributes": {"POSITION": 5}}, "POSITION is 5"),
    ({"attributes": []}, "attributes is []; allowed: an object"), ({"attributes": {}}, "has no faces"),
    ({"indices": 1}, "has 2 corners; allowed for triangles"), ({"indices": 2}, "has the index 3; allowed: 0 to 2"),
    ({"attributes": {"POSITION": 0, "NORMAL": 3}}, "NORMAL has 4 elements; allowed: 3, as POSITION has"),
    ({"attributes": {"POSITION": 0, "TEXCOORD_0": 4}}, "TEXCOORD_0 has 4 elements")])
def test_a_wrong_primitive_is_refused(tmp_path, change, words):
    file = triangle()
    for numbers in ([0, 1], [0, 1, 3]):
        file.accessor(numbers, np.uint8)
    file.accessor(np.zeros((4, 3), np.float32))
    file.accessor(np.zeros((4, 2), np.float32))
    file.tree["meshes"][0]["primitives"][0] |= change
    refused(tmp_path, file, words)


def test_colours_and_what_programs_add_are_ignored(tmp_path):
    file = triangle()
    file.tree["meshes"][0]["primitives"][0]["attributes"] |= {
        "COLOR_0": file.accessor([(1, 0, 0)] * 3, np.float32), "TANGENT": file.accessor([(1, 0, 0, 1)] * 3, np.float32),
        "TEXCOORD_1": file.accessor([(1, 1)] * 3, np.float32), "_TEMPERATURE": file.accessor([1, 2, 3], np.float32)}
    mesh = load(tmp_path, file)
    assert np.array_equal(corners(mesh), [TRIANGLE]) and not mesh.has_uv


# --- nodes ---


def test_translation_rotation_and_scale(tmp_path):
    """T·R·S: first scaled by (2, 3, 4), then turned by 90 degrees about y (x to -z), then moved; or by a matrix."""
    turn = [0, HALF, 0, HALF]
    expected = np.array([(10, 0, 0), (10, 0, -2), (10, 3, 0)])
    for node in ({"translation": [10, 0, 0], "rotation": turn, "scale": [2, 3, 4]},
                 {"matrix": [0, 0, -2, 0, 0, 3, 0, 0, 4, 0, 0, 0, 10, 0, 0, 1]}):
        assert np.allclose(corners(load(tmp_path, triangle(node))), [expected], atol=1e-6)
    for size in (5, 1e300, 1e-300):   # of any length
        longer = triangle({"rotation": [0, size, 0, size]})
        assert np.allclose(corners(load(tmp_path, longer)), [[(0, 0, 0), (0, 0, -1), (0, 1, 0)]], atol=1e-7)
    assert np.array_equal(corners(load(tmp_path, triangle({"rotation": [0, 0, 0, 0]}))), [TRIANGLE])


def test_a_mesh_of_several_nodes_and_parents(tmp_path):
    """A child stands in its parent's frame; the same mesh is there once for each node."""
    file = triangle({"translation": [1, 0, 0], "children": [1, 2], "scale": [2, 2, 2]})
    file.add("nodes", mesh=0, translation=[10, 0, 0])
    file.add("nodes", children=[3])
    file.add("nodes", mesh=0, translation=[0, 5, 0], scale=[1, 3, 1])
    found = corners(load(tmp_path, file))
    assert same_faces(found, [TRIANGLE * 2 + (1, 0, 0), TRIANGLE * 2 + (21, 0, 0), TRIANGLE * (2, 6, 2) + (1, 10, 0)])


@pytest.mark.parametrize("scales, mirrored", [([(-1, 1, 1)], True), ([(-1, -1, 1)], False), ([(-1, -2, -1)], True),
                                              ([(1, -1, 1), (1, 1, -1)], False), ([(1, -1, 1), (2, 3, 1)], True)])
def test_a_mirrored_mesh_keeps_its_outside(tmp_path, scales, mirrored):
    """Winding turns with the sign of all scales together, normals go by the inverse transposed, uv stay."""
    file = File()
    uv = np.float32([(0, 1), (1, 1), (0, 0)])   # u, 1 - v are the point's x and y
    normal = np.array((2, 1, 3))
    file.mesh({"POSITION": file.accessor(TRIANGLE), "TEXCOORD_0": file.accessor(uv),
               "NORMAL": file.accessor([normal] * 3, np.float32)})
    file.add("nodes", scale=scales[0], **({"mesh": 0} if len(scales) == 1 else {"children": [1]}))
    if len(scales) > 1:
        file.add("nodes", scale=scales[1], mesh=0)
    mesh, scale = load(tmp_path, file), np.prod(scales, axis=0)
    expected = TRIANGLE * scale
    assert same_faces(corners(mesh), [expected[::-1] if mirrored else expected])
    assert np.allclose(mesh.normals, normal / scale / np.linalg.norm(normal / scale), atol=1e-6)
    assert np.allclose(mesh.uv, corners(mesh)[..., :2] / scale[:2])


def test_a_node_scaled_to_nothing_is_left_out(tmp_path):
    """Some programs hide what they do not show so; the faces are degenerate, and the others are there."""
    file = triangle({"scale": [0, 0, 0]})
    file.add("nodes", mesh=0)
    mesh = load(tmp_path, file)
    assert len(mesh.faces) == 1 and mesh.degenerate_faces == 1


def two_scenes(**more):
    file = File(scenes=[{"nodes": [0]}, {"nodes": [1]}, {}], **more)
    file.mesh({"POSITION": file.accessor(TRIANGLE)})
    file.add("nodes", mesh=0)
    file.add("nodes", mesh=0, translation=[5, 0, 0])
    return file


def test_which_scene(tmp_path):
    """The one that the file names, else the first; in a file without scenes all nodes without a parent are shown."""
    assert load(tmp_path, two_scenes(scene=1)).positions.max() == 6
    assert load(tmp_path, two_scenes()).positions.max() == 1
    refused(tmp_path, two_scenes(scene=2), "has no faces: no node of its scene has a mesh")
    refused(tmp_path, two_scenes(scene=3), "scene is 3; allowed: less than 3, the number of scenes")
    none = two_scenes()
    none.tree["scenes"] = []
    assert len(load(tmp_path, none).faces) == 2
    twice = two_scenes()
    twice.tree["scenes"][0]["nodes"] = [0, 0]
    assert len(load(tmp_path, twice).faces) == 1


@pytest.mark.parametrize("change, words", [
    ({"children": [0]}, "1 nodes are below a node that is its own ancestor"),
    ({"children": [1, 1]}, "nodes[1] is a child of nodes[0] and nodes[0]"),
    ({"children": [9]}, "children is 9; allowed: less than 2"), ({"children": [-1]}, "children is -1"),
    ({"children": 1}, "children is 1; allowed: a list"),
    ({"children": [1]}, "scenes[0] has nodes[1], a child of nodes[0]"),
    ({"mesh": 1}, "mesh is 1; allowed: less than 1"), ({"scale": [1, 1]}, "scale is [1, 1]; allowed: 3 finite numbers"),
    ({"rotation": [0, 0, "0", 1]}, "rotation is"), ({"translation": [1e999, 0, 0]}, "JSON"),
    ({"matrix": [1] * 15}, "allowed: 16 finite numbers"), ({"matrix": [1] * 16}, "a last row that is not 0, 0, 0, 1"),
    ({"matrix": np.eye(4).ravel().tolist(), "scale": [1, 1, 1]}, "has a matrix and a scale"),
    ({"extensions": []}, "extensions is []; allowed: an object")])
def test_a_wrong_node_is_refused(tmp_path, change, words):
    file = triangle(change)
    file.add("nodes", mesh=0)
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    refused(tmp_path, file, words)


def test_numbers_too_large_are_refused(tmp_path):
    data = json.dumps(triangle({"translation": [12345, 0, 0]}).finished(data_uri(TRIANGLE.tobytes())))
    refused(tmp_path, data.replace("12345", "1e999").encode(), "translation is", "x.gltf")
    refused(tmp_path, data.replace("12345", "NaN").encode(), "has NaN in its JSON", "x.gltf")
    refused(tmp_path, data.replace("12345", "1" * 5000).encode(), "x.gltf: ", "x.gltf")


def test_circles_of_nodes_are_refused(tmp_path):
    file = triangle({"children": [1]})
    file.add("nodes", children=[2])
    file.add("nodes", children=[1])
    refused(tmp_path, file, "nodes[1] is a child of nodes[0] and nodes[2]; allowed: one")
    file = triangle()
    file.add("nodes", children=[2])
    file.add("nodes", children=[1])
    file.tree["scenes"] = [{"nodes": [0]}]
    refused(tmp_path, file, "2 nodes are below a node that is its own ancestor")


def test_a_deep_tree(tmp_path):
    """Ten times as deep as Python can call itself; each node moves by a half."""
    file = triangle()
    file.tree["nodes"] = [{"translation": [.5, 0, 0], "children": [k + 1]} for k in range(10_000)] + [{"mesh": 0}]
    assert np.array_equal(corners(load(tmp_path, file)), [TRIANGLE + (5000, 0, 0)])


def test_a_node_far_away_keeps_its_mesh(tmp_path):
    """Places are float64 until the mesh has an origin of its own: a hundredth at five million."""
    far = np.array([431250, 55, 5411800])
    mesh = load(tmp_path, triangle({"translation": far.tolist(), "scale": [.01, .01, .01]}))
    assert np.allclose(corners(mesh) - far, [TRIANGLE * .01], atol=2e-9) and len(mesh.positions) == 3


def test_hidden_nodes_are_left_out(tmp_path):
    """KHR_node_visibility hides a node and all below it, but their places still hold for joints."""
    file = triangle()
    file.add("nodes", children=[2], extensions={"KHR_node_visibility": {"visible": False}})
    file.add("nodes", mesh=0, translation=[5, 0, 0])
    assert len(load(tmp_path, file).faces) == 1
    file.tree["nodes"][1]["extensions"]["KHR_node_visibility"]["visible"] = True
    assert len(load(tmp_path, file).faces) == 2


# --- skins ---


def skinned(joints, weights, bind=None, joint_type="u1", weight_type="<f4", node=None, normals=None, **nodes):
    """A triangle held by two joints: nodes 1, moved by 10 along x, and 2, its child, turned by 90 degrees about z and
    moved by 1 along y.  joints, weights: [3, 4] for one set or [3, 8] for two."""
    file = File()
    attributes = {"POSITION": file.accessor(TRIANGLE)}
    if normals is not None:
        attributes["NORMAL"] = file.accessor(normals, np.float32)
    joints, weights = np.array(joints), np.array(weights, float)
    if weight_type != "<f4":
        weights = np.rint(weights * np.iinfo(weight_type).max)
    for k in range(joints.shape[1] // 4):
        columns = slice(4 * k, 4 * k + 4)
        attributes[f"JOINTS_{k}"] = file.accessor(joints[:, columns], joint_type)
        attributes[f"WEIGHTS_{k}"] = file.accessor(weights[:, columns], weight_type, normalized=weight_type != "<f4")
    file.mesh(attributes)
    skin = {"joints": [1, 2]}
    if bind is not None:
        columns = np.float32(bind).transpose(0, 2, 1).reshape(-1, 16)   # matrices are stored by columns
        skin["inverseBindMatrices"] = file.accessor(columns)
    file.add("skins", **skin)
    file.tree["nodes"] = [{"mesh": 0, "skin": 0} | (node or {}),
                          {"translation": [10, 0, 0], "children": [2]} | nodes.get("first", {}),
                          {"rotation": [0, 0, HALF, HALF], "translation": [0, 1, 0]} | nodes.get("second", {})]
    return file


ONE, TWO, BOTH = (1, 0, 0, 0), (0, 1, 0, 0), (.6, .4, 0, 0)   # weights of joints 0 and 1
# Where the triangle's points are if joint 0, or 1, holds them: (x + 10, y) and (10 - y, 1 + x).
BY_FIRST = TRIANGLE + (10, 0, 0)
BY_SECOND = np.array([(10, 1, 0), (10, 2, 0), (9, 1, 0)])


@pytest.mark.parametrize("joint_type", ["u1", "<u2"])
@pytest.mark.parametrize("weight_type", ["<f4", "u1", "<u2"])
def test_a_skin_is_placed_by_its_joints(tmp_path, joint_type, weight_type):
    """Joints' places in the world times the inverse bind matrices; the node's own place has no say."""
    joints = [(0, 1, 0, 0)] * 3
    weights = [ONE, TWO, BOTH]
    for node in ({}, {"translation": [99, 99, 99], "scale": [3, 3, 3]}):
        mesh = load(tmp_path, skinned(joints, weights, None, joint_type, weight_type, node))
        expected = [BY_FIRST[0], BY_SECOND[1], BY_FIRST[2] * .6 + BY_SECOND[2] * .4]
        assert np.allclose(corners(mesh), [expected], atol=2e-6)   # float32 of numbers up to 10, and of the rotation
    move = np.array([np.eye(4), np.eye(4)])
    move[0, :3, 3] = (-10, 0, 0)          # undoes joint 0
    move[1, :3, :3] = np.diag([2, 3, 4])  # before joint 1
    mesh = load(tmp_path, skinned(joints, [ONE, TWO, TWO], move, joint_type, weight_type))
    assert np.allclose(corners(mesh), [[(0, 0, 0), (10, 3, 0), (7, 1, 0)]], atol=2e-6)


def test_the_order_of_joints_and_a_second_set(tmp_path):
    """JOINTS_1 holds as much as JOINTS_0; a joint that has no weight may be any number."""
    joints = np.array([(77, 77, 77, 77, 1, 77, 77, 77), (0, 77, 77, 77, 77, 1, 77, 77), (1, 0, 0, 77, 0, 0, 0, 1)])
    weights = np.array([(0, 0, 0, 0, 1, 0, 0, 0), (.6, 0, 0, 0, 0, .4, 0, 0), (.1, .1, .1, 0, .1, .1, .1, .4)])
    expected = [BY_SECOND[0], BY_FIRST[1] * .6 + BY_SECOND[1] * .4, BY_FIRST[2] * .5 + BY_SECOND[2] * .5]
    assert np.allclose(corners(load(tmp_path, skinned(joints, weights))), [expected], atol=2e-6)


def test_weights_add_up_to_one(tmp_path):
    """As whole numbers, not normalized, they are shares too."""
    file = skinned([(0, 1, 0, 0)] * 3, [(.6, .4, 0, 0)] * 3, weight_type="u1")
    for each in file.tree["accessors"]:
        each.pop("normalized", None)
    assert np.allclose(corners(load(tmp_path, file)), [BY_FIRST * .6 + BY_SECOND * .4], atol=2e-6)


def test_normals_of_a_skin(tmp_path):
    """By the inverse transposed: a scale of (2, 1, 1) makes (1, 1, 0) to (1/2, 1, 0); then 90 degrees about z."""
    bind = np.array([np.diag([2, 1, 1, 1]), np.diag([2, 1, 1, 1])])
    mesh = load(tmp_path, skinned([(0, 1, 0, 0)] * 3, [ONE, TWO, TWO], bind, normals=[(1, 1, 0)] * 3))
    at = {tuple(np.rint(p).astype(int)): n for p, n in zip(mesh.positions, mesh.normals, strict=True)}
    long = 1.25**.5
    assert np.allclose(at[10, 0, 0], (.5 / long, 1 / long, 0), atol=1e-6)
    assert np.allclose(at[10, 3, 0], (-1 / long, .5 / long, 0), atol=1e-6)


def test_a_mirrored_skin_keeps_its_outside(tmp_path):
    """Joints of a mirrored parent turn the winding, and do not turn normals about."""
    mesh = load(tmp_path, skinned([(0, 0, 0, 0)] * 3, [ONE] * 3, normals=[(0, 0, 1)] * 3, first={"scale": [-1, 1, 1]}))
    assert same_faces(corners(mesh), [(TRIANGLE * (-1, 1, 1) + (10, 0, 0))[::-1]])
    assert np.allclose(mesh.normals, (0, 0, 1), atol=1e-7)


def test_many_vertices_of_a_skin(tmp_path):
    """More than are taken at a time: each with a joint of its own place."""
    n = 40_000
    rng = np.random.default_rng(1)
    positions, joints = rng.normal(size=(3 * n, 3)).astype(np.float32), rng.integers(0, 2, 3 * n)
    file = skinned([(0, 1, 0, 0)] * 3, [ONE] * 3, second={"rotation": [0, 0, 0, 1]})
    weights = np.zeros((3 * n, 4), np.float32)
    weights[np.arange(3 * n), joints] = 1
    numbers = np.tile(np.uint8([0, 1, 0, 0]), (3 * n, 1))
    file.tree["meshes"][0]["primitives"][0]["attributes"] = {
        "POSITION": file.accessor(positions), "JOINTS_0": file.accessor(numbers), "WEIGHTS_0": file.accessor(weights)}
    expected = (positions + np.array([(10, 0, 0), (10, 1, 0)])[joints]).reshape(-1, 3, 3)
    assert np.allclose(corners(load(tmp_path, file)), expected, atol=1e-6)


@pytest.mark.parametrize("change, words", [
    ("JOINTS_0", "has no JOINTS_0, but nodes[0] a skin"), ("WEIGHTS_0", "has no WEIGHTS_0, but nodes[0] a skin"),
    ({"joints": [1]}, "has the joint 1; allowed: 0 to 0"), ({"joints": [1, 7]}, "joints is 7; allowed: less than 3"),
    ({"joints": 3}, "joints is 3; allowed: a list"), ({"inverseBindMatrices": 0}, "read as inverseBindMatrices"),
    ({"inverseBindMatrices": 3}, "has 1 inverseBindMatrices; allowed: 2"),
    ({"joints": []}, "joints is []; allowed: one or more"),
    ({"inverseBindMatrices": 4}, "inverseBindMatrices has a last row")])
def test_a_wrong_skin_is_refused(tmp_path, change, words):
    file = skinned([(0, 1, 0, 0)] * 3, [BOTH] * 3)
    file.accessor([np.eye(4).ravel()], np.float32)
    file.accessor([np.ones(16)] * 2, np.float32)
    if isinstance(change, dict):
        file.tree["skins"][0] |= change
    else:
        del file.tree["meshes"][0]["primitives"][0]["attributes"][change]
    refused(tmp_path, file, words)


@pytest.mark.parametrize("weights, words", [((0, 0, 0, 0), "weights whose sum is 0 at vertex 1"),
                                            ((2, -1, 0, 0), "has the weight -1; allowed: from 0"),
                                            ((np.nan, 0, 0, 0), "has the weight nan")])
def test_wrong_weights_are_refused(tmp_path, weights, words):
    refused(tmp_path, skinned([(0, 1, 0, 0)] * 3, [ONE, weights, ONE]), words)


def test_a_joint_of_no_scene_and_a_skin_without_a_node(tmp_path):
    """Joints have their place wherever they are; a mesh with weights but without a skin is an ordinary one."""
    file = skinned([(0, 1, 0, 0)] * 3, [ONE] * 3, node={"translation": [0, 0, 7]})
    file.tree["scenes"] = [{"nodes": [0]}]
    assert np.array_equal(corners(load(tmp_path, file)), [BY_FIRST])
    del file.tree["nodes"][0]["skin"]
    assert np.array_equal(corners(load(tmp_path, file)), [TRIANGLE + (0, 0, 7)])


# --- morph targets ---


def morphed(**node):
    """A triangle with two targets: one raises point 1 by (0, 0, 1), sparsely; the other moves all by (0, 2, 0)."""
    file = File()
    first = file.describe("<f4", 3, 3, sparse=file.sparse([1], np.float32([(0, 0, 1)])))
    file.mesh({"POSITION": file.accessor(TRIANGLE), "NORMAL": file.accessor([(0, 0, 1)] * 3, np.float32),
               "TEXCOORD_0": file.accessor([(0, 0)] * 3, np.float32)},
              targets=[{"POSITION": first, "NORMAL": file.accessor([(2, 0, 0)] * 3, np.float32)},
                       {"POSITION": file.accessor([(0, 127, 0)] * 3, "i1", True, normalized=True),
                        "TEXCOORD_0": file.accessor([(.5, .25)] * 3, np.float32)}])
    file.add("nodes", mesh=0, **node)
    return file


@pytest.mark.parametrize("on_mesh, on_node, weights", [
    (None, None, (0, 0)), ((1, 0), None, (1, 0)), ((.5, 2), None, (.5, 2)), ((1, 0), (0, -1), (0, -1)),
    (None, (.5, 0), (.5, 0)), ((1, 1), (0, 0), (0, 0))])
def test_morph_targets_by_their_default_weights(tmp_path, on_mesh, on_node, weights):
    """The node's weights count, else the mesh's, else none."""
    file = morphed(**({} if on_node is None else {"weights": on_node}))
    if on_mesh is not None:
        file.tree["meshes"][0]["weights"] = on_mesh
    mesh = load(tmp_path, file)
    a, b = weights
    assert np.allclose(corners(mesh), [TRIANGLE + np.outer((0, 1, 0), (0, 0, a)) + (0, b, 0)], atol=1e-7)
    normal = np.array((2 * a, 0, 1))
    assert np.allclose(mesh.normals, normal / np.linalg.norm(normal), atol=1e-6)
    assert np.allclose(mesh.uv, (.5 * b, 1 - .25 * b), atol=1e-7)


def test_a_morphed_skin(tmp_path):
    """Targets come first, then joints."""
    file = skinned([(0, 1, 0, 0)] * 3, [TWO] * 3)
    file.tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": file.accessor([(1, 0, 0)] * 3, np.float32)}]
    file.tree["meshes"][0]["weights"] = [2]
    assert np.allclose(corners(load(tmp_path, file)), [BY_SECOND + (0, 2, 0)], atol=2e-6)


@pytest.mark.parametrize("weights", [[1], [1, 2, 3], "12", [1, None]])
def test_wrong_weights_of_morph_targets_are_refused(tmp_path, weights):
    refused(tmp_path, morphed(weights=weights), "allowed: 2 finite numbers")


def test_wrong_targets_are_refused(tmp_path):
    file = morphed(weights=[1, 1])
    file.tree["meshes"][0]["primitives"][0]["targets"][1] = {"POSITION": file.accessor(QUAD)}
    refused(tmp_path, file, "targets[1].POSITION has 4 elements; allowed: 3")
    file.tree["meshes"][0]["primitives"][0]["targets"][1] = 5
    refused(tmp_path, file, "targets[1] is 5; allowed: an object")


# --- extensions ---


def instanced(node=None, **attributes):
    file = triangle(node)
    file.tree["nodes"][0].setdefault("extensions", {})["EXT_mesh_gpu_instancing"] = {
        "attributes": {name: file.accessor(*given if isinstance(given, tuple) else (given, np.float32))
                       for name, given in attributes.items()}}
    return file


def test_instances(tmp_path):
    """Each by T·R·S of its own, within the node's place; not the mesh itself besides."""
    file = instanced({"translation": [0, 0, 7], "scale": [2, 2, 2]}, TRANSLATION=[(0, 0, 0), (10, 0, 0), (20, 0, 0)],
                     ROTATION=[(0, 0, 0, 1), (0, 0, HALF, HALF), (0, 0, 0, 1)],
                     SCALE=[(1, 1, 1), (1, 2, 1), (-1, 1, 1)])
    turned = np.array([(0, 0, 0), (0, 1, 0), (-2, 0, 0)])   # scaled by (1, 2, 1), then 90 degrees about z
    expected = [TRIANGLE * 2, turned * 2 + (20, 0, 0), (TRIANGLE * (-2, 2, 2) + (40, 0, 0))[::-1]]
    found = corners(load(tmp_path, file))
    assert same_faces(np.rint(found * 1e4) / 1e4, np.array(expected) + (0, 0, 7))
    alone = instanced(TRANSLATION=[(0, 0, 1), (0, 0, 2)])
    assert same_faces(corners(load(tmp_path, alone)), [TRIANGLE + (0, 0, 1), TRIANGLE + (0, 0, 2)])


@pytest.mark.parametrize("dtype", ["i1", "<i2"])
def test_instances_turned_by_integers(tmp_path, dtype):
    file = instanced(ROTATION=(np.array([(0, 0, 0, 1), (0, 0, 1, 0)]) * np.iinfo(dtype).max, dtype), _ID=[1, 2])
    file.tree["accessors"][1]["normalized"] = True
    assert same_faces(np.rint(corners(load(tmp_path, file))) + 0, [TRIANGLE, TRIANGLE * (-1, -1, 1)])


def test_instances_keep_uv_and_normals(tmp_path):
    file = instanced(TRANSLATION=[(0, 0, 0), (5, 0, 0)], SCALE=[(1, 1, 1), (1, 1, -1)])
    file.tree["meshes"][0]["primitives"][0]["attributes"] |= {
        "NORMAL": file.accessor([(0, 0, 1)] * 3, np.float32), "TEXCOORD_0": file.accessor(TRIANGLE[:, :2])}
    mesh = load(tmp_path, file)
    assert np.array_equal(np.sort(mesh.normals[:, 2]), [-1, -1, -1, 1, 1, 1])
    for point, uv in zip(mesh.positions[mesh.faces].reshape(-1, 3), mesh.uv.reshape(-1, 2), strict=True):
        assert np.array_equal(uv, (point[0] % 5, 1 - point[1]))


@pytest.mark.parametrize("file, words", [
    (lambda: instanced(TRANSLATION=[(0, 0, 0)] * 2, SCALE=[(1, 1, 1)] * 3), "instances with counts of [2, 3]"),
    (lambda: instanced(), "instances with counts of []"), (lambda: instanced(_ID=[1.]), "instances with counts of []"),
    (lambda: instanced({"skin": 0}, SCALE=[(1, 1, 1)]), "instances and a skin"),
    (lambda: instanced(ROTATION=[(0, 0, 0)]), "read as ROTATION, is 'VEC3'")])
def test_wrong_instances_are_refused(tmp_path, file, words):
    refused(tmp_path, file(), words)


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression",
                                  "EXT_mesh_primitive_restart", "CESIUM_RTC", "XYZ_anything", 5])
def test_extensions_that_are_needed_and_unknown_are_refused(tmp_path, name):
    file = triangle()
    file.tree |= {"extensionsUsed": [name], "extensionsRequired": ["KHR_mesh_quantization", name]}
    refused(tmp_path, file, f"needs the extension {name}, which is not read here; allowed: files without it")
    del file.tree["extensionsRequired"]   # used, but not needed
    assert len(load(tmp_path, file).faces) == 1


def test_extensions_that_are_needed_and_harmless(tmp_path):
    file = triangle()
    file.tree["extensionsRequired"] = ["KHR_materials_unlit", "KHR_lights_punctual", "KHR_texture_basisu",
                                       "EXT_mesh_gpu_instancing", "KHR_mesh_quantization", "KHR_texture_transform"]
    assert len(load(tmp_path, file).faces) == 1
    file.tree["extensionsRequired"] = "KHR_materials_unlit"
    refused(tmp_path, file, "extensionsRequired is 'KHR_materials_unlit'; allowed: a list")


def test_what_is_only_there_compressed_is_refused(tmp_path):
    """Draco leaves accessors without bytes, meshopt a buffer; with a fallback that is read."""
    draco = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    file = triangle(extensions=draco)
    assert len(load(tmp_path, file).faces) == 1
    del file.tree["accessors"][0]["bufferView"]
    refused(tmp_path, file, "primitives[0] is only stored as the extension KHR_draco_mesh_compression holds it")
    file = triangle(extensions={"XYZ_points": {}})
    file.tree["meshes"][0]["primitives"][0]["attributes"] = {}
    refused(tmp_path, file, "only stored as the extension XYZ_points holds it")
    variants = triangle(extensions={"KHR_materials_variants": {}})
    variants.tree["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = variants.describe("<f4", 3, 3)
    assert len(load(tmp_path, variants).faces) == 1
    for name in ("EXT_meshopt_compression", "KHR_meshopt_compression"):
        file = triangle()
        fallback = {"byteLength": 36, "extensions": {name: {"fallback": True}}}
        for number in range(2):   # the fallback may be any buffer, the first of a GLB too
            file.tree["buffers"] = [{"byteLength": 36}] * number + [fallback]
            file.tree["bufferViews"][0] |= {"buffer": number, "extensions": {name: {"buffer": 0}}}
            refused(tmp_path, file, f"has buffers[{number}] only as {name} holds it")
        fallback["uri"] = data_uri((TRIANGLE * 2).tobytes())
        assert np.array_equal(corners(load(tmp_path, file)), [TRIANGLE * 2])


def textured(material, uv=((0, 0), (1, 0), (0, 1))):
    file = triangle(material=0)
    file.tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = file.accessor(uv, np.float32)
    file.add("materials", **material)
    return file


def texture(texture_set=0, **transform):
    extensions = {"extensions": {"KHR_texture_transform": transform}} if transform else {}
    return {"index": 0, "texCoord": texture_set} | extensions


BASE = {"pbrMetallicRoughness": {"baseColorTexture": texture(offset=[.5, .25], scale=[2, 4])}}


@pytest.mark.parametrize("material, expected", [
    ({}, [(0, 1), (1, 1), (0, 0)]),
    (BASE, [(.5, .75), (2.5, .75), (.5, -3.25)]),
    (BASE | {"normalTexture": texture(scale=[9, 9])}, [(.5, .75), (2.5, .75), (.5, -3.25)]),   # base colour counts
    ({"pbrMetallicRoughness": {"baseColorTexture": texture()}, "normalTexture": texture(scale=[9, 9])},
     [(0, 1), (1, 1), (0, 0)]),
    ({"normalTexture": texture(scale=[2, 2]), "occlusionTexture": texture(1, scale=[7, 7])}, [(0, 1), (2, 1), (0, -1)]),
    ({"normalTexture": texture(scale=[2, 2], texCoord=1), "emissiveTexture": texture(1, scale=[3, 1], texCoord=0)},
     [(0, 1), (3, 1), (0, 0)]),
    ({"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": texture(scale=[2, 1])}}},
     [(0, 1), (2, 1), (0, 0)]),
    # The extension's first example: the lower left quarter of the picture. (u, v) goes to (v/2, 1 - u/2), v downwards.
    ({"emissiveTexture": texture(offset=[0, 1], rotation=np.pi / 2, scale=[.5, .5])}, [(0, 0), (0, .5), (.5, 0)]),
    # Its second: v downwards becomes v upwards.
    ({"emissiveTexture": texture(offset=[0, 1], scale=[1, -1])}, [(0, 0), (1, 0), (0, 1)]),
])
def test_texture_transforms(tmp_path, material, expected):
    """uv are as the base colour's picture takes them: what stores them as integers scales them there."""
    assert np.allclose(load(tmp_path, textured(material)).uv, [expected], atol=1e-7)


def test_texture_transforms_that_differ_are_refused(tmp_path):
    file = textured({"normalTexture": texture(scale=[2, 2]), "occlusionTexture": texture()})
    refused(tmp_path, file, "several KHR_texture_transforms")
    refused(tmp_path, textured({"normalTexture": texture(scale=[2])}), "scale is [2]; allowed: 2 finite numbers")
    del file.tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"]
    assert not load(tmp_path, file).has_uv   # without uv nothing depends on it


def test_uv_of_some_primitives(tmp_path):
    """uv need no material; faces of a primitive without uv have zeros, of one without normals computed ones."""
    file = File()
    first = file.mesh({"POSITION": file.accessor(TRIANGLE), "TEXCOORD_0": file.accessor(TRIANGLE[:, :2]),
                       "NORMAL": file.accessor([(0, 1, 0)] * 3, np.float32)})
    file.mesh({"POSITION": file.accessor(TRIANGLE + np.float32([5, 0, 0]))}, mesh=first)
    file.add("nodes", mesh=first)
    mesh = load(tmp_path, file)
    assert np.array_equal(mesh.uv, [[(0, 1), (1, 1), (0, 0)], np.zeros((3, 2))]) and mesh.has_uv
    assert np.array_equal(mesh.normals, [(0, 1, 0)] * 3 + [(0, 0, 1)] * 3)


def test_plain_files_are_as_trimesh_reads_them(tmp_path):
    """The same bits in the same order (float32 of the same products), so that strands keep their numbers."""
    trimesh = pytest.importorskip("trimesh", "5.2")
    rng = np.random.default_rng(2)
    file = File()
    for k, count in enumerate((30, 60, 90)):
        attributes = {"POSITION": file.accessor(rng.normal(size=(count, 3)), np.float32),
                      "NORMAL": file.accessor(rng.normal(size=(count, 3)), np.float32)}
        mesh = file.mesh(attributes, file.accessor(rng.permutation(count), np.uint16), mode=4 + k % 2)
        file.mesh(attributes, mesh=mesh)
    for k in range(8):
        children = [k + 4] if k < 4 else []
        file.add("nodes", mesh=k % 3, translation=rng.normal(size=3).tolist(), rotation=rng.normal(size=4).tolist(),
                 scale=rng.normal(size=3).tolist(), **({"children": children} if children else {}))
    mesh = load(tmp_path, file)
    scene = trimesh.load(tmp_path / "x.glb", process=False)
    found = []
    for name in scene.graph.nodes_geometry:
        matrix, part = scene.graph[name][0], scene.geometry[scene.graph[name][1]]
        points = np.asarray(part.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
        faces = np.asarray(part.faces)
        found.append(points[faces if np.linalg.det(matrix[:3, :3]) > 0 else faces[:, ::-1]])
    assert np.array_equal(mesh.positions[mesh.faces], np.concatenate(found).astype(np.float32)[mesh.kept_faces])
    assert len(mesh.faces) == len(mesh.kept_faces) > 300 and not mesh.origin.any()


# --- buffers, chunks ---


@pytest.mark.parametrize("uri", [
    data_uri(TRIANGLE.tobytes()),
    data_uri(TRIANGLE.tobytes()).replace("application/octet-stream", "application/gltf-buffer"),
    data_uri(TRIANGLE.tobytes() + b"!").rstrip("="), data_uri(TRIANGLE.tobytes()).replace("A", "%41"),
    "data:," + "".join(f"%{byte:02x}" for byte in TRIANGLE.tobytes()),
    data_uri(TRIANGLE.tobytes())[:60] + "\n " + data_uri(TRIANGLE.tobytes())[60:]])
def test_data_uris(tmp_path, uri):
    assert np.array_equal(corners(load(tmp_path, triangle().gltf(uri), "x.gltf")), [TRIANGLE])


@pytest.mark.parametrize("uri, words", [
    (data_uri(TRIANGLE.tobytes())[:-8], "buffers[0] states 36 bytes but has"),
    ("data:application/octet-stream;base64", "comma"),
    (data_uri(TRIANGLE.tobytes()).replace("AAAA", "AA!A"), "is no base64"), (5, "uri is 5; allowed: a text"),
    ("a/../../b.bin", "own folder"), ("..\\b.bin", "x.gltf"), ("file:///b.bin", "own folder"),
    ("C:b.bin", "own folder"),
    ("%2e%2e/b.bin", "own folder"), ("/b.bin", "own folder"), ("folder", "folder: is a pipe, a device"),
    (".", "is a pipe, a device or a folder"),
    ("gone.bin", "does not exist"), ("nul\0.bin", "x.gltf"), ("short.bin", "states 36 bytes but has 35")])
def test_buffers_that_are_refused(tmp_path, uri, words):
    inner = tmp_path / "inner"
    (inner / "folder").mkdir(parents=True)
    (inner / "short.bin").write_bytes(TRIANGLE.tobytes()[:35])
    (tmp_path / "b.bin").write_bytes(TRIANGLE.tobytes())
    refused(inner, triangle().gltf(uri), words, "x.gltf")


def test_a_buffer_below_and_longer_than_needed(tmp_path):
    """A buffer need not be all of its file; spaces may be written as %20."""
    (tmp_path / "a b").mkdir()
    (tmp_path / "a b" / "c.bin").write_bytes(TRIANGLE.tobytes() + b"more")
    for uri in ("a%20b/c.bin", "a b/c.bin", "./a b/../a b/c.bin"):
        assert np.array_equal(corners(load(tmp_path, triangle().gltf(uri), "x.gltf")), [TRIANGLE])


def test_links(tmp_path):
    """A link out of the folder is refused as a path is; one that stays in it is followed."""
    inner = tmp_path / "inner"
    inner.mkdir()
    for place in (tmp_path / "out.bin", inner / "in.bin"):
        place.write_bytes(TRIANGLE.tobytes())
    try:
        (inner / "bad.bin").symlink_to(tmp_path / "out.bin")
        (inner / "good.bin").symlink_to("in.bin")
        (inner / "up").symlink_to(tmp_path, target_is_directory=True)
        (tmp_path / "to_inner").symlink_to(inner, target_is_directory=True)
        (inner / "round.bin").symlink_to("round.bin")
    except OSError:
        pytest.skip("no links on this system")
    for uri in ("bad.bin", "up/out.bin"):
        refused(inner, triangle().gltf(uri), f"is in '{uri}'; allowed: files in its own folder", "x.gltf")
    refused(inner, triangle().gltf("round.bin"), "x.gltf", "x.gltf")
    assert len(load(inner, triangle().gltf("good.bin"), "x.gltf").faces) == 1
    assert len(load(tmp_path / "to_inner", triangle().gltf("in.bin"), "x.gltf").faces) == 1


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names on this system")
def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe.bin")
    refused(tmp_path, triangle().gltf("pipe.bin"), "pipe.bin: is a pipe, a device or a folder", "x.gltf")


def test_only_the_buffers_that_are_needed_are_read(tmp_path):
    file = triangle()
    file.tree["buffers"] = [{"byteLength": 36}, {"byteLength": 10, "uri": "pictures.bin"}]
    file.view(b"")
    file.tree["bufferViews"][1] |= {"buffer": 1, "byteLength": 10}
    file.add("images", bufferView=1, mimeType="image/png")
    assert len(load(tmp_path, file).faces) == 1
    file.tree["accessors"][0]["bufferView"] = 7
    refused(tmp_path, file, "bufferView is 7")


def chunk(kind, data):
    return struct.pack("<2I", len(data), kind) + data


def test_chunks(tmp_path):
    """JSON, then a binary one or none; what follows is skipped, also behind the length that the header states."""
    file = triangle()
    text, whole = json.dumps(file.finished()).encode(), file.glb()
    head = struct.pack("<4s2I", b"glTF", 2, 0)

    def of(*chunks, length=None):
        body = b"".join(chunks)
        return head[:8] + struct.pack("<I", 12 + len(body) if length is None else length) + body

    json_chunk, binary = chunk(0x4E4F534A, text), chunk(0x004E4942, file.binary)
    for data in (whole, whole + b"after", of(json_chunk, binary), of(json_chunk, binary, chunk(1, b"more"))):
        assert np.array_equal(corners(load(tmp_path, data)), [TRIANGLE])
    for data, words in [
            (of(json_chunk), "buffers[0] has no data"),
            (of(json_chunk, chunk(7, file.binary)), "buffers[0] has no data"),
            (of(binary, json_chunk), "first chunk is not JSON"), (of(chunk(0x4E4F534A, b"")), "cannot be read as .glb"),
            (of(json_chunk, binary, length=len(json_chunk) + 30), "ends after"),
            (of(json_chunk, binary)[:-1], "states"),
            (of(json_chunk, binary[:-1]), "ends after"), (of(length=12) + bytes(20), "first chunk is not JSON"),
            (head, "no GLB header"), (b"glTF" + struct.pack("<I", 1) + whole[8:], "GLB version 1; allowed: 2"),
            (glb([], b""), "x.glb: the JSON is []; allowed: an object")]:
        refused(tmp_path, data, words)


@pytest.mark.parametrize("tree, words", [
    ({"asset": {"version": "1.0"}}, "is of glTF version '1.0'"), ({"asset": {"version": "3.0"}}, "'3.0'"),
    ({"asset": {"version": "2.1", "minVersion": "2.1"}}, "'2.1' (asset.minVersion)"), ({"asset": []}, "asset is []"),
    ({"nodes": {}}, "nodes is {}; allowed: a list"), ({"nodes": [[]]}, "nodes[0] is []; allowed: an object"),
    ({}, "has no faces: no node of its scene"), ({"nodes": [{}]}, "has no faces")])
def test_wrong_trees_are_refused(tmp_path, tree, words):
    refused(tmp_path, json.dumps(tree).encode(), words, "x.gltf")


def test_a_version_to_come_and_no_asset(tmp_path):
    file = triangle()
    file.tree["asset"] = {"version": "2.1"}
    assert len(load(tmp_path, file).faces) == 1
    del file.tree["asset"]
    assert len(load(tmp_path, file).faces) == 1


def test_a_tree_deeper_than_python(tmp_path):
    refused(tmp_path, b"[" * 100_000, "x.gltf: cannot be read as .gltf", "x.gltf")


def test_marks_and_encodings_of_the_json(tmp_path):
    text = triangle().gltf().decode()
    for encoding in ("utf-8-sig", "utf-16"):
        assert len(load(tmp_path, text.encode(encoding), "x.gltf").faces) == 1
