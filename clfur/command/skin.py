"""What the skin says of its hair, by options and in the file of --types: maps, a comb, and where hair grows."""

from pathlib import Path

import click
import numpy as np

from .. import Comb, Error, Maps
from ..files.arrays import load_numbers
from ..files.images import load_picture
from .types import MAPS, read_for


def skin_of(mesh, options, said, folder):
    """{"maps": `Maps` or None, "comb": `Comb` or None} of options, and of what the file of --types has ``said``, whose
    files are in a folder; options count more."""
    maps = {name: value if not isinstance(value, str) else load_map(folder / value)
            for name, value in said.get("maps", {}).items()}
    maps |= {name: read_for("--map", load_map, file) for name, file in options["maps"]}
    names = options["on"] or said.get("on", ())
    if names:
        flag = "--on" if options["on"] else "--types"
        maps["on"] = read_for(flag, lambda names: mesh.mask(*names), (names,) if isinstance(names, str) else names)
    return {"maps": Maps(**maps) if maps else None, "comb": _comb(options, said.get("comb"), folder)}


def _comb(options, said, folder):
    """The `Comb` of the options, or of the file of --types."""
    said = dict(said) if isinstance(said, dict) else {} if said is None else {"direction": said}
    if isinstance(said.get("direction"), str):
        said["direction"] = load_map(folder / said["direction"])
    way = options["comb"]
    if way is not None:
        said["direction"] = read_for("--comb", load_map, way) if isinstance(way, str) else way
    if options["comb_weight"] is not None:
        said["weight"] = options["comb_weight"]
        if "direction" not in said:
            raise click.UsageError("--comb-weight is for hair that is combed; allowed: with --comb")
    return Comb(**said) if said else None


def load_map(path):
    """What a file says of the skin: the array of a .npy file, else a picture, or UDIM tiles of one."""
    return load_numbers(Path(path)) if Path(path).suffix.lower() == ".npy" else load_picture(path)


def check_said(said, where):
    """Raise `clfur.Error` for what the object in a file of --types says of the skin, if it is none of what it may."""
    if not isinstance(maps := said.get("maps", {}), dict) or not maps.keys() <= set(MAPS):
        odd = next((name for name in maps if name not in MAPS), maps) if isinstance(maps, dict) else maps
        raise Error(f"{where}: maps has {odd!r:.40}; allowed: an object with {', '.join(MAPS)}")
    comb = said.get("comb")
    if isinstance(comb, dict) and (not comb.keys() <= {"direction", "weight"} or "direction" not in comb):
        raise Error(f"{where}: comb has {', '.join(comb)!r:.60}; allowed: direction, and maybe weight")
    names = said.get("on", [])
    if not isinstance(names, (str, list)) or not all(isinstance(name, str) for name in names):
        raise Error(f"{where}: on is {names!r:.60}; allowed: a name, or a list of them")


def taken(strands):
    """For what is told of a picture: pixels of a type map that took the nearest key; or ""."""
    inexact = getattr(strands, "inexact", 0)
    if not inexact:
        return ""
    found = strands.type_indices
    pixels = sum(each.size for each in found.values()) if isinstance(found, dict) else np.size(found)
    return f"{inexact:,} of {pixels:,} pixels of the type map are no key: they took the nearest"
