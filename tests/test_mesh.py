"""Reading of mesh files, and the built-in models."""

import base64
import json
import struct
import subprocess
import sys

import numpy as np
import pytest

from clfur.errors import Error
from clfur.files.meshes import load_mesh
from clfur.files.teapot import teapot
from clfur.scene import Mesh

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
NORMALS = np.tile(np.float32([0.6, 0, 0.8]), (4, 1))  # not what the faces would give
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 0.25]], np.float32)

OBJ = """# caf\xe9
mtllib missing.mtl
v 0 0 0
v 1 0 0
v 1 1 0.5
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 0.25
vn 0.6 0 0.8
usemtl none
f 1/1/1 2/2/1 3/3/1 4/4/1
"""
PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float nx
property float ny
property float nz
property float s
property float t
element face 1
property list uchar int vertex_indices
end_header
0 0 0 .6 0 .8 0 0
1 0 0 .6 0 .8 1 0
1 1 .5 .6 0 .8 1 1
0 1 0 .6 0 .8 0 .25
4 0 1 2 3
"""
OFF = "OFF\n# a comment\n4 2 0\n0 0 0\n1 0 0\n1 1 .5\n0 1 0\n3 0 1 2\n3 0 2 3\n"


def binary_stl(corners):
    records = [struct.pack("<12fH", 0, 0, 0, *face.ravel(), 0) for face in corners]
    return b"solid but binary".ljust(80) + struct.pack("<I", len(records)) + b"".join(records)


def ascii_stl(corners):
    facets = ["facet normal 0 0 0\nouter loop\n"
              + "".join("vertex {} {} {}\n".format(*point) for point in face) + "endloop\nendfacet\n"
              for face in corners]
    return ("solid x\n" + "".join(facets) + "endsolid x\n").encode()


def gltf(nodes=({"mesh": 0},), uri=None, **changes):
    """Return (tree, binary) of POSITIONS, NORMALS, UV and FACES, without a material."""
    parts = [POSITIONS, NORMALS, np.stack([UV[:, 0], 1 - UV[:, 1]], 1), FACES.astype(np.uint16)]
    binary = b"".join(part.tobytes() for part in parts)
    offsets = np.cumsum([0] + [part.nbytes for part in parts])
    buffer = {"byteLength": len(binary)} | ({} if uri is None else {"uri": uri})
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": list(nodes), "buffers": [buffer],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2},
                                    "indices": 3}]}],
        "bufferViews": [{"buffer": 0, "byteOffset": int(o), "byteLength": part.nbytes}
                        for o, part in zip(offsets, parts, strict=False)],
        "accessors": [{"bufferView": k, "componentType": c, "count": n, "type": t}
                      for k, (c, n, t) in enumerate([(5126, 4, "VEC3"), (5126, 4, "VEC3"),
                                                     (5126, 4, "VEC2"), (5123, 6, "SCALAR")])],
    }
    return tree | changes, binary


def glb(tree, binary):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<2I", len(text), 0x4E4F534A) + text
    body += struct.pack("<2I", len(binary), 0x4E4942) + binary
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(body)) + body


def data_uri(binary):
    return "data:application/octet-stream;base64," + base64.b64encode(binary).decode()


def load(folder, name, data):
    file = folder / name
    file.write_bytes(data.encode("latin-1") if isinstance(data, str) else data)
    return load_mesh(file)


@pytest.mark.parametrize("name, data, normals, uv", [
    ("quad.obj", OBJ, True, True),
    ("QUAD.OBJ", OBJ.replace("\n", "\r\n"), True, True),
    ("quad.ply", PLY, True, True),
    ("quad.off", OFF, False, False),
    ("quad.stl", binary_stl(POSITIONS[FACES]), False, False),
    ("text.stl", ascii_stl(POSITIONS[FACES]), False, False),
    ("quad.glb", glb(*gltf()), True, True),
    ("quad.gltf", json.dumps(gltf(uri=data_uri(gltf()[1]))[0]), True, True),
])
def test_every_format(tmp_path, name, data, normals, uv):
    mesh = load(tmp_path, name, data)
    corners = {tuple(map(tuple, np.roll(c, -int(np.lexsort(c.T)[0]), axis=0).tolist()))
               for c in mesh.positions[mesh.faces]}
    expected = {tuple(map(tuple, c)) for c in POSITIONS[FACES].tolist()}
    other = {tuple(map(tuple, c)) for c in POSITIONS[[[0, 1, 2], [0, 2, 3]]].tolist()}
    assert len(mesh.positions) == 4 and corners in (expected, other)
    if normals:
        assert np.allclose(mesh.normals, NORMALS, atol=1e-6)
    else:
        assert not np.allclose(mesh.normals, NORMALS, atol=0.1)
    assert mesh.has_uv == uv
    if uv:
        corners = mesh.positions[mesh.faces].reshape(-1, 1, 3)
        at = (corners == POSITIONS).all(axis=2).argmax(axis=1)
        assert np.allclose(mesh.uv.reshape(-1, 2), UV[at], atol=1e-6)


def test_gltf_buffer_in_its_folder(tmp_path):
    (tmp_path / "a b.bin").write_bytes(gltf()[1])
    assert len(load(tmp_path, "x.gltf", json.dumps(gltf(uri="a%20b.bin")[0])).faces) == 2


def test_gltf_needs_no_pictures(tmp_path):
    tree, binary = gltf(images=[{"uri": "missing.png"}], textures=[{"source": 0}],
                        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}])
    tree["meshes"][0]["primitives"][0]["material"] = 0
    assert load(tmp_path, "x.glb", glb(tree, binary)).has_uv


def test_scene_transforms_are_applied(tmp_path):
    mirror = np.diag([-1, 2, 1, 1]).astype(float)
    nodes = [{"mesh": 0, "translation": [10, 0, 0]}, {"mesh": 0, "matrix": mirror.T.ravel().tolist()}]
    mesh = load(tmp_path, "x.glb", glb(*gltf(nodes)))
    assert len(mesh.faces) == 4 and mesh.has_uv
    moved = mesh.positions[:, 0] >= 10
    assert np.allclose(mesh.normals[moved], (0.6, 0, 0.8), atol=1e-6)
    assert np.allclose(mesh.normals[~moved], (-0.6, 0, 0.8), atol=1e-6)
    assert mesh.positions[:, 1].max() == 2 and mesh.positions[~moved, 0].min() == -1
    corners = mesh.positions[mesh.faces].astype(float)  # the mirrored faces still face forward
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()
    for point, place in zip(corners.reshape(-1, 3), mesh.uv.reshape(-1, 2), strict=True):
        if point[0] in (-1, 11) and point[1] == 0:
            assert np.allclose(place, (1, 0))


def test_obj_seams_and_relative_indices(tmp_path):
    text = ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\n"
            "v 5 0 0\nv 6 0 0\nv 6 1 0\nv 5 2 0\nv 4 1 0\nf -5 -4 -3 -2 \\\n -1\n")
    mesh = load(tmp_path, "x.obj", text)
    assert len(mesh.faces) == 4 and len(mesh.positions) == 8
    seam = OBJ.replace("f 1/1/1 2/2/1 3/3/1 4/4/1", "f 1/1/1 2/2/1 3/3/1\nf 1/2/1 3/1/1 4/4/1")
    mesh = load(tmp_path, "y.obj", seam)
    assert len(mesh.positions) == 4
    assert np.array_equal(mesh.uv, UV[[[0, 1, 2], [1, 0, 3]]])
    mesh = load(tmp_path, "z.obj", OBJ.replace("2/2/1", "2"))  # a corner without uv and normal
    assert len(mesh.faces) == 2 and mesh.has_uv


def damaged():
    stl, glb_bytes = binary_stl(POSITIONS[FACES]), glb(*gltf())
    big = gltf()[0]
    big["buffers"][0]["byteLength"] = 2**40
    many = gltf()[0]
    many["accessors"][0] |= {"count": 2**40}
    draco = gltf(extensionsRequired=["KHR_draco_mesh_compression"])[0]
    index = gltf()
    binary_ply = (b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
                  b"property float y\nproperty float z\nelement face 2\n"
                  b"property list uchar int vertex_indices\nend_header\n"
                  + POSITIONS.tobytes() + b"".join(struct.pack("<B3i", 3, *face) for face in FACES))
    yield from [
        ("empty.obj", "", "is empty"),
        ("junk.obj", bytes(range(256)) * 9, "no faces"),
        ("points.obj", "v 0 0 0\n", "no faces"),
        ("nan.obj", OBJ.replace("v 1 1", "v 1 nan"), "is nan"),
        ("inf.obj", OBJ.replace("v 1 1", "v 1 1e999"), "is inf"),
        ("index.obj", OBJ.replace("4/4/1", "5/4/1"), "v index 5"),
        ("uv_index.obj", OBJ.replace("4/4/1", "4/5/1"), "vt index 5"),
        ("zero.obj", OBJ.replace("4/4/1", "0/4/1"), "line 13"),
        ("negative.obj", OBJ.replace("4/4/1", "-5/4/1"), "counts back"),
        ("cut_v.obj", OBJ + "v 1 2", "line 14"),
        ("cut_f.obj", OBJ + "f 1 x", "line 14"),
        ("cut_corner.obj", OBJ + "f 1 2 3/", "line 14"),
        ("words.obj", OBJ + "f one two three\n", "line 14"),
        ("junk.ply", "plyx", "no PLY header"),
        ("cut.ply", PLY[:-12], "cut.ply"),
        ("cut_faces.ply", PLY.replace("face 1", "face 3"), "cut short"),
        ("huge.ply", PLY.replace("face 1", "face 4294967295"), "4294967295"),
        ("nan.ply", PLY.replace("1 1 .5", "1 nan .5"), "is nan"),
        ("index.ply", PLY.replace("4 0 1 2 3", "4 0 1 2 4"), "index 4"),
        ("cut_binary.ply", binary_ply[:-5], ""),
        ("cloud.ply", PLY.replace("face 1", "face 0").replace("4 0 1 2 3\n", ""), "no faces"),
        ("cut.stl", stl[:-20], "cut short"),
        ("huge.stl", stl[:80] + b"\xff" * 4 + stl[84:], "4294967295 faces"),
        ("none.stl", stl[:80] + b"\0" * 4, "no faces"),
        ("short.stl", stl[:50], "cut short"),
        ("cut_text.stl", ascii_stl(POSITIONS[FACES])[:-60], "cut short"),
        ("cut.off", OFF[:-10], "cut short"),
        ("half.off", OFF[:30], ""),
        ("index.off", OFF.replace("3 0 2 3", "3 0 2 9"), "index"),
        ("junk.off", "hello", "no OFF header"),
        ("cut.glb", glb_bytes[:-30], "cut short"),
        ("short.glb", glb_bytes[:10], "no GLB header"),
        ("huge.glb", glb(big, gltf()[1]), "cut short"),
        ("many.glb", glb(many, gltf()[1]), "cut short"),
        ("draco.glb", glb(draco, gltf()[1]), "draco"),
        ("index.glb", glb(index[0], index[1][:-2] + b"\x09\x00"), "index 9"),
        ("nodata.gltf", json.dumps(gltf()[0]), "no data"),
        ("missing.gltf", json.dumps(gltf(uri="gone.bin")[0]), "does not exist"),
        ("outside.gltf", json.dumps(gltf(uri="../gone.bin")[0]), "own folder"),
        ("absolute.gltf", json.dumps(gltf(uri="/etc/hostname")[0]), "own folder"),
        ("web.gltf", json.dumps(gltf(uri="https://example.org/a.bin")[0]), "own folder"),
        ("cut.gltf", json.dumps(gltf()[0])[:-20], ""),
        ("list.gltf", "[]", ""),
        ("model.xyz", "0 0 0\n", "not supported"),
        ("model.zip", "PK", "not supported"),
        ("model", "v 0 0 0", "no suffix"),
    ]


@pytest.mark.parametrize("name, data, words", [pytest.param(*each, id=each[0]) for each in damaged()])
def test_damaged_files(tmp_path, name, data, words):
    with pytest.raises(Error) as caught:
        load(tmp_path, name, data)
    text = str(caught.value)
    assert name in text and words in text and "\n" not in text and len(text) < 500


def test_what_is_no_file(tmp_path):
    for path, words in [(tmp_path / "gone.obj", "no such file"), ("nothing", "sphere, teapot"),
                        (tmp_path, "is a folder"), (None, "load_mesh path")]:
        with pytest.raises(Error, match=words):
            load_mesh(path)


# --- built-in models ---


def edge_uses(mesh):
    """Return how many faces use each directed edge: {(from, to): count}."""
    edges = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    pairs, counts = np.unique(edges, axis=0, return_counts=True)
    return {tuple(pair): count for pair, count in zip(pairs.tolist(), counts.tolist(), strict=True)}


def geometry(mesh):
    """Return the corners float64 [F, 3, 3] and the faces' unit normals [F, 3]."""
    corners = mesh.positions.astype(float)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_sphere():
    mesh = load_mesh("sphere")
    assert len(mesh.faces) == 1280 and len(mesh.positions) == 642 and mesh.degenerate_faces == 0
    assert np.allclose(np.linalg.norm(mesh.positions, axis=1), 1, atol=1e-6)
    assert np.allclose(mesh.normals, mesh.positions, atol=1e-6)
    uses = edge_uses(mesh)
    assert all(uses[b, a] == count == 1 for (a, b), count in uses.items())
    corners, normals = geometry(mesh)
    assert ((normals * corners[:, 0]).sum(axis=1) > 0.9).all()
    assert mesh.has_uv and np.ptp(mesh.uv[..., 0], axis=1).max() < 0.2  # no face spans the seam
    assert mesh.uv.min() >= 0 and mesh.uv[..., 1].max() <= 1


