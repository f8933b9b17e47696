"""A shaggy dog: brown hair in tufts within tufts, paler at the tips, with the light behind it."""

from pathlib import Path

import studio
from animals import animal, away_from, ball, both, cone, eyes, joined, spot

import clfur

behind = studio.backdrop((.24, .2, .17))
settings = studio.FINE
BODY = joined(
    ball((0, .62, 0), (.56, .6, .5)), ball((0, 1.0, .02), (.42, .4, .38)), both(cone((.42, 1.0, .1), (.5, .5, .42),
                                                                                     .17, .15)),
    both(cone((.34, .24, .2), (.46, .2, .68), .24, .17)), both(ball((.47, .23, .76), (.16, .2, .1))),
    ball((0, 1.56, .1), (.46, .42, .42)), ball((0, 1.44, .48), (.2, .16, .2)),
    both(ball((.4, 1.9, .06), (.2, .21, .08))), soft=.12)
FACE = eyes((.17, 1.62, .49), .078, (.02, .01, .006), .7) + [((0, 1.5, .67), (.075, .055, .05), (.012, .01, .01))]


def length(p):
    return (1 - .78 * spot(p, (0, 1.48, .6), (.3, .24, .32)) - .68 * spot(p, (.42, 1.98, .1), (.22, .22, .2))
            - .75 * spot(p, (.47, .2, .86), (.2, .22, .1)) - .55 * spot(p, (.17, 1.63, .52), (.17, .15, .2)))


def coat(p):
    return .15 + .8 * spot(p, (0, 1.42, .6), (.22, .2, .25)) + .35 * spot(p, (0, .7, .5), (.3, .35, .3))


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-.9, -.1, -.7), (.9, 2.2, 1.1), (.09, .05, .03), FACE, coat, length)
    hair = clfur.HairType(
        color=(1, 1, 1), color_texture=[[(.075, .03, .012), (.16, .075, .03), (.42, .27, .13)]], root_color=(.5, .45,
                                                                                                             .4),
        tip_color=(1.5, 1.4, 1.25), alpha=.15, look=clfur.Chiang(azimuthal_roughness=.35), length=.22, stiffness=1,
        segments=14,
        width=.004, tip_width=.1, length_variation=.4, direction_variation=.3, color_variation=.2,
        tufts=clfur.Tufts(3500, strength=.65, within=clfur.Tufts(500)), frizz=(.006, 3))
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=170_000, maps=maps, force=(0, -.7, 0),
                        comb=clfur.Comb(away_from((0, 1.5, .9), .6), .6))
    return studio.stage(mesh, fur, (-1.5, 1.5, 4.6), (0, 1.02, .1), size, body, fov=31)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "dog.png", settings, behind)


if __name__ == "__main__":
    main()
