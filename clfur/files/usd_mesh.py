"""Meshes in USD files, joined, and the colours of their materials."""

from typing import Any

import numpy as np

from ..errors import Error
from .polygons import triangulate
from .subdivision import limit, smoothed
from .usd import Stage, numbers
from .usd_skel import Skeletons

UV = "st", "UVMap", "uv", "map1"   # primvars, the first that there is: USD's own, then what programs wrote
LEVELS, QUADS = 2, 250_000   # of subdivision, and faces that it may make
WRAPS = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp", "useMetadata": "repeat", "black": "clamp"}
WHITE: dict[str, Any] = {"color": (0.18, 0.18, 0.18)}   # of a mesh that says nothing of it (UsdPreviewSurface)


def meshes_of(stage: Stage) -> dict | None:
    """Return all meshes that are seen as one: positions, faces, normals or None, uv by corner or None, material_of,
    and materials: dictionaries of color and, as they have it, texture (bytes of a picture), wrap and raw."""
    found, materials, skeletons = [], Materials(stage), Skeletons(stage)
    for prim, matrices in stage.seen():
        if not prim.IsA(stage.pxr.UsdGeom.Mesh):
            continue
        try:
            own = _mesh(stage, prim, materials, skeletons)
            for matrix in matrices if own else []:
                stage.count(len(own["positions"]))
                found.append(_placed(own, matrix))
        except Error as error:
            raise Error(f"{prim.GetPath()}: {error}") from None
    if not found:
        return None
    first = np.cumsum([0, *(len(each["positions"]) for each in found)])
    joined = {name: np.concatenate([each[name] for each in found]) for name in ("positions", "material_of")}
    joined["faces"] = np.concatenate([each["faces"] + begin for each, begin in zip(found, first)])
    if any(each["uv"] is not None for each in found):
        joined["uv"] = np.concatenate([np.zeros((len(each["faces"]), 3, 2)) if each["uv"] is None else each["uv"]
                                       for each in found])
    if any(each["normals"] is not None for each in found):   # zero: `Mesh` has that of the faces
        joined["normals"] = np.concatenate([np.zeros_like(each["positions"]) if each["normals"] is None else
                                            each["normals"] for each in found])
    return joined | {"materials": materials.found}


def _placed(own, matrix):
    """A mesh as `_mesh` has it, where a matrix takes it; mirrored, its faces go round the other way."""
    turn = matrix[:3, :3]
    mirrored = np.linalg.det(turn) < 0
    normals = own["normals"]
    if normals is not None and np.linalg.det(turn):
        normals = normals @ np.linalg.inv(turn).T
    faces, uv = own["faces"], own["uv"]
    if mirrored:
        faces, uv = faces[:, ::-1], None if uv is None else uv[:, ::-1]
    return own | {"positions": own["positions"] @ turn + matrix[3, :3], "normals": normals, "faces": faces, "uv": uv}


