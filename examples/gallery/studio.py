"""A studio: lights, a soft sky, a camera, what is behind it all, and the command that each script of the gallery is."""

import functools
from collections.abc import Callable

import attrs
import click
import numpy as np

import clfur
from clfur.command.types import Size

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


def from_side(scene, degrees, radius=5.1, height=1.75, target=(0, .8, .05), fov=37):
    """The same Scene from so far to the right of its front, lit for that camera."""
    angle = np.radians(degrees)
    eye = radius * np.sin(angle), height, radius * np.cos(angle)
    camera = clfur.Camera(eye, target, fov=fov, size=scene.camera.size)
    return attrs.evolve(scene, camera=camera, light=lights(eye, target))


def from_above(mesh, fur, eye, target, size, body, fov):
    """A Scene that fills the picture, with lights from left and right."""
    light = [clfur.Light((-.8, -.6, -.3), color=(1, .9, .78), intensity=1.5),
             clfur.Light((.7, -.5, .5), color=(.7, .85, 1), intensity=.6)]
    return clfur.Scene(mesh, fur, clfur.Camera(eye, target, fov=fov, size=size), light, body, environment=SKY)


def snow(mesh, fur, eye, target, size, body, fov):
    """A Scene under a bright sky and a low sun, on a ground that catches its shadow."""
    sky = clfur.Environment([(.3, .5, .85), (.62, .66, .72), (.5, .5, .5)], intensity=.42)
    sun = clfur.Light((-.9, -.5, .35), color=(1, .85, .66), intensity=.45, size=3)
    return clfur.Scene(mesh, fur, clfur.Camera(eye, target, fov=fov, size=size), sun, body, environment=sky,
                       ground=clfur.Ground(height=0))


def evening(fur, eye, target, size, fov=34):
    """A Scene of fur alone on bare earth, before a low sun: `evening_sky` is behind it."""
    return clfur.Scene(fur=fur, camera=clfur.Camera(eye, target, fov=fov, size=size),
                       light=clfur.Light((-.35, -.28, 1), color=(1, .66, .32), intensity=1.2),
                       environment=clfur.Environment([(.25, .36, .6), (.6, .45, .32), (.1, .09, .05)], intensity=.4),
                       ground=clfur.Ground(height=0, color=(.12, .1, .03)))


def evening_sky(size):
    """What is behind a picture of a size, linear light: yellow at the horizon, where the sun is, and blue above."""
    width, height = size
    up = np.clip(1 - np.arange(height) / height / .52, 0, 1)[:, None, None] * np.ones((1, width, 1))
    x = np.abs(np.arange(width) / width - .78)[None, :, None]
    glow = np.exp(-(x / .3)**2 - (up / .35)**2)
    return ((.95, .5, .22) * (1 - up)**1.5 + (.16, .24, .42) * up + glow * (.9, .5, .15)).astype(np.float32)


def backdrop(middle=(.16, .2, .26), center=(.5, .45), edge=.12):
    """A function of a picture's size that gives what is behind it, linear light: a glow that fades to its edges."""
    def behind(size):
        width, height = size
        x, y = np.meshgrid((np.arange(width) + .5) / width - center[0], (np.arange(height) + .5) / height - center[1])
        glow = np.exp(-(x**2 * 5 + y**2 * 6))[..., None]
        return ((edge + (1 - edge) * glow) * np.array(middle)).astype(np.float32)
    return behind


@attrs.frozen
class Picture:
    """A picture of the gallery; called, it is the command that draws it.

    scene: a function of a size that gives the Scene.  settings: to draw it in.  size: unless another is asked for.
    shoot: a function that draws a Scene to a file.  behind: what is behind it, a function of a size.
    """

    scene: Callable
    settings: clfur.Settings
    size: tuple
    shoot: Callable
    behind: Callable | None = None

    @property
    def about(self):
        """What its script begins with."""
        return self.scene.__globals__["__doc__"]

    def draw(self, file, size=None, **fewer):
        """Draw it to a file; what else is given is for the scene's function."""
        self.shoot(self.scene(size or self.size, **fewer), file)

    def __call__(self, arguments=None):
        """Draw it as these arguments say, those of the shell if there are none."""
        name = self.scene.__name__

        @click.command(name, help=self.about)
        @click.option("-o", "--output", default=f"{name}.png", metavar="FILE", show_default=True, help="The picture.")
        @click.option("--size", type=Size(), default="x".join(map(str, self.size)), metavar="WxH", show_default=True,
                      help="Its size in pixels.")
        def command(output, size):
            try:
                self.draw(output, size)
            except clfur.Error as error:
                raise click.UsageError(str(error)) from None
        command.main(arguments)


def picture(behind, settings=FINE, size=(800, 600), shoot=None):
    """Makes a `Picture` of the function of a size that gives its Scene, drawn before what is behind it."""
    def still(scene, file):
        clfur.save(file, clfur.over(clfur.render(scene, settings=settings), behind(scene.camera.size)))
    return lambda scene: Picture(scene, settings, size, shoot or still, behind)


def film(settings, size, **options):
    """Makes a `Picture` that moves of it, by `clfur.film` with these options."""
    shoot = functools.partial(clfur.film, settings=settings, overwrite=True, **options)
    return lambda scene: Picture(scene, settings, size, shoot)
