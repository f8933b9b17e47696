#!/usr/bin/env bash
# Package: pymeshlab 2025.7.post1 (PyPI), with numpy 2.4.6.
# Input: a unit square as binary PLY, x y z as float or double, little-endian or big-endian.
# Seen (area): float little 1.0, float big 1.0, double little 1.0, double big 0.0. In the last the faces are right and the
#   corners are 3.03865e-319 instead of 1: the bytes of a double are not swapped. No error, no warning.
# Why it matters: a scanned head in that format has no area, so it grows no fur at all; a tool that takes MeshLab for the
# truth, or converts through it, passes the empty mesh on. Turn such a file to little-endian first.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check pymeshlab==2025.7.post1 numpy==2.4.6

cat > try.py <<'PY'
import struct

import pymeshlab

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
FACES = [(0, 1, 2), (0, 2, 3)]


def area(kind, order):
    mark, code = "<>"[order == "big"], {"float": "3f", "double": "3d"}[kind]
    head = "\n".join(["ply", f"format binary_{order}_endian 1.0", "element vertex 4", *(f"property {kind} {axis}" for axis in "xyz"),
                      "element face 2", "property list uchar int vertex_indices", "end_header", ""])
    with open("square.ply", "wb") as file:
        file.write(head.encode())
        for corner in CORNERS:
            file.write(struct.pack(mark + code, *corner))
        for face in FACES:
            file.write(struct.pack(mark + "B3i", 3, *face))
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.load_new_mesh("square.ply")
    mesh = meshes.current_mesh()
    if (mesh.vertex_number(), mesh.face_number()) != (4, 2):
        raise SystemExit("changed: not 4 vertices and 2 faces")
    print(kind, order, "largest x", mesh.vertex_matrix()[:, 0].max(), end=" ")
    value = meshes.get_geometric_measures()["surface_area"]
    print("area", value)
    return value


seen = [area(kind, order) for kind in ("float", "double") for order in ("little", "big")]
if seen != [1, 1, 1, 0]:
    raise SystemExit(f"changed: the areas are {seen}, before 1, 1, 1, 0")
PY
venv/bin/python try.py
