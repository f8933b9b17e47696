"""Low hills in a square, coloured by their height."""

import numpy as np

import clfur

from .animals import noise

N = 60   # places on a side
COLORS = np.array([(.01, .08, .16), (.02, .28, .33), (.45, .06, .2), (.75, .2, .06), (.85, .5, .14)])


def height(p):
    """A smooth random function of places."""
    return noise(p, 1.1, 8)


def slope(p):
    """Which way it goes up [n, 3]: how much it does along x, y and z in .002."""
    return np.stack([height(p + e) - height(p - e) for e in 1e-3 * np.eye(3)], -1)


def unit(ways):
    """The same [n, 3], 1 long."""
    return ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)


def build():
    """(Mesh, paint [N, N, 3] for its uv)."""
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, N), np.linspace(0, 1, N)))
    places = np.stack([4.8 * u - 2.4, 0 * u, 3.9 * v - 2.4], 1)
    places[:, 1] = .09 * height(places)
    shade = np.clip(2 + 1.15 * height(places) + .25 * noise(places, .3, 3), 0, 4)
    paint = np.stack([np.interp(shade, range(5), part) for part in COLORS.T], 1).reshape(N, N, 3)[::-1]
    first = np.arange(N * (N - 1)).reshape(N - 1, N)[:, :-1].reshape(-1, 1)
    faces = np.concatenate([first + (0, N, 1), first + (1, N, N + 1)])
    return clfur.Mesh(places, uv=np.stack([u, v], 1), faces=faces), paint
