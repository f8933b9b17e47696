"""Meshes and scenes."""

import numpy as np

import clfur
from clfur.stages.strands import grow, upload_curves
from clfur.stages.tessellate import tessellate


def icosphere(subdivisions):
    """Unit sphere of 20·4^n triangles -> (positions [V, 3], faces [F, 3])."""
    g = (1 + 5**0.5) / 2
    positions = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g),
                 (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
             (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5),
             (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    positions, faces = np.array(positions, float), np.array(faces)
    for _ in range(subdivisions):
        a, b, c = (positions[faces[:, i]] for i in range(3))
        n, f = len(positions), len(faces)
        middles = np.concatenate([a + b, b + c, c + a])
        ab, bc, ca = (np.arange(f) + n + i * f for i in range(3))
        faces = np.concatenate([np.stack(t, 1) for t in (
            (faces[:, 0], ab, ca), (ab, faces[:, 1], bc), (ca, bc, faces[:, 2]), (ab, bc, ca))])
        positions = np.concatenate([positions, middles])
        positions /= np.linalg.norm(positions, axis=1, keepdims=True)
    return positions / np.linalg.norm(positions, axis=1, keepdims=True), faces


def squares(*sizes_and_heights):
    """Level squares around the y axis: half a side and height of each, facing up."""
    corners = np.array([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], float)
    positions = np.concatenate([corners * size + (0, height, 0) for size, height in sizes_and_heights])
    faces = np.array([(0, 2, 1), (0, 3, 2)])
    return clfur.Mesh(positions, faces=np.concatenate([faces + 4 * i for i in range(len(sizes_and_heights))]))


def scene_of(kind, mesh, body=(.3, .2, .1)):
    rng = np.random.default_rng(5)
    camera = clfur.Camera(eye=(0, .4, 3.2), size=(121, 83))
    if kind in ("curves", "striped"):
        roots = rng.normal(size=(2500, 1, 3))
        roots /= np.linalg.norm(roots, axis=-1, keepdims=True)
        counts = rng.integers(0, 12, 2500)
        points = (roots * (1 + .05 * np.arange(12))[None, :, None])[np.arange(12) < counts[:, None]]
        fur = clfur.Curves(points, counts=counts, width=rng.uniform(.002, .01, len(points)),
                           color=rng.uniform(0, 1, (2500 if kind == "curves" else len(points), 3)))
    else:
        hair = clfur.HairType(segments=8, segment_length=.03, curl=(.01, 1), width=.004, length_variation=.3,
                              direction_variation=.3, color_variation=.2)
        fur = clfur.Strands(types=[hair], roots=kind, seed=3, inner=3, outer=3)
    return clfur.Scene(mesh=mesh, fur=fur, camera=camera, body_color=body)


def strands_of(gpu, scene):
    """The scene's strands on the device."""
    fur = scene.fur
    if isinstance(fur, clfur.Curves):
        return upload_curves(gpu, fur)
    return grow(gpu, tessellate(gpu, scene.mesh, fur.inner, fur.outer, fur.surface), fur)
