"""Rays and the fibres and triangles that they meet: brute force in float64, with bins to spare what is far off."""

from dataclasses import dataclass

import numpy as np

PAIRS = 1 << 17          # of rays and things at a time: their arrays stay in a processor's cache
CELLS_EACH = 4           # bins for each thing
MOST_CELLS = 1 << 24
ACROSS = 4               # bins that a thing covers at most, on average


@dataclass(frozen=True)
class Eye:
    """Where rays come from: all from ``origin`` [3], or side by side along the last of ``axes``.

    axes: [3, 3] rows, a right-handed frame whose last axis is the way ahead.  A ray is given by its place [2]: where it
    passes through the plane at distance 1, or through any plane across if they are parallel.
    """

    origin: np.ndarray
    axes: np.ndarray
    parallel: bool

    def frame(self, points):
        """World points [..., 3] -> along the axes, from the origin."""
        return (points - self.origin) @ self.axes.T

    def places(self, framed):
        """Points of the frame [..., 3], before the eye -> places [..., 2] of the rays through them."""
        return framed[..., :2] if self.parallel else framed[..., :2] / framed[..., 2:]

    def points(self, places, z):
        """World points at distances z [n] ahead on rays [n, 2]."""
        across = places if self.parallel else places * z[:, None]
        return np.column_stack([across, z]) @ self.axes + self.origin


def frame_along(direction):
    """Rows of a right-handed frame whose last is ``direction``, a unit vector."""
    x = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(direction, x), direction])


class Fibres:
    """Round straight fibres between two points each, before an eye.

    ``a``, ``b``: [n, 4] ends in the world and the diameter there.  ``first``, ``last``: [n] whether a strand starts or
    ends there; elsewhere it goes on with the fibre before or after it in the array, and `nearest` fills the gap
    outside of the bend with what a ball has there.  ``near``: least distance ahead.
    ``window``: (low [2], high [2]), the places that rays may have.
    """

    def __init__(self, eye, a, b, first, last, near, window):
        p, q = eye.frame(a[:, :3]), eye.frame(b[:, :3])
        self.eye, self.near = eye, near
        self.data = np.column_stack([p, q - p, a[:, 3] / 2, (b[:, 3] - a[:, 3]) / 2]).T.copy()
        self.before, self.after = (np.roll(q - p, shift, 0) for shift in (1, -1))
        self.low, self.high = np.where(first, 0.0, -np.inf), np.where(last, 1.0, np.inf)
        radius = np.maximum(a[:, 3], b[:, 3]) / 2
        inside = np.flatnonzero((np.maximum(p[:, 2], q[:, 2]) + radius > near) | eye.parallel)
        p, q = _cut(p[inside], q[inside], near, eye), _cut(q[inside], p[inside], near, eye)
        half = np.maximum(_half(p, radius[inside], eye), _half(q, radius[inside], eye))
        self.bins = Bins(np.stack([eye.places(p), eye.places(q)], 1), half, window, inside)

    def meet(self, places, ray, fibre, joined):
        """Pairs of a ray and a fibre -> (whether they meet, distance ahead, share of the way from a to b) [n] each.

        A ray meets a fibre where it passes its axis within its radius: that is a ribbon which faces the ray.
        ``joined``: a ball at each joint fills the gap at a bend, where both fibres have ended,
        else the ways of a ray past a strand are counted: next to joints as many twice as not at all.
        """
        x, y = places[ray, 0], places[ray, 1]
        ax, ay, az, ux, uy, uz, r, more = self.data.take(fibre, 1)
        if self.eye.parallel:                # the ray is (x, y, 0) + t (0, 0, 1), else t (x, y, 1)
            ax, ay = ax - x, ay - y
            along, ahead, square = uz, az, 1.0
            x = y = 0.0
        else:
            along, ahead, square = x * ux + y * uy + uz, x * ax + y * ay + az, x * x + y * y + 1
        uu, ua = ux * ux + uy * uy + uz * uz, ux * ax + uy * ay + uz * az
        across = square * uu - along * along
        with np.errstate(invalid="ignore", divide="ignore"):
            s = (along * ahead - square * ua) / across
            share = np.clip(s, 0, 1)
            t = (ahead + share * along) / square
            dx, dy, dz = ax + share * ux - t * x, ay + share * uy - t * y, az + share * uz - t
            radius = r + share * more
            met = (dx * dx + dy * dy + dz * dz < radius * radius) & (across > 1e-24 * square * uu)
        if joined:
            met &= (s >= self.low[fibre]) & (s <= self.high[fibre])
            past = np.flatnonzero(met & (s != share))
            other = np.where((s[past] > 1)[:, None], self.after[fibre[past]], -self.before[fibre[past]])
            met[past] = (np.stack([dx, dy, dz], 1)[past] * other).sum(1) >= 0   # from the ray to the joint
        else:
            met &= (s >= 0) & (s < 1)
        if not self.eye.parallel:
            met &= t >= self.near
        return met, t, share

    def nearest(self, places):
        """The nearest fibre on each ray [n, 2] -> (distance ahead [n], infinite where there is none; fibre [n])."""
        return _nearest(self.bins, places, lambda ray, fibre: self.meet(places, ray, fibre, True)[:2])

    def share(self, places, fibre):
        """How far along its fibre each ray passes: 0 at a, 1 at b."""
        return self.meet(places, np.arange(len(places)), fibre, True)[2]

    def sum_before(self, places, z, excluded, owner, value):
        """Sum of ``value`` [n] of the fibres that each ray meets before a distance z ahead, but those
        whose ``owner`` is the ray's ``excluded`` [n] (-1: none)."""
        total = np.zeros(len(places))
        for ray, fibre in self.bins.pairs(places):
            met, t, _ = self.meet(places, ray, fibre, False)
            met &= (t < z[ray]) & (owner[fibre] != excluded[ray])
            first = ray[0]
            sums = np.bincount(ray[met] - first, value[fibre[met]], ray[-1] + 1 - first)
            total[first:ray[-1] + 1] += sums
        return total


