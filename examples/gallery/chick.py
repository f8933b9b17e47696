"""A chick: down that stands off, so fine that the light from behind comes through."""

import studio
from models.chick import CHICK, belly, cheeks, eye, face, head

import clfur


@studio.picture(studio.backdrop((.13, .25, .32)))
def chick(size):
    mesh, maps, body = CHICK.build(
        skin=(.6, .36, .08), coat=lambda p: .2 + .5 * belly(p) + .4 * cheeks(p),
        length=lambda p: 1 - .7 * face(p) - .35 * head(p) - .62 * eye(p))
    down = clfur.HairType(color=(1, 1, 1), color_texture=[[(.72, .36, .035), (.8, .5, .09), (.84, .66, .26)]],
                          alpha=.15, look=clfur.Chiang(azimuthal_roughness=.5), length=.2, stiffness=1.5, segments=10,
                          width=.0032, tip_width=.1, length_variation=.5, direction_variation=.5, color_variation=.15,
                          tufts=clfur.Tufts(9000, strength=.55, within=clfur.Tufts(900, strength=.4)), frizz=(.01, 2))
    fur = clfur.Strands(inner=1, outer=1, types=down, roots=190_000, maps=maps, force=(0, -.25, -.15))
    return studio.stage(mesh, fur, (1.6, 1.1, 3.6), (0, .82, 0), size, body, fov=32)


if __name__ == "__main__":
    chick()
