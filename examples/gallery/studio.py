"""A studio: lights from three sides, a soft sky, a camera, and what is behind it all."""

from pathlib import Path

import numpy as np

import clfur

KEY = clfur.Light((-.75, -.9, -.8), color=(1, .9, .76), intensity=.8, size=5)
RIM = clfur.Light((.7, -.55, 1), color=(.8, .9, 1), intensity=.55)
SKY = clfur.Environment([(.42, .5, .66), (.34, .33, .36), (.2, .16, .13)], intensity=.36)
FINE = clfur.Settings(masks=4, scattering="grid")


def stage(mesh, fur, eye, target, size, body=(.3, .2, .13), fov=30, height=0):
    """A Scene in the studio, on a ground that catches its shadow."""
    return clfur.Scene(mesh, fur, clfur.Camera(eye, target, fov=fov, size=size), [KEY, RIM], body, environment=SKY,
                       ground=clfur.Ground(height=height))


def backdrop(size, middle=(.16, .2, .26), edge=(.02, .026, .04), center=(.5, .45)):
    """A picture [height, width, 3] that is bright around a place and dark at its edges, in linear light."""
    width, height = size
    x, y = np.meshgrid((np.arange(width) + .5) / width - center[0], (np.arange(height) + .5) / height - center[1])
    share = np.exp(-(x**2 * 5 + y**2 * 6))[..., None]
    return (np.array(edge) + share * np.subtract(middle, edge)).astype(np.float32)


def shoot(scene, file, settings=FINE, behind=None, device=None):
    """Draw a scene before a backdrop to a file."""
    image = clfur.render(scene, device, settings)
    clfur.save(Path(file), clfur.over(image, backdrop(scene.camera.size) if behind is None else behind))
