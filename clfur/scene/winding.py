"""Which way a mesh's faces are wound: what is doubled, inside out, or at odds with its neighbours.

Faces are given by welded vertices: what stands at one place has one number.
"""

import numpy as np

LARGEST = 256   # so many closed surfaces are looked into for others
STRIPS = 1024   # into which the faces of one are sorted at most
FLAT = 1e-9   # times the area to the power 3/2: a volume that is nothing but rounding errors
# A turn by no round angle, so that no ray along the first axis meets an edge.
_TURN = np.linalg.qr(np.array([[0.31, 0.74, -0.52], [-0.83, 0.42, 0.17], [0.29, 0.61, 0.69]]))[0]


def groups_of(faces, vertices):
    """Return, for each of faces [n, 3], the first one that has the same three vertices: int64 [n]."""
    rows = np.sort(faces, axis=1)
    if vertices <= 1 << 21:   # then one number tells all three
        key = (rows[:, 0] * vertices + rows[:, 1]) * vertices + rows[:, 2]
    else:
        _, key = np.unique(rows, axis=0, return_inverse=True)
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    return first[group.reshape(-1)]


def parity_of(faces):
    """Return, for each of faces [n, 3], whether its vertices go round in an odd order: bool [n]."""
    a, b, c = faces.T
    return (a > b) ^ (b > c) ^ (a > c)


def components(n, a, b):
    """Return the smallest number that each of n things is joined with, by pairs a [m], b [m]: int64 [n]."""
    root = np.arange(n)
    while len(a):
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))   # the least of several: a star is joined in two rounds
        while not np.array_equal(further := root[root], root):
            root = further
        a, b = root[a], root[b]
        apart = a != b
        a, b = a[apart], b[apart]
    return root


