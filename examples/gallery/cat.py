"""A ginger cat: stripes and white paws by a palette along u; hair that is short on the face and long on the cheeks."""

import studio
from models.cat import CAT, cheeks, ears, eye, face, stripes, white

import clfur

COLORS = [(.74, .66, .55), (.5, .25, .08), (.34, .12, .018), (.3, .1, .013), (.07, .013, .002), (.05, .009, .0015)]


@studio.picture(studio.backdrop((.1, .17, .15)))
def cat(size):
    mesh, maps, body = CAT.build(
        skin=(.3, .14, .06), coat=lambda p: .6 + .4 * stripes(p) - white(p),
        length=lambda p: .55 - .45 * face(p) - .42 * ears(p) - .3 * eye(p) + .25 * cheeks(p))
    hair = clfur.HairType(color=(1, 1, 1), color_texture=[COLORS], alpha=.15, look=clfur.Chiang(), length=.17,
                          stiffness=1, segments=10, width=.0035, tip_width=.1, length_variation=.35,
                          direction_variation=.25, color_variation=.12, tufts=clfur.Tufts(5000, strength=.5))
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=200_000, maps=maps, force=(0, -.4, 0),
                        comb=clfur.Comb(CAT.backwards(), .68))
    return studio.stage(mesh, fur, (1.5, 1.75, 4.6), (-.05, 1.02, 0), size, body)


if __name__ == "__main__":
    cat()
