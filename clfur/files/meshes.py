"""Files and built-in models -> Mesh."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Error, shown
from ..scene import Mesh
from ..scene.mesh import Numbering
from ..scene.origin import copied
from .input import read
from .obj import obj
from .off import off
from .output import is_path
from .ply import ply
from .stl import stl
from .teapot import teapot

FORMATS = ".obj, .ply, .stl, .off, .glb or .gltf"


def load_mesh(path: str | os.PathLike) -> Mesh:
    """Return the Mesh of a file, or of a built-in name: "sphere" or "teapot".

    path: str or path-like; obj, ply, stl, off, glb or gltf, by suffix. Normals and uv are kept (missing
    normals are computed by Mesh), polygons become triangles (fans, or ears cut where a fan would be wrong),
    several meshes in a scene become one with their transforms applied. Vertices that no face uses are left out,
    faces of less than three corners are counted in `Mesh.degenerate_faces`. Of materials which a face of a glTF file
    has is read (`Mesh.material_of`); see `load_materials`. `Mesh.numbering` has names of groups, objects and materials
    of OBJ, of nodes, meshes and materials of glTF, and vertex colours of PLY; it counts as the file does.
    Raises Error, one line that names the file, for anything that is missing, damaged, cut short, without faces, no
    regular file or of more than 2**30 bytes.
    """
    if not is_path(path):
        raise Error(f"load_mesh path is {shown(path)}; allowed: a file's name, or one of {_names()}")
    if str(path) in BUILT_IN:
        return BUILT_IN[str(path)]()
    path = Path(path)
    data = _read(path)
    try:
        return mesh_of(READERS[path.suffix.lower()](data, path))
    except Error as error:
        raise Error(f"{path}: {error}") from None
    except Exception as error:  # a reader may fail in any way on a damaged file; the user gets one line
        first_line = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise Error(f"{path}: cannot be read as {path.suffix.lower()}: {first_line}") from error


def _names():
    return ", ".join(BUILT_IN)


def _read(path):
    """Return the bytes of a file, which may be at most MAX_BYTES."""
    if os.path.isdir(path):  # pathlib's would raise for names that the system refuses
        raise Error(f"{path}: is a folder; allowed: a file {FORMATS}")
    if not os.path.exists(path):
        built_in = "" if path.suffix else f"; built-in names: {_names()}"
        raise Error(f"{path}: no such file{built_in}")
    if path.suffix.lower() not in READERS:
        raise Error(f"{path}: {path.suffix or 'no suffix'} is not supported; allowed: {FORMATS}")
    data = read(path)
    if not data:
        raise Error(f"{path}: is empty")
    return data


def mesh_of(fields: dict[str, Any]) -> Mesh:
    """Return the Mesh of what a reader gives, numbered as the file is."""
    numbering = _numbering(fields)
    return copied(Mesh(**finite(fields)), numbering=numbering)


def _numbering(fields):
    """Return the `Numbering` of a reader's fields, and take what is said of it out of them."""
    faces, known = fields["faces"], fields.pop("numbering", {})
    known = {"corners": faces, "vertices": len(fields["positions"]), "face_of": None, "faces": len(faces)} | known
    return Numbering(**known | {"corners": known["corners"].astype(np.uint32)})


def finite(fields: dict[str, Any]) -> dict[str, Any]:
    """Return a Mesh's fields without vertices that are not finite and that no face uses."""
    finite = np.isfinite(fields["positions"]).all(axis=1)
    if finite.all():
        return fields
    keep = finite
    keep[fields["faces"]] = True   # is an Error of Mesh's where it is not finite
    fields = {**fields, "faces": (np.cumsum(keep) - 1)[fields["faces"]]}
    for name in ("positions", "normals", "uv"):
        array = fields.get(name)
        if array is not None and array.shape[1:] in ((3,), (2,)):   # uv may be by corner
            fields[name] = array[keep]
    return fields


def _of_gltf(data, path):
    from . import gltf  # takes long to import, with pictures, animations and all

    return (gltf.glb if path.suffix.lower() == ".glb" else gltf.gltf)(data, path)


READERS = {".obj": obj, ".ply": ply, ".stl": stl, ".off": off, ".glb": _of_gltf, ".gltf": _of_gltf}


# --- built-in models ------------------------------------------------------------------------------------


def _sphere(subdivisions=3):
    """Return the unit sphere as an icosahedron whose faces are split in four `subdivisions` times.

    uv is longitude and latitude, u continuous within each face (so it passes 1 at the seam).
    """
    golden = (1 + 5**0.5) / 2
    points = [(0, y, z) for y in (-1, 1) for z in (-golden, golden)]
    points = np.array([np.roll(point, shift) for shift in range(3) for point in points])
    distance = ((points[:, None] - points) ** 2).sum(axis=2)
    faces = np.array([(i, j, k) for i in range(12) for j in range(i) for k in range(j)
                      if max(distance[i, j], distance[j, k], distance[k, i]) < 4.1])
    corners = points[faces] / np.linalg.norm(points[0])
    outward = (np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]).sum(axis=1) > 0
    faces[~outward] = faces[~outward][:, ::-1]
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        edges, middle = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = faces.T
        ab, bc, ca = (middle.reshape(-1, 3) + len(points)).T
        middles = points[edges].sum(axis=1)
        points = np.concatenate([points, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    corners = points[faces]
    u = np.arctan2(corners[..., 0], corners[..., 2]) / (2 * np.pi) + 0.5
    poles = np.abs(corners[..., 1]) > 1 - 1e-9
    u = np.where(poles, np.nan, u)
    u += (np.nanmax(u, axis=1, keepdims=True) - u) > 0.5  # the face crosses the seam
    u = np.where(poles, np.nanmean(u, axis=1, keepdims=True), u)
    v = np.arcsin(np.clip(corners[..., 1], -1, 1)) / np.pi + 0.5
    return Mesh(points, points, np.stack([u, v], axis=2), faces)


def _teapot():
    return Mesh(*teapot())


BUILT_IN = {"sphere": _sphere, "teapot": _teapot}
