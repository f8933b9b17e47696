"""A troll: its type map is black, white where the head has hair."""

from .animals import Animal, ball, both, cone, eyes, joined, rows

SHAPE = joined(
    ball((0, .9, 0), (.5, .46, .46)),
    ball((0, .35, 0), (.36, .36, .3)),
    both(ball((.5, .86, -.02), (.07, .15, .12), (0, 0, -20))),
    both(cone((.3, .4, .05), (.52, .22, .18), .1, .08)),
    both(ball((.18, .06, .14), (.16, .08, .22))),
    ball((0, .8, .46), (.1, .08, .1)),
    ball((0, .68, .4), (.2, .03, .05)), soft=.08)


def scalp(p):
    """The top of the head, without ears."""
    return (p[:, 1] - .98 - .6 * p[:, 2] > 0) & (p[:, 1] > .9) & (abs(p[:, 0]) < .46)


TROLL = Animal(SHAPE, (-.8, -.1, -.7), (.8, 1.5, .8), kind=scalp,
               type_map=rows((0, 0, 0), (255, 255, 255), (0, 0, 0)),
               bare=eyes((.17, .96, .39), .085, (.1, .3, .5), .6, (.2, .1, 1)))
