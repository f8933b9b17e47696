"""A lion, after figure 9 of the report that clfur follows: a type map says where mane, tail and coat grow."""

import studio
from attrs import evolve
from models.lion import BLUE, GREEN, LION, RED, ears, face, muzzle, neck

import clfur


@studio.picture(studio.backdrop((.27, .17, .1)))
def lion(size):
    mesh, maps, body = LION.build((.3, .19, .09), muzzle, lambda p: .6 + .4 * neck(p) - .45 * face(p) - .35 * ears(p))
    hair = clfur.HairType(alpha=.15, look=clfur.Chiang(), length=.1, stiffness=1.2, segments=7, width=.003,
                          tip_width=.1, length_variation=.35, direction_variation=.25, color_variation=.2)
    coat = evolve(hair, key=GREEN, color=(1, 1, 1), color_texture=[[(.3, .15, .04), (.4, .25, .1), (.75, .62, .45)]])
    mane = evolve(hair, key=RED, color=(.022, .006, .0014), root_color=(.014, .004, .001), tip_color=(.09, .03, .006),
                  length=.52, segments=20, width=.0042, wave=(.012, 2), tufts=clfur.Tufts(900, strength=.7))
    tail = evolve(hair, key=BLUE, color=(.015, .006, .003), length=.45, segments=14, width=.004, tufts=clfur.Tufts(900))
    fur = clfur.Strands(inner=1, outer=1, types=[coat, mane, tail], type_map=LION.type_map, roots=190_000, maps=maps,
                        force=(0, -.5, 0), comb=clfur.Comb(LION.backwards(.35), .6))
    return studio.stage(mesh, fur, (1.9, 1.6, 4.8), (.1, 1.05, 0), size, body, fov=30.5)


if __name__ == "__main__":
    lion()
