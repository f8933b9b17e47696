"""Strands by area: settings, scenes, and the pieces of strands in each pixel."""

import numpy as np

import clfur
from clfur.scene import highlighted
from clfur.twin import coverage as twin

from .scenes import icosphere

NONE = np.uint64(twin.NONE)
SETTINGS = clfur.Settings(raster="coverage", samples=4, grid=16, shadow_map=32)
OFF = clfur.Settings(raster="coverage", samples=1, shadows="off", grid=16, shadow_map=16)
LIGHT = clfur.Light((-1, -.3, -.5), (1, .8, .6))


def pieces_of(fragments, resolved=None):
    """Structured [n] of `Fragments`; after `Resolved` of those that are used, whose share is of light."""
    ends = fragments.pixels.get()[..., 1].ravel().astype(np.int64)
    if resolved is None:
        starts, listed = fragments.starts.get().ravel().astype(np.int64), fragments.areas.get()
    else:
        starts, listed = ends - resolved.used.get().ravel(), resolved.weights.get()
    counts = ends - starts
    at = np.repeat(starts, counts) + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    result = np.zeros(len(at), [("pixel", "i8"), ("id", "i8"), ("depth", "i8"), ("share", "f4")])
    key, share = listed[at, 0], listed[at, 1].astype(np.uint32).view(np.float32)
    result["pixel"], result["share"] = np.repeat(np.arange(len(counts)), counts), share
    result["id"], result["depth"] = key & np.uint64(0xFFFFFFFF), key >> np.uint64(32)
    return np.sort(result, order=("pixel", "id"))


def wild(n, seed, extent=1.4, width=.1):
    """Strands through all that a camera sees, behind it too: [n, 5, 4]."""
    rng = np.random.default_rng(seed)
    steps = np.concatenate([rng.uniform(-extent, extent, (n, 1, 3)), rng.normal(size=(n, 4, 3)) * .25], 1)
    return np.concatenate([steps.cumsum(1), rng.uniform(0, width, (n, 5, 1))], 2)


def ball(half=.5, subdivisions=1):
    positions, faces = icosphere(subdivisions)
    return clfur.Mesh(positions * half, positions, np.abs(positions[faces][..., :2]), faces)


def furry(kind, n=60, size=(41, 31), highlight="kajiya-kay", **keys):
    rng = np.random.default_rng(1)
    strands = wild(n, 2, .8, .04)
    colors = {"all": rng.random(3), "strand": rng.random((n, 3)), "point": rng.random((n, 5, 3))}
    fur = clfur.Strands(inner=2, outer=2, types=clfur.HairType(width=.01, segment_length=.05, color_variation=.5,
                                                               segments=4)) if kind == "grown" else (
        clfur.Curves(strands[..., :3], width=strands[..., 3], color=colors[kind], specular=.3))
    fur = highlighted(fur, highlight)
    return clfur.Scene(ball(), fur, **{"camera": clfur.Camera(size=size), "light": LIGHT, **keys})
