"""A chick, and where on it what is."""

from .animals import Animal, area, ball, both, cone, eyes, joined

SHAPE = joined(
    ball((0, .72, -.05), (.5, .46, .54)),
    ball((0, 1.24, .2), (.36, .34, .34)),
    both(ball((.46, .78, -.1), (.1, .26, .32), (0, 8, 0))),
    cone((0, .85, -.5), (0, 1.02, -.75), .12, .05), soft=.16)
YELLOW = (.75, .3, .07)
TOES = [((x, .02, .25 + .1 * z), (.028, .025, .1), YELLOW)
        for side in (-.2, .2) for x, z in ((side, .6), (side - .08, .3), (side + .08, .3))]
SHANKS = [((x, .15, .14), (.035, .17, .035), YELLOW) for x in (-.2, .2)]
BEAK = [((0, 1.2, .56), (.075, .035, .13), (.85, .36, .06)), ((0, 1.165, .53), (.06, .025, .1), (.6, .22, .04))]
CHICK = Animal(SHAPE, (-.8, 0, -1), (.8, 1.8, .8),
               bare=[*TOES, *SHANKS, *BEAK, *eyes((.2, 1.3, .44), .06, (.01, .008, .006), .8, (.7, .1, 1))])
head, face = area((0, 1.25, .2), (.4, .4, .5)), area((0, 1.24, .5), (.3, .16, .3))
eye, cheeks = area((.22, 1.3, .46), (.12, .12, .14)), area((.2, 1.2, .5), (.2, .2, .2))
belly = area((0, .55, .4), (.5, .4, .5))
