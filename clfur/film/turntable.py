"""A camera that goes around what it sees."""

from collections.abc import Callable
from typing import Any

from ..scene import Scene, extent
from ..scene.camera import around
from ..scene.checks import frozen
from ..scene.origin import copied


def turntable(scene: Any, degrees: float, seconds: float, lights: bool = False,
              since: float = 0.0) -> Callable[[float], Scene]:
    """Return a function of seconds whose Scenes are seen from all around, against the clock as seen from above.

    scene: a `Scene`, or a function of seconds that gives one. degrees: by which the camera goes around the vertical
    line through the middle of what is drawn at first, in so many seconds. lights: whether they go with it, as if the
    scene stood on a turntable before a camera that stands still. since: seconds when the camera is where it is given.
    """
    at = scene if callable(scene) else lambda _: scene
    first = at(0.0)
    middle, _ = extent(first.mesh, first.fur)

    def turned(moment):
        now, turn = at(moment), around(degrees * (moment - since) / seconds)
        return copied(now, camera=_turned(now.camera, turn, middle), light=tuple(
            _turned(light, turn, middle) for light in now.lights) if lights else now.light)

    return turned


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
