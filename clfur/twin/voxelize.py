"""What cl/voxelize.cl means: points are snapped in the device's own order of float operations; which cells a snapped
segment falls into, and how much of it, is then found in exact integers, segment by segment."""

import numpy as np

SUBPIXEL = 256             # fixed-point steps per cell
FAR = 4                    # grids from the origin beyond which a point is not snapped
FRACTION = 24              # bits of a fragment's slope below the sub-cell
METHODS = ("binary", "count", "trilinear", "length")


def voxelize(grid, points, spans, kinds, method, weights):
    """Put strands into a grid -> [nz, ny, nx] int64.

    grid: a `Grid` struct. points [P, 4] x, y, z, width; spans [strands, 2] first point, points; kinds [strands] the
    type of each; weights [types] what one fragment or one crossing adds; method: one of METHODS.
    """
    cells = np.zeros([int(n) for n in grid["size"][2::-1]], np.int64)
    for (z, y, x), amount in deposits(grid, points, spans, kinds, method, weights):
        z = np.maximum(z, 0) if grid["size"][3] else z   # what lies before the grid counts in its first layer
        inside = (x >= 0) & (y >= 0) & (z >= 0)
        for place, size in zip((z, y, x), cells.shape):
            inside &= place < size
        at = z[inside], y[inside], x[inside]
        if method == "binary":
            np.maximum.at(cells, at, amount[inside])
        else:
            np.add.at(cells, at, amount[inside])
    return cells


def deposits(grid, points, spans, kinds, method, weights):
    """Yield what each segment leaves, inside the grid or not: ((z, y, x) each int64 [n], amounts int64 [n])."""
    points = np.asarray(points, np.float32)
    snapped, good, w = snap(grid, points)
    for (first, count), kind in zip(np.asarray(spans, np.int64), np.asarray(kinds, np.int64)):
        weight, left = int(weights[kind]), np.float32(0.5)
        for k in range(first, first + count - 1):
            ends, at, away = points[k:k + 2], snapped[k:k + 2], w[k:k + 2]
            if not (good[k] and good[k + 1]):
                ends = cut_to_grid(grid, *ends)
                if ends is None:
                    continue
                at, both, away = snap(grid, np.stack(ends))
                if not both.all():
                    continue
            if method == "length":
                if max(at[:, 2]) < 0 and not grid["size"][3]:
                    continue
                amount, left = crossings(grid, *ends, *away, weight, left)
                yield spread(*at, amount)
            else:
                yield from fragments(*at, weight, method)


def snap(grid, points):
    """World points [P, >= 3] -> sub-cells int64 [P, 3], which of them could be snapped [P], distances w float32 [P]."""
    m, p = grid["to_grid"], np.asarray(points, np.float32)
    with np.errstate(all="ignore"):
        c = ((m[0] * p[:, 0:1] + m[1] * p[:, 1:2]) + m[2] * p[:, 2:3]) + m[3]
        w, far = c[:, 3], np.float32(FAR * grid["size"][:3].max())
        q = np.stack([c[:, 0] / w, c[:, 1] / w, np.maximum(c[:, 2], -far) if grid["size"][3] else c[:, 2]], 1)
        good = (w > 0) & (np.abs(q) <= far).all(1)
        if grid["size"][3]:
            good &= w >= grid["face"][3]
        steps = np.floor(np.where(good[:, None], q, 0) * np.float32(SUBPIXEL) + np.float32(0.5))
    return steps.astype(np.int64), good, w


def cut_to_grid(grid, a, b):
    """What of a segment a, b [4] float32 lies in the grid and a cell around, also before it where that counts."""
    m, (nx, ny, nz, before) = grid["to_grid"], grid["size"].astype(np.float32)
    one = np.float32(1)

    def inside(p):
        x, y, z, w = ((m[0] * p[0] + m[1] * p[1]) + m[2] * p[2]) + m[3]
        return (w - grid["face"][3], (nz + one) - z, x + w, (nx + one) * w - x, y + w, (ny + one) * w - y, z + one)

    for side in range(6 if before else 7):
        by_a, by_b = inside(a)[side], inside(b)[side]
        if not (by_a >= 0 or by_b >= 0):
            return None
        if by_a < 0:
            a = b + (a - b) * (by_b / (by_b - by_a))
        elif by_b < 0:
            b = a + (b - a) * (by_a / (by_a - by_b))
    return a, b


def divide(n, d):
    """Quotient of Python ints rounded towards zero, as in C."""
    return abs(n) // abs(d) * (1 if (n < 0) == (d < 0) else -1)


