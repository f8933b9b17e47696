"""USD files: a stage of usd-core's, a library that is asked for only here (`pip install "clfur[usd]"`), and its prims
that are seen."""

import importlib
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Error, shown
from .apart import apart
from .input import note, read, size_of

SUFFIXES = ".usd", ".usda", ".usdc", ".usdz"
TO_Y_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float64)   # rows: where x, y and z of a Z-up stage point
MOST = 2**27      # points of all instances together
MEMORY = 64       # bytes that a byte of a file may become


def is_usd(name: Any) -> bool:
    """Whether a file's name, or None, is that of a USD file."""
    return name is not None and Path(name).suffix.lower() in SUFFIXES


def library() -> Any:
    """Return usd-core's package; raises Error where it is not installed."""
    try:
        import pxr
        from pxr import Ar, Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender, UsdShade, UsdSkel, Vt  # noqa: F401
    except ImportError:
        raise Error('needs usd-core to be read or written; allowed: pip install "clfur[usd]"') from None
    return pxr


def called(function: Any, path: Path, *arguments: Any) -> Any:
    """Return what a function gives of a USD file and more arguments.

    In a process of its own, but of text that names no other file: of that usd-core tells all that is wrong. Files of
    layers that it opens are noted as read.
    """
    library()   # what is not installed need not be asked for there
    size = size_of(path)
    with open(path, "rb") as file:
        text = file.read(5) == b"#usda"
    if text and b"@" not in read(path):
        return function(path, *arguments)
    value, files = apart(_with_files, function.__module__, function.__qualname__, path, *arguments, size=MEMORY * size)
    for each in files:
        note(each)
    return value


def _with_files(module, name, *arguments):
    """What a function of a module gives, and names of the files of all layers that its stages opened."""
    pxr = library()
    cache = pxr.Usd.StageCache()   # it holds stages, so that they still know of their layers, those of clips too
    with pxr.Usd.StageCacheContext(cache):
        value = getattr(importlib.import_module(module), name)(*arguments)
    layers = {layer.realPath for stage in cache.GetAllStages() for layer in stage.GetUsedLayers()}
    return value, sorted({pxr.Ar.SplitPackageRelativePathOuter(each)[0] for each in layers} - {""})


def alone(path: Path) -> Path:
    """Return a file that has what a USD file is made of, of which nothing leads out of it: that one, or another beside
    it where assets are named, as a material's pictures are, which that leaves out. Raises Error where layers or clips
    are not within it, as .usdz files have them. Nothing of all that is looked for."""
    return called(_alone, path)


def _alone(path):
    pxr = library()
    waiting, layers, named = [str(path)], [], False   # held, so that the stage is made of them as they are then
    while waiting:
        try:
            layer = pxr.Sdf.Layer.FindOrOpen(waiting.pop())
        except Exception:   # usd-core's own; who reads the file will tell
            continue
        if layer is None or layer in layers:
            continue
        layers.append(layer)
        for name in filter(None, layer.GetCompositionAssetDependencies()):   # "": the layer itself
            out = _leads_out(path, layer.identifier, name)
            waiting.append("" if out else pxr.Sdf.ComputeAssetPathRelativeToLayer(layer, name))
            if not waiting[-1].startswith(f"{path}["):
                raise Error(f"is made of other files, as {shown(name)}; allowed: one file that has all in it")
        prims = [at for at in _paths(layer) if not at.IsPropertyPath()]
        if clips := [at for at in prims if layer.GetObjectAtPath(at).HasInfo("clips")]:
            raise Error(f"has clips, which are other files, at {clips[0]}; allowed: one file that has all in it")
        named |= _clear_assets(pxr.Sdf, layer)
    if not named:
        return path
    made = path.with_name("alone.usdc")
    one = layers[0] if len(layers) == 1 else pxr.Usd.Stage.Open(layers[0]).Flatten()
    one.Export(str(made))
    return made


def _leads_out(path, layer, name):
    """Whether the name of a file in a layer of a file may be of one that is not within that."""
    within = layer[len(str(path)) + 1:-1] if layer != str(path) else ""
    there = posixpath.normpath(posixpath.join(posixpath.dirname(within), name.replace("\\", "/")))
    is_any = name.startswith("`") or ":" in name   # an expression, or an address
    return is_any or path.suffix.lower() != ".usdz" or there.startswith(("/", ".."))


def _paths(layer):
    """All paths of a layer that have a spec which may say something."""
    found: list[Any] = []
    layer.Traverse(layer.pseudoRoot.path, lambda at: found.append(at) if (
        at.IsPrimPath() or at.IsPrimVariantSelectionPath() or at.IsPropertyPath()) else None)
    return found


def _clear_assets(Sdf, layer):
    """Take all assets out of the attributes of a layer, in memory alone -> whether there are some."""
    named = [each for each in map(layer.GetAttributeAtPath, filter(Sdf.Path.IsPropertyPath, _paths(layer)))
             if each and str(each.typeName) in ("asset", "asset[]")]
    layer.SetPermissionToEdit(True)
    for attribute in named:
        attribute.ClearInfo("default")
        attribute.ClearInfo("timeSamples")
    return bool(named)


