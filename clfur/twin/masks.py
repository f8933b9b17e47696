"""What cl/masks.cl means, in float64: pieces of one pixel that hide each other in each of its patches."""

import numpy as np

from .coverage import BESIDE, DEPTH_ONE, LEAST, area_within, cut, drawn, leans, segments

SIDE = 4   # patches of a pixel, across and down


def pieces(view, points, spans):
    """Yield (y, x, depth << 32 | id, areas [SIDE, SIDE]) of ribbons, as `coverage.ribbon` cuts
    them: a patch is a pixel of a picture SIDE times as large; a column has the depth of the pixel's, thin ones
    its width too."""
    columns, rows = drawn(view)
    wide = leans(view, points, spans)
    for number, a, b in segments(view, points, spans):
        steep = abs(b[0] - a[0]) < abs(b[1] - a[1])
        if steep:
            a, b = ((y, x, e, h) for x, y, e, h in (a, b))
        ends = sorted(zip((a, b), wide.get(number, (0.0, 0.0))), key=lambda end: end[0][0])
        ((u0, v0, e0, h0), lean0), ((u1, v1, e1, h1), lean1) = ends
        out = max(abs(lean0), abs(lean1))
        us, vs = (rows, columns) if steep else (columns, rows)
        if u0 == u1:
            continue
        slope = (v1 - v0) / (u1 - u0)
        tilt = np.hypot(1, slope)
        for u in range(max(int(np.floor(u0 - out)), us[0]), min(int(np.floor(u1 + out)) + 1, us[1])):
            t = (np.clip([u, u + 1], u0, u1).mean() - u0) / (u1 - u0)
            radii = tilt * np.array([h0, h1] if number in wide else [h0 + t * (h1 - h0)] * 2)
            around = [(u0 + lean0, radii[0]), (u1 + lean1, radii[1]), (u1 - lean1, -radii[1]), (u0 - lean0, -radii[0])]
            column = cut([(x, v0 + slope * (x - u0) + above) for x, above in around], 0, u)
            if not column:
                continue
            low, high = (pick(v for _, v in column) for pick in (min, max))
            for v in range(max(int(np.floor(low)), vs[0]), min(int(np.floor(high)) + 1, vs[1])):
                areas = np.array([[_area(column, u + i / SIDE, v + j / SIDE) for i in range(SIDE)]
                                  for j in range(SIDE)])
                if areas.any():
                    depth = int(DEPTH_ONE * (1 - min(max(e0 + t * (e1 - e0), 0), 1)))
                    yield *((u, v) if steep else (v, u)), depth << 32 | number, areas.T if steep else areas


def _area(corners, u, v):
    """Share of the patch from u, v on that lies within a polygon."""
    enlarged = [((x - u) * SIDE, (y - v) * SIDE) for x, y in corners]
    return area_within(cut(enlarged, 0, 0), 0)


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
