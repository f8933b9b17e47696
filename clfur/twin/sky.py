"""What cl/sky.cl and cl/sky.h mean, over arrays: hair in moments, the body as shares of cells, light by Legendre."""

import numpy as np

PARTS, STEPS = 4, 2   # of a cell's side, for the body and along hair


def moments(low, scale, n, points, spans, opaque):
    """What strands leave in cells -> [n, n, n, 3, 3] float64, (1 - alpha) · width · length · t tᵀ over a cell's face.

    low [3], scale: of the grid, cells a unit.  points [P, 4]; spans [strands, 2]; opaque [strands] 1 - alpha.  Where
    steps of half a cell lie is found in float32, as there.
    """
    cells = np.zeros((n, n, n, 3, 3))
    points, low, scale = np.asarray(points, np.float32), np.asarray(low, np.float32), np.float32(scale)
    for (first, count), share in zip(np.asarray(spans, int), opaque):
        for a, b in zip(points[first:first + count - 1], points[first + 1:first + count]):
            d = b - a
            square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
            if not square > 0:
                continue
            steps = int(np.sqrt(square) * scale * STEPS) + 1
            p = a + ((np.arange(steps, dtype=np.float32) + np.float32(0.5)) / np.float32(steps))[:, None] * d
            at = (p[:, :3] - low) * scale
            inside = ((at >= 0) & (at < n)).all(1)
            x, y, z = np.floor(at[inside]).astype(int).T
            along = d[:3].astype(float)
            each = share * float(scale) ** 2 * p[inside, 3].astype(float) / steps / np.sqrt(along @ along)
            np.add.at(cells, (z, y, x), each[:, None, None] * np.outer(along, along))
    return cells


def solid(low, scale, n, corners):
    """Share of each cell that is body -> [n, n, n]: of 16 lines through it along each axis, the axis where it is least.

    corners: [T, 3, 3] of triangles that face outwards.
    """
    at = (np.asarray(corners, float) - low) * scale
    middles = (np.arange(n * PARTS) + 0.5) / PARTS
    shares = []
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        share = np.zeros((n * PARTS, n * PARTS, n))   # across, across, along
        for a, b, c in at:
            e, f = b - a, c - a
            area = e[one] * f[two] - e[two] * f[one]
            if area == 0:
                continue
            u, v = middles[:, None] - a[one], middles[None] - a[two]
            s, t = (u * f[two] - v * f[one]) / area, (v * e[one] - u * e[two]) / area
            met = (s > 0) & (t > 0) & (s + t < 1)
            height = a[axis] + s[met] * e[axis] + t[met] * f[axis]
            share[met] += np.sign(area) * np.clip(height[:, None] - np.arange(n), 0, 1)
        means = share.reshape(n, PARTS, n, PARTS, n).mean((1, 3))
        shares.append(np.abs(np.transpose(means, {0: (1, 0, 2), 1: (0, 2, 1), 2: (2, 1, 0)}[axis])))
    return np.minimum(np.min(shares, 0), 1)


def through(cells, body, directions):
    """Share of the light of each direction that reaches the middles of cells -> [directions, n, n, n].

    A body lies behind what its cells tell: its surface gets what comes to them.

    cells, body: as `moments` and `solid` give them; directions: [D, 3] towards the light.
    """
    n, result = len(body), []
    density = np.trace(cells, axis1=3, axis2=4)
    for w in np.asarray(directions, float):
        axis = int(np.argmax(np.abs(w)))
        step = w / abs(w[axis])
        depth = np.sqrt(np.maximum(density**2 - density * np.einsum("zyxij,i,j->zyx", cells, w, w), 0))
        depth = depth / abs(w[axis])
        there = np.zeros((n, n, n))
        behind = np.ones((n + 4, n + 4, n + 4))        # with what lies around the grid
        order = range(n)[::-1] if w[axis] > 0 else range(n)
        for k in order:
            at = np.stack(np.meshgrid(*[np.arange(n) if a != axis else [k] for a in range(3)], indexing="ij"), -1)
            from_ = at + step
            base = np.floor(from_ + (np.arange(3) == axis) * 0.5).astype(int)   # along the axis it is a whole number
            part = np.where(np.arange(3) == axis, 0, from_ - base)
            value = 0
            for corner in np.ndindex(2, 2, 2):
                weight = np.prod(np.where(corner, part, 1 - part), -1)
                x, y, z = np.moveaxis(base + corner + 2, -1, 0)
                value = value + weight * behind[z, y, x]
            x, y, z = np.moveaxis(at, -1, 0)
            share, d = body[z, y, x], depth[z, y, x]
            there[z, y, x] = value * np.exp(-d * (1 + share) / 2)
            behind[z + 2, y + 2, x + 2] = value * np.exp(-d) * np.minimum(2 - 2 * share, 1)
        result.append(there)
    return np.array(result)


def light(low, scale, shares, directions, table, places, axes, kernel):
    """Light [n, 3] at places [n, 3] around axes [n, 3], over that of a sky of 1: by Legendre's polynomials.

    shares: as `through` gives them.  table: [D, m, 3] of each direction's light in m parts from ``directions`` [D, m,
    3]; kernel: what of orders 0, 1 and 2 is kept.
    """
    n = shares.shape[1]
    at = np.clip((np.asarray(places, float) - low) * scale - 0.5, 0, n - 1)
    base = np.minimum(at.astype(int), n - 2)
    part, result = at - base, np.zeros((len(at), 3))
    cosines = np.einsum("dmi,ni->ndm", directions, axes)
    weights = (kernel[0] + 3 * kernel[1] * cosines + 2.5 * kernel[2] * (3 * cosines**2 - 1)) / (4 * np.pi)
    sent = np.einsum("ndm,dmc->ndc", weights, table)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, part, 1 - part), 1)
        x, y, z = (base + corner).T
        result += weight[:, None] * np.einsum("dn,ndc->nc", shares[:, z, y, x], sent)
    return np.maximum(result, 0)


def on_level(low, scale, shares, directions, light, places):
    """What directions send to places [n, 3] -> [n, 3]: all of it, or where they leave the grid what reaches it there.

    shares: as `through` gives them; directions: [D, 3]; light: [D, 3].
    """
    n, result = shares.shape[1], np.zeros((len(places), 3))
    start = (np.asarray(places, float) - low) * scale
    for share, w, color in zip(shares, np.asarray(directions, float), np.asarray(light, float)):
        with np.errstate(divide="ignore"):
            ends = np.sort(np.stack([-start / w, (n - start) / w]), 0)
        first, last = np.maximum(ends[0].max(1), 0), ends[1].min(1)
        at = np.clip(start + np.where(first < last, first, 0)[:, None] * w - 0.5, 0, n - 1)
        base = np.minimum(at.astype(int), n - 2)
        left = 0
        for corner in np.ndindex(2, 2, 2):
            x, y, z = (base + corner).T
            left = left + np.prod(np.where(corner, at - base, 1 - at + base), 1) * share[z, y, x]
        result += np.where(first < last, left, 1)[:, None] * color
    return result
