"""A sheep, and where on it what is: its type map is white, black on head and legs."""

from .animals import Animal, ball, both, cone, eyes, joined, rows

SHAPE = joined(
    ball((0, .98, -.1), (.56, .5, .8)),
    ball((0, 1.1, .45), (.36, .38, .3)),
    cone((0, 1.32, .62), (0, 1.22, 1.02), .2, .13),
    ball((0, 1.5, .56), (.2, .14, .18)),
    both(ball((.32, 1.4, .6), (.2, .065, .09), (0, 15, -18))),
    both(cone((.27, .7, .3), (.27, .06, .32), .12, .085)),
    both(cone((.27, .7, -.5), (.27, .06, -.55), .12, .085)), soft=.08)
NOSE = ((0, 1.22, 1.14), (.06, .035, .02), (.02, .015, .015))


def black(p):
    """Head, ears and legs."""
    head = (p[:, 2] > .62) & (p[:, 1] < 1.48) & (p[:, 1] > 1.0) & (abs(p[:, 0]) < .26)
    ears = (abs(p[:, 0]) > .22) & (p[:, 1] > 1.2) & (p[:, 2] > .4)
    return (head | ears | (p[:, 1] < .5)) * 1.


SHEEP = Animal(SHAPE, (-.8, -.1, -1.1), (.8, 1.8, 1.3), kind=black,
               type_map=rows((255, 255, 255), (0, 0, 0), (255, 255, 255)),
               bare=[*eyes((.165, 1.33, .8), .05, (.5, .35, .1), .9, (1, .1, .6)), NOSE])
