"""Rays that each have a place and a direction of their own, in float64: through a scene's strands and body."""

import numpy as np

EACH, MOST = 4.0, 2**22      # cells for one segment or triangle; cells at most
PAIRS = 1 << 19              # of a ray and a thing that are looked at together
FAR = 8                      # cells around that are known to be empty, at most
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
        self.around = self._empty_around()

    def light_left(self, p, w, strand, triangle, bias):
        """Share [n] of light that comes from direction w [n, 3] far away to places p [n, 3].

        Each lies on a strand [n] or a triangle [n] (-1: none) that does not count.  ``bias``: nothing nearer counts.
        """
        left = np.zeros(len(p))

        def visit(on, cell, start, end):
            for ray, thing in _pairs(self.segments, cell):
                k = on[ray]
                met, at = self._meets_segment(p, w, k, thing)
                met &= (at >= start[ray]) & (at < end[ray]) & (self.owner[thing] != strand[k])
                np.add.at(left, k[met], self.depth[thing[met]])
            for ray, thing in _pairs(self.triangles, cell):
                k = on[ray]
                met, at = self._meets_triangle(p, w, k, thing)
                left[k[met & (at > bias) & (thing != triangle[k])]] = -np.inf
            return left[on] > np.log(LEAST)
        self._walk(p, w, visit)
        return np.where(left > np.log(LEAST), np.exp(left), 0.0)

    def nearest(self, p, w, strand, triangle, bias, random):
        """What rays from places p [n, 3] in directions w [n, 3] meet first -> (distances [n], infinite where nothing is
        met; segments [n] and triangles [n] that are met, or -1).

        For ``strand``, ``triangle`` and ``bias`` see `light_left`.  A strand lets a ray through as often as it lets
        light through, by ``random``, a generator.
        """
        distance = np.full(len(p), np.inf)
        segment, face = np.full(len(p), -1), np.full(len(p), -1)
        alpha = np.exp(self.depth)

        def keep(k, at, thing, its, other):
            """Take things that are nearer than what was met."""
            np.minimum.at(distance, k, at)
            first = at == distance[k]
            its[k[first]], other[k[first]] = thing[first], -1

        def visit(on, cell, start, end):
            for ray, thing in _pairs(self.segments, cell):
                k = on[ray]
                met, at = self._meets_segment(p, w, k, thing)
                met &= (at >= start[ray]) & (at < end[ray]) & (self.owner[thing] != strand[k])
                met = np.flatnonzero(met)
                met = met[random.random(len(met)) >= alpha[thing[met]]]
                keep(k[met], at[met], thing[met], segment, face)
            for ray, thing in _pairs(self.triangles, cell):
                k = on[ray]
                met, at = self._meets_triangle(p, w, k, thing)
                met &= (at > bias) & (at < end[ray]) & (thing != triangle[k])
                keep(k[met], at[met], thing[met], face, segment)
            return distance[on] == np.inf
        self._walk(p, w, visit)
        return distance, segment, face

    def _walk(self, p, w, visit):
        """Take rays through their cells: visit(rays [m], their cells' numbers, distances from, to) -> which go on."""
        w = np.where(np.abs(w) > 1e-12, w, np.copysign(1e-12, w))
        faces = (np.stack([self.low, self.low + self.cell * self.n])[:, None] - p) / w
        t, out = np.maximum(faces.min(0).max(1), 0), faces.max(0).min(1)
        on = np.flatnonzero(t <= out)
        t, ahead = t[on], w[on] >= 0
        start, inverse = (p[on] - self.low) / self.cell, self.cell / w[on]   # in cells
        cell = np.clip(np.floor(start + (t[:, None] / inverse)), 0, self.n - 1).astype(int)
        while len(on):
            number = self._number(cell)
            around = self.around[number]
            walls = (cell + np.where(ahead, 1 + around[:, None], -around[:, None]) - start) * inverse
            axis = walls.argmin(1)
            end = np.maximum(walls.min(1), t)
            goes = visit(on, number, t, end)
            some = np.flatnonzero(around)
            if len(some):   # all of the others stay in their column
                box, far = cell[some], around[some, None]
                cell[some] = np.clip(np.floor(start[some] + end[some, None] / inverse[some]), box - far, box + far)
                its = np.arange(len(some)), axis[some]
                cell[some, axis[some]] = box[its] + np.where(ahead[some][its], far[:, 0], -far[:, 0])
            rays = np.arange(len(on))
            cell[rays, axis] += np.where(ahead[rays, axis], 1, -1)
            goes = np.flatnonzero(goes & ((cell >= 0) & (cell < self.n)).all(1))
            on, t, cell, start, inverse, ahead = (each[goes] for each in (on, end, cell, start, inverse, ahead))

    def _meets_segment(self, p, w, k, thing):
        """Whether rays k meet segments, and how far ahead -> ([m], [m])."""
        a, d, way = self.a[thing, :3] - p[k], self.d[thing, :3], w[k]
        dw, aw, ad, dd = dot(d, way), dot(a, way), dot(a, d), dot(d, d)
        across = dd - dw * dw
        with np.errstate(invalid="ignore", divide="ignore"):
            s = (dw * aw - ad) / across
            at = aw + s * dw
            off = a + s[:, None] * d - at[:, None] * way
            met = dot(off, off) < ((self.a[thing, 3] + s * self.d[thing, 3]) / 2) ** 2
        return met & (s >= 0) & (s < 1) & (at > 0) & (across > 1e-24 * dd), at

    def _meets_triangle(self, p, w, k, thing):
        """Whether rays k meet triangles, and how far ahead -> ([m], [m])."""
        corners, edges = self.corners[thing] - p[k, None], self.edges[thing]
        sides = np.stack([dot(np.cross(corners[:, i], corners[:, (i + 1) % 3]), w[k]) for i in range(3)])
        normal = np.cross(edges[:, 0], edges[:, 1])
        with np.errstate(invalid="ignore", divide="ignore"):
            at = dot(corners[:, 0], normal) / dot(normal, w[k])
        return (sides >= 0).all(0) | (sides <= 0).all(0), at

    def _empty_around(self):
        """How many cells each [cells] may be left by, on all sides, through cells in which nothing is."""
        there = (np.diff(self.segments[1]) + np.diff(self.triangles[1]) > 0).reshape(self.n[::-1])
        around = np.zeros(there.shape, np.int64)
        for distance in range(FAR):
            around[~there] = distance
            if there.all():
                break
            for axis in range(3):
                low, high = ([slice(None)] * axis + [each] for each in (slice(None, -1), slice(1, None)))
                grown = there.copy()
                grown[tuple(low)] |= there[tuple(high)]
                grown[tuple(high)] |= there[tuple(low)]
                there = grown
        return around.ravel()

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
