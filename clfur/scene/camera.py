"""Cameras: a pinhole at a place, or one that was calibrated."""

import math
from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from . import checks

FOV = checks.real(low=1e-3, high=179.99)   # degrees: with any size, focal lengths are FOCAL to checks.LARGEST
FOCAL = 1e-5       # pixels that a focal length must have at least
FURTHEST = 1e6     # pixels from the picture to where the axis of the view meets its plane, at most


def size_of(value, where):
    allowed = "(width, height), whole numbers from 1 to 16384"
    try:
        width, height = value
    except Exception:   # an object's own methods can raise anything
        checks.refuse(where, value, allowed)
    return checks.whole(1, 16384)(width, where), checks.whole(1, 16384)(height, where)


def _matrix(n):
    """Return a converter to an array float64 [n, n] of finite numbers."""
    allowed = f"an array [{n}, {n}] of finite numbers >= {-checks.LARGEST:g}, <= {checks.LARGEST:g}"

    def convert(value, where):
        array = checks.numbers(value, where, allowed)
        with np.errstate(over="ignore"):   # of long doubles
            array = np.array(array, np.float64)
        if array.shape != (n, n) or not (np.abs(array) <= checks.LARGEST).all():
            checks.refuse(where, value, allowed)
        return array

    return convert


@attrs.frozen(eq=False)
class Camera:
    """A pinhole camera at `eye` that looks at `target`.

    eye, target, up: [3]; up may not be parallel to the view. fov: vertical, degrees, 0.001 to 179.99.
    size: (width, height) in pixels, 1..16384 each. Raises Error for anything else.

    Every camera has `pose`, float64 [4, 4] camera to world (the camera looks along its -Z, +Y is up,
    +X right), `intrinsics`, float64 [3, 3] in pixels (see `calibrated`), and `size`; the renderer uses these
    three alone. One made by `calibrated` has None for eye, target, up and fov.
    """

    eye: checks.Given = checks.field(checks.vector(3), default=(0.0, 0.4, 3.2))
    target: checks.Given = checks.field(checks.vector(3), default=(0.0, 0.0, 0.0))
    up: checks.Given = checks.field(checks.vector(3), default=(0.0, 1.0, 0.0))
    fov: float = checks.field(FOV, default=45.0)
    size: checks.Given = checks.field(size_of, default=(640, 480))
    pose: np.ndarray = attrs.field(init=False, repr=False)
    intrinsics: np.ndarray = attrs.field(init=False, repr=False)

    def __attrs_post_init__(self):
        if (self.eye == self.target).all():
            raise Error(f"Camera.target is {checks.shown(self.target.tolist())}, the same as Camera.eye; "
                        "allowed: another point")
        back = checks.unit(self.eye - self.target, "Camera.eye - Camera.target")
        right = np.cross(checks.unit(self.up, "Camera.up"), back)
        if np.sqrt((right**2).sum()) < 1e-6:
            raise Error(f"Camera.up is {checks.shown(self.up.tolist())}, along the view; "
                        "allowed: a vector that is not parallel to target - eye")
        right = checks.unit(right, "Camera.up")
        pose = np.eye(4)
        pose[:3, :] = np.stack([right, np.cross(back, right), back, self.eye], axis=1)
        width, height = self.size
        focal = height / 2 / math.tan(math.radians(self.fov) / 2)
        intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        object.__setattr__(self, "pose", checks.frozen(pose))
        object.__setattr__(self, "intrinsics", checks.frozen(intrinsics))

    @classmethod
    def calibrated(cls, pose: Any, intrinsics: Any, size: Sequence[int]) -> "Camera":
        """Return the camera of a calibration.

        pose: [4, 4] camera to world, right-handed, a rotation and a translation; the camera looks along its
        -Z and +Y is up (the trimesh and OpenGL convention; OpenCV's looks along +Z with +Y down: negate the
        second and third columns of its pose). intrinsics: [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels; a
        point (x, y, -d) before the camera is seen at column (fx x - s y)/d + cx and row cy - fy y/d. The
        origin is the top-left corner of the top-left pixel, whose centre is at (0.5, 0.5); OpenCV puts it
        in that pixel's centre, so its cx and cy are 0.5 less: add 0.5 to both. fx and fy are 1e-5 to 1e9, s is
        -fx to fx, cx and cy are -1e6 to 1e6: float32 cannot tell pixels beyond. size: (width, height).
        Raises Error where the pose is no rigid motion (tolerance 1e-4) or the matrix has not this form.
        """

        pose = checks.safely(_matrix(4), pose, "Camera.calibrated pose")
        if (pose[3] != (0, 0, 0, 1)).any():
            checks.refuse("Camera.calibrated pose[3]", pose[3].tolist(), "[0, 0, 0, 1]")
        rotation = pose[:3, :3]
        error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
        if error > 1e-4 or np.linalg.det(rotation) < 0:
            raise Error("Camera.calibrated pose[:3, :3] is no rotation: its columns are "
                        f"{error:.3g} from orthonormal, its determinant is {np.linalg.det(rotation):.3g}; "
                        "allowed: an error of 1e-4, determinant 1")
        u, _, v = np.linalg.svd(rotation)
        pose[:3, :3] = u @ v  # the nearest rotation, so that its transpose is its inverse
        k = checks.safely(_matrix(3), intrinsics, "Camera.calibrated intrinsics")
        (fx, s, cx), (zero, fy, cy), last = k
        if zero != 0 or (last != (0, 0, 1)).any() or min(fx, fy) < FOCAL or (
                abs(s) > fx or max(abs(cx), abs(cy)) > FURTHEST):
            checks.refuse("Camera.calibrated intrinsics", k.tolist(),
                          f"[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx > 0 and fy > 0, both from {FOCAL:g} to "
                          f"{checks.LARGEST:g}, s from -fx to fx, cx and cy from {-FURTHEST:g} to {FURTHEST:g}")
        camera = object.__new__(cls)  # eye, target, up and fov stay None: the matrices say more than they can
        fields = {"eye": None, "target": None, "up": None, "fov": None, "size": size_of(size, "Camera.size"),
                  "pose": checks.frozen(pose), "intrinsics": checks.frozen(k)}
        for name, value in fields.items():
            object.__setattr__(camera, name, value)
        return camera
