"""Rays that each have a place and a direction of their own, in float64: through a scene's strands and body."""

import numpy as np

EACH, MOST = 4.0, 2**22      # cells for one segment or triangle; cells at most
PAIRS = 1 << 19              # of a ray and a thing that are looked at together
LEAST = 1e-6                 # of light, below which nothing is looked for


class Space:
    """Segments and triangles in cells of space.

    ``a``, ``b``: [n, 4] ends of segments and the diameter there; ``owner``: [n] their strands; ``depth``: [n] what a
    crossing takes of the logarithm of light.  ``corners``: [m, 3, 3] of triangles, through which nothing gets.
    """

    def __init__(self, a, b, owner, depth, corners):
        self.a, self.d, self.corners = a, b - a, corners
        self.owner, self.depth = owner, depth
        radius = np.maximum(a[:, 3], b[:, 3])[:, None] / 2
        low = np.concatenate([np.minimum(a, b)[:, :3] - radius, corners.min(1)])
        high = np.concatenate([np.maximum(a, b)[:, :3] + radius, corners.max(1)])
        size = high.max(0) - low.min(0) if len(low) else np.ones(3)
        side = size.max() or 1.0
        self.low = (low.min(0) if len(low) else np.zeros(3)) - 1e-6 * side
        count = np.clip(EACH * len(low), 64, MOST)
        filled = np.prod(np.maximum(size / side, 1e-2))
        self.cell = side / np.clip(np.cbrt(count / filled), 1, 512)
        self.n = np.floor((size + 2e-6 * side) / self.cell).astype(int) + 1
        self.edges = corners[:, (1, 2, 0)] - corners
        self.segments, self.triangles = self._of_segments(a, b, radius), self._of_triangles()

    def light_left(self, p, w, strand, triangle, bias):
        """Share [n] of light that comes from direction w [n, 3] far away to places p [n, 3].

        Each lies on a strand [n] or a triangle [n] (-1: none) that does not count.  ``bias``: nothing nearer counts.
        """
        left, on = np.zeros(len(p)), np.arange(len(p))
        inverse = 1 / np.where(np.abs(w) > 1e-12, w, np.copysign(1e-12, w))
        faces = (np.stack([self.low, self.low + self.cell * self.n])[:, None] - p) * inverse
        t, out = np.maximum(faces.min(0).max(1), 0), faces.max(0).min(1)
        left[t > out] = 0.0
        cell = np.clip(np.floor((p + t[:, None] * w - self.low) / self.cell).astype(int), 0, self.n - 1)
        step = np.where(w >= 0, 1, -1)
        inside = t <= out
        on, t, cell = on[inside], t[inside], cell[inside]
        while len(on):
            walls = (self.low + (cell + (step[on] > 0)) * self.cell - p[on]) * inverse[on]
            axis = walls.argmin(1)
            end = np.maximum(np.take_along_axis(walls, axis[:, None], 1)[:, 0], t)
            number = self._number(cell)
            self._cross(left, on, number, t, end, p, w, strand, triangle, bias)
            cell[np.arange(len(on)), axis] += step[on, axis]
            at = np.take_along_axis(cell, axis[:, None], 1)[:, 0]
            goes = (at >= 0) & (at < self.n[axis]) & (left[on] > np.log(LEAST))
            on, t, cell = on[goes], end[goes], cell[goes]
        return np.where(left > np.log(LEAST), np.exp(left), 0.0)

    def _cross(self, left, on, number, t, end, p, w, strand, triangle, bias):
        """Take from the logarithm of light what rays meet in their cells, from t to end."""
        for ray, thing in _pairs(self.segments, number):
            k = on[ray]
            a, d = self.a[thing, :3] - p[k], self.d[thing, :3]
            dw, aw, ad, dd = dot(d, w[k]), dot(a, w[k]), dot(a, d), dot(d, d)
            across = dd - dw * dw
            with np.errstate(invalid="ignore", divide="ignore"):
                s = (dw * aw - ad) / across
                at = aw + s * dw
                off = a + s[:, None] * d - at[:, None] * w[k]
                met = dot(off, off) < ((self.a[thing, 3] + s * self.d[thing, 3]) / 2) ** 2
            met &= (s >= 0) & (s < 1) & (at >= t[ray]) & (at < end[ray]) & (at > 0) & (across > 1e-24 * dd)
            met &= self.owner[thing] != strand[k]
            np.add.at(left, k[met], self.depth[thing[met]])
        for ray, thing in _pairs(self.triangles, number):
            k = on[ray]
            corners, edges = self.corners[thing] - p[k, None], self.edges[thing]
            sides = np.stack([dot(np.cross(corners[:, i], corners[:, (i + 1) % 3]), w[k]) for i in range(3)])
            normal = np.cross(edges[:, 0], edges[:, 1])
            with np.errstate(invalid="ignore", divide="ignore"):
                at = dot(corners[:, 0], normal) / dot(normal, w[k])
            met = ((sides >= 0).all(0) | (sides <= 0).all(0)) & (at > bias) & (thing != triangle[k])
            left[k[met]] = -np.inf

    def _of_segments(self, a, b, radius):
        """Boxes of a few pieces of each segment, by cells: see `_listed`."""
        length = np.abs(b - a)[:, :3].max(1, initial=0) / self.cell
        pieces = np.ceil(2 * length).astype(int).clip(1, 64)
        thing, k = runs(pieces)
        one, two = (a[thing, :3] + (share / pieces[thing])[:, None] * (b - a)[thing, :3] for share in (k, k + 1))
        thing, at = self._touched(thing, np.minimum(one, two) - radius[thing], np.maximum(one, two) + radius[thing])
        return self._listed(thing, at, len(a))

    def _of_triangles(self):
        """Triangles where their planes pass through cells of their boxes."""
        normal = np.cross(self.edges[:, 0], self.edges[:, 1])
        thing, at = self._touched(np.arange(len(normal)), self.corners.min(1), self.corners.max(1))
        middle = self.low + (at + 0.5) * self.cell - self.corners[thing, 0]
        near = np.abs(dot(middle, normal[thing])) <= 0.5001 * self.cell * np.abs(normal).sum(1)[thing]
        return self._listed(thing[near], at[near], len(normal))

    def _touched(self, thing, low, high):
        """(things, cells [n, 3]) of boxes of things."""
        slack = 1e-6 * self.cell
        low, high = (np.clip(np.floor((each - self.low) / self.cell).astype(int), 0, self.n - 1)
                     for each in (low - slack, high + slack))
        x, y, z = (high - low + 1).T
        which, k = runs(x * y * z)
        return thing[which], low[which] + np.stack([k % x[which], k // x[which] % y[which], k // (x * y)[which]], 1)

    def _listed(self, thing, at, count):
        """(things by cells, where each cell's begin), each once."""
        keys = np.unique(self._number(at).astype(np.int64) * max(count, 1) + thing)
        number, thing = np.divmod(keys, max(count, 1))
        return thing, np.concatenate([[0], np.cumsum(np.bincount(number, minlength=int(self.n.prod())))])

    def _number(self, at):
        return (at[:, 2] * self.n[1] + at[:, 1]) * self.n[0] + at[:, 0]


def runs(counts):
    """Numbers 0 to before a count, for each: (which [n], number [n])."""
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)


def _pairs(listed, cells):
    """Yield (rays, things) of rays in cells, some at a time."""
    things, starts = listed
    begin = starts[cells]
    counts = starts[cells + 1] - begin
    some = np.flatnonzero(counts)
    sums = np.cumsum(counts[some])
    at = 0
    while at < len(some):
        done = sums[at - 1] if at else 0
        end = max(int(np.searchsorted(sums, done + PAIRS, "right")), at + 1)
        which, k = runs(counts[some[at:end]])
        ray = some[at:end][which]
        yield ray, things[begin[ray] + k]
        at = end


def dot(a, b):
    """Scalar products of vectors [n, 3]."""
    return np.einsum("ni,ni->n", a, b)