def _mesh(stage, prim, materials, skeletons):
    """One mesh in its own space; None of one without faces."""
    mesh, at = stage.pxr.UsdGeom.Mesh(prim), stage.at
    given = [each.Get(at) for each in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(),
                                       mesh.GetFaceVertexIndicesAttr())]
    if not all(given):
        stage.leave("a Mesh without faces", prim)
        return None
    points, sizes, corners = (numbers(each, columns) for each, columns in zip(given, (3, 1, 1)))
    held, first = skeletons.hold(prim), _first(stage, mesh, points)
    points = np.concatenate([skeletons.deformed(prim, points) if held else points, first], axis=1)   # now, and at first
    sizes, corners = (each.ravel().astype(np.int64) for each in (sizes, corners))
    if (sizes < 0).any() or int(sizes.sum()) != len(corners):
        raise Error(f"has {len(corners)} faceVertexIndices, but its faceVertexCounts add up to {int(sizes.sum())}")
    if corners.min() < 0 or corners.max() >= len(points):
        raise Error(f"has the index {corners[(corners < 0) | (corners >= len(points))][0]}; allowed: 0 to "
                    f"{len(points) - 1}")
    of_faces, faces = materials.of_faces(prim, len(sizes)), np.arange(len(sizes))   # which of the file's each is of
    scheme = str(mesh.GetSubdivisionSchemeAttr().Get(at))
    uv = next(filter(None, (stage.values(prim, name, 2) for name in UV)), None)
    normals = _normals(stage, mesh, prim) if scheme == "none" and not held else None
    uv, normals = (None if each is None else _by_corner(what, each, len(points), corners, sizes)
                   for what, each in (("uv", uv), ("normals", normals)))
    if scheme == "catmullClark":
        levels = _levels(stage, mesh, prim, sizes)
        for _ in range(levels):
            faces = np.repeat(faces, sizes)
            points, corners, uv = smoothed(points, sizes, corners, uv)
            sizes = np.full(len(faces), 4)
        points = limit(points, corners) if levels else points
    elif scheme == "loop":
        stage.leave("subdivision of scheme loop", prim)
    triangles, owner = triangulate(points[:, 3:], corners, sizes)   # alike at all times
    points = points[:, :3]
    keep = ~np.isin(faces[owner], np.asarray(mesh.GetHoleIndicesAttr().Get(at) or (), np.int64))
    triangles, owner = triangles[keep], owner[keep]
    if str(mesh.GetOrientationAttr().Get(at)) == "leftHanded":
        triangles = triangles[:, ::-1]
    positions, indices = points, corners[triangles]
    if normals is not None:   # which may differ at a point: each corner has its own
        positions, indices = points[corners], triangles
    return {"positions": positions, "faces": indices, "normals": normals, "uv": None if uv is None else uv[triangles],
            "material_of": of_faces[faces[owner]]}


def _first(stage, mesh, points):
    """Points of a mesh at their first time, if they are as many then, else these."""
    first = mesh.GetPointsAttr().Get(stage.pxr.Usd.TimeCode.EarliestTime())
    return numbers(first, 3) if len(first or ()) == len(points) else points


def _levels(stage, mesh, prim, sizes):
    """How often a mesh with faces of these sizes is subdivided; what of it is not is told."""
    if (sizes < 3).any():
        stage.leave("subdivision of faces of less than three corners", prim)
        return 0
    if mesh.GetCreaseIndicesAttr().Get(stage.at) or mesh.GetCornerIndicesAttr().Get(stage.at):
        stage.leave("creases of subdivision", prim)
    levels = sum(int(sizes.sum()) * 4**level <= QUADS for level in range(LEVELS))
    if levels < LEVELS:
        stage.leave(f"subdivision beyond {levels} levels", prim)
    return levels


def _normals(stage, mesh, prim):
    """(float64 [rows, 3], interpolation) of a mesh; None without."""
    found = stage.values(prim, "normals", 3)   # a primvar comes first (USD)
    normals = mesh.GetNormalsAttr().Get(stage.at)
    return found or ((numbers(normals, 3), str(mesh.GetNormalsInterpolation())) if normals else None)


def _by_corner(what, found, points, corners, sizes):
    """Values [corners, k] of those of a mesh and their interpolation."""
    value, how = found
    rows = {"constant": (1, np.zeros(len(corners), np.int64)), "vertex": (points, corners),
            "varying": (points, corners), "uniform": (len(sizes), np.repeat(np.arange(len(sizes)), sizes)),
            "faceVarying": (len(corners), np.arange(len(corners)))}
    if how not in rows or len(value) != rows[how][0]:
        allowed = rows[how][0] if how in rows else ", ".join(rows)
        raise Error(f"has {len(value)} values of {what}, {how}; allowed: {allowed}")
    return value[rows[how][1]]


