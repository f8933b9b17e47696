"""guides in float64 NumPy: strands between guides, each found among all and bent by angles."""

import math

import numpy as np

from .strands import offsets, random3, sides_of, signed, unit_or


def feet(places, positions, faces):
    """Where a mesh is nearest to places [N, 3]: (distances [N], face [N], weights of its corners [N, 3])."""
    a, b, c = (np.asarray(positions, float)[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    best = np.full(len(places), np.inf), np.zeros(len(places), int), np.zeros((len(places), 3))
    for i, p in enumerate(np.asarray(places, float)):
        # Areas that the place makes with the sides, seen along the normal; below 0, the nearest is on a side.
        parts = np.stack([(np.cross(q - p, r - p) * normal).sum(1) for q, r in ((b, c), (c, a), (a, b))], 1)
        weights = [parts / (normal * normal).sum(1)[:, None]]
        inside = (parts >= 0).all(1)
        for k, (q, r) in enumerate(((a, b), (b, c), (c, a))):
            t = np.clip(((p - q) * (r - q)).sum(1) / ((r - q)**2).sum(1), 0, 1)
            on_side = np.zeros((len(faces), 3))
            on_side[:, k], on_side[:, (k + 1) % 3] = 1 - t, t
            weights.append(on_side)
        away = [np.linalg.norm(np.einsum("fc,fcx->fx", w, np.stack([a, b, c], 1)) - p, axis=1) for w in weights]
        away[0][~inside] = np.inf
        way, face = np.unravel_index(np.argmin(away), (4, len(faces)))
        best[0][i], best[1][i], best[2][i] = away[way][face], face, weights[way][face]
    return best


def normals_at(face, weights, positions, normals, faces):
    """Unit normals [N, 3] of a mesh at what `feet` gives."""
    mean = np.einsum("nc,ncx->nx", weights, np.asarray(normals, float)[faces[face]])
    corners = np.asarray(positions, float)[faces[face]]
    side = unit_or(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), (0, 1, 0))
    return unit_or(mean, side)


def nearest(root, up, allowed, places, normals, n):
    """The n guides nearest to each root: (distances [N, n], numbers [N, n]), inf and -1 where there are no more.

    root, up: [N, 3].  places, normals: [G, 3] of guides.  allowed: [N, G] whether a strand may follow one.
    """
    angle = np.arccos(np.clip(up @ normals.T, -1, 1))
    further = 1 / np.maximum(np.cos(angle / 2), 1 / 8)   # 8: half of 1 / 32 by the half angle's formula, its root
    away = np.linalg.norm(root[:, None] - places, axis=2) * further
    away[~allowed] = np.inf
    order = np.argsort(away, axis=1, kind="stable")[:, :n]
    found = np.take_along_axis(away, order, 1)
    number = np.where(np.isfinite(found), order, -1)
    pad = ((0, 0), (0, n - order.shape[1]))
    return np.pad(found, pad, constant_values=np.inf), np.pad(number, pad, constant_values=-1)


def turned(vectors, start, end):
    """Vectors [M, 3] turned as ``start`` is to become ``end``, unit vectors, about what is across both (Rodrigues)."""
    axis, cosine = np.cross(start, end), float(start @ end)
    size = np.linalg.norm(axis)
    if size < 1e-12:
        return vectors * math.copysign(1, cosine)
    axis, angle = axis / size, math.atan2(size, cosine)
    return (vectors * math.cos(angle) + np.cross(axis, vectors) * math.sin(angle)
            + np.outer(vectors @ axis, axis) * (1 - math.cos(angle)))


def at_shares(points, shares):
    """Places [S, 3] of a polyline [P, 3] at shares of its length, from its first point."""
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    way = way / way[-1] if way[-1] else np.linspace(0, 1, len(way))
    return np.stack([np.interp(shares, way, x) for x in (points - points[0]).T], 1)


def between(
    root,               # [N, 3]
    frame,              # [N, 3, 3] of the skin, see `strands.frames`
    kind,               # [N] types of the strands
    types,              # objects with the fields of HairType
    guides,             # [G] arrays [P, 3]
    normals,            # [G, 3] of the skin where they stand
    guide_kind=None,    # [G] their types, or None
    blended=3,
    parting=60.0,
    seed=0,
    traits=None,        # what maps make of the strands: scale [N, 4], as layout.Traits has it
    reach=None,         # how many times `room` the nearest guide may be away
):
    """Points [N, S, 3] of strands between guides; where a strand has fewer, or none stands, NaN."""
    n, numbers = len(root), np.arange(len(root))
    vary, lean, turn = (signed(random3(numbers, seed, use)) for use in (1, 3, 2))
    segments = np.array([t.segments for t in types])[kind]
    points = np.full((n, max(t.segments for t in types) + 1, 3), math.nan)
    allowed = np.ones((n, len(guides)), bool)
    if guide_kind is not None:
        allowed = kind[:, None] == np.asarray(guide_kind)
        allowed[~allowed.any(1)] = True
    places = np.array([g[0] for g in guides])
    away, number = nearest(root, frame[:, 2], allowed, places, normals, blended + 1)
    stands = segments > 0 if traits is None else (segments > 0) & (traits["scale"][:, 0] > 0)
    if reach is not None:
        stands &= away[:, 0] <= reach * room(places, normals, guide_kind)[number[:, 0]]
    for i in np.flatnonzero(stands):
        t = types[kind[i]]
        up = unit_or(frame[i, 2] + t.direction_variation * lean[i] @ frame[i], frame[i, 2])
        some = number[i, :blended][number[i, :blended] >= 0]
        length = (1 + t.length_variation * vary[i, 1]) / (1 + t.length_variation)
        length *= 1 if traits is None else min(float(traits["scale"][i, 0]), 1)
        shares = length * np.arange(segments[i] + 1) / segments[i]
        shapes = [turned(at_shares(guides[g], shares), normals[g], up) for g in some]
        ways = [turned(at_shares(guides[g], (.25, .5, 1)), normals[g], up) for g in some]
        weight = weights(away[i, :len(some)], away[i, blended]) * [together(ways[0], way, parting) for way in ways]
        axis = np.einsum("g,gsx->sx", weight, shapes) / weight.sum() + root[i]
        k = np.arange(segments[i] + 1)
        ahead = unit_or(axis[np.minimum(k + 1, segments[i])] - axis[np.maximum(k - 1, 0)], frame[i, 2])[None]
        side = unit_or(np.cross(ahead[:, 0], turn[[i]] @ frame[i]), frame[i, 2])
        bent = 1 if traits is None else float(traits["scale"][i, 3])
        bent = 0 if t.tufts is not None else bent   # which curl as a whole
        aside = offsets(ahead[:, 1:], sides_of(ahead, side)[:, 1:], t.curl, t.wave)[0]
        points[i, :segments[i] + 1] = axis + bent * aside
    return points


def room(places, normals, kind):
    """How far the seventh guide of its own type is from each [G], as `nearest` has it."""
    same = np.ones((len(places), len(places)), bool) if kind is None else np.equal.outer(kind, kind)
    return nearest(places, normals, same, places, normals, 8)[0][:, 7]


def weights(away, edge):
    """Weights of guides so far away [K], of which that at ``edge`` would have none: Franke and Little's (1980)."""
    if away[0] == 0:
        return (away == 0).astype(float)
    weight = 1 / away if not np.isfinite(edge) else (edge - away) / (edge * away)
    return weight**2 if weight.any() else np.ones(len(away))


def together(one, other, parting):
    """Whether chords [K, 3] of two guides are within ``parting`` degrees of each other; those without a length are."""
    a, b = unit_or(one, (0, 0, 0)), unit_or(other, (0, 0, 0))
    angles = np.degrees(np.arccos(np.clip((a * b).sum(1), -1, 1)))
    return bool((angles[(a != 0).any(1) & (b != 0).any(1)] <= parting).all())
