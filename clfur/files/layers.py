"""Outputs of the renderer <-> parts of an EXR file: names of channels, whole numbers, Cryptomatte, the header."""

import json
from typing import Any

import attrs
import numpy as np

from .._version import __version__
from ..errors import Error
from ..scene import Camera
from . import exr, matte

# Names of the channels of each output, one for each of its last axis; NUMBERED ones have as many as there are.
CHANNELS = {"depth": ("Z",), "uv": ("uv.U", "uv.V"), "orientation": ("orientation.X", "orientation.Y"),
            "motion_vector": ("motion_vector.X", "motion_vector.Y")} | {
    name: tuple(f"{name}.{axis}" for axis in "XYZ") for name in ("tangent", "normal", "position")}
NUMBERED = ("type_alpha",)
WHOLE = 2**24         # of whole numbers up to it float32 holds each
RANKS = 6             # of a Cryptomatte of types
# What OpenImageIO and others convert, and what not.
COLOR, DATA = {"colorInteropID": "lin_rec709_scene"}, {"colorInteropID": "data"}
KIND = "clfur:dtype"  # attribute: what the arrays of a part were


def about(camera: Camera | None = None, settings: Any = None) -> dict:
    """{attribute: value} of a header: who made the picture, and of what."""
    found: dict[str, Any] = {"software": f"clfur {__version__}"}
    if camera is not None:
        if not isinstance(camera, Camera):
            raise Error(f"save camera is {camera!r:.60}; allowed: a clfur.Camera")
        found["clfur:camera"] = json.dumps({"pose": camera.pose.tolist(), "intrinsics": camera.intrinsics.tolist(),
                                            "size": list(camera.size)})
        # The attribute's camera looks along +z, and its points are rows.
        found["worldToCamera"] = (np.diag([1, 1, -1, 1]) @ np.linalg.inv(camera.pose)).T.astype(np.float32)
    if settings is not None:
        if not attrs.has(type(settings)):
            raise Error(f"save settings is {settings!r:.60}; allowed: a clfur.Settings")
        found["clfur:settings"] = json.dumps(attrs.asdict(settings))
    return found


def header_of(parts: list[exr.Part]) -> dict:
    """{"software": text, "camera": Camera or None, "settings": {name: value} or None} of what `about` gave."""
    header, found = parts[0].header, {"software": parts[0].header.get("software", ""), "camera": None, "settings": None}
    try:
        if "clfur:camera" in header:
            found["camera"] = Camera.calibrated(**json.loads(header["clfur:camera"]))
        if "clfur:settings" in header:
            found["settings"] = dict(json.loads(header["clfur:settings"]))
    except (TypeError, ValueError):
        raise Error("has a header that clfur did not write") from None
    return found


def parts_of(outputs: dict[str, np.ndarray], about: dict) -> list[exr.Part]:
    """[`exr.Part`], one for each output, colour first: what converts colours leaves the others as they are."""
    parts, rest = [], dict(outputs)
    for name in sorted(rest, key=lambda name: name != "color"):
        array = rest[name]
        if name in ("matte_id", "matte_alpha"):
            continue
        names = _names(name, array)
        planes = array if array.ndim == 3 else array[:, :, None] if array.ndim == 2 else None
        if planes is None or planes.shape[2] != len(names) or 0 in planes.shape:
            allowed = "in .npz" if array.ndim == 1 else f"[h, w, {len(names)}]"
            raise Error(f"save output {name!r} has the shape {list(array.shape)}; allowed: {allowed}")
        parts.append(exr.Part(name, {each: _stored(name, planes[:, :, k]) for k, each in enumerate(names)},
                              (COLOR if name == "color" else DATA) | {KIND: str(array.dtype)}))
    if "type_alpha" in outputs:
        parts.append(_matte("CryptoType", *matte.ranked(outputs["type_alpha"], outputs.get("body_alpha"), RANKS)))
    if "matte_id" in outputs or "matte_alpha" in outputs:
        ids, shares = outputs.get("matte_id"), outputs.get("matte_alpha")
        if ids is None or shares is None or ids.shape != shares.shape or ids.ndim != 3 or ids.shape[2] % 2:
            raise Error("save has one of matte_id and matte_alpha, or they differ; allowed in .exr: both, of one shape "
                        "[h, w, an even number]")
        parts.append(_matte("CryptoStrand", ids, shares))
    if len({array.shape for part in parts for array in part.channels.values()}) != 1:
        raise Error("save outputs are not all of one size; allowed: arrays of the same [h, w]")
    parts[0].header |= about
    return parts


def outputs_of(parts: list[exr.Part]) -> dict[str, np.ndarray]:
    """{output: array} of what `parts_of` gave, or of others' channels."""
    try:
        return _outputs_of(parts)
    except Error:
        raise
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise Error("has channels that do not go with its header") from None


def _outputs_of(parts):
    found: dict[str, np.ndarray] = {}
    for part in parts:
        channels, kind = part.channels, part.header.get(KIND)
        cryptos = [name for name in matte.LAYERS if f"{name}00.R" in channels]
        if cryptos == ["CryptoStrand"]:
            found["matte_id"], found["matte_alpha"] = matte.read_layer("CryptoStrand", channels, part.header)
        elif kind is not None and not cryptos:
            name = part.name
            planes = [channels[each] for each in _ordered(name, channels)]
            array = planes[0] if len(planes) == 1 and name not in NUMBERED else np.stack(planes, 2)
            signed = np.dtype(kind).kind == "i" and array.dtype == np.uint32
            found[name] = (array.view(np.int32) if signed else array).astype(kind)
        elif not cryptos:
            found |= _others(channels)
    return found


def _names(name, array):
    if name == "color":
        return tuple("RGBA"[:array.shape[2]])
    if name in NUMBERED and array.ndim == 3:
        return tuple(f"{name}.{k:03}" for k in range(array.shape[2]))
    return CHANNELS.get(name, (name,))


def _ordered(name, channels):
    """The channels of an output, in its own order."""
    order = tuple("RGBA") if name == "color" else CHANNELS.get(name, sorted(channels))
    return [each for each in order if each in channels]


def _others(channels):
    """Channels of another program's as outputs."""
    found, rest = {}, dict(channels)
    colors = [name for name in "RGBA" if name in rest]
    if colors[:3] == list("RGB"):
        found["color"] = np.stack([rest.pop(name).astype(np.float32) for name in colors], 2)
    if "Z" in rest:
        found["depth"] = rest.pop("Z").astype(np.float32)
    return found | {name: array if array.dtype.kind == "u" else array.astype(np.float32)
                    for name, array in rest.items()}


def _stored(name, array):
    """An array as EXR has it: float32, or uint32 for whole numbers of which some are beyond what floats hold.

    Others are floats, so that -1 is -1 to all who read it: OpenImageIO makes floats of whole numbers unless told.
    """
    if array.dtype.kind not in "iu" or not array.size or (np.abs(array.astype(np.float64)) <= WHOLE).all():
        return np.ascontiguousarray(array, np.float32)
    limits = np.iinfo(np.int32 if array.dtype.kind == "i" else np.uint32)
    if not limits.min <= int(array.min()) <= int(array.max()) <= limits.max:
        raise Error(f"save output {name!r} has whole numbers from {array.min()} to {array.max()}; allowed in .exr: "
                    f"from {limits.min} to {limits.max}")
    return np.ascontiguousarray(array.astype(np.int64).astype(np.uint32))


def _matte(name, ids, shares):
    channels, header = matte.layer(name, ids, shares)
    return exr.Part(name, channels, DATA | header)
