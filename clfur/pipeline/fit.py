"""What the grids and shadow maps of lights are fitted to: all there is, or what can be seen where that is much less.

Where nothing reaches out of what the camera sees (`scene.seen`), that is a ball around all of it, which the camera does
not change.  Otherwise it is a cube, in the light's axes, around what is seen and casts a shadow on it: of a size out of
a geometric row, at whole cells, so that shadows stay where they are while the camera moves.  What is seen besides reads
full light, which is what it has; what stands outside, before the cube, counts in its first layer.
"""

import functools
import itertools
import math
from typing import Any

import numpy as np

from ..scene import Curves, Light, Mesh, Scene, Strands, fur_extent, hair_bounds
from ..scene.bounds import boxes_to_see
from ..scene.ground import height_of
from ..scene.remembered import remembered
from ..scene.seen import Seen, clipped_faces, clipped_segments, faces_of, is_unknown, seen, segments_of, times

STEPS = 4            # sizes of a cube between one and its double; distances from a spot have 2
GAIN = math.sqrt(2)  # times smaller than a ball around everything must a cube be, to be taken
LARGE = 0.05         # of the area of all faces have those in a plane of which is looked whether they shade anything
ROUNDING = 1e-2      # of a texel may the uv of a root be off
MOST_HIDDEN = 1 << 22   # pairs of points and faces that are looked at whether one hides the other
LEAST = 0.05         # of the radius: what is nearer to a spot casts no shadow
STEEP = 1.45         # radians aside that a light at a position may have to see