class Stage:
    """A USD stage at a time, and which of its prims are seen."""

    def __init__(self, path: Path, time: float | None) -> None:
        """Open a file; raises Error. time: in the stage's time codes; None: the first sample of each attribute."""
        self.pxr = library()
        Usd, UsdGeom = self.pxr.Usd, self.pxr.UsdGeom
        try:
            self.stage = Usd.Stage.Open(str(path))
        except Exception as error:   # usd-core's own
            raise Error(f"cannot be read as USD: {_reason(error)}") from None
        self.at = Usd.TimeCode(time) if time is not None else Usd.TimeCode.EarliestTime()
        self.up = TO_Y_UP if UsdGeom.GetStageUpAxis(self.stage) == UsdGeom.Tokens.z else np.eye(3)
        self.matrices = UsdGeom.XformCache(self.at)
        self.left: dict[str, list[str]] = {}   # what of it is not understood, and where
        self.purposes: tuple[str, ...] = ("default", "render")   # of prims that are seen
        self.points = 0

    def times(self) -> tuple[float, float, float]:
        """(first, last, time codes a second) of what moves: as the stage says, else by its samples; first and last are
        the same of one that does not."""
        stage = self.stage
        first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
        if not stage.HasAuthoredTimeCodeRange():
            samples = [each for prim in stage.Traverse() for attribute in prim.GetAuthoredAttributes()
                       for each in attribute.GetTimeSamples()]
            first, last = (min(samples), max(samples)) if samples else (0.0, 0.0)
        return float(first), float(last), float(stage.GetTimeCodesPerSecond())

    def leave(self, what: str, prim: Any) -> None:
        """Remember that a prim, or something of it, is left out."""
        self.left.setdefault(what, []).append(str(prim.GetPath()))

    def world(self, matrix: np.ndarray) -> np.ndarray:
        """A matrix [4, 4] to the stage's world (rows times matrix, as USD has it) as one to a world with +Y up."""
        return np.asarray(matrix, np.float64) @ np.block([[self.up, np.zeros((3, 1))], [np.zeros((1, 3)), 1]])

    def seen(self) -> Iterator[tuple[Any, list[np.ndarray]]]:
        """Each prim that is seen, and where: a matrix float64 [4, 4] to the world for each of its instances.

        Left out: what is inactive, not loaded, invisible, or under a prim that is; prims with other purposes than
        `purposes`; and prototypes of a PointInstancer where they stand themselves.
        """
        for prim, matrix in self._under(self.stage.GetPseudoRoot()):
            if prim.IsA(self.pxr.UsdGeom.PointInstancer):
                yield from self._instances(prim, matrix)
            else:
                yield prim, [self.world(matrix)]

    def _under(self, root):
        """(prim, its matrix to the stage's world) of prims that are seen from a root on, not below a PointInstancer."""
        Usd, UsdGeom = self.pxr.Usd, self.pxr.UsdGeom
        tree = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
        for prim in tree:
            shown = UsdGeom.Imageable(prim)
            if shown and shown.GetVisibilityAttr().Get(self.at) == UsdGeom.Tokens.invisible:
                tree.PruneChildren()
                continue
            if prim.IsA(UsdGeom.PointInstancer):
                tree.PruneChildren()
            if not shown or shown.ComputePurpose() in self.purposes:
                yield prim, np.array(self.matrices.GetLocalToWorldTransform(prim))

    def _instances(self, prim, matrix):
        instancer = self.pxr.UsdGeom.PointInstancer(prim)
        numbers = np.asarray(instancer.GetProtoIndicesAttr().Get(self.at) or (), np.int64)
        mask = instancer.ComputeMaskAtTime(self.at)
        each = np.array(instancer.ComputeInstanceTransformsAtTime(self.at, self.at), np.float64).reshape(-1, 4, 4)
        numbers = numbers[np.asarray(mask, bool)] if mask and len(mask) == len(numbers) else numbers
        if len(each) != len(numbers):
            raise Error(f"{prim.GetPath()}: has {len(numbers)} instances, but {len(each)} places")
        for number, path in enumerate(instancer.GetPrototypesRel().GetForwardedTargets()):
            root, of_it = self.stage.GetPrimAtPath(path), each[numbers == number]
            if not root or not len(of_it):
                continue
            for under, _ in self._under(root):
                if under.IsA(self.pxr.UsdGeom.PointInstancer):
                    self.leave("a PointInstancer within another", under)
                    continue
                own, _ = self.matrices.ComputeRelativeTransform(under, root)
                yield under, [self.world(np.array(own) @ one @ matrix) for one in of_it]

    def count(self, points: int) -> None:
        """Add to the points of all instances; raises Error where they become too many."""
        self.points += points
        if self.points > MOST:
            raise Error(f"has more than {MOST} points, with all instances; allowed: at most so many")

    def values(self, prim: Any, name: str, columns: int) -> tuple[np.ndarray, str] | None:
        """A primvar of a prim or one above it, if any: (float64 [rows, columns], interpolation)."""
        variable = self.pxr.UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        value = variable.ComputeFlattened(self.at) if variable and variable.HasValue() else None
        if value is None or not np.size(value):
            return None
        return numbers(value, columns), str(variable.GetInterpolation())


def _reason(error):
    text = " ".join(str(error).split())
    where = re.search(r"on line \d+", text)   # the rest tells of usd-core's own sources
    return "it is damaged or cut short" + (f" {where[0]}" if where else "")


def numbers(values: Any, columns: int) -> np.ndarray:
    """An array of a stage as float64 [rows, columns]; raises Error for another."""
    array = np.asarray(values, np.float64)
    if array.size % columns:
        raise Error(f"has values of shape {list(array.shape)}; allowed: {columns} numbers each")
    return array.reshape(-1, columns)
