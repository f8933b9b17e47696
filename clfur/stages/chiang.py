"""Looks of Chiang's model -> tables of how hair scatters light around itself, and what else kernels look up of it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array

SHADES = int(layout.CONSTANTS["SHADES"])
WAY = 1.85           # radii that light goes on its way through hair, about: by it shades are chosen
SHARES = Declared("share", np.float32, 4)   # of light that leaves by each lobe, while a table is made
KEPT = "looks"       # begins the key of what is kept of looks, whatever the scene


@dataclass(frozen=True)
class Scattering(Arrays):
    """How hair scatters light, by type: cl/scatter.h looks it up."""

    lobes: Any = array("type", layout.Lobes)
    lobe_table: Any = array("entry", np.float32, 4)   # [cosines, angles, SHADES] R, TT, TRT, rest; one after the other

    def arrays(self) -> dict:
        """All of it, as arguments of a launch."""
        return dict(vars(self))


def no_scattering(gpu: Any) -> Scattering:
    """`Scattering` of types that are all of other models."""
    return Scattering.empty(gpu, {"type": 0, "entry": 0})


def of_model(types: Any) -> list:
    """Those of `clfur.HairType`s whose look is of this model."""
    return [kind for kind in types if kind.look.model == "chiang"]


def lobed(types: Any, hairy: Any) -> tuple:
    """`clfur.HairType`s as `scattering` takes them, () if it is not needed; ``hairy``: [types] whether hair is of each.

    Types of which none is are taken for the first that has lobes: they cost no table, and kernels that run over all
    types find one of each.
    """
    first = next(iter(of_model(kind for kind, there in zip(types, hairy) if there)), None)
    return () if first is None else tuple(kind if there else first for kind, there in zip(types, hairy))


def scattering(gpu: Any, types: Any) -> Scattering:
    """`Scattering` of `clfur.HairType`s: a table for each roughness around the strand and index that differ.

    Tables are linear between cosines of the eye's angle, angles around the strand and shades of colour, none of which
    takes light away or adds any: sums over all angles stay 1 where nothing is absorbed.
    """
    lobes, places = np.zeros(len(types), layout.Lobes), _places(types)
    table = Scattering.declared["lobe_table"].empty(gpu, entries(types))
    for row, kind in zip(lobes, types):
        if kind.look.model != "chiang":
            continue
        look = kind.look
        for lobe, v, tilt in zip(row["along"], look.variances, (2, -1, -4, 0)):
            angle = tilt * look.lobes[2]
            lobe[:] = 1 / v, 1 / (v * -math.expm1(-2 / v)), math.sin(angle), math.cos(angle)
        row["color"][0] = WAY * math.log(2) / look.depth**2
        row["table"] = places[_kind_of(look)], *sizes(look.scale), 0
    for look in {_kind_of(kind.look): kind.look for kind in of_model(types)}.values():
        tabulate(gpu, look, *sizes(look.scale), places[_kind_of(look)], table)
    return Scattering(gpu.upload(lobes), table)


def tabulate(gpu: Any, look: Any, n_cosines: int, angles: int, first: int, table: Any) -> None:
    """Fill rows of a ``table``, [cosines, angles, SHADES] from row ``first`` on, for the `clfur.Chiang` of a type."""
    s, index = look.scale, look.index
    x, weights = np.polynomial.legendre.leggauss(_places_across(s))   # over 0 to pi / 2, of the angle
    gammas, weights = math.pi / 4 * (x + 1), math.pi / 4 * weights
    given = {"index": index, "entries": len(x), "cosines": gpu.upload(np.float32(cosines(n_cosines))),
             "gammas": gpu.upload(np.float32(gammas)),
             "shares": SHARES.empty(gpu, n_cosines * len(x) * SHADES)}
    gpu.launch("chiang.attenuate", n_cosines * len(x), absorptions=gpu.upload(np.float32(shades())), **given)
    gpu.launch("chiang.gather", n_cosines * angles, s=s, whole=math.tanh(math.pi / (2 * s)), angles=angles, first=first,
               weights=gpu.upload(np.float32(weights * np.cos(gammas))), table=table, **given)


def entries(types: Any) -> int:
    """Rows of the tables of `clfur.HairType`s."""
    return sum(math.prod(sizes(scale)) * SHADES for scale in _scales(types))


def bytes_of(types: Any) -> int:
    """Bytes on the device of `scattering`, and of what it takes meanwhile."""
    shares = max((sizes(scale)[0] * _places_across(scale) * SHADES for scale in _scales(types)), default=0)
    return Scattering.bytes(type=len(types), entry=entries(types)) + SHARES.bytes * shares


def sizes(scale: float) -> tuple[int, int]:
    """(Cosines, angles) of a table of lobes as narrow as this: enough for 1 % of what is above a tenth."""
    return max(math.ceil(10 * scale**-.65), 24), max(math.ceil(9 / scale), 48)


def shades() -> np.ndarray:
    """What a radius absorbs of each shade of the tables -> [SHADES] float64, from most to none."""
    return -np.log(np.maximum(np.linspace(0, 1, SHADES), 1e-12)) / WAY


def cosines(n: int) -> np.ndarray:
    """Cosines of the eye's angle of which a table has rows -> [n] float64: near 0, where they matter most, dense."""
    return ((np.sqrt(1 + 8 * np.linspace(0, 1, n)) - 1) / 2)**2


def _places_across(scale):
    """How many places across half a strand's width do for lobes as narrow as this."""
    return int(3 / scale) + 32


def _scales(types):
    """Scales of all tables."""
    return list({_kind_of(kind.look): kind.look.scale for kind in of_model(types)}.values())


def _kind_of(look):
    """By what tables differ."""
    return look.azimuthal_roughness, look.index


def _places(types):
    """{kind of table: where it begins}."""
    places, begin = {}, 0
    for kind in of_model(types):
        if _kind_of(kind.look) not in places:
            places[_kind_of(kind.look)] = begin
            begin += math.prod(sizes(kind.look.scale)) * SHADES
    return places
