"""Grounds."""

from typing import Any

import attrs
import numpy as np

from . import checks
from .bounds import boxes_to_see
from .seen import is_unknown


@attrs.frozen(eq=False)
class Ground:
    """A level plane without an end, seen from above: what shadows of fur and body fall on.

    height: its y in the world; None is the lowest vertex of the mesh, or without one the lowest point of Curves.
    color: None for its shadow alone, black and as opaque as light is missing there, to be laid over a photo; or linear
    RGB >= 0 (arrays of uint8 or uint16 are sRGB) of a plane that reflects light as the body does, an Environment's too.
    It hides what lies under it and casts no shadow; a camera under it does not see it. Raises Error otherwise.
    """

    height: float | None = checks.field(checks.optional(checks.real()), default=None)
    color: checks.Given = checks.field(checks.optional(checks.color), default=None)


def height_of(scene: Any) -> float:
    """Return the y of a scene's ground, relative to the scene's origin."""
    scene = scene.local
    if scene.ground.height is not None:
        return float(scene.ground.height)
    if scene.mesh is not None:
        return float(scene.mesh.positions[:, 1].min())
    if is_unknown(scene.strands):
        return float(scene.strands.bounds.center[1] - scene.strands.bounds.radius)
    return float(min((low[1] for low, _ in boxes_to_see(None, scene.fur)), default=0.0))


def ground_from(camera: Any, height: float) -> tuple[np.ndarray, float] | None:
    """Return (a [3], how high the eye stands above) of a ground, or None where the eye is not above it: at pixel (x, y)
    the ground lies (eye's height) / (a @ (x, y, 1)) along the view's axis, where that is above 0."""
    above = float(camera.pose[1, 3] - height)
    if not above > 0:
        return None
    down = -(camera.pose[1, :3] * (1, -1, -1)) @ np.linalg.inv(camera.intrinsics)
    return down, above
