"""What cl/bounce.cl means, in float64."""

import numpy as np


def facing(body):
    """The way that a body's surface looks in cells, by their shares [n, n, n] of it -> [n, n, n, 3] x, y, z unit, 0
    where there is none."""
    wide = np.pad(body, 1, mode="edge")
    z, y, x = (np.take(wide, range(len(body)), a) - np.take(wide, range(2, len(body) + 2), a) for a in range(3))
    change = np.stack([x[1:-1, 1:-1], y[1:-1, :, 1:-1], z[:, 1:-1, 1:-1]], -1)
    length = np.linalg.norm(change, axis=-1, keepdims=True)
    return np.where(length > 0.01, change / np.where(length > 0, length, 1), 0)


def sent(normals, directions, light):
    """Mean of light [D, ...] from directions [D, 3] that falls on a surface, weighed by the cosine with normals
    [..., 3] -> [...]; 0 where there is none."""
    weights = np.maximum(np.moveaxis(normals @ np.asarray(directions, float).T, -1, 0), 0)
    total = weights.sum(0)
    return (weights * light).sum(0) / np.where(total > 0, total, 1)
