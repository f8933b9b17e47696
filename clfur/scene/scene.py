"""All that a picture shows, and a camera that sees all of it."""

import functools
import math
from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from . import checks
from .bounds import extent, local, origin_of, points_to_frame, strands_and_shells
from .camera import FOV, Camera, around, size_of
from .curves import Curves
from .display import brief, repr_png
from .environment import Environment
from .ground import Ground, height_on, shadow_places
from .light import Light
from .maps import planes
from .material import body_color, laid_in_tiles
from .mesh import Mesh
from .origin import copied, seen_from
from .remembered import remembered
from .rest import posed
from .shells import Shells
from .strands import Strands

OUTSIDE = 1.05   # radii of the scene from its middle must a point light stand that casts shadows
MOST_PERIODS = 1 << 16, 1 << 12   # of the sines of shell fur: from uv 0, where float32 is exact enough, and on a face


def _fur(value, where):
    """Return what `Scene.fur` takes; a list becomes a tuple, which `extent` can remember."""
    fur = tuple(value) if isinstance(value, (tuple, list)) else value
    parts = fur if isinstance(fur, tuple) else () if fur is None else (fur,)
    strands, shells = ([part for part in parts if isinstance(part, kind)] for kind in ((Strands, Curves), Shells))
    if len(strands) > 1 or len(shells) > 1 or len(strands) + len(shells) < len(parts):
        checks.refuse(where, value, "None, Strands, Curves, Shells, or a list of one Shells and one Strands or Curves")
    return fur


def _lights(value, where):
    """Return what `Scene.light` takes; a list becomes a tuple."""
    lights = value if isinstance(value, (tuple, list)) else (value,)
    if not lights or not all(isinstance(light, Light) for light in lights):
        checks.refuse(where, value, "an object of class Light, or a list of them")
    return tuple(lights) if isinstance(value, list) else value


@remembered(2)   # what is drawn again must be the very same
def gusty(shells, time):
    """Return Shells at another time."""
    return copied(shells, time=time)


DIRECTION = 0.45, 0.3, 1.0   # from what is drawn to a camera that nobody has placed


def frame(mesh: Mesh | None, fur: Any, size: Sequence[int] = (640, 480), fov: float = 45,
          direction: Sequence[float] = DIRECTION, ground: Ground | None = None,
          lights: Sequence[Light] = (), sides: int = 1) -> Camera:
    """Return a Camera that sees all of a mesh and its fur, and most of its shadow on a ground.

    mesh: Mesh, or None with Curves. fur: what `Scene` takes. size: (width, height) in pixels. fov: vertical, degrees.
    direction: [3] from the centre of what is drawn to the camera, which comes as near as it can. ground: a Ground, on
    which shadows of lights count that are no further than three radii from the centre, and not those of lights less
    than half as strong as the strongest. sides: from how many sides, as the camera goes around the vertical through the
    centre, all is in the picture. Raises Error as Scene does for its fur, and as Camera does.
    """
    fur = _fur(fur, "frame fur")
    mesh = checks.instance(Mesh, none=True)(mesh, "frame mesh")
    size = size_of(size, "frame size")
    fov = FOV(fov, "frame fov")
    towards = checks.direction(direction, "frame direction")
    center, radius = extent(mesh, fur)
    up = (0, 1, 0) if abs(towards[1]) < 0.999 else (0, 0, -1)
    axes = Camera(eye=center + towards, target=center, up=up, fov=fov, size=size).pose[:3, :3]
    tall = math.tan(math.radians(fov) / 2)
    slopes = np.array([tall * size[0] / size[1], tall])
    # The four planes of the view, each pushed out to its furthest point: where they meet is the nearest eye.
    there, *drawn = local(mesh, fur)
    seen, extends = points_to_frame(*drawn)
    points = np.concatenate([np.asarray(each, float) for each in seen] or [np.zeros((1, 3))])
    if ground is not None:
        points = np.concatenate([points, shadow_places(
            points, extends, height_on(seen_from(ground, there), *drawn), center - there, radius,
            seen_from(tuple(lights), there))])
    offsets = np.concatenate([(points - (center - there)) @ around(360 * side / sides) for side in range(sides)]) @ axes
    margin = extends * np.sqrt(1 + slopes**2)
    one = (offsets[:, :2] + slopes * offsets[:, 2:]).max(0) + margin
    other = (-offsets[:, :2] + slopes * offsets[:, 2:]).max(0) + margin
    distance = 1.05 * float(((one + other) / (2 * slopes)).max()) or 1.0
    target = center + axes[:, :2] @ ((one - other) / 2)
    return Camera(eye=target + distance * towards, target=target, up=up, fov=fov, size=size)


