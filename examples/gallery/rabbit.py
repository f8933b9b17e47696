"""A rabbit, from behind, in both furs: an undercoat of shells and longer hair over it."""

import studio
from models.rabbit import RABBIT, ears, face, rump, tail

import clfur


@studio.picture(studio.backdrop((.2, .19, .13)), settings=clfur.Settings(masks=4, grid=160))
def rabbit(size):
    mesh, maps, body = RABBIT.build(
        skin=(.2, .14, .1), coat=rump, length=lambda p: 1 - .66 * face(p) - .6 * ears(p) + .4 * tail(p))
    under = clfur.Shells(length=.03, layers=24, hairs=60_000, density=.9, color=(.2, .12, .07), root_shade=.4)
    guard = clfur.HairType(color=(1, 1, 1), color_texture=[[(.22, .105, .042), (.3, .16, .07), (.9, .85, .78)]],
                           root_color=(.3, .3, .3), tip_color=(1.4, 1.35, 1.3), alpha=.2, specular=.12, length=.17,
                           stiffness=1, segments=9, width=.003, tip_width=.1, length_variation=.4,
                           direction_variation=.3, color_variation=.3, tufts=clfur.Tufts(5000, strength=.5))
    over = clfur.Strands(inner=1, outer=1, types=guard, roots=150_000, maps=maps, force=(0, -.4, 0),
                         comb=clfur.Comb(RABBIT.backwards(.3), .7))
    return studio.stage(mesh, [under, over], (2.4, 1.45, -4.3), (0, .97, -.05), size, body, fov=32)


if __name__ == "__main__":
    rabbit()
