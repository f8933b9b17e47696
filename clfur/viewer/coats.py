"""Coats that look well on any mesh: they go with its size."""

from collections.abc import Callable
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from ..scene import HairType, Kajiya, Mesh, Scene, Shells, Strands, Tufts

LENGTHS = ("length", "segment_length", "width")


def short_fur(mesh: Mesh) -> tuple:
    """Short fur, as of a cow or a mouse."""
    r = mesh.bounds[1]
    return (Strands(roots=80_000, types=HairType(
        color=(0.42, 0.24, 0.11), root_color=(0.14, 0.07, 0.03), length=0.05 * r, stiffness=0.6, segments=6,
        width=0.0012 * r, tip_width=0.3, length_variation=0.4, direction_variation=0.3, color_variation=0.25,
        tufts=Tufts(5000, strength=0.5), look=Kajiya(0.25, 40))),)


def long_hair(mesh: Mesh) -> tuple:
    """Long, shining hair that falls down."""
    r = mesh.bounds[1]
    return (Strands(roots=40_000, collision=True, force=(0, -2, 0), types=HairType(
        color=(0.55, 0.32, 0.13), root_color=(0.22, 0.11, 0.04), length=0.3 * r, stiffness=0.6, segments=16,
        width=0.0011 * r, tip_width=0.4, length_variation=0.2, direction_variation=0.12, color_variation=0.2,
        wave=(0.004 * r, 2.5), tufts=Tufts(1500, strength=0.5), look=Kajiya(0.5, 80))),)


def curls(mesh: Mesh) -> tuple:
    """Locks of curls, as of a poodle."""
    r = mesh.bounds[1]
    return (Strands(roots=40_000, types=HairType(
        color=(0.2, 0.11, 0.06), root_color=(0.07, 0.035, 0.02), length=0.16 * r, stiffness=1.0, segments=24,
        width=0.0013 * r, tip_width=0.4, length_variation=0.25, direction_variation=0.4, color_variation=0.2,
        curl=(0.012 * r, 3.5), tufts=Tufts(1200, strength=0.85, profile=0.6), frizz=(0.0015 * r, 6),
        look=Kajiya(0.35, 50))),)


def wool(mesh: Mesh) -> tuple:
    """Dense crimped wool, over shells."""
    r = mesh.bounds[1]
    return (Shells(length=0.04 * r, layers=24, hairs=40_000, density=0.9, color=(0.62, 0.55, 0.43), noise=(1.5, 6),
                   specular=0.05, exponent=10),
            Strands(roots=45_000, types=HairType(
                color=(0.75, 0.68, 0.55), root_color=(0.4, 0.34, 0.25), length=0.075 * r, stiffness=2.0, segments=20,
                width=0.0013 * r, tip_width=0.6, length_variation=0.3, direction_variation=0.7, color_variation=0.1,
                curl=(0.008 * r, 3), tufts=Tufts(3000, strength=0.7), frizz=(0.002 * r, 8), look=Kajiya(0.1, 15))))


def spikes(mesh: Mesh) -> tuple:
    """Stiff spines with bright tips, as of a hedgehog, over short fur."""
    r = mesh.bounds[1]
    return (Shells(length=0.025 * r, layers=20, hairs=60_000, color=(0.2, 0.13, 0.08), specular=0.1, exponent=20),
            Strands(roots=5_000, force=(0, -0.3, 0), types=HairType(
                color=(0.28, 0.18, 0.1), root_color=(0.12, 0.07, 0.04), tip_color=(0.9, 0.8, 0.6), length=0.13 * r,
                stiffness=6.0, segments=5, width=0.008 * r, tip_width=0.0, taper=0.3, length_variation=0.3,
                direction_variation=0.35, color_variation=0.2, alpha=0.0, look=Kajiya(0.5, 60))))


def velvet(mesh: Mesh) -> tuple:
    """Shells alone: a short even pile."""
    r = mesh.bounds[1]
    return (Shells(length=0.045 * r, layers=32, hairs=120_000, density=0.85, color=(0.35, 0.05, 0.07), noise=(0.4, 10),
                   specular=0.15, exponent=40),)


COATS: dict[str, Callable[[Mesh], tuple]] = {
    "Short fur": short_fur, "Long hair": long_hair, "Curls": curls, "Wool": wool, "Spikes": spikes, "Velvet": velvet}


def dressed(scene: Scene, name: str) -> Scene:
    """Return the scene with one of `COATS` in place of its fur. Raises Error without a mesh."""
    if scene.mesh is None:
        raise Error("the scene has no mesh for a coat; allowed: one with a mesh")
    return attrs.evolve(scene, fur=COATS[name](scene.mesh))


def fitted(fur: tuple, before: Mesh, mesh: Mesh) -> tuple:
    """Return the fur of one mesh for another: as large beside it, with as many hairs.

    What belongs to the faces, vertices or uv of the first is left out: levels by face, guides, maps, combs, a mesh in
    rest; without uv also type maps, then of all types the first is left, and textures. Curves, which stand on the
    first alone, become short fur.
    """
    times = mesh.bounds[1] / before.bounds[1]
    return tuple(_fitted_shells(each, times, mesh) if isinstance(each, Shells) else _fitted_strands(each, times, mesh)
                 if isinstance(each, Strands) else short_fur(mesh)[0] for each in fur)


def scaled(kind: HairType, times: float) -> HairType:
    """Return a hair type so many times as large."""
    fields: dict[str, Any] = {name: getattr(kind, name) and getattr(kind, name) * times for name in LENGTHS}
    fields |= {name: (getattr(kind, name)[0] * times, getattr(kind, name)[1]) for name in ("curl", "wave", "frizz")}
    return attrs.evolve(kind, tufts=spread(kind.tufts, times), **fields)


def spread(tufts: Tufts | None, times: float) -> Tufts | None:
    """Return tufts by density, as many on a mesh so many times as large."""
    if tufts is None:
        return None
    density = None if tufts.density is None else tufts.density / times**2
    return attrs.evolve(tufts, density=density, within=spread(tufts.within, times))


def _fitted_strands(strands, times, mesh):
    types = [scaled(kind, times) for kind in strands.types]
    if not mesh.has_uv:
        types = [attrs.evolve(kind, color_texture=None) for kind in types[:1 if strands.type_map is not None else None]]
    levels = {name: 5 if isinstance(getattr(strands, name), np.ndarray) else getattr(strands, name)
              for name in ("inner", "outer")}
    return attrs.evolve(strands, types=types, type_map=strands.type_map if mesh.has_uv else None, guides=None,
                        maps=None, comb=None, rest=None, **levels)


def _fitted_shells(shells, times, mesh):
    uv = {} if mesh.has_uv or shells.pattern == "cells" else {"pattern": "cells", "hairs": 60_000}
    return attrs.evolve(shells, **{"length": shells.length * times, "frequency": shells.frequency / (
        times if shells.pattern == "cells" else 1), "rest": None, "lean": None, **uv})
