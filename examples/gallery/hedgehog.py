"""A hedgehog: spines, wide and banded, on its back, and soft hair on face and belly."""

import studio
from models.hedgehog import HEDGEHOG, eye, face

import clfur


@studio.picture(studio.backdrop((.22, .13, .07)))
def hedgehog(size):
    mesh, maps, body = HEDGEHOG.build(skin=(.05, .03, .02), length=lambda p: .8 - .62 * face(p) - .5 * eye(p))
    spine = clfur.HairType(key=(255, 255, 255), color=(.02, .01, .005), root_color=(.008, .004, .002),
                           tip_color=(.34, .22, .1), alpha=.1, look=clfur.Chiang(.25, .4), length=.34, stiffness=8,
                           segments=6, width=.023, tip_width=.06, taper=.2, length_variation=.25,
                           direction_variation=.4, color_variation=.25)
    hair = clfur.HairType(key=(0, 0, 0), color=(.11, .055, .022), tip_color=(.22, .12, .055), alpha=.15,
                          look=clfur.Chiang(), length=.18, stiffness=.7, segments=8, width=.0034, tip_width=.1,
                          length_variation=.4, direction_variation=.3, color_variation=.2)
    fur = clfur.Strands(inner=1, outer=1, types=[spine, hair], type_map=HEDGEHOG.type_map, roots=45_000, maps=maps,
                        force=(0, -.2, -.3), comb=clfur.Comb(HEDGEHOG.backwards(.2), .5))
    return studio.stage(mesh, fur, (2.2, 1.15, 3.2), (0, .48, 0), size, body, fov=27, rim=.6)


if __name__ == "__main__":
    hedgehog()
