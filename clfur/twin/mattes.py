"""What cl/mattes.cl means, in float64: whose pieces of strands are seen in pixels, and which way they lie."""

import numpy as np

from .coverage import fragments, resolve
from .vectors import f64


def twice_the_angle(view, a, b):
    """(cosine, sine) of twice the angle of segments on the screen, from x to the right, against the clock: [n, 2].

    a, b: [n, 3] their ends in the world, all before the eye.
    """
    ends = [np.c_[f64(p)[:, :3], np.ones(len(p))] @ f64(view["to_screen"]) for p in (a, b)]
    way = np.subtract(*[(x + 1j * y) / w for x, y, _, w in (end.T for end in ends)])
    turn = np.conj(way) ** 2
    turn = np.where(turn == 0, 0, turn / np.where(turn == 0, 1, np.abs(turn)))
    return np.stack([turn.real, turn.imag], 1)


def shares(view, points, spans, visible):
    """{(y, x): ({strand: share of the pixel's light}, the body's share)} of pixels in which strands are.

    view: a `View` struct.  points [P, 4] x, y, z, width; spans [strands, 2] first point, points.  visible:
    [rows, width, samples] keys of the body.
    """
    owner = np.repeat(np.arange(len(spans)), np.asarray(spans)[:, 1])
    pixels = {}
    for y, x, depth, number, share in fragments(view, points, spans):
        pixels.setdefault((y, x), {})[int(depth) << 32 | number] = share
    found = {}
    for (y, x), pieces in pixels.items():
        hidden, of_strands = resolve(pieces, [int(key) for key in visible[y, x]]), {}
        for key, weight in hidden["weights"].items():
            strand = int(owner[key & 0xFFFFFFFF])
            of_strands[strand] = of_strands.get(strand, 0.0) + weight
        found[y, x] = of_strands, hidden["body"]
    return found
