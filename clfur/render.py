"""From a scene to its picture: what users call."""

import functools
import itertools
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from . import budget
from .device.scheduler import Scheduler
from .device.selection import choose, shares_processor
from .device.team import Team
from .errors import Error, shown
from .pipeline.build import told
from .pipeline.grown import curves_of
from .pipeline.picture import OF_TWO, OUTPUTS, Frame, draw_frame
from .pipeline.plan import Plan
from .pipeline.views import Rig
from .scene import Camera, Curves, Scene, Strands
from .scene.checks import refuse, to_stop, whole
from .scene.origin import copied
from .settings import Settings

__all__ = ["OUTPUTS", "Frame", "draw", "frames", "grow", "render", "schedulers"]


def render(scene: Scene, device: Any = None, settings: Settings | None = None,
           outputs: Sequence[str] | None = None, region: Sequence[int] | None = None,
           before: Scene | None = None, stop: Callable[[], bool] | None = None) -> Any:
    """Draw a `Scene` -> float32 [height, width, 4]: linear, premultiplied, coverage in alpha.

    ``device``: what `Scheduler` accepts, or a `Scheduler` to keep between frames, or a list of these, which then draw
    the frame together: they share the strands' shadows by speed (and with `Settings.raster` "samples" what is seen),
    and the picture is the same. ``settings``: a `Settings`; None: its defaults. ``outputs``: names of pictures to
    return as {name: array} instead, [h, w] where nothing else is told:

    - "color": as above. "coverage", float32: what color's alpha is before any blur.
    - "depth", float32: distance along the view axis in world units, inf where nothing is. "position", float32 [h,
      w, 3]: the place in the world, relative to `Scene.origin` (add it in float64), on the ray through the pixel's
      middle; inf where nothing is. "id", int32: strand, -1 nothing, -2 body, -3 shells, -4 ground. "tangent" and
      "normal", float32 [h, w, 3]: unit vectors of the world, 0 where there is none. "uv", float32 [h, w, 2]: the
      body's, or of the strand's root.
    - "motion_vector", float32 [h, w, 2]: how many pixels what is seen has gone to the right and down since ``before``,
      the same place of the same strand or triangle; inf where that was not before the camera. Background goes as the
      camera turns, a ground stays in the world, shells go with their face.
    - "hair_alpha", float32: share of the pixel's light that strands and shells have, in front of all else or seen
      through it: the hair alone. "body_alpha": the body's share. With the ground's they add up to what is covered.
      "type_alpha", float32 [h, w, types]: each type's share; where the scene has shells, theirs is one more, the
      last. Their sum is hair_alpha. "type", int32: the type with most, -1 without hair.
    - "orientation", float32 [h, w, 2]: (cos 2a, sin 2a) of the hair's angle a on the screen, from x to the right
      against the clock, so that both ways along a hair are one; each hair counts by its share, so its length is at
      most hair_alpha, and a = atan2(y, x) / 2.
    - "matte_id", int32 [h, w, 6] as "id", and "matte_alpha", float32 [h, w, 6]: who has most of the pixel, and the
      next ones, and their shares. "strand_area", float32 [strands]: pixels that each strand has, behind what hides
      it; 0 of strands that `Settings.lod` leaves out, and of those it keeps the wider area.

    Those of the second line tell of what fills most of a pixel, with raster "samples" of its nearest sample. Of
    shells they tell where half of the light from behind is gone; coverage of a ground is its shadow, and of a
    holdout nothing, while the others tell of these as if they were opaque. Shares are areas, without blur or gamma;
    those from hair_alpha on cost another drawing of the strands, without light. Arrays are contiguous, and the
    caller's own: `torch.from_dlpack(array)` shares them.
    ``region``: (x, y, width, height) in pixels of the picture that are wanted alone, from its top-left corner on: the
    very same bits as of the whole one, in about that share of its time.
    ``before``: the same scene at another time, of as many strands and faces in their order, for motion_vector.
    ``stop``: a function without arguments, such as `threading.Event().is_set`, by which the picture can be given up: it
    is asked some hundred times in a picture, in any thread, and once it says True, `clfur.Stopped` is raised, which is
    no Error. That takes no longer than about 0.1 s, but while a driver builds kernels. A `Scheduler` that is kept is as
    good as before, as it is after Ctrl-C (KeyboardInterrupt).
    Raises `clfur.Error` for an unknown device or output, a region that is not within the picture, a ``before`` of
    other strands, and for a picture that the device cannot hold.
    """
    frame = draw(scene, device, settings, ("color",) if outputs is None else outputs, region=region, before=before,
                 stop=stop)
    return frame.images["color"] if outputs is None else frame.images


def draw(scene: Scene, device: Any = None, settings: Settings | None = None, outputs: Sequence[str] = ("color",),
         hashes: bool = False, region: Sequence[int] | None = None, before: Scene | None = None,
         stop: Callable[[], bool] | None = None) -> Frame:
    """Draw a `Scene` and tell what it took -> `Frame`; arguments and errors as for `render`.

    ``hashes``: also hash the bits of the integer stages, which are the same on every device; of a region those of the
    8 x 8 pixels that it has a part of.
    With `Settings.max_error` the cheapest of `clfur.budget`'s ladder is taken that is near enough to its finest in a
    tenth of the picture; with ``seconds`` the dearest whose frame, done anew, takes no longer.  That is found out once
    for a scene, a light and a distance, while the `Scheduler` is kept, and is no part of the frame's seconds.  If it
    cannot be had: the best there is, and a warning.  With both, seconds counts more.
    """
    outputs, settings, part = checked(scene, settings, outputs, region, before, stop)
    return drawn(schedulers(device), scene, settings, outputs, hashes, before, stop, region=part)


