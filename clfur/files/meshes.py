"""Files and built-in models -> Mesh; the only importer of trimesh."""

import io
import os
import re
import struct
from pathlib import Path

import numpy as np

from ..errors import Error, shown
from ..scene import Mesh
from .gltf import glb, gltf
from .output import is_path
from .teapot import teapot

FORMATS = ".obj, .ply, .stl, .off, .glb or .gltf"
MAX_BYTES = 2**30  # of a file, and of what a file's header may ask for
MAX_FACES = 2**26  # of all the instances in a file together


def load_mesh(path: str | os.PathLike) -> Mesh:
    """Return the Mesh of a file, or of a built-in name: "sphere" or "teapot".

    path: str or path-like; obj, ply, stl, off, glb or gltf, by suffix. Normals and uv are kept (missing
    normals are computed by Mesh), polygons become fans of triangles, several meshes in a scene become one
    with their transforms applied. Materials and textures are not read. Raises Error, one line that names the
    file, for anything that is missing, damaged, cut short or without faces.
    """
    if not is_path(path):
        raise Error(f"load_mesh path is {shown(path)}; allowed: a file's name, or one of {_names()}")
    if str(path) in BUILT_IN:
        return BUILT_IN[str(path)]()
    path = Path(path)
    data = _read(path)
    try:
        return Mesh(**READERS[path.suffix.lower()](data, path))
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
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise Error(f"{path}: has {size} bytes; allowed: at most {MAX_BYTES}")
        data = path.read_bytes()
    except OSError as error:
        raise Error(f"{path}: {error.strerror}") from None
    if not data:
        raise Error(f"{path}: is empty")
    return data


# --- OBJ ------------------------------------------------------------------------------------------------
# Read here and not by trimesh, which takes relative indices from the file's end (so a file of several
# objects comes out wrong), reads index 0 as the last one, and passes over lines that were cut short.


def _obj(data, path):
    """Return the fields of the Mesh in an OBJ file: its v, vt, vn and f lines; all others are skipped."""
    tables, widths = {"v": [], "vt": [], "vn": []}, {"v": 3, "vt": 2, "vn": 3}  # flat lists of floats
    known = {}  # a corner as written -> its number in `distinct`
    distinct, corners, sizes = [], [], []  # (v, vt, vn) of distinct corners; numbers; corners of each face
    text = data.decode("latin-1").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.split("\n"), 1):
        words = (line.partition("#")[0] if "#" in line else line).split()
        kind = words[0] if words else ""
        if kind in tables:
            tables[kind] += _obj_numbers(words, widths[kind], number)
        elif kind == "f":
            if len(words) < 4:
                raise Error(f"line {number}: {line.strip()[:60]!r} has less than three corners")
            for word in words[1:]:
                at = known.get(word)
                if at is None:
                    at = len(distinct)
                    distinct.append(_obj_corner(word, tables, number))
                    if "-" not in word:  # relative ones mean another point on another line
                        known[word] = at
                corners.append(at)
            sizes.append(len(words) - 1)
    if not sizes:
        raise Error("has no faces")
    distinct = np.array(distinct)
    positions, uvs, normals = (np.array(table).reshape(-1, widths[kind]) for kind, table in tables.items())
    for kind, table, last in zip(tables, (positions, uvs, normals), distinct.max(axis=0), strict=True):
        if last >= len(table):
            raise Error(f"a face has the {kind} index {last + 1}; allowed: 1 to {len(table)}")

    v, vt, vn = distinct[np.array(corners)[_fans(np.array(sizes))]].transpose(2, 0, 1)  # [F, 3] each
    uv = np.where(vt[..., None] >= 0, uvs[vt], 0) if len(uvs) else None
    if not len(normals):
        return {"positions": positions, "uv": uv, "faces": v}
    # One vertex for each pair (v, vn); Mesh welds the positions again.
    pairs, faces = np.unique(v * (len(normals) + 1) + vn + 1, return_inverse=True)
    v, vn = np.divmod(pairs, len(normals) + 1)
    normals = np.where(vn[:, None] > 0, normals[vn - 1], 0)
    return {"positions": positions[v], "normals": normals, "uv": uv, "faces": faces.reshape(-1, 3)}


def _obj_numbers(words, width, number):
    """Return the first `width` numbers after a line's first word; vt may have one alone."""
    try:
        values = [float(word) for word in words[1 : width + 1]]
    except ValueError:
        values = []
    if len(values) == 1 and width == 2:
        values.append(0.0)
    if len(values) < width:
        raise Error(f"line {number}: {' '.join(words)[:60]!r} is no {words[0]} of {width} numbers")
    return values


def _obj_corner(word, tables, number):
    """Return the 0-based (v, vt, vn) of a corner such as 3, 3/1, 3//2 or -1/-1/-1; -1 where there is none."""
    parts = word.split("/")
    try:
        indices = [int(part) if part else None for part in parts]
    except ValueError:
        indices = [None]
    if not parts[-1] or indices[0] is None or len(parts) > 3 or 0 in indices:
        raise Error(f"line {number}: {word[:40]!r} is no corner of a face")
    counts = (len(tables["v"]) // 3, len(tables["vt"]) // 2, len(tables["vn"]) // 3)
    found = [-1, -1, -1]
    for k, index in enumerate(indices):
        if index is not None:
            found[k] = index - 1 if index > 0 else counts[k] + index
            if found[k] < 0:
                raise Error(f"line {number}: {word[:40]!r} counts back to before the first of its kind")
    return found


def _fans(sizes):
    """Return the corners [F, 3] of the triangles of polygons whose corners are numbered on and on."""
    starts = np.cumsum(sizes) - sizes
    polygon = np.repeat(np.arange(len(sizes)), sizes - 2)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(sizes - 2) - (sizes - 2), sizes - 2)
    first = starts[polygon]
    return np.stack([first, first + step + 1, first + step + 2], axis=1)