class Fit:
    """What a scene's lights have to see.

    whole: (center [3], radius) of a ball around everything.
    """

    def __init__(self, scene: Scene, known: Seen) -> None:
        self.scene, self.seen, self.whole = scene, known, known.ball
        strands = [each for each in (scene.strands, scene.shells) if each is not None and not isinstance(each, Curves)]
        self._boxes: dict = {}   # what `_shading` gave
        self.grown = fur_extent(tuple(strands))   # how far what grows on the faces reaches

    @classmethod
    def of(cls, scene: Scene) -> "Fit":
        """The `Fit` of a scene."""
        return cls(scene.local, seen(scene))

    def frame(self, light: Light, cells: int) -> tuple[np.ndarray, float, float, float, float]:
        """(World -> axes of the light [4, 4], half the depth, distance of its middle along the light, half a side,
        least distance from a spot at which what stands before counts, 0 if nothing does).

        Half a side is that of the square that the light must see: in world units, or for a spot at distance 1.
        ``cells``: along a side, at whole ones of which a cube stands.
        """
        center, radius, cropped = self._cube(light, cells) if self.seen.cropped else (*self.whole, False)
        radius = 1.001 * radius or 1.0                       # nothing lies on the border
        to_light = np.eye(4)
        to_light[:3, :3] = axes_along(self.ahead(light))
        if light.position is None:
            to_light[:3, 3] = -to_light[:3, :3] @ center
            if cropped:
                side = 2 * radius / cells
                to_light[:3, 3] = np.rint(to_light[:3, 3] / side) * side
            return to_light, radius, 0.0, radius, 1.0
        to_light[:3, 3] = -to_light[:3, :3] @ light.position
        distance = (to_light @ [*center, 1.0])[2]
        # The light may stand inside the scene, or look away from it: what is nearer than this casts no shadow.
        least = LEAST * radius
        near = max(distance - radius, least)
        far = distance + radius if distance + radius > near else 2 * near
        # The cone, or as much of it as the ball around the scene fills.
        off = np.linalg.norm(center - light.position)
        widest = math.acos(max(min(distance / off, 1), -1)) + math.asin(radius / off) if off > radius else math.pi
        cone = math.tan(min(math.radians(light.angle) / 2, widest))
        # What shades the edge of a disc stands aside of what shades its middle.
        half = cone if light.everywhere else min(cone + light.size * (1 / near - 1 / far), math.tan(min(widest, STEEP)))
        half = max(half, cone)
        if cropped:
            near, far = max(_step(near, math.floor, 2), least), _step(far, math.ceil, 2)
            half = min(_step(half, math.ceil), max(half, math.tan(min(math.radians(light.angle) / 2, STEEP))))
        return to_light, (far - near) / 2, (far + near) / 2, half, least if near > least else 0.0

    def ahead(self, light: Light) -> np.ndarray:
        """The way [3] that a light looks: its own, or of a point light that to the middle of everything."""
        if not light.everywhere:
            return light.direction
        way = self.whole[0] - light.position
        length = float(np.linalg.norm(way))
        return way / length if length else light.direction

    def hair_before(self, grid: np.void, strands: int) -> tuple[int, float, float, float]:
        """What `hair_bounds` tells of as many strands, of those alone that can lie in a grid's columns, and their
        smallest w, or the grid's."""
        fur: Any = self.scene.strands
        nearest = float(grid["face"][2])
        bounds = hair_bounds(fur, strands) if strands else (0, 0.0, 0.0)
        if self.seen.strands is None:
            if self.seen.cropped and self._nearest_face(grid) < nearest:
                nearest = float(grid["face"][3])
            return (*bounds, nearest)
        boxes, curves = self.seen.strands[0], fur.on_host
        m = grid["to_grid"].astype(float)
        x, y, z, w = (times(boxes.center, m[:3]) + m[3]).T
        reach, side = boxes.reach, float(grid["face"][1])
        beside = (int(grid["size"][0]) / 2 + 1) * (w + reach) + math.sqrt(2) * reach / side
        half = int(grid["size"][0]) / 2 * w
        deep = reach * float(np.linalg.norm(grid["to_grid"][:3, 2]))
        some = np.flatnonzero((np.abs(x - half) <= beside) & (np.abs(y - half) <= beside) & (w + reach > 0)
                              & (z - deep <= int(grid["size"][2]) + 1))
        if len(some) == len(boxes.first) and 2 * reach.max() <= side * int(grid["size"][0]):
            return (*bounds, nearest)
        first, _ = segments_of(boxes, some)
        longest = 3 * side * (int(grid["size"][0]) + 4) * max(float((w[some] + reach[some]).max(initial=0)), 1e-30)
        length = np.minimum(np.linalg.norm(curves.points[first + 1] - curves.points[first], axis=1), longest)
        least = float((w[some] - reach[some]).min(initial=np.inf))
        total = float(length.sum(dtype=float))
        width = 2 * float(boxes.width[some].max(initial=0))
        return (int(boxes.counts[some].sum()), total, total * width,
                nearest if least >= nearest else float(max(grid["face"][3], least)))

    def _nearest_face(self, grid):
        """Smallest w of all that grows on the mesh, or infinity without."""
        if self.scene.mesh is None:
            return np.inf
        m = grid["to_grid"].astype(float)
        return float((times(self.scene.mesh.positions, m[:3, 3]) + m[3, 3]).min()) - self.grown

    def _cube(self, light, cells):
        """(Center, half a side, True) of a cube around what casts shadows on what is seen; or the ball and False."""
        if self.scene.ground and light.position is not None:   # whose shadows grow with the way to the ground
            return *self.whole, False
        low, high = self._boxes.get(light) or self._boxes.setdefault(light, self._on_ground(
            light, *self._shading(light)))
        axes = axes_along(self.ahead(light))
        center = axes.T @ ((low + high) / 2)
        half = (high - low) / 2
        radius = float(half.max() if light.position is None else np.linalg.norm(half))
        if light.position is None:   # what shades the edge of a disc stands aside
            radius *= 1 + 2 * math.tan(math.radians(light.size) / 2)
        radius = _step(radius * (1 + 4 / cells) or self.whole[1], math.ceil)
        return (center, radius, True) if GAIN * radius <= self.whole[1] else (*self.whole, False)

    def _shading(self, light):
        """Corners (low, high) [3] of a box in the light's axes around what is seen and casts a shadow on it."""
        (points, radius, faces), axes = self.visible, axes_along(self.ahead(light))
        idle = self._idle(light)
        casts = ~idle[faces]
        if not casts.any():
            return _box(times(points, axes.T), radius)
        low, high = _box(times(points[casts], axes.T), radius[casts])
        if casts.all():
            return low, high
        # Of what is left out, the light that falls on it may be taken by what is not seen.
        least, most = _box(times(points, axes.T), radius)
        center, reach = self._unseen(idle[:-1])
        before = self._falls_on(light, center, reach)
        if before.any():
            one, other = _box_of_each(times(center[before], axes.T), reach[before])
            one[:, :2], other[:, :2] = np.maximum(one[:, :2], least[:2]), np.minimum(other[:, :2], most[:2])
            low, high = np.minimum(low, one.min(0)), np.maximum(high, other.max(0))
        return low, high

    def _on_ground(self, light, low, high):
        """A box in a distant light's axes, as `_shading` gives it, grown by what shades the ground where it is seen."""
        if self.scene.ground is None or not light.direction[1] < 0:
            return low, high
        # The shadow of a rectangle around everything, as two triangles of the ground.
        axes = axes_along(light.direction)
        one, other = _box(times(self._corners, axes.T), np.zeros(8))
        square = np.array([(x, y, 0) for x, y in zip((one[0], other[0], other[0], one[0]),
                                                     (one[1], one[1], other[1], other[1]))]) @ axes
        square += ((height_of(self.scene) - square[:, 1]) / light.direction[1])[:, None] * light.direction
        points, _ = clipped_faces(self.seen.frustum, square[[(0, 1, 2), (0, 2, 3)]])
        if not len(points):
            return low, high
        one, other = _box(times(points, axes.T), np.zeros(len(points)))
        low, high = low.copy(), high.copy()
        low[:2], high[:2] = np.minimum(low, one)[:2], np.maximum(high, other)[:2]
        center, reach = self._unseen(np.zeros(len(self._idle(light)) - 1, bool))
        center = times(center, axes.T)
        before = ((center[:, :2] + reach[:, None] > low[:2]) & (center[:, :2] - reach[:, None] < high[:2])).all(1)
        high[2] = (center[before, 2] + reach[before]).max(initial=high[2])
        return low, high

    @functools.cached_property
    def _corners(self):
        """Corners [8, 3] of a box around everything."""
        center, radius = self.whole
        low, high = center - radius, center + radius
        if not is_unknown(self.scene.strands):
            boxes, reach = boxes_to_see(self.scene.mesh, self.scene.fur), fur_extent(self.scene.fur)
            low = np.maximum(low, np.min([each for each, _ in boxes], 0) - reach)
            high = np.minimum(high, np.max([each for _, each in boxes], 0) + reach)
        return np.array(list(itertools.product(*zip(low, high))))

    @functools.cached_property
    def visible(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What is in the frustum: (points [n, 3], how far what is there reaches [n], of which face, -1 of none [n])."""
        frustum, found = self.seen.frustum, [(np.zeros((0, 3)), np.zeros(0), np.zeros(0, int))]
        known = self._faces
        if known is not None:
            inside, touched = self.seen.faces[1:] if self.seen.faces else (np.ones(len(known.center), bool),) * 2
            some, part = np.flatnonzero(inside), np.flatnonzero(touched & ~inside)
            whose = np.repeat(some, 3)
            reach = known.bulge + self.grown * self._furry
            found.append((known.corners[some].reshape(-1, 3), reach[whose], whose))
            points, whose = clipped_faces(frustum, known.corners[part])
            whose = part[whose]
            found.append((points, reach[whose], whose))
        fur = self.scene.strands
        if isinstance(fur, Curves) and self.seen.strands:
            boxes, inside, touched = self.seen.strands
            found.append((boxes.center[inside], boxes.reach[inside], np.full(inside.sum(), -1)))
            first, owner = segments_of(boxes, np.flatnonzero(touched & ~inside))
            points = fur.on_host.points
            ends, whose = clipped_segments(frustum, points[first].astype(float), points[first + 1].astype(float))
            found.append((ends, boxes.width[owner[whose]], np.full(len(ends), -1)))
        elif isinstance(fur, Curves) and len(fur.points):
            bounds: Any = fur.bounds
            center, radius = (bounds.center, bounds.radius) if is_unknown(fur) else self._curves
            found.append((center[None], np.array([radius]), np.array([-1])))
        points, radius, faces = (np.concatenate(each) for each in zip(*found))
        if not len(points):
            return self.whole[0][None], np.array([self.whole[1]]), np.array([-1])
        return points, radius, faces

    @property
    def _faces(self):
        """`Faces` of the mesh, or None."""
        mesh, fur = self.scene.mesh, self.scene.strands
        if mesh is None or (self.scene.body_color is None and not self.grown):
            return None
        return self.seen.faces[0] if self.seen.faces else faces_of(mesh, fur is not None and fur.surface == "pn")

    @functools.cached_property
    def _furry(self):
        """Which faces something may grow on, bool [F]."""
        fur, mesh = self.scene.strands, self.scene.mesh
        if self.scene.shells is None and isinstance(fur, Strands) and isinstance(fur.type_indices, np.ndarray):
            return furry_faces(fur, mesh)
        return np.full(len(mesh.faces), self.grown > 0)

    @property
    def _curves(self):
        """(Center, radius) of a ball around Curves that are all inside."""
        points = self.scene.strands.on_host.points
        low, high = points.min(0).astype(float), points.max(0).astype(float)
        return (low + high) / 2, float(np.linalg.norm(high - low)) / 2 + fur_extent(self.scene.strands)

    def _idle(self, light):
        """Which faces shade nothing that is seen, [F + 1] with False at last for what is no face: those of a plane
        behind which nothing is."""
        known, (points, radius, _) = self._faces, self.visible
        idle = np.zeros(1 if known is None else len(known.center) + 1, bool)
        if known is None or self._furry.all():
            return idle
        normals = np.cross(known.corners[:, 1] - known.corners[:, 0], known.corners[:, 2] - known.corners[:, 0])
        area = np.linalg.norm(normals, axis=1)
        normals /= np.where(area > 0, area, 1)[:, None]
        slack = 1e-5 * self.whole[1]
        flat = (area > 0) & (known.bulge <= slack) & ~self._furry
        towards = -light.direction if light.position is None else light.position - known.center
        normals *= np.where((normals * towards).sum(1) < 0, -1, 1)[:, None]
        offsets = (normals * known.center).sum(1)
        # Faces in the plane of the largest face that is left, and again.
        while flat.any():
            first = int(np.argmax(np.where(flat, area, 0)))
            n, offset = normals[first], offsets[first]
            beside = times(known.corners, n) - offset
            mine = flat & ((beside > -slack) & (beside < slack)).all(1)
            if area[mine].sum() < LARGE * area.sum():
                break
            behind = times(points, n) - radius < offset - slack
            deepest = points[behind] - radius[behind, None] * n
            idle[:-1][mine] = self._hidden(deepest, n, offset, known.corners[mine])
            flat &= ~mine
        return idle

    def _hidden(self, points, n, offset, corners):
        """Whether all points [m, 3] behind a plane are hidden by these faces in it, [k, 3, 3]: so is hair that hangs
        through the ground."""
        eye = self.scene.camera.pose[:3, 3]
        if not len(points):
            return True
        if eye @ n <= offset or len(points) * len(corners) > MOST_HIDDEN:
            return False
        before, after = eye @ n - offset, offset - times(points, n)
        at = eye + (before / (before + after))[:, None] * (points - eye)
        over = np.ones((len(points), len(corners)), bool)
        turn = np.sign((np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * n).sum(1))
        for i in range(3):
            side, start = np.roll(corners, -1, 1)[:, i] - corners[:, i], corners[:, i]
            across = np.cross(n, side) * turn[:, None]
            over &= at @ across.T >= (across * start).sum(1) - 1e-9 * (across * across).sum(1)
        return bool(over.any(1).all())

    def _unseen(self, idle):
        """Spheres (center [n, 3], radius [n]) around what stands outside of the frustum, but for ``idle`` faces."""
        found = [(np.zeros((0, 3)), np.zeros(0))]
        if self.seen.faces and self._faces is not None:   # else they are not drawn, and nothing grows on them
            known, _, touched = self.seen.faces
            some = ~touched & ~idle
            found.append((known.center[some], known.radius[some] + self.grown))
        if self.seen.strands:
            boxes, _, touched = self.seen.strands
            found.append((boxes.center[~touched], boxes.reach[~touched]))
        center, radius = (np.concatenate(each) for each in zip(*found))
        return center, radius

    def _falls_on(self, light, center, radius):
        """Whether the shadow of spheres falls on what is seen, [n]: whether a ray from them, as wide as it gets there,
        meets the frustum and the box around what is in it."""
        points, reach, _ = self.visible
        low, high = _box(points, reach)
        planes = np.concatenate([self.seen.frustum.planes, np.eye(3), -np.eye(3)])
        offsets = np.concatenate([self.seen.frustum.offsets, -low, high])
        ray = np.broadcast_to(light.direction, center.shape)
        if light.position is not None:
            ray = center - light.position
            away = np.linalg.norm(ray, axis=1)
            furthest = np.linalg.norm((low + high) / 2 - light.position) + np.linalg.norm(high - low) / 2
            radius = radius * np.maximum(furthest / np.where(away > 0, away, 1), 1)
        start, slope = times(center, planes.T) + offsets + radius[:, None], times(ray, planes.T)
        meets = -start / np.where(slope == 0, 1, slope)
        begin = np.where(slope > 0, meets, np.where((slope == 0) & (start < 0), np.inf, 0)).max(1)
        end = np.where(slope < 0, meets, np.inf).min(1)
        return np.maximum(begin, 0) <= end


def axes_along(z: np.ndarray) -> np.ndarray:
    """Rows x, y, z of a frame that turns as smoothly as z does, but where z points straight up."""
    turn, cosine = _cross((0, -1, 0), z), -z[1]
    if cosine < -1 + 1e-9:
        return np.array([(1, 0, 0), (0, 0, -1), z])
    # The shortest turn from straight down to z (Rodrigues), of the axis x.
    x = np.array([1.0, 0, 0])
    x = x + _cross(turn, x) + _cross(turn, _cross(turn, x)) / (1 + cosine)
    return np.array([x, _cross(z, x), z])


def _cross(a, b):
    """Cross product of two vectors, to which NumPy's takes ten times as long."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@remembered(2)   # a film asks for the same again in every frame
def furry_faces(fur: Strands, mesh: Mesh) -> np.ndarray:
    """Which faces of a mesh have a type of hair that grows, anywhere around the texels of their uv, bool [F]."""
    grows = np.array([kind.segments > 0 and (kind.full_length > 0 or fur.guides is not None)
                      for kind in fur.types])[fur.type_indices]
    height, width = grows.shape
    sums = np.zeros((height + 1, width + 1), np.int64)
    sums[1:, 1:] = grows.cumsum(0).cumsum(1)
    uv = mesh.uv.astype(np.float64) * (width, height)
    low, high = np.floor(uv.min(1) - ROUNDING).astype(np.int64), np.floor(uv.max(1) + ROUNDING).astype(np.int64) + 1
    one = np.clip(low, 0, (width, height))
    other = np.clip(high, 0, (width, height))
    top, bottom = height - other[:, 1], height - one[:, 1]   # rows run down
    some = (sums[bottom, other[:, 0]] - sums[top, other[:, 0]] - sums[bottom, one[:, 0]] + sums[top, one[:, 0]]) > 0
    wraps = ((mesh.uv < 0) | (mesh.uv >= 1)).any((1, 2))
    return some | (wraps & grows.any())


def _step(size, rounded, steps=STEPS):
    """A size out of a geometric row, of so many steps to the double."""
    return 2.0 ** (rounded(steps * math.log2(size)) / steps)


def _box_of_each(points, radius):
    return points - radius[:, None], points + radius[:, None]


def _box(points, radius):
    """Corners (low, high) [3] of the box around spheres."""
    return (np.array([(points[:, i] - radius).min() for i in range(3)]),
            np.array([(points[:, i] + radius).max() for i in range(3)]))
