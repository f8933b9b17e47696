"""glTF and GLB files -> the fields of a Mesh (glTF 2.0); what would move a point is done, or refused by its name.

Read here and not by trimesh, which takes normalized integers and sparse accessors as they are stored, and passes over
fans, skins, morph targets, instances and extensions that a file needs.
"""

import contextlib
import json
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import Error
from ..scene import Material, checks
from .gltf_animation import Motions, names_of
from .gltf_data import Source, child, vector, whole
from .gltf_materials import materials_of
from .gltf_nodes import Nodes
from .gltf_parts import Part, Use, instances
from .input import read

MAX_PLACED = 2**26   # faces, and vertices, of all nodes and instances together
MAX_USES = 2**18     # of primitives by nodes
MAX_VALUES = 2**23   # of the JSON: each takes some 100 bytes once it is read
MODES = ("POINTS", "LINES", "LINE_LOOP", "LINE_STRIP", "TRIANGLES", "TRIANGLE_STRIP", "TRIANGLE_FAN")
# Extensions that a file may need: those that are done, and those that move no point and no uv.
DONE = {"EXT_mesh_gpu_instancing", "KHR_mesh_quantization", "KHR_node_visibility", "KHR_texture_transform"}
HARMLESS = {
    "ADOBE_materials_clearcoat_specular", "ADOBE_materials_clearcoat_tint", "ADOBE_materials_thin_transparency",
    "AGI_articulations", "AGI_stk_metadata", "CESIUM_primitive_outline", "EXT_instance_features", "EXT_lights_ies",
    "EXT_lights_image_based", "EXT_mesh_features", "EXT_mesh_manifold", "EXT_mesh_primitive_edge_visibility",
    "EXT_structural_metadata", "EXT_texture_astc", "EXT_texture_avif", "EXT_texture_webp", "FB_geometry_metadata",
    "GODOT_single_root", "KHR_animation_pointer", "KHR_interactivity", "KHR_lights_punctual",
    "KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness", "KHR_materials_sheen", "KHR_materials_specular",
    "KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_variants", "KHR_materials_volume",
    "KHR_node_hoverability", "KHR_node_selectability", "KHR_techniques_webgl", "KHR_texture_basisu", "KHR_xmp",
    "KHR_xmp_json_ld", "MSFT_packing_normalRoughnessMetallic", "MSFT_packing_occlusionRoughnessMetallic",
    "MSFT_texture_dds", "NV_materials_mdl",
}


def glb(data: bytes, path: Path) -> dict:
    """Return the fields of the Mesh in a GLB file."""
    return gltf(*_chunks(data, path))