# --- the other formats, by trimesh ----------------------------------------------------------------------


def _by_trimesh(data, kind, least_faces=0):
    """Return the fields of the Mesh that trimesh finds in data; Error if it has fewer faces than stated."""
    import trimesh  # here, since it takes long and built-in models and OBJ files do without

    with np.errstate(all="ignore"):   # damaged files: what they hold is checked here and by Mesh
        loaded = trimesh.load(io.BytesIO(data), file_type=kind, process=False)
    if isinstance(loaded, trimesh.Scene):
        placed = [loaded.graph[node] for node in loaded.graph.nodes_geometry]
        placed = [(matrix, loaded.geometry[name]) for matrix, name in placed]
    else:
        placed = [(np.eye(4), loaded)]
    placed = [(matrix, part) for matrix, part in placed if len(getattr(part, "faces", ()))]
    total = sum(len(part.faces) for _, part in placed)
    if total > MAX_FACES:
        raise Error(f"has {total} faces; allowed: at most {MAX_FACES}")
    if total < least_faces:
        raise Error(f"is damaged or cut short: it states {least_faces} faces but holds {total}")
    if not total:
        raise Error("has no faces")
    positions, normals, uvs, faces, count = [], [], [], [], 0
    for matrix, part in placed:
        index = np.asarray(part.faces)
        if index.min() < 0 or index.max() >= len(part.vertices):
            worst = index.min() if index.min() < 0 else index.max()
            raise Error(f"a face has the index {worst}; allowed: 0 to {len(part.vertices) - 1}")
        linear = matrix[:3, :3]
        with np.errstate(all="ignore"):  # what is not finite is found by Mesh
            positions.append(np.asarray(part.vertices, np.float64) @ linear.T + matrix[:3, 3])
        normals.append(_normals(part, linear))
        uvs.append(_uv(part, index))
        faces.append((index if np.linalg.det(linear) >= 0 else index[:, ::-1]) + count)
        if np.linalg.det(linear) < 0 and uvs[-1] is not None:
            uvs[-1] = uvs[-1][:, ::-1]
        count += len(part.vertices)
    return {
        "positions": np.concatenate(positions),
        "normals": _join(normals, [(len(part.vertices), 3) for _, part in placed]),
        "uv": _join(uvs, [(len(part.faces), 3, 2) for _, part in placed]),
        "faces": np.concatenate(faces),
    }


def _normals(part, linear):
    """Return the file's own normals [V, 3], transformed, or None; never ones that trimesh would compute."""
    if "vertex_normals" not in part._cache:
        return None
    inverse = np.linalg.inv(linear) if np.linalg.det(linear) else np.zeros((3, 3))
    return np.asarray(part.vertex_normals, np.float64) @ inverse


def _uv(part, faces):
    """Return uv by corner [F, 3, 2], or None where there is none."""
    uv = getattr(part.visual, "uv", None)
    if uv is None or np.shape(uv)[:1] != (len(part.vertices),):
        return None
    return np.asarray(uv, np.float64)[:, :2][faces]


def _join(arrays, shapes):
    """Return the arrays as one, zeros of the shape for each None; None where all are."""
    if all(array is None for array in arrays):
        return None
    return np.concatenate([
        np.zeros(shape) if array is None else array for array, shape in zip(arrays, shapes, strict=True)
    ])


def _ply(data, path):
    header = re.match(rb"ply\s.*?end_header", data[: 2**16], re.DOTALL)
    if not header:
        raise Error("is damaged or cut short: it has no PLY header")
    counts = {name: int(count) for name, count in re.findall(rb"element\s+(\w+)\s+(\d+)", header.group())}
    if max(counts.values(), default=0) > len(data):
        raise Error(f"is damaged or cut short: it states {max(counts.values())} elements "
                    f"but has {len(data)} bytes")
    return _by_trimesh(data, "ply", counts.get(b"face", 0))


def _stl(data, path):
    stated = struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 0
    if len(data) >= 84 and len(data) == 84 + 50 * stated:
        return _by_trimesh(data, "stl", stated)
    text = data.lower()
    if not (text.lstrip().startswith(b"solid") and b"facet" in text):
        raise Error(f"is damaged or cut short: it states {stated} faces, {84 + 50 * stated} bytes, "
                    f"but has {len(data)} bytes")
    facets = len(re.findall(rb"\bfacet\s", text))
    if facets != text.count(b"endfacet") or b"endsolid" not in text:
        raise Error("is damaged or cut short: it ends within a facet or solid")
    return _by_trimesh(data.decode("latin-1").encode(), "stl", facets)


def _off(data, path):
    text = re.sub(r"#.*", "", data.decode("latin-1"))
    words = text[: 2**12].split()
    if not words or not words[0].upper().endswith("OFF") or not all(w.isdigit() for w in words[1:3]):
        raise Error("is damaged or cut short: it has no OFF header")
    return _by_trimesh(text.encode(), "off", int(words[2]))


READERS = {".obj": _obj, ".ply": _ply, ".stl": _stl, ".off": _off, ".glb": glb, ".gltf": gltf}


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
