"""A sheep: wool in curls that tufts share, a black face and legs of short hair, by a type map."""

import studio
from models.sheep import SHEEP

import clfur


@studio.picture(studio.backdrop((.1, .15, .25)))
def sheep(size):
    mesh, maps, body = SHEEP.build(skin=(.008, .007, .006))
    wool = clfur.HairType(key=(255, 255, 255), color=(.6, .5, .37), alpha=.15,
                          look=clfur.Chiang(azimuthal_roughness=.5), length=.36, stiffness=2, segments=36, width=.0042,
                          tip_width=.4, length_variation=.3, direction_variation=.3, color_variation=.12,
                          curl=(.024, 4), tufts=clfur.Tufts(1500, strength=.9, profile=.6), frizz=(.006, 6))
    short = clfur.HairType(key=(0, 0, 0), color=(.006, .005, .005), alpha=.15, look=clfur.Chiang(), length=.05,
                           stiffness=.5, segments=5, width=.003, tip_width=.1, length_variation=.3,
                           direction_variation=.2, color_variation=.3)
    fur = clfur.Strands(inner=1, outer=1, types=[wool, short], type_map=SHEEP.type_map, roots=110_000, maps=maps,
                        force=(0, -.3, 0))
    return studio.stage(mesh, fur, (3.1, 1.75, 4.1), (0, .88, .05), size, body, fov=30)


if __name__ == "__main__":
    sheep()
