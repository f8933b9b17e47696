"""A studio: lights from three sides, a soft sky, a camera, and what is behind it all."""

from pathlib import Path

import numpy as np

import clfur

KEY = {"direction": (-.6, -.85, -1), "color": (1, .9, .76), "intensity": 1.15, "size": 5}   # from the camera's left
RIM = {"direction": (.75, -.5, .8), "color": (.8, .9, 1), "intensity": .8}                 # from behind, right of it
SKY = clfur.Environment([(.42, .5, .66), (.34, .33, .36), (.2, .16, .13)], intensity=.4)
FINE = clfur.Settings(masks=4, scattering="grid")


def lights(eye, target, key=1.0, rim=1.0):
    """The key light and the one from behind, as a camera has them."""
    x, z = np.subtract(eye, target)[[0, 2]] / np.hypot(*np.subtract(eye, target)[[0, 2]])
    seen = np.array([[z, 0, -x], [0, 1, 0], [x, 0, z]])   # the camera's right, up, and the way to it
    return [clfur.Light(**{**light, "direction": light["direction"] @ seen, "intensity": light["intensity"] * times})
            for light, times in ((KEY, key), (RIM, rim))]


def stage(mesh, fur, eye, target, size, body=(.3, .2, .13), fov=30, height=0, **times):
    """A Scene in the studio, on a ground that catches its shadow."""
    return clfur.Scene(mesh, fur, clfur.Camera(eye, target, fov=fov, size=size), lights(eye, target, **times), body,
                       environment=SKY, ground=clfur.Ground(height=height))


def backdrop(middle=(.16, .2, .26), center=(.5, .45), edge=.12):
    """A function of a picture's size that gives what is behind it, linear light: a glow that fades to its edges."""
    def behind(size):
        width, height = size
        x, y = np.meshgrid((np.arange(width) + .5) / width - center[0], (np.arange(height) + .5) / height - center[1])
        glow = np.exp(-(x**2 * 5 + y**2 * 6))[..., None]
        return ((edge + (1 - edge) * glow) * np.array(middle)).astype(np.float32)
    return behind


def shoot(scene, file, settings, behind, device=None):
    """Draw a scene before what is behind it to a file."""
    clfur.save(Path(file), clfur.over(clfur.render(scene, device, settings), behind(scene.camera.size)))
