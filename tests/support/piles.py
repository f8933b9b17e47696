"""Heads and walls of hair, and how dense it lies there."""

import numpy as np

import clfur
from clfur.twin import hair_grid as twin

from .scenes import icosphere

SEGMENTS = 8


def scene_of(mesh, roots):
    fur = clfur.Strands(roots=roots, types=clfur.HairType(length=0.3, segments=SEGMENTS, width=0.002))
    return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=(0, 0.5, 4), size=(32, 32)))


def ball(shift=(0, 0, 0), turn=0.0):
    positions, faces = icosphere(2)
    c, s = np.cos(turn), np.sin(turn)
    return clfur.Mesh(positions=positions @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + shift, faces=faces)


def wall(side=0.3, n=8):
    """A square that faces along x, from which hair stands level."""
    at = np.linspace(-side / 2, side / 2, n)
    y, z = (each.ravel() for each in np.meshgrid(at, at, indexing="ij"))
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([corner, corner + n, corner + 1], 1),
                            np.stack([corner + 1, corner + n, corner + n + 1], 1)])
    return clfur.Mesh(positions=np.stack([0 * y, y, z], 1), faces=faces)


def points(scene):
    """[strands, points, 3] relative to the middle of the mesh."""
    places = np.asarray(scene.fur.on_host.points, float) + scene.fur.origin - scene.mesh.bounds[0]
    return places.reshape(-1, SEGMENTS + 1, 3)


def densities(places, cell=0.04):
    """Of free points of strands with segments of one length, judged by the twin."""
    at = places[:, 1:].reshape(-1, 3)
    masses = np.tile([1.0] * (SEGMENTS - 1) + [0.5], len(places))
    low = at.min(0) - 2 * cell
    size = tuple(np.ceil((at.max(0) - low) / cell).astype(int) + 3)
    return twin.density_at(at, twin.grid_of(at, masses, 0 * at, low, cell, size)[1], low, cell)[0]
