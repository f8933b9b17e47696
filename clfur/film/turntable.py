"""A camera that goes around what it sees."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..scene import Scene, extent, frame
from ..scene.checks import frozen
from ..scene.origin import copied

SIDES = 12   # from which all must be in the picture


def turntable(scene: Any, degrees: float, seconds: float, lights: bool = False,
              framed: bool = False) -> Callable[[float], Scene]:
    """Return a function of seconds whose Scenes are seen from all around, against the clock as seen from above.

    scene: a `Scene`, or a function of seconds that gives one. degrees: by which the camera goes around the vertical
    line through the middle of what is drawn at first, in so many seconds. lights: whether they go with it, as if the
    scene stood on a turntable before a camera that stands still. framed: whether the camera, which is one that `frame`
    has placed, goes so far away that all is in the picture from all sides.
    """
    at = scene if callable(scene) else lambda _: scene
    first = at(0.0)
    middle, _ = extent(first.mesh, first.fur)
    far = _far(first, middle) if framed else None

    def turned(moment):
        now, turn = at(moment), _turn(math.radians(degrees) * moment / seconds)
        return copied(now, camera=_turned(far or now.camera, turn, middle), light=tuple(
            _turned(light, turn, middle) for light in now.lights) if lights else now.light)

    return turned


def _turn(angle):
    """The rotation [3, 3] around the vertical by an angle, from +Z to +X."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])


def _turned(thing, turn, middle):
    """A Camera or Light, turned around a place."""
    fields = {name: frozen(turn @ (getattr(thing, name) - middle) + middle) for name in ("eye", "target", "position")
              if getattr(thing, name, None) is not None}
    fields |= {name: frozen(turn @ getattr(thing, name)) for name in ("direction", "up")
               if getattr(thing, name, None) is not None}
    if hasattr(thing, "pose"):
        pose = thing.pose.copy()
        pose[:3, :3], pose[:3, 3] = turn @ pose[:3, :3], turn @ (pose[:3, 3] - middle) + middle
        fields["pose"] = frozen(pose)
    return copied(thing, **fields)


def _far(scene, middle):
    """The camera of a Scene that looks at the line it goes around, from where all sides of it fit into the picture."""
    camera, found = scene.camera, []
    slope = math.tan(math.radians(camera.fov) / 2)
    slopes = np.array([slope * camera.size[0] / camera.size[1], slope])
    towards = camera.eye - camera.target
    for side in range(SIDES):
        seen = frame(scene.mesh, scene.fur, camera.size, camera.fov, direction=_turn(2 * math.pi * side / SIDES) @ towards,
                     ground=scene.ground, lights=scene.lights)
        found.append([*seen.pose[:3, :2].T @ (seen.target - middle), np.linalg.norm(seen.eye - seen.target)])
    aside, above, distance = np.transpose(found)
    height = (above.min() + above.max()) / 2
    distance = distance + np.maximum(np.abs(aside) / slopes[0], np.abs(above - height) / slopes[1])
    target = middle + height * camera.pose[:3, 1]
    return type(camera)(eye=target + distance.max() * towards / np.linalg.norm(towards), target=target, up=camera.up,
                        fov=camera.fov, size=camera.size)
