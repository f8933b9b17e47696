"""Meshes of places of a file's vertices, which all have the faces and the numbering of one in rest."""

from collections.abc import Iterable

import numpy as np

from ..errors import Error
from ..scene import Mesh, checks
from ..scene.origin import ZERO, copied, near_origin

TOGETHER = 1e-4   # of the mesh's radius: vertices that touch in rest, and are never further apart, are one


class Poses:
    """Gives the Mesh of each pose: its faces, uv, materials and numbering are those of a Mesh in rest.

    rest: a Mesh as a file gives it, by its `numbering`. poses: places of the file's vertices [n, 3] in some poses. What
    touches in rest and parts in one of them is not welded, so that lips that are closed in rest can open.
    """

    def __init__(self, rest: Mesh, poses: Iterable[np.ndarray]) -> None:
        self._rest = rest
        corners = rest.numbering.corners.astype(np.intp)
        self._dropped = corners[rest.dropped[0]]
        self._used, at = np.unique(corners[rest.kept_faces], return_index=True)   # vertices of the file
        welded = rest.faces.ravel()[at].astype(np.intp)
        self._of = _parted(self._used, welded, poses, TOGETHER * rest.bounds[1])
        place = np.zeros(int(self._used.max()) + 1, np.intp)
        place[self._used] = self._of
        self._faces = rest.faces if self._of is welded else checks.frozen(place[corners[rest.kept_faces]].astype("u4"))
        count = int(self._of.max()) + 1
        self._first = np.empty(count, np.intp)
        self._first[self._of[::-1]] = self._used[::-1]   # of several the first is written last
        of_rest = np.empty(count, np.intp)
        of_rest[self._of] = welded
        self._normals = rest.normals[of_rest].astype(np.float64)
        facing = _facing(rest.positions[of_rest].astype(np.float64), self._faces)
        self._sign = np.where((facing * self._normals[self._faces].sum(1)).sum(1) < 0, -1.0, 1.0)[:, None]

    def mesh(self, positions: np.ndarray, normals: np.ndarray | None) -> Mesh:
        """Return the Mesh of places, and normals (None, or zero where there are none), of the file's vertices [n, 3].
        Raises Error where they are not finite."""
        places = positions[self._first]
        if not np.isfinite(places).all():
            raise Error("has places that are not finite at this time; allowed: finite ones")
        given, origin = near_origin(places, ZERO, "Mesh.positions")
        which, _, *others = self._rest.dropped
        return copied(
            self._rest, positions=checks.frozen(given + np.float32(0)), origin=origin, faces=self._faces,
            normals=checks.frozen(self._smooth(places, normals).astype(np.float32)),
            dropped=(which, checks.frozen((positions[self._dropped] - origin).astype(np.float32)), *others))

    def _smooth(self, places, given):
        """Return unit normals: means of the given ones, else of faces by area, else those in rest."""
        count, found = len(places), np.zeros((len(places), 3))
        if given is not None:
            found = _sums(_unit(given[self._used]), self._of, count)
            found = _unit(np.where(np.abs(found) > 1e-6, found, 0))
        missing = ~found.any(axis=1)
        if missing.any():
            by_area = np.repeat(_facing(places, self._faces) * self._sign, 3, axis=0)
            of_faces = _unit(_sums(by_area, self._faces.ravel(), count))
            found = np.where(missing[:, None], np.where(of_faces.any(axis=1)[:, None], of_faces, self._normals), found)
        return found


def _parted(used, welded, poses, far):
    """Return which vertex of the mesh each of the used ones of a file is, [n]: those of the mesh in rest, and more
    where some part by more than ``far`` in one of the poses."""
    counts = np.bincount(welded)
    shared = np.flatnonzero(counts[welded] > 1)
    if not len(shared):
        return welded
    ways = np.stack([pose[used[shared]] for pose in poses])
    result, count, left = welded, len(counts), np.arange(len(shared))
    while len(left):   # those of the first of each go with it, all others once more
        _, first, which = np.unique(welded[shared[left]], return_index=True, return_inverse=True)
        more = left[np.abs(ways[:, left] - ways[:, left[first]][:, which]).max(axis=(0, 2)) > far]
        if not len(more):
            break
        if result is welded:
            result = welded.copy()
        _, which = np.unique(welded[shared[more]], return_inverse=True)
        result[shared[more]] = count + which
        count, left = count + int(which.max()) + 1, more
    return result


def _facing(places, faces):
    """Return cross products of two edges of faces, float64 [F, 3]: along their normals, as long as twice their area."""
    a, b, c = (places[faces[:, k]].T for k in range(3))
    (ux, uy, uz), (vx, vy, vz) = b - a, c - a
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)


def _sums(values, index, count):
    return np.stack([np.bincount(index, values[:, k], count) for k in range(3)], axis=1)


def _unit(vectors):
    """Return vectors [n, 3] of length one; those that are zero, or not finite, as zero."""
    with np.errstate(all="ignore"):
        x, y, z = np.abs(vectors).T   # column by column: four times as fast as along rows
        size = np.maximum(np.maximum(x, y), z)[:, None]
        good = np.isfinite(size) & (size > 0)
        vectors = np.where(good, vectors / np.where(good, size, 1), 0)   # so that no square overflows
        x, y, z = vectors.T
        length = np.sqrt(x * x + y * y + z * z)[:, None]
        return vectors / np.where(length > 0, length, 1)