class Surfaces:
    """Faces that hang together by edges of two faces each, and which side of each of them is outside.

    sign: float64 [faces], 1, or -1 of those that are wound against the outside. turned: bool [faces], those of these of
    which no given normal told it. one_sided: bool [faces], of surfaces such as Möbius' strip, which have no sides.
    """

    def __init__(self, positions, faces, normals, agreement):
        """positions: [V, 3]. faces: [n, 3] welded. normals: float64 [n, 3], of length twice the area.
        agreement: [n] how much a face's winding agrees with normals that were given, by area; 0 without any."""
        self.faces, self.normals, self.corner = faces, normals, positions[faces[:, 0]].astype(np.float64)
        self.area = np.sqrt((normals**2).sum(axis=1)) / 2
        self._join(len(positions))
        told = self._sum(self.sign * agreement)
        more = np.where(told != 0, told, self._sum(self.sign * self.area)) < 0   # else most of it is right
        self.sign[more[self.surface]] *= -1
        inside_out = self._inside_out(positions, told == 0)
        self.sign[inside_out[self.surface]] *= -1
        self.turned = (self.sign < 0) & (told == 0)[self.surface]

    def _join(self, vertices):
        """Number the surfaces, wind each as its first face is, and find those that are closed."""
        n, begin, end = len(self.faces), self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        rises, key = begin < end, np.minimum(begin, end) * vertices + np.maximum(begin, end)
        order = np.argsort(key, kind="stable")
        first = np.flatnonzero(np.append(True, np.diff(key[order]) != 0))
        count = np.diff(np.append(first, len(order)))
        one, other = (order[first[count == 2] + k] for k in range(2))
        against = rises[one] == rises[other]
        a, b = one // 3, other // 3
        self.sign, self.one_sided = np.ones(n), np.zeros(n, bool)
        if against.any():   # each face twice, as it is and turned: a neighbour joins the one that it goes on from
            both = components(2 * n, np.append(a, a + n), np.append(b + n * against, b + n * ~against))
            root = np.minimum(both[:n], both[n:])
            self.one_sided = both[:n] == both[n:]
            self.sign[(both[:n] > both[n:]) & ~self.one_sided] = -1
        else:
            root = components(n, a, b)
        self.roots, self.surface = np.unique(root, return_inverse=True)
        # Closed: along each edge its faces go up as often as down.
        edge = np.repeat(np.arange(len(first)), count)
        odd = np.isin(edge, np.flatnonzero(count != 2)) | self.one_sided[order // 3]
        face = order[odd] // 3
        way = np.where(rises[order[odd]], 1, -1) * self.sign[face]
        pairs, place = np.unique(edge[odd] * len(self.roots) + self.surface[face], return_inverse=True)
        open_ = pairs[np.bincount(place.reshape(-1), way, len(pairs)) != 0] % len(self.roots)
        self.closed = np.ones(len(self.roots), bool)
        self.closed[open_] = self.closed[self.surface[self.one_sided]] = False

    def _sum(self, values):
        return np.bincount(self.surface, values, len(self.roots))

    def _inside_out(self, positions, unknown):
        """Which surfaces are closed around a negative volume, and with them what is within.

        What lies within another may be the wall of a hollow: it is turned if, and only if, that is.
        """
        reach = self.corner - self.corner[self.roots][self.surface]   # from a place of its own: nothing cancels
        volume = self._sum(self.sign * (reach * self.normals).sum(axis=1)) / 6
        negative = self.closed & unknown & (volume < -FLAT * self._sum(self.area) ** 1.5)
        if not negative.any():
            return negative
        nested = Nested(positions, self)
        turned = negative & ~nested.within(np.ones_like(negative), negative)
        return turned | nested.within(turned, self.closed & unknown & ~turned)


class Nested:
    """Which surfaces lie within closed ones."""

    def __init__(self, positions, surfaces):
        self.surfaces, n = surfaces, len(surfaces.roots)
        self.corners = (positions.astype(np.float64) @ _TURN)[surfaces.faces]
        self.order = np.argsort(surfaces.surface, kind="stable")
        self.starts = np.searchsorted(surfaces.surface[self.order], np.arange(n + 1))
        self.low = np.minimum.reduceat(self.corners.min(axis=1)[self.order], self.starts[:-1])
        self.high = np.maximum.reduceat(self.corners.max(axis=1)[self.order], self.starts[:-1])
        size = np.where(surfaces.closed, (self.high - self.low).sum(axis=1), 0)
        large = np.argsort(-size, kind="stable")[:LARGEST]
        self.large = large[surfaces.closed[large]]

    def within(self, around, asked):
        """Which of the surfaces asked for lie within one of those around: bool [surfaces] each."""
        found = np.zeros_like(asked)
        for k in self.large[around[self.large]]:
            inside = asked & ~found & (self.low > self.low[k]).all(axis=1) & (self.high < self.high[k]).all(axis=1)
            there = np.flatnonzero(inside)
            if len(there):
                places = self.corners[self.surfaces.roots[there], 0]
                found[there] = _within(self.corners[self.order[self.starts[k]:self.starts[k + 1]]], places)
        return found


def _within(corners, places):
    """Whether a ray along the first axis from each place [n, 3] meets faces [m, 3, 3] an odd number of times."""
    low, high = corners[:, :, 2].min(axis=1), corners[:, :, 2].max(axis=1)
    # Faces by strips of the last axis, about as high as a face.
    bottom, height = low.min(), max((high - low).mean(), (high.max() - low.min()) / STRIPS)
    first, last = (((each - bottom) / height).astype(np.int64) for each in (low, high))
    count = last - first + 1
    face = np.repeat(np.arange(len(corners)), count)
    strip = np.repeat(first - np.cumsum(count) + count, count) + np.arange(len(face))
    face, starts = face[np.argsort(strip, kind="stable")], np.searchsorted(np.sort(strip), np.arange(last.max() + 2))
    odd = np.zeros(len(places), bool)
    for n, (p, row) in enumerate(zip(places, ((places[:, 2] - bottom) / height).astype(np.int64))):
        a, b, c = np.moveaxis(corners[face[starts[row]:starts[row + 1]]] - p, 1, 0)
        u, v, w = (x[:, 1] * y[:, 2] - x[:, 2] * y[:, 1] for x, y in ((b, c), (c, a), (a, b)))
        along = (u * a[:, 0] + v * b[:, 0] + w * c[:, 0]) * (u + v + w)
        odd[n] = np.count_nonzero(((u > 0) == (v > 0)) & ((v > 0) == (w > 0)) & (along > 0)) % 2
    return odd
