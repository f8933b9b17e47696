"""A name in velvet: tubes along the letters, and shells on them."""

import itertools
from pathlib import Path

import animals
import numpy as np
import studio
from animals import cone, joined, surface

import clfur

behind = studio.backdrop((.24, .21, .16))
settings = clfur.Settings(grid=160)
ARC = [(.36 * np.cos(a), .36 * np.sin(a) + .36) for a in np.linspace(0, 2 * np.pi, 25)]
LINES = [   # of each letter: where it begins, and places along it
    (.4, ARC[3:22]), (1.05, [(0, 0), (0, 1.15)]),
    (1.56, [(0, 0), (0, .8), (.04, .98), (.15, 1.1), (.3, 1.14), (.38, 1.12)]), (1.56, [(-.18, .68), (.32, .68)]),
    (2.36, [(-.3, .72), (-.3, .3), *[(.3 * np.cos(a), .3 + .3 * np.sin(a)) for a in np.linspace(3.3, 6.1, 9)],
            (.3, .3), (.3, .72)]),
    (2.66, [(0, .72), (0, 0)]), (3.1, [(0, 0), (0, .72)]), (3.1, [(0, .4), (.06, .56), (.18, .68), (.34, .7)])]


def word():
    tubes = [cone((x + a[0], a[1], 0), (x + b[0], b[1], 0), .115, .115)
             for x, line in LINES for a, b in itertools.pairwise(line)]
    return surface(joined(*tubes, soft=.04), (-.2, -.2, -.2), (3.7, 1.4, .2), 8 * animals.CELLS // 5)


def scene(size=(800, 600)):
    places, normals, faces = word()
    mesh = clfur.Mesh(places - (1.75, .3, 0), normals=normals, faces=faces)
    plush = clfur.Shells(length=.085, layers=30, hairs=150_000, density=.85, color=(.03, .28, .3), root_shade=.2,
                         force=(.1, -.35, 0),
                         length_variation=.5, specular=.25, exponent=30.0)
    return studio.stage(mesh, plush, (.55, .75, 4.9), (0, .27, 0), size, (.01, .06, .07), 37, height=-.42, key=1.1,
                        rim=1.5)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "letters.png", settings, behind)


if __name__ == "__main__":
    main()
