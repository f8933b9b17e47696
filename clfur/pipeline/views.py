"""Cameras and lights -> the matrices that the kernels see with."""

import math
from dataclasses import dataclass
from typing import Any

import attrs
import numpy as np

from .. import layout
from ..scene import Environment, Light, Scene
from ..scene.environment import ambient_of
from ..scene.ground import ground_from, height_of
from ..scene.seen import Seen, seen
from ..settings import Settings
from .fit import Fit

MOST_CELLS = 4096   # of shells along a side of a face; as in shells.cl
NO_CONE = -2.0   # less than any cosine: all is inside
TILE = int(layout.CONSTANTS["TILE"])
COARSE = 2   # lengths of fur: cells of the grid that are wider show no shadow within it


@dataclass(frozen=True)
class Rig:
    """A scene and all that looks at it, made once a frame; whatever needs a view or a size is handed this."""

    scene: Scene
    settings: Settings    # shadows are off where no light casts any: what stands before one that is out cannot matter
    center: np.ndarray    # [3] of a ball around all that is drawn,
    radius: float         # and its radius [world]
    view: np.void         # layout.View: the whole picture
    lights: tuple         # layout.Light of each light of the scene,
    light_views: tuple    # its layout.View, None without a shadow map or where it casts none,
    grids: tuple          # and its layout.Grid, None where it casts no shadows
    fit: Fit              # what these two are fitted to
    ground: np.void | None   # layout.Ground, None where none is seen

    @classmethod
    def of(cls, scene: Scene, settings: Settings = Settings(), sample: int | None = None) -> "Rig":
        """The `Rig` of a scene and how it is drawn.

        ``sample``: row of the PATTERN where the only sample of a pixel lies; in its middle if None.
        """
        scene = scene.local
        if not any(light.casts for light in scene.lights):
            settings = attrs.evolve(settings, shadows="off")
        known, shadows = seen(scene), settings.shadows != "off"
        fit, view = Fit(scene, known), view_of(scene, settings.samples, known)
        if sample is not None:
            view["size"][3] = sample
        return cls(
            scene, settings, *known.ball, view,
            lights=tuple(light_of(light, scene.environment, settings.scattering != "off") for light in scene.lights),
            light_views=tuple(light_view_of(scene, settings.shadow_map, light, fit)
                              if shadows and settings.shadow_map and light.casts else None
                              for light in scene.lights),
            grids=tuple(grid_of(scene, settings.grid, light, fit) if shadows and light.casts else None
                        for light in scene.lights),
            fit=fit, ground=ground_of(scene, view))

    @property
    def _of_ground(self) -> list[str]:
        """Why nothing is seen of a ground."""
        scene = self.scene
        if scene.ground is None:
            return []
        if self.ground is None:
            return ["nothing is seen of the ground, as the camera does not stand above it; a lower Ground.height or a "
                    "higher camera shows it"]
        falls = self.settings.shadows != "off" and any(light.casts and _shines_down(light) for light in scene.lights)
        if scene.ground.color is None and scene.environment is None and not falls:
            return ["nothing is seen of the ground, as no shadow falls on it; a light from above with shadows, an "
                    "Environment, or a Ground.color shows it"]
        return []

    @property
    def warnings(self) -> list[str]:
        """What is known to be wrong in the picture."""
        found, shells, mesh = [], self.scene.shells, self.scene.mesh
        sides = [float(grid["face"][1]) for grid in self.grids if grid is not None and not grid["light"][3]]
        if self.fit.seen.cropped and 0 < COARSE * self.fit.grown < max(sides, default=0):
            found.append(f"cells of the light's grid are {max(sides):.3g} wide and fur {self.fit.grown:.3g} long, as "
                         "it goes far into the distance: shadows are hardly seen, near ones too; less of it, or a bald "
                         "ground, has finer ones")
        found += self._of_ground
        if shells is not None and mesh is not None and shells.pattern == "cells":
            cells = shells.frequency_on(mesh) * math.sqrt((shells.rest or mesh).largest_face)
            if cells >= MOST_CELLS + 1:
                found.append(f"the largest face would have {cells:.6g} hairs of shells along a side, but holds "
                             f"{MOST_CELLS}: there they are {cells / MOST_CELLS:.3g} times as wide, and its borders "
                             "are bald; more faces in the mesh, or a smaller Shells.frequency or hairs, put it right")
        return found


def _shines_down(light):
    return light.position is not None or light.direction[1] < 0


