"""Catmull and Clark's subdivision of polygons (1978), as USD has it: interpolateBoundary edgeAndCorner, no creases."""

import numpy as np


def smoothed(points: np.ndarray, sizes: np.ndarray, corners: np.ndarray, uv: np.ndarray | None
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return a mesh with each polygon of n corners divided into n quads: (points, corners [4 C] and uv of these).

    points: float64 [V, n]. sizes: int64 [F] of the polygons, corners: int64 [C] into points, polygon after polygon.
    uv: float64 [C, 2] or None; it stays linear. The quads come in the order of the corners.
    """
    face, behind, before = _around(sizes)
    edges, edge, inner = _edges(corners, behind)
    middles = points[edges].mean(axis=1)
    centers = _means(points[corners], face, len(sizes))
    new_edges = np.where(inner[:, None], (middles + _means(centers[face], edge, len(edges))) / 2, middles)

    many = np.bincount(corners, minlength=len(points))[:, None]
    around = _means(centers[face], corners, len(points))   # of the faces at a vertex, and of the edges there
    aside = _means(middles[np.concatenate([edge, edge[before]])], np.concatenate([corners, corners]), len(points))
    new = np.where(many > 0, (around + 2 * aside + (many - 3) * points) / np.maximum(many, 1), points)
    new = _bounded(new, points, edges[~inner], many[:, 0], 3 / 4)

    first, last = len(points), len(points) + len(edges)
    quads = np.stack([corners, first + edge, last + face, first + edge[before]], axis=1)
    if uv is not None:
        half = (uv + uv[behind]) / 2
        uv = np.stack([uv, half, _means(uv, face, len(sizes))[face], half[before]], axis=1).reshape(-1, 2)
    return np.concatenate([new, new_edges, centers]), quads.reshape(-1), uv


def limit(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return where points of quads come to lie on the surface itself (Halstead et al. 1993), float64 [V, n].

    corners: int64 [4 F], of quads that `smoothed` has made.
    """
    _, behind, before = _around(np.full(len(corners) // 4, 4))
    edges, _, inner = _edges(corners, behind)
    many = np.bincount(corners, minlength=len(points))[:, None]
    aside = _means((points[corners[behind]] + points[corners[before]]) / 2, corners, len(points))
    across = _means(points[corners[behind[behind]]], corners, len(points))
    new = np.where(many > 0, (many * points + 4 * aside + across) / (many + 5), points)
    return _bounded(new, points, edges[~inner], many[:, 0], 2 / 3)


def _around(sizes):
    """Of each corner of polygons: its polygon, and the corners behind and before it."""
    face, starts = np.repeat(np.arange(len(sizes)), sizes), np.cumsum(sizes) - sizes
    own = np.arange(len(face)) - starts[face]
    return face, starts[face] + (own + 1) % sizes[face], starts[face] + (own - 1) % sizes[face]


def _edges(corners, behind):
    """(vertices [E, 2] of edges, the edge of each corner and the one behind it, whether an edge has two faces)."""
    ends = np.sort(np.stack([corners, corners[behind]], axis=1), axis=1)
    edges, edge = np.unique(ends, axis=0, return_inverse=True)
    return edges, edge.reshape(-1), np.bincount(edge.reshape(-1), minlength=len(edges)) == 2


def _bounded(new, points, rim, many, own):
    """New places, but of vertices on edges [R, 2] without two faces: ``own`` parts of their place and the rest of their
    two neighbours' there; a corner of one face alone, or where other than two such edges meet, stays."""
    touched = np.bincount(rim.ravel(), minlength=len(points))
    beside = _means(points[rim[:, ::-1]].reshape(-1, points.shape[1]), rim.ravel(), len(points))
    smooth = (touched == 2) & (many > 1)
    new = np.where((touched > 0)[:, None], points, new)
    return np.where(smooth[:, None], own * points + (1 - own) * beside, new)


def _means(values, of, count):
    """Means [count, k] of values [n, k] by number; 0 where there are none."""
    many = np.maximum(np.bincount(of, minlength=count), 1)
    return np.stack([np.bincount(of, column, count) for column in values.T], axis=1) / many[:, None]
