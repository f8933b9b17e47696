"""Strands in USD files: BasisCurves of every type, basis and wrap."""

import tempfile
from pathlib import Path

import numpy as np

from ..errors import Error
from ..scene import HairType
from ..scene.origin import ZERO, near_origin
from .bases import TO_BEZIER, chords_of, misfit, segments_of, unrolled
from .fields import usual_width
from .usd import Stage, called, library, numbers
from .usd_mesh import material_color

VALUES = ("width", "widths", 1), ("color", "displayColor", 3), ("opacity", "displayOpacity", 1)
INTERPOLATIONS = "constant", "uniform", "varying", "vertex"
COARSE = 0.02   # of a curve's length: of what is as wide as a ribbon chords would be seen
OTHERS = "NurbsCurves", "HermiteCurves"
# Of varying values usd-core 26.11 counts so many more a curve than its text: all pinned ones, and linear periodic ones.
OTHER_COUNTS = {"pinned": -2, "periodic": 1}
ROOT_UV = "st", "surface_uv_coordinate", "uv"   # primvars, the first that there is: USD's own, Blender's, others'


def read(path: Path, tolerance: float, time: float | None) -> dict:
    """Return the strands of all BasisCurves of a USD stage that are seen: points, counts, and as they have them width,
    color and transparency, per point, and root_uv.

    Places are in the stage's units, turned to +Y up. tolerance: how far chords may be from cubic curves, in widths.
    time: of time samples; None: the first.
    """
    return called(_read, path, tolerance, time)


def _read(path, tolerance, time):
    stage = Stage(path, time)
    found = strands_of(stage, tolerance)
    for kind in OTHERS:
        if paths := stage.left.get(f"a {kind}"):
            raise Error(f"has {kind} at {paths[0]}; allowed: BasisCurves")
    notes = []
    if found is None and not stage.left:   # as files of guides alone have them
        stage.purposes = ("guide",)
        found = strands_of(stage, tolerance)
        notes = ["its BasisCurves have the purpose guide: programs that draw a scene leave them out"]
    notes += [f"left out: {what} at {paths[0]}" for what, paths in stage.left.items()]
    if found is None:
        raise Error(notes[-1] if stage.left else "has no BasisCurves that are seen")
    return found | ({"note": "; ".join(notes)} if notes else {})


def strands_of(stage: Stage, tolerance: float) -> dict | None:
    """What `read` returns of a stage; None of one without curves that are seen."""
    sets: list[dict] = []
    for prim, matrices in stage.seen():
        if prim.GetTypeName() in OTHERS:
            stage.leave(f"a {prim.GetTypeName()}", prim)
        if prim.IsA(stage.pxr.UsdGeom.BasisCurves):
            try:
                sets += filter(None, (_strands(stage, prim, matrix, tolerance) for matrix in matrices))
            except Error as error:
                raise Error(f"{prim.GetPath()}: {error}") from None
    return _together(sets) if sets else None


def _together(sets):
    """One dictionary of those of several prims; those without a value that others have get what is usual."""
    kind = HairType()
    usual = {"color": kind.color, "transparency": kind.alpha}
    names = set().union(*sets) - ({"root_uv"} if any("root_uv" not in each for each in sets) else set())
    for each in sets:
        for name in names - each.keys():
            value = usual_width(each["points"]) if name == "width" else usual[name]
            each[name] = np.broadcast_to(value, (len(each["points"]), *np.shape(value)))
    return {name: np.concatenate([each[name] for each in sets]) for name in names}


# --- one prim -------------------------------------------------------------------------------------------------