def view_of(scene: Scene, samples: int, known: Seen | None = None) -> np.void:
    """The scene's camera as a `layout.View`; its near plane stands just before all that can be seen.

    ``known``: what `seen` tells of the scene, where that is known already.
    """
    scene = scene.local
    camera, near = scene.camera, (known or seen(scene)).near
    pose, k = camera.pose, camera.intrinsics
    # Camera axes right, down, forward: forward is the distance that "depth" tells.
    world_to_camera = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(pose)
    to_screen = np.zeros((4, 4))
    to_screen[:2] = k[:2, :3] @ world_to_camera[:3]
    to_screen[2, 3] = near
    to_screen[3] = world_to_camera[2]
    return _view(to_screen, (*pose[:3, 3], 1), camera.size, samples, math.sqrt(k[0, 0] * k[1, 1]))


def ground_of(scene: Scene, view: np.void) -> np.void | None:
    """The scene's ground in a view of `view_of`, as a `layout.Ground`; None without one, or where its eye is not above
    it."""
    scene = scene.local
    if scene.ground is None:
        return None
    height = height_of(scene)
    known = ground_from(scene.camera, height)
    if known is None:
        return None
    down, above = known
    packed: Any = np.zeros((), layout.Ground)
    packed["plane"] = *(float(view["to_screen"][3, 2]) / above * down), height
    if scene.ground.color is not None:
        packed["color"] = *scene.ground.color, 1
    return packed


def light_of(light: Light, environment: Environment | None = None, scatters: bool = False) -> np.void:
    """A `clfur.Light` as a `layout.Light`, under a sky if there is one; see `ambient_of`."""
    packed: Any = np.zeros((), layout.Light)
    packed["direction"][:3] = light.direction
    packed["color"] = *light.strength, ambient_of(light, environment, scatters)
    if light.position is not None:
        packed["position"] = *light.position, 1
        packed["cone"][0] = NO_CONE if light.everywhere else math.cos(math.radians(light.angle) / 2)
    packed["cone"][1] = math.tan(math.radians(light.size) / 2) if light.position is None else light.size
    return packed


def light_view_of(scene: Scene, size: int, light: Light | None = None, fit: Fit | None = None) -> np.void:
    """What a light sees, as a `layout.View` of size² pixels with one sample each: parallel rays, or a spot's.

    ``light``: a `clfur.Light`, the scene's first if None.  ``fit``: where that of the scene is known; below too.
    """
    light = light or scene.local.lights[0]
    to_light, radius, distance, half, least = (fit or Fit.of(scene)).frame(light, size)
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
    view = _view(to_screen, eye, (size, size), 1, scale)
    view["scale"][2] = least
    return view


def deep_of(scene: Scene, tiles: int, reach: float, light: Light, fit: Fit) -> tuple[np.void, np.void]:
    """What a light sees of all hair that shades what is seen -> (`layout.View` of ``tiles``² tiles, `layout.Deep`).

    As the view of `light_view_of`, but nothing that counts lies before its near plane.  ``reach``: as of `layout.Deep`.
    """
    size = TILE * tiles
    to_light, radius, distance, _, least = fit.frame(light, size)
    center, whole = fit.whole
    view = light_view_of(scene, size, light, fit)
    to_screen = view["to_screen"].T.astype(float)
    if light.position is None:
        middle = float(to_light[2, :3] @ center + to_light[2, 3])
        near, far = (f(middle + sign * (1.001 * whole), distance + sign * radius) for f, sign in ((min, -1), (max, 1)))
        to_screen[2] = -to_light[2] / (far - near)
        to_screen[2, 3] += far / (far - near)
    else:
        to_screen[2, 3] = least or distance - radius
    made = _view(to_screen, view["eye"], (size, size), 1, float(view["scale"][0]))
    packed: Any = np.zeros((), layout.Deep)
    packed["to_map"], packed["size"][0], packed["reach"][0] = made["to_screen"], tiles, reach
    return made, packed


def grid_of(scene: Scene, cells: int, light: Light | None = None, fit: Fit | None = None) -> np.void:
    """The cells³ that hold all that shades what is seen, seen from a light, as a `layout.Grid`; see `Fit`."""
    light = light or scene.local.lights[0]
    to_light, radius, distance, half, least = (fit or Fit.of(scene)).frame(light, cells)
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
    nearest = 1 if light.position is None else distance - radius
    packed["size"] = cells, cells, cells, least > 0
    packed["face"] = side * side, side, nearest, least or nearest
    return packed


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


def columns_of(view: np.void, first: int, end: int) -> np.void:
    """The `layout.View` that draws only these columns of a view of all, as the very same bits; ``first``: a multiple of
    TILE."""
    some = view.copy()
    some["size"][0], some["rows"][2:] = end - first, (first, int(view["size"][0]) - end)
    return some


def one_sample(view: np.void) -> np.void:
    """A `layout.View` of the same pixels, each seen by one sample in its middle."""
    single = view.copy()
    single["size"][2:] = 1, layout.pattern_start(1)
    return single
