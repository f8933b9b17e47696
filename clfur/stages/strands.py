"""Roots on a surface, and the strands that grow there or that the user brings."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from .tessellate import widen


@dataclass(frozen=True)
class Grown:
    """Strands on the device: runs of points, told apart by ``spans``."""

    points: Any       # [P, 4] float32 x, y, z, width [world]
    tangents: Any     # [P, 4] float32 unit
    strand_of: Any    # [P] uint32
    spans: Any        # [strands, 2] uint32 first point, points
    colors: Any       # [1 | strands | P, 4] float32 linear r, g, b, -
    normals: Any      # [strands, 4] float32 unit, of the skin at the root; 0 where it is not known
    uv: Any           # [strands, 4] float32 root's u, v, index of its type, -
    types: Any        # [types] layout.HairType


def grow(gpu, surface, fur):
    """Grow `clfur.Strands` on a tessellated `Surface` -> `Grown`.

    A root stands in the middle of every triangle, or ``fur.roots`` of them uniformly by area (in strata: strand
    i in the i-th part of the area).  The growth loop is the report's (section 2.1.3), each strand alone.
    """
    root, direction, uv = (_roots_on_faces if fur.roots == "faces" else _roots_by_area)(gpu, surface, fur)
    n = len(root)
    types, texels = pack_types(fur.types)
    indices = fur.type_indices if fur.type_map is not None else np.zeros((1, 1))
    stride = max(t.segments for t in fur.types) + 1
    point_forces = np.array([[*f.position, f.strength] for f in fur.point_forces], np.float32).reshape(-1, 4)
    grown = Grown(
        points=gpu.empty((n * stride, 4), np.float32),
        tangents=gpu.empty((n * stride, 4), np.float32),
        strand_of=gpu.empty(n * stride, np.uint32),
        spans=gpu.empty((n, 2), np.uint32),
        colors=gpu.empty((n, 4), np.float32),
        normals=direction,
        uv=gpu.empty((n, 4), np.float32),
        types=gpu.upload(types),
    )
    gpu.launch("strands.grow", n, root, direction, uv, grown.types,
               gpu.upload(indices.astype(np.uint32)), vector(indices.shape[::-1], np.int32), gpu.upload(texels),
               vector((*fur.force, 0), np.float32), gpu.upload(point_forces), np.uint32(len(point_forces)),
               np.uint32(fur.seed), np.uint32(stride),
               grown.points, grown.tangents, grown.strand_of, grown.spans, grown.colors, grown.uv)
    return grown


def bring(gpu, curves):
    """Put `clfur.Curves` on the device -> `Grown`; tangents come from neighbouring points."""
    counts = curves.counts.astype(np.uint32)
    n, total = len(counts), len(curves.points)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]]) if n else []
    types = np.zeros(1, layout.HairType)
    types["shine"][0, :3] = curves.specular, curves.exponent, curves.alpha
    grown = Grown(
        points=gpu.empty((total, 4), np.float32),
        tangents=gpu.empty((total, 4), np.float32),
        strand_of=gpu.empty(total, np.uint32),
        spans=gpu.upload(np.stack([first, counts], 1).astype(np.uint32)),
        colors=gpu.upload(widen(curves.color)),
        normals=gpu.full((n, 4), np.float32, 0),
        uv=gpu.full((n, 4), np.float32, 0),
        types=gpu.upload(types),
    )
    gpu.launch("strands.bring", n, gpu.upload(curves.points), grown.spans, gpu.upload(curves.width),
               np.int32(per(len(curves.width), n, total)), grown.points, grown.tangents, grown.strand_of)
    return grown


def no_strands(gpu):
    """`Grown` without a strand."""
    rows = gpu.empty((0, 4), np.float32)
    return Grown(points=rows, tangents=rows, strand_of=gpu.empty(0, np.uint32), spans=gpu.empty((0, 2), np.uint32),
                 colors=rows, normals=rows, uv=rows, types=gpu.empty(0, layout.HairType))


def per(length, strands, points):
    """What an array of this length has a value for: 0 everything, 1 each strand, 2 each point."""
    return 0 if length == 1 else 1 if length == strands else 2


def pack_types(types):
    """`clfur.HairType`s -> ([types] layout.HairType, texels of their textures [N, 4] float32)."""
    packed = np.zeros(len(types), layout.HairType)
    texels = []
    for row, t in zip(packed, types):
        row["color"] = *t.color, t.color_variation
        row["shape"] = t.segment_length, t.width, t.force_weight, t.direction_variation
        row["curl"] = t.curl[0], *_turn(t.curl[1], t.segments), t.length_variation
        row["wave"] = t.wave[0], *_turn(t.wave[1], t.segments), 0
        row["shine"] = t.specular, t.exponent, t.alpha, 0
        row["counts"] = t.segments, sum(map(len, texels)), 0, 0
        if t.color_texture is not None:
            row["counts"][2:] = t.color_texture.shape[1::-1]
            texels.append(widen(t.color_texture.reshape(-1, 3)))
    return packed, np.concatenate(texels or [np.zeros((1, 4), np.float32)])


def vector(values, dtype):
    """A kernel argument of the OpenCL type int2, float4, ..."""
    return np.array(values, dtype)


def _turn(turns, segments):
    angle = 2 * np.pi * turns / max(segments, 1)
    return np.cos(angle), np.sin(angle)


def _roots_on_faces(gpu, surface, fur):
    n = len(surface.triangles)
    roots = tuple(gpu.empty((n, 4), np.float32) for _ in range(3))
    gpu.launch("strands.roots_on_faces", n, surface.positions, surface.normals, surface.uv, surface.triangles, *roots)
    return roots


def _roots_by_area(gpu, surface, fur):
    n, triangles = fur.roots, np.uint32(len(surface.triangles))
    roots = tuple(gpu.empty((n, 4), np.float32) for _ in range(3))
    blocks = -(-int(triangles) // layout.CONSTANTS["SCAN"])
    sums, areas = gpu.empty(blocks, np.uint64), gpu.empty(int(triangles), np.uint64)
    gpu.launch("strands.sum_areas", blocks, surface.positions, surface.triangles, triangles, surface.unit, sums)
    gpu.launch("strands.scan_sums", 1, np.uint32(blocks), sums)
    gpu.launch("strands.scan_areas", blocks, surface.positions, surface.triangles, triangles, surface.unit, sums, areas)
    gpu.launch("strands.roots_by_area", n, surface.positions, surface.normals, surface.uv, surface.triangles,
               areas, triangles, np.uint32(fur.seed), np.uint32(n), *roots)
    return roots