def _strands(stage, prim, matrix, tolerance):
    """Return what `read` does of one prim, whose points a matrix takes to the world; None where none has a segment."""
    curves = stage.pxr.UsdGeom.BasisCurves(prim)
    points, counts = (each.Get(stage.at) for each in (curves.GetPointsAttr(), curves.GetCurveVertexCountsAttr()))
    if not points or not counts:
        stage.leave("BasisCurves without points or curveVertexCounts", prim)
        return None
    points = numbers(points, 3) @ matrix[:3, :3] + matrix[3, :3]
    counts = numbers(counts, 1).ravel().astype(np.int64)
    if (counts < 0).any() or int(counts.sum()) != len(points):
        raise Error(f"has {len(points)} points, but its curveVertexCounts add up to {int(counts.sum())}")
    basis, wrap = _kind(stage, curves)
    values = {name: found for name, primvar, columns in VALUES if (found := _values(stage, prim, primvar, columns))}
    if "color" not in values and (color := material_color(stage, prim)):
        values["color"] = np.array([color]), "constant"
    if "width" in values:   # a matrix that stretches the axes by several factors has one for widths: their mean
        width, how = values["width"]
        values["width"] = width * abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3), how
    control, many = unrolled(points, counts, basis, wrap)
    ends = segments_of(many, basis) + (0 if wrap == "periodic" else 1)
    for name, (value, how) in values.items():
        how = "constant" if len(value) == 1 and how in INTERPOLATIONS else how   # as some write it
        values[name] = value, how
        _check(name, value, how, counts, ends, OTHER_COUNTS.get(wrap, 0))
        if not (value >= 0).all():
            raise Error(f"has a {name} of {value[~(value >= 0)][0]:g}; allowed: finite numbers >= 0")
    near = tolerance * _typical(values.get("width"), points, len(counts))
    chords = chords_of(control, many, basis, np.minimum(near, COARSE * tolerance * _lengths(points, counts)))
    stage.count(len(chords.of))
    if wrong := misfit(counts, basis, wrap):
        stage.leave(f"what no segment has of curves that do not fit ({wrong})", prim)
        if not len(chords.of):
            return None
    found = {"points": chords.mean(control), "counts": chords.counts}
    for name, (value, how) in values.items():
        if how == "vertex":
            value = chords.mean(unrolled(value, counts, basis, wrap)[0])
        elif how == "varying":
            value = _varying(value, ends, OTHER_COUNTS.get(wrap, 0), segments_of(many, basis), chords)
        else:
            value = value[chords.of] if how == "uniform" else np.repeat(value, len(chords.of), axis=0)
        value = np.maximum(value, 0)   # as splines may dip below
        found[name] = value if name == "color" else value[:, 0]
    if "opacity" in found:
        found["transparency"] = 1 - np.minimum(found.pop("opacity"), 1)
    return found | _root_uv(stage, prim, counts, ends)


def _kind(stage, curves):
    """(basis or "linear", wrap) of curves."""
    linear = curves.GetTypeAttr().Get(stage.at) == "linear"
    basis = "linear" if linear else str(curves.GetBasisAttr().Get(stage.at))
    wrap = str(curves.GetWrapAttr().Get(stage.at))
    if basis not in ("linear", *TO_BEZIER) or wrap not in ("nonperiodic", "periodic", "pinned"):
        raise Error(f"has basis {basis} and wrap {wrap}, which are none of USD's")
    return basis, wrap


def _values(stage, prim, primvar, columns):
    """(float64 [rows, columns], interpolation) of a primvar, or of the attribute widths; None where there is none."""
    found = stage.values(prim, primvar, columns)
    if found is None and primvar == "widths":   # a primvar comes first (USD)
        curves = stage.pxr.UsdGeom.BasisCurves(prim)
        widths = curves.GetWidthsAttr().Get(stage.at)
        found = (numbers(widths, 1), str(curves.GetWidthsInterpolation())) if widths else None
    return found


def _root_uv(stage, prim, counts, ends):
    """{"root_uv"} of a prim that has one for each curve, or for its points: the first's; else {}."""
    found = next(filter(None, (stage.values(prim, name, 2) for name in ROOT_UV)), None)
    if found is None:
        return {}
    value, how = found
    first = {"constant": np.zeros(len(counts), np.int64), "uniform": np.arange(len(counts)),
             "vertex": np.cumsum(counts) - counts, "varying": np.cumsum(ends) - ends}.get(how)
    many = {"constant": 1, "uniform": len(counts), "vertex": int(counts.sum()), "varying": int(ends.sum())}.get(how)
    return {"root_uv": value[first]} if len(value) == many else {}


def _check(name, value, how, counts, ends, more):
    """Raise Error where a value has not as many rows as its interpolation wants."""
    wanted = {"constant": {1}, "uniform": {len(counts)}, "vertex": {int(counts.sum())},
              "varying": {int(ends.sum()), int((ends + more).sum())}}
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


def _lengths(points, counts):
    """How long the polygons of points are, float64 [curves]."""
    of = np.repeat(np.arange(len(counts)), counts)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1) * (of[1:] == of[:-1])
    return np.bincount(of[1:], steps, len(counts))


def _varying(value, ends, more, segments, chords):
    """Values at the ends of segments, linear between them; where a curve has some more or fewer than ends, see
    `OTHER_COUNTS`: fewer are spread evenly over it, one more of a periodic one is at its first point again."""
    at_each_end = len(value) == int(ends.sum()) or more > 0
    many = ends if len(value) == int(ends.sum()) else ends + more
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
    pxr = library()
    Gf, Sdf, Usd, UsdGeom, Vt = pxr.Gf, pxr.Sdf, pxr.Usd, pxr.UsdGeom, pxr.Vt
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
