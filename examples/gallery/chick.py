"""A chick: down that stands off, so fine that the light from behind comes through."""

from pathlib import Path

import studio
from animals import animal, ball, both, cone, eyes, joined, spot

import clfur

behind = studio.backdrop((.13, .25, .32))
settings = studio.FINE
BODY = joined(ball((0, .72, -.05), (.5, .46, .54)), ball((0, 1.24, .2), (.36, .34, .34)),
              both(ball((.46, .78, -.1), (.1, .26, .32), (0, 8, 0))), cone((0, .85, -.5), (0, 1.02, -.75), .12, .05),
              soft=.16)
LEGS = [((x, .02, .25 + .1 * z), (.028, .025, .1), (.75, .3, .07)) for side in (-.2, .2) for x, z in (
    (side, .6), (side - .08, .3), (side + .08, .3))] + [((x, .15, .14), (.035, .17, .035), (.75, .3, .07))
                                                        for x in (-.2, .2)]
BEAK = [((0, 1.2, .56), (.075, .035, .13), (.85, .36, .06)), ((0, 1.165, .53), (.06, .025, .1), (.6, .22, .04))]
FACE = eyes((.2, 1.3, .44), .06, (.01, .008, .006), .8, (.7, .1, 1))


def length(p):
    eye, face = spot(p, (.22, 1.3, .46), (.12, .12, .14)), spot(p, (0, 1.24, .5), (.3, .16, .3))
    return 1 - .7 * face - .35 * spot(p, (0, 1.25, .2), (.4, .4, .5)) - .62 * eye


def coat(p):
    return .2 + .5 * spot(p, (0, .55, .4), (.5, .4, .5)) + .4 * spot(p, (.2, 1.2, .5), (.2, .2, .2))


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-.8, 0, -1), (.8, 1.8, .8), (.6, .36, .08), LEGS + BEAK + FACE, coat, length)
    down = clfur.HairType(
        color=(1, 1, 1), color_texture=[[(.72, .36, .035), (.8, .5, .09), (.84, .66, .26)]], alpha=.15,
        look=clfur.Chiang(azimuthal_roughness=.5),
        length=.2, stiffness=1.5, segments=10, width=.0032, tip_width=.1, length_variation=.5, direction_variation=.5,
        color_variation=.15, tufts=clfur.Tufts(9000, strength=.55, within=clfur.Tufts(900, strength=.4)),
        frizz=(.01, 2))
    fur = clfur.Strands(inner=1, outer=1, types=down, roots=190_000, maps=maps, force=(0, -.25, -.15))
    return studio.stage(mesh, fur, (1.6, 1.1, 3.6), (0, .82, 0), size, body, fov=32)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "chick.png", settings, behind)


if __name__ == "__main__":
    main()
