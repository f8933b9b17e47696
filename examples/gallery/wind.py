"""A troll in gusts of wind: long hair that moves, with the hair around it and over the head below it."""

from pathlib import Path

import numpy as np
import studio
from animals import animal, ball, both, cone, eyes, joined

import clfur

behind = studio.backdrop((.12, .14, .2))
settings = clfur.Settings(scattering="grid")
BODY = joined(ball((0, .9, 0), (.5, .46, .46)), ball((0, .35, 0), (.36, .36, .3)),
              both(ball((.5, .86, -.02), (.07, .15, .12), (0, 0, -20))),
              both(cone((.3, .4, .05), (.52, .22, .18), .1, .08)), both(ball((.18, .06, .14), (.16, .08, .22))),
              ball((0, .8, .46), (.1, .08, .1)), ball((0, .68, .4), (.2, .03, .05)), soft=.08)
FACE = eyes((.17, .96, .39), .085, (.1, .3, .5), .6, (.2, .1, 1))
motion = {"hair": clfur.HairMotion(bend_length=.5, air=.25), "units_per_metre": 4, "hair_on_hair": .1,
          "wind": clfur.Wind((2.2, .2, -.4), gust=1.1, size=.5, skin=.02)}


def scene(size=(400, 400), roots=60_000):
    mesh, maps, body = animal(BODY, (-.8, -.1, -.7), (.8, 1.5, .8), (.5, .28, .18), FACE,
                              kind=lambda p: (p[:, 1] - .98 - .6 * p[:, 2] > 0) & (p[:, 1] > .9) & (abs(p[:, 0]) < .46))
    hair = clfur.HairType(
        key=(255, 255, 255), color=(.5, .05, .16), root_color=(.2, .02, .1), tip_color=(.85, .3, .12), alpha=.15,
        look=clfur.Chiang(), length=.8,
        stiffness=3, segments=12, width=.005, tip_width=.1, length_variation=.3, direction_variation=.35,
        color_variation=.2,
        tufts=clfur.Tufts(260, strength=.6))
    bald = clfur.HairType(key=(0, 0, 0), segments=0, look=clfur.Chiang())
    where = np.array([[(0, 0, 0)], [(255, 255, 255)], [(0, 0, 0)]], np.uint8)   # v of animals: .1 bald, .6 hair
    fur = clfur.Strands(inner=1, outer=1, types=[hair, bald], type_map=where, roots=roots, maps=maps,
                        force=(0, -.2, 0), collision=True)
    return studio.stage(mesh, fur, (-.8, 1.3, 4.3), (.1, .92, 0), size, body, fov=30, rim=.9)


def main(folder=".", size=(400, 400), frames=(24, 72), roots=60_000):
    clfur.film(scene(size, roots), Path(folder) / "wind.png", range(*frames), fps=24, motion=motion,
               settings=settings,
               background=(.05, .06, .085), overwrite=True)


if __name__ == "__main__":
    main()