@attrs.frozen(eq=False)
class Scene:
    """All that a picture shows; in notebooks it shows itself, small.

    mesh: Mesh or None. fur: Strands or Shells (which need a mesh), Curves, a list of Shells (undercoat) and one of
    Strands and Curves (guard hairs), or None; a mesh or fur is required. camera: Camera, or None to frame all of it.
    light: a Light, or a list of them, which add up. body_color: linear RGB >= 0 of the mesh itself (arrays of uint8 or
    uint16 are sRGB), a picture of them [h, w, 3] that is laid on by uv, a Material or a list of those that
    `Mesh.material_of` tells the faces of, {1001: picture or Material, ...} of UDIM tiles, which repeat at their
    borders (where there is none, the body has the first one's colour), or None to leave it undrawn. environment: an
    Environment, whose light falls on fur, body and ground beside the lights', or None. With one, lights that tell no
    ambient have none. body: "drawn", or "holdout": it hides and shades what is behind it, but is not seen itself, so
    that its pixels are free for a picture of it. ground: a Ground, or None. Raises Error where the parts don't fit: a
    type_map, color_texture or pattern "sine" on a mesh without uv, levels for another number of faces, an edge whose
    two faces give it different levels, or a rest mesh of other faces.

    Faces that have no area or normal in this pose, but have in rest, become part of `mesh`: what grows there stands as
    the normals of their corners, or of faces beside them, point.

    A list is stored as a tuple. `lights` are all lights, always in a tuple; `strands` are the Strands or Curves of
    `fur`, `shells` its Shells, or None.
    """

    mesh: Mesh | None = checks.field(checks.instance(Mesh, none=True), default=None)
    fur: checks.Given = checks.field(_fur, default=None)
    camera: checks.Given = checks.field(checks.instance(Camera, none=True), default=None)
    light: checks.Given = checks.field(_lights, default=Light())
    body_color: checks.Given = checks.field(checks.optional(body_color), default=(0.30, 0.20, 0.12))
    environment: Environment | None = checks.field(checks.instance(Environment, none=True), default=None)
    body: str = checks.field(checks.choice("drawn", "holdout"), default="drawn")
    ground: Ground | None = checks.field(checks.instance(Ground, none=True), default=None)
    strands: Strands | Curves = attrs.field(init=False, repr=False)
    shells: Shells = attrs.field(init=False, repr=False)
    __repr__ = brief
    _repr_png_ = repr_png

    @property
    def lights(self) -> tuple[Light, ...]:
        """All lights, in a tuple."""
        return self.light if isinstance(self.light, tuple) else (self.light,)

    @property
    def origin(self) -> np.ndarray:
        """The place float64 [3] that it is drawn relative to: the mesh's origin, or that of Curves."""
        return origin_of(self.mesh, self.fur)

    @functools.cached_property
    def local(self) -> "Scene":
        """The same Scene with everything relative to its `origin`, as it is drawn; itself where nothing is far away."""
        there, mesh, fur = local(self.mesh, self.fur)
        if mesh is self.mesh and fur is self.fur:
            return self
        return self._moved(there, mesh, fur)

    def seen_from(self, there: np.ndarray) -> "Scene":
        """The same Scene relative to another's `origin`, float64 [3]."""
        return self._moved(there, seen_from(self.mesh, there), seen_from(self.fur, there))

    def _moved(self, there, mesh, fur):
        strands, shells = strands_and_shells(fur)
        if shells is not None and np.any(shells.wind):   # gusts travel through the world
            turns = (shells.wind / np.linalg.norm(shells.wind)) @ there / (shells.rest or mesh).own_frame[2]
            shells = gusty(shells, float(shells.time - turns))
            fur = shells if strands is None else (strands, shells)
        return copied(self, mesh=mesh, fur=fur, strands=strands, shells=shells, light=seen_from(self.light, there),
                      camera=seen_from(self.camera, there), ground=seen_from(self.ground, there))

    def __attrs_post_init__(self):
        strands, shells = strands_and_shells(self.fur)
        object.__setattr__(self, "strands", strands)
        object.__setattr__(self, "shells", shells)
        if self.mesh is None and strands is None and shells is None:
            raise Error("Scene.mesh and Scene.fur are None; allowed: at least one of them")
        if self.body == "holdout" and (self.mesh is None or self.body_color is None):
            raise Error("Scene.body is 'holdout' but no body is drawn; allowed: with a mesh and any body_color")
        for fur in (strands, shells):
            if isinstance(fur, (Strands, Shells)) and self.mesh is None:
                raise Error(f"Scene.mesh is None but Scene.fur has {type(fur).__name__}; "
                            "allowed: a Mesh for them to grow on")
        if isinstance(strands, Strands):
            object.__setattr__(self, "mesh", posed(self.mesh, strands.rest, "Strands.rest"))
            _check_uv(self.mesh, strands)
            planes(self.mesh, strands.maps, strands.comb)   # raises where they don't fit
        if strands is not None and self.mesh is not None:
            _check_levels(self.mesh, strands)
        if isinstance(self.body_color, tuple) and self.mesh is not None:
            _check_materials(self.mesh, self.body_color)
        if shells is not None:
            object.__setattr__(self, "mesh", posed(self.mesh, shells.rest, "Shells.rest"))
            if shells.pattern == "sine":
                _check_sines(self.mesh, shells)
            if shells.lean is not None and len(shells.lean) != len(self.mesh.positions):
                raise Error(f"Shells.lean has {len(shells.lean)} rows and Scene.mesh {len(self.mesh.positions)} "
                            "vertices; allowed: as many")
        if isinstance(self.body_color, dict):
            self._lay_tiles()
        _, radius = extent(self.mesh, self.fur)
        if radius and not 1e-6 <= radius <= checks.LARGEST:
            raise Error(f"Scene is {2 * radius:.3g} across; allowed: 2e-06 to 2e+09, where float32 is exact enough")
        center, _ = extent(self.mesh, self.fur)
        for place in (light.position for light in self.lights if light.position is not None):
            if np.linalg.norm(place - center) > 1e3 * (radius or 1):
                raise Error(f"Light.position is {checks.shown(place)}; allowed: at most 1000 radii of the scene away, "
                            f"or no position: light that is all but parallel")
        for light in self.lights:
            if light.everywhere and light.casts and np.linalg.norm(light.position - center) < OUTSIDE * radius:
                raise Error(f"Light.position is {checks.shown(light.position)}, inside of all that is drawn, with "
                            f"Light.angle 360; allowed: at least {OUTSIDE:g} radii from its middle, which is "
                            f"{checks.shown(np.round(center, 3).tolist())}, a spot, or shadows=False")
        if self.camera is None:
            object.__setattr__(self, "camera", frame(self.mesh, self.fur, ground=self.ground,
                                                         lights=self.lights))


    def _lay_tiles(self):
        """Let faces have the materials of the UDIM tiles in which they lie."""
        if self.mesh is None or not self.mesh.has_uv:
            raise Error("Scene.body_color has UDIM tiles, which are laid on by uv, but Scene.mesh has none; allowed: a "
                        "mesh with uv")
        mesh, materials = laid_in_tiles(self.mesh, tuple(self.body_color.items()))
        object.__setattr__(self, "mesh", mesh)
        object.__setattr__(self, "body_color", materials)


