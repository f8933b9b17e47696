"""Shell fur, and meshes that it grows on."""

import numpy as np

from .scenes import icosphere

FUR = {"length": 0.25, "layers": 12, "frequency": 8.0}
SINE = FUR | {"pattern": "sine", "frequency": 6.0}
BENT = {"wind": (0.6, 0.2, 0.0), "force": (0.0, -0.5, 0.0), "time": 0.3}


def ball(subdivisions=1, center=(0, 0, 0)):
    """Unit sphere of 20·4^n faces, u and v by longitude and latitude: a face at the seam spans all of them."""
    positions, faces = icosphere(subdivisions)
    uv = np.stack([np.arctan2(positions[:, 0], positions[:, 2]) / (2 * np.pi) + 0.5,
                   np.arcsin(positions[:, 1]) / np.pi + 0.5], 1)[faces]
    uv[..., 0] += (uv[..., 0] < 0.5) & (np.ptp(uv[..., 0], axis=1) > 0.5)[:, None]
    return positions + center, positions, uv, faces


def quad():
    corners = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    return corners, np.tile((0.0, 1.0, 0.0), (4, 1)), np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)[faces], faces


def pair():
    """Two spheres, one behind the other."""
    a, b = ball(1, (0.3, 0.2, 0)), ball(1, (-0.3, 0, -2.6))
    return (*(np.concatenate([x, y]) for x, y in zip(a[:3], b)), np.concatenate([a[3], b[3] + len(a[0])]))


MESHES = {"ball": ball(1), "quad": quad(), "pair": pair()}


def noise_shape(packed):
    nx, ny, nz = (4 * int(n) for n in packed["noise"][:3])
    return 1 if nz == 4 else nz, ny, nx
