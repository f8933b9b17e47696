#!/usr/bin/env bash
# Packages: assimp_py 1.1.0 and, to compare, pymeshlab 2025.7.post1 (PyPI), with numpy 2.4.6.
# Input: a PLY of seven points whose surface is one `tristrips` list: 0 1 2 3, -1 (start anew), 4 5 6. Large scans of
#   the Stanford archive are stored so (lucy.ply). Its three triangles have the area .5 + .5 + 1.5 = 2.5.
# Seen: assimp_py gives one triangle, the last, of the area 1.5; without the -1 (five triangles, area 4.5) again the last only.
#   pymeshlab gives 3 triangles and 2.5, then 5 and 4.5. No error, no warning.
# Why it matters: of a scanned animal of 100,000 triangles one is left, so the fur is gone but for one tuft. The same triangles
# as an element `face` are read right.
# Known: Assimp's issues 2337 and 6296, mended in Assimp's source in 2026, not in this package.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check assimp_py==1.1.0 pymeshlab==2025.7.post1 numpy==2.4.6

cat > try.py <<'PY'
import assimp_py
import numpy as np
import pymeshlab

POINTS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (2, 0, 0), (5, 0, 0), (2, 1, 0)], float)


def write(element, lists):
    head = ["ply", "format ascii 1.0", f"element vertex {len(POINTS)}", *(f"property float {axis}" for axis in "xyz"),
            f"element {element} {len(lists)}", "property list int int vertex_indices", "end_header"]
    rows = [" ".join(f"{value:g}" for value in point) for point in POINTS]
    rows += [" ".join(map(str, [len(one), *one])) for one in lists]
    with open("surface.ply", "w") as file:
        file.write("\n".join(head + rows) + "\n")


def by_assimp():
    mesh, = assimp_py.import_file("surface.ply", assimp_py.Process_Triangulate).meshes
    corners = np.asarray(mesh.vertices).reshape(-1, 3)[np.asarray(mesh.indices).reshape(-1, 3)]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return len(corners), float(np.linalg.norm(crosses, axis=1).sum() / 2)


def by_meshlab():
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.load_new_mesh("surface.ply")
    return meshes.current_mesh().face_number(), float(meshes.get_geometric_measures()["surface_area"])


seen = []
for name, element, lists in (("restart", "tristrips", [[0, 1, 2, 3, -1, 4, 5, 6]]), ("one strip", "tristrips", [[0, 1, 2, 3, 4, 5, 6]]),
                             ("faces", "face", [[0, 1, 2], [2, 1, 3], [4, 5, 6]])):
    write(element, lists)
    seen.append((by_assimp(), by_meshlab()))
    print(f"{name}: assimp_py {seen[-1][0]}, pymeshlab {seen[-1][1]} (triangles, area)")
if seen != [((1, 1.5), (3, 2.5)), ((1, 1.5), (5, 4.5)), ((3, 2.5), (3, 2.5))]:
    raise SystemExit("changed: other triangles or areas than before")
PY
venv/bin/python try.py
