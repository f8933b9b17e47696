"""Where the nodes of a glTF file stand: their tree, the scene that is shown, joints of skins (glTF 2.0, 3.5, 3.7.3)."""

import numpy as np

from ..errors import Error
from .gltf_data import child, vector

IDENTITY = np.eye(4)


class Nodes:
    """The nodes of a file. world: float64 [n, 4, 4], their places now; local: their own matrices in rest, and trs:
    the translations, rotations and scales of these; shown: numbers of those in the scene, in order."""

    def __init__(self, source):
        self.source, self.items = source, source.items("nodes")
        self.children = [self._numbers(node, "children", f"nodes[{k}]") for k, node in enumerate(self.items)]
        self.parents = np.array(self._parents(), np.intp)
        self._levels = self._by_depth()
        self._skins = {}   # number: (joints, inverse bind matrices), once used
        self.trs, self.local = _local(self.items)
        self.move(self.local)
        self.shown = self._shown()

    def _numbers(self, holder, name, where):
        """Return the numbers of nodes in the list holder[name]."""
        numbers = child(holder, name, list, where)
        return [self.source.item("nodes", {name: number}, name, where)[0] for number in numbers]

    def _parents(self):
        """Return the number of each node's parent, -1 for a root."""
        parents = [-1] * len(self.items)
        for k, children in enumerate(self.children):
            for number in children:
                if parents[number] >= 0:
                    raise Error(f"nodes[{number}] is a child of nodes[{parents[number]}] and nodes[{k}]; allowed: one")
                parents[number] = k
        return parents

    def _by_depth(self):
        """Return the numbers of the nodes of each depth below their roots, from these on."""
        levels, waiting = [], [k for k, parent in enumerate(self.parents) if parent < 0]
        while waiting:
            levels.append(waiting)
            waiting = [number for k in waiting for number in self.children[k]]
        if lost := len(self.items) - sum(map(len, levels)):
            raise Error(f"{lost} nodes are below a node that is its own ancestor; allowed: a tree")
        return levels

    def move(self, local):
        """Place all nodes by the own matrix of each, float64 [n, 4, 4]: the product of these from its root down."""
        self._bones = {}
        with np.errstate(all="ignore"):   # what is not finite is found by Mesh
            self.world = local.copy()
            for level in self._levels[1:]:
                self.world[level] = self.world[self.parents[level]] @ self.world[level]

    def _shown(self):
        """Return the numbers of the nodes of the scene that is shown, as trimesh orders them: the last first."""
        source, scenes = self.source, self.source.items("scenes")
        if "scene" in source.tree:
            number = source.item("scenes", source.tree, "scene", "")[0]
        waiting = [k for k, parent in enumerate(self.parents) if parent < 0]
        if scenes:
            number = number if "scene" in source.tree else 0
            waiting = list(dict.fromkeys(self._numbers(scenes[number], "nodes", f"scenes[{number}]")))
            for k in waiting:
                if self.parents[k] >= 0:
                    raise Error(f"scenes[{number}] has nodes[{k}], a child of nodes[{self.parents[k]}]; allowed: roots")
        shown = []
        while waiting:
            k = waiting.pop()
            extensions = child(self.items[k], "extensions", dict, f"nodes[{k}]")
            if child(extensions, "KHR_node_visibility", dict, f"nodes[{k}]").get("visible", True) is not False:
                shown.append(k)
                waiting += self.children[k]
        return shown

    def bones(self, k):
        """Return the matrices that place a vertex by the joints of node k's skin, float64 [joints, 3, 4] (3.7.3.1)."""
        number, skin = self.source.item("skins", self.items[k], "skin", f"nodes[{k}]")
        if number not in self._skins:
            self._skins[number] = self._skin(skin, f"skins[{number}]")
        if number not in self._bones:
            joints, bind = self._skins[number]
            self._bones[number] = (self.world[joints] @ bind)[:, :3]
        return self._bones[number]

    def _skin(self, skin, where):
        """Return a skin's joints, numbers of nodes, and their inverse bind matrices, float64 [joints or 1, 4, 4]."""
        joints = self._numbers(skin, "joints", where)
        if not joints:
            raise Error(f"{where}.joints is []; allowed: one or more")
        if "inverseBindMatrices" not in skin:
            return joints, IDENTITY[None]
        bind = self.source.values(skin, "inverseBindMatrices", where).reshape(-1, 4, 4).transpose(0, 2, 1)
        if len(bind) < len(joints):
            raise Error(f"{where} has {len(bind)} inverseBindMatrices; allowed: {len(joints)}, one a joint")
        bind = bind[:len(joints)]
        _check_affine(bind, f"{where}.inverseBindMatrices")
        return joints, bind


def _local(nodes):
    """Return the translation, rotation and scale of each node, and its own matrix, float64 [n, 4, 4]."""
    trs = moved, turned, scaled = [
        np.array([vector(node, name, len(default), f"nodes[{k}]", default) for k, node in enumerate(nodes)]).reshape(
            -1, len(default)) for name, default in (
            ("translation", (0, 0, 0)), ("rotation", (0, 0, 0, 1)), ("scale", (1, 1, 1)))]
    matrices = composed(moved, turned, scaled)
    for k, node in enumerate(nodes):
        if "matrix" in node:
            given = [name for name in ("translation", "rotation", "scale") if name in node]
            if given:
                raise Error(f"nodes[{k}] has a matrix and a {given[0]}; allowed: one of both")
            matrices[k] = vector(node, "matrix", 16, f"nodes[{k}]").reshape(4, 4).T
            _check_affine(matrices[k], f"nodes[{k}].matrix")
    return trs, matrices


def _check_affine(matrices, where):
    """Error if the last row of a matrix [..., 4, 4] is not 0, 0, 0, 1, up to how programs round."""
    if not (np.abs(matrices[..., 3, :] - IDENTITY[3]) < 1e-5).all():
        raise Error(f"{where} has a last row that is not 0, 0, 0, 1; allowed: that alone")


def composed(moved, turned, scaled):
    """Return the matrices T·R·S of translations [n, 3], quaternions xyzw [n, 4] and scales [n, 3]: float64 [n, 4, 4].

    Quaternions need not be of length one; those of length zero do not turn.
    """
    turned = np.ldexp(turned, -np.frexp(np.abs(turned).max(axis=1, keepdims=True))[1])   # so that no square overflows
    length = (turned**2).sum(axis=1, keepdims=True)
    x, y, z, w = (turned / np.sqrt(np.where(length > 0, length, 2) / 2)).T
    rows = [(1 - y*y - z*z, x*y - z*w, x*z + y*w), (x*y + z*w, 1 - x*x - z*z, y*z - x*w),
            (x*z - y*w, y*z + x*w, 1 - x*x - y*y)]
    matrices = np.zeros((len(moved), 4, 4))
    matrices[:, :3, :3] = np.stack([np.stack(row, axis=-1) for row in rows], axis=1) * scaled[:, None]
    matrices[:, :3, 3] = moved
    matrices[:, 3, 3] = 1
    return matrices
