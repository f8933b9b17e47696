"""Animations of glTF files: keyframes of nodes and of morph targets' weights (glTF 2.0, 3.11 and appendix C)."""

from typing import Any

import attrs
import numpy as np

from ..errors import Error, shown
from .gltf_data import Source, child, whole
from .gltf_nodes import Nodes, composed
from .gltf_parts import Part, Use

TRS = "translation", "rotation", "scale"             # as `Nodes.trs` has them
ROWS = {"LINEAR": 1, "STEP": 1, "CUBICSPLINE": 3}   # values of a keyframe: of a spline tangent in, value, tangent out


def names_of(source: Source) -> tuple:
    """Return what the animations of a file are called, None for those without a name."""
    return tuple(each["name"] if isinstance(each.get("name"), str) else None for each in source.items("animations"))


@attrs.frozen
class Track:
    """Keyframes of nodes that share their times. path: what they are of. times: [keys], rising. values: [keys, 1 or 3
    as in ROWS, nodes, numbers]; a spline's tangents come before and after its values."""

    path: str
    interpolation: str
    nodes: list
    times: np.ndarray
    values: np.ndarray

    def at(self, seconds: float) -> np.ndarray:
        """Return the values at a time, [nodes, numbers]; before the first keyframe and after the last they stay."""
        times, values = self.times, self.values
        k = int(np.clip(np.searchsorted(times, seconds, "right") - 1, 0, len(times) - 1))
        after = min(k + 1, len(times) - 1)
        span = times[after] - times[k]
        share = min(max((seconds - times[k]) / span, 0.0), 1.0) if span > 0 else 0.0
        if self.interpolation == "CUBICSPLINE":
            found = _spline(values[k], values[after], share, span)
            return found / _length(found) if self.path == "rotation" else found
        one, other = values[k, 0], values[after, 0]
        if self.interpolation == "STEP":
            return one
        return _slerp(one, other, share) if self.path == "rotation" else one + share * (other - one)


def _spline(one, other, t, span):
    """Values between two keyframes [3, ...] by Hermite's cubic spline (C.5)."""
    return ((2*t**3 - 3*t**2 + 1) * one[1] + span * (t**3 - 2*t**2 + t) * one[2]
            + (3*t**2 - 2*t**3) * other[1] + span * (t**3 - t**2) * other[0])


def _slerp(one, other, share):
    """Quaternions [n, 4] a share of the shorter way from one to another, at even speed (C.4)."""
    one, other = one / _length(one), other / _length(other)
    cosine = (one * other).sum(1, keepdims=True)
    angle = np.arctan2(np.sqrt(np.maximum(1 - cosine**2, 0)), np.abs(cosine))
    near = angle < 1e-6   # where sines would divide zero by zero, and a straight line is as exact
    sine = np.where(near, 1, np.sin(angle))
    of_one = np.where(near, 1 - share, np.sin((1 - share) * angle) / sine)
    of_other = np.where(near, share, np.sin(share * angle) / sine)
    return of_one * one + of_other * np.where(cosine < 0, -1, 1) * other


def _length(quaternions):
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return np.where(length > 0, length, 1)


