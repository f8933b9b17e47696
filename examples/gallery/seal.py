"""A seal pup on snow under a sky: white hair is white by the light that goes from hair to hair."""

import studio
from models.seal import SEAL, back, crown, eye, face, flippers, nose

import clfur


@studio.picture(studio.backdrop((.5, .62, .75), (.5, .3), .55))
def seal(size):
    mesh, maps, body = SEAL.build(
        skin=(.7, .68, .66), coat=lambda p: back(p) + .6 * crown(p),
        length=lambda p: 1 - .6 * face(p) - .3 * nose(p) - .45 * eye(p) - .5 * flippers(p))
    hair = clfur.HairType(color=(1, 1, 1), color_texture=[[(.86, .82, .76), (.75, .7, .65), (.5, .45, .4)]], alpha=.2,
                          look=clfur.Chiang(azimuthal_roughness=.45), length=.16, stiffness=1, segments=9, width=.003,
                          tip_width=.1, length_variation=.4, direction_variation=.35, color_variation=.1,
                          tufts=clfur.Tufts(5000, strength=.55))
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=200_000, maps=maps, force=(0, -.4, 0),
                        comb=clfur.Comb(SEAL.backwards(.1), .62))
    return studio.snow(mesh, fur, (1.7, 1.0, 3.6), (.02, .42, -.1), size, body, fov=26)


if __name__ == "__main__":
    seal()
