"""A seal pup on snow under a sky: white hair is white by the light that goes from hair to hair."""

from pathlib import Path

import studio
from animals import animal, away_from, ball, both, cone, eyes, joined, spot

import clfur

behind = studio.backdrop((.5, .62, .75), (.5, .3), .55)
settings = studio.FINE
BODY = joined(
    cone((0, .42, .15), (0, .22, -1.2), .43, .17), ball((0, .66, .5), (.38, .38, .38)), ball((0, .57, .8),
                                                                                             (.22, .16, .15)),
    both(cone((.38, .22, .25), (.72, .04, .38), .1, .07)), both(cone((.06, .16, -1.3), (.22, .07, -1.62), .09, .07)),
    soft=.16)
FACE = eyes((.17, .76, .79), .095, (.012, .01, .01), .8, (.4, .15, 1)) + [((0, .62, .945), (.075, .05, .045),
                                                                           (.02, .018, .02))]


def length(p):
    eye, nose = spot(p, (.18, .76, .8), (.15, .14, .15)), spot(p, (0, .62, .95), (.13, .1, .2))
    face, flipper = spot(p, (0, .64, .85), (.3, .24, .3)), spot(p, (.65, .05, .35), (.3, .15, .2))
    return 1 - .6 * face - .3 * nose - .45 * eye - .5 * flipper


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-1, -.1, -1.9), (1, 1.3, 1.2), (.7, .68, .66), FACE,
                              lambda p: spot(p, (0, .9, -.3), (.3, .3, .8)) + .6 * spot(p, (0, .95, .45),
                                                                                        (.2, .15, .2)), length)
    hair = clfur.HairType(
        color=(1, 1, 1), color_texture=[[(.86, .82, .76), (.75, .7, .65), (.5, .45, .4)]], alpha=.2,
        look=clfur.Chiang(azimuthal_roughness=.45), length=.16,
        stiffness=1, segments=9, width=.003, tip_width=.1, length_variation=.4, direction_variation=.35,
        color_variation=.1,
        tufts=clfur.Tufts(5000, strength=.55))
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=200_000, maps=maps, force=(0, -.4, 0),
                        comb=clfur.Comb(away_from((0, .6, 1.3), .1), .62))
    sky = clfur.Environment([(.3, .5, .85), (.62, .66, .72), (.5, .5, .5)], intensity=.42)
    return clfur.Scene(mesh, fur, clfur.Camera((1.7, 1.0, 3.6), (.02, .42, -.1), fov=26, size=size), body_color=body,
                       environment=sky,
                       light=clfur.Light((-.9, -.5, .35), color=(1, .85, .66), intensity=.45, size=3),
                       ground=clfur.Ground(height=0))


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "seal.png", settings, behind)


if __name__ == "__main__":
    main()
