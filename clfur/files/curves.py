"""Strand files <-> Curves."""

import functools
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..errors import Error, go_on, shown
from ..scene import Bounds, Curves, HairType, checks
from . import usd_curves
from .arrays import SETUP, read_npy, read_npz, write_npy, write_npz
from .curve_text import write_mitsuba, write_pbrt
from .fields import usual_width
from .hair import read_hair, write_hair
from .input import read, size_of
from .output import is_path, output_path, whole
from .strand_ply import read_strand_ply, write_strand_ply
from .tressfx import read_tfx, write_tfx
from .usc import read_usc, write_usc
from .usd import SUFFIXES

READERS = {".hair": read_hair, ".tfx": read_tfx, ".data": read_usc, ".ply": read_strand_ply, ".npz": read_npz,
           ".npy": read_npy}
USD = SUFFIXES
WRITERS: dict[str, Callable[..., bytes]] = {
    ".hair": write_hair, ".tfx": write_tfx, ".data": write_usc, ".ply": write_strand_ply, ".npz": write_npz,
    ".npy": write_npy, ".txt": write_mitsuba, ".pbrt": write_pbrt,
    **{suffix: functools.partial(usd_curves.write, suffix=suffix) for suffix in USD[:3]}}
FORMATS = ", ".join((*READERS, *USD))
TEXTS = ".txt", ".pbrt"   # which take long
OF_ROOTS = "root_uv", "root_normal"
VALUES: dict[str, tuple] = {"width": (), "color": (3,), "transparency": ()}   # of all, of strands or of points
USUAL: dict[str, Any] = {field.name: field.default for field in attrs.fields(Curves)}
STEPS = 255     # of transparency that strands of one file may differ by


def load_curves(path: str | os.PathLike, *, width: float | None = None, color: Any = None, tolerance: float = 0.25,
                time: float | None = None) -> Curves:
    """Return the `Curves` of a strand file.

    path: str or path-like; .hair (cyHair), .tfx (TressFX 4), .data (USC-HairSalon), .ply (strands or edges), .npz,
    .npy, and with usd-core .usd, .usda, .usdc, .usdz (BasisCurves), by suffix; docs/formats.md says of each what its
    width means, where the root is, and its units. width: the strands' diameter where the file says none; None: 0.0012
    of half the diagonal of all strands. color: RGB, linear light, where the file says none; None: a HairType's.
    tolerance: how far a polyline may be from a cubic curve of USD, in its widths. time: of USD's time samples, in its
    time codes; None: the first.
    Strands whose transparency differs become types. Raises Error, one line that names the file, for one that is
    missing, damaged, cut short, without strands, no regular file or of more than 2**30 bytes.
    """
    given = {"width": None if width is None else checks.real(low=0)(width, "load_curves width"), "color": color}
    return read_curves(path, {name: value for name, value in given.items() if value is not None}, tolerance, time)


def read_curves(path: str | os.PathLike, given: dict[str, Any], tolerance: float = 0.25, time: float | None = None
              ) -> Curves:
    """Return the `Curves` of a file; ``given``: fields of theirs where the file says nothing of them."""
    if not is_path(path):
        raise Error(f"load_curves path is {shown(path)}; allowed: a file's name")
    file = Path(path)
    tolerance = checks.real(low=1e-3, high=1e3)(tolerance, "load_curves tolerance")
    time = None if time is None else checks.real()(time, "load_curves time")
    suffix = file.suffix.lower()
    if os.path.isdir(file):
        raise Error(f"{file}: is a folder; allowed: a file {FORMATS}")
    if not os.path.exists(file):
        raise Error(f"{file}: no such file")
    if suffix not in READERS and suffix not in USD:
        written = ", which is written alone" if suffix in WRITERS else ""
        raise Error(f"{file}: {file.suffix or 'no suffix'} is no strand file{written}; allowed: {FORMATS}")
    data = b"" if suffix in USD else read(file)   # usd-core reads for itself
    if not (data or size_of(file)):
        raise Error(f"{file}: is empty")
    try:
        with np.errstate(all="ignore"):   # what is not finite is an Error of Curves
            strands = usd_curves.read(file, tolerance, time) if suffix in USD else READERS[suffix](data, file)
            found = curves_from(strands, given)
    except Error as error:
        raise Error(f"{file}: {error}") from None
    except Exception as error:   # a reader may fail in any way on a damaged file; the user gets one line
        first_line = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise Error(f"{file}: cannot be read as {suffix}: {first_line}") from error
    if "note" in strands:
        warnings.warn(f"{file}: {strands['note']}", stacklevel=3)
    return found


def save_curves(path: str | os.PathLike, curves: Curves, stop: Callable[[], bool] | None = None) -> None:
    """Write the strands of `Curves` to a file, whole or not at all.

    path: str or path-like; as for `load_curves`, but .usdz, and also .txt (Mitsuba's curves) and .pbrt, by suffix.
    What a format has no place for is left out: docs/formats.md. Places are float32 but in .npz, .npy, .ply and text.
    stop: None, or a function without arguments, asked now and then: once it says True, Stopped is raised.
    Raises Error for another suffix, a folder that is not, no strands, those that the format cannot hold, or no room.
    """
    checks.to_stop(stop, "stop")
    file = output_path(path, tuple(WRITERS))
    if not isinstance(curves, Curves):
        raise Error(f"save_curves curves is {shown(curves)}; allowed: a clfur.Curves, as clfur.grow returns")
    try:
        if not (strands := stored(curves))["counts"].size:
            raise Error("Curves have no strands with points; allowed: one or more")
        go_on(stop)
        writer, suffix = WRITERS[file.suffix.lower()], file.suffix.lower()
        data = writer(strands, stop=stop) if suffix in TEXTS else writer(strands)
        go_on(stop)
    except Error as error:
        raise Error(f"{file}: {error}") from None
    with whole(file) as temporary:
        temporary.write_bytes(data)


