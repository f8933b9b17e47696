"""A name: tubes along its letters."""

import itertools

import numpy as np

import clfur

from . import animals
from .animals import cone, joined, surface

ARC = [(.36 * np.cos(a), .36 * np.sin(a) + .36) for a in np.linspace(0, 2 * np.pi, 25)]
BOWL = [(.3 * np.cos(a), .3 + .3 * np.sin(a)) for a in np.linspace(3.3, 6.1, 9)]
LINES = [   # of each letter: where it begins, and places along it
    (.4, ARC[3:22]),
    (1.05, [(0, 0), (0, 1.15)]),
    (1.56, [(0, 0), (0, .8), (.04, .98), (.15, 1.1), (.3, 1.14), (.38, 1.12)]), (1.56, [(-.18, .68), (.32, .68)]),
    (2.36, [(-.3, .72), (-.3, .3), *BOWL, (.3, .3), (.3, .72)]), (2.66, [(0, .72), (0, 0)]),
    (3.1, [(0, 0), (0, .72)]), (3.1, [(0, .4), (.06, .56), (.18, .68), (.34, .7)])]


def word():
    """The Mesh of it, with its middle at 0."""
    tubes = [cone((x + a[0], a[1], 0), (x + b[0], b[1], 0), .115, .115)
             for x, line in LINES for a, b in itertools.pairwise(line)]
    places, normals, faces = surface(joined(*tubes, soft=.04), (-.2, -.2, -.2), (3.7, 1.4, .2), 8 * animals.CELLS // 5)
    return clfur.Mesh(places - (1.75, .3, 0), normals=normals, faces=faces)
