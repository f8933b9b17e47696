"""Meshes in rest: the same faces as one that is posed, by which fur knows its place on the skin in every pose."""

import numpy as np

from ..errors import Error
from .mesh import Mesh


def rest_of(mesh: Mesh, rest: Mesh | None, where: str) -> Mesh:
    """Return the mesh in rest: ``rest``, checked to have the faces of the posed ``mesh``, or that itself for None.

    ``where``: the field that gives it, such as "Strands.rest". The faces must be those kept of the given ones, and
    corners that are one vertex in both poses must be so wherever the vertex is; places may touch in one of the poses.
    Raises Error otherwise.
    """
    if rest is None or rest is mesh:
        return mesh
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
    return rest
