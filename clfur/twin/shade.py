"""What cl/shade.cl means, in float64: where a sample's point stands in the world, and the light there.

``strands`` and ``body`` are any objects with the arrays of `DeviceStrands` and `Surface` as members, in NumPy.
"""

import numpy as np

from .lighting import light_at
from .raster import BODY, DEPTH_ONE, NONE, PATTERNS
from .scatter import fibre
from .strands import tangents_at
from .vectors import dot, f64, merge, mix, unit


def color(view, lights, visible, strands, body, body_color, paint=None):
    """Light every sample and average -> [height, width, 4] float64: linear, premultiplied, coverage in alpha.

    view, lights [n]: structs. visible: [height, width, samples] uint64, depth << 32 | id. paint: what `painted` takes
    of materials in place of ``body_color``.
    """
    radiance = np.zeros((*visible.shape, 4))
    on, number, p, v = samples_of(view, visible)
    hair = number < BODY

    rgb = np.zeros(p.shape)
    k, strand, share, t = on_strand(strands, number[hair], p[hair])
    kind, types = f64(strands.uv)[strand, 2].astype(int), np.asarray(strands.types)
    shine, lobes = f64(types["shine"])[kind], f64(types["lobes"])[kind]
    base = strand_color(strands, k, strand, share)
    n, weights = on_body(body, number[~hair] - BODY, p[~hair], v[~hair])
    if paint is not None:
        steps = steps_on(view, body, number[~hair] - BODY, p[~hair])
        body_color = painted(body, *paint, number[~hair] - BODY, weights, steps / np.sqrt(visible.shape[2]))
    else:
        body_color = f64(body_color)[:3]
    for light in lights:
        to_light, direct, ambient = light_at(light, p)
        rgb[hair] += fibre(base, shine, t, to_light[hair], v[hair], direct[hair], ambient, lobes)
        lambert = np.maximum(dot(n, to_light[~hair]), 0)[:, None]
        rgb[~hair] += body_color * (direct[~hair] * lambert + ambient)

    radiance[on] = np.concatenate([rgb, np.ones((len(rgb), 1))], 1)
    return radiance.mean(2)


def cover(visible, transmittance):
    """Share of each pixel that is covered -> [height, width] float64; transmittance: [height, width, samples] share of
    light that comes from behind shell fur."""
    return np.where(visible == NONE, 1 - f64(transmittance), 1).mean(2)


def outputs(view, visible, strands, body):
    """What the nearest covered sample of each pixel sees -> {name: [height, width(, 4)] float64 or int}."""
    height, width, _samples = visible.shape
    nearest = visible.argmin(2)
    only = np.full(visible.shape, NONE, np.uint64)
    np.put_along_axis(only, nearest[..., None], visible.min(2)[..., None], 2)
    on, number, p, v = samples_of(view, only)
    on = on.any(2)
    hair = number < BODY
    _, strand, _, t = on_strand(strands, number[hair], p[hair])
    n, b = on_body(body, number[~hair] - BODY, p[~hair], v[~hair])
    across = v[hair] - dot(v[hair], t)[:, None] * t
    corner_uv = f64(body.uv)[np.asarray(body.triangles)[number[~hair] - BODY, :3]]

    result = {"depth": np.full((height, width), np.inf), "id": np.full((height, width), -1),
              **{name: np.zeros((height, width, 4)) for name in ("tangent", "normal", "uv")},
              "coverage": (visible != NONE).mean(2)}
    result["depth"][on] = p @ f64(view["to_screen"])[:3, 3] + float(view["to_screen"][3, 3])
    result["id"][on] = merge(hair, np.asarray(strands.numbers)[strand], np.full((~hair).sum(), -2))
    result["tangent"][on, :3] = merge(hair, t, 0 * n)
    result["normal"][on, :3] = merge(hair, unit(across), n)
    result["uv"][on] = merge(hair, f64(strands.uv)[strand], (b[..., None] * corner_uv).sum(1))
    return result


# --- geometry -------------------------------------------------------------------------------------------


def samples_of(view, visible):
    """Covered samples -> (mask like visible, ids [n], points [n, 3], unit vectors v to the eye [n, 3]).

    A point projects to its sample: to_screen·(p, 1) = w·(x, y, e, 1), which is solved for p.
    """
    on = visible != NONE
    y, x, s = np.nonzero(on)
    y, x = y + int(view["rows"][0]), x + int(view["rows"][2])
    offset = f64(PATTERNS[visible.shape[2]])[s] / 16
    e = np.maximum(1 - (visible[on] >> np.uint64(32)).astype(np.float64) / DEPTH_ONE, 0.5 / DEPTH_ONE)
    place = np.stack([x + 0.5 + offset[:, 0], y + 0.5 + offset[:, 1], e, np.ones(len(e))], 1)
    q = np.linalg.solve(f64(view["to_screen"]).T, place.T).T
    p = q[:, :3] / q[:, 3:]
    eye = f64(view["eye"])
    return on, (visible[on] & np.uint64(0xFFFFFFFF)).astype(np.int64), p, unit(eye[:3] - eye[3] * p)


