"""Cameras: a pinhole at a place, or one that was calibrated."""

import math
from collections.abc import Sequence
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from . import checks
from .display import brief

FOV = checks.real(low=1e-3, high=179.99)   # degrees: with any size, focal lengths are FOCAL to checks.LARGEST
FOCAL = 1e-5       # pixels that a focal length must have at least
FLIPPED = 1, -1, -1   # axes: OpenCV's cameras look along +Z with +Y down, clfur's along -Z with +Y up
MIDDLE = 0.5       # of a pixel: there OpenCV's rows and columns begin, at its corner clfur's
MOST = 1_000_000   # cameras at a time
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


def _rotation(matrix, where):
    """Return the rotation [3, 3] nearest to a matrix that is one but for 1e-4, so that its transpose is its inverse."""
    error = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
    if error > 1e-4 or np.linalg.det(matrix) < 0:
        raise Error(f"{where} is no rotation: its columns are {error:.3g} from orthonormal, its determinant is "
                    f"{np.linalg.det(matrix):.3g}; allowed: an error of 1e-4, determinant 1")
    u, _, v = np.linalg.svd(matrix)
    return u @ v


def _checked(k, given, where):
    """Return the intrinsics [3, 3], which a user has ``given`` so; Error where they have not the form of such."""
    (fx, s, cx), (zero, fy, cy), last = k
    if zero != 0 or (last != (0, 0, 1)).any() or min(fx, fy) < FOCAL or (
            abs(s) > fx or max(abs(cx), abs(cy)) > FURTHEST):
        checks.refuse(where, given.tolist(),
                      f"[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx > 0 and fy > 0, both from {FOCAL:g} to "
                      f"{checks.LARGEST:g}, s from -fx to fx, cx and cy from {-FURTHEST:g} to {FURTHEST:g}")
    return k