def fragments(a, b, weight, method):
    """Yield the fragments of one segment between sub-cells a and b: ((z, y, x), amounts), see `deposits`.

    There is one in each layer of cells across the longer of x and y (x if they are equal) whose middle lies in
    [a, b); its other two coordinates are a's plus a slope, cut to FRACTION bits, times the distance from a.
    """
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    steep = abs(bx - ax) < abs(by - ay)
    (u0, v0, z0), (u1, v1, z1) = sorted([(ay, ax, az), (by, bx, bz)] if steep else [(ax, ay, az), (bx, by, bz)],
                                        key=lambda end: end[0])
    if u0 == u1:
        return
    # The first and the last layer whose middle could matter; at most twice the guard band, so no bound is needed.
    u = np.arange(u0 // SUBPIXEL, u1 // SUBPIXEL + 1)
    way = u * SUBPIXEL + SUBPIXEL // 2 - u0
    u, way = (each[(way >= 0) & (way < u1 - u0)] for each in (u, way))
    v = v0 + (divide((v1 - v0) << FRACTION, u1 - u0) * way >> FRACTION)
    z = z0 + (divide((z1 - z0) << FRACTION, u1 - u0) * way >> FRACTION)
    if method != "trilinear":
        v, z = v // SUBPIXEL, z // SUBPIXEL
        yield (z, u, v) if steep else (z, v, u), np.full(len(u), weight, np.int64)
        return
    # Between the middles of four cells: shares are cut to whole amounts, and what that leaves stays nearest.
    v, z = v - SUBPIXEL // 2, z - SUBPIXEL // 2
    fv, fz = v % SUBPIXEL, z % SUBPIXEL
    v, z = v // SUBPIXEL, z // SUBPIXEL
    right, behind = weight * fv // SUBPIXEL, weight * fz // SUBPIXEL
    both = right * fz // SUBPIXEL
    for dv, dz, part in ((0, 0, weight - right - behind + both), (1, 0, right - both), (0, 1, behind - both),
                         (1, 1, both)):
        yield (z + dz, u, v + dv) if steep else (z + dz, v + dv, u), part


def crossings(grid, a, b, wa, wb, weight, left):
    """What a segment a, b [4] float32 amounts to, all in float32: (whole amount, what is left for the next one)."""
    half, light = np.float32(0.5), grid["light"]
    with np.errstate(all="ignore"):
        w, width, d = max(half * (wa + wb), grid["face"][3]), half * (a[3] + b[3]), (b - a)[:3]
        ray = light[:3] - light[3] * (half * (a + b))[:3]
        c = np.stack([d[1] * ray[2] - d[2] * ray[1], d[2] * ray[0] - d[0] * ray[2], d[0] * ray[1] - d[1] * ray[0]])
        exact = np.sqrt(dot(c, c)) * width / (grid["face"][0] * (w * w * w)) * np.float32(weight) + left
    amount = int(min(exact, np.float32(2**31)))
    return amount, min(exact - np.float32(amount), np.float32(1))


def dot(a, b):
    """Scalar product of float32 vectors [3], summed from the left."""
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def spread(a, b, amount):
    """A whole amount spread evenly over steps of 3/4 cell at most between sub-cells a and b; see `deposits`.

    The first steps take one more each where the amount does not divide.  Each step counts in the layer of its middle,
    between the middles of the four columns around: shares are cut to whole amounts, and what that leaves stays first.
    """
    a, b = a.tolist(), b.tolist()
    n = max(abs(q - p) for p, q in zip(a, b)) // (SUBPIXEL * 3 // 4) + 1
    i = np.arange(n)
    x, y, z = ((p << 9) + divide(divide((q - p) << 9, n), 2) + i * divide((q - p) << 9, n) for p, q in zip(a, b))
    part = amount // n + (i < amount % n).astype(np.int64)
    x, y, z = (x >> 9) - SUBPIXEL // 2, (y >> 9) - SUBPIXEL // 2, z >> 17
    right, behind = part * (x % SUBPIXEL) // SUBPIXEL, part * (y % SUBPIXEL) // SUBPIXEL
    both = right * (y % SUBPIXEL) // SUBPIXEL
    x, y = x // SUBPIXEL, y // SUBPIXEL
    parts = part - right - behind + both, right - both, behind - both, both
    return (np.tile(z, 4), np.concatenate([y, y, y + 1, y + 1]), np.concatenate([x, x + 1, x, x + 1])), \
        np.concatenate(parts)
