"""Human hair from strands of one's own: guides that walk over a head, and 70,000 strands in locks along them."""

from pathlib import Path

import numpy as np
import studio
from animals import ball, both, cone, joined, surface

import clfur

behind = studio.backdrop((.16, .17, .21))
settings = studio.FINE
HEAD = joined(
    ball((0, .25, -.05), (.5, .56, .6)), ball((0, -.05, .2), (.37, .55, .36)), cone((0, -.4, .3), (0, -.45, .36), .17,
                                                                                    .13),
    cone((0, .1, .53), (0, -.07, .63), .05, .075), ball((0, -.26, .53), (.12, .05, .06)),
    both(ball((.17, .12, .47), (.1, .06, .06))),
    both(ball((.47, .02, -.02), (.05, .13, .09))), cone((0, -.3, -.12), (0, -1.1, -.16), .25, .27),
    both(cone((.1, -1.12, -.16), (.8, -1.3, -.2), .24, .2)),
    ball((0, -1.6, -.15), (.75, .5, .36)), soft=.1)
STEPS, LENGTH = 56, 2.2


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def outside(p, gap):
    """Places that are at least so far from the head, and the way up from it."""
    up = unit(np.stack([HEAD(p + e) - HEAD(p - e) for e in .01 * np.eye(3)], -1))
    return p + np.maximum(gap - HEAD(p), 0)[:, None] * up, up


def locks(roots, random):
    """Guides [n, STEPS, 3]: away from a parting on the left, over the head, and down."""
    line, layer = [roots], random.uniform(0, 1, len(roots))
    side = np.where(roots[:, 0] > .13, 1, -1)
    way = unit(np.stack([side * .6, np.full(len(roots), .3), -.55 - .2 * roots[:, 2]], -1))
    for step in range(1, STEPS):
        t = step / STEPS
        place = line[-1] + LENGTH / STEPS * way
        place, up = outside(place, .02 + .07 * min(8 * t, 1) * (.4 + layer))
        line.append(place)
        way = unit(.7 * way + .3 * np.array([0, -1, -.12]) + .05 * up)
        way = unit(place - line[-2]) * .5 + way * .5
    return np.stack(line, 1)


def hair(strands=70_000, guides=420):
    random = np.random.default_rng(2)
    places, *_ = surface(HEAD, (-1, -.6, -1), (1, 1.1, 1), 60)
    hairline = places[:, 1] - .05 - .72 * (places[:, 2] - .12)
    scalp = places[(hairline > 0) | ((places[:, 2] < -.1) & (places[:, 1] > -.3) & (places[:, 2] < -.5 * places[:, 1]
                                                                                    - .1))]
    first = scalp[random.choice(len(scalp), guides, replace=len(scalp) < guides)]
    line = locks(first, random)
    roots, _ = outside(scalp[random.integers(0, len(scalp), strands)] + random.normal(0, .014, (strands, 3)), 0)
    of = np.concatenate([((some[:, None] - first)**2).sum(-1).argmin(1) for some in np.array_split(roots, 50)])
    t = np.linspace(0, 1, STEPS)
    apart = (roots - first[of])[:, None] * (1 - .8 * t**.7)[:, None]
    phase = random.uniform(0, 6.28, (guides, 2))[of] + random.normal(0, .25, (strands, 2))
    turn = 2 * np.pi * t * random.uniform(2.4, 3.4, guides)[of][:, None]
    wave = .05 * t[None]**.8 * np.stack([np.sin(turn + phase[:, :1]), .3 * np.sin(turn), np.cos(turn + phase[:, 1:])],
                                        0)
    frizz = random.normal(0, .02, (strands, 1, 3)) * t[:, None] * random.uniform(0, 1.4, (strands, 1, 1))**3
    points = line[of] + apart + np.moveaxis(wave, 0, -1) + frizz
    shade = random.uniform(.6, 1.35, (guides, 1))[of] * random.uniform(.8, 1.2, (strands, 1))
    color = shade[:, None] * (np.array([.16, .045, .012]) + t[:, None] * np.array([.2, .085, .03]))
    cut = random.integers(int(.75 * STEPS), STEPS + 1, strands)
    keep = np.arange(STEPS) < cut[:, None]
    width = .0042 * np.minimum(1, 4 * (1 - np.arange(STEPS) / cut[:, None]) + .05)
    return clfur.Curves(points[keep], counts=cut, width=width[keep], color=np.clip(color[keep], 0, 1),
                        look=clfur.Chiang(.25, .3), alpha=.15)


def scene(size=(800, 600), strands=70_000):
    places, normals, faces = surface(HEAD, (-1.1, -2.1, -1), (1.1, 1, 1))
    head = clfur.Mesh(places, normals=normals, faces=faces)
    return studio.stage(head, hair(strands), (-3.5, .35, 2.5), (-.08, -.36, -.11), size, (.5, .3, .21), 38, height=-4)


def main(folder=".", size=(800, 600), strands=70_000):
    studio.shoot(scene(size, strands), Path(folder) / "portrait.png", settings, behind)


if __name__ == "__main__":
    main()