class Motions:
    """An animation of a file: where its vertices are at each time. times: of all its keyframes, rising; parts: of uses;
    left: words for channels that are left out, and where."""

    def __init__(self, source: Source, nodes: Nodes, uses: list[Use], name: str | int | None) -> None:
        self._nodes, self._uses = nodes, uses
        self._targets = {use.node: len(use.weights) for use in uses}
        self.left: dict[str, str] = {}
        self._tracks = self._read(source, *_chosen(source, name))
        moved = [node for track in self._tracks if track.path != "weights" for node in track.nodes]
        self._moved = np.unique(np.array(moved, np.intp))
        for k in self._moved:
            if "matrix" in nodes.items[k]:
                raise Error(f"nodes[{k}] has a matrix and is animated; allowed: translation, rotation and scale")
        self.parts = [Part(source, nodes, use, self._weighted(use)) for use in uses]
        self.times = np.unique(np.concatenate([np.zeros(1), *(track.times for track in self._tracks)]))

    def at(self, seconds: float) -> tuple[np.ndarray, np.ndarray | None]:
        """Return positions and normals (or None; zeros where the file has none) at a time, float64 [vertices, 3], in
        the order of those of the file."""
        trs = [each.copy() for each in self._nodes.trs]
        weights: dict[int, Any] = {}
        for track in self._tracks:
            if track.path == "weights":
                weights |= zip(track.nodes, track.at(seconds))
            else:
                trs[TRS.index(track.path)][track.nodes] = track.at(seconds)
        local = self._nodes.local.copy()
        local[self._moved] = composed(*(each[self._moved] for each in trs))
        self._nodes.move(local)
        found = [part.placed(self._nodes, weights.get(use.node, use.weights))[:2]
                 for use, part in zip(self._uses, self.parts)]
        positions = np.concatenate([each.reshape(-1, 3) for each, _ in found])
        if all(each is None for _, each in found):
            return positions, None
        return positions, np.concatenate([np.zeros((place.size // 3, 3)) if each is None
                                          else each.reshape(-1, 3) for place, each in found])

    def _weighted(self, use):
        """Which morph targets of a use have a weight at any time."""
        weights = [np.array(use.weights).reshape(1, -1)]
        for track in self._tracks:
            if track.path == "weights" and use.node in track.nodes:
                weights.append(track.values[:, :, track.nodes.index(use.node)].reshape(-1, len(use.weights)))
        return set(np.flatnonzero(np.concatenate(weights).any(axis=0)).tolist())

    def _read(self, source, animation, where):
        """Return the Tracks of an animation; nodes that have the same times share one."""
        found, taken, times = {}, set(), {}
        samplers = child(animation, "samplers", list, where)
        for j, channel in enumerate(child(animation, "channels", list, where)):
            name = f"{where}.channels[{j}]"
            if not isinstance(channel, dict):
                raise Error(f"{name} is {shown(channel)}; allowed: an object")
            target = child(channel, "target", dict, name)
            path: Any = target.get("path")
            if path not in (*TRS, "weights"):
                self.left.setdefault(f"what moves {shown(path)}", name)
                continue
            if "node" not in target:
                continue   # to be passed over (3.11)
            node, _ = source.item("nodes", target, "node", f"{name}.target")
            if path == "weights" and not self._targets.get(node):
                continue   # of nothing that is drawn
            if (node, path) in taken:
                raise Error(f"{name} moves the {path} of nodes[{node}] again; allowed: one channel for it")
            taken.add((node, path))
            number = whole(channel, "sampler", name)
            if number >= len(samplers) or not isinstance(samplers[number], dict):
                raise Error(f"{name}.sampler is {number}; allowed: less than {len(samplers)}, the number of samplers")
            sampler, of = samplers[number], f"{where}.samplers[{number}]"
            key = whole(sampler, "input", of), path, _interpolation(sampler, of), self._targets.get(node)
            if key[0] not in times:
                times[key[0]] = _times(source, sampler, of)
            numbers = self._targets[node] if path == "weights" else 4 if path == "rotation" else 3
            values = _values(source, sampler, of, path, len(times[key[0]]), numbers)
            found.setdefault(key if path == "weights" else key[:3], []).append((node, values))
        if not found and not self.left:
            raise Error(f"{where} moves nothing; allowed: one with channels")
        return [Track(key[1], key[2], [node for node, _ in each], times[key[0]], np.stack([v for _, v in each], axis=2))
                for key, each in found.items()]


def _chosen(source, name):
    """Return (an animation, its place in the file) by its name, its number or None, the first."""
    animations, names = source.items("animations"), names_of(source)
    if not animations:
        raise Error("has no animation; allowed: files with one (`load_mesh` reads what does not move)")
    number = 0 if name is None else name
    if isinstance(name, str):
        number = names.index(name) if name in names else -1
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(animations):
        listed = ", ".join(repr(each) for each in names[:20] if each is not None)
        raise Error(f"has no animation {shown(name)}; allowed: None, 0 to {len(animations) - 1}"
                    + (f", {listed}" if listed else "") + (", ..." if len(names) > 20 else ""))
    return animations[number], f"animations[{number}]"


def _interpolation(sampler, where):
    kind = sampler.get("interpolation", "LINEAR")
    if not isinstance(kind, str) or kind not in ROWS:
        raise Error(f"{where}.interpolation is {shown(kind)}; allowed: {', '.join(ROWS)}")
    return kind


def _times(source, sampler, where):
    times = source.values(sampler, "input", where, "time")[:, 0]
    if not len(times) or not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise Error(f"{where}.input has {len(times)} times that are not finite or do not rise; allowed: one or more "
                    "that rise")
    return times


def _values(source, sampler, where, path, keys, numbers):
    """Return a sampler's output: float64 [keys, 1 or 3, numbers]."""
    _, accessor = source.item("accessors", sampler, "output", where)
    if accessor.get("componentType") != 5126 and accessor.get("normalized") is not True:
        raise Error(f"{where}.output has whole numbers that are not normalized; allowed: normalized ones, or floats")
    rows = ROWS[_interpolation(sampler, where)]
    wanted = keys * rows * (numbers if path == "weights" else 1)
    count = source.count(sampler, "output", where, path)
    if count != wanted:
        raise Error(f"{where}.output has {count} elements; allowed: {wanted}, as its {keys} keyframes of {path} need")
    values = source.values(sampler, "output", where, path)
    if not np.isfinite(values).all():
        raise Error(f"{where}.output has numbers that are not finite; allowed: finite ones")
    return values.reshape(keys, rows, numbers)
