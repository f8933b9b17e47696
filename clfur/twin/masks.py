"""What cl/masks.cl means, in float64: pieces of one pixel that hide each other in each of its patches."""

import numpy as np

from .coverage import BESIDE, DEPTH_ONE, LEAST, area_within, segments

SIDE = 4   # patches of a pixel, across and down


def pieces(view, points, spans):
    """Yield (y, x, depth << 32 | id, areas [SIDE, SIDE]) of ribbons, as `coverage.ribbon` cuts
    them: a patch is a pixel of a picture SIDE times as large; a column has the width and depth of the pixel's."""
    width, rows = int(view["size"][0]), [int(each) for each in view["rows"][:2]]
    for number, a, b in segments(view, points, spans):
        steep = abs(b[0] - a[0]) < abs(b[1] - a[1])
        if steep:
            a, b = ((y, x, e, h) for x, y, e, h in (a, b))
        (u0, v0, e0, h0), (u1, v1, e1, h1) = sorted((a, b), key=lambda end: end[0])
        us, vs = (rows, (0, width)) if steep else ((0, width), rows)
        if u0 == u1:
            continue
        slope = (v1 - v0) / (u1 - u0)
        for u in range(max(int(np.floor(u0)), us[0]), min(int(np.floor(u1)) + 1, us[1])):
            left, right = max(u0, u), min(u1, u + 1)
            t = ((left + right) / 2 - u0) / (u1 - u0)
            half = (h0 + t * (h1 - h0)) * np.hypot(1, slope)
            ends = sorted(v0 + slope * (end - u0) for end in (left, right))
            for v in range(max(int(np.floor(ends[0] - half)), vs[0]), min(int(np.floor(ends[1] + half)) + 1, vs[1])):
                areas = np.array([[_area(left, right, u + i / SIDE, v0 - slope * u0, slope, half, v + j / SIDE)
                                   for i in range(SIDE)] for j in range(SIDE)])
                if areas.any():
                    depth = int(DEPTH_ONE * (1 - min(max(e0 + t * (e1 - e0), 0), 1)))
                    yield *((u, v) if steep else (v, u)), depth << 32 | number, areas.T if steep else areas


def _area(left, right, u, height, slope, half, v):
    """Share of the patch from u, v on that a ribbon covers, whose middle lies at height + slope * u."""
    first, last = max(left, u), min(right, u + 1 / SIDE)
    if first >= last:
        return 0.0
    low, high = height + slope * first, height + slope * last
    corners = [(first, low - half), (last, high - half), (last, high + half), (first, low + half)]
    return SIDE * SIDE * area_within([(x, (y - v) * SIDE) for x, y in corners], 0) / SIDE


def resolve(layers):
    """Hide pieces of one pixel, {depth << 32 | id: areas [SIDE, SIDE]}, with nothing else there -> ({key: share of the
    pixel's light}, alpha)."""
    left, weights, beside, oldest = np.ones((SIDE, SIDE)), {}, [], 0
    for key, areas in sorted(layers.items()):
        number, before = key & 0xFFFFFFFF, left.mean()
        if before <= LEAST:
            break
        strand = next((each for each in beside if each[0] - 1 <= number <= each[1] + 1), None)
        if strand is None:
            strand = [number, number, np.zeros((SIDE, SIDE))]
            if len(beside) < BESIDE:
                beside.append(strand)
            else:
                beside[oldest], oldest = strand, (oldest + 1) % BESIDE
        covered = np.minimum(strand[2] + areas, 1)
        free = 1 - strand[2]
        left = np.where(free > 0, left * (1 - covered) / np.where(free > 0, free, 1), left)
        strand[:] = min(strand[0], number), max(strand[1], number), covered
        if left.mean() <= LEAST:
            left = np.zeros((SIDE, SIDE))
        weights[key] = before - left.mean()
    return weights, 1 - left.mean()
