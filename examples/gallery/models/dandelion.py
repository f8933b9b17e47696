"""A dandelion clock: the strands of it."""

import numpy as np

HAIRS, POINTS = 56, 9                        # of a parachute; of a strand
GRAIN, STALK, HAIR, GREEN = range(4)         # kinds of strands
BLOWN = [(.78, .36, .2), (1.05, .62, -.1), (.62, .72, .3), (1.32, .3, 0), (1.4, .78, -.3), (.98, .1, .1)]


def unit(a):
    return a / np.linalg.norm(a)


def seed(center, way, reach, random):
    """Strands [n, POINTS, 3] of one seed: its grain, its stalk, and the hairs at the end of it."""
    aside = np.linalg.svd(way[None])[2][1:]
    t = np.linspace(0, 1, POINTS)[:, None]
    stalk, grain = center + reach * way * (.12 + .88 * t), center + reach * way * (-.04 + .2 * t)
    turn = random.uniform(0, 2 * np.pi, HAIRS)
    out = np.cos(turn)[:, None] * aside[0] + np.sin(turn)[:, None] * aside[1]
    rise = random.uniform(.08, .4, (HAIRS, 1))
    end = .2 * random.uniform(.75, 1.1, (HAIRS, 1)) * (out + rise * way) / np.sqrt(1 + rise**2)
    hairs = stalk[-1] + end[:, None] * t + .03 * way * (t * (1 - t))
    return np.concatenate([grain[None], stalk[None], hairs])


def clock(seeds=150):
    """Strands [n, POINTS, 3], and of what kind each is: seeds on a head, without those that the wind has taken."""
    random, strands = np.random.default_rng(4), []
    k = np.arange(seeds) + .5
    y, turn = 1 - 2 * k / seeds, 2.399963 * k
    ways = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], 1)
    for way in map(unit, ways + random.normal(0, .05, ways.shape)):
        gone = way @ (.75, .6, .25) + random.normal(0, .12) > .72
        if way[1] > -.93 and not gone:
            strands.append(seed(.07 * way, way, .5 * random.uniform(.93, 1.05), random))
    for place in BLOWN:
        strands.append(seed(np.array(place), unit(np.array([.45, .8, .1]) + random.normal(0, .25, 3)), .4, random))
    t = np.linspace(0, 1, POINTS)[:, None]
    stem = np.array([[.02, -.05, 0]]) + t * (-.22, -1.6, 0) + .12 * t * (1 - t) * (1, 0, 0)
    stems = stem + .025 * np.array([(np.cos(a), 0, np.sin(a)) for a in np.arange(40)])[:, None]
    core = np.array([[w * .09 * s for s in np.linspace(.1, 1, POINTS)] for w in ways])
    kinds = [GRAIN, STALK, *[HAIR] * HAIRS] * len(strands) + [GREEN] * (len(stems) + len(core))
    return np.concatenate([*strands, stems, core]), np.array(kinds)
