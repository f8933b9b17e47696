"""What cl/flow.cl means, in float64: two projections of each place, and their difference."""

import numpy as np

from .vectors import dot, f64, mix, unit


def on_screen(view, p):
    """Places [n, 3] -> (x, y in pixels [n, 2], distance along the view axis [n])."""
    q = np.c_[f64(p)[:, :3], np.ones(len(p))] @ f64(view["to_screen"])
    with np.errstate(divide="ignore", invalid="ignore"):
        return q[:, :2] / q[:, 3:], q[:, 3]


def vectors(view, view_before, now, before):
    """Motion vectors [n, 2] of places [n, 3]; infinite where one is not before its camera."""
    (to, deep), (from_, was_deep) = on_screen(view, now), on_screen(view_before, before)
    return np.where(((deep > 0) & (was_deep > 0))[:, None], to - from_, np.inf)


def endless(view, view_before, x, y):
    """Motion vectors [n, 2] of what is endlessly far away, at pixels x, y [n]: by the rays through their middles."""
    turn, turn_before = (f64(each["to_screen"])[:3][:, [0, 1, 3]] for each in (view, view_before))
    ways = np.linalg.solve(turn.T, np.stack([x + .5, y + .5, np.ones(len(x))])).T
    q = ways @ turn_before
    return np.where(q[:, 2:] > 0, np.stack([x + .5, y + .5], 1) - q[:, :2] / q[:, 2:], np.inf)


def on_strands(a, b, a_before, b_before, p):
    """Places nearest to p [n, 3] on segments a to b -> (these, the same places on the segments before) [n, 3]."""
    a, b, p = (f64(each)[:, :3] for each in (a, b, p))
    share = np.clip(dot(b - a, p - a) / dot(b - a, b - a), 0, 1)
    return mix(a, b, share), mix(f64(a_before)[:, :3], f64(b_before)[:, :3], share)


def on_faces(corners, corners_before, p, lifted=False):
    """Places p [n, 3] on triangles [n, 3, 3] -> (these, the same places on the triangles before); ``lifted``: as far
    above both."""
    corners, before = f64(corners)[..., :3], f64(corners_before)[..., :3]
    normals = [unit(np.cross(each[:, 1] - each[:, 0], each[:, 2] - each[:, 0])) for each in (corners, before)]
    height = dot(p - corners[:, 0], normals[0])
    matrix = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], normals[0]], 2)
    parts = np.linalg.solve(matrix, (p - corners[:, 0])[:, :, None])[:, :, 0]
    two = np.clip(parts[:, 0], 0, 1)
    three = np.clip(parts[:, 1], 0, 1 - two)
    weights = np.stack([1 - two - three, two, three], 1)
    return [(weights[:, :, None] * each).sum(1) + lifted * height[:, None] * normal
            for each, normal in zip((corners, before), normals)]


def farthest(view, view_before, now, before):
    """How far any point [n, 3] goes on the screen: of those whose way lies before the near planes, or in part, and not
    beside the picture by more than its size."""
    size, ways = f64(view["size"])[:2], [0.0]
    ends = [np.c_[f64(p)[:, :3], np.ones(len(p))] @ f64(each["to_screen"])
            for each, p in ((view_before, before), (view, now))]
    for p, q in zip(*ends):
        inside = p[3] - float(view_before["to_screen"][3, 2]), q[3] - float(view["to_screen"][3, 2])
        if max(inside) <= 0:
            continue
        cut = inside[0] / (inside[0] - inside[1]) if min(inside) <= 0 else None
        ends_of_way = [mix(p[None], q[None], np.array([cut]))[0] if cut is not None and depth <= 0 else end
                       for end, depth in ((p, inside[0]), (q, inside[1]))]
        places = np.array([end[:2] / end[3] for end in ends_of_way])
        if (places.max(0) >= -size).all() and (places.min(0) <= 2 * size).all():
            ways.append(np.linalg.norm(places[1] - places[0]))
    return max(ways)
