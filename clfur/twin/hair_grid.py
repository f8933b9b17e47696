"""A grid of hair and what its points feel of it, in float64; points are not snapped, nothing is cut to whole units."""

import numpy as np

ALONE, DENSER = 1.25, 1.2


def shares(points, low, cell, size):
    """Linear shares of cells around points [n, 3] -> ([8, n, 3] cells, [8, n] shares, [8, n, 3] their slopes a cell);
    nothing where not all eight are in the grid."""
    at = (np.asarray(points, float) - low) / cell - 0.5
    inside = ((at >= 0) & (at < np.array(size) - 1)).all(1)
    at = np.where(inside[:, None], at, 0)
    first = np.floor(at).astype(int)
    high = at - first
    corners = np.array(list(np.ndindex(2, 2, 2)))[:, None]
    each = np.where(corners, high, 1 - high) * inside[:, None]
    slopes = np.stack([np.where(corners[..., a], 1, -1) * np.delete(each, a, 2).prod(2) for a in range(3)], 2)
    return first + corners, each.prod(2), slopes * inside[:, None]


def grid_of(points, masses, velocities, low, cell, size):
    """Points into a grid -> (mean velocities [nx, ny, nz, 3], 0 where nothing is; densities [nx, ny, nz]: mass a cell's
    side, which is how many strands cross it)."""
    mass, momentum = np.zeros(size), np.zeros((*size, 3))
    for at, share in zip(*shares(points, low, cell, size)[:2]):
        np.add.at(mass, tuple(at.T), share * masses)
        np.add.at(momentum, tuple(at.T), (share * masses)[:, None] * velocities)
    return momentum / np.where(mass > 0, mass, 1)[..., None], mass / cell


def density_at(points, density, low, cell):
    """Densities [n] at points, and their gradients [n, 3] a cell."""
    at, share, slopes = shares(points, low, cell, density.shape)
    there = density[tuple(np.moveaxis(at, 2, 0))]
    return (share * there).sum(0), (slopes * there[..., None]).sum(0)


def felt_at(points, groomed, velocity, density, low, cell, friction, push, rub, most):
    """What points feel -> (acceleration of one at rest [n, 3], friction [n] [1 / s]).

    Cells drag by their mean velocities, and are felt by as many strands as cross them beyond one alone, up to one
    more.  Where the density d is above rest = `DENSER` times the groomed, -push (1 - rest / d) (grad d) / d is added,
    of no more than ``most``, and to the friction rub |(grad d) / d|².
    """
    at, share, _ = shares(points, low, cell, density.shape)
    at = tuple(np.moveaxis(at, 2, 0))
    by = share * np.clip(density[at] - ALONE, 0, 1)
    now, gradient = density_at(points, density, low, cell)
    rest = DENSER * np.maximum(groomed, ALONE)
    dense = now > rest
    slope = gradient / np.where(dense, now, 1)[:, None]
    away = -push * np.where(dense, 1 - rest / np.where(dense, now, 1), 0)[:, None] * slope
    size = np.linalg.norm(away, axis=1)
    away *= np.minimum(1, most / np.where(size > 0, size, 1))[:, None]
    friction = friction + np.where(dense, rub * (slope**2).sum(1), 0)
    return friction[:, None] * (by[..., None] * velocity[at]).sum(0) + away, friction * by.sum(0)
