"""Meshes in rest: the same faces as one that is posed, by which fur knows its place on the skin in every pose."""


import numpy as np

from ..errors import Error
from . import checks
from .mesh import Mesh, first_of_equal_rows
from .origin import copied
from .remembered import remembered

REACH = 16   # faces without area, one beside the other, over which normals spread


def posed(mesh: Mesh, rest: Mesh | None, where: str) -> Mesh:
    """Return the ``mesh`` with all the faces of the mesh in ``rest``: also those that have no area in this pose.

    ``where``: the field that gives rest, such as "Strands.rest". The faces must be those kept of the given ones, and
    corners that are one vertex in both poses must be so wherever the vertex is; places may touch in one of the poses.
    Raises Error otherwise.
    """
    if rest is None or rest is mesh:
        return mesh
    mesh = _completed(mesh, rest)
    one, other = rest.kept_faces, mesh.kept_faces
    if len(one) != len(other) or (one != other).any():
        face = int(np.setxor1d(one, other)[0])
        has, lacks = (where, "Scene.mesh") if face in one else ("Scene.mesh", where)
        raise Error(f"{where} has {len(one):,} faces and Scene.mesh {len(other):,}: face {face} of {has} is none that "
                    f"{lacks} has kept; allowed: the same faces, posed in another way")
    posed, resting = mesh.faces.ravel().astype(np.int64), rest.faces.ravel().astype(np.int64)
    pairs = np.unique(posed * len(rest.positions) + resting)   # of vertices that are one corner's
    a, b = np.divmod(pairs, len(rest.positions))
    torn = (np.bincount(a)[a] > 1) & (np.bincount(b)[b] > 1)   # neither touches: these are other corners
    if torn.any():
        worst = int(np.argmax(np.isin(posed * len(rest.positions) + resting, pairs[torn])))
        raise Error(f"{where} has another vertex than Scene.mesh at corner {worst % 3} of face {int(one[worst // 3])}; "
                    "allowed: the same faces and corners, posed in another way")
    return mesh


@remembered(2)   # what is drawn again must be the very same
def _completed(mesh, rest):
    """The mesh with those of its dropped faces that rest has kept. Their vertices that no other face has get the
    normals of their neighbours, or those in rest."""
    numbers, places, uv, materials = mesh.dropped
    missing = np.isin(numbers, rest.kept_faces)
    if not missing.any():
        return mesh
    numbers, places, uv = numbers[missing], places[missing].reshape(-1, 3), uv[missing]
    known = len(mesh.positions)
    first = first_of_equal_rows(np.concatenate([mesh.positions, places]))[known:]
    new = np.unique(first[first >= known])
    faces = np.where(first < known, first, known + np.searchsorted(new, first)).reshape(-1, 3)
    normals = np.concatenate([mesh.normals.astype(np.float64), np.zeros((len(new), 3))])
    at_rest = rest.normals[rest.faces[np.searchsorted(rest.kept_faces, numbers)]]
    _spread(normals, faces, at_rest)
    kept = np.concatenate([mesh.kept_faces, numbers])
    order = np.argsort(kept)
    return copied(
        mesh, positions=checks.frozen(np.concatenate([mesh.positions, places[new - known]])),
        normals=checks.frozen(normals.astype(np.float32)),
        uv=checks.frozen(np.concatenate([mesh.uv, uv])[order]),
        faces=checks.frozen(np.concatenate([mesh.faces, faces.astype(np.uint32)])[order]),
        material_of=None if mesh.material_of is None else checks.frozen(
            np.concatenate([mesh.material_of, materials[missing]])[order]),
        kept_faces=checks.frozen(kept[order]), dropped=tuple(each[:0] for each in mesh.dropped),
        **{name: getattr(rest, name) for name in ("degenerate_faces", "zero_normal_faces", "doubled_faces")})


def _spread(normals, faces, otherwise):
    """Give normals [V, 3] to vertices of ``faces`` [M, 3] without, from face to face, else ``otherwise`` [M, 3, 3]."""
    for _ in range(REACH):
        unknown = ~normals.any(1)
        of_faces = np.repeat(normals[faces].sum(1), 3, 0)
        sums = np.stack([np.bincount(faces.ravel(), of_faces[:, k], len(normals)) for k in range(3)], 1)
        length = np.linalg.norm(sums, axis=1)
        found = unknown & (length > 1e-6)
        if not found.any():
            break
        normals[found] = sums[found] / length[found, None]
    alone = ~normals.any(1)[faces]
    normals[faces[alone]] = otherwise[alone]
