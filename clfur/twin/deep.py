"""What cl/deep.cl and cl/deep.h mean, in float64: pieces of ribbons in a light's texels, and what they let through."""

import numpy as np

from .coverage import DEPTH_ONE, fragments
from .vectors import f64

LAST = (1 << 23) - 1      # the most depth of a piece
UNIT = 1024               # steps of its opacity an octave
DARKEST = 1 - 1 / 256     # share of light that one piece takes at most


def pieces(view, packed, points, spans, opaque):
    """{(y, x): [(depth, strand, opacity in steps)]} of a map.

    view, packed: a `View` and a `Deep` struct.  points [P, 4] x, y, z, width; spans [strands, 2]; opaque: [strands] the
    share of light that one takes which fills a texel.
    """
    a, b, over, _ = f64(packed["depth"])
    strand_of = np.repeat(np.arange(len(spans)), np.asarray(spans, np.int64)[:, 1])
    found = {}
    for y, x, depth, number, share in fragments(view, points, spans):
        e, strand = 1 - depth / DEPTH_ONE, int(strand_of[number])
        steps = -UNIT * np.log2(1 - min(opaque[strand] * share, DARKEST))
        found.setdefault((y, x), []).append((min(max(a + (b / e if over else b * e), 0), LAST), strand, steps))
    return found


def through(packed, found, places, own):
    """Share of light that gets through pieces, as `pieces` gives, to places [n, 3] of strands ``own`` -> [n] 0..1.

    Four texels around each are averaged, bilinearly, each with the product of what lies nearer to the light there.
    """
    size = int(packed["size"][0])
    c = np.c_[f64(places), np.ones(len(places))] @ f64(packed["to_map"])
    result = np.ones(len(c))
    for i, (x, y, depth, w) in enumerate(c):
        if w <= 0:
            continue
        x, y = x / w - 0.5, y / w - 0.5
        left, top = int(np.floor(x)), int(np.floor(y))
        result[i] = 0
        for tx, ty in ((left, top), (left + 1, top), (left, top + 1), (left + 1, top + 1)):
            inside = 0 <= tx < size and 0 <= ty < size
            steps = sum(each for before, strand, each in found.get((ty, tx), []) if before < depth and strand != own[i])
            result[i] += (1 - abs(x - tx)) * (1 - abs(y - ty)) * 2 ** (-steps / UNIT * inside)
    return result