class Materials:
    """The colours of a stage's meshes, each once."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.found: list[dict] = []
        self.known: dict[str, int] = {}

    def of_faces(self, prim: Any, faces: int) -> np.ndarray:
        """Which of ``found`` each face of a mesh has, int64 [faces]."""
        UsdGeom, UsdShade = self.stage.pxr.UsdGeom, self.stage.pxr.UsdShade
        of = np.full(faces, self._of(prim, prim))
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            rows = np.asarray(subset.GetIndicesAttr().Get(self.stage.at) or (), np.int64)
            if str(subset.GetElementTypeAttr().Get()) != UsdGeom.Tokens.face or (rows < 0).any() or \
                    (rows >= faces).any():
                raise Error(f"has the subset {subset.GetPrim().GetName()} of what are no faces of it")
            of[rows] = self._of(subset.GetPrim(), prim)
        return of

    def _of(self, prim, mesh):
        """The number of the material of a prim, or of the mesh's own colour."""
        material, _ = self.stage.pxr.UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        said = None
        if material:
            path = str(material.GetPath())
            if path in self.known:
                return self.known[path]
            said = color_of(self.stage, material)
            if said is None:
                self.stage.leave("a material without a UsdPreviewSurface", material.GetPrim())
        if said is None:
            said, path = self._display_color(mesh), str(mesh.GetPath())
        if path not in self.known:
            self.known[path] = len(self.found)
            self.found.append(said)
        return self.known[path]

    def _display_color(self, mesh):
        found = self.stage.values(mesh, "displayColor", 3)
        if found is None:
            return WHITE
        if len(found[0]) > 1:
            self.stage.leave("displayColor of faces or points (its mean is taken)", mesh)
        return {"color": tuple(found[0].mean(axis=0).tolist())}


def material_color(stage: Stage, prim: Any) -> tuple | None:
    """The base colour of the material of a prim, where it says one and no picture; else None."""
    material, _ = stage.pxr.UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    said = color_of(stage, material, pictures=False) if material else None
    return None if said is None or said is WHITE or "texture" in said else said["color"]


def color_of(stage: Stage, material: Any, pictures: bool = True) -> dict | None:
    """The base colour of a material: color and, as it has it, texture, wrap and raw; None without UsdPreviewSurface.

    Without pictures no file is opened, and a texture is empty.
    """
    UsdShade = stage.pxr.UsdShade
    surface, _, _ = material.ComputeSurfaceSource()
    if not surface or surface.GetIdAttr().Get(stage.at) != "UsdPreviewSurface":
        return None
    base = surface.GetInput("diffuseColor")
    attributes = UsdShade.Utils.GetValueProducingAttributes(base) if base else ()
    if not attributes:
        return WHITE
    shader = UsdShade.Shader(attributes[0].GetPrim())
    if not UsdShade.Output.IsOutput(attributes[0]):
        value = attributes[0].Get(stage.at)
        return WHITE if value is None else {"color": tuple(float(each) for each in value)}
    if shader.GetIdAttr().Get(stage.at) != "UsdUVTexture":
        stage.leave("a diffuseColor that is no UsdUVTexture", shader.GetPrim())
        return WHITE
    return _textured(stage, shader, pictures)


def _textured(stage, shader, pictures):
    """The colour of a UsdUVTexture."""
    def value(name, usual=None):
        there = shader.GetInput(name)
        producers = stage.pxr.UsdShade.Utils.GetValueProducingAttributes(there) if there else ()
        found = producers[0].Get(stage.at) if producers else None
        return usual if found is None else found

    file = value("file")
    content = content_of(stage, file) if pictures else b"" if getattr(file, "resolvedPath", "") else None
    if content is None:
        stage.leave("a texture that is not to be had", shader.GetPrim())
        fallback = value("fallback")
        return WHITE if fallback is None else {"color": tuple(float(each) for each in fallback)[:3]}
    scale = tuple(float(each) for each in value("scale", (1, 1, 1, 1)))[:3]
    wrap = tuple(WRAPS.get(str(value(name, "repeat")), "repeat") for name in ("wrapS", "wrapT"))
    return {"color": scale, "texture": content, "wrap": wrap, "raw": str(value("sourceColorSpace")) == "raw"}


def content_of(stage: Stage, asset: Any) -> bytes | None:
    """The bytes of a file that a stage names, which may lie in its .usdz; None where it is not to be had."""
    path = getattr(asset, "resolvedPath", "")
    opened = stage.pxr.Ar.GetResolver().OpenAsset(stage.pxr.Ar.ResolvedPath(path)) if path else None
    return bytes(opened.GetBuffer()) if opened else None