class Triangles:
    """Triangles [n, 3, 3] of the world before an eye; for ``near`` and ``window`` see `Fibres`."""

    def __init__(self, eye, corners, near, window):
        p = eye.frame(corners)
        flat = np.concatenate([p[..., :2], np.ones_like(p[..., :1])], 2) if eye.parallel else p
        self.eye, self.near = eye, near
        # Sides as planes through the eye: a side that two triangles share gives them the same number, but for its sign.
        sides = np.cross(flat[:, (1, 2, 0)], flat[:, (2, 0, 1)])
        self.data = np.concatenate([sides.reshape(-1, 9), p[:, :, 2]], 1).T.copy()
        inside = np.flatnonzero((p[..., 2].max(1) > near) | eye.parallel)
        p, q = p[inside], np.roll(p[inside], -1, 1)
        edges = np.stack([eye.places(_cut(p, q, near, eye)), eye.places(_cut(q, p, near, eye))], 2)
        # A triangle that is cut at the near plane has another side there: its box, as two diagonals, holds all.
        cut = np.flatnonzero((p[..., 2].min(1) < near) & (not eye.parallel))
        low, high = edges[cut].min((1, 2)), edges[cut].max((1, 2))
        other = np.stack([low[:, 0], high[:, 1]], 1), np.stack([high[:, 0], low[:, 1]], 1)
        edges[cut, 0], edges[cut, 1] = np.stack([low, high], 1), np.stack(other, 1)
        edges = np.concatenate([edges, edges[:, :1]], 1)
        edges[cut, 2], edges[cut, 3] = np.stack([low, other[0]], 1), np.stack([other[1], high], 1)
        self.bins = Bins(edges, np.zeros(len(inside)), window, inside)

    def meet(self, places, ray, triangle):
        """Pairs of a ray and a triangle -> (whether they meet, distance ahead) [n] each."""
        x, y = places[ray, 0], places[ray, 1]
        d = self.data.take(triangle, 1)
        e0, e1, e2 = (x * d[k] + y * d[k + 1] + d[k + 2] for k in (0, 3, 6))
        total = e0 + e1 + e2
        met = ((e0 >= 0) & (e1 >= 0) & (e2 >= 0)) | ((e0 <= 0) & (e1 <= 0) & (e2 <= 0))
        met &= total != 0
        z = (e0 * d[9] + e1 * d[10] + e2 * d[11]) / np.where(met, total, 1)
        if not self.eye.parallel:
            met &= z >= self.near
        return met, z

    def nearest(self, places):
        """The nearest triangle on each ray [n, 2] -> as `Fibres.nearest`."""
        return _nearest(self.bins, places, lambda ray, triangle: self.meet(places, ray, triangle))

    def any_before(self, places, z, excluded):
        """Whether each ray meets a triangle, but the ``excluded`` [n] one (-1: none), before a distance z ahead."""
        found = np.zeros(len(places), bool)
        for ray, triangle in self.bins.pairs(places):
            met, t = self.meet(places, ray, triangle)
            found[ray[met & (t < z[ray]) & (triangle != excluded[ray])]] = True
        return found


def _nearest(bins, places, meet):
    depth, which = np.full(len(places), np.inf), np.full(len(places), -1)
    for ray, thing in bins.pairs(places):
        met, t = meet(ray, thing)
        ray, thing, t = ray[met], thing[met], t[met]
        np.minimum.at(depth, ray, t)
        first = t == depth[ray]
        which[ray[first]] = thing[first]
    return depth, which


def _cut(p, q, near, eye):
    """Ends p [..., 3] of lines to q, moved to the near plane where they lie before it and q does not."""
    if eye.parallel:
        return p
    rise = q[..., 2] - p[..., 2]
    short = np.maximum(near - p[..., 2], 0)
    moved = p + np.clip(short / np.where(rise > 0, rise, np.inf), 0, 1)[..., None] * (q - p)
    moved[..., 2] = np.maximum(moved[..., 2], near)
    return moved


