"""A sheep from four sides: the camera goes round, and the hair stays on the device."""

from pathlib import Path

import attrs
import numpy as np
import sheep
import studio

import clfur

behind = studio.backdrop((.2, .15, .2))
settings = studio.FINE


def scene(size=(800, 260), angle=0.0):
    still = sheep.scene((size[0] // 4, size[1]))
    x, z = 5.1 * np.sin(np.radians(37 + angle)), 5.1 * np.cos(np.radians(37 + angle))
    eye, target = (x, 1.75, z), (0, .8, .05)
    return attrs.evolve(still, camera=clfur.Camera(eye, target, fov=37, size=(size[0] // 4, size[1])),
                        light=studio.lights(eye, target))


def main(folder=".", size=(800, 260), angles=(0, 75, 150, 255)):
    gpu = clfur.Scheduler()
    images = [clfur.render(scene(size, angle), gpu, settings) for angle in angles]
    strip = np.concatenate(images, 1)
    clfur.save(Path(folder) / "turned.png", clfur.over(strip, behind(strip.shape[1::-1])))


if __name__ == "__main__":
    main()
