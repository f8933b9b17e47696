"""Strands by area: settings, scenes, and the pieces of strands in each pixel."""

from pathlib import Path

import numpy as np

import clfur
from clfur.scene import highlighted
from clfur.stages import coverage
from clfur.twin import coverage as twin

from .scenes import icosphere

NONE = np.uint64(twin.NONE)
SETTINGS = clfur.Settings(raster="coverage", samples=4, grid=16, shadow_map=32)
OFF = clfur.Settings(raster="coverage", samples=1, shadows="off", grid=16, shadow_map=16)
LIGHT = clfur.Light((-1, -.3, -.5), (1, .8, .6))


PIECE = [("pixel", "i8"), ("id", "i8"), ("depth", "i8"), ("share", "f4"), ("at", "f4")]


class Kernels:
    """The folder of kernels, and in it those of the tests."""

    def __init__(self, folder):
        self.folder = folder

    def joinpath(self, name):
        own = Path(__file__).with_name(name)
        return own if own.is_file() else self.folder.joinpath(name)


def counted(gpu, view, strands, visible):
    """(`Tiles`, `Segments`) of strands."""
    tiles = coverage.bound(gpu, view, visible)
    coverage.count(gpu, view, strands, tiles)
    segments = coverage.allocate(gpu, tiles.counts.get(), int(tiles.survivors.get()[0]))
    coverage.fill(gpu, view, strands, tiles, segments)
    assert (segments.cursors.get() == segments.starts.get()[1:]).all()
    assert segments.survivors.get() == tiles.survivors.get()
    return tiles, segments


def pieces_of(gpu, view, segments):
    """All pieces of `Segments`, whatever hides them, in the order of pixels and ids: structured [n]."""
    n = len(segments.ids)
    numbers = np.stack([np.zeros(n), np.arange(n)], 1).astype(np.uint32)
    room = 0
    for _ in range(2):
        count, keys, pixels = gpu.full(1, np.uint32, 0), gpu.empty(room, np.uint64), gpu.empty(room, np.uint32)
        shares, ats = (gpu.empty(room, np.float32) for _ in range(2))
        gpu.launch("pieces.drawn", n, view=view, list=gpu.upload(numbers), ends=segments.ends, ids=segments.ids,
                   cuts=segments.cuts, room=room, count=count, keys=keys, pixels=pixels, shares=shares, ats=ats)
        room = int(count.get()[0])
    result = np.zeros(room, PIECE)
    key = keys.get()
    result["pixel"], result["share"], result["at"] = pixels.get(), shares.get(), ats.get()
    result["id"], result["depth"] = key & np.uint64(0xFFFFFFFF), key >> np.uint64(32)
    return np.sort(result, order=("pixel", "id"))


def hidden(gpu, pieces, visible, shell_transmittance=None, shell_front=None, light=None, behind=0):
    """{name: array} of what is seen of pieces, structured as from `pieces_of`, of a pixel one after the other.

    visible: [rows, width, samples] uint64, the body's.  light: [pieces, 3] of each; none if None.  behind:
    light of shells.
    """
    rows, width, samples = visible.shape
    has_shells, n = shell_front is not None, len(pieces)
    order = np.argsort(pieces["pixel"], kind="stable")
    pieces = pieces[order]
    places = np.zeros((n, 5), np.uint64)   # the same at all of them, see places.h
    if light is not None:
        r, g, b = (np.asarray(light, np.float32)[order].view(np.uint32) >> np.uint32(10)).astype(np.uint64).T
        places[:] = (r << np.uint64(42) | g << np.uint64(21) | b)[:, None]
    starts = np.searchsorted(pieces["pixel"], np.arange(rows * width + 1)).astype(np.uint32)
    keys = pieces["depth"].astype(np.uint64) << np.uint64(32) | pieces["id"].astype(np.uint64)
    through = gpu.upload(shell_transmittance) if has_shells else gpu.empty(visible.shape, np.float32)
    out = {"body_transmittance": through, "alpha": gpu.empty((rows, width), np.float32),
           "front": gpu.empty((rows, width), np.uint64),
           "shell_front": gpu.empty((rows if has_shells else 0, width), np.uint64),
           "image": gpu.full((rows, width, 4), np.float32, behind)}
    gpu.launch("pieces.hidden", rows * width, samples=samples, starts=gpu.upload(starts), keys=gpu.upload(keys),
               shares=gpu.upload(np.ascontiguousarray(pieces["share"])), places=gpu.upload(places),
               visible=gpu.upload(visible), has_shells=has_shells,
               sample_shells=gpu.upload(shell_front) if has_shells else gpu.empty(0, np.uint64), **out)
    return {name: array.get() for name, array in out.items()}


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
