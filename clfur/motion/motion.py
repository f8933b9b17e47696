"""A scene whose strands move: what users call."""

import itertools
import math
import warnings
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import attrs
import numpy as np

from .. import layout
from ..errors import Error, shown
from ..render import grow, schedulers
from ..scene import Mesh, Scene, Strands, checks
from ..scene.bounds import LONG, hair_bounds
from ..scene.curves import Bounds, Curves
from ..scene.guides import far_from
from ..scene.origin import seen_from
from ..scene.rest import posed
from ..stages import motion as stage
from ..stages import wind as air
from ..stages.guides import feet_on
from ..stages.strands import DeviceStrands, upload_curves
from ..stages.tessellate import as_float4
from .body import Body
from .hair import HairMotion, Wind, of_types
from .hair_on_hair import HairOnHair
from .pose import between, box_within, pose_of
from .undercoat import Undercoat
from .within import Began, mixed

FEW, MOST = 0.25, 32   # lengths of the longest strand that a root may go in a substep; substeps it is given for that
DEEP = 0.5             # cells: strands that are groomed further inside the body are told of


class Motion:
    """The strands of a scene in motion, step by step: each gives a `Scene` that is drawn as any other.

    scene: a Scene with a mesh and fur, or a function of seconds that gives one. The hair of scene(0) is the groom: as
    it is, it is at rest under gravity. Strands are grown once; roots keep their places on the mesh's faces, which all
    scenes share. Of later ones the Strands or Curves are not heeded, all else is drawn as it is there: mesh, camera,
    lights, sky, ground, colours, and shells but for how they lean, at each vertex, which is of scene(0) and moves.
    hair: a HairMotion, or one for each type and then one for shells; None: HairMotion().
    device: as for `render`, of several the first; scenes must be drawn by the same. rate: substeps a second, 1 to
    10,000; roots that move fast get more. units_per_metre: of the scene. gravity: [3] m/s². wind: a Wind or None. fps:
    frames a second, of `at`. jump: world units; where a vertex goes further in a step it is a cut, and hair is carried
    along. None: the radius of the mesh. body: whether strands feel the mesh, and do not enter it; "auto": where some
    are longer than a fifth of the mesh's radius, so that they can lie on it. What was groomed nearer than half of its
    width, or inside, may stay as near. Hair that is too soft to bear its weight as it was groomed falls, and a warning
    says how much; another, how much goes through the body. hair_on_hair: seconds, > 0, in which hair takes the speed of
    the hair around it; hair is then pushed apart where it lies denser than it was groomed, too. None: hair does not
    feel other hair.

    The equations are in docs/motion.md. Raises Error for a scene without fur or mesh, for shells with a wind of their
    own, for Curves that stand elsewhere, and where arguments are not allowed; `step` and `at` do for a function that
    gives something else, or a mesh of other faces.

    time: seconds since the groom.
    """

    _state: stage.State
    _roots: Any   # as `stage.place_roots` gives them

    def __init__(self, scene: Scene | Callable[[float], Scene], hair: Any = None, device: Any = None, *,
                 rate: float = 120.0, units_per_metre: float = 1.0, gravity: Any = (0.0, -9.81, 0.0),
                 wind: Wind | None = None, fps: float = 24.0, jump: float | None = None,
                 body: bool | str = "auto", hair_on_hair: float | None = None) -> None:
        self._given, self.time = scene, 0.0
        first = self.scene = self._now = self._scene_at(0.0)
        if first.fur is None:
            raise Error(f"Motion.scene is {shown(first)}; allowed: with Strands, Curves or Shells")
        if first.shells is not None and np.any(first.shells.wind):
            raise Error("Motion.scene.fur's Shells have a wind of their own; allowed: none, Motion.wind moves them")
        self.rate = checks.real(1, 10_000)(rate, "Motion.rate")
        self.fps = checks.real(1, 10_000)(fps, "Motion.fps")
        self.units = checks.positive()(units_per_metre, "Motion.units_per_metre")
        self.gravity = checks.safely(checks.vector(3), gravity, "Motion.gravity") * self.units
        self.wind = self._wind = checks.instance(Wind, none=True)(wind, "Motion.wind") or Wind()
        self.jump = first.mesh.bounds[1] if jump is None else checks.positive()(jump, "Motion.jump")
        if not isinstance(body, bool) and not (isinstance(body, str) and body == "auto"):
            checks.refuse("Motion.body", body, '"auto", True or False')
        near = checks.optional(checks.positive())(hair_on_hair, "Motion.hair_on_hair")
        self._gpu = schedulers(device)[0]
        self._groom = grow(first, self._gpu) if isinstance(first.strands, Strands) else (
            first.strands or Curves(points=np.zeros((0, 3)), counts=[])).on_host
        hair, last = of_types(HairMotion() if hair is None else hair, len(self._groom.hair_types) * bool(first.strands),
                              first.shells is not None)
        self._said, self._last_step, self._frame = False, 0.0, 0
        self._began: Began | None = None
        self._mesh, self._origin = first.mesh, first.origin
        with self._gpu.frame():
            self._corners, normals = self._posed(first.mesh)
            self._rest = self._pose = pose_of(self._corners, normals, None)
            self._here = self._uploaded(self._rest)
            self._hang(hair, body)
            self._undercoat = None if first.shells is None else Undercoat(
                self._gpu, first.shells, first.mesh, last, self.gravity, self.units, self._standing)
        segments, length, area = hair_bounds(self._groom, len(self._groom.counts))
        away = float(np.abs(self._gpu.download(self._offsets)).max(initial=0)) * 3**0.5
        beyond = self._longest + away + float(self._groom.width.max(initial=0)) / 2
        self._beyond = Bounds((0, 0, 0), beyond, segments, length, area)
        self._others = None
        if near is not None and first.strands is not None:
            with self._gpu.frame():
                box = box_within(self._rest, self._rest, 0)
                self._others = HairOnHair(self._gpu, near, self._state, self._roots, box, beyond, self._longest,
                                          self.units)

    def step(self, seconds: float, mesh: Mesh | None = None, wind: Wind | None = None, cut: bool = False,
             stop: Callable[[], bool] | None = None) -> Scene:
        """Go on by so many seconds -> the Scene then, whose Curves are on the device.

        mesh: its pose then, of the same faces; None: that of the function `scene`, or as it is. wind: from now on, or
        None: as it is. cut: hair is carried along with the mesh as if nothing had moved. stop: as for `clfur.draw`; a
        step that is stopped, or ends in an error or by Ctrl-C, has not begun. Raises Error for a mesh of other faces.
        """
        seconds = checks.real(low=1e-6, high=3600)(seconds, "Motion.step seconds")
        wind = checks.instance(Wind, none=True)(wind, "Motion.step wind") or self.wind
        cut = checks.flag(cut, "Motion.step cut")
        scene = self._scene_at(self.time + seconds)
        if mesh is None and callable(self._given):
            mesh = scene.mesh
        mesh = checks.instance(Mesh)(self._mesh if mesh is None else mesh, "Motion.step mesh")
        corners, pose, moved = self._corners, self._pose, 0.0
        if mesh is not self._mesh:
            corners, normals = self._posed(mesh)
            moved = float(np.linalg.norm(corners - self._corners, axis=2).max(initial=0))
            pose = pose_of(corners, normals, self._rest)
        is_cut = cut or moved > self.jump
        with self._gpu.frame(checks.to_stop(stop, "Motion.step stop")), self._whole():
            self.wind = wind
            there = self._here if pose.corners is self._pose.corners else self._uploaded(pose)
            self._began = Began(self.time, seconds, self._mesh, self._roots, stage.remember(self._gpu, self._state),
                                is_cut, callable(self._given) and mesh is scene.mesh)
            self._go(seconds, pose, there, moved, is_cut)
            self._now, self._mesh, self._corners, self._pose, self._here = scene, mesh, corners, pose, there
            return self._drawn_as(scene, mesh, *self._placed())

    @contextmanager
    def _whole(self):
        """If what is done within is given up, all that moves is as it was."""
        moving = [each for each in (self, self._undercoat) if each]
        known = [(each, dict(vars(each))) for each in moving]
        states = [self._state, self._undercoat.state] if self._undercoat else [self._state]
        arrays = [(state, name, self._gpu.copied(getattr(state, name))) for state in states for name in state.moving]
        try:
            yield
        except BaseException:   # Ctrl-C too
            for each, there in known:
                vars(each).update(there)
            for state, name, array in arrays:
                object.__setattr__(state, name, array)
            raise

    def at(self, frame: int, stop: Callable[[], bool] | None = None) -> Scene:
        """Go on to a frame, as `fps` counts them from the groom's, 0 -> the Scene then. stop: as for `step`. Raises
        Error for one that has gone by."""
        frame = checks.whole(0, 2**31 - 1)(frame, "Motion.at frame")
        if frame < self._frame:
            raise Error(f"Motion.at frame is {frame}; allowed: {self._frame} and later, as time goes on alone")
        while self._frame < frame:
            seconds = (self._frame + 1) / self.fps - self.time   # so that errors do not add up
            if seconds > 1e-6:   # Ctrl-C may have come between the step and what follows
                self.step(seconds, stop=stop)
            self._frame += 1
        return self._drawn()

    def state(self) -> dict:
        """All that is needed to go on from here -> {name: NumPy array or number}, for `restore`."""
        arrays = {name: self._gpu.download(getattr(*where)) for name, where in self._held().items()}
        return {"time": self.time, "frame": self._frame, "last_step": self._last_step, **arrays}

    def restore(self, state: dict, mesh: Mesh | None = None, wind: Wind | None = None) -> Scene:
        """Go to where a Motion of the same arguments was when it gave its `state` -> the Scene then.

        From there on it gives the same bits. mesh, wind: the last that `step` was given there, if any. Raises Error
        for what is no such state.
        """
        held = self._held()
        try:
            arrays = {name: np.asarray(state[name]) for name in held}
            time, last_step = (checks.real(low=0)(state[name], name) for name in ("time", "last_step"))
            frame = checks.whole(0, 2**31 - 1)(state["frame"], "frame")
        except (LookupError, TypeError, ValueError):   # of which Error is one
            raise Error("Motion.restore state is not what Motion.state has given; allowed: that alone") from None
        for name, array in arrays.items():
            there = getattr(*held[name])
            if (array.shape, array.dtype) != (there.shape, there.dtype):
                raise Error(f"Motion.restore state has {name} {array.dtype} {list(array.shape)}; allowed: "
                            f"{there.dtype} {list(there.shape)}, of a Motion of the same arguments")
        scene = self._scene_at(time)
        mesh = checks.instance(Mesh, none=True)(mesh, "Motion.restore mesh") or scene.mesh
        self.wind = checks.instance(Wind, none=True)(wind, "Motion.restore wind") or self._wind
        with self._gpu.frame():
            self._corners, normals = self._posed(mesh)
            self._pose = pose_of(self._corners, normals, self._rest)
            self._here = self._uploaded(self._pose)
            for name, array in arrays.items():
                owner, attribute = held[name]
                object.__setattr__(owner, attribute, self._gpu.upload(array))
            if self._undercoat:
                self._undercoat.begin()
        self._now, self._mesh, self.time, self._frame, self._last_step = scene, mesh, time, frame, last_step
        self._began = None
        return self._drawn()

    def _held(self):
        """{name: (object, its attribute)} of the arrays on the device that hair keeps from step to step."""
        held = {f"strands.{name}": (self._state, name) for name in self._state.declared} | {"roots": (self, "_roots")}
        if coat := self._undercoat:
            held |= {f"shells.{name}": (coat.state, name) for name in coat.state.declared}
            held |= {f"shells.{name}": (coat, name) for name in ("roots", "lean")}
        return held

    def between(self, share: float) -> Scene:
        """The Scene at a share, 0 to 1, of the last step, for motion blur.

        Strands go on a cubic in time through places and speeds at both ends of the step, and are as long as ever; 1 is
        what `step` gave, 0 what was before it, to the bit. The mesh is that of the function `scene` then, or goes
        straight from pose to pose; all of a step that is a cut is after it. Raises Error before the first step.
        """
        share, began = checks.real(low=0, high=1)(share, "Motion.between share"), self._began
        if began is None:
            raise Error("Motion.between is asked for before any step; allowed: after Motion.step or Motion.at")
        if share == 1:
            return self._drawn()
        time = began.time + share * began.seconds
        scene = self._scene_at(time) if callable(self._given) else self._now
        mesh = self._mesh if began.is_cut else scene.mesh if began.by_scene else mixed(began.mesh, self._mesh, share)
        gpu, state, ends = self._gpu, self._state, (began.roots, self._roots)
        with gpu.frame():
            if share == 0 and not began.is_cut:
                points, normals = stage.place_points(gpu, replace(state, places=began.hair[0]), ends[0], self._strands)
            else:
                roots = ends[1] if began.is_cut else self._roots_on(mesh)
                points, normals = stage.between(gpu, state, self._types, self._strands, began.hair, (*ends, roots),
                                                share, began.seconds, began.is_cut)
            return self._drawn_as(scene, mesh, points, normals, 1.0 if began.is_cut else share)

    def _roots_on(self, mesh):
        """Roots on a pose of the mesh."""
        there = self._uploaded(pose_of(*self._posed(mesh), None))
        return stage.place_roots(self._gpu, self._feet, self._offsets, there, there, 1.0,
                                 stage.padded(self._gpu, len(self._feet)))

    def _scene_at(self, seconds):
        """The scene that was given, or that the given function gives."""
        scene = self._given(seconds) if callable(self._given) else self._given
        if not isinstance(scene, Scene) or scene.mesh is None:
            which = f"Motion.scene({seconds:g})" if callable(self._given) else "Motion.scene"
            more = ", or a function of seconds that gives one" if scene is self._given else ""
            raise Error(f"{which} is {shown(scene)}; allowed: a clfur.Scene with a mesh{more}")
        return scene

    def _hang(self, hair, body):
        """Put the groom on the mesh, at rest."""
        gpu, groom = self._gpu, self._groom
        counts = groom.counts.astype(np.int64)
        first, n = np.cumsum(counts) - counts, len(counts)
        points = (groom.points + (groom.origin - self._origin)).astype(np.float32)
        kinds = np.zeros(n, int) if groom.type_of is None else groom.type_of.astype(int)
        uv = np.zeros((n, 4), np.float32)
        uv[:, 2] = kinds
        drawn = as_float4(points)
        width = self._groom.width
        drawn[:, 3] = np.repeat(width, counts) if len(width) == n != len(points) else width
        self._strands = DeviceStrands.empty(
            gpu, {"run": 0, "color": 0, "type": 0, "strand": n, "point": 0}, points=gpu.upload(drawn),
            spans=gpu.upload(np.stack([first, counts], 1).astype(np.uint32)), uv=gpu.upload(uv))
        lengths = _lengths(points, counts)
        longest = [float(lengths[kinds == kind].max(initial=0)) or 1.0 for kind in range(len(hair))]
        types = np.zeros(len(hair), layout.MotionType)
        types["hair"] = [each.row(length, self.units) for each, length in zip(hair, longest)]
        types["touch"][:, 0] = [each.friction for each in hair]
        self._types, self._longest = gpu.upload(types), float(lengths.max(initial=0))
        somewhere = self._corners.reshape(-1, 3)[:1] if len(self._corners) else np.zeros((1, 3), np.float32)
        self._stand(np.append(points, somewhere, 0)[np.where(counts > 0, first, -1)])   # a strand may have no points
        is_long = self._longest > LONG * self.scene.mesh.bounds[1]
        self._body = Body(gpu, seen_from(self._mesh, self._origin), self.scene.strands, self._rest) if (
            is_long if body == "auto" else body and n) else None
        self._state, soft = stage.hang(gpu, self._strands, int(counts.max(initial=1)), self._roots, self._types,
                                       self.gravity, self._body is not None)
        if too_soft := int(gpu.download(soft).sum()):
            warnings.warn(f"{too_soft:,} of {n:,} strands are too soft to stay as they were groomed under gravity, and "
                          "fall; a longer HairMotion.bend_length bears them", RuntimeWarning, stacklevel=4)
        if self._body:
            self._stand_off()

    def _stand_off(self):
        """Let strands feel the body, from as they were groomed."""
        felt = self._body.felt
        deepest = self._gpu.download(stage.stand_off(self._gpu, self._state, self._strands, felt))[:self._state.n]
        if within := int((deepest < -DEEP * felt.distance.grid["reach"][1]).sum()):
            warnings.warn(f"{within:,} of {len(deepest):,} strands are groomed to go through the body, and may stay as "
                          "deep in it; Strands.collision keeps most of them out", RuntimeWarning, stacklevel=5)

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

    def _roots_at(self, now, share, rows=None):
        """Roots, such a share of the way from the pose that is here to another; rows: the rigid motion there."""
        return self._standing(self._feet, self._offsets, now, share, rows)

    def _standing(self, feet, offsets, now=None, share=1.0, rows=None):
        """The same of whatever stands with such feet; now: None as the mesh is here."""
        body = stage.RESTING if rows is None else stage.body_at(rows[:3, :3], rows[:3, 3])
        return stage.place_roots(self._gpu, feet, offsets, self._here, now or self._here, share,
                                 stage.padded(self._gpu, len(feet)), body)

    def _posed(self, mesh):
        """(Corners of the faces that the groom's mesh has, normals there) of a pose, float32 [faces, 3, 3]."""
        mesh = posed(mesh, self.scene.mesh, "Motion.scene.mesh")
        corners = mesh.positions[mesh.faces] + (mesh.origin - self._origin)
        return corners.astype(np.float32), mesh.normals[mesh.faces].astype(np.float32)

    def _uploaded(self, pose):
        return tuple(self._gpu.upload(np.pad(each, ((0, 0), (0, 0), (0, 1)))) for each in (pose.corners, pose.normals))

    def _go(self, seconds, pose, there, moved, is_cut):
        """Go on to a pose whose faces are on the device, and which have moved so far at most."""
        gpu, n, state = self._gpu, self._substeps(seconds, 0.0 if is_cut else moved), self._state
        step, longest, (shares, bared) = seconds / n, self._longest, self._sheltered()
        bodies = self._body.way(self._pose, pose, n, is_cut) if self._body else itertools.repeat(None)
        if self._undercoat:
            self._undercoat.begin()
        for number, felt in zip(range(n), bodies):
            share = 1.0 if is_cut else (number + 1) / n
            rows = between(self._pose, pose, share)
            wind = self.wind.at(self.time + (number + 1) * step, self.units, longest)
            if state.n:
                roots = self._roots_at(there, share, rows)
                winds = air.blow(gpu, wind, roots, state.places, state.points, state.padded, shares)
                as_before, jumped = abs(step - self._last_step) < 1e-6 * step, is_cut and not number
                of_hair = None
                if self._others is not None and not jumped:
                    box = box_within(self._pose, pose, 1.0 if is_cut else number / n)   # where roots are still
                    of_hair = self._others.felt(self._roots, box, step, as_before)
                stage.advance(gpu, state, self._types, roots, self._roots, step, self.gravity, winds,
                              2 if as_before else 1, jumped, felt, of_hair)
                self._roots, self._last_step = roots, step
            if self._undercoat:
                roots = self._standing(*self._undercoat.feet, there, share, rows)
                self._undercoat.go(roots, step, wind, self.gravity, bared, is_cut and not number)
        self.time += seconds

    def _sheltered(self):
        """Shares of the wind that strands upwind leave to strands, and to shells; None where they give no shelter.
        Hair goes so little in a step that they are as good as new in all of it."""
        speed, gpu, state = float(np.linalg.norm(self.wind.velocity)), self._gpu, self._state
        if not (self.wind.shelter and speed and state.n):
            return None, None
        curves, bounds = self._curves(*self._placed(), self._mesh), self._around(self._mesh)
        wind = self.wind.at(self.time, self.units, 0)
        upwind = air.upwind(gpu, self.wind.velocity / speed, (bounds.center, bounds.radius), upload_curves(gpu, curves),
                            (bounds.segments, bounds.length, bounds.area), len(curves.hair_types))
        return (air.shelter(gpu, wind, upwind, self._roots, state.places, state.points, state.padded),
                self._undercoat and self._undercoat.sheltered(wind, upwind))

    def _substeps(self, seconds, moved):
        """How many substeps of such a step, in which a vertex of the mesh moves so far."""
        by_rate = max(math.ceil(seconds * self.rate - 1e-6), 1)
        by_way = math.ceil(moved / (FEW * self._longest)) if self._longest else 1
        if self._body:
            by_way = max(by_way, math.ceil(moved / self._body.pace))
        if by_way > max(MOST, by_rate) and not self._said:
            self._said = True
            warnings.warn(f"the mesh moves by {moved / self._longest:.3g} lengths of the longest strand in a step, for "
                          f"which {by_way} substeps would be right; {MOST} substeps are made of it at most: shorter "
                          "steps are more exact", RuntimeWarning, stacklevel=4)
        return max(by_rate, min(by_way, MOST))

    def _around(self, mesh):
        """The `Bounds` of the strands around a pose of the mesh."""
        center, radius = seen_from(mesh, self._origin).bounds
        return attrs.evolve(self._beyond, center=center, radius=radius + self._beyond.radius)

    def _placed(self):
        """Points of the strands as they are now, and normals at their roots."""
        return stage.place_points(self._gpu, self._state, self._roots, self._strands)

    def _curves(self, points, normals, mesh):
        return attrs.evolve(self._groom, points=points, root_normal=normals, origin=self._origin,
                            bounds=self._around(mesh), lod_by="number")

    def _drawn(self):
        """The scene as it is now."""
        with self._gpu.frame():
            return self._drawn_as(self._now, self._mesh, *self._placed())

    def _drawn_as(self, scene, mesh, points, normals, share=1.0):
        """A scene with strands of such points and normals at roots, and shells as at a share of the last step."""
        shells = scene.shells
        if shells is not None and self._undercoat:
            shells = self._undercoat.drawn(shells, mesh, share)
        curves = None if self.scene.strands is None else self._curves(points, normals, mesh)
        fur = tuple(each for each in (shells, curves) if each is not None)
        return attrs.evolve(scene, mesh=mesh, fur=fur if len(fur) > 1 else fur[0] if fur else None)


def _lengths(points, counts):
    """How long strands are [strands] float64."""
    steps = np.zeros(len(points) + 1)
    steps[1:-1] = np.linalg.norm(np.diff(points.astype(np.float64), axis=0), axis=1)
    sums = np.cumsum(steps)
    first = np.cumsum(counts) - counts
    return np.where(counts > 0, sums[np.maximum(first + counts - 1, 0)] - sums[np.minimum(first, len(points))], 0)
