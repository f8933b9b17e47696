"""glTF and GLB files -> the fields of a Mesh (glTF 2.0); what would move a point is done, or refused by its name.

Read here and not by trimesh, which takes normalized integers and sparse accessors as they are stored, and passes over
fans, skins, morph targets, instances and extensions that a file needs.
"""

import json
import math
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from ..scene import Material, checks
from .gltf_data import Source, child, vector, whole
from .gltf_materials import materials_of
from .gltf_nodes import IDENTITY, Nodes, composed
from .input import read

MAX_PLACED = 2**26   # faces, and vertices, of all nodes and instances together
MAX_USES = 2**18     # of primitives by nodes
MAX_VALUES = 2**23   # of the JSON: each takes some 100 bytes once it is read
BLOCK = 2**14        # vertices that are skinned at a time
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
    data = read(path)
    try:
        tree, _, binary = _chunks(data, path) if path.suffix.lower() == ".glb" else (data, path, None)
        source = Source(_tree(tree), path, binary)
        used = {use.material for use in _uses(source, Nodes(source)) if use.material is not None}
        return materials_of(source, used) if used else ()
    except Error as error:
        raise Error(f"{path}: {error}") from None
    except Exception as error:   # of a damaged file
        raise Error(f"{path}: cannot be read as {path.suffix.lower()}: {type(error).__name__}") from error


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
        for use in uses:
            part = _placed(source, nodes, use)
            for name in ("positions", "normals", "uv"):
                if part[name] is None:
                    continue
                if result[name] is None:
                    result[name] = np.zeros((vertices, part[name].shape[-1]))
                rows = part[name].reshape(-1, part[name].shape[-1])
                result[name][vertex:vertex + len(rows)] = rows
            rows = part["faces"].reshape(-1, 3)
            result["faces"][face:face + len(rows)] = rows + vertex
            vertex, face = vertex + use.vertices * use.copies, face + len(rows)
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


@attrs.frozen
class _Use:
    """A primitive of a node's mesh. weights: of its morph targets; vertices, faces: how many; copies: instances;
    material: which, or None; names: of the node, of the mesh and of the material, a tuple each."""

    node: int
    primitive: dict
    where: str
    weights: tuple
    mode: int
    vertices: int
    faces: int
    copies: int
    material: int | None
    names: tuple


