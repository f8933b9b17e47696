"""Strands that are brought: a whisk of spirals, each with its own colour, thinner towards the tips."""

from pathlib import Path

import numpy as np

import clfur


def main(folder=".", size=(640, 480), strands=3000, points=40):
    random = np.random.default_rng(1)
    along = np.linspace(0, 1, points)
    turn = random.uniform(0, 2 * np.pi, (strands, 1)) + 5 * along
    spread = np.sqrt(random.uniform(0, 1, (strands, 1))) * (.15 + .85 * along**2)
    places = np.stack([spread * np.cos(turn), 2 * along * random.uniform(.8, 1, (strands, 1)) - 1,
                       spread * np.sin(turn)], -1)
    curves = clfur.Curves(places, width=np.broadcast_to(.012 * (1 - .9 * along), (strands, points)),
                          color=random.uniform((.5, .2, .05), (.9, .5, .2), (strands, 3)), exponent=60.0)
    scene = clfur.Scene(fur=curves, camera=clfur.Camera(eye=(0, .8, 3.4), size=size))
    clfur.save(Path(folder) / "curves.png", clfur.render(scene))


if __name__ == "__main__":
    main()
