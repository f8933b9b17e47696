"""The vertices of glTF primitives, and where morph targets, skins, nodes and instances put them (glTF 2.0, 3.7)."""

import math

import attrs
import numpy as np

from ..errors import Error
from ..scene import checks
from .gltf_data import child, vector, whole
from .gltf_nodes import IDENTITY, composed

BLOCK = 2**13   # vertices that are skinned at a time: what is between stays in a cache


@attrs.frozen
class Use:
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


class Part:
    """A primitive of a node's mesh, read once, and placed for each pose. uv: float64 [vertices, 2], or None."""

    def __init__(self, source, nodes, use, targets=None):
        """targets: which morph targets will have weights; None: those that have by default."""
        self.use, self.uv, self._faces = use, _uv(source, use), _faces(source, use)
        attributes = use.primitive["attributes"]
        self._rest = {name: _attribute(source, use, attributes, name, f"{use.where}.attributes")
                      for name in ("POSITION", "NORMAL") if name in attributes}
        targets = {j for j, weight in enumerate(use.weights) if weight} if targets is None else targets
        self._targets = {name: _targets(source, use, name, targets) for name in self._rest}
        node, where = nodes.items[use.node], f"nodes[{use.node}]"
        self._influences = self._copies = None
        if "skin" in node:
            self._influences = _shares(source, use, len(nodes.bones(use.node)), self._faces)
        elif (attributes := instances(node, where)) is not None:
            self._copies = composed(*(
                source.values(attributes, name, where) if name in attributes else np.tile(default, (use.copies, 1))
                for name, default in (("TRANSLATION", (0., 0, 0)), ("ROTATION", (0., 0, 0, 1)), ("SCALE", (1., 1, 1)))))

    def placed(self, nodes, weights):
        """Return positions and normals (or None) in the world, float64 [copies, vertices, 3], and what is mirrored:
        which of the copies, or of a skin which vertices.

        nodes: where they are now. weights: of the morph targets. A skinned node's own place has no say (3.7.3.3).
        """
        positions, normals = (self._morphed(name, weights) for name in ("POSITION", "NORMAL"))
        if self._influences is not None:
            positions, normals, mirrored = _skinned(nodes.bones(self.use.node), *self._influences, positions, normals)
            return positions[None], None if normals is None else normals[None], mirrored
        matrices = nodes.world[self.use.node][None]
        if self._copies is not None:
            matrices = matrices @ self._copies
        linear = matrices[:, :3, :3]
        mirrored = np.linalg.det(linear) < 0
        if normals is not None:
            flat = np.linalg.det(linear) == 0
            inverse = np.linalg.inv(np.where(flat[:, None, None], IDENTITY[:3, :3], linear))
            normals = normals @ np.where(flat[:, None, None], 0, inverse)
        return positions @ linear.transpose(0, 2, 1) + matrices[:, None, :3, 3], normals, mirrored

    def wound(self, mirrored):
        """Return the faces of all copies [copies * faces, 3], turned where they are mirrored."""
        if self._influences is not None:
            turned = mirrored[self._faces].sum(axis=1) > 1
            return np.where(turned[:, None], self._faces[:, ::-1], self._faces)
        faces = np.where(mirrored[:, None, None], self._faces[:, ::-1], self._faces)
        return (faces + self.use.vertices * np.arange(self.use.copies)[:, None, None]).reshape(-1, 3)

    def _morphed(self, name, weights):
        """Return an attribute plus its weighted morph targets, float64 [vertices, 3], or None where there is none."""
        if name not in self._rest:
            return None
        values = self._rest[name].copy()
        for j, change in self._targets[name].items():
            if weights[j]:
                values += weights[j] * change
        return values


def instances(node, where):
    """Return the attributes of a node's instances (EXT_mesh_gpu_instancing), or None where it has none."""
    extensions = child(node, "extensions", dict, where)
    if "EXT_mesh_gpu_instancing" not in extensions:
        return None
    where = f"{where}.EXT_mesh_gpu_instancing"
    return child(child(extensions, "EXT_mesh_gpu_instancing", dict, where), "attributes", dict, where)


