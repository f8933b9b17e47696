"""A scene whose strands move: what users call."""

import math
import warnings
from collections.abc import Callable
from typing import Any

import attrs
import numpy as np

from .. import layout
from ..errors import Error, shown
from ..render import grow, schedulers
from ..scene import Mesh, Scene, Strands, checks
from ..scene.bounds import hair_bounds
from ..scene.curves import Bounds
from ..scene.guides import far_from
from ..scene.origin import seen_from
from ..scene.rest import posed
from ..stages import motion as stage
from ..stages.guides import feet_on
from ..stages.strands import DeviceStrands
from ..stages.tessellate import as_float4
from .hair import HairMotion, Wind, of_types
from .hair_on_hair import HairOnHair

FEW, MOST = 0.25, 32   # lengths of the longest strand that a root may go in a substep; substeps it is given for that


class Motion:
    """The strands of a scene in motion, step by step: each gives a `Scene` that is drawn as any other.

    scene: a Scene with a mesh and Strands or Curves, or a function of seconds that gives one. The hair of scene(0) is
    the groom: as it is, it is at rest under gravity. Strands are grown once; roots keep their places on the mesh's
    faces, which all scenes share. Of later ones the Strands or Curves are not heeded, all else is drawn as it is
    there: mesh, shells, camera, lights, sky, ground, colours. hair: a HairMotion, or one for each type; None:
    HairMotion(). device: as for `render`, of several the first; scenes must be drawn by the same. rate: substeps a
    second, 1 to 10,000; roots that move fast get more. units_per_metre: of the scene. gravity: [3] m/s². wind: a Wind
    or None. fps: frames a second, of `at`. jump: world units; where a vertex goes further in a step it is a cut, and
    hair is carried along. None: the radius of the mesh. hair_on_hair: seconds, > 0, in which hair takes the speed of the
    hair around it; hair is then pushed apart where it lies denser than it was groomed, too. None: hair does not feel
    other hair. Hair that is too soft to bear its weight as it was groomed falls, and a warning says how much.

    Hair does not feel the body. The equations are in docs/motion.md. Raises Error for a scene without
    strands or mesh, for Curves that stand elsewhere, and where arguments are not allowed; `step` and `at` do for a
    function that gives something else, or a mesh of other faces.

    time: seconds since the groom.
    """

    def __init__(self, scene: Scene | Callable[[float], Scene], hair: Any = None, device: Any = None, *,
                 rate: float = 120.0, units_per_metre: float = 1.0, gravity: Any = (0.0, -9.81, 0.0),
                 wind: Wind | None = None, fps: float = 24.0, jump: float | None = None,
                 hair_on_hair: float | None = None) -> None:
        self._given, self.time = scene, 0.0
        self.scene = scene = self._now = self._scene_at(0.0)
        if scene.strands is None:
            raise Error(f"Motion.scene is {shown(scene)}; allowed: with Strands or Curves")
        self.rate = checks.real(1, 10_000)(rate, "Motion.rate")
        self.fps = checks.real(1, 10_000)(fps, "Motion.fps")
        self.units = checks.positive()(units_per_metre, "Motion.units_per_metre")
        self.gravity = checks.safely(checks.vector(3), gravity, "Motion.gravity") * self.units
        self.wind = checks.instance(Wind, none=True)(wind, "Motion.wind") or Wind()
        self.jump = scene.mesh.bounds[1] if jump is None else checks.positive()(jump, "Motion.jump")
        seconds = checks.optional(checks.positive())(hair_on_hair, "Motion.hair_on_hair")
        self._gpu = schedulers(device)[0]
        self._groom = grow(scene, self._gpu) if isinstance(scene.strands, Strands) else scene.strands.on_host
        hair = of_types(HairMotion() if hair is None else hair, len(self._groom.hair_types))
        self._said, self._last_step, self._frame = False, 0.0, 0
        self._mesh, self._origin = scene.mesh, scene.origin
        with self._gpu.frame():
            self._corners = self._posed(scene.mesh)
            self._here = tuple(map(self._gpu.upload, self._corners))
            self._hang(hair)
        self._others = None
        segments, length, area = hair_bounds(self._groom, len(self._groom.counts))
        away = float(np.abs(self._gpu.download(self._offsets)).max(initial=0)) * 3**0.5
        beyond = self._longest + away + float(self._groom.width.max()) / 2
        self._beyond = Bounds((0, 0, 0), beyond, segments, length, area)
        if seconds is not None:
            with self._gpu.frame():
                self._others = HairOnHair(self._gpu, seconds, self._state, self._roots, _box(self._corners), beyond,
                                          self._longest, self.units)

    def step(self, seconds: float, mesh: Mesh | None = None, wind: Wind | None = None, cut: bool = False) -> Scene:
        """Go on by so many seconds -> the Scene then, whose Curves are on the device.

        mesh: its pose then, of the same faces; None: that of the function `scene`, or as it is. wind: from now on, or
        None: as it is. cut: hair is carried along with the mesh as if nothing had moved. Raises Error for a mesh of other faces.
        """
        seconds = checks.real(low=1e-6, high=3600)(seconds, "Motion.step seconds")
        self.wind = checks.instance(Wind, none=True)(wind, "Motion.step wind") or self.wind
        scene = self._scene_at(self.time + seconds)
        if mesh is None and callable(self._given):
            mesh = scene.mesh
        mesh = checks.instance(Mesh)(self._mesh if mesh is None else mesh, "Motion.step mesh")
        now, moved = self._corners, 0.0
        if mesh is not self._mesh:
            now = self._posed(mesh)
            moved = float(np.linalg.norm(now[0] - self._corners[0], axis=2).max())
        with self._gpu.frame():
            there = self._here if mesh is self._mesh else tuple(map(self._gpu.upload, now))
            boxes = None if self._others is None else (_box(self._corners), _box(now))
            self._go(seconds, there, boxes, moved, cut or moved > self.jump)
        self._now, self._mesh, self._corners, self._here = scene, mesh, now, there
        return self._drawn()

    def at(self, frame: int) -> Scene:
        """Go on to a frame, as `fps` counts them from the groom's, 0 -> the Scene then. Raises Error for one that has
        gone by."""
        frame = checks.whole(0, 2**31 - 1)(frame, "Motion.at frame")
        if frame < self._frame:
            raise Error(f"Motion.at frame is {frame}; allowed: {self._frame} and later, as time goes on alone")
        while self._frame < frame:
            self.step(1 / self.fps)
            self._frame += 1
        return self._drawn()

    def _scene_at(self, seconds):
        """The scene that was given, or that the given function gives."""
        scene = self._given(seconds) if callable(self._given) else self._given
        if not isinstance(scene, Scene) or scene.mesh is None:
            which = f"Motion.scene({seconds:g})" if callable(self._given) else "Motion.scene"
            more = ", or a function of seconds that gives one" if scene is self._given else ""
            raise Error(f"{which} is {shown(scene)}; allowed: a clfur.Scene with a mesh{more}")
        return scene

    def _hang(self, hair):
        """Put the groom on the mesh, at rest."""
        gpu, groom = self._gpu, self._groom
        counts = groom.counts.astype(np.int64)
        first, n = np.cumsum(counts) - counts, len(counts)
        points = (groom.points + (groom.origin - self._origin)).astype(np.float32)
        kinds = np.zeros(n, int) if groom.type_of is None else groom.type_of.astype(int)
        uv = np.zeros((n, 4), np.float32)
        uv[:, 2] = kinds
        self._strands = DeviceStrands.empty(
            gpu, {"run": 0, "color": 0, "type": 0, "strand": n, "point": 0}, points=gpu.upload(as_float4(points)),
            spans=gpu.upload(np.stack([first, counts], 1).astype(np.uint32)), uv=gpu.upload(uv))
        lengths = _lengths(points, counts)
        longest = [float(lengths[kinds == kind].max(initial=0)) or 1.0 for kind in range(len(hair))]
        types = np.zeros(len(hair), layout.MotionType)
        types["hair"] = [each.row(length, self.units) for each, length in zip(hair, longest)]
        self._types, self._longest = gpu.upload(types), float(lengths.max(initial=0))
        self._stand(np.append(points, np.zeros((1, 3), np.float32), 0)[np.where(counts > 0, first, -1)])
        self._state, soft = stage.hang(gpu, self._strands, int(counts.max(initial=1)), self._roots, self._types,
                                       self.gravity)
        if too_soft := int(gpu.download(soft).sum()):
            warnings.warn(f"{too_soft:,} of {n:,} strands are too soft to stay as they were groomed under gravity, and "
                          "fall; a longer HairMotion.bend_length bears them", RuntimeWarning, stacklevel=4)

    def _stand(self, roots):
        """Find the places of roots [strands, 3] on the mesh."""
        gpu, n = self._gpu, len(roots)
        self._feet = feet_on(gpu, seen_from(self._mesh, self._origin), gpu.upload(as_float4(roots)),
                             gpu.empty((n, 4), np.float32))
        away = np.sqrt(gpu.download(self._feet)[:, 0])
        if self.scene.strands is self._groom and n:   # it has not grown there
            far_from(self._mesh, away, "Motion.scene.fur")
        self._offsets = gpu.full((n, 4), np.float32, 0)
        there = gpu.download(self._roots_at(self._here, 1.0))[:, :, :n]
        offsets = np.zeros((n, 4), np.float32)
        offsets[:, :3] = np.einsum("axn,nx->na", there[1:], roots - there[0].T)
        self._offsets = gpu.upload(offsets)
        self._roots = self._roots_at(self._here, 1.0)

    def _roots_at(self, now, share):
        """Roots, such a share of the way from the pose that is here to another."""
        return stage.place_roots(self._gpu, self._feet, self._offsets, self._here, now, share,
                                 stage.padded(self._gpu, len(self._feet)))

    def _posed(self, mesh):
        """(Corners of the faces that the groom's mesh has, normals there) of a pose, float32 [faces, 3, 4]."""
        mesh = posed(mesh, self.scene.mesh, "Motion.scene.mesh")
        corners = mesh.positions[mesh.faces] + (mesh.origin - self._origin)
        return tuple(np.pad(each.astype(np.float32), ((0, 0), (0, 0), (0, 1)))
                     for each in (corners, mesh.normals[mesh.faces]))

    def _go(self, seconds, there, boxes, moved, is_cut):
        """Go on to a pose that is on the device, whose vertices have moved so far at most; boxes: around both."""
        gpu, n = self._gpu, self._substeps(seconds, 0.0 if is_cut else moved)
        wind, step = self.wind.of_world(self.units), seconds / n
        for number in range(n):
            share = 1.0 if is_cut else (number + 1) / n
            roots = self._roots_at(there, share)
            winds = stage.blow(gpu, self._state, roots, time=self.time + (number + 1) * step, **wind)
            as_before = abs(step - self._last_step) < 1e-6 * step
            jumped, felt = is_cut and not number, None
            if self._others is not None and not jumped:
                share = 1.0 if is_cut else number / n   # where roots are still
                box = (1 - share) * boxes[0] + share * boxes[1]
                felt = self._others.felt(self._roots, box, step, as_before)
            stage.advance(gpu, self._state, self._types, roots, self._roots, step, self.gravity, winds,
                          2 if as_before else 1, jumped, self.wind.skin * self.units, felt)
            self._roots, self._last_step = roots, step
        self.time += seconds

    def _substeps(self, seconds, moved):
        """How many substeps of such a step, in which a vertex of the mesh moves so far."""
        by_rate = max(math.ceil(seconds * self.rate - 1e-6), 1)
        by_way = math.ceil(moved / (FEW * self._longest)) if self._longest else 1
        if by_way > max(MOST, by_rate) and not self._said:
            self._said = True
            warnings.warn(f"the mesh moves by {moved / self._longest:.3g} lengths of the longest strand in a step; "
                          f"{MOST} substeps are made of it at most: shorter steps are more exact", RuntimeWarning,
                          stacklevel=4)
        return max(by_rate, min(by_way, MOST))

    def _drawn(self):
        """The scene as it is now."""
        with self._gpu.frame():
            points, normals = stage.place_points(self._gpu, self._state, self._roots, self._strands)
        mesh, (center, radius) = self._mesh, self._mesh.bounds
        bounds = attrs.evolve(self._beyond, center=center, radius=radius + self._beyond.radius)
        curves = attrs.evolve(self._groom, points=points, root_normal=normals, origin=self._origin, bounds=bounds,
                              lod_by="number")
        shells = self._now.shells
        return attrs.evolve(self._now, mesh=mesh, fur=curves if shells is None else (shells, curves))


def _box(corners):
    """(Lowest, highest) corner of a pose [2, 3] float64."""
    places = corners[0][..., :3].reshape(-1, 3).astype(float)
    return np.stack([places.min(0), places.max(0)])


def _lengths(points, counts):
    """How long strands are [strands] float64."""
    steps = np.zeros(len(points) + 1)
    steps[1:-1] = np.linalg.norm(np.diff(points.astype(np.float64), axis=0), axis=1)
    sums = np.cumsum(steps)
    first = np.cumsum(counts) - counts
    return np.where(counts > 0, sums[np.maximum(first + counts - 1, 0)] - sums[np.minimum(first, len(points))], 0)
