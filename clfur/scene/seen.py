"""What of a scene its camera can see: how near that is, and how far it extends."""

import functools
import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from .bounds import boxes_to_see, extent, fur_extent, points_to_see
from .checks import is_on_device
from .curves import Curves
from .mesh import box, sphere
from .remembered import remembered

WIDE = 1.5          # times as wide and high as the picture is what counts as seen: a camera that turns a little sees
                    # the same
EDGE = 1.02         # the same for what may not be cut off: wider than any sample or strand at the picture's edge
IN_FUR = 0.05       # of the fur's length: nearer than this nothing need be seen,
AMONG = 1e-3        # or than this share of how far what is seen reaches,
LEAST = 1e-5        # but no less than this one, nor than its square of the scene's radius
PIECE = 2048        # points that are multiplied at a time


def times(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """``points`` [..., 3] @ ``matrix`` [3] or [3, k], in pieces so small that BLAS starts no threads for each: to wait
    for these takes five times as long as all the sums."""
    rows, columns = points.reshape(-1, 3), matrix if matrix.ndim == 2 else matrix[:, None]
    whole = len(rows) // PIECE * PIECE
    result = np.empty((len(rows), columns.shape[1]), np.result_type(rows, matrix))
    np.matmul(rows[:whole].reshape(-1, PIECE, 3), columns, out=result[:whole].reshape(-1, PIECE, columns.shape[1]))
    np.matmul(rows[whole:], columns, out=result[whole:])
    return result.reshape(points.shape[:-1] + matrix.shape[1:])


class Frustum:
    """What a camera sees of the world, ``wide`` times as wide and high as its picture, and ``margin`` [world] around.

    planes: [5, 3] their normals, inwards: left, right, top, bottom, behind.  offsets: [5].
    """

    def __init__(self, camera: Any, wide: float, margin: float) -> None:
        k, size = camera.intrinsics, np.array(camera.size, float)
        axes = (camera.pose[:3, :3] * (1, -1, -1)).T   # right, down, forward
        low, high = size / 2 * (1 - wide), size / 2 * (1 + wide)
        planes = np.array([k[0] - low[0] * k[2], high[0] * k[2] - k[0], k[1] - low[1] * k[2], high[1] * k[2] - k[1],
                           (0, 0, 1)])
        planes /= np.linalg.norm(planes, axis=1, keepdims=True)
        middle = np.linalg.solve(k, (*size / 2, 1))
        middle /= np.linalg.norm(middle)
        # Moved back so far that all within the margin lies in it.
        self.apex = camera.pose[:3, 3] - margin / (planes @ middle).min() * middle @ axes
        self.planes = planes @ axes
        self.offsets = -self.planes @ self.apex
        corners = np.array([(x, y, 1) for x in (low[0], high[0]) for y in (low[1], high[1])]) @ np.linalg.inv(k).T
        self.corners = corners @ axes                  # [4, 3] along its four edges, 1 forward each
        self.cosine = float(1 / np.linalg.norm(corners, axis=1).max())   # of the angle at the furthest corner

    def within(self, points: np.ndarray) -> np.ndarray:
        """How far points [..., 3] lie inside each plane: [..., 5]."""
        return times(points, self.planes.T) + self.offsets

    def of_spheres(self, center: np.ndarray, radius: Any) -> tuple[np.ndarray, np.ndarray]:
        """Which spheres [n] lie inside, and which touch it: bool [n] each."""
        least = functools.reduce(np.minimum, [
            times(center, plane) + offset for plane, offset in zip(self.planes, self.offsets)])
        return least >= radius, least > -radius

    def of_boxes(self, boxes: "Boxes") -> tuple[np.ndarray, np.ndarray]:
        """Which `Boxes` lie inside, and which touch it: bool [n] each."""
        inside, touched = self.of_spheres(boxes.center, boxes.reach)
        some = np.flatnonzero(touched & ~inside)
        within, reach = self.within(boxes.center[some]), times(boxes.half[some], np.abs(self.planes).T)
        inside[some], touched[some] = (within >= reach).all(1), (within > -reach).all(1)
        return inside, touched


@dataclass(frozen=True)
class Faces:
    """Flat faces of a mesh [F], as spheres: corners [F, 3, 3], center [F, 3], radius [F], and bulge [F], how far a
    curved one stands out of its corners' triangle."""

    corners: np.ndarray
    center: np.ndarray
    radius: np.ndarray
    bulge: np.ndarray


@remembered(2)   # a film asks for the same again in every frame
def faces_of(mesh: Any, curved: bool) -> Faces:
    """`Faces` of a mesh, flat or of curved PN triangles."""
    corners = mesh.positions.astype(np.float64)[mesh.faces]
    center = corners.mean(1)
    bulge = np.zeros(len(corners))
    if curved:   # control points of a side stand out by a third of |d · n|, the one in the middle by half as much more
        normals = mesh.normals.astype(np.float64)[mesh.faces]
        for shift in (1, 2):
            d = np.roll(corners, -shift, axis=1) - corners
            bulge = np.maximum(bulge, np.abs((d * normals).sum(2)).max(1) / 2)
    return Faces(corners, center, np.sqrt(((corners - center[:, None])**2).sum(2).max(1)) + bulge, bulge)


@dataclass(frozen=True)
class Boxes:
    """Curves that have points [n]: their boxes, and half of their largest width."""

    center: np.ndarray   # [n, 3]
    half: np.ndarray     # [n, 3]
    first: np.ndarray    # [n] of each one's points
    counts: np.ndarray   # [n]
    width: np.ndarray    # [n]
    reach: np.ndarray    # [n] of spheres around them, half a width included


@remembered(2)
def boxes_of(curves: Curves) -> Boxes:
    """`Boxes` of Curves on the host."""
    counts = curves.counts.astype(np.int64)
    first, some = np.cumsum(counts) - counts, counts > 0
    first, counts = first[some], counts[some]
    if curves.uniform:
        points = curves.points.reshape(len(counts), -1, 3)
        low, high = points[:, 0].copy(), points[:, 0].copy()
        for k in range(1, points.shape[1]):
            np.minimum(low, points[:, k], out=low)
            np.maximum(high, points[:, k], out=high)
    else:
        low, high = (ufunc.reduceat(curves.points, first) for ufunc in (np.minimum, np.maximum))
    width = curves.width
    if len(width) == len(curves.points) != 1:
        width = np.maximum.reduceat(width, first)
    elif len(width) > 1:
        width = width[some]
    low, high = low.astype(np.float64), high.astype(np.float64)
    half, width = (high - low) / 2, np.broadcast_to(width / 2, len(first))
    return Boxes((low + high) / 2, half, first, counts, width, np.sqrt((half * half).sum(1)) + width)


def points_of(boxes: Boxes, chosen: np.ndarray) -> np.ndarray:
    """Numbers of the points of some of them, bool [n] or their numbers: int [points]."""
    first, counts = boxes.first[chosen], boxes.counts[chosen]
    return np.arange(counts.sum()) + np.repeat(first - np.cumsum(counts) + counts, counts)


@dataclass(frozen=True)
class Seen:
    """What a camera sees of a scene.

    frustum: `Frustum` of it, WIDE.  ball: (center [3], radius) around all there is, but for Curves that lie outside of
    the frustum.  near: nothing before this distance along the view is seen.  faces:
    (`Faces`, inside, touched), bool [F] each, or None where all of the mesh is inside, or there is none.  strands:
    (`Boxes`, inside, touched), or None where all are, or they are not Curves whose points are known.  cropped: whether
    anything is partly inside.
    """

    frustum: Frustum
    ball: tuple[np.ndarray, float]
    near: float
    faces: tuple[Faces, np.ndarray, np.ndarray] | None
    strands: tuple[Boxes, np.ndarray, np.ndarray] | None
    cropped: bool


def seen(scene: Any) -> Seen:
    """`Seen` of a scene by its camera."""
    scene = scene.local
    mesh, fur = scene.mesh, scene.strands
    known_fur = scene.shells if is_unknown(fur) else scene.fur
    frustum = Frustum(scene.camera, WIDE, fur_extent(known_fur))
    faces = strands = None
    center, radius = extent(mesh, scene.fur)
    if frustum.of_spheres(center[None], radius)[0][0]:
        return Seen(frustum, (center, radius), _near(scene, (center, radius), None, None), None, None, False)
    corners = boxes_to_see(mesh, known_fur)
    if mesh is not None and not _all_inside(frustum, corners[0]):
        known = faces_of(mesh, fur is not None and fur.surface == "pn")
        faces = known, *frustum.of_spheres(known.center, known.radius)
        straddle = np.flatnonzero(faces[2] & ~faces[1])   # spheres of large faces reach further than they do
        within = frustum.within(known.corners[straddle])
        bulge = known.bulge[straddle]
        faces[1][straddle] = within.min((1, 2)) >= bulge
        faces[2][straddle] = (within.max(1).min(1) > -bulge)
    if isinstance(fur, Curves) and not is_unknown(fur) and len(fur.points) and not _all_inside(frustum, corners[-1]):
        boxes = boxes_of(fur.on_host)
        inside, touched = frustum.of_boxes(boxes)
        strands = None if inside.all() else (boxes, inside, touched)
    cropped = [each is not None and bool((each[1] != each[2]).any()) for each in (faces, strands)]
    ball = extent(mesh, scene.fur)
    if strands is not None and not fur.bounds and scene.ground is None:   # on which shadows of all of them may fall
        ball = _ball(scene, strands[0], strands[2])
    return Seen(frustum, ball, _near(scene, ball, faces, strands), faces, strands, any(cropped))


def is_unknown(fur: Any) -> bool:
    """Whether they are Curves on a device that have bounds: these are not read back."""
    return isinstance(fur, Curves) and fur.bounds is not None and is_on_device(fur.points)


def _all_inside(frustum, corners):
    return bool((frustum.within(np.array(list(itertools.product(*zip(*corners))))) >= 0).all())


def _ball(scene, boxes, touched):
    """What `extent` gives of a scene with only those Curves that touch the frustum."""
    chosen = np.flatnonzero(touched)
    mesh, curves = scene.mesh, scene.strands.on_host
    others = points_to_see(mesh, scene.fur)[:-1]   # without the Curves
    places, half = boxes.center[chosen], boxes.half[chosen]
    ends = [box(each) for each in others] + ([(box(places - half)[0], box(places + half)[1])] if len(chosen) else [])
    if not ends:
        return extent(mesh, scene.fur)
    center, _ = sphere(np.min([each for each, _ in ends], 0), np.max([each for _, each in ends], 0))
    if len(chosen):   # only those can be the furthest that reach as far as one of them does
        x, y, z = (places - center).T
        reach = np.sqrt(x * x + y * y + z * z) + boxes.reach[chosen]
        one = curves.points[points_of(boxes, chosen[[np.argmax(reach)]])]
        furthest = chosen[reach >= np.sqrt(((one - center)**2).sum(1).max()) * (1 - 1e-9)]
        others = [*others, curves.points[points_of(boxes, furthest)]]
    radius = float(np.sqrt(max(((each - center)**2).sum(1).max() for each in others)))
    return center, radius + max(float(boxes.width[chosen].max(initial=0)), fur_extent(scene.shells))


def _near(scene, ball, faces, strands):
    """Where the near plane stands: as near as the ball, or nearer where that would cut off what is seen."""
    (center, radius), camera, mesh = ball, scene.camera, scene.mesh
    eye, forward = camera.pose[:3, 3], -camera.pose[:3, 2]
    distance = float(forward @ (center - eye))
    radius = radius or abs(distance) or 1.0
    near = max(distance - 1.01 * radius, AMONG * radius)
    grown = 0.0 if isinstance(scene.strands, Curves) else fur_extent(scene.strands)
    grown = max(grown, fur_extent(scene.shells))
    if near > AMONG * radius:   # nothing is before the ball
        return near
    far = min(_furthest(scene, eye, forward, faces, strands), radius)
    floor = max(min(IN_FUR * grown, AMONG * far), LEAST * far, LEAST**2 * radius)
    if near <= floor:
        return near
    unknown = is_unknown(scene.strands)
    frustum, nearest = Frustum(camera, EDGE, fur_extent(scene.shells if unknown else scene.fur)), np.inf
    if mesh is not None:
        known = faces[0] if faces else faces_of(mesh, scene.strands is not None and scene.strands.surface == "pn")
        nearest = _nearest_face(frustum, eye, known, grown, near)
    if unknown:
        bounds = scene.strands.bounds
        nearest = min(nearest, max(float(np.linalg.norm(bounds.center - eye) - bounds.radius) * frustum.cosine, 0.0))
    elif isinstance(scene.strands, Curves) and len(scene.strands.points):
        nearest = min(nearest, _nearest_strand(frustum, eye, scene.strands.on_host, near))
    return near if near <= nearest else max(nearest, floor)


def _furthest(scene, eye, forward, faces, strands):
    """How far along the view all reaches that is seen of the points of mesh and Curves."""
    boxes = boxes_to_see(scene.mesh, scene.shells if is_unknown(scene.strands) else scene.fur)
    parts = [faces] * (scene.mesh is not None) + [strands] * (len(boxes) > (scene.mesh is not None))
    far = [0.0]
    for part, corners in zip(parts, boxes):
        if part is None:   # all of it is
            far.append(float(((np.array(list(itertools.product(*zip(*corners)))) - eye) @ forward).max()))
        else:
            known, touched = part[0], part[2]
            reach = known.radius if isinstance(known, Faces) else known.reach
            far.append(float((times(known.center[touched] - eye, forward) + reach[touched]).max(initial=0)))
    return max(far)


def _nearest_face(frustum, eye, faces, grown, near):
    """A distance ahead before which no face and nothing that grows on it is seen, or infinity where it is no less than
    ``near``."""
    reach, d = near / frustum.cosine + grown, faces.center - eye
    some = np.flatnonzero((d * d).sum(1) < (reach + faces.radius)**2)
    some = some[frustum.within(faces.corners[some]).max(1).min(1) > -faces.bulge[some]]
    if not len(some):
        return np.inf
    away = to_triangles(eye, faces.corners[some]) - faces.bulge[some] - grown
    return max(float(away.min()) * frustum.cosine, 0.0)


def _nearest_strand(frustum, eye, curves, near):
    """The same of Curves."""
    boxes = boxes_of(curves)
    d = boxes.center - eye
    some = np.flatnonzero((d * d).sum(1) < (near / frustum.cosine + boxes.reach)**2)
    away = np.linalg.norm(np.maximum(np.abs(d[some]) - boxes.half[some], 0), axis=1) - boxes.width[some]
    some = some[away < near / frustum.cosine]
    some = some[frustum.of_spheres(boxes.center[some], boxes.reach[some])[1]]
    if not len(some):
        return np.inf
    first, owner = segments_of(boxes, some)
    a, b = curves.points[first].astype(np.float64), curves.points[first + 1].astype(np.float64)
    visible = (np.maximum(frustum.within(a), frustum.within(b)) > 0).all(1)
    if not visible.any():
        return np.inf
    away = to_segments(eye, a[visible], b[visible]) - boxes.width[owner[visible]]
    return max(float(away.min()) * frustum.cosine, 0.0)


def segments_of(boxes: Boxes, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(First points of the segments of some Curves, whose they are) int [segments] each."""
    counts = np.maximum(boxes.counts[chosen] - 1, 0)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.repeat(boxes.first[chosen], counts) + within, np.repeat(chosen, counts)


def to_segments(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances from a point to segments a b [n, 3]."""
    d = b - a
    square = (d * d).sum(1)
    at = np.clip(((p - a) * d).sum(1) / np.where(square > 0, square, 1), 0, 1)
    return np.linalg.norm(a + at[:, None] * d - p, axis=1)


def to_triangles(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distances from a point to triangles [n, 3, 3]: to the plane where the point is over it, else to a side."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    n = np.cross(b - a, c - a)
    length = np.linalg.norm(n, axis=1)
    over = length > 0
    for one, other in ((a, b), (b, c), (c, a)):
        over &= (np.cross(other - one, p - one) * n).sum(1) >= 0
    sides = np.min([to_segments(p, one, other) for one, other in ((a, b), (b, c), (c, a))], 0)
    return np.where(over, np.abs(((p - a) * n).sum(1)) / np.where(length > 0, length, 1), sides)


def clipped_faces(frustum: Frustum, corners: Any) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what a frustum holds of triangles [n, 3, 3]: (points [m, 3], of which triangle each is [m])."""
    n, within = len(corners), frustum.within(corners)
    found, whose = [corners.reshape(-1, 3)], [np.repeat(np.arange(n), 3)]
    good: list[Any] = [(within >= 0).all(2).ravel()]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        for plane in range(5):
            some = np.flatnonzero((within[:, i, plane] < 0) != (within[:, j, plane] < 0))
            one, other = within[some, i, plane], within[some, j, plane]
            points = corners[some, i] + (one / (one - other))[:, None] * (corners[some, j] - corners[some, i])
            others = np.delete(frustum.within(points), plane, 1)
            found, whose, good = [*found, points], [*whose, some], [*good, (others >= 0).all(1)]
    edge, far = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    for ray in frustum.corners:   # Moeller and Trumbore 1997
        p, to_apex = np.cross(ray, far), frustum.apex - corners[:, 0]
        det, q = (edge * p).sum(1), np.cross(to_apex, edge)
        by = 1 / np.where(det == 0, np.inf, det)
        u, v, t = (to_apex * p).sum(1) * by, times(q, ray) * by, (far * q).sum(1) * by
        found, whose = [*found, frustum.apex + t[:, None] * ray], [*whose, np.arange(n)]
        good.append((det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0))
    keep = np.concatenate(good)
    return np.concatenate(found)[keep], np.concatenate(whose)[keep]


def clipped_segments(frustum: Frustum, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(Ends [2 m, 3] of what a frustum holds of segments a b [n, 3], of which segment each is)."""
    begin, end = np.zeros(len(a)), np.ones(len(a))
    for plane, offset in zip(frustum.planes, frustum.offsets):   # a row at a time: much faster than along short rows
        one, other = times(a, plane) + offset, times(b, plane) + offset
        at = one / np.where(one == other, 1, one - other)
        begin = np.maximum(begin, np.where(one < 0, np.where(other >= 0, at, 2), 0))
        end = np.minimum(end, np.where((one >= 0) & (other < 0), at, 1))
    some = np.flatnonzero(begin < end)
    d = b[some] - a[some]
    return np.concatenate([a[some] + begin[some, None] * d, a[some] + end[some, None] * d]), np.tile(some, 2)
