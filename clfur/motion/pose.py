"""Poses of a mesh: a rigid motion of the mesh at rest, and what is left of it."""

from dataclasses import dataclass

import numpy as np

SAME = 1e-6   # of the furthest vertex: so far from where a rigid motion takes it float32 may put it


@dataclass(frozen=True, eq=False)
class Pose:
    """A pose of the mesh: the rigid motion that is nearest to it, and its faces without that.

    rotation [3, 3] and offset [3], float64: a place x at rest is rotation @ x + offset. corners, normals there, float32
    [faces, 3, 3]: those at rest where the motion is rigid.
    """

    rotation: np.ndarray
    offset: np.ndarray
    corners: np.ndarray
    normals: np.ndarray

    def rows(self) -> np.ndarray:
        """The motion as rows [4, 4]."""
        rows = np.eye(4)
        rows[:3, :3], rows[:3, 3] = self.rotation, self.offset
        return rows


def pose_of(corners: np.ndarray, normals: np.ndarray, rest: Pose | None) -> Pose:
    """Return the `Pose` of faces with these corners and normals there, [faces, 3, 3] float32. rest: the `Pose` at rest;
    None: it is that."""
    if rest is None:
        return Pose(np.eye(3), np.zeros(3), corners, normals)
    if np.array_equal(corners, rest.corners) and np.array_equal(normals, rest.normals):
        return rest
    was, now = rest.corners.reshape(-1, 3).astype(np.float64), corners.reshape(-1, 3).astype(np.float64)
    if not len(was):
        return Pose(np.eye(3), np.zeros(3), corners, normals)
    a, b = was.mean(0), now.mean(0)
    rotation = _nearest_rotation((was - a).T @ (now - b))
    offset = b - rotation @ a
    if np.abs(was @ rotation.T + offset - now).max() <= SAME * np.abs(np.concatenate([was, now])).max():
        return Pose(rotation, offset, rest.corners, rest.normals)
    back = ((now - offset) @ rotation).reshape(corners.shape).astype(np.float32)
    return Pose(rotation, offset, back, (normals.astype(np.float64) @ rotation).astype(np.float32))


def _nearest_rotation(sums: np.ndarray) -> np.ndarray:
    """The rotation R for which the trace of R @ sums is the largest (Horn, "Closed-form solution of absolute
    orientation using unit quaternions", 1987)."""
    return _rotation(_quaternion(sums))


def _quaternion(s):
    across = np.array([s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]])
    n = np.zeros((4, 4))
    n[0, 0], n[0, 1:], n[1:, 0] = np.trace(s), across, across
    n[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    return np.linalg.eigh(n)[1][:, -1]


def _rotation(q: np.ndarray) -> np.ndarray:
    """The rotation [3, 3] of a unit quaternion w, x, y, z."""
    w, x, y, z = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def between(before: Pose, now: Pose, share: float) -> np.ndarray:
    """The rigid motion, as rows [4, 4], such a share of the way from one pose to another: along a screw, so that what
    turns about an axis stays on its circle."""
    if share in (0, 1):
        return (now if share else before).rows()
    way = now.rows() @ np.linalg.inv(before.rows())
    rotation, offset = way[:3, :3], way[:3, 3]
    axis, angle = _axis_of(rotation)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])

    def path(by):
        """What an even screw makes of its offset, up to there: the integral of its rotations."""
        a = by * angle
        turns = (1 - np.cos(a), a - np.sin(a)) if angle > 1e-6 else (a * a / 2, 0.0)
        return by * np.eye(3) + (turns[0] * cross + turns[1] * cross @ cross) / max(angle, 1e-12)
    part = np.eye(4)
    a = share * angle
    part[:3, :3] = np.eye(3) + np.sin(a) * cross + (1 - np.cos(a)) * cross @ cross
    part[:3, 3] = path(share) @ np.linalg.solve(path(1.0), offset)
    return part @ before.rows()


def part_of(before: Pose, now: Pose, share: float) -> Pose:
    """The `Pose` such a share of the way from one to another: corners go straight, but for the rigid motion."""
    rows = between(before, now, share)
    corners, normals = (was + np.float32(share) * (there - was) for was, there in (
        (before.corners, now.corners), (before.normals, now.normals)))
    return Pose(rows[:3, :3], rows[:3, 3], corners, normals)


def box_within(before: Pose, now: Pose, share: float) -> np.ndarray:
    """The box around all corners such a share of the way: its lowest and highest corner [2, 3], float64."""
    rows = between(before, now, share)
    corners = before.corners if now.corners is before.corners else part_of(before, now, share).corners
    places = corners.reshape(-1, 3) @ rows[:3, :3].T + rows[:3, 3]
    return np.stack([places.min(0), places.max(0)])


def _axis_of(rotation: np.ndarray) -> tuple[np.ndarray, float]:
    """The unit axis of a rotation, and its angle, 0 to pi."""
    q = _quaternion(rotation.T)
    q = q if q[0] >= 0 else -q
    sine = float(np.linalg.norm(q[1:]))
    axis = q[1:] / sine if sine > 1e-12 else np.array([0.0, 1.0, 0.0])
    return axis, 2 * float(np.arctan2(sine, q[0]))
