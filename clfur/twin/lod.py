"""lod in float64 NumPy: which strands are kept, how wide, and with which of their points."""

import numpy as np

LEAST, SOFT, PARTS, MOST = 1 / 8, 1.5, 4, 16


def mixed(*words):
    """pcg3d (Jarzynski and Olano, 2020) of three words."""
    x, y, z = ((v * 1664525 + 1013904223) % 2**32 for v in words)
    for last in (False, True):
        x = (x + y * z) % 2**32
        y = (y + z * x) % 2**32
        z = (z + x * y) % 2**32
        if not last:
            x, y, z = (v ^ v >> 16 for v in (x, y, z))
    return x, y, z


def place(number, seed):
    """A strand's place in (0, 1): the top 23 bits of pcg3d of its number, seed and 4."""
    return ((mixed(number, seed, 4)[0] >> 9) + 0.5) / 2**23


def number_of(a, b):
    """The number of a strand that has none, by the bits of its ends' places [3]: the same from either end."""
    words = (mixed(*map(int, (np.float32(end) + np.float32(0)).view(np.uint32))) for end in (a, b))
    return mixed(*(sum(both) % 2**32 for both in zip(*words)))[0]


def widening(u, k):
    """Factor of the width of strands at places u where the share k is kept: a ramp over its mean in [0, 1]."""
    ramp = np.clip((SOFT * k - np.asarray(u)) / ((SOFT - 1) * k), 0, 1)
    # The ramp's integral: whole up to k, then half of its height at both ends of what lies below 1.
    end = min(SOFT * k, 1)
    mean = k + (end - k) * (1 + (SOFT * k - end) / ((SOFT - 1) * k)) / 2
    return ramp / mean


def thin(
    to_screen,      # [4, 4] world -> (x, y, e, 1)·w
    scale,          # pixels per world unit at w = 1
    points,         # [n, 4] of one strand, x, y, z, width
    number,         # of the strand; None: by where its ends are
    seed,
    lod,            # pixels
    colors=None,    # [n, 3], if each point has one
):
    """One strand -> (factor of its widths, indices of the points that are kept; none if it is not)."""
    points = np.asarray(points, float)
    w = points[:, :3] @ to_screen[3, :3] + to_screen[3, 3]
    n = len(points)
    if n == 0:
        return 0.0, []
    if number is None:
        if tuple(points[0, :3]) > tuple(points[-1, :3]):    # from the other end
            backwards = None if colors is None else colors[::-1]
            factor, kept = thin(to_screen, scale, points[::-1], None, seed, lod, backwards)
            return factor, [n - 1 - each for each in kept[::-1]]
        number, wide = number_of(points[0, :3], points[-1, :3]), max(points[0, 3], points[-1, 3])
    else:
        wide = points[0, 3]
    nearer = min(w[0], w[-1])
    k = 1.0
    if nearer > 0 and wide > 0:
        k = min(max(wide * scale / nearer / lod, LEAST), 1.0)
    factor = float(widening(place(number, seed), k))
    if factor <= 0:
        return 0.0, []
    kept, most = [0], min(-(-(n - 1) // PARTS), MOST)
    while kept[-1] < n - 1:
        a = b = kept[-1]
        b += 1
        while b + 1 < n and b + 1 - a <= most and _holds(points, w, colors, a, b + 1, lod / 4 / scale, factor):
            b += 1
        kept.append(b)
    return factor, kept


def _holds(points, w, colors, a, b, tolerance, factor):
    """Whether the line from point a to b may stand for the points between, to within this at w = 1."""
    nearer = min(w[a], w[b])
    if nearer <= 0:
        return False
    way, off = points[b] - points[a], points[a + 1:b] - points[a]
    square = way[:3] @ way[:3]
    at = np.clip(off[:, :3] @ way[:3] / square, 0, 1) if square > 0 else np.zeros(len(off))
    off = off - at[:, None] * way
    distance = np.sqrt((off[:, :3] ** 2).sum(1) + (factor / 2 * off[:, 3]) ** 2)
    if (distance > tolerance * nearer).any():
        return False
    if colors is None:
        return True
    between = colors[a] + at[:, None] * (colors[b] - colors[a])
    return not (np.abs(between - colors[a + 1:b]) > colors[a + 1:b] / 32).any()
