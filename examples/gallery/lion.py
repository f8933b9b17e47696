"""A lion, after figure 9 of the report that clfur follows: a type map says where mane, tail and coat grow."""

from pathlib import Path

import attrs
import numpy as np
import studio
from animals import animal, away_from, ball, both, cone, eyes, joined, spot

import clfur

behind = studio.backdrop((.27, .17, .1))
settings = studio.FINE
BODY = joined(
    ball((0, .72, -.15), (.42, .52, .52)), ball((0, 1.0, .12), (.38, .45, .36)),
    both(ball((.34, .34, -.2), (.24, .34, .42))),
    both(cone((.2, .8, .25), (.19, .08, .5), .15, .13)), both(ball((.19, .08, .6), (.15, .09, .19))),
    both(ball((.38, .08, .2), (.14, .09, .22))),
    ball((0, 1.5, .32), (.38, .38, .36)), ball((0, 1.36, .62), (.2, .16, .2)),
    both(ball((.31, 1.84, .22), (.12, .12, .05), (-10, 20, -25))),
    cone((0, .2, -.6), (.8, .1, -.45), .08, .06), cone((.8, .1, -.45), (1.12, .16, -.1), .06, .05), soft=.11)
FACE = eyes((.165, 1.54, .615), .062, (.5, .27, .05), .4) + [((0, 1.43, .82), (.075, .05, .04), (.12, .05, .045))]


def kind(p):
    """0 coat, .5 mane, 1 the end of the tail."""
    head, face = p - (0, 1.48, .3), p[:, 2] > .45 - .5 * np.maximum(abs(p[:, 0]) - .2, 0)
    mane = (np.linalg.norm(head * (1, .8, 1), axis=1) < .62) & ~face & (p[:, 1] > .92)
    ears = (abs(p[:, 0]) > .24) & (p[:, 1] > 1.76)
    return np.where((p[:, 0] > .95) & (p[:, 2] > -.35), 1, np.where(mane & ~ears, .5, 0))


def length(p):
    crown = (p[:, 1] > .9) & (p[:, 2] < .5)
    return .6 + .4 * crown - .45 * spot(p, (0, 1.42, .7), (.32, .3, .28)) - .35 * spot(p, (0, 1.9, .3), (.4, .25, .5))


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-1, -.1, -1), (1.3, 2.2, 1.1), (.3, .19, .09), FACE,
                              lambda p: spot(p, (0, 1.3, .75), (.16, .12, .2)), length, kind)
    hair = clfur.HairType(alpha=.15, look=clfur.Chiang(), tip_width=.1, length_variation=.35, direction_variation=.25,
                          color_variation=.2, stiffness=1.2)
    coat = attrs.evolve(hair, key=(0, 255, 0), color=(1, 1, 1), length=.1, segments=7, width=.003,
                        color_texture=[[(.3, .15, .04), (.4, .25, .1), (.75, .62, .45)]])
    mane = attrs.evolve(hair, key=(255, 0, 0), color=(.022, .006, .0014), root_color=(.014, .004, .001), length=.52,
                        tip_color=(.09, .03, .006), segments=20, width=.0042, wave=(.012, 2),
                        tufts=clfur.Tufts(900, strength=.7))
    tail = attrs.evolve(hair, key=(0, 0, 255), color=(.015, .006, .003), length=.45, segments=14, width=.004,
                        tufts=clfur.Tufts(900))
    rows = np.array([[tail.key]] * 5 + [[mane.key]] * 3 + [[coat.key]] * 3, np.uint8)   # v: .1 coat, .35 mane, .6 tail
    fur = clfur.Strands(inner=1, outer=1, types=[coat, mane, tail], type_map=rows, roots=190_000, maps=maps,
                        force=(0, -.5, 0), comb=clfur.Comb(away_from((0, 1.5, .8), .35), .6))
    return studio.stage(mesh, fur, (1.9, 1.6, 4.8), (.1, 1.05, 0), size, body, fov=30.5)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "lion.png", settings, behind)


if __name__ == "__main__":
    main()
