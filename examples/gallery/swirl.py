"""Hair that is combed along a flow: it leans as a function of its place says, in colours of a picture by uv."""

import numpy as np
import studio
from models.hills import build, slope, unit

import clfur


@studio.picture(studio.backdrop((.02, .02, .03)), clfur.Settings(masks=4, shadows="deep", scattering="grid"))
def swirl(size):
    mesh, paint = build()
    hair = clfur.HairType(color=(1, 1, 1), color_texture=paint, root_color=(.4, .4, .4), tip_color=(1.15, 1.15, 1.15),
                          alpha=.1, look=clfur.Chiang(), length=.34, stiffness=1.5, segments=14, width=.0045,
                          tip_width=.08, length_variation=.4, direction_variation=.2, color_variation=.2,
                          tufts=clfur.Tufts(2600, strength=.75, profile=.3))
    round_hills = clfur.Comb(lambda places, normals: unit(np.cross((0, 1, 0), slope(places))), .75)
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=180_000, force=(0, -.25, 0), comb=round_hills)
    return studio.from_above(mesh, fur, (.1, 1.75, 1.75), (0, 0, -.12), size, .35 * paint, fov=42)


if __name__ == "__main__":
    swirl()
