"""distance in float64 NumPy: the nearest feature by brute force, places between nodes, strands that slide."""

import numpy as np

from .vectors import dot, f64

SOME = 1 << 21   # pairs of a point and a triangle that are looked at together


# --- how far the body is -------------------------------------------------------------------------------------------


class Body:
    """Triangles, corners [T, 3, 3], and pseudo-normals of their features (Baerentzen and Aanaes 2005).

    ``normals`` [T, 3, 3] of the corners tell what is outside, or else that a face is counter-clockwise from there.
    Features of a triangle are numbered 0..2 its corners, 3..5 the sides from there to the next, 6 itself.  Triangles
    without an area are left out.
    """

    def __init__(self, corners, normals=None):
        corners = f64(corners)
        sides = np.roll(corners, -1, 1) - corners
        n = np.cross(sides[:, 0], sides[:, 1])
        size = np.linalg.norm(n, axis=1)
        keep = size > 1e-9 * np.linalg.norm(sides, axis=2).max(1, initial=0) ** 2
        self.corners, sides, n = corners[keep], sides[keep], n[keep] / size[keep, None]
        if normals is not None:
            n *= np.where(dot(n, f64(normals)[keep].sum(1)) < 0, -1, 1)[:, None]
        back = -np.roll(sides, 1, 1)
        angles = np.arctan2(np.linalg.norm(np.cross(sides, back), axis=2), dot(sides, back))
        _, number = np.unique(self.corners.reshape(-1, 3), axis=0, return_inverse=True)
        number = number.reshape(-1, 3)
        ends = np.sort(np.stack([number, np.roll(number, -1, 1)], 2), 2)
        side = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)[1].reshape(-1, 3)
        of_corner, of_side = (np.zeros((each.max(initial=0) + 1, 3)) for each in (number, side))
        for i in range(3):
            np.add.at(of_corner, number[:, i], n * angles[:, i, None])
            np.add.at(of_side, side[:, i], n)
        self.normals = np.concatenate([of_corner[number], of_side[side], n[:, None]], 1)          # [T, 7, 3]
        self.middle = self.corners.mean(1)
        self.radius = np.linalg.norm(self.corners - self.middle[:, None], axis=2).max(1, initial=0)

    def nearest(self, points):
        """What is nearest to points [N, 3]: (distance, below 0 inside; the way from there [N, 3])."""
        points = f64(points)
        values, ways = np.empty(len(points)), np.empty((len(points), 3))
        for a in range(0, len(points), step := max(SOME // max(len(self.middle), 1), 1)):
            some = points[a:a + step]
            to_middle = np.linalg.norm(some[:, None] - self.middle, axis=2)
            p, t = np.nonzero(to_middle - self.radius <= to_middle.min(1)[:, None] + 1e-12)
            found, feature = closest(some[p], self.corners[t])
            way = some[p] - found
            order = np.lexsort([np.linalg.norm(way, axis=1), p])
            first = order[np.searchsorted(p[order], np.arange(len(some)))]
            way, t, feature = way[first], t[first], feature[first]
            inside = dot(way, self.normals[t, feature]) < 0
            values[a:a + step], ways[a:a + step] = np.linalg.norm(way, axis=1) * np.where(inside, -1, 1), way
        return values, ways


    def look(self, points):
        """(Distance, slope [N, 3]) at points [N, 3], as `near` has them of nodes, but exact."""
        values, ways = self.nearest(points)
        some = np.abs(values) > 1e-12
        return values, np.where(some[:, None], ways / np.where(some, values, 1)[:, None], 0)


def closest(p, corners):
    """The closest point of triangles [N, 3, 3] to points [N, 3], and the feature it lies on (Ericson, "Real-Time
    Collision Detection", 5.1.5)."""
    a, b, c = (corners[:, i] for i in range(3))
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2, d3, d4, d5, d6 = dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(all="ignore"):
        on_ab, on_ac = a + (d1 / (d1 - d3))[:, None] * ab, a + (d2 / (d2 - d6))[:, None] * ac
        on_bc = b + ((d4 - d3) / (d4 - d3 + d5 - d6))[:, None] * (c - b)
        within = a + (vb / (va + vb + vc))[:, None] * ab + (vc / (va + vb + vc))[:, None] * ac
    cases = [(d1 <= 0) & (d2 <= 0), (d3 >= 0) & (d4 <= d3), (d6 >= 0) & (d5 <= d6), (vc <= 0) & (d1 >= 0) & (d3 <= 0),
             (va <= 0) & (d4 - d3 >= 0) & (d5 - d6 >= 0), (vb <= 0) & (d2 >= 0) & (d6 <= 0)]
    feature = np.select(cases, range(6), 6)
    places = np.stack([a, b, c, on_ab, on_bc, on_ac, within], 1)
    return places[np.arange(len(p)), feature], feature


def nodes(grid):
    """Where the nodes of a grid are, x runs first: [N, 3]."""
    x, y, z = (np.arange(n) / float(grid["place"][3]) + first for n, first in zip(grid["size"][:3], f64(grid["place"])))
    return np.stack(np.meshgrid(z, y, x, indexing="ij"), -1)[..., ::-1].reshape(-1, 3)


def deepened(grid, values):
    """Values of nodes, as the kernel `finish` gives them, with those that are far: half the way along rows from what is
    known, through planes of x, then y, then z; inside is what is enclosed by it along all three."""
    size, reach, cell = grid["size"][2::-1], float(grid["reach"][0]), float(grid["reach"][1])
    v = f64(values).reshape(size)
    far, enclosed = v >= reach, np.ones(size, bool)
    for axis in range(3):
        enclosed &= _comes_from_inside(v, far, axis) & np.flip(
            _comes_from_inside(np.flip(v, axis), np.flip(far, axis), axis), axis)
    found = np.where(far, np.inf, np.abs(v))
    for axis in (2, 1, 0):
        for order in (1, -1):
            rows, free = (np.moveaxis(each, axis, 0)[::order] for each in (found, far))
            for k in range(1, len(rows)):
                rows[k] = np.where(free[k], np.minimum(rows[k], rows[k - 1] + cell / 2), rows[k])
    return np.where(far & enclosed | ~far & (v < 0), -found, found).ravel()


def _comes_from_inside(v, far, axis):
    """Whether the last node before each along an axis that is known is inside."""
    inside = np.zeros(v.shape, bool)
    rows, values, free = (np.moveaxis(each, axis, 0) for each in (inside, v, far))
    for k in range(1, len(rows)):
        rows[k] = np.where(free[k - 1], rows[k - 1], values[k - 1] < 0)
    return inside


# --- between nodes -------------------------------------------------------------------------------------------------


def near(grid, values, points):
    """(Distance, slope [N, 3]) at points [N, 3] between nodes with these values: what each corner of a cell adds."""
    size = np.array(grid["size"][:3], int)
    q = np.clip((f64(points) - f64(grid["place"])[:3]) * float(grid["place"][3]), 0, size - 1)
    low = np.minimum(np.floor(q), size - 2).astype(int)
    f = q - low
    value, slope = np.zeros(len(q)), np.zeros((len(q), 3))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (low + corner).T
        there = f64(values)[(z * size[1] + y) * size[0] + x]
        shares = np.where(corner, f, 1 - f)
        value += there * shares.prod(1)
        for axis in range(3):
            others = np.delete(shares, axis, 1).prod(1)
            slope[:, axis] += there * others * (1 if corner[axis] else -1) * float(grid["place"][3])
    return value, slope


# --- strands -------------------------------------------------------------------------------------------------------


def slide(points, widths, counts, look, cell):
    """Strands [N, S, 3] of so many points each, with widths [N, S], that slide along a body -> (points, which moved).

    ``look``: gives (distance, slope [n, 3]) at points [n, 3].  A segment that would come nearer to the body than half
    its width is turned about its beginning; one that begins nearer may stay about as near.
    """
    came, points = f64(points), f64(points).copy()
    moved = np.zeros(len(points), bool)
    free = np.zeros(len(points))
    if (some := counts > 1).any():
        free[some] = look(points[some, 0])[0]
    for k in range(points.shape[1] - 1):
        way = came[:, k + 1] - came[:, k]
        length = np.where(k + 1 < counts, np.linalg.norm(np.nan_to_num(way), axis=1), 0)
        away = np.minimum(0.5 * np.nan_to_num(widths[:, k + 1]), free + 0.1 * length)
        asked = (length > 0) & (free - length < away)
        free = np.where(asked, free, free - length)
        ahead, turned = way.copy(), np.zeros(len(points), bool)
        if asked.any():
            ahead[asked], free[asked], turned[asked] = _turned(
                points[asked, k], way[asked] / length[asked, None], length[asked], free[asked], away[asked], look, cell)
            ahead[asked & turned] *= length[asked & turned, None]
            ahead[asked & ~turned] = way[asked & ~turned]
        moved |= turned
        points[moved, k + 1] = points[moved, k] + ahead[moved]
    return points, moved


def _turned(at, ahead, length, free, away, look, cell, looks=32, places=12):
    """Segments (directions [n, 3], distance where they end, which were turned) that keep ``away`` from a body."""
    pace = np.maximum(cell, length / places)
    r = np.minimum(np.maximum(free - away, pace), length)
    going, turned, ahead, free = np.ones(len(at), bool), np.zeros(len(at), bool), ahead.copy(), free.copy()
    for _ in range(looks):
        if not going.any():
            break
        i = np.flatnonzero(going)
        free[i], slope = look(at[i] + r[i, None] * ahead[i])
        lack = away[i] - free[i]
        up = slope - dot(slope, ahead[i])[:, None] * ahead[i]
        rise = np.linalg.norm(up, axis=1)
        straight = rise < 0.02
        up = np.where(straight[:, None], _across(ahead[i]), up / np.maximum(rise, 0.02)[:, None])
        turn = np.where(straight, 0.25, np.minimum(lack / (r[i] * np.maximum(rise, 0.02)), 1))
        inside = lack > cell / 128
        there = ahead[i] + turn[:, None] * up
        ahead[i[inside]] = (there / np.linalg.norm(there, axis=1)[:, None])[inside]
        turned[i[inside]] = True
        going[i[~inside & (r[i] >= length[i])]] = False
        out = i[~inside]
        r[out] = np.minimum(r[out] + np.maximum(free[out] - away[out], pace[out]), length[out])
    return ahead, free, turned


def _across(v):
    """A vector of length one across each unit vector [n, 3], in the plane of y and z or of x and z."""
    x, y, z = v.T
    zero = np.zeros(len(v))
    steep = y * y + z * z > 0.5
    across = np.where(steep[:, None], np.stack([zero, -z, y], 1), np.stack([z, zero, -x], 1))
    return across / np.linalg.norm(across, axis=1)[:, None]
