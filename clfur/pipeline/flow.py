"""Two scenes of the same strands and faces: motion vectors from the one to the other, and how far anything goes."""

from typing import Any

import numpy as np

from ..errors import Error
from ..scene import Scene
from ..settings import Settings
from ..stages import flow
from . import build
from .plan import Plan
from .views import Rig


def plan_before(scene: Scene, before: Scene, settings: Settings) -> Plan:
    """`Plan` of the scene ``before``, relative to the same place; raises `clfur.Error` unless both have the same
    strands, faces and size of picture."""
    plan = Plan(Rig.of(before, settings), ())
    other = Plan(Rig.of(scene, settings), ())
    for what, one, two in (("strands", plan.strands, other.strands), ("points of strands", plan.points, other.points),
                           ("faces", plan.faces, other.faces), ("triangles", plan.triangles, other.triangles),
                           ("columns", plan.size[0], other.size[0]), ("rows", plan.size[1], other.size[1])):
        if one != two:
            raise Error(f"before has {one:,} {what} and scene {two:,}; allowed: the same scene at another time")
    return plan


def vectors(gpu: Any, plan: Plan, parts: list, front: Any, known: dict) -> Any:
    """Motion vectors [rows, width] of what is in `Front`; known: what else is of its pixels, ids among it."""
    other: Any = plan.before
    views = front.view, _same_part(front.view, other.rig.view)
    made = flow.still(gpu, *views, front.keys)
    for part in parts:
        now = build.hair(gpu, plan, part, 0), build.body(gpu, plan, part)
        flow.moving(gpu, *views, front.keys, now, build.before(gpu, plan, part), made, bool(plan.settings.lod))
        del now   # goes before the next one is made
    if plan.scene.shells:
        now, before = (gpu.upload(_corners(each.scene.mesh)) for each in (plan, other))
        flow.of_shells(gpu, *views, front.keys, front.shell_front, known["id"], now, before, made)
    return made


def farthest(gpu: Any, plan: Plan) -> float:
    """How far anything goes on the screen from the scene before to this one [pixels]."""
    other: Any = plan.before
    most = None
    for part in plan.parts(gpu):
        now = build.hair(gpu, plan, part, 0), build.body(gpu, plan, part)
        most = flow.farthest(gpu, plan.view, other.view, now, build.before(gpu, plan, part), most)
        del now
    return float(gpu.download(most).view(np.float32)[0])


def _same_part(view, of_all):
    """The camera of a whole picture, for the samples of a view of some of its rows and columns."""
    other = view.copy()
    for name in "to_screen", "to_world", "eye", "scale":
        other[name] = of_all[name]
    return other


def _corners(mesh):
    """Corners of faces, float32 [faces, 3, 4]."""
    return np.pad(mesh.positions[mesh.faces].astype(np.float32), ((0, 0), (0, 0), (0, 1)))
