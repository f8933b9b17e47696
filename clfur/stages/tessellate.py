"""Mesh faces -> the smaller triangles that carry a strand each and make the drawn body."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Surface:
    """A tessellated mesh on the device."""

    positions: Any     # [V, 4] float32 world
    normals: Any       # [V, 4] float32 unit
    uv: Any            # [V, 4] float32 u, v, -, -
    barycentric: Any   # [V, 4] float32 place in the mesh's face
    triangles: Any     # [T, 4] uint32 three vertices counter-clockwise, face of the mesh
    unit: float        # scale of lengths that makes areas whole numbers
    longest: float = np.inf   # no side of a triangle is longer [world]
    first_triangle: int = 0   # number of the first of these triangles among all of the mesh


def levels_of(inner, outer, faces):
    """Levels for every face, [faces, 4] int32: outer[0], outer[1], outer[2], inner.

    ``inner`` is a number or [faces], ``outer`` a number or [faces, 3], each 1..64.  As OpenGL has it, an inner
    level of 1 counts as 2 unless all outer levels are 1 (OpenGL 4.6, 11.2.2.1, equal spacing).
    """
    levels = np.empty((faces, 4), np.int32)
    levels[:, :3] = outer
    levels[:, 3] = inner
    levels[(levels[:, 3] == 1) & (levels[:, :3] > 1).any(1), 3] = 2
    return levels


def counts_of(levels):
    """Vertices and triangles that each face gives, [faces] int64 each; see `levels_of`."""
    outer, n = levels[:, :3].sum(1, dtype=np.int64), levels[:, 3].astype(np.int64)
    rings = n // 2 + n % 2 - 1                       # inner rings with sides: n-2, n-4, ... down to 1 or 2
    inside = 3 * rings * (n - 1 - rings)             # their segments, which are their vertices
    vertices = outer + inside + (n % 2 == 0)
    # Every ring's segment carries one triangle outwards and one inwards; an odd level ends in one triangle.
    triangles = np.where(n == 1, 1, outer + 2 * inside - 2 * (n % 2 != 0))
    return vertices, triangles


def tessellate(gpu, mesh, inner=1, outer=1, surface="pn", faces=None):
    """Divide every face and put the new vertices on the flat or the curved (PN) triangle -> `Surface`.

    ``mesh`` has positions and normals [V, 3] float32, uv [F, 3, 2] float32, faces [F, 3] uint32.  ``faces``: which of
    them, (first, one past the last), if not all.
    """
    levels = levels_of(inner, outer, len(mesh.faces))
    begin, end = faces or (0, len(levels))
    vertices, triangles = counts_of(levels)
    before, levels = int(triangles[:begin].sum()), levels[begin:end]
    first_vertex = np.concatenate([[0], np.cumsum(vertices[begin:end])])
    first_triangle = np.concatenate([[0], np.cumsum(triangles[begin:end])])
    n_vertices, n_triangles = int(first_vertex[-1]), int(first_triangle[-1])

    device_levels = gpu.upload(levels)
    device_first = gpu.upload(first_vertex.astype(np.uint32))
    result = Surface(
        positions=gpu.empty((n_vertices, 4), np.float32),
        normals=gpu.empty((n_vertices, 4), np.float32),
        uv=gpu.empty((n_vertices, 4), np.float32),
        barycentric=gpu.empty((n_vertices, 4), np.float32),
        triangles=gpu.empty((n_triangles, 4), np.uint32),
        unit=np.float32(2.0**28 / np.sqrt(mesh.area)),
        # A side of a curved triangle is longer than that of a flat one, by far less than twice.
        longest=2 * mesh.longest_edge / min(np.min(inner), np.min(outer)),
        first_triangle=before,
    )
    gpu.launch("tessellate.vertices", end - begin,
               positions=gpu.upload(widen(mesh.positions)), normals=gpu.upload(widen(mesh.normals)),
               corner_uv=gpu.upload(widen(mesh.uv[begin:end].reshape(-1, 2))),
               faces=gpu.upload(widen(mesh.faces[begin:end])),
               levels=device_levels, first=device_first, curved=surface == "pn", out_positions=result.positions,
               out_normals=result.normals, out_uv=result.uv, out_barycentric=result.barycentric)
    gpu.launch("tessellate.triangles", end - begin, levels=device_levels, first_vertex=device_first,
               first_triangle=gpu.upload(first_triangle.astype(np.uint32)), out_triangles=result.triangles)
    return result


def no_surface(gpu):
    """`Surface` without a triangle."""
    rows = [gpu.empty((0, 4), np.float32) for _ in range(4)]
    return Surface(*rows, triangles=gpu.empty((0, 4), np.uint32), unit=np.float32(1))


def widen(array):
    """[N, <4] -> [N, 4] with zeros: the device reads vectors of four."""
    wide = np.zeros((len(array), 4), array.dtype)
    wide[:, :array.shape[1]] = array
    return wide
