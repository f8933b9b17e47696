"""From a scene to its picture: what users call."""

import functools
import threading
import warnings
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import attrs

from . import budget
from .device.scheduler import Scheduler
from .device.selection import choose
from .device.team import Team
from .errors import Error, shown
from .pipeline.build import told
from .pipeline.grown import curves_of
from .pipeline.picture import OUTPUTS, Frame, draw_frame
from .pipeline.plan import Plan
from .pipeline.views import Rig
from .scene import Curves, Scene, Strands, highlighted
from .settings import Settings

__all__ = ["OUTPUTS", "Frame", "draw", "grow", "render", "schedulers"]


def render(scene: Scene, device: Any = None, settings: Settings | None = None,
           outputs: Sequence[str] | None = None) -> Any:
    """Draw a `Scene` -> float32 [height, width, 4]: linear, premultiplied, coverage in alpha.

    ``device``: what `Scheduler` accepts, or a `Scheduler` to keep between frames, or a list of these, which then draw
    the frame together: they share the strands' shadows by speed (and with `Settings.raster` "samples" what is seen),
    and the picture is the same. ``outputs``: names of pictures to return as {name: array} instead: "color" as above,
    "depth" float32 [h, w] (distance along the view axis, inf where nothing is), "id" int32 [h, w] (strand, -1 nothing,
    -2 body, -3 shells, -4 ground), "tangent" and "normal" float32 [h, w, 3], "uv" float32 [h, w, 2], "coverage" float32
    [h, w]. All but color and coverage tell of what fills most of a pixel, with raster "samples" of its nearest sample.
    Of shells they tell where half of the light from behind is gone; coverage is what color's alpha is before any blur:
    so of a ground it is its shadow, and of a holdout nothing, while the others tell of these as if they were opaque.
    Raises `clfur.Error` for an unknown device or output, and for a picture that the device cannot hold.
    """
    frame = draw(scene, device, settings, ("color",) if outputs is None else outputs)
    return frame.images["color"] if outputs is None else frame.images


def draw(scene: Scene, device: Any = None, settings: Settings | None = None, outputs: Sequence[str] = ("color",),
         hashes: bool = False) -> Frame:
    """Draw a `Scene` and tell what it took -> `Frame`; arguments and errors as for `render`.

    ``hashes``: also hash the bits of the integer stages, which are the same on every device.
    With `Settings.max_error` the cheapest of `clfur.budget`'s ladder is taken that is near enough to its finest in a
    tenth of the picture; with ``seconds`` the dearest whose frame, done anew, takes no longer.  That is found out once
    for a scene, a light and a distance, while the `Scheduler` is kept, and is no part of the frame's seconds.  If it
    cannot be had: the best there is, and a warning.  With both, seconds counts more.
    """
    outputs = (outputs,) if isinstance(outputs, str) else outputs
    for name in outputs if isinstance(outputs, (tuple, list)) else [outputs]:
        if not isinstance(name, str) or name not in OUTPUTS:
            raise Error(f"there is no output {shown(name)}; allowed: {', '.join(OUTPUTS)}")
    _check_scene(scene)
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise Error(f"settings is {shown(settings)}; allowed: a clfur.Settings")
    gpus = schedulers(device)
    with ExitStack() as frames:
        for gpu in gpus:
            frames.enter_context(gpu.frame())
        team, scene = Team(gpus), scene.local
        drawn = scene
        if settings.specular is not None:   # as once all looks had it
            drawn = attrs.evolve(scene, fur=highlighted(scene.fur, settings.specular))
        if not settings.goal:
            return draw_frame(team, drawn, settings, outputs, hashes)
        chosen = budget.choose(team, scene, settings, functools.partial(draw_frame, team, drawn))
        for gpu in team.gpus:
            gpu.start()
        return replace(draw_frame(team, drawn, chosen.settings, outputs, hashes), error=chosen.error, why=chosen.why)


def _check_scene(scene):
    if not isinstance(scene, Scene):
        raise Error(f"scene is {shown(scene)}; allowed: a clfur.Scene")


def grow(scene: Scene, device: Any = None) -> Curves:
    """Grow the strands of a `Scene` -> `Curves` on the host, which drawn in their place give the same picture.

    ``device``: as for `render`; of several the first grows them.  Raises `clfur.Error` for a scene without `Strands`.
    """
    _check_scene(scene)
    if not isinstance(scene.strands, Strands):
        raise Error("scene has no Strands; allowed: one with Strands in its fur")
    gpu = schedulers(device)[0]
    with gpu.frame():
        gpu.forget()   # what frames have left: the plan below has room for strands alone
        plan = Plan(Rig.of(scene.local, Settings(shadows="off", shadow_map=0)), ())
        curves = curves_of(gpu, plan, scene.origin)
        for what in told(plan, gpu):
            warnings.warn(what, RuntimeWarning, stacklevel=2)
        return curves


def schedulers(device: Any) -> list[Scheduler]:
    """The `Scheduler`s that ``device`` means; one or, for a list, several different ones."""
    several = device if isinstance(device, (list, tuple)) else [device]
    gpus = [one if isinstance(one, Scheduler) else _scheduler(one) for one in several]
    if not gpus or len(set(gpus)) < len(gpus):
        raise Error(f"device is {shown(device, 200)}; allowed: what means a device, a clfur.Scheduler, or a list of "
                    "different ones")
    return gpus


_here = threading.local()   # a scheduler belongs to one thread


def _scheduler(device):
    """The scheduler of a caller who keeps none: a new one for each call would cost its start and some memory."""
    device = choose(device)
    mine = _here.__dict__.setdefault("schedulers", {})
    gpu = mine.get(device) or mine.setdefault(device, Scheduler(device))
    gpu.forget()
    return gpu
