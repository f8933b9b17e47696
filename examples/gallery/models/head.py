"""A head and shoulders, and hair on it: guides that walk from the scalp, and strands in locks along them."""

import numpy as np

import clfur

from .animals import ball, both, cone, joined, surface

HEAD = joined(
    ball((0, .25, -.05), (.5, .56, .6)),
    ball((0, -.05, .2), (.37, .55, .36)),
    cone((0, -.4, .3), (0, -.45, .36), .17, .13),
    cone((0, .1, .53), (0, -.07, .63), .05, .075),
    ball((0, -.26, .53), (.12, .05, .06)),
    both(ball((.17, .12, .47), (.1, .06, .06))),
    both(ball((.47, .02, -.02), (.05, .13, .09))),
    cone((0, -.3, -.12), (0, -1.1, -.16), .25, .27),
    both(cone((.1, -1.12, -.16), (.8, -1.3, -.2), .24, .2)),
    ball((0, -1.6, -.15), (.75, .5, .36)), soft=.1)
POINTS, LENGTH = 56, 2.2   # of a strand


def mesh():
    """Head and shoulders."""
    places, normals, faces = surface(HEAD, (-1.1, -2.1, -1), (1.1, 1, 1))
    return clfur.Mesh(places, normals=normals, faces=faces)


def scalp():
    """Places [n, 3] where hair grows: above a hairline, and down the neck."""
    places, *_ = surface(HEAD, (-1, -.6, -1), (1, 1.1, 1), 60)
    _, y, z = places.T
    return places[(y - .05 - .72 * (z - .12) > 0) | ((z < -.1) & (y > -.3) & (z < -.5 * y - .1))]


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def outside(p, gap):
    """Places that are at least so far from the head, and the way up from it."""
    up = unit(np.stack([HEAD(p + e) - HEAD(p - e) for e in .01 * np.eye(3)], -1))
    return p + np.maximum(gap - HEAD(p), 0)[:, None] * up, up


def guides(roots, random):
    """Strands [n, POINTS, 3]: away from a parting on the left, over the head, and down."""
    line, layer = [roots], random.uniform(0, 1, len(roots))
    side = np.where(roots[:, 0] > .13, 1, -1)
    way = unit(np.stack([side * .6, np.full(len(roots), .3), -.55 - .2 * roots[:, 2]], -1))
    for step in range(1, POINTS):
        t = step / POINTS
        place = line[-1] + LENGTH / POINTS * way
        place, up = outside(place, .02 + .07 * min(8 * t, 1) * (.4 + layer))
        line.append(place)
        way = unit(.7 * way + .3 * np.array([0, -1, -.12]) + .05 * up)
        way = unit(place - line[-2]) * .5 + way * .5
    return np.stack(line, 1)


def locks(strands, count, random):
    """Strands [n, POINTS, 3] in so many locks, and which lock each is of: they wind round the nearest guide."""
    where = scalp()
    first = where[random.choice(len(where), count, replace=len(where) < count)]
    line = guides(first, random)
    roots, _ = outside(where[random.integers(0, len(where), strands)] + random.normal(0, .014, (strands, 3)), 0)
    of = np.concatenate([((some[:, None] - first)**2).sum(-1).argmin(1) for some in np.array_split(roots, 50)])
    t = np.linspace(0, 1, POINTS)
    apart = (roots - first[of])[:, None] * (1 - .8 * t**.7)[:, None]
    phase = random.uniform(0, 6.28, (count, 2))[of] + random.normal(0, .25, (strands, 2))
    turn = 2 * np.pi * t * random.uniform(2.4, 3.4, count)[of][:, None]
    round_it = np.stack([np.sin(turn + phase[:, :1]), .3 * np.sin(turn), np.cos(turn + phase[:, 1:])], -1)
    wave = (.05 * t**.8)[:, None] * round_it
    frizz = random.normal(0, .02, (strands, 1, 3)) * t[:, None] * random.uniform(0, 1.4, (strands, 1, 1))**3
    return line[of] + apart + wave + frizz, of
