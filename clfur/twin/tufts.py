"""tufts in float64 NumPy: places on faces, the nearest of them, strands that gather, curl together and are frizzy."""

import math

import numpy as np

from .strands import random3, signed, turned_sides, unit_or
from .tessellate import flat_triangle, pn_triangle

NONE = 2**32 - 1   # the tuft of strands that have none


def stand(
    corners,    # [n, 3, 3]
    normals,    # [n, 3, 3] of these
    weights,    # [n, 3] of the corners
    curved,     # PN triangles, or flat ones
):
    """Places and unit normals [n, 3] on faces."""
    on = pn_triangle if curved else flat_triangle
    there = [on(*(np.asarray(a, float)[i:i + 1] for a in (corners, normals, weights))) for i in range(len(corners))]
    return tuple(np.array([each[which][0, 0] for each in there]).reshape(-1, 3) for which in (0, 1))


def nearest(root, normal, middles, middle_normals, sizes, spacing):
    """The middle that is nearest to each root [N], as skin that looks another way is further and a large tuft nearer:
    (its number, NONE where there are none; how near it and the next are, [N, 2])."""
    if not len(middles):
        return np.full(len(root), NONE), np.zeros((len(root), 2))
    apart = ((np.asarray(root)[:, None] - middles) ** 2).sum(2)
    away = (apart + spacing**2 * (1 - np.asarray(normal) @ np.asarray(middle_normals).T)) / np.asarray(sizes) ** 2
    two = np.sort(np.column_stack([away, np.full(len(root), math.inf)]), 1)[:, :2]
    return away.argmin(1), two


def at_length(line, length):
    """Places [n, 3] so far along a polyline [P, 3], [n]; its last segment goes on."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    ends = np.concatenate([[0], np.cumsum(steps)])
    k = np.clip(np.searchsorted(ends, length, side="left") - 1, 0, len(steps) - 1)
    share = (length - ends[k]) / np.where(steps[k] > 0, steps[k], 1)
    return line[k] + share[:, None] * (line[k + 1] - line[k])


def gather(
    points,      # [N, P, 3]
    tuft,        # [N]
    lines,       # [tufts, Q, 3] the hair in their middles
    strength,    # one, or [N]
    profile,
):
    """Strands [N, P, 3] drawn to the hair in the middle of their tuft, at the same length; each segment goes from where
    the one before ends towards where its end is drawn, no further than it is long."""
    points = np.asarray(points, float)
    result, strength = points.copy(), np.broadcast_to(strength, len(points))
    share = np.linspace(0, 1, points.shape[1])
    share = share / ((1 / profile - 2) * (1 - share) + 1)
    for i in np.flatnonzero((tuft != NONE) & (strength != 0)):
        steps = np.linalg.norm(np.diff(points[i], axis=0), axis=1)
        there = at_length(np.asarray(lines[tuft[i]], float), np.concatenate([[0], np.cumsum(steps)]))
        drawn = points[i] + np.minimum(strength[i] * share, 1)[:, None] * (there - points[i])
        for k, step in enumerate(steps):
            way = drawn[k + 1] - result[i, k]
            result[i, k + 1] = result[i, k] + way * min(step / max(np.linalg.norm(way), 1e-300), 1)
    return result


def noise(number, seed, t):
    """Smooth random lines [N, T, 2] at places t [T]: none at 0, random numbers at 1, 2, ..., cubic between."""
    whole = np.floor(t).astype(int)
    ends = np.stack([signed(random3(number, seed, 64 + wave))[:, :2] for wave in range(whole.max() + 2)], 1)
    ends[:, 0] = 0
    f = (t - whole)[:, None]
    return ends[:, whole] + (3 * f**2 - 2 * f**3) * (ends[:, whole + 1] - ends[:, whole])


def curl(
    points,      # [N, P, 3]
    turn,        # [N, 3] where curls begin
    kind,        # an object with the fields of HairType
    number,      # [N] of the strands
    seed,
    bent=1,      # one, or [N]: times curl and wave
    frizzy=1,    # and times frizz
):
    """Strands [N, P, 3] that curl and wave, where their type has tufts, and are frizzy, in a frame carried along."""
    points = np.asarray(points, float)
    count = points.shape[1]
    ahead = np.empty_like(points)
    ahead[:, 0] = unit_or(points[:, 1] - points[:, 0], (0, 1, 0))
    for k in range(1, count):
        ahead[:, k] = unit_or(points[:, min(k + 1, count - 1)] - points[:, k - 1], ahead[:, k - 1])
    least = np.where(np.abs(ahead[:, 0, :1]) < 0.6, (1, 0, 0), (0, 1, 0))
    side = unit_or(np.cross(ahead[:, 0], turn), unit_or(np.cross(ahead[:, 0], least), (1, 0, 0)))
    sides = turned_sides(ahead, side)
    share = np.linspace(0, 1, count)
    off = kind.frizz[0] * np.reshape(frizzy, (-1, 1, 1)) * noise(number, seed, kind.frizz[1] * share)
    if kind.tufts is not None:
        phi, psi = (2 * math.pi * turns * np.arange(count) / kind.segments for _, turns in (kind.curl, kind.wave))
        curls = [kind.curl[0] * (np.cos(phi) - 1) + kind.wave[0] * np.sin(psi), kind.curl[0] * np.sin(phi)]
        off = off + np.reshape(bent, (-1, 1, 1)) * np.stack(curls, 1)
    return points + off[..., :1] * sides + off[..., 1:] * np.cross(ahead, sides)


def put(points, place, normal, kind, number, seed, levels, traits=None):
    """Strands [N, P, 3] of a type, with numbers [N] and roots at places [N, 3] with unit normals [N, 3], in rest if the
    mesh has one, as its tufts and frizz leave them.

    levels: of the tufts, and of those around them, objects with the hair in their middles, lines [tufts, Q, 3], with
    places, normals, sizes, turns and spacing, of this type alone, and with strength and profile of its `clfur.Tufts`.
    traits: [N] what maps make of the strands.
    """
    turn = np.zeros((len(points), 3))
    drawn, bent, frizzy = (1, 1, 1) if traits is None else (
        traits["tuft"][:, 0], traits["scale"][:, 3], traits["tuft"][:, 1])
    if levels:
        inner, lines, outer = levels[0], np.asarray(levels[0].lines, float), levels[-1]
        tuft = found = find(inner, place, normal)
        if len(levels) > 1:
            around = find(outer, inner.places, inner.normals)
            lines = gather(lines, around, outer.lines, outer.strength, outer.profile)
            found = np.where(tuft == NONE, NONE, np.append(around, NONE)[np.minimum(tuft, len(around))])
            points = gather(points, found, outer.lines, outer.strength * drawn, outer.profile)
        points = gather(points, tuft, lines, inner.strength * drawn, inner.profile)
        turn = np.concatenate([outer.turns, turn[:1]])[np.minimum(found, len(outer.turns))]
    return curl(points, turn, kind, number, seed, bent, frizzy)


def find(level, place, normal):
    """The tufts [N] of a level for roots at places [N, 3] with normals."""
    return nearest(place, normal, level.places, level.normals, level.sizes, level.spacing)[0]
