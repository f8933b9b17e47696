"""A troll in gusts of wind: long hair that moves, with the hair around it and over the head below it."""

import studio
from models.troll import TROLL

import clfur


@studio.film(clfur.Settings(scattering="grid"), (400, 400), frames=range(24, 72), fps=24, background=(.05, .06, .085),
             motion={"hair": clfur.HairMotion(bend_length=.5, air=.25), "units_per_metre": 4, "hair_on_hair": .1,
                     "wind": clfur.Wind((2.2, .2, -.4), gust=1.1, size=.5, skin=.02)})
def wind(size, roots=60_000):
    mesh, maps, body = TROLL.build(skin=(.5, .28, .18))
    hair = clfur.HairType(key=(255, 255, 255), color=(.5, .05, .16), root_color=(.2, .02, .1),
                          tip_color=(.85, .3, .12), alpha=.15, look=clfur.Chiang(), length=.8, stiffness=3,
                          segments=12, width=.005, tip_width=.1, length_variation=.3, direction_variation=.35,
                          color_variation=.2, tufts=clfur.Tufts(260, strength=.6))
    bald = clfur.HairType(key=(0, 0, 0), segments=0, look=clfur.Chiang())
    fur = clfur.Strands(inner=1, outer=1, types=[hair, bald], type_map=TROLL.type_map, roots=roots, maps=maps,
                        force=(0, -.2, 0), collision=True)
    return studio.stage(mesh, fur, (-.8, 1.3, 4.3), (.1, .92, 0), size, body, fov=30, rim=.9)


if __name__ == "__main__":
    wind()