def around(degrees: float) -> np.ndarray:
    """Return the rotation [3, 3] around the vertical, from +Z to +X."""
    sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])


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
    __repr__ = brief

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
        -Z and +Y is up (the trimesh and OpenGL convention). intrinsics: [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in
        pixels; a point (x, y, -d) before the camera is seen at column (fx x - s y)/d + cx and row cy - fy y/d. The
        origin is the top-left corner of the top-left pixel, whose centre is at (0.5, 0.5); OpenCV puts it in that
        pixel's centre: see `from_opencv`. fx and fy are 1e-5 to 1e9, s is -fx to fx, cx and cy are -1e6 to 1e6: float32
        cannot tell pixels beyond. Where fx is not fy a strand is as wide in pixels as with the mean of both, sqrt(fx
        fy), whichever way it runs. size: (width, height).
        Raises Error where the pose is no rigid motion (tolerance 1e-4) or the matrix has not this form.
        """

        pose = checks.safely(_matrix(4), pose, "Camera.calibrated pose")
        if (pose[3] != (0, 0, 0, 1)).any():
            checks.refuse("Camera.calibrated pose[3]", pose[3].tolist(), "[0, 0, 0, 1]")
        pose[:3, :3] = _rotation(pose[:3, :3], "Camera.calibrated pose[:3, :3]")
        k = checks.safely(_matrix(3), intrinsics, "Camera.calibrated intrinsics")
        return cls._of(pose, _checked(k, k, "Camera.calibrated intrinsics"), size)

    @classmethod
    def _of(cls, pose, k, size):
        camera = object.__new__(cls)  # eye, target, up and fov stay None: the matrices say more than they can
        fields = {"eye": None, "target": None, "up": None, "fov": None, "size": size_of(size, "Camera.size"),
                  "pose": checks.frozen(pose), "intrinsics": checks.frozen(k)}
        for name, value in fields.items():
            object.__setattr__(camera, name, value)
        return camera

    @classmethod
    def from_opencv(cls, K: Any, R: Any, t: Any, size: Sequence[int], dist: Any = None) -> "Camera":
        """Return the camera of OpenCV's calibration: x right, y down, z forward.

        K: [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels, whose origin is the centre of the top-left pixel. R: [3, 3]
        rotation and t: [3] or [3, 1] translation from the world to the camera; of a rotation vector R is
        cv2.Rodrigues(vector)[0]. size: (width, height). dist: distortion coefficients, all of them 0, or None: lines
        stay straight in clfur; undistort pictures first, and give the K of cv2.getOptimalNewCameraMatrix. A point X
        of the world is drawn where K (R X + t) has it: the limits are those of `calibrated`, and so are the errors.
        """
        rotation = _rotation(checks.safely(_matrix(3), R, "Camera.from_opencv R"), "Camera.from_opencv R")
        place = checks.numbers(t, "Camera.from_opencv t", "3 finite numbers")
        place = checks.vector(3)(place[:, 0] if place.shape == (3, 1) else place, "Camera.from_opencv t")
        if dist is not None and checks.numbers(dist, "Camera.from_opencv dist", "numbers, all 0, or None").any():
            checks.refuse("Camera.from_opencv dist", dist,
                          "zeros or None: undistort the pictures first, with cv2.undistort")
        given = checks.safely(_matrix(3), K, "Camera.from_opencv K")
        k = given.copy()
        k[:2, 2] += MIDDLE
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation.T * FLIPPED, -rotation.T @ place
        return cls._of(pose, _checked(k, given, "Camera.from_opencv K"), size)

    def to_opencv(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[int, int]]:
        """Return (K, R, t, size) that `from_opencv` makes the same camera of: float64 [3, 3], [3, 3], [3]."""
        k = self.intrinsics.copy()
        k[:2, 2] -= MIDDLE
        rotation = (self.pose[:3, :3] * FLIPPED).T
        return k, rotation, -rotation @ self.pose[:3, 3], self.size

    @classmethod
    def on_sphere(cls, n: int, center: Sequence[float] = (0, 0, 0), radius: float = 3.2, *, seed: int = 0,
                  elevation: Sequence[float] = (-90, 90), up: Sequence[float] = (0, 1, 0), fov: float = 45,
                  size: Sequence[int] = (640, 480)) -> list["Camera"]:
        """Return n cameras at random places of a sphere of ``radius`` around ``center``, at which they look.

        They are spread evenly over the area between two angles of ``elevation`` above the plane across ``up``, degrees;
        ``up`` points upwards in each picture. seed: of the random numbers, 0 or more; more cameras of one seed begin
        with the same ones. fov, size: as of `Camera`. Raises Error for what is not such.
        """
        where = "Camera.on_sphere "
        n = checks.whole(0, MOST)(n, where + "n")
        middle, above = checks.vector(3)(center, where + "center"), checks.direction(up, where + "up")
        radius = checks.positive()(radius, where + "radius")
        low, high = (checks.real(low=-90, high=90)(angle, where + "elevation")
                     for angle in checks.vector(2)(elevation, where + "elevation"))
        if low > high:
            checks.refuse(where + "elevation", elevation, "the lower angle first")
        random = np.random.default_rng(checks.whole(0, 2**63 - 1)(seed, where + "seed")).random((n, 2))
        ahead = np.cross(np.eye(3)[(np.argmax(np.abs(above)) + 2) % 3], above)   # of +Y: from +Z towards +X
        ahead /= np.linalg.norm(ahead)
        around = 2 * np.pi * random[:, :1]
        level = np.cos(around) * np.cross(ahead, above) + np.sin(around) * ahead
        sine = np.sin(np.radians(low)) + random[:, 1:] * (np.sin(np.radians(high)) - np.sin(np.radians(low)))
        cosine = np.sqrt(np.maximum(1 - sine * sine, 0))
        # Up turned by the elevation: never along the view, not even at the poles.
        return [cls(eye=middle + radius * away, target=middle, up=upwards, fov=fov, size=size)
                for away, upwards in zip(cosine * level + sine * above, cosine * above - sine * level)]
