"""A hedgehog, and where on it what is: its type map is white on its back, black on face and belly."""

import numpy as np

from .animals import Animal, area, ball, both, cone, eyes, joined, rows

SHAPE = joined(
    ball((0, .46, -.1), (.52, .44, .66)),
    ball((0, .4, .42), (.34, .32, .34)),
    cone((0, .38, .6), (0, .33, .95), .2, .06),
    both(ball((.24, .6, .5), (.11, .11, .04), (0, 20, 0))),
    both(cone((.25, .2, .42), (.25, .04, .5), .1, .07)),
    both(cone((.3, .2, -.4), (.32, .04, -.36), .11, .08)), soft=.12)
NOSE = ((0, .345, 1.03), (.05, .045, .045), (.012, .011, .012))
face, eye = area((0, .4, .9), (.3, .3, .35)), area((.16, .48, .72), (.11, .11, .11))


def soft(p):
    """Face and belly."""
    return np.clip(4 * (p[:, 2] - .28 + .8 * np.maximum(.28 - p[:, 1], 0) - .55 * np.maximum(p[:, 1] - .5, 0))
                   + (p[:, 1] < .2), 0, 1) > .5


HEDGEHOG = Animal(SHAPE, (-.8, -.1, -1), (.8, 1.1, 1.2), front=(0, .3, 1.2), kind=soft,
                  type_map=rows((0, 0, 0), (0, 0, 0), (255, 255, 255)),
                  bare=[*eyes((.155, .48, .7), .06, (.01, .008, .008), .8, (.8, .3, .7)), NOSE])
