"""Mesh faces -> the smaller triangles that carry a strand each and make the drawn body."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..layout import Arrays, array


@dataclass(frozen=True)
class Surface(Arrays):
    """A tessellated mesh on the device."""

    positions: Any = array("vertex", np.float32, 4)    # world
    normals: Any = array("vertex", np.float32, 4)      # unit
    uv: Any = array("vertex", np.float32, 4)           # u, v, weights of the first two corners of the mesh's face
    triangles: Any = array("triangle", np.uint32, 4)   # three vertices counter-clockwise, face of the mesh
    area_scale: float = 1.0                            # scale of lengths that makes areas whole numbers
    longest: float = np.inf                            # no side of a triangle is longer [world]
    first_triangle: int = 0                            # number of the first of these triangles among all of the mesh


@dataclass(frozen=True)
class Source(Arrays):
    """What a mesh is divided by, on the device."""

    positions: Any = array("mesh_vertex", np.float32, 3)
    normals: Any = array("mesh_vertex", np.float32, 3)
    corner_uv: Any = array("corner", np.float32, 2)    # of the faces, three each
    faces: Any = array("face", np.uint32, 3)           # three vertices
    levels: Any = array("face", np.int32, 4)           # see `levels_of`
    first_vertex: Any = array("end", np.uint32)        # that each face gives, and the end of all
    first_triangle: Any = array("end", np.uint32)


def levels_of(inner: int | np.ndarray, outer: int | np.ndarray, faces: int) -> np.ndarray:
    """Levels for every face, [faces, 4] int32: outer[0], outer[1], outer[2], inner.

    ``inner`` is a number or [faces], ``outer`` a number or [faces, 3], each 1..64.  As OpenGL has it, an inner
    level of 1 counts as 2 unless all outer levels are 1 (OpenGL 4.6, 11.2.2.1, equal spacing).
    """
    levels = np.empty((faces, 4), np.int32)
    levels[:, :3] = outer
    levels[:, 3] = inner
    levels[(levels[:, 3] == 1) & (levels[:, :3] > 1).any(1), 3] = 2
    return levels


def counts_of(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles that each face gives, [faces] int64 each; ``levels``: [faces, 4], see `levels_of`."""
    outer, n = levels[:, :3].sum(1, dtype=np.int64), levels[:, 3].astype(np.int64)
    rings = n // 2 + n % 2 - 1                       # inner rings with sides: n-2, n-4, ... down to 1 or 2
    inside = 3 * rings * (n - 1 - rings)             # their segments, which are their vertices
    vertices = outer + inside + (n % 2 == 0)
    # Every ring's segment carries one triangle outwards and one inwards; an odd level ends in one triangle.
    triangles = np.where(n == 1, 1, outer + 2 * inside - 2 * (n % 2 != 0))
    return vertices, triangles


def tessellate(gpu: Any, mesh: Any, inner: int | np.ndarray = 1, outer: int | np.ndarray = 1, surface: str = "pn",
               faces: tuple[int, int] | None = None) -> Surface:
    """Divide every face and put the new vertices on the flat or the curved (PN) triangle -> `Surface`.

    ``mesh`` has positions and normals [V, 3] float32, uv [F, 3, 2] float32, faces [F, 3] uint32.  ``inner``,
    ``outer``: as in `levels_of`.  ``faces``: which of them, (first, one past the last), if not all.
    """
    n = len(mesh.faces)
    begin, end = faces or (0, n)
    levels = levels_of(inner, outer, n if np.ndim(inner) or np.ndim(outer) else 1)   # all faces may be alike
    vertices, triangles = (np.broadcast_to(each, n) for each in counts_of(levels))
    before, levels = int(triangles[:begin].sum()), np.broadcast_to(levels, (n, 4))[begin:end]
    first_vertex = np.concatenate([[0], np.cumsum(vertices[begin:end])])
    first_triangle = np.concatenate([[0], np.cumsum(triangles[begin:end])])
    n_vertices, n_triangles = int(first_vertex[-1]), int(first_triangle[-1])

    source = Source(
        positions=gpu.lend(mesh.positions),
        normals=gpu.lend(mesh.normals),
        corner_uv=gpu.lend(mesh.uv[begin:end].reshape(-1, 2)),
        faces=gpu.lend(mesh.faces[begin:end]),
        levels=gpu.upload(levels),
        first_vertex=gpu.upload(first_vertex.astype(np.uint32)),
        first_triangle=gpu.upload(first_triangle.astype(np.uint32)),
    )
    result = Surface.empty(
        gpu, {"vertex": n_vertices, "triangle": n_triangles},
        area_scale=np.float32(2.0**28 / np.sqrt(mesh.area)),
        # A side of a curved triangle is longer than that of a flat one, by far less than twice.
        longest=2 * mesh.longest_edge / min(np.min(inner), np.min(outer)),
        first_triangle=before,
    )
    gpu.launch("tessellate.vertices", end - begin, positions=source.positions, normals=source.normals,
               corner_uv=source.corner_uv, faces=source.faces, levels=source.levels, first_vertex=source.first_vertex,
               curved=surface == "pn", out_positions=result.positions, out_normals=result.normals, out_uv=result.uv)
    gpu.launch("tessellate.triangles", end - begin, levels=source.levels, first_vertex=source.first_vertex,
               first_triangle=source.first_triangle, out_triangles=result.triangles)
    return result


def no_surface(gpu: Any) -> Surface:
    """`Surface` without a triangle."""
    return Surface.empty(gpu, {"vertex": 0, "triangle": 0})


def as_float4(array: np.ndarray) -> np.ndarray:
    """[N, <4] -> [N, 4] of the same dtype, with zeros: the device reads vectors of four."""
    wide = np.zeros((len(array), 4), array.dtype)
    wide[:, :array.shape[1]] = array
    return wide