def on_strand(strands, k, p):
    """Points [n, 3] near segments k [n], as they came -> (k as they lie, strand, share of the length, unit tangent)."""
    k = np.asarray(strands.stored)[k // strands.run].astype(int) + k % strands.run
    a, b = f64(strands.points)[k, :3], f64(strands.points)[k + 1, :3]
    share = np.clip(dot(b - a, p - a) / dot(b - a, b - a), 0, 1)
    strand = np.asarray(strands.strand_of)[k // strands.run].astype(int)
    first, last = tangents_at(f64(strands.points)[:, :3], np.asarray(strands.spans)[strand], k)
    return k, strand, share, unit(mix(first, last, share))


def strand_color(strands, k, strand, share):
    """Colours [n, 3] of points on segments: one for all, each strand's, or mixed of two points'."""
    colors = f64(strands.colors)[:, :3]
    if len(colors) == 1:
        return colors[np.zeros_like(k)]
    if len(colors) == len(strands.spans):
        return colors[strand]
    return mix(colors[k], colors[k + 1], share)


def on_body(body, triangle, p, v):
    """Points [n, 3] of triangles [n] -> (unit normals on the eye's side, weights of the corners) [n, 3].

    Weights are areas over the triangle's, so a point outside by a rounding error is brought back to its rim.
    """
    corners = np.asarray(body.triangles)[triangle, :3]
    a, b, c = np.moveaxis(f64(body.positions)[corners, :3], 1, 0)
    n = np.cross(b - a, c - a)
    at_b = np.clip(dot(np.cross(p - a, c - a), n) / dot(n, n), 0, 1)
    at_c = np.clip(dot(np.cross(b - a, p - a), n) / dot(n, n), 0, 1 - at_b)
    weights = np.stack([1 - at_b - at_c, at_b, at_c], 1)
    n = unit((weights[..., None] * f64(body.normals)[corners, :3]).sum(1))
    return np.where(dot(n, v)[:, None] < 0, -n, n), weights


# --- base colours ---------------------------------------------------------------------------------------


def painted(body, materials, material_of, triangle, weights, steps=None):
    """Base colours [n, 3] of triangles [n] at weights [n, 3] of their corners.

    materials: objects with color [3], levels ([h, w, 3] each, half as large as the one before, or none) and wrap;
    material_of: [faces] which each face has, or None for the first. steps: [n, 2, 2] how far in uv a sample's share of
    the picture goes along x and y; None for no size at all.
    """
    triangles = np.asarray(body.triangles)[triangle]
    uv = (weights[..., None] * f64(body.uv)[triangles[:, :3], :2]).sum(1)
    which = np.zeros(len(uv), int) if material_of is None else np.asarray(material_of)[triangles[:, 3]]
    colors = np.zeros((len(uv), 3))
    for k, material in enumerate(materials):
        mine = which == k
        colors[mine] = f64(material.color)
        if material.levels and mine.any():
            height, width = material.levels[0].shape[:2]
            length = 0 if steps is None else np.linalg.norm(steps[mine] * (width, height), axis=2).max(1)
            level = np.clip(np.log2(np.maximum(length, 1e-9)), 0, len(material.levels) - 1) * np.ones(mine.sum())
            seen = np.zeros((mine.sum(), 3))
            for j, picture in enumerate(material.levels):   # each counts as far as it is near
                seen += np.maximum(1 - np.abs(level - j), 0)[:, None] * picture_at(picture, uv[mine], material.wrap)
            colors[mine] *= seen
    return colors


def picture_at(picture, uv, wrap):
    """A picture [h, w, 3] at uv [n, 2], between the four texels around -> [n, 3]; v runs up."""
    picture, ends = f64(picture), []
    for place, n, how in (1 - uv[:, 1], picture.shape[0], wrap[1]), (uv[:, 0], picture.shape[1], wrap[0]):
        at = place * n - .5 if how != "clamp" else np.clip(place, 0, 1) * n - .5
        low = np.floor(at).astype(np.int64)
        both = np.stack([low, low + 1])
        if how == "repeat":
            both %= n
        elif how == "mirror":
            both %= 2 * n
            both = np.minimum(both, 2 * n - 1 - both)
        ends.append((np.clip(both, 0, n - 1), np.stack([low + 1 - at, at - low])))
    (rows, down), (columns, across) = ends
    return sum((down[i] * across[j])[:, None] * picture[rows[i], columns[j]] for i in (0, 1) for j in (0, 1))


def steps_on(view, body, triangle, p):
    """How far in uv rays a pixel further along x and y pass on the planes of triangles -> [n, 2, 2]."""
    corners = np.asarray(body.triangles)[triangle, :3]
    a, b, c = np.moveaxis(f64(body.positions)[corners, :3], 1, 0)
    uv = f64(body.uv)[corners, :2]
    n, eye, matrix = np.cross(b - a, c - a), f64(view["eye"])[:3], f64(view["to_screen"]).T
    q = np.concatenate([p, np.ones((len(p), 1))], 1) @ matrix.T
    place, steps, delta = q[:, :3] / q[:, 3:], [], 1e-3
    for axis in (0, 1):
        ends = []
        for sign in (-1, 1):
            there = np.concatenate([place, np.ones((len(p), 1))], 1)
            there[:, axis] += sign * delta / 2
            d = np.linalg.solve(matrix, there.T).T
            d = d[:, :3] / d[:, 3:] - eye
            with np.errstate(divide="ignore", invalid="ignore"):
                met = eye + (dot(n, a - eye) / dot(n, d))[:, None] * d
            two, three = dot(np.cross(met - a, c - a), n) / dot(n, n), dot(np.cross(b - a, met - a), n) / dot(n, n)
            ends.append(two[:, None] * (uv[:, 1] - uv[:, 0]) + three[:, None] * (uv[:, 2] - uv[:, 0]))
        steps.append((ends[1] - ends[0]) / delta)
    return np.stack(steps, 1)
