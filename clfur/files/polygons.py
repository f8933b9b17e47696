"""Polygons -> triangles: fans where a fan is right, ears cut in the polygon's own plane where it is not."""

import numpy as np

from ..errors import Error

MOST_CORNERS = 2**13   # of a polygon that is no fan: to cut its ears can take the square of them, 15 s for so many
BLOCK = 2**16          # triangles that are looked at together, so that this takes little memory beside the file's


def triangulate(positions: np.ndarray, corners: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles of polygons as numbers of corners, int64 [F, 3], and each one's polygon, int64 [F].

    positions: [V, 3], not finite where there are none. corners: whole numbers [C] into positions, polygon after
    polygon. sizes: whole numbers [P], how many of the corners each polygon has. Triangles come polygon by polygon.
    A polygon is a fan around its first corner if, seen along its normal (Newell's), every triangle of that has an
    area and the same side up; a quad may be a fan around its second corner; of others ears are cut, in the
    projection along the normal. A hole is part of an outline, joined to it by a bridge of two sides at one place.
    What has no inside stays a fan: polygons without area, quads that cross themselves. Less than three corners
    give one triangle without area. Raises Error for a polygon that is no fan and has more than MOST_CORNERS corners.
    """
    sizes = np.asarray(sizes, np.int64) if len(corners) else np.zeros(0, np.int64)
    starts = np.cumsum(sizes) - sizes
    triangles, owner = _fans(starts, sizes, len(corners))
    with np.errstate(all="ignore"):   # what is not finite, or overflows, stays a fan
        wrong, normals = _folded(positions, corners, sizes, triangles, owner)
        quads = wrong[sizes[wrong] == 4]
        turned = starts[quads, None, None] + np.array([[1, 2, 3], [1, 3, 0]])   # [Q, 2, 3]
        right = (_signed(positions[corners[turned]], normals[quads, None])[0] > 0).all(axis=1)
        at = np.searchsorted(owner, quads[right])
        triangles[at], triangles[at + 1] = turned[right, 0], turned[right, 1]
        cut: dict[int, np.ndarray] = {}
        for k in wrong[sizes[wrong] > 4].tolist():
            if sizes[k] > MOST_CORNERS:
                raise Error(f"a face that is not convex has {sizes[k]} corners; allowed: at most {MOST_CORNERS}")
            ears = _ears(positions[corners[starts[k]:starts[k] + sizes[k]]], normals[k])
            cut |= {k: ears + starts[k]} if len(ears) else {}
    if cut:
        kept = ~np.isin(owner, list(cut))
        owner = np.concatenate([owner[kept], *(np.full(len(ears), k) for k, ears in cut.items())])
        triangles = np.concatenate([triangles[kept], *cut.values()])
        order = np.argsort(owner, kind="stable")
        triangles, owner = triangles[order], owner[order]
    _cut_alike(_places(positions)[corners], starts, sizes, triangles, owner)
    return triangles, owner


def _places(positions):
    """Return a number for each place of positions [V, 3], uint64 [V]: equal ones have the same, others hardly ever."""
    x, y, z = np.ascontiguousarray(positions + 0.0, np.float64).view(np.uint64).T   # + 0 turns -0.0 into 0.0
    return _mixed(_mixed(_mixed(x) + y) + z)


def _mixed(bits):
    """Return numbers uint64 in which each bit depends on all of these: floats often differ in a few alone."""
    bits = (bits ^ (bits >> np.uint64(32))) * np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
    return bits ^ (bits >> np.uint64(32))


def _cut_alike(places, starts, sizes, triangles, owner):
    """Give polygons that go round the places [C] of an earlier one, either way, the triangles of that one, in place.

    Else the two sides of a two-sided quad could be cut along different diagonals, and Mesh would not know them.
    """
    large = np.flatnonzero(sizes > 3)
    sums = np.append(np.uint64(0), np.cumsum(places))   # those of a polygon add up to the same in any order
    key = sums[starts[large] + sizes[large]] - sums[starts[large]]
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    model = first[group.reshape(-1)]
    later = np.flatnonzero((model != np.arange(len(large))) & (sizes[large[model]] == sizes[large]))
    ones, others = large[model[later]], large[later]
    begin, count = np.searchsorted(owner, np.stack([ones, others])), np.bincount(owner, minlength=len(sizes))
    for n in np.unique(sizes[others]).tolist():
        some = (sizes[others] == n) & (count[ones] == n - 2) & (count[others] == n - 2)
        one, other = (starts[each[some], None] + np.arange(n) for each in (ones, others))
        at = (places[other] == places[one[:, :1]]).argmax(axis=1)[:, None]
        once = (np.diff(np.sort(places[one], axis=1)) != 0).all(axis=1)
        for way, turn in ((1, [0, 1, 2]), (-1, [0, 2, 1])):
            same = np.take_along_axis(other, (at + way * np.arange(n)) % n, 1)   # the other's corners as the one's go
            good = once & (places[same] == places[one]).all(axis=1)
            theirs, own = (each[some][good, None] + np.arange(n - 2) for each in begin)
            local = triangles[theirs] - one[good, :1, None]
            found = np.take_along_axis(same[good], local.reshape(-1, 3 * (n - 2)), 1)
            triangles[own] = found.reshape(-1, n - 2, 3)[..., turn]


def by_size(triangles: np.ndarray, owner: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what `triangulate` does in another order: faces of three corners, halves of quads, then polygons.

    First halves of quads come before second ones, which are 2 3 0 in place of 0 2 3: as the library that read PLY and
    OFF files before had them, so that strands keep their numbers.
    """
    sizes = np.asarray(sizes, np.int64)[owner]   # of each one's polygon
    second = (sizes == 4) & np.append(False, owner[1:] == owner[:-1])
    fan = second & (triangles[:, 2] - triangles[:, 0] == 3)
    triangles = np.where(fan[:, None], np.roll(triangles, -1, axis=1), triangles)
    group = np.select([sizes <= 3, (sizes == 4) & ~second, second], [0, 1, 2], 3)
    order = np.argsort(group, kind="stable")
    return triangles[order], owner[order]


def _fans(starts, sizes, count):
    """Return the corners int64 [F, 3] of all polygons' fans around their first corner, and the polygons int64 [F]."""
    many = np.maximum(sizes - 2, 1)
    owner = np.repeat(np.arange(len(sizes)), many)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(many) - many, many)
    first = np.minimum(starts[owner], count - 1)   # a face of no corners takes one of the next's
    last = np.maximum(starts[owner] + sizes[owner] - 1, first)
    return np.stack([first, np.minimum(first + step + 1, last), np.minimum(first + step + 2, last)], axis=1), owner


def _folded(positions, corners, sizes, triangles, owner):
    """Return the polygons whose fan is wrong, int64 [n], and all normals, float64 [P, 3], as long as twice the area."""
    normals, both, back = np.zeros((len(sizes), 3)), np.zeros(len(sizes)), np.zeros(len(sizes))
    wrong = np.zeros(len(sizes), bool)
    large = np.flatnonzero(sizes[owner] > 3)
    blocks = [large[at:at + BLOCK] for at in range(0, len(large), BLOCK)]
    for block in blocks:
        points = positions[corners[triangles[block]]]
        crosses = _cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        first, last = owner[block[0]], owner[block[-1]] + 1
        for k in range(3):
            normals[first:last, k] += np.bincount(owner[block] - first, crosses[k])
        both[first:last] += np.bincount(owner[block] - first, _length(*crosses))
    area = _length(*normals.T)
    for block in blocks:
        points = positions[corners[triangles[block]]]
        margin, signed = _signed(points, normals[owner[block]])
        thin = np.flatnonzero(~(margin > 0))
        alike = (points[thin] == np.roll(points[thin], 1, axis=1)).all(axis=2).any(axis=1)
        wrong[owner[block[thin[~alike]]]] = True   # but a corner given twice is no fold
        first, last = owner[block[0]], owner[block[-1]] + 1
        back[first:last] += np.bincount(owner[block] - first, np.maximum(-signed, 0))
    wrong &= np.isfinite(area) & (area > 1e-9 * both)
    wrong &= (sizes <= MOST_CORNERS) | (back > 1e-4 * area)   # rounded circles of a million corners have dents
    return np.flatnonzero(wrong), normals


def _signed(points, normals):
    """Return, of triangles [..., 3, 3], by how much their twice area along normals exceeds nothing, and the area."""
    a, b, c = (points[..., k, :] for k in range(3))
    crosses, unit = _cross(b - a, c - a), normals / _length(*np.moveaxis(normals, -1, 0))[..., None]
    area = sum(crosses[k] * unit[..., k] for k in range(3))
    longest = np.maximum(np.maximum(_squares(b - a), _squares(c - b)), _squares(a - c))
    return area - 2e-12 * longest, area   # the margin by which Mesh tells faces without area


def _squares(vectors):
    return np.einsum("...k,...k->...", vectors, vectors)


def _length(x, y, z):
    return np.sqrt(x * x + y * y + z * z)


def _cross(a, b):
    """Return the three components of cross products of vectors [..., 3]: NumPy's own takes three times as long."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def _ears(points, normal):
    """Return the triangles [F, 3] that mapbox's earcut finds in a polygon of points [n, 3], seen along its normal."""
    import mapbox_earcut  # here, since few files have such polygons

    normal = normal / _length(*normal)
    points = points - points[0]
    points = points - (points @ normal)[:, None] * normal
    axis = int(np.abs(normal).argmax())   # to leave this one out keeps others exact, where a turn would round them
    flat = points[:, [(axis + 1) % 3, (axis + 2) % 3]] * [[np.sign(normal[axis]), 1]]
    ears = mapbox_earcut.triangulate_float64(np.ascontiguousarray(flat), np.array([len(flat)], np.uint32))
    return _with_all(ears.reshape(-1, 3).astype(np.int64), flat)


def _with_all(ears, flat):
    """Return the ears with the corners that they pass by put into the sides that these are on.

    Earcut may leave a corner on a straight side out; the neighbour that has it too would part from this face.
    """
    if len(ears) == len(flat) - 2:   # then all are there
        return ears
    for corner in np.setdiff1d(np.arange(len(flat)), ears).tolist():
        if not len(ears) or (flat[np.unique(ears)] == flat[corner]).all(axis=1).any():
            continue   # a corner given twice
        begin, end = flat[ears], flat[np.roll(ears, -1, axis=1)]   # [F, 3, 2]: each side's two ends
        side, there = end - begin, flat[corner] - begin
        length = (side**2).sum(axis=2)
        along = (side * there).sum(axis=2) / length
        aside = np.abs(side[..., 0] * there[..., 1] - side[..., 1] * there[..., 0]) / length
        aside = np.where((along > 0) & (along < 1), aside, np.inf)
        face, k = np.unravel_index(aside.argmin(), aside.shape)
        if aside[face, k] < 1e-9:
            a, b, c = np.roll(ears[face], -k)
            ears[face] = a, corner, c
            ears = np.append(ears, [[corner, b, c]], axis=0)
    return ears
