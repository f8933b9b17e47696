"""A hedgehog: spines, wide and banded, on its back, and soft hair on face and belly."""

from pathlib import Path

import numpy as np
import studio
from animals import animal, away_from, ball, both, cone, eyes, joined, spot

import clfur

behind = studio.backdrop((.22, .13, .07))
settings = studio.FINE
BODY = joined(ball((0, .46, -.1), (.52, .44, .66)), ball((0, .4, .42), (.34, .32, .34)), cone((0, .38, .6),
                                                                                              (0, .33, .95), .2, .06),
              both(ball((.24, .6, .5), (.11, .11, .04), (0, 20, 0))), both(cone((.25, .2, .42), (.25, .04, .5), .1,
                                                                                .07)),
              both(cone((.3, .2, -.4), (.32, .04, -.36), .11, .08)), soft=.12)
FACE = eyes((.155, .48, .7), .06, (.01, .008, .008), .8, (.8, .3, .7)) + [((0, .345, 1.03), (.05, .045, .045),
                                                                           (.012, .011, .012))]


def soft(p):
    return np.clip(4 * (p[:, 2] - .28 + .8 * np.maximum(.28 - p[:, 1], 0) - .55 * np.maximum(p[:, 1] - .5, 0))
                   + (p[:, 1] < .2), 0, 1) > .5


def length(p):
    return .8 - .62 * spot(p, (0, .4, .9), (.3, .3, .35)) - .5 * spot(p, (.16, .48, .72), (.11, .11, .11))


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-.8, -.1, -1), (.8, 1.1, 1.2), (.05, .03, .02), FACE, length=length, kind=soft)
    spine = clfur.HairType(
        key=(255, 255, 255), color=(.02, .01, .005), root_color=(.008, .004, .002), tip_color=(.34, .22, .1),
        length=.34, stiffness=8,
        segments=6, width=.023, tip_width=.06, taper=.2, length_variation=.25, direction_variation=.4,
        color_variation=.25, alpha=.1,
        look=clfur.Chiang(.25, .4))
    hair = clfur.HairType(
        key=(0, 0, 0), color=(.11, .055, .022), tip_color=(.22, .12, .055), length=.18, stiffness=.7, segments=8,
        width=.0034,
        tip_width=.1, length_variation=.4, direction_variation=.3, color_variation=.2, alpha=.15, look=clfur.Chiang())
    rows = np.array([[(0, 0, 0)], [(0, 0, 0)], [(255, 255, 255)]], np.uint8)   # v of animals: .1 spines, .6 hair
    fur = clfur.Strands(inner=1, outer=1, types=[spine, hair], type_map=rows, roots=45_000, maps=maps,
                        force=(0, -.2, -.3),
                        comb=clfur.Comb(away_from((0, .3, 1.2), .2), .5))
    return studio.stage(mesh, fur, (2.2, 1.15, 3.2), (0, .48, 0), size, body, fov=27, rim=.6)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "hedgehog.png", settings, behind)


if __name__ == "__main__":
    main()
