"""A sheep from four sides: the camera goes round, and the hair stays on the device."""

import numpy as np
import studio
from sheep import sheep

import clfur


def strip(scene, file):
    gpu, views = clfur.Scheduler(), []
    for angle in np.radians([37, 112, 187, 292]):
        eye = 5.1 * np.sin(angle), 1.75, 5.1 * np.cos(angle)
        views.append(clfur.render(studio.seen_from(scene, eye, (0, .8, .05), fov=37), gpu, studio.FINE))
    image = np.concatenate(views, 1)
    clfur.save(file, clfur.over(image, turned.behind(image.shape[1::-1])))


@studio.picture(studio.backdrop((.2, .15, .2)), size=(800, 260), shoot=strip)
def turned(size):
    return sheep.scene((size[0] // 4, size[1]))


if __name__ == "__main__":
    turned()