def _attribute(source, use, holder, name, where, kind=None):
    """Return an attribute's values [vertices, n]; Error if there are more or fewer."""
    count = source.count(holder, name, where, kind)
    if count != use.vertices:
        raise Error(f"{where}.{name} has {count} elements; allowed: {use.vertices}, as POSITION has")
    return source.values(holder, name, where, kind)


def _targets(source, use, name, numbers):
    """Return {number: how it changes an attribute, float64 [vertices, n]} of morph targets."""
    found = {}
    for j, target in enumerate(use.primitive.get("targets", ())):
        where = f"{use.where}.targets[{j}]"
        if not isinstance(target, dict):
            checks.refuse(where, target, "an object")
        if j in numbers and name in target:
            found[j] = _attribute(source, use, target, name, where)
    return found


def _uv(source, use):
    """Return the uv of a primitive in rest, [vertices, 2] with v upwards, or None where there is none."""
    attributes = use.primitive["attributes"]
    if "TEXCOORD_0" not in attributes:
        return None
    uv = _attribute(source, use, attributes, "TEXCOORD_0", f"{use.where}.attributes")
    weighted = {j for j, weight in enumerate(use.weights) if weight}
    for j, change in _targets(source, use, "TEXCOORD_0", weighted).items():
        uv += use.weights[j] * change
    matrix = _texture_transform(source, use)
    if matrix is not None:
        uv = uv @ matrix[:, :2].T + matrix[:, 2]
    uv[:, 1] = 1 - uv[:, 1]   # a picture's upper left corner is (0, 0) in glTF
    return uv


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


def _shares(source, use, count, faces):
    """Return which of so many joints hold each vertex, and how much: whole numbers and float64 [most, vertices].

    Weights are taken to add up to one; Error where those of a vertex of faces are none.
    """
    joints, weights = _influences(source, use, count)
    total = weights.sum(axis=1)
    bad = faces[~(total[faces] > 0)]
    if len(bad):
        raise Error(f"{use.where}.attributes has weights whose sum is {total[bad[0]]:g} at vertex {bad[0]}; "
                    "allowed: more than 0")
    weights = weights / np.where(total > 0, total, 1)[:, None]
    held = weights.any(axis=0)
    return np.ascontiguousarray(joints[:, held].T.astype(np.intp)), np.ascontiguousarray(weights[:, held].T)


def _skinned(bones, joints, weights, positions, normals):
    """Return positions and normals [vertices, 3] where the joints put them, and which vertices are mirrored.

    bones: [joints, 3, 4]. joints, weights: of `_shares`. Normals go by the cofactors of the blended matrix, which are
    its inverse transposed but for a factor.
    """
    mirrored = np.empty(len(positions), bool)
    table = np.ascontiguousarray(bones.reshape(-1, 12).T)
    for start in range(0, len(positions), BLOCK):
        rows = slice(start, start + BLOCK)
        a, b, c, x, d, e, f, y, g, h, i, z = sum(weight[rows] * table[:, joint[rows]]
                                                 for joint, weight in zip(joints, weights))
        u, v, w = positions[rows].T.copy()
        positions[rows] = np.stack([a*u + b*v + c*w + x, d*u + e*v + f*w + y, g*u + h*v + i*w + z], axis=1)
        cofactors = e*i - f*h, f*g - d*i, d*h - e*g
        mirrored[rows] = a * cofactors[0] + b * cofactors[1] + c * cofactors[2] < 0
        if normals is not None:
            u, v, w = normals[rows].T * np.where(mirrored[rows], -1, 1)
            normals[rows] = np.stack([cofactors[0]*u + cofactors[1]*v + cofactors[2]*w,
                                      (c*h - b*i)*u + (a*i - c*g)*v + (b*g - a*h)*w,
                                      (b*f - c*e)*u + (c*d - a*f)*v + (a*e - b*d)*w], axis=1)
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
