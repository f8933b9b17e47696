"""Martin Newell's teapot (1975), evaluated from its bicubic Bezier patches.

The 32 patches make four surfaces. Pot and lid are turned: each of their patches is a quarter turn of a cubic
curve (radius, height). Handle and spout are tubes: a cubic of half cross-sections, mirrored at z = 0. So the
306 control points reduce to the tables here, in Newell's units with +Y up, the spout along +X.
"""

import numpy as np

QUARTER = 0.56  # Newell's weight of the inner control points of a quarter circle

# Control points (radius, height) of cubics that share their ends: 3 n + 1 points make n curves.
POT = [(1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4),  # rim
       (1.75, 1.875), (2, 1.35), (2, 0.9), (2, 0.45), (1.5, 0.225), (1.5, 0.15),  # body
       (1.5, 0.075), (1.425, 0), (0, 0)]  # bottom
LID = [(0, 3.15), (0.8, 3.15), (0, 2.85), (0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)]

# For each point along a tube: (x, height) of the inner and of the outer side, and half the width.
HANDLE = [((-1.6, 2.025), (-1.5, 2.25), 0.3), ((-2.3, 2.025), (-2.5, 2.25), 0.3),
          ((-2.7, 2.025), (-3, 2.25), 0.3), ((-2.7, 1.8), (-3, 1.8), 0.3), ((-2.7, 1.575), (-3, 1.35), 0.3),
          ((-2.5, 1.125), (-2.65, 0.9375), 0.3), ((-2, 0.9), (-1.9, 0.6), 0.3)]
SPOUT = [((1.7, 1.425), (1.7, 0.6), 0.66), ((2.6, 1.425), (3.1, 0.825), 0.66),
         ((2.3, 2.1), (2.4, 2.025), 0.25), ((2.7, 2.4), (3.3, 2.4), 0.25),
         ((2.8, 2.475), (3.525, 2.49375), 0.25), ((2.9, 2.475), (3.45, 2.5125), 0.15),
         ((2.8, 2.4), (3.2, 2.4), 0.15)]


def turned(profile):
    """Return the control points [3 n + 1, 13, 3] of a turned surface: its profile, then around."""
    around = [(1, 0), (1, QUARTER), (QUARTER, 1)]
    for _ in range(3):
        around += [(-z, x) for x, z in around[-3:]]
    around.append(around[0])
    return np.array([[(radius * x, height, radius * z) for x, z in around] for radius, height in profile])


def tube(sections):
    """Return the control points [3 n + 1, 7, 3] of a tube: along, then around."""
    return np.array([
        [(*a, 0), (*a, half), (*b, half), (*b, 0), (*b, -half), (*a, -half), (*a, 0)]
        for a, b, half in sections
    ])


def evaluate(control, level):
    """Return a surface of bicubic patches and its two derivatives on a grid.

    control: [3 m + 1, 3 n + 1, 3]. level: steps per patch. Each result: [m level + 1, n level + 1, 3].
    """

    def basis(count):  # rows of weights for all the control points along one way, and of their derivatives
        rows = np.arange(count * level + 1)
        curve = np.minimum(rows // level, count - 1)
        t = rows / level - curve
        s = 1 - t
        value, slope = np.zeros((2, len(rows), 3 * count + 1))
        for k, (weight, change) in enumerate([
            (s**3, -3 * s**2), (3 * s**2 * t, 3 * s**2 - 6 * s * t),
            (3 * s * t**2, 6 * s * t - 3 * t**2), (t**3, 3 * t**2),
        ]):
            value[rows, 3 * curve + k] = weight
            slope[rows, 3 * curve + k] = change
        return value, slope

    (a, da), (b, db) = basis(len(control) // 3), basis(control.shape[1] // 3)
    return tuple(np.einsum("ik,jl,klc->ijc", x, y, control) for x, y in [(a, b), (da, b), (a, db)])


def teapot(level=10):
    """Return (positions [V, 3], normals [V, 3], uv [F, 3, 2], faces [F, 3]) of the teapot.

    level: steps along each side of a patch; 10 gives 6320 triangles. It is centred on its box and scaled
    so that the diagonal of the box is 2. uv is one atlas: pot below, then lid, then handle and spout.
    Neighbouring patches share vertices; the four surfaces are separate, and open where Newell's are.
    """
    pieces = [  # control points, and the rectangle (u, v, width, height) of uv
        (turned(POT), (0, 0, 1, 0.5)), (turned(LID), (0, 0.5, 1, 0.25)),
        (tube(HANDLE), (0, 0.75, 0.5, 0.25)), (tube(SPOUT), (0.5, 0.75, 0.5, 0.25)),
    ]
    positions, normals, uv, faces, count = [], [], [], [], 0
    for control, (u, v, width, height) in pieces:
        point, along, around = evaluate(control, level)
        normal = np.cross(around, along)
        pole = (control == control[:, :1]).all(axis=(1, 2))  # a row of control points that is one point
        for row, k in [(0, 0), (-1, -1)]:
            if pole[k]:  # no derivative around it: the limit is the axis of turning
                normal[row] = (0, 1 if row == 0 else -1, 0)
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
        rows, columns = point.shape[0], point.shape[1] - 1  # the last column is the first again
        i, j = (each.ravel() for each in np.mgrid[: rows - 1, :columns])
        corners = np.array([[(0, 0), (1, 1), (1, 0)], [(0, 0), (0, 1), (1, 1)]])  # of the two triangles
        i, j = i[:, None, None] + corners[..., 0], j[:, None, None] + corners[..., 1]  # [cells, 2, 3]
        at = np.where(pole[0] & (i == 0), 0, np.where(pole[-1] & (i == rows - 1), 0, j % columns))
        face = (i * columns + at).reshape(-1, 3)
        place = np.stack([u + width * j / columns, v + height * (1 - i / (rows - 1))], axis=-1)
        place = place.reshape(-1, 3, 2)
        solid = (face != np.roll(face, 1, axis=1)).all(axis=1)  # at a pole every other triangle has no area
        positions.append(point[:, :columns].reshape(-1, 3))
        normals.append(normal[:, :columns].reshape(-1, 3))
        uv.append(place[solid])
        faces.append(face[solid] + count)
        count += rows * columns
    positions = np.concatenate(positions)
    low, high = positions.min(axis=0), positions.max(axis=0)
    positions = (positions - (low + high) / 2) * (2 / np.linalg.norm(high - low))
    return positions, np.concatenate(normals), np.concatenate(uv), np.concatenate(faces)
