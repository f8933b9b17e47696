"""Names of groups, objects, materials and vertex colours as masks of the skin, and how files number it."""

import json
import struct

import numpy as np
import pytest
from support.named import OBJ

import clfur
from clfur import Maps, Strands
from clfur.scene.maps import planes


@pytest.fixture
def obj(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(OBJ, encoding="utf-8")
    return clfur.load_mesh(path)


def test_groups_objects_and_materials_of_obj(obj):
    assert obj.numbering.names == ("head", "ear", "tail", "body", "Fell weiß")
    masks = {name: obj.mask(name)["face"].tolist() for name in obj.numbering.names}
    assert masks == {"head": [1, 0, 0], "ear": [1, 0, 0], "tail": [0, 1, 1], "body": [1, 1, 1], "Fell weiß": [1, 0, 0]}
    assert obj.mask("ear", "tail")["face"].tolist() == [1, 1, 1]


def test_vertices_and_polygons_of_obj_keep_their_numbers(obj):
    """A quad is a face, a vertex without a face counts, and one with two normals is one."""
    assert (obj.numbering.vertices, obj.numbering.faces) == (7, 3)
    _, _, length, width, *_ = planes(obj, Maps(length=np.arange(7.0), width=[5.0, 6, 7]), None)
    assert sorted(length.ravel().tolist()) == [0, 0, 1, 1, 1, 2, 2, 2, 3, 5, 6, 6] and width.tolist() == [5, 5, 6, 7]
    corners = obj.positions[obj.faces]
    np.testing.assert_array_equal(corners[length == 3], [(0, 0, 1)])


def test_hair_grows_where_a_group_is(obj, gpu):
    fur = Strands(4, 4, surface="flat", maps=Maps(on=obj.mask("head")))
    curves = clfur.grow(clfur.Scene(obj, fur), gpu)
    first = (np.cumsum(curves.counts) - curves.counts)[curves.counts > 0]
    assert (curves.points[first, 0] < 1).all() and 0.4 < (curves.counts > 0).mean() < 0.6


@pytest.mark.parametrize("name", ["foot", "red", ""])
def test_a_wrong_name_gives_those_that_there_are(obj, name):
    with pytest.raises(clfur.Error, match=f"{name!r}; allowed: head, ear, tail, body, Fell"):
        obj.mask(name)


def test_a_mesh_without_names_says_so(sphere):
    with pytest.raises(clfur.Error, match="allowed: none, as it names none"):
        sphere.mask("head")


@pytest.mark.parametrize("kind, colors", [("uchar", [(0, 51, 255), (255, 0, 0), (0, 0, 0)]),
                                          ("ushort", [(0, 13107, 65535), (65535, 0, 0), (0, 0, 0)]),
                                          ("float", [(0, .2, 1), (1, 0, 0), (0, 0, 0)])])
@pytest.mark.parametrize("prefix, alpha", [("", True), ("diffuse_", False)])
def test_vertex_colours_of_ply(tmp_path, kind, colors, prefix, alpha):
    names = [f"{prefix}{name}" for name in ("red", "green", "blue", *["alpha"] * alpha)]
    rows = [f"{x} 0 {z} " + " ".join(map(str, [*color, *[color[0]] * alpha]))
            for (x, z), color in zip([(0, 0), (0, 1), (1, 0)], colors)]
    path = tmp_path / "a.ply"
    path.write_text("\n".join(["ply", "format ascii 1.0", "element vertex 3", *(f"property float {c}" for c in "xyz"),
                               *(f"property {kind} {name}" for name in names), "element face 1",
                               "property list uchar int vertex_indices", "end_header", *rows, "3 0 1 2", ""]))
    mesh = clfur.load_mesh(path)
    assert mesh.numbering.names == ("red", "green", "blue", "alpha")[:3 + alpha]
    np.testing.assert_allclose(mesh.mask("green")["vertex"], [.2, 0, 0], atol=1e-6)
    np.testing.assert_allclose(mesh.mask("red")["vertex"], [0, 1, 0])
    with pytest.raises(clfur.Error, match="one vertex colour, or others"):
        mesh.mask("red", "green")


def test_polygons_of_ply_keep_their_numbers(tmp_path):
    """Faces of three corners come first in the mesh, but not in the file."""
    path = tmp_path / "a.ply"
    path.write_text("\n".join(["ply", "format ascii 1.0", "element vertex 5", *(f"property float {c}" for c in "xyz"),
                               "element face 2", "property list uchar int vertex_indices", "end_header",
                               "0 0 0", "1 0 0", "1 0 1", "0 0 1", "2 0 0", "4 0 3 2 1", "3 1 2 4", ""]))
    mesh = clfur.load_mesh(path)
    assert mesh.numbering.faces == 2
    assert planes(mesh, Maps(length=[4.0, 3.0]), None)[2].tolist() == [3, 4, 4]


def test_nodes_meshes_and_materials_of_gltf(tmp_path):
    data = struct.pack("<9f", 0, 0, 0, 0, 0, 1, 1, 0, 0)
    tree = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
            "nodes": [{"name": "left ear", "mesh": 0}, {"mesh": 1, "translation": [3, 0, 0]}],
            "meshes": [{"name": "ear", "primitives": [{"attributes": {"POSITION": 0}, "material": 0}]},
                       {"name": "tail", "primitives": [{"attributes": {"POSITION": 0}}]}],
            "materials": [{"name": "pink"}], "buffers": [{"byteLength": 36, "uri": "a.bin"}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                           "min": [0, 0, 0], "max": [1, 0, 1]}]}
    (tmp_path / "a.bin").write_bytes(data)
    (tmp_path / "a.gltf").write_text(json.dumps(tree))
    mesh = clfur.load_mesh(tmp_path / "a.gltf")
    assert set(mesh.numbering.names) == {"left ear", "ear", "tail", "pink"}
    for name, far in ("left ear", False), ("ear", False), ("pink", False), ("tail", True):
        marked = planes(mesh, Maps(on=mesh.mask(name)), None)[1] > 0
        assert (mesh.positions[mesh.faces[marked], 0] >= 3).all() == far and marked.sum() == 1


def test_many_names_of_many_groups_take_little_memory(tmp_path):
    """20,000 materials on faces of 2,000 groups each: only what differs is kept."""
    groups = "g " + " ".join(f"g{k}" for k in range(2000))
    lines = ["v 0 0 0", "v 0 0 1", "v 1 0 0", groups]
    lines += [line for k in range(20_000) for line in (f"usemtl m{k}", "f 1 2 3")]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    mesh = clfur.load_mesh(tmp_path / "a.obj")
    assert sum(len(names) for kind, _ in mesh.numbering.labels for names in kind) < 23_000
    assert mesh.mask("m7")["face"].sum() == 1 and mesh.mask("g7")["face"].sum() == 20_000
