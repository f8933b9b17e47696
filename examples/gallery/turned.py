"""A sheep from four sides: the camera goes round, and the hair stays on the device."""

import numpy as np
import studio
from sheep import sheep

import clfur


def strip(scene, file):
    gpu = clfur.Scheduler()
    views = [clfur.render(studio.from_side(scene, angle), gpu, studio.FINE) for angle in (37, 112, 187, 292)]
    image = np.concatenate(views, 1)
    clfur.save(file, clfur.over(image, turned.behind(image.shape[1::-1])))


@studio.picture(studio.backdrop((.2, .15, .2)), size=(800, 260), shoot=strip)
def turned(size):
    return studio.from_side(sheep.scene((size[0] // 4, size[1])), 37)


if __name__ == "__main__":
    turned()
