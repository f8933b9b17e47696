"""Hair types of the options, and of a JSON file whose fields count more."""

import json
from pathlib import Path

import attrs
import numpy as np

from .. import Chiang, Error, HairType
from ..files.images import load_picture
from ..files.input import plain, read
from .skin import check_said
from .types import from_hex, look_of, read_for, tufts_of


def hair_type(defaults, given):
    """A `HairType` of the fields given and of defaults; its rule of growth is that of which a field is given, or the
    first of the ``rules`` in defaults. Roots are half as bright where nothing is said; a Chiang's pigment may be all
    its colour."""
    others = dict(defaults)
    rules = others.pop("rules", ({},))
    rule = next((rule for rule in rules if rule.keys() & given.keys()), rules[0])
    kind = HairType(**{**others, **rule, **given})
    if kind.root_color is None and not isinstance(kind.look, Chiang):
        kind = attrs.evolve(kind, root_color=kind.color / 2)
    return kind


def type_map(path):
    """The picture of a type map's file, or {number: picture} of its tiles."""
    pixels = read_for("--type-map", load_picture, path)
    if any(each.dtype != np.uint8 for each in (pixels.values() if isinstance(pixels, dict) else [pixels])):
        raise Error(f"--type-map: {path}: has more than 8 bits a channel; allowed in a type map: 8, as the keys of "
                    "types have")
    return pixels


def _once(pairs):
    """The dict of a JSON object's pairs; ValueError for a name that is there twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r:.40} is there twice in an object")
    return found


SAID = "types", "type_map", "maps", "comb", "on"


def groom_of(path):
    """What a JSON file says of hair, {one of SAID: what}: an object of these, or a list, which is of types. Raises
    `clfur.Error` naming the file."""
    try:
        listed = json.loads(plain(read(Path(path))).decode(), object_pairs_hook=_once)
    except Error:
        raise
    except (ValueError, RecursionError) as error:
        raise Error(f"{path} is not JSON: {error}") from None
    said = listed if isinstance(listed, dict) else {"types": listed}
    if unknown := [name for name in said if name not in SAID]:
        raise Error(f"{path}: unknown name {unknown[0]!r:.60}; allowed: a list of types, or an object with "
                    + ", ".join(SAID))
    types = said.get("types", [])
    if not said or not isinstance(types, list) or not all(isinstance(fields, dict) for fields in types):
        raise Error(f'{path} must hold a list of objects, such as [{{"key": [255, 0, 0], "segments": 10}}]')
    check_said(said, path)
    return said


def hair_types(path, listed, defaults):
    """The hair types that a JSON file has ``listed``; raises `clfur.Error` naming the file, the type, the field."""
    allowed = [field.alias for field in attrs.fields(HairType) if field.init]
    types = []
    for number, fields in enumerate(listed):
        where = f"{path}, type {number}"
        if unknown := [name for name in fields if name not in allowed]:
            raise Error(f"{where}: unknown field {unknown[0]!r}; allowed: {', '.join(allowed)}")
        try:
            if isinstance(texture := fields.get("color_texture"), str):
                fields["color_texture"] = load_picture(Path(path).parent / texture)
            for name in ("color", "root_color", "tip_color"):
                if isinstance(color := fields.get(name), str):
                    fields[name] = from_hex(color)
            if fields.get("tufts") is not None:
                fields["tufts"] = tufts_of(fields["tufts"])
            if isinstance(look := fields.get("look"), str):
                fields["look"] = look_of(look)
            elif "specular" in fields or "exponent" in fields:   # they make one
                fields.setdefault("look", None)
            types.append(hair_type(defaults, fields))
        except ValueError as error:   # clfur.Error is one
            raise Error(f"{where}: {error}") from None
    return types
