"""A shaggy dog: brown hair in tufts within tufts, paler at the tips, with the light behind it."""

import studio
from models.dog import DOG, chest, ears, eye, face, muzzle, soles

import clfur


@studio.picture(studio.backdrop((.24, .2, .17)))
def dog(size):
    mesh, maps, body = DOG.build(
        skin=(.09, .05, .03), coat=lambda p: .15 + .8 * muzzle(p) + .35 * chest(p),
        length=lambda p: 1 - .78 * face(p) - .68 * ears(p) - .75 * soles(p) - .55 * eye(p))
    hair = clfur.HairType(color=(1, 1, 1), color_texture=[[(.075, .03, .012), (.16, .075, .03), (.42, .27, .13)]],
                          root_color=(.5, .45, .4), tip_color=(1.5, 1.4, 1.25), alpha=.15,
                          look=clfur.Chiang(azimuthal_roughness=.35), length=.22, stiffness=1, segments=14, width=.004,
                          tip_width=.1, length_variation=.4, direction_variation=.3, color_variation=.2,
                          tufts=clfur.Tufts(3500, strength=.65, within=clfur.Tufts(500)), frizz=(.006, 3))
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=170_000, maps=maps, force=(0, -.7, 0),
                        comb=clfur.Comb(DOG.backwards(.6), .6))
    return studio.stage(mesh, fur, (-1.5, 1.5, 4.6), (0, 1.02, .1), size, body, fov=31)


if __name__ == "__main__":
    dog()
