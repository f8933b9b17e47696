"""A lion that sits, and where on it what is: its type map is green, red where the mane is, blue at the tail's end."""

import numpy as np

from .animals import Animal, area, ball, both, cone, eyes, joined, rows

SHAPE = joined(
    ball((0, .72, -.15), (.42, .52, .52)),
    ball((0, 1.0, .12), (.38, .45, .36)),
    both(ball((.34, .34, -.2), (.24, .34, .42))),
    both(cone((.2, .8, .25), (.19, .08, .5), .15, .13)),
    both(ball((.19, .08, .6), (.15, .09, .19))),
    both(ball((.38, .08, .2), (.14, .09, .22))),
    ball((0, 1.5, .32), (.38, .38, .36)),
    ball((0, 1.36, .62), (.2, .16, .2)),
    both(ball((.31, 1.84, .22), (.12, .12, .05), (-10, 20, -25))),
    cone((0, .2, -.6), (.8, .1, -.45), .08, .06),
    cone((.8, .1, -.45), (1.12, .16, -.1), .06, .05), soft=.11)
NOSE = ((0, 1.43, .82), (.075, .05, .04), (.12, .05, .045))
GREEN, RED, BLUE = (0, 255, 0), (255, 0, 0), (0, 0, 255)
face, muzzle = area((0, 1.42, .7), (.32, .3, .28)), area((0, 1.3, .75), (.16, .12, .2))
ears = area((0, 1.9, .3), (.4, .25, .5))


def neck(p):
    """All that is above the chest, but for the face."""
    return (p[:, 1] > .9) & (p[:, 2] < .5)


def kind(p):
    """0 coat, .5 mane, 1 the end of the tail."""
    head, front = p - (0, 1.48, .3), p[:, 2] > .45 - .5 * np.maximum(abs(p[:, 0]) - .2, 0)
    mane = (np.linalg.norm(head * (1, .8, 1), axis=1) < .62) & ~front & (p[:, 1] > .92)
    bare = (abs(p[:, 0]) > .24) & (p[:, 1] > 1.76)
    return np.where((p[:, 0] > .95) & (p[:, 2] > -.35), 1, np.where(mane & ~bare, .5, 0))


LION = Animal(SHAPE, (-1, -.1, -1), (1.3, 2.2, 1.1), front=(0, 1.5, .8), kind=kind,
              type_map=rows(*[BLUE] * 5, *[RED] * 3, *[GREEN] * 3),
              bare=[*eyes((.165, 1.54, .615), .062, (.5, .27, .05), .4), NOSE])
