"""A scene file in time: a ball of long hair that turns one way and the other. `clfur render turning.py --time 0.8`."""

import functools
import math
from pathlib import Path

import numpy as np

import clfur

ROUND = 2.0   # seconds, after which it begins anew
BALL = clfur.load_mesh("sphere")
FUR = clfur.Strands(roots=12_000, seed=3, force=(0, -1, 0), types=clfur.HairType(
    length=.75, stiffness=1.2, length_variation=.3, width=.008, color=(.6, .22, .06)))

motion = {"hair": clfur.HairMotion(bend_length=.5, air=.4), "units_per_metre": 3,
          "wind": clfur.Wind((.5, 0, 0), gust=1, size=.3, skin=.02)}


def scene(t, size=(640, 480)):
    """The ball at t seconds."""
    angle = 1.5 * math.sin(2 * math.pi * t / ROUND) ** 3
    turn = np.array([[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]])
    place = np.array([0, .25 * math.sin(math.pi * t / ROUND) ** 2, 0])
    return clfur.Scene(
        mesh=clfur.Mesh(positions=BALL.positions @ turn.T + place, faces=BALL.faces), fur=FUR,
        camera=clfur.Camera(eye=(0, 1.5, 6.3), target=(0, -.1, 0), size=size), body_color=(.2, .08, .03),
        light=[clfur.Light(direction=(-1, -1.3, -.6), angle=8), clfur.Light(direction=(1, -.2, -1), intensity=.3)],
        ground=clfur.Ground(height=-1.9))


def main(folder=".", size=(640, 480), frames=24):
    film = clfur.Motion(functools.partial(scene, size=size), **motion)
    for frame in range(frames):
        clfur.save(Path(folder) / f"turning-{frame:03}.png", clfur.render(film.at(frame)))


if __name__ == "__main__":
    main()
