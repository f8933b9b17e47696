"""A rabbit, from behind, in both furs: an undercoat of shells and longer hair over it."""

from pathlib import Path

import studio
from animals import animal, away_from, ball, both, cone, joined, spot

import clfur

behind = studio.backdrop((.2, .19, .13))
settings = clfur.Settings(masks=4, grid=160)
BODY = joined(
    ball((0, .55, -.2), (.46, .52, .62)), both(ball((.3, .36, -.3), (.28, .34, .4))), ball((0, .68, .25),
                                                                                           (.32, .38, .32)),
    both(cone((.16, .4, .5), (.14, .08, .62), .11, .09)), both(cone((.32, .08, -.2), (.3, .08, .3), .12, .1)),
    ball((0, 1.12, .42), (.31, .3, .36)), ball((0, 1.02, .7), (.19, .16, .14)), ball((0, .45, -.88), .17),
    both(cone((.13, 1.32, .32), (.24, 1.98, .12), .09, .1)), both(ball((.2, 1.75, .2), (.14, .36, .06),
                                                                       (-14, 12, -9))), soft=.12)


def length(p):
    return (1 - .66 * spot(p, (0, 1.08, .75), (.3, .25, .3)) - .6 * spot(p, (.2, 1.8, .2), (.25, .4, .2))
            + .4 * spot(p, (0, .45, -.95), (.2, .2, .2)))


def scene(size=(800, 600)):
    mesh, maps, body = animal(BODY, (-.8, -.1, -1.1), (.8, 2.3, 1), (.2, .14, .1),
                              coat=lambda p: spot(p, (0, .4, -1), (.24, .26, .25)), length=length)
    under = clfur.Shells(length=.03, layers=24, hairs=60_000, density=.9, color=(.2, .12, .07), root_shade=.4)
    guard = clfur.HairType(color=(1, 1, 1), color_texture=[[(.22, .105, .042), (.3, .16, .07), (.9, .85, .78)]],
                           root_color=(.3, .3, .3), tip_color=(1.4, 1.35, 1.3), length=.17, stiffness=1,
                           segments=9, width=.003, tip_width=.1, length_variation=.4, direction_variation=.3,
                           color_variation=.3, specular=.12, alpha=.2, tufts=clfur.Tufts(5000, strength=.5))
    fur = clfur.Strands(inner=1, outer=1, types=guard, roots=150_000, maps=maps, force=(0, -.4, 0),
                        comb=clfur.Comb(away_from((0, 1.1, 1.2), .3), .7))
    return studio.stage(mesh, [under, fur], (2.4, 1.45, -4.3), (0, .97, -.05), size, body, fov=32)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "rabbit.png", settings, behind)


if __name__ == "__main__":
    main()
