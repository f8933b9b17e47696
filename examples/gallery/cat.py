"""A ginger cat: stripes and white paws by a palette along u; hair that is short on the face and long on the cheeks."""

from pathlib import Path

import numpy as np
import studio
from animals import animal, away_from, ball, both, cone, eyes, joined, noise, spot

import clfur

behind = studio.backdrop((.1, .17, .15))
settings = studio.FINE
BODY = joined(
    ball((0, .62, -.1), (.47, .58, .52)), ball((0, 1.0, .12), (.34, .42, .34)),
    both(ball((.34, .34, -.05), (.25, .34, .44))), both(cone((.18, .75, .28), (.17, .1, .5), .14, .11)),
    both(ball((.17, .08, .56), (.13, .09, .17))), both(ball((.36, .08, .36), (.13, .09, .2))),
    ball((0, 1.54, .3), (.45, .38, .38)), both(ball((.13, 1.39, .6), (.14, .11, .12))),
    ball((0, 1.3, .57), (.1, .07, .1)),
    both(ball((.3, 1.94, .22), (.17, .24, .055), (-12, 24, -24))), cone((-.3, .13, -.5), (-.85, .12, .1), .12, .1),
    soft=.13)
FACE = eyes((.185, 1.58, .585), .095, (.35, .42, .06), pupil=.55)
FACE += [((0, 1.46, .72), (.05, .035, .035), (.35, .13, .11))]


def coat(p):
    stripes = np.sin(15 * (p[:, 2] + .5 * p[:, 1]) + 1.6 * noise(p, .5) + 10 * abs(p[:, 0]) * (p[:, 1] > 1.3))
    white = spot(p, (0, .85, .5), (.15, .4, .2)) + spot(p, (0, 1.33, .68), (.17, .12, .2)) + (p[:, 1] < .13)
    return .6 + .4 * np.clip(2.5 * stripes, -1, 1) - white


def length(p):
    ears, eye = spot(p, (.32, 2.02, .25), (.2, .22, .2)), spot(p, (.2, 1.57, .65), (.17, .14, .2))
    return .55 - .45 * spot(p, (0, 1.45, .7), (.28, .25, .3)) - .42 * ears - .3 * eye + .25 * spot(p, (.42, 1.4, .25),
                                                                                                   (.2, .2, .3))


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-1.1, -.1, -.9), (1.1, 2.3, 1), (.3, .14, .06), FACE, coat, length)
    colors = np.array([(.74, .66, .55), (.5, .25, .08), (.34, .12, .018), (.3, .1, .013), (.07, .013, .002),
                       (.05, .009, .0015)])
    hair = clfur.HairType(
        color=(1, 1, 1), color_texture=colors[None], alpha=.15, look=clfur.Chiang(), length=.17, stiffness=1,
        segments=10, width=.0035,
        tip_width=.1, length_variation=.35, direction_variation=.25, color_variation=.12, tufts=clfur.Tufts(5000,
                                                                                                            strength=.5))
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=200_000, maps=maps, force=(0, -.4, 0),
                        comb=clfur.Comb(away_from((0, 1.5, .9)), .68))
    return studio.stage(mesh, fur, (1.5, 1.75, 4.6), (-.05, 1.02, 0), size, body)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "cat.png", settings, behind)


if __name__ == "__main__":
    main()
