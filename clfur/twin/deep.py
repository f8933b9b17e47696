"""What cl/deep.cl and cl/deep.h mean, in float64: segments of hair as a light sees them, and what they let through."""

import numpy as np

from .coverage import segments
from .vectors import f64

UNIT = 1024               # steps of what one takes an octave
DARKEST = 1 - 1 / 256     # share of light that one takes at most,
DARK = 6                  # and octaves that all do


def through(packed, view, points, spans, opaque, places, own):
    """Share of light that gets through strands to places [n, 3] of strands ``own`` -> [n] 0..1.

    view, packed: a `View` and a `Deep` struct.  points [P, 4] x, y, z, width; spans [strands, 2]; opaque: [strands]
    share of light that each takes.  Each segment takes what it covers of a square around the place, which is turned
    along it.
    """
    strand_of = np.repeat(np.arange(len(spans)), np.asarray(spans, np.int64)[:, 1])
    size, reach = 8 * int(packed["size"][0]), float(packed["reach"][0])
    c = np.c_[f64(places), np.ones(len(places))] @ f64(packed["to_map"])
    before = c[:, 3] > 0
    seen = c[:, :3] / np.where(before, c[:, 3], 1)[:, None]
    inside = before & ((seen[:, :2] >= 0) & (seen[:, :2] < size)).all(1)
    steps = np.zeros(len(places))
    for number, a, b in segments(view, points, spans):
        (ax, ay, ae, ah), (bx, by, be, bh) = a, b
        length = np.hypot(bx - ax, by - ay)
        if not length:
            continue
        way = np.array([bx - ax, by - ay]) / length
        along, aside = (seen[:, :2] - (ax, ay)) @ way, (seen[:, :2] - (ax, ay)) @ (-way[1], way[0])
        t = np.clip(along / length, 0, 1)
        radius = ah + (bh - ah) * t
        wide = np.minimum(aside + reach, radius) - np.maximum(aside - reach, -radius)
        far = np.minimum(along + reach, length) - np.maximum(along - reach, 0)
        share = np.maximum(wide, 0) * np.maximum(far, 0) / (4 * reach**2)
        strand = strand_of[number]
        takes = (ae + (be - ae) * t > np.maximum(seen[:, 2], 0)) & (own != strand)
        steps -= UNIT * takes * np.log2(1 - np.minimum(opaque[strand] * share, DARKEST))
    return np.where(inside, 2 ** -np.minimum(steps / UNIT, DARK), 1)