def _half(p, radius, eye):
    """How far, in places, balls [n] extend from their middle: along either axis."""
    if eye.parallel:
        return radius
    z2, r2 = p[:, 2] ** 2, radius**2
    safe = z2 > 1.0001 * r2
    most = np.zeros(len(p))
    for k in (0, 1):
        root = radius * np.sqrt(np.maximum(p[:, k] ** 2 + z2 - r2, 0))
        for sign in (-1, 1):
            at = (p[:, k] * p[:, 2] + sign * root) / np.where(safe, z2 - r2, 1)
            most = np.maximum(most, np.abs(at - p[:, k] / p[:, 2]))
    return np.where(safe, most, np.inf)


class Bins:
    """Which things are near a place, by square bins: each is a hull of edges [n, e, 2, 2] that is grown by ``half``."""

    def __init__(self, edges, half, window, names):
        edges = edges if edges.ndim == 4 else edges[:, None]
        self.low = np.asarray(window[0], float)
        extent = np.maximum(np.asarray(window[1], float) - self.low, 1e-12)
        box_low = edges.min((1, 2)) - half[:, None]
        box_high = edges.max((1, 2)) + half[:, None]
        here = np.flatnonzero(((box_high >= self.low) & (box_low <= window[1])).all(1))
        size = np.minimum((box_high - box_low)[here].max(1), extent.max()).sum() / max(len(here), 1)
        self.cell = max(float(np.sqrt(extent.prod() / np.clip(CELLS_EACH * len(here), 64, MOST_CELLS))),
                        extent.max() / 16384, size / ACROSS)
        self.columns, self.rows = (np.floor(extent / self.cell).astype(np.int64) + 1).tolist()
        cells, things = [], []
        for at in range(0, len(here), 1 << 16):
            some = here[at:at + (1 << 16)]
            cell, thing = self._touched((edges[some] - self.low) / self.cell, half[some] / self.cell)
            cells.append(cell)
            things.append(names[some[thing]].astype(np.int32))
        cells, things = (np.concatenate([*each, np.zeros(0, np.int32)]) for each in (cells, things))
        self.things = things[np.argsort(cells, kind="stable")]
        self.starts = np.concatenate([[0], np.cumsum(np.bincount(cells, minlength=self.columns * self.rows))])

    def _touched(self, edges, half):
        """(cell, thing) for all cells that things touch; edges and half are in cells."""
        y, half = edges[..., 1], half + 1e-6               # a place on a border is near both sides
        row0 = np.clip(np.floor(y.min((1, 2)) - half), 0, self.rows).astype(np.int64)
        row1 = np.clip(np.floor(y.max((1, 2)) + half) + 1, 0, self.rows).astype(np.int64)
        thing, row = _runs(row0, row1)
        low, high = row - half[thing], row + 1 + half[thing]     # all of a thing that can touch this row
        left, right = np.full(len(row), np.inf), np.full(len(row), -np.inf)
        for k in range(edges.shape[1]):
            (px, py), (qx, qy) = edges[thing, k, 0].T, edges[thing, k, 1].T
            rise = np.where(py == qy, 1, qy - py)
            ends = [np.clip(np.where(py == qy, default, (limit - py) / rise), 0, 1)
                    for limit, default in ((low, 0), (high, 1))]
            there = (np.minimum(py, qy) <= high) & (np.maximum(py, qy) >= low)
            for end in ends:
                x = px + end * (qx - px)
                left = np.minimum(left, np.where(there, x, np.inf))
                right = np.maximum(right, np.where(there, x, -np.inf))
        slack = half[thing]
        column0 = np.clip(np.floor(left - slack), 0, self.columns).astype(np.int64)
        column1 = np.clip(np.floor(right + slack) + 1, 0, self.columns).astype(np.int64)
        at, column = _runs(column0, column1)
        return (row[at] * self.columns + column).astype(np.int32), thing[at]

    def pairs(self, places):
        """Yield (rays, things) [n] that may meet: some rays at a time, in order, and each with all of its things."""
        at = np.floor((places - self.low) / self.cell).astype(np.int64)
        inside = ((at >= 0) & (at < (self.columns, self.rows))).all(1)
        cell = np.where(inside, at[:, 1] * self.columns + at[:, 0], 0)
        start = self.starts[cell]
        counts = np.where(inside, self.starts[cell + 1] - start, 0)
        some = np.flatnonzero(counts)
        start, counts = start[some], counts[some]
        sums = np.cumsum(counts)
        begin = 0
        while begin < len(some):
            done = sums[begin - 1] if begin else 0
            end = max(int(np.searchsorted(sums, done + PAIRS, "right")), begin + 1)
            n = counts[begin:end]
            offset = start[begin:end] - (sums[begin:end] - n - done)
            yield np.repeat(some[begin:end], n), self.things[np.repeat(offset, n) + np.arange(n.sum())]
            begin = end


def _runs(first, end):
    """All whole numbers from first to before end, for each: (which [n], number [n])."""
    n = np.maximum(end - first, 0)
    which = np.repeat(np.arange(len(n)), n)
    return which, np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n) + first[which]
