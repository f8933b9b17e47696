"""A cat that sits, and where on it what is."""

import numpy as np

from .animals import Animal, area, ball, both, cone, eyes, joined, noise

SHAPE = joined(
    ball((0, .62, -.1), (.47, .58, .52)),
    ball((0, 1.0, .12), (.34, .42, .34)),
    both(ball((.34, .34, -.05), (.25, .34, .44))),
    both(cone((.18, .75, .28), (.17, .1, .5), .14, .11)),
    both(ball((.17, .08, .56), (.13, .09, .17))),
    both(ball((.36, .08, .36), (.13, .09, .2))),
    ball((0, 1.54, .3), (.45, .38, .38)),
    both(ball((.13, 1.39, .6), (.14, .11, .12))),
    ball((0, 1.3, .57), (.1, .07, .1)),
    both(ball((.3, 1.94, .22), (.17, .24, .055), (-12, 24, -24))),
    cone((-.3, .13, -.5), (-.85, .12, .1), .12, .1), soft=.13)
NOSE = ((0, 1.46, .72), (.05, .035, .035), (.35, .13, .11))
CAT = Animal(SHAPE, (-1.1, -.1, -.9), (1.1, 2.3, 1), front=(0, 1.5, .9),
             bare=[*eyes((.185, 1.58, .585), .095, (.35, .42, .06), pupil=.55), NOSE])
face, muzzle = area((0, 1.45, .7), (.28, .25, .3)), area((0, 1.33, .68), (.17, .12, .2))
ears, eye = area((.32, 2.02, .25), (.2, .22, .2)), area((.2, 1.57, .65), (.17, .14, .2))
cheeks, chest = area((.42, 1.4, .25), (.2, .2, .3)), area((0, .85, .5), (.15, .4, .2))


def white(p):
    """Chest, muzzle and paws."""
    return chest(p) + muzzle(p) + (p[:, 1] < .13)


def stripes(p):
    """-1 to 1."""
    waves = np.sin(15 * (p[:, 2] + .5 * p[:, 1]) + 1.6 * noise(p, .5) + 10 * abs(p[:, 0]) * (p[:, 1] > 1.3))
    return np.clip(2.5 * waves, -1, 1)
