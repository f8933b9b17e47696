"""Cameras and lights -> the matrices that the kernels see with."""

import math
from dataclasses import dataclass
from typing import Any

import attrs
import numpy as np

from .. import layout
from ..scene import Light, Scene, extent
from ..settings import Settings


@dataclass(frozen=True)
class Rig:
    """A scene and all that looks at it, made once a frame; whatever needs a view or a size is handed this."""

    scene: Scene
    settings: Settings    # shadows are off where no light shines: what stands before one that is out cannot matter
    center: np.ndarray    # [3] of a ball around all that is drawn,
    radius: float         # and its radius [world]
    view: np.void         # layout.View: the whole picture
    lights: tuple         # layout.Light of each light of the scene,
    light_views: tuple    # its layout.View, None without a shadow map or where it is out,
    grids: tuple          # and its layout.Grid, None without shadows or where it is out

    @classmethod
    def of(cls, scene: Scene, settings: Settings = Settings()) -> "Rig":
        """The `Rig` of a scene and how it is drawn."""
        if not any(np.any(light.color) for light in scene.lights):
            settings = attrs.evolve(settings, shadows="off")
        ball, shadows = extent(scene.mesh, scene.fur), settings.shadows != "off"
        return cls(
            scene, settings, *ball, view_of(scene, settings.samples, ball),
            lights=tuple(light_of(light) for light in scene.lights),
            light_views=tuple(light_view_of(scene, settings.shadow_map, light, ball)
                              if shadows and settings.shadow_map and np.any(light.color) else None
                              for light in scene.lights),
            grids=tuple(grid_of(scene, settings.grid, light, ball) if shadows and np.any(light.color) else None
                        for light in scene.lights))


def view_of(scene: Scene, samples: int, ball: tuple | None = None) -> np.void:
    """The scene's camera as a `layout.View`; its near plane stands just before all that can be seen.

    ``ball``: what `extent` tells of the scene, where that is known already; below too.
    """
    camera = scene.camera
    center, radius = ball or extent(scene.mesh, scene.fur)
    pose, k = camera.pose, camera.intrinsics
    # Camera axes right, down, forward: forward is the distance that "depth" tells.
    world_to_camera = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(pose)
    distance = (world_to_camera @ [*center, 1.0])[2]
    radius = radius or abs(distance) or 1.0
    near = max(distance - 1.01 * radius, 1e-3 * radius)
    to_screen = np.zeros((4, 4))
    to_screen[:2] = k[:2, :3] @ world_to_camera[:3]
    to_screen[2, 3] = near
    to_screen[3] = world_to_camera[2]
    return _view(to_screen, (*pose[:3, 3], 1), camera.size, samples, math.sqrt(k[0, 0] * k[1, 1]))


def light_of(light: Light) -> np.void:
    """A `clfur.Light` as a `layout.Light`."""
    packed: Any = np.zeros((), layout.Light)
    packed["direction"][:3] = light.direction
    packed["color"] = *light.color, light.ambient
    if light.position is not None:
        packed["position"] = *light.position, 1
        packed["cone"][0] = math.cos(math.radians(light.angle) / 2)
    return packed


def light_view_of(scene: Scene, size: int, light: Light | None = None, ball: tuple | None = None) -> np.void:
    """What a light sees, as a `layout.View` of size² pixels with one sample each: parallel rays, or a spot's.

    ``light``: a `clfur.Light`, the scene's first if None; below too.
    """
    light = light or scene.lights[0]
    to_light, radius, distance, half = _frame_of(light, ball or extent(scene.mesh, scene.fur))
    to_screen = np.zeros((4, 4))
    near, far = distance - radius, distance + radius
    scale = size / (2 * half)
    if light.position is None:
        to_screen[:2] = scale * to_light[:2]
        to_screen[:2, 3] += size / 2
        to_screen[2] = -to_light[2] / (far - near)          # e falls from 1 at near to 0 at far
        to_screen[2, 3] += far / (far - near)
        to_screen[3, 3] = 1
        eye = *-light.direction, 0
    else:
        to_screen[:2] = scale * to_light[:2] + size / 2 * to_light[2]
        to_screen[2, 3] = near
        to_screen[3] = to_light[2]
        eye = *light.position, 1
    return _view(to_screen, eye, (size, size), 1, scale)