def stored(curves: Curves) -> dict[str, Any]:
    """Return what files hold of Curves: points float64 [total, 3], counts int64 [strands]; width, color and
    transparency float32, [1, ...] for all or [total, ...] for each point; root_uv and root_normal where they are; and
    setup, {name: value} of `SETUP`, of which bounds is an array [7]. Strands without points are left out."""
    curves = curves.on_host
    there = curves.counts > 0
    counts = curves.counts[there].astype(np.int64)
    alphas = np.array([kind.alpha for kind in curves.hair_types], np.float32)
    same = curves.type_of is None or (alphas == alphas[0]).all()
    values = {"width": curves.width, "color": curves.color,
              "transparency": alphas[:1] if same else alphas[curves.type_of]}
    for name, each in values.items():
        if len(each) == len(there) > 1:   # of strands, also where there are as many points: see `Curves`
            values[name] = np.repeat(np.asarray(each)[there], counts, axis=0)
    found = {"points": curves.points.astype(np.float64) + curves.origin, "counts": counts, **values,
             **{name: getattr(curves, name)[there] for name in OF_ROOTS if getattr(curves, name) is not None}}
    setup: dict[str, Any] = {name: getattr(curves, name) for name in SETUP if name != "bounds"}
    found["setup"] = {name: value for name, value in setup.items() if not np.array_equal(value, USUAL[name])}
    if (bounds := curves.bounds) is not None:
        found["setup"]["bounds"] = np.array([*bounds.center, *attrs.astuple(bounds)[1:]], np.float64)
    return found


def curves_from(strands: dict[str, Any], given: dict[str, Any]) -> Curves:
    """The Curves of what a reader returns: as `stored`, but color may also be sRGB, values may be per strand, and width
    and the rest may be missing, which are as ``given``."""
    points, counts = np.asarray(strands["points"]), strands.get("counts")
    if counts is None and points.ndim == 3:
        counts = np.full(len(points), points.shape[1])
        points = points.reshape(-1, 3)
    if not points.size or counts is None or not len(counts):
        raise Error("has no strands" if counts is not None or not points.size else "has points but no counts")
    counts = np.asarray(counts)
    if counts.ndim != 1 or counts.dtype.kind not in "iu" or int(counts.sum()) != len(points) or counts.min() < 0:
        raise Error(f"has {len(points)} points, but its counts add up to {int(counts.sum())}; allowed: whole numbers "
                    ">= 0 that add up to it")
    there = counts > 0   # the others are nothing to draw
    found = {name: np.asarray(strands[name]) for name in VALUES if name in strands}
    if len(there) != len(points):
        found = {name: value[there] if value.shape == (len(there), *VALUES[name]) else value
                 for name, value in found.items()}
    counts = counts[there]
    fields: dict[str, Any] = {name: np.asarray(strands[name])[there] for name in OF_ROOTS if name in strands}
    fields |= {name: _by_strand(found[name], VALUES[name], counts) for name in ("width", "color") if name in found}
    if not np.any(fields.get("width", 0)):
        fields["width"] = given.get("width", usual_width(points))
    if "transparency" in found:
        fields |= _types(found["transparency"].astype(np.float64), counts, given.get("look"))
        given = {name: value for name, value in given.items() if name not in ("alpha", "look") or "alpha" in fields}
    setup = dict(strands.get("setup", {}))
    if "bounds" in setup:
        if np.shape(setup["bounds"]) != (7,):
            raise Error(f"has bounds of shape {list(np.shape(setup['bounds']))}; allowed: [7]")
        *center, radius, segments, length, area = setup["bounds"].tolist()
        setup["bounds"] = Bounds(center, radius, int(segments), length, area)
    if len(counts) and counts.max() == 1:
        warnings.warn("strands of a file have one point each, and nothing of them is drawn", stacklevel=4)
    rest: dict[str, Any] = {**given, **setup, **fields}
    return Curves(points=points, counts=counts, **rest)


def _by_strand(values, tail, counts):
    """Values for all, for each strand or for each point; per strand where they are the same along each."""
    total, strands = int(counts.sum()), len(counts)
    if values.shape == (strands, *tail) and total != strands:
        return values[:, None]
    if values.shape != (total, *tail) or total == strands or not counts.all():
        return values
    roots = values[np.cumsum(counts) - counts]
    return roots[:, None] if np.array_equal(np.repeat(roots, counts, axis=0), values) else values


def _types(clear, counts, look):
    """{"alpha"} of transparency that is the same for all, else {"types", "type_of"} of each strand's mean."""
    if not (np.isfinite(clear).all() and clear.min() >= 0 and clear.max() <= 1):
        raise Error(f"has transparencies of {clear.min():g} to {clear.max():g}; allowed: 0 to 1")
    if clear.size == 1 or clear.min() == clear.max():
        return {"alpha": float(clear.flat[0])}
    if clear.size == int(counts.sum()):
        sums = np.concatenate([[0], np.cumsum(clear.ravel())])
        ends = np.cumsum(counts)
        clear = (sums[ends] - sums[ends - counts]) / np.maximum(counts, 1)
    steps, type_of = np.unique(np.rint(clear.ravel() * STEPS).astype(np.uint8), return_inverse=True)
    return {"types": [HairType(alpha=float(step) / STEPS, look=look) for step in steps], "type_of": type_of}