def load_materials(path: str | os.PathLike) -> tuple[Material, ...]:
    """Return the materials of a glTF or GLB file, in the order that `Mesh.material_of` of its mesh counts them in.

    path: str or path-like. Of each material the base colour is read: its factor, and its picture with how that repeats
    (PNG, JPEG, WebP, AVIF; in the file or beside it); those that no face has are left white. () where no face has any,
    and for files of other formats, whose materials are not read. Raises Error, one line that names the file, as
    `load_mesh` does, and for pictures that cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() not in (".glb", ".gltf"):
        return ()
    with naming(path):
        tree, _, binary = chunks_of(path)
        source = Source(_tree(tree), path, binary)
        used = {use.material for use in _uses(source, Nodes(source)) if use.material is not None}
        return materials_of(source, used) if used else ()


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """What is raised of a glTF file within becomes an Error of one line that names it."""
    try:
        yield
    except Error as error:
        raise Error(str(error) if str(error).startswith(f"{path}: ") else f"{path}: {error}") from None
    except Exception as error:   # of a damaged file
        raise Error(f"{path}: cannot be read as {path.suffix.lower()}: {type(error).__name__}") from error


def chunks_of(path: Path) -> tuple[bytes, Path, memoryview | None]:
    """Return what `gltf` takes of a file, a glTF or GLB file by its suffix."""
    data = read(path)
    return _chunks(data, path) if path.suffix.lower() == ".glb" else (data, path, None)


def _chunks(data, path):
    """Return what `gltf` takes of a GLB file: its header, a chunk of JSON, a binary one or none."""
    if data[:4] != b"glTF" or len(data) < 20:
        raise Error("is damaged or cut short: it has no GLB header")
    version, length = struct.unpack("<2I", data[4:12])
    if version != 2:
        raise Error(f"is of GLB version {version}; allowed: 2")
    if length > len(data):
        raise Error(f"is damaged or cut short: it states {length} bytes but has {len(data)}")
    at = 12
    chunks: list[tuple[int, memoryview]] = []
    while at + 8 <= length and len(chunks) < 2:   # what comes after is of no version that is known
        size, kind = struct.unpack("<2I", data[at:at + 8])
        if at + 8 + size > length:
            raise Error(f"is damaged or cut short: a chunk of {size} bytes ends after the {length} of the file")
        chunks.append((kind, memoryview(data)[at + 8:at + 8 + size]))
        at += 8 + size
    if not chunks or chunks[0][0] != 0x4E4F534A:
        raise Error("is damaged or cut short: its first chunk is not JSON")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == 0x004E4942 else None
    return bytes(chunks[0][1]), path, binary


def gltf(data: bytes, path: Path, binary: memoryview | None = None) -> dict:
    """Return the fields of the Mesh of a glTF file: float64 positions, normals and uv (or None), int64 faces, and which
    of `load_materials` each has (or None).

    data: its JSON. path: of the file, for buffers beside it. binary: the GLB's chunk. All triangles of the scene that
    is shown become one mesh in its world, as they stand before any animation begins: instances, morph targets by
    their default weights, skins by where their joints are.
    """
    source = Source(_tree(data), path, binary)
    nodes = Nodes(source)
    uses = list(_uses(source, nodes))
    return _together(source, nodes, uses, (Part(source, nodes, use) for use in uses))


def animated(data: bytes, path: Path, binary: memoryview | None, name: str | int | None) -> tuple[dict, Any, tuple]:
    """Return what `gltf` does of a file in rest, its Motions by an animation (its name, its number from 0, or None: the
    first), and the names of all."""
    source = Source(_tree(data), path, binary)
    nodes = Nodes(source)
    uses = list(_uses(source, nodes))
    motions = Motions(source, nodes, uses, name)
    return _together(source, nodes, uses, motions.parts), motions, names_of(source)


def _together(source, nodes, uses, parts):
    """Return the fields of the Mesh of all uses, of which each is a part."""
    vertices, faces = (sum(getattr(use, name) * use.copies for use in uses) for name in ("vertices", "faces"))
    if max(vertices, faces) > MAX_PLACED:
        raise Error(f"has {faces} faces of {vertices} vertices; allowed: at most {MAX_PLACED} of each")
    result: dict[str, Any] = {"positions": None, "normals": None, "uv": None, "faces": np.empty((faces, 3), np.int64)}
    repeats = [use.faces * use.copies for use in uses]
    result["numbering"] = {"labels": tuple(_labels(names, repeats) for names in zip(*(use.names for use in uses)))}
    default = len(source.items("materials"))
    if any(use.material is not None for use in uses):
        result["material_of"] = np.repeat([default if use.material is None else use.material for use in uses],
                                          repeats)
    vertex = face = 0
    with np.errstate(all="ignore"):   # what is not finite is found by Mesh
        for use, part in zip(uses, parts):
            positions, normals, mirrored = part.placed(nodes, use.weights)
            for name, rows in ("positions", positions), ("normals", normals), ("uv", part.uv):
                if rows is None:
                    continue
                if result[name] is None:
                    result[name] = np.zeros((vertices, rows.shape[-1]))
                result[name][vertex:vertex + use.vertices * use.copies].reshape(use.copies, use.vertices, -1)[:] = rows
            wound = part.wound(mirrored)
            result["faces"][face:face + len(wound)] = wound + vertex
            vertex, face = vertex + use.vertices * use.copies, face + len(wound)
    return result


def _labels(names, repeats):
    """Return tuples of names, each once, and which of them are each face's; of names of uses of so many faces each."""
    distinct = {each: number for number, each in enumerate(dict.fromkeys(names))}
    return tuple(distinct), np.repeat([distinct[each] for each in names], repeats)


def _tree(data):
    """Return what a glTF file's JSON holds, if it is of a version and needs only extensions that are known."""
    if data.count(b",") + data.count(b"[") + data.count(b"{") > MAX_VALUES:
        raise Error(f"has a JSON of more than {MAX_VALUES} values; allowed: at most that")
    tree = json.loads(data, parse_constant=_no_number)
    if not isinstance(tree, dict):
        checks.refuse("the JSON", tree, "an object")
    asset = child(tree, "asset", dict, "")
    for name in ("version", "minVersion"):
        version = str(asset.get(name, "2.0"))
        if not (version.startswith("2.") and (name == "version" or version == "2.0")):
            raise Error(f"is of glTF version {version[:20]!r} (asset.{name}); allowed: 2.0")
    for name in child(tree, "extensionsRequired", list, ""):
        if not isinstance(name, str) or name not in DONE | HARMLESS:
            raise Error(f"needs the extension {str(name)[:60]}, which is not read here; allowed: files without it")
    return tree