def grid_of(scene: Scene, cells: int, light: Light | None = None, ball: tuple | None = None) -> np.void:
    """The cells³ that hold all of the scene, seen from a light, as a `layout.Grid`.

    They fit a ball around the scene, so that their size does not change while the light turns.
    """
    light = light or scene.lights[0]
    to_light, radius, distance, half = _frame_of(light, ball or extent(scene.mesh, scene.fur))
    side = 2 * half / cells
    packed: Any = np.zeros((), layout.Grid)
    to_grid = np.zeros((4, 4))
    to_grid[:2] = to_light[:2] / side
    to_grid[2] = to_light[2] * cells / (2 * radius)
    to_grid[2, 3] -= (distance - radius) * cells / (2 * radius)
    if light.position is None:
        to_grid[:2, 3] += cells / 2
        to_grid[3, 3] = 1
        packed["light"][:3] = -light.direction
    else:
        to_grid[:2] += cells / 2 * to_light[2]
        to_grid[3] = to_light[2]
        packed["light"] = *light.position, 1
    packed["to_grid"] = to_grid.T
    packed["size"][:3] = cells
    packed["face"][:3] = side * side, side, 1 if light.position is None else distance - radius
    return packed


def _frame_of(light, ball):
    """(world -> axes of the light [4, 4], radius, distance of the centre along the light, half a side).

    Half a side is that of the square that the light must see: in world units, or for a spot at distance 1.
    """
    center, radius = ball
    radius = 1.001 * radius or 1.0                       # nothing lies on the border
    to_light = np.eye(4)
    to_light[:3, :3] = _axes(light.direction)
    if light.position is None:
        to_light[:3, 3] = -to_light[:3, :3] @ center
        return to_light, radius, 0.0, radius
    to_light[:3, 3] = -to_light[:3, :3] @ light.position
    distance = (to_light @ [*center, 1.0])[2]
    # The light may stand inside the scene, or look away from it: what is nearer than this casts no shadow.
    near = max(distance - radius, 0.05 * radius)
    far = distance + radius if distance + radius > near else 2 * near
    # The cone, or as much of it as the ball around the scene fills.
    off = np.linalg.norm(center - light.position)
    widest = math.acos(max(min(distance / off, 1), -1)) + math.asin(radius / off) if off > radius else math.pi
    return to_light, (far - near) / 2, (far + near) / 2, math.tan(min(math.radians(light.angle) / 2, widest))


def _axes(z):
    """Rows x, y, z of a frame that turns as smoothly as z does, but where z points straight up."""
    turn, cosine = np.cross((0, -1, 0), z), -z[1]
    if cosine < -1 + 1e-9:
        return np.array([(1, 0, 0), (0, 0, -1), z])
    # The shortest turn from straight down to z (Rodrigues), of the axis x.
    x = np.array([1.0, 0, 0])
    x = x + np.cross(turn, x) + np.cross(turn, np.cross(turn, x)) / (1 + cosine)
    return np.array([x, np.cross(z, x), z])


def _view(to_screen, eye, size, samples, scale):
    view = np.zeros((), layout.View)
    view["to_screen"] = to_screen.T
    view["to_world"] = np.linalg.inv(to_screen).T
    view["eye"] = eye
    view["size"] = *size, samples, layout.pattern_start(samples)
    view["scale"][:2] = scale, layout.least_half_width(samples)
    view["rows"][1] = size[1]
    return view


def band_of(view: np.void, first: int, end: int) -> np.void:
    """The `layout.View` that draws only these rows of a view, as the very same bits."""
    band = view.copy()
    band["rows"][:2] = first, end
    return band


def one_sample(view: np.void) -> np.void:
    """A `layout.View` of the same pixels, each seen by one sample in its middle."""
    single = view.copy()
    single["size"][2:] = 1, layout.pattern_start(1)
    return single