def checked(scene: Any, settings: Any, outputs: Any, region: Any, before: Any, stop: Any = None) -> tuple:
    """(outputs, Settings, region) of what `draw` is given, or `clfur.Error`."""
    outputs = (outputs,) if isinstance(outputs, str) else outputs
    for name in outputs if isinstance(outputs, (tuple, list)) else [outputs]:
        if not isinstance(name, str) or name not in OUTPUTS | OF_TWO:
            raise Error(f"there is no output {shown(name)}; allowed: {', '.join(OUTPUTS | OF_TWO)}")
    _check_scene(scene)
    if before is None and "motion_vector" in outputs:
        raise Error("motion_vector needs before; allowed: the scene at another time")
    if before is not None and not isinstance(before, Scene):
        raise Error(f"before is {shown(before)}; allowed: a clfur.Scene")
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise Error(f"settings is {shown(settings)}; allowed: a clfur.Settings")
    to_stop(stop, "stop")
    return outputs, settings, _region(region, scene.camera.size)


def drawn(gpus: list[Scheduler], scene: Scene, settings: Settings, outputs: Sequence[str], hashes: bool = False,
          before: Scene | None = None, stop: Callable[[], bool] | None = None, **how: Any) -> Frame:
    """`draw` of what has been checked; how: what else `draw_frame` takes."""
    how["before"] = before and before.seen_from(scene.origin)
    with ExitStack() as frames:
        for gpu in gpus:
            frames.enter_context(gpu.frame(stop))
        team, scene = Team(gpus), scene.local
        if not settings.goal:
            return draw_frame(team, scene, settings, outputs, hashes, **how)
        chosen = budget.choose(team, scene, settings, functools.partial(draw_frame, team, scene))
        for gpu in team.gpus:
            gpu.start()
        frame = draw_frame(team, scene, chosen.settings, outputs, hashes, **how)
        return replace(frame, error=chosen.error, why=chosen.why)


def _region(value, size):
    """(x, y, width, height) of a region of a picture of this (width, height), None for all of it."""
    if value is None:
        return None
    allowed = f"x, y, width and height of one pixel or more within {size[0]} x {size[1]}"
    try:
        x, y, width, height = (whole(0, 16384)(each, "region") for each in value)
    except Exception:   # an object's own methods can raise anything
        refuse("region", value, allowed)
    if not (width and height and x + width <= size[0] and y + height <= size[1]):
        refuse("region", value, allowed)
    return x, y, width, height


def frames(scene: Scene, cameras: Iterable[Camera], device: Any = None, settings: Settings | None = None,
           outputs: Sequence[str] = ("color",), stop: Callable[[], bool] | None = None) -> Iterator[Frame]:
    """Draw a `Scene` from one camera after the other -> an iterator of a `Frame` each, drawn when it is asked for.

    ``cameras``: `Camera`s, in place of the scene's own; other arguments and errors as for `draw`. What hangs on no
    camera stays on the device: strands, body and shells, a sky, and the lights' grids and maps as long as all that is
    drawn is in the picture (else they are fitted anew to what is, so that shadows stay as sharp as they are nearby).
    With `Settings.lod` the camera thins the strands, and with ``max_error`` or ``seconds`` settings are chosen for
    each.
    """
    _check_scene(scene)
    if isinstance(cameras, (str, dict, Camera)) or not isinstance(cameras, Iterable):
        raise Error(f"cameras is {shown(cameras)}; allowed: a list or another iterable of clfur.Camera")
    return _frames(scene, cameras, schedulers(device), settings, outputs, stop)


def _frames(scene, cameras, gpus, settings, outputs, stop):
    for number, camera in enumerate(cameras):
        if not isinstance(camera, Camera):
            raise Error(f"cameras[{number}] is {shown(camera)}; allowed: a clfur.Camera")
        yield draw(copied(scene, camera=camera), gpus, settings, outputs, stop=stop)


def _check_scene(scene):
    if not isinstance(scene, Scene):
        raise Error(f"scene is {shown(scene)}; allowed: a clfur.Scene")


def grow(scene: Scene, device: Any = None, stop: Callable[[], bool] | None = None) -> Curves:
    """Grow the strands of a `Scene` -> `Curves` on the host, which drawn in their place give the same picture.

    ``device``, ``stop``: as for `render`; of several devices the first grows them.  Raises `clfur.Error` for a scene
    without `Strands`.
    """
    _check_scene(scene)
    to_stop(stop, "stop")
    if not isinstance(scene.strands, Strands):
        raise Error("scene has no Strands; allowed: one with Strands in its fur")
    gpu = schedulers(device)[0]
    with gpu.frame(stop):
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
    if same := next((pair for pair in itertools.combinations(gpus, 2)
                     if shares_processor(*(gpu.device for gpu in pair))), None):
        _tell_same(*(gpu.name for gpu in same))
    return gpus


@functools.cache   # once, not for each frame
def _tell_same(one, other):
    warnings.warn(f"{one} and {other} are the same processor: together they are no faster than one", RuntimeWarning,
                  stacklevel=4)


_here = threading.local()   # a scheduler belongs to one thread


def _scheduler(device):
    """The scheduler of a caller who keeps none: a new one for each call would cost its start and some memory."""
    device = choose(device)
    mine = _here.__dict__.setdefault("schedulers", {})
    gpu = mine.get(device) or mine.setdefault(device, Scheduler(device))
    gpu.forget()
    return gpu