def _no_number(name):
    raise Error(f"has {name} in its JSON; allowed: numbers")


# --- primitives -----------------------------------------------------------------------------------------


def _uses(source: Source, nodes: Nodes) -> Iterator[Use]:
    """Yield the primitives with faces of all nodes that are shown, of which only counts are read."""
    faces, uses, others = 0, 0, set()
    known: dict[int, list] = {}   # of a mesh: its primitives
    for k in nodes.shown:
        node = nodes.items[k]
        if "mesh" not in node:
            continue
        number, mesh = source.item("meshes", node, "mesh", f"nodes[{k}]")
        if number not in known:
            known[number] = list(_primitives(source, mesh, f"meshes[{number}]"))
        copies = _copies(source, node, f"nodes[{k}]")
        uses += len(known[number])
        if uses > MAX_USES:
            raise Error(f"draws primitives more than {MAX_USES} times; allowed: at most that")
        for primitive, where, mode, vertices, count in known[number]:
            if mode < 4:
                others.add(MODES[mode])
            elif count:
                faces += count
                material: int | None = None
                found: dict = {}
                if "material" in primitive:
                    material, found = source.item("materials", primitive, "material", where)
                names = tuple((each["name"],) if isinstance(each.get("name"), str) else ()
                              for each in (node, mesh, found))
                yield Use(k, primitive, where, _weights(node, mesh, primitive, where), mode, vertices, count, copies,
                           material, names)
    if not faces:
        raise Error(f"has no faces, only {' and '.join(sorted(others))}" if others else
                    "has no faces: no node of its scene has a mesh of triangles")


def _primitives(source, mesh, where):
    """Yield (primitive, its name, mode, vertices, faces) of a mesh."""
    for j, primitive in enumerate(child(mesh, "primitives", list, where)):
        name = f"{where}.primitives[{j}]"
        if not isinstance(primitive, dict):
            checks.refuse(name, primitive, "an object")
        mode = whole(primitive, "mode", name, 4)
        if mode >= len(MODES):
            raise Error(f"{name}.mode is {mode}; allowed: 0 to {len(MODES) - 1}")
        yield primitive, name, mode, *_counts(source, primitive, mode, name)


def _counts(source, primitive, mode, where):
    """Return how many (vertices, faces) a primitive has; Error where they are not in accessors."""
    attributes = child(primitive, "attributes", dict, where)
    accessors = [source.item("accessors", attributes, name, f"{where}.attributes")[1] for name in attributes]
    if "indices" in primitive:
        accessors.append(source.item("accessors", primitive, "indices", where)[1])
    stored = all("bufferView" in each or "sparse" in each for each in accessors)
    unknown = sorted(set(child(primitive, "extensions", dict, where)) - DONE - HARMLESS)
    if unknown and not (stored and "POSITION" in attributes):
        raise Error(f"{where} is only stored as the extension {unknown[0][:60]} holds it; allowed: files without it")
    if "POSITION" not in attributes:
        return 0, 0   # nothing is to be drawn (3.7.2.1)
    vertices = source.count(attributes, "POSITION", where)
    corners = source.count(primitive, "indices", where) if "indices" in primitive else vertices
    if mode == 4 and corners % 3:
        raise Error(f"{where} has {corners} corners; allowed for triangles: a multiple of three")
    return vertices, corners // 3 if mode == 4 else max(corners - 2, 0)


def _weights(node, mesh, primitive, where):
    """Return the default weights of a primitive's morph targets: the node's, else its mesh's, else zeros."""
    targets = child(primitive, "targets", list, where)
    weights = node.get("weights", mesh.get("weights", [0] * len(targets)))
    if not targets:
        return ()
    return tuple(vector({"weights": weights}, "weights", len(targets), f"{where}, its morph", None).tolist())


def _copies(source, node, where):
    """Return how often a node's mesh is drawn: once, or its instances (EXT_mesh_gpu_instancing)."""
    attributes = instances(node, where)
    if attributes is None:
        return 1
    counts = {source.count(attributes, name, where) for name in ("TRANSLATION", "ROTATION", "SCALE")
              if name in attributes}
    if len(counts) != 1 or "skin" in node:
        problem = "and a skin" if "skin" in node else f"with counts of {sorted(counts)}"
        raise Error(f"{where} has instances {problem}; allowed: TRANSLATION, ROTATION, SCALE of one count, and no skin")
    return counts.pop()
