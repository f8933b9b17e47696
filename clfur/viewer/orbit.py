"""The camera of who looks at a scene: it orbits, pans and zooms."""

import math
from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ..scene import Camera, Scene, checks, extent

STEEPEST = 89.9   # degrees above or below the level: `Camera` cannot look along its up
TURN = 360.0      # degrees by which a drag as long as the picture is high turns
ZOOM = 1.1        # times that a step of the wheel goes nearer
NEAREST, FURTHEST = 1e-3, 1e3   # distances to the target, in radii of the scene
FLAT = 0.999      # cosine between a view and +Y, from which on it is taken for one from above or below


@attrs.frozen
class Orbit:
    """A camera that looks at `target` from an azimuth and an elevation around the axis `up`.

    target, up: (x, y, z) of the world, up of length 1. azimuth: degrees around up, from +Z to +X where up is +Y.
    elevation: degrees above the plane across up, -89.9 to 89.9. distance: from the eye to the target, world units.
    fov: vertical, degrees. size: (width, height) in pixels. radius: of the scene, by which nearest and furthest go.

    It changes nothing: what moves gives another one. Drags and pans are in heights of the picture, so that they mean
    the same at any size; x to the right, y down, as a mouse goes.
    """

    target: tuple[float, ...] = attrs.field(default=(0.0, 0.0, 0.0), converter=tuple)
    azimuth: float = 0.0
    elevation: float = 0.0
    distance: float = 1.0
    fov: float = 45.0
    size: tuple[int, ...] = attrs.field(default=(640, 480), converter=tuple)
    up: tuple[float, ...] = attrs.field(default=(0.0, 1.0, 0.0), converter=tuple)
    radius: float = 1.0

    @classmethod
    def of(cls, scene: Scene, size: Sequence[int] | None = None) -> "Orbit":
        """Return the orbit that begins at a scene's own camera, with its vertical field of view; size: another one. In
        a narrower picture it stands further away, so that as much is seen to the sides.

        A camera that was calibrated looks at the point of its view that is as far away as the scene's centre; where its
        principal point is not in the middle, or pixels are not square, the orbit's are. One that looks straight down or
        up does so from 89.9 degrees, around +Y.
        """
        camera = scene.camera
        right, above, back, eye = camera.pose[:3, :].T
        center, radius = extent(scene.mesh, scene.fur)
        radius = float(radius) or 1.0
        if camera.target is None:
            away = center - eye
            distance = max(float(-away @ back), 0.0) or float(np.linalg.norm(away)) or radius
            fov = math.degrees(2 * math.atan(camera.size[1] / 2 / camera.intrinsics[1, 1]))
        else:
            distance, fov = float(np.linalg.norm(camera.target - eye)), camera.fov
        target = eye - distance * back
        up = _axis(right, above, back, camera.up)
        side, ahead = _level(up)
        width, height = camera.size if size is None else _size(size)
        distance *= max(camera.size[0] / camera.size[1] * height / width, 1.0)
        return cls(
            target=_floats(target), azimuth=math.degrees(math.atan2(-right @ ahead, right @ side)),
            elevation=_within(math.degrees(math.asin(_within(float(back @ up), 1.0))), STEEPEST),
            distance=distance, fov=min(max(fov, 1e-3), 179.99), up=_floats(up), radius=radius,
            size=(width, height))

    def camera(self) -> Camera:
        """The `Camera` that sees it so."""
        _, _, back = self._axes()
        target = np.array(self.target)
        return Camera(eye=target + self.distance * back, target=target, up=self.up, fov=self.fov, size=self.size)

    def turned(self, x: float, y: float) -> "Orbit":
        """Around the target, as by a drag of x and y heights of the picture: what is in front follows it."""
        return attrs.evolve(self, azimuth=math.remainder(self.azimuth - TURN * x, 360.0),
                            elevation=_within(self.elevation + TURN * y, STEEPEST))

    def panned(self, x: float, y: float) -> "Orbit":
        """Along the picture's plane: the target follows a drag of x and y heights of the picture."""
        right, above, _ = self._axes()
        high = 2 * self.distance * math.tan(math.radians(self.fov) / 2)   # of what is seen at the target
        return attrs.evolve(self, target=_floats(np.array(self.target) + high * (y * above - x * right)))

    def zoomed(self, steps: float) -> "Orbit":
        """Nearer to the target by so many steps of the wheel, further where they are below 0."""
        factor = ZOOM ** -_within(steps, 100.0)
        return attrs.evolve(self, distance=min(max(self.distance * factor, NEAREST * self.radius),
                                               FURTHEST * self.radius))

    def resized(self, size: Sequence[int]) -> "Orbit":
        """With pictures of another (width, height), and the same vertical field of view."""
        return attrs.evolve(self, size=_size(size))

    def told(self) -> dict[str, Any]:
        """{field: value} as JSON has it; `Orbit(**told)` is the same."""
        return attrs.asdict(self)

    def _axes(self):
        """Unit vectors of the camera in the world: right, up, and from the target to the eye."""
        side, ahead = _level(np.array(self.up))
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        out = math.cos(azimuth) * ahead + math.sin(azimuth) * side
        back = math.cos(elevation) * out + math.sin(elevation) * np.array(self.up)
        right = math.cos(azimuth) * side - math.sin(azimuth) * ahead
        return right, np.cross(back, right), back


def _axis(right, above, back, up):
    """The axis, a unit vector across the picture's horizontal, around which a camera with these axes orbits.

    up: its own, which is such, or None: the one nearest to +Y, so that a camera that is tilted stays so.
    """
    vertical = np.array([0.0, 1.0, 0.0])
    if up is None or abs(back @ vertical) > FLAT:
        up = vertical
    up = up - (up @ right) * right
    length = float(np.linalg.norm(up))
    return up / length if length > 1e-3 else above


def _level(up):
    """Unit vectors across the axis ``up``: where azimuths of 90 and of 0 degrees are; of +Y they are +X and +Z."""
    ahead = np.cross(np.eye(3)[(np.argmax(np.abs(up)) + 2) % 3], up)
    ahead /= np.linalg.norm(ahead)
    return np.cross(up, ahead), ahead


def _within(value, limit):
    return min(max(value, -limit), limit)


def _floats(vector):
    return tuple(float(each) for each in vector)


def _size(value):
    """(width, height), whole numbers within what `Camera` takes."""
    width, height = value
    return checks.whole(1, 16384)(width, "Orbit.size"), checks.whole(1, 16384)(height, "Orbit.size")