def _uses(source: Source, nodes: Nodes) -> Iterator[_Use]:
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
                yield _Use(k, primitive, where, _weights(node, mesh, primitive, where), mode, vertices, count, copies,
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
    attributes = _instances(node, where)
    if attributes is None:
        return 1
    counts = {source.count(attributes, name, where) for name in ("TRANSLATION", "ROTATION", "SCALE")
              if name in attributes}
    if len(counts) != 1 or "skin" in node:
        problem = "and a skin" if "skin" in node else f"with counts of {sorted(counts)}"
        raise Error(f"{where} has instances {problem}; allowed: TRANSLATION, ROTATION, SCALE of one count, and no skin")
    return counts.pop()


def _instances(node, where):
    """Return the attributes of a node's instances, or None where it has none."""
    extensions = child(node, "extensions", dict, where)
    if "EXT_mesh_gpu_instancing" not in extensions:
        return None
    where = f"{where}.EXT_mesh_gpu_instancing"
    return child(child(extensions, "EXT_mesh_gpu_instancing", dict, where), "attributes", dict, where)


def _placed(source: Source, nodes: Nodes, use: _Use) -> dict:
    """Return the fields of the Mesh of a primitive in the world: positions [copies, vertices, 3] and so on."""
    positions = _morphed(source, use, "POSITION")
    normals, uv = _morphed(source, use, "NORMAL"), _uv(source, use)
    faces = _faces(source, use)
    node, where = nodes.items[use.node], f"nodes[{use.node}]"
    if "skin" in node:
        positions, normals, mirrored = _skinned(source, use, nodes.bones(use.node), positions, normals, faces)
        turned = mirrored[faces].sum(axis=1) > 1
        faces = np.where(turned[:, None], faces[:, ::-1], faces)
        return {"positions": positions, "normals": normals, "uv": uv, "faces": faces}
    matrices = nodes.world[use.node][None]
    attributes = _instances(node, where)
    if attributes is not None:
        given = [source.values(attributes, name, where) if name in attributes else np.tile(default, (use.copies, 1))
                 for name, default in (("TRANSLATION", (0., 0, 0)), ("ROTATION", (0., 0, 0, 1)), ("SCALE", (1., 1, 1)))]
        matrices = matrices @ composed(*given)
    linear = matrices[:, :3, :3]
    mirrored = np.linalg.det(linear) < 0
    if normals is not None:
        flat = np.linalg.det(linear) == 0
        inverse = np.linalg.inv(np.where(flat[:, None, None], IDENTITY[:3, :3], linear))
        normals = normals @ np.where(flat[:, None, None], 0, inverse)
    if uv is not None:
        uv = np.broadcast_to(uv, (use.copies, *uv.shape))
    faces = np.where(mirrored[:, None, None], faces[:, ::-1], faces)
    return {"positions": positions @ linear.transpose(0, 2, 1) + matrices[:, None, :3, 3], "normals": normals,
            "uv": uv, "faces": faces + use.vertices * np.arange(use.copies)[:, None, None]}


def _attribute(source, use, holder, name, where, kind=None):
    """Return an attribute's values [vertices, n]; Error if there are more or fewer."""
    count = source.count(holder, name, where, kind)
    if count != use.vertices:
        raise Error(f"{where}.{name} has {count} elements; allowed: {use.vertices}, as POSITION has")
    return source.values(holder, name, where, kind)


def _morphed(source, use, name):
    """Return an attribute plus its weighted morph targets, float64 [vertices, n], or None where there is none."""
    attributes = use.primitive["attributes"]
    if name not in attributes:
        return None
    values = _attribute(source, use, attributes, name, f"{use.where}.attributes")
    for j, weight in enumerate(use.weights):
        target, where = use.primitive["targets"][j], f"{use.where}.targets[{j}]"
        if not isinstance(target, dict):
            checks.refuse(where, target, "an object")
        if weight and name in target:
            values += weight * _attribute(source, use, target, name, where)
    return values


def _faces(source, use):
    """Return the faces of a primitive, whole numbers [faces, 3] (3.7.2.1)."""
    corners = np.arange(use.vertices)
    if "indices" in use.primitive:
        stored = source.values(use.primitive, "indices", use.where)[:, 0]
        corners = stored.astype(np.int64)
        largest, restart = int(corners.max()), np.iinfo(stored.dtype).max
        if largest == restart:
            raise Error(f"{use.where}.indices has {restart}, a primitive's restart; allowed: primitives without one")
        if largest >= use.vertices:
            raise Error(f"{use.where}.indices has the index {largest}; allowed: 0 to {use.vertices - 1}")
    if use.mode == 4:
        return corners.reshape(-1, 3)
    if use.mode == 6:
        return np.stack([corners[1:-1], corners[2:], np.full(use.faces, corners[0])], axis=1)
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    strip[1::2] = strip[1::2, ::-1]   # every other one would face backwards
    return strip


def _uv(source, use):
    """Return the uv of a primitive, [vertices, 2] with v upwards, or None where there is none."""
    uv = _morphed(source, use, "TEXCOORD_0")
    if uv is None:
        return None
    matrix = _texture_transform(source, use)
    if matrix is not None:
        uv = uv @ matrix[:, :2].T + matrix[:, 2]
    uv[:, 1] = 1 - uv[:, 1]   # a picture's upper left corner is (0, 0) in glTF
    return uv


def _texture_transform(source, use):
    """Return the matrix [2, 3] by which the material's pictures take TEXCOORD_0, or None where they take it as it is.

    That of the base colour's picture, which is what a user lays on the mesh; without one, that which all others share
    (KHR_texture_transform; programs that store uv as integers scale them so). The signs are those of the extension's
    words and first example, which turn the other way than its matrix if that is read by columns.
    """
    if "material" not in use.primitive:
        return None
    number, material = source.item("materials", use.primitive, "material", use.where)
    found, waiting = set(), [material]
    while waiting:
        for name, value in waiting.pop().items():
            if not isinstance(value, dict) or name == "extras":
                continue
            if not name.endswith("Texture"):
                waiting.append(value)
                continue
            where = f"materials[{number}].{name}"
            transform = child(child(value, "extensions", dict, where), "KHR_texture_transform", dict, where)
            if whole(transform, "texCoord", where, whole(value, "texCoord", where, 0)):
                continue
            each = tuple(number for part, default in (("scale", (1, 1)), ("offset", (0, 0)))
                         for number in vector(transform, part, 2, where, default).tolist())
            each += tuple(vector({"rotation": [transform.get("rotation", 0)]}, "rotation", 1, where, None).tolist())
            if name in ("baseColorTexture", "diffuseTexture"):
                found, waiting = {each}, []
                break
            found.add(each)
    if len(found) > 1:
        raise Error(f"materials[{number}] has several KHR_texture_transforms of TEXCOORD_0 and no picture of the base "
                    "colour; allowed: one for all")
    (wide, high, right, down, angle), = found or {(1, 1, 0, 0, 0)}
    if (wide, high, right, down, angle) == (1, 1, 0, 0, 0):
        return None
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([(cos * wide, sin * high, right), (-sin * wide, cos * high, down)])


# --- skins ----------------------------------------------------------------------------------------------


def _skinned(source, use, bones, positions, normals, faces):
    """Return positions and normals [vertices, 3] where the joints put them, and which vertices are mirrored.

    bones: [joints, 3, 4]. The node's own place has no say (3.7.3.3); weights are taken to add up to one. Normals go by
    the cofactors of the blended matrix, which are its inverse transposed but for a factor.
    """
    joints, weights = _influences(source, use, len(bones))
    total = weights.sum(axis=1)
    bad = faces[~(total[faces] > 0)]
    if len(bad):
        raise Error(f"{use.where}.attributes has weights whose sum is {total[bad[0]]:g} at vertex {bad[0]}; "
                    "allowed: more than 0")
    weights = weights / np.where(total > 0, total, 1)[:, None]
    mirrored = np.empty(len(positions), bool)
    for start in range(0, len(positions), BLOCK):
        rows = slice(start, start + BLOCK)
        blend = np.einsum("vk,vkij->vij", weights[rows], bones[joints[rows]])
        linear = blend[:, :, :3]
        positions[rows] = (linear @ positions[rows, :, None])[:, :, 0] + blend[:, :, 3]
        mirrored[rows] = np.linalg.det(linear) < 0
        if normals is not None:
            columns = linear.transpose(2, 0, 1)
            cofactors = np.stack([np.cross(columns[k - 2], columns[k - 1]) for k in range(3)], axis=2)
            sign = np.where(mirrored[rows], -1, 1)[:, None]
            normals[rows] = (cofactors @ normals[rows, :, None])[:, :, 0] * sign
    return positions, normals, mirrored


def _influences(source, use, count):
    """Return which joints hold each vertex, and how much: whole numbers and float64 [vertices, 4 a set]."""
    attributes, where = use.primitive["attributes"], f"{use.where}.attributes"
    joints, weights = [], []
    while f"JOINTS_{len(joints)}" in attributes or f"WEIGHTS_{len(joints)}" in attributes or not joints:
        for kind, found in (("JOINTS", joints), ("WEIGHTS", weights)):
            name = f"{kind}_{len(found)}"
            if name not in attributes:
                raise Error(f"{where} has no {name}, but nodes[{use.node}] a skin; allowed: both or none")
            found.append(_attribute(source, use, attributes, name, where, kind))
    joints, weights = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
    if not (weights >= 0).all():
        raise Error(f"{where} has the weight {weights[~(weights >= 0)][0]:g}; allowed: from 0")
    joints = np.where(weights > 0, joints, 0)   # those without a weight may be any number
    if joints.size and joints.max() >= count:
        raise Error(f"{where} has the joint {joints.max()}; allowed: 0 to {count - 1}")
    return joints, weights
