"""A meadow: blades of grass, and flowers among them."""

import numpy as np

from .animals import noise

POINTS = 8   # of a strand
KINDS = np.array([(.75, .05, .03), (.8, .6, .06), (.78, .76, .72), (.3, .16, .6)])   # colours of flowers
OFTEN = (.4, .2, .25, .15)
PETALS = 24
T = np.linspace(0, 1, POINTS)[:, None]


def far(depth):
    """How much wider strands are that far away [n, 1], so that few fill the distance."""
    return .9 + .25 * depth[:, None]


def grass(blades, random):
    """Strands [n, POINTS, 3], how far from the camera each is, and which way it leans."""
    depth = .8 * (45 / .8)**random.uniform(0, 1, blades)**.9                   # denser where it is near
    root = np.stack([random.uniform(-.75, .75, blades) * (depth + .6), 0 * depth, 3 - depth], 1)
    clump = noise(root, .5, 1)
    height = (.34 + .07 * clump) * random.uniform(.45, 1.15, blades)
    lean = np.stack([.35 + .3 * noise(root, 1.5, 2), 0 * clump, .2 * noise(root, .8, 3)], 1)
    lean += random.normal(0, .35, (blades, 3)) * (1, 0, 1)
    bend = .6 * T**2 * lean[:, None] - .3 * T**3 * (lean**2).sum(1)[:, None, None] * (0, 1, 0)
    return root[:, None] + height[:, None, None] * (T * (0, 1, 0) + bend), depth, lean


def flowers(count, blades, depth, lean, random):
    """(strands, colours, widths) of flowers where blades are: a stem, and petals that are strands, too."""
    where = random.choice(np.flatnonzero(depth > 1.7), count)
    root, wide = blades[where, 0], far(depth[where])
    around = 2 * np.pi * np.arange(PETALS) / PETALS
    petal = np.stack([np.cos(around), .55 + 0 * around, np.sin(around)], 1)[:, None] * T * .045 + (0, .01, 0) * (T * T)
    head = root + (0, 1, 0) * (.36 + .16 * random.uniform(0, 1, (count, 1))) + .1 * lean[where]
    stem = root[:, None] + T * (head - root)[:, None]
    petals = (head[:, None, None] + petal * random.uniform(.7, 1.4, (count, 1, 1, 1))).reshape(-1, POINTS, 3)
    kinds = KINDS[random.choice(4, count, p=OFTEN)]
    colors = np.concatenate([np.tile((.06, .13, .03), (count, POINTS, 1)),
                             np.repeat(np.repeat(kinds[:, None], PETALS, 0), POINTS, 1)])
    widths = np.concatenate([np.repeat(.0045 * wide, POINTS, 1),
                             np.repeat(.016 * wide, PETALS, 0) * np.array([.3, .7, 1, 1.1, 1.1, 1, .7, .2])])
    return np.concatenate([stem, petals]), colors, widths
