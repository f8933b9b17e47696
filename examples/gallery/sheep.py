"""A sheep: wool in curls that tufts share, a black face and legs of short hair, by a type map."""

from pathlib import Path

import numpy as np
import studio
from animals import animal, ball, both, cone, eyes, joined

import clfur

behind = studio.backdrop((.1, .15, .25))
settings = studio.FINE
BODY = joined(
    ball((0, .98, -.1), (.56, .5, .8)), ball((0, 1.1, .45), (.36, .38, .3)), cone((0, 1.32, .62), (0, 1.22, 1.02), .2,
                                                                                  .13),
    ball((0, 1.5, .56), (.2, .14, .18)), both(ball((.32, 1.4, .6), (.2, .065, .09), (0, 15, -18))),
    both(cone((.27, .7, .3), (.27, .06, .32), .12, .085)), both(cone((.27, .7, -.5), (.27, .06, -.55), .12, .085)),
    soft=.08)
FACE = eyes((.165, 1.33, .8), .05, (.5, .35, .1), .9, (1, .1, .6)) + [((0, 1.22, 1.14), (.06, .035, .02),
                                                                       (.02, .015, .015))]


def black(p):
    head = (p[:, 2] > .62) & (p[:, 1] < 1.48) & (p[:, 1] > 1.0) & (abs(p[:, 0]) < .26)
    ears = (abs(p[:, 0]) > .22) & (p[:, 1] > 1.2) & (p[:, 2] > .4)
    return (head | ears | (p[:, 1] < .5)) * 1.


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-.8, -.1, -1.1), (.8, 1.8, 1.3), (.008, .007, .006), FACE, kind=black)
    wool = clfur.HairType(
        key=(255, 255, 255), color=(.6, .5, .37), alpha=.15, look=clfur.Chiang(azimuthal_roughness=.5), length=.36,
        stiffness=2, segments=36,
        width=.0042, tip_width=.4, length_variation=.3, direction_variation=.3, color_variation=.12, curl=(.024, 4),
        tufts=clfur.Tufts(1500, strength=.9, profile=.6), frizz=(.006, 6))
    short = clfur.HairType(
        key=(0, 0, 0), color=(.006, .005, .005), alpha=.15, look=clfur.Chiang(), length=.05, stiffness=.5, segments=5,
        width=.003,
        tip_width=.1, length_variation=.3, direction_variation=.2, color_variation=.3)
    rows = np.array([[(255, 255, 255)], [(0, 0, 0)], [(255, 255, 255)]], np.uint8)   # v of animals: .1 wool, .6 black
    fur = clfur.Strands(inner=1, outer=1, types=[wool, short], type_map=rows, roots=110_000, maps=maps,
                        force=(0, -.3, 0))
    return studio.stage(mesh, fur, (3.1, 1.75, 4.1), (0, .88, .05), size, body, fov=30)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "sheep.png", settings, behind)


if __name__ == "__main__":
    main()
