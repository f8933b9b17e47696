"""A dandelion clock of strands alone: 150 seeds on stalks, each with a parachute, some of which the wind has taken."""

import numpy as np
import studio
from models.dandelion import GRAIN, POINTS, clock

import clfur


@studio.picture(studio.backdrop((.12, .18, .06), (.32, .35)),
                settings=clfur.Settings(masks=4, shadows="deep", scattering="grid"))
def dandelion(size, seeds=150):
    points, kind = clock(seeds)
    width = np.array([1, .0019, .0019, .013])[kind, None] * np.linspace(1, .35, POINTS)
    width[kind == GRAIN] = .014 * np.sin(np.linspace(.4, 3, POINTS))
    color = np.array([(.22, .11, .05), (.6, .52, .38), (.9, .88, .84), (.1, .16, .03)])[kind]
    fur = clfur.Curves(points, width=width, color=color, alpha=.3, look=clfur.Chiang(azimuthal_roughness=.5))
    light = [clfur.Light((-.75, -.7, .9), color=(1, .86, .62), intensity=1.7),
             clfur.Light((.6, -.5, -1), intensity=.5)]
    return clfur.Scene(fur=fur, camera=clfur.Camera((.3, .25, 4.1), (.3, .12, 0), fov=29, size=size), light=light,
                       environment=studio.SKY)


if __name__ == "__main__":
    dandelion()