def test_teapot():
    mesh = load_mesh("teapot")
    assert len(mesh.faces) == 6320 and mesh.degenerate_faces == mesh.zero_normal_faces == 0
    center, radius = mesh.bounds
    assert np.allclose(center, 0, atol=1e-6) and abs(radius - 1) < 1e-6
    assert mesh.has_uv and mesh.uv.min() >= 0 and mesh.uv.max() <= 1
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    assert np.allclose((high - low) / (high - low)[1] * 3.15, (6.434, 3.15, 4), atol=2e-3)  # Newell's size

    # Borders of patches share vertices: only the rims of the four surfaces are open. Each is one ring: the
    # pot's, the lid's, and the two ends of handle and spout, of 40, 40 and four times 20 edges.
    uses = edge_uses(mesh)
    assert max(uses.values()) == 1
    rim = {a: b for a, b in uses if (b, a) not in uses}
    rings = []
    while rim:
        start, at = next(iter(rim.items()))
        del rim[start]
        length = 1
        while at != start:
            at = rim.pop(at)
            length += 1
        rings.append(length)
    assert sorted(rings) == [20, 20, 20, 20, 40, 40]


def test_teapot_normals():
    mesh = load_mesh("teapot")
    corners, normals = geometry(mesh)
    agreement = (normals[:, None] * mesh.normals[mesh.faces]).sum(axis=2)
    assert agreement.min() > 0.3 and np.mean(agreement > 0.9) > 0.95
    fine = Mesh(*teapot(level=20))
    error = ((geometry(fine)[1][:, None] * fine.normals[fine.faces]).sum(axis=2) - 1).mean()
    assert 0.2 < error / (agreement - 1).mean() < 0.3  # cosines converge with the square of the step
    # Outward: the volume is positive, and the highest and lowest points look up and down.
    assert np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0
    assert np.allclose(mesh.normals[mesh.positions[:, 1].argmax()], (0, 1, 0), atol=1e-6)
    bottom = np.lexsort([np.hypot(*(mesh.positions[:, [0, 2]] - (mesh.positions[:, [0, 2]].mean(0))).T),
                         mesh.positions[:, 1]])[0]
    assert mesh.normals[bottom, 1] < -0.99
    body = np.abs(mesh.positions[:, 2]) > 0.4  # neither handle nor spout reach so far to the side
    assert (mesh.normals[body, 2] * mesh.positions[body, 2] > 0).all()


def test_built_in_models_need_no_trimesh():
    code = ("import sys; from clfur.files.meshes import load_mesh; load_mesh('teapot'); load_mesh('sphere'); "
            "sys.exit('trimesh' in sys.modules)")
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
