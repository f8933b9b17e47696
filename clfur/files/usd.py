"""Strands in USD files: BasisCurves of every type, basis and wrap.  usd-core reads them, a library that is asked for
only here (`pip install "clfur[usd]"`)."""

import re
import tempfile
from pathlib import Path

import numpy as np

from ..errors import Error
from ..scene.origin import ZERO, near_origin
from .bases import TO_BEZIER, chords_of, segments_of, unrolled
from .fields import usual_width

TO_Y_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float64)   # rows: where x, y and z of a Z-up stage point


def _library():
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, Vt
    except ImportError:
        raise Error('needs usd-core to be read or written; allowed: pip install "clfur[usd]"') from None
    return Gf, Sdf, Usd, UsdGeom, Vt


def read(path: Path, tolerance: float, time: float | None) -> dict:
    """Return the strands of all BasisCurves of a USD stage that are seen: points, counts, and as they have them width,
    color and transparency, per point.

    Places are in the stage's units, turned to +Y up. tolerance: how far chords may be from cubic curves, in widths.
    time: of time samples; None: the stage's first.
    """
    _, _, Usd, UsdGeom, _ = _library()
    try:
        stage = Usd.Stage.Open(str(path))
    except Exception as error:   # usd-core's own
        raise Error(f"cannot be read as USD: {_reason(error)}") from None
    at = Usd.TimeCode(time) if time is not None else Usd.TimeCode.EarliestTime()
    places, sets = UsdGeom.XformCache(at), []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        if prim.IsA(UsdGeom.NurbsCurves) and _is_seen(UsdGeom, prim, at):
            raise Error(f"has NurbsCurves at {prim.GetPath()}; allowed: BasisCurves")
        if prim.IsA(UsdGeom.BasisCurves) and _is_seen(UsdGeom, prim, at):
            try:
                sets.append(_strands(UsdGeom, prim, at, np.array(places.GetLocalToWorldTransform(prim)), tolerance))
            except Error as error:
                raise Error(f"{prim.GetPath()}: {error}") from None
    if not sets:
        raise Error("has no BasisCurves that are seen")
    found = _together(sets)
    if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z:
        found["points"] = found["points"] @ TO_Y_UP
    return found


def _reason(error):
    text = " ".join(str(error).split())
    where = re.search(r"on line \d+", text)   # the rest tells of usd-core's own sources
    return "it is damaged or cut short" + (f" {where[0]}" if where else "")


def _is_seen(UsdGeom, prim, at):
    shown = UsdGeom.Imageable(prim)
    return shown.ComputeVisibility(at) != UsdGeom.Tokens.invisible and \
        shown.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)


def _together(sets):
    """One dictionary of those of several prims; what only some of them have is an Error."""
    names = set().union(*sets)
    for name in names:
        if not all(name in each for each in sets):
            raise Error(f"has {name} on some of its BasisCurves, not on others; allowed: on all, or on none")
    return {name: np.concatenate([each[name] for each in sets]) for name in names}


# --- one prim -------------------------------------------------------------------------------------------------


def _strands(UsdGeom, prim, at, matrix, tolerance):
    """Return what `read` does of one prim, whose points a matrix takes to the world."""
    curves = UsdGeom.BasisCurves(prim)
    points = _numbers(curves.GetPointsAttr().Get(at), 3) @ matrix[:3, :3] + matrix[3, :3]
    counts = _numbers(curves.GetCurveVertexCountsAttr().Get(at), 1).ravel().astype(np.int64)
    if (counts < 0).any() or int(counts.sum()) != len(points):
        raise Error(f"has {len(points)} points, but its curveVertexCounts add up to {int(counts.sum())}")
    linear = curves.GetTypeAttr().Get(at) == UsdGeom.Tokens.linear
    basis, wrap = "linear" if linear else str(curves.GetBasisAttr().Get(at)), str(curves.GetWrapAttr().Get(at))
    if basis not in ("linear", *TO_BEZIER) or wrap not in ("nonperiodic", "periodic", "pinned"):
        raise Error(f"has basis {basis} and wrap {wrap}, which are none of USD's")
    values = _values(UsdGeom, curves, prim, at)
    if "width" in values:   # a matrix that stretches the axes by several factors has one for widths: their mean
        width, how = values["width"]
        values["width"] = width * abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3), how
    control, many = unrolled(points, counts, basis, wrap)
    ends = segments_of(many, basis) + (0 if wrap == "periodic" else 1)
    for name, (value, how) in values.items():
        _check(name, value, how, counts, ends, wrap)
        if not (value >= 0).all():
            raise Error(f"has a {name} of {value[~(value >= 0)][0]:g}; allowed: finite numbers >= 0")
    chords = chords_of(control, many, basis, tolerance * _typical(values.get("width"), points, len(counts)))
    found = {"points": chords.mean(control), "counts": chords.counts}
    for name, (value, how) in values.items():
        if how == "vertex":
            value = chords.mean(unrolled(value, counts, basis, wrap)[0])
        elif how == "varying":
            value = _varying(value, len(value) == int(ends.sum()), ends, counts, segments_of(many, basis), chords)
        else:
            value = value[chords.of] if how == "uniform" else np.repeat(value, len(chords.of), axis=0)
        value = np.maximum(value, 0)   # as splines may dip below
        found[name] = value if name == "color" else value[:, 0]
    if "opacity" in found:
        found["transparency"] = 1 - np.minimum(found.pop("opacity"), 1)
    return found


