"""Grounds."""

from typing import Any

import attrs
import numpy as np

from . import checks
from .bounds import boxes_to_see, strands_and_shells
from .display import brief
from .seen import is_unknown

REACH = 3.0   # radii of a scene from its middle: shadows on a ground that are framed


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
    __repr__ = brief


def height_of(scene: Any) -> float:
    """Return the y of a scene's ground, relative to the scene's origin."""
    scene = scene.local
    return height_on(scene.ground, scene.mesh, scene.fur)


def height_on(ground: Ground, mesh: Any, fur: Any) -> float:
    """Return the y of a ground under a mesh and its fur, all seen from one place."""
    if ground.height is not None:
        return float(ground.height)
    if mesh is not None:
        return float(mesh.positions[:, 1].min())
    strands, _ = strands_and_shells(fur)
    if is_unknown(strands):
        return float(strands.bounds.center[1] - strands.bounds.radius)
    return float(min((low[1] for low, _ in boxes_to_see(None, fur)), default=0.0))


def shadow_places(points: np.ndarray, margin: float, height: float, middle: np.ndarray, radius: float,
                  lights: Any) -> np.ndarray:
    """Return places [m, 3] on a ground at a height: the ``margin`` around their hull holds the shadows that lights make
    of all within the margin of points [n, 3]. Those no further than `REACH` radii from the middle [3] count, as a low
    light's shadows are without an end, and those of lights at least half as strong as the strongest."""
    found, strongest = [np.zeros((0, 3))], max((light.strength.sum() for light in lights if light.casts), default=0.0)
    for light in lights:
        if light.casts and light.strength.sum() >= strongest / 2:
            way = np.broadcast_to(light.direction, points.shape) if light.position is None else points - light.position
            down = (way[:, 1] < 0) & (points[:, 1] >= height)
            start, way = points[down], way[down]
            places = start + way * ((height - start[:, 1]) / way[:, 1])[:, None]
            # A ball's shadow is an ellipse: as wide as the ball, and longer, between two such balls.
            flat, steep = np.hypot(way[:, 0], way[:, 2]), np.linalg.norm(way, axis=1)
            longer = margin * (steep / -way[:, 1] - 1) / np.maximum(flat, 1e-30)
            found += [places + sign * longer[:, None] * way * (1, 0, 1) for sign in (-1, 1)]
    places = np.concatenate(found)
    return places[((places - middle) ** 2).sum(1) <= (REACH * radius) ** 2]


def ground_from(camera: Any, height: float) -> tuple[np.ndarray, float] | None:
    """Return (a [3], how high the eye stands above) of a ground, or None where the eye is not above it: at pixel (x, y)
    the ground lies (eye's height) / (a @ (x, y, 1)) along the view's axis, where that is above 0."""
    above = float(camera.pose[1, 3] - height)
    if not above > 0:
        return None
    down = -(camera.pose[1, :3] * (1, -1, -1)) @ np.linalg.inv(camera.intrinsics)
    return down, above