def _check_uv(mesh, strands):
    if mesh.has_uv:
        return
    if strands.type_map is not None:
        raise Error("Strands.type_map is looked up by uv but Scene.mesh has none; allowed: a mesh with uv")
    if any(hair.color_texture is not None for hair in strands.types):
        raise Error("HairType.color_texture is looked up by uv but Scene.mesh has none; "
                    "allowed: a mesh with uv")


def _check_materials(mesh, materials):
    if not mesh.has_uv and any(material.texture is not None for material in materials):
        raise Error("Scene.body_color has a texture, which is laid on by uv, but Scene.mesh has none; "
                    "allowed: a mesh with uv")
    if len(materials) == 1:
        return
    if mesh.material_of is None or mesh.material_of.max() >= len(materials):
        has = "no material_of" if mesh.material_of is None else f"material_of up to {mesh.material_of.max()}"
        raise Error(f"Scene.body_color has {len(materials)} materials but Scene.mesh has {has}; allowed: one material, "
                    "or a mesh that tells which of them each face has")


def _check_sines(mesh, shells):
    if not mesh.has_uv:
        raise Error("Shells.pattern is 'sine', which is made from uv, but Scene.mesh has none; "
                    "allowed: 'cells', or a mesh with uv")
    periods = np.abs(mesh.uv * (2.0, 1.0)).max(), np.ptp(mesh.uv * (2.0, 1.0), axis=1).max()
    most = min(limit / each for limit, each in zip(MOST_PERIODS, periods) if each) if any(periods) else np.inf
    if shells.frequency > most:
        raise Error(f"Shells.frequency is {shells.frequency:g}, of sines over uv up to {np.abs(mesh.uv).max():g}; "
                    f"allowed with these uv: at most {most:.6g}")


def _check_levels(mesh, strands):
    kind = type(strands).__name__
    for name in ("inner", "outer"):
        levels = getattr(strands, name)
        if isinstance(levels, np.ndarray) and len(levels) != len(mesh.faces):
            raise Error(f"{kind}.{name} has levels for {len(levels)} faces; "
                        f"allowed: {len(mesh.faces)}, the faces that the mesh has kept")
    if not isinstance(strands.outer, np.ndarray):
        return
    edges = np.sort(mesh.faces[:, [[1, 2], [2, 0], [0, 1]]].astype(np.int64), axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    levels = strands.outer.reshape(-1)[order]
    differ = (edges[order][1:] == edges[order][:-1]).all(axis=1) & (levels[1:] != levels[:-1])
    if differ.any():
        at = int(np.argmax(differ))
        one, other = order[at], order[at + 1]
        raise Error(f"{kind}.outer is {levels[at]} at face {one // 3}, edge {one % 3}, but {levels[at + 1]} "
                    f"at face {other // 3}, edge {other % 3}, which is the same edge; allowed: equal levels")


def on_host(scene: Scene) -> Scene:
    """The same Scene with no array on a device."""
    here = tuple(each.on_host if isinstance(each, (Curves, Shells)) else each
                 for each in (scene.shells, scene.strands) if each is not None)
    if all(each is scene.shells or each is scene.strands for each in here):
        return scene
    return attrs.evolve(scene, fur=here if len(here) > 1 else here[0])