def _numbers(values, columns):
    """An array of a stage as float64 [rows, columns]; of none, an Error."""
    if values is None or not len(values):
        raise Error("has no points, or no curveVertexCounts")
    return np.asarray(values, np.float64).reshape(-1, columns)


def _values(UsdGeom, curves, prim, at):
    """{"width", "color", "opacity"} of those that a prim has: (float64 [rows, columns], interpolation)."""
    primvars, found = UsdGeom.PrimvarsAPI(prim), {}
    names = [("width", "widths", 1), ("color", "displayColor", 3), ("opacity", "displayOpacity", 1)]
    for name, primvar, columns in names:
        variable = primvars.FindPrimvarWithInheritance(primvar)
        if variable and variable.HasValue():
            value = variable.ComputeFlattened(at)
            if value is not None and len(value):
                found[name] = _numbers(value, columns), str(variable.GetInterpolation())
    widths = curves.GetWidthsAttr().Get(at)
    if "width" not in found and widths is not None and len(widths):   # a primvar comes first (USD)
        found["width"] = _numbers(widths, 1), str(curves.GetWidthsInterpolation())
    return found


def _check(name, value, how, counts, ends, wrap):
    """Raise Error where a value has not as many rows as its interpolation wants."""
    wanted = {"constant": {1}, "uniform": {len(counts)}, "vertex": {int(counts.sum())},
              "varying": {int(ends.sum()), int((ends - 2).sum()) if wrap == "pinned" else int(ends.sum())}}
    if how not in wanted or len(value) not in wanted[how]:
        allowed = " or ".join(map(str, sorted(wanted.get(how, ()))))
        raise Error(f"has {len(value)} values of {name}, {how}; allowed: {allowed or ', '.join(wanted)}")


def _typical(width, points, curves):
    """How wide each curve is, by which chords are chosen: float64 [curves]; the usual width where it has none."""
    usual = usual_width(points)
    if width is None or not (width[0] > 0).any():
        return np.full(curves, usual)
    value, how = width
    if how == "uniform":
        return np.where(value[:, 0] > 0, value[:, 0], usual)
    return np.full(curves, value[value > 0].min())


def _varying(value, at_each_end, ends, counts, segments, chords):
    """Values at the ends of segments, linear between them.

    Of pinned curves usd-core wants two fewer than its text says: these are spread evenly over the curve.
    """
    many = ends if at_each_end else ends - 2
    first, of = np.cumsum(many) - many, chords.of
    where = chords.where if at_each_end else chords.where * ((many - 1) / segments)[of]
    before = np.minimum(where.astype(np.int64), np.maximum(many - 1, 0)[of])
    behind = np.where((ends == segments)[of], 0, before)   # of a periodic curve's last the first comes again
    after = np.where(before + 1 < many[of], before + 1, behind)
    share = (where - before)[:, None]
    return value[first[of] + before] * (1 - share) + value[first[of] + after] * share


# --- out ------------------------------------------------------------------------------------------------------


def write(strands: dict, suffix: str) -> bytes:
    """Return the bytes of a USD stage of one prim of linear BasisCurves; metres, +Y up; widths are diameters."""
    Gf, Sdf, Usd, UsdGeom, Vt = _library()
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    curves = UsdGeom.BasisCurves.Define(stage, "/hair")
    stage.SetDefaultPrim(curves.GetPrim())
    points, origin = near_origin(strands["points"], ZERO, "points")
    if origin.any():   # far from 0, where points of float32 would lose their shape
        curves.AddTranslateOp().Set(Gf.Vec3d(*origin.tolist()))
    curves.CreateTypeAttr(UsdGeom.Tokens.linear)
    curves.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
    curves.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(strands["counts"].astype(np.int32)))
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points))
    curves.CreatePointsAttr(points)
    width, color, clear = (strands[name] for name in ("width", "color", "transparency"))
    curves.CreateWidthsAttr(Vt.FloatArray.FromNumpy(np.ascontiguousarray(width, np.float32)))
    curves.SetWidthsInterpolation("constant" if len(width) == 1 else "vertex")
    curves.CreateDisplayColorPrimvar("constant" if len(color) == 1 else "vertex").Set(
        Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(color, np.float32)))
    curves.CreateDisplayOpacityPrimvar("constant" if len(clear) == 1 else "vertex").Set(
        Vt.FloatArray.FromNumpy(np.ascontiguousarray(1 - clear, np.float32)))
    if "root_uv" in strands:
        UsdGeom.PrimvarsAPI(curves).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "uniform").Set(
            Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(strands["root_uv"], np.float32)))
    curves.CreateExtentAttr(UsdGeom.Curves.ComputeExtent(points, curves.GetWidthsAttr().Get()))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"hair{suffix}"
        stage.Export(str(file))
        return file.read_bytes()
