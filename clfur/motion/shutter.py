"""Motion blur: the mean of pictures that were taken while a shutter was open."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import attrs

from ..errors import Error, shown
from ..layout import PATTERNS, pattern_start
from ..pipeline.flow import farthest, plan_before
from ..pipeline.picture import Frame
from ..pipeline.plan import Plan
from ..pipeline.views import Rig
from ..render import checked, drawn, schedulers
from ..scene import Scene
from ..settings import Settings
from ..stages import shutter

MEANS = ("color", "coverage", "hair_alpha", "body_alpha", "type_alpha", "orientation", "strand_area")
MOST, APART = 64, 1.5   # pictures of a blur; pixels on the screen that they are apart, at most


def blurred(scenes: Sequence[Scene], device: Any = None, settings: Settings | None = None,
            outputs: Sequence[str] = ("color",), hashes: bool = False, region: Sequence[int] | None = None,
            before: Scene | None = None, stop: Callable[[], bool] | None = None) -> Frame:
    """Draw a scene at the middles of n equal parts of the time in which a shutter is open -> `Frame`, of one picture.

    scenes: 1 to 64 `Scene`s of one size, in the order of time; of one it is `clfur.draw`'s very bits. Color, coverage,
    hair_alpha, body_alpha, type_alpha, orientation and strand_area are the means of all pictures, each with its own
    shadows, added up as linear light in steps of 2^-32, so that they are the same bits in any order. All other outputs,
    and hashes, are those of scenes[n // 2], drawn once more. Where strands are drawn by what they cover, and there are
    as many pictures as `Settings.samples`, each has one of these, at another place in the pixel.
    Other arguments and errors as for `clfur.draw`; with `Settings.seconds` each picture has its part of these.
    """
    scenes = _scenes(scenes)
    n, middle = len(scenes), scenes[len(scenes) // 2]
    outputs, settings, part = checked(middle, settings, outputs, region, before, stop)
    gpus, whole = schedulers(device), {"region": part, "before": before, "stop": stop}
    if n == 1:
        return drawn(gpus, middle, settings, outputs, hashes, **whole)
    if settings.seconds is not None:
        settings = attrs.evolve(settings, seconds=settings.seconds / n)
    means = [name for name in outputs if name in MEANS]
    others = [name for name in outputs if name not in MEANS or (hashes and name == "color")]   # light has hashes too
    found = [drawn(gpus, middle, settings, others, hashes, **whole)] if others or hashes or not means else []
    if means:
        found.append(_mean(gpus, scenes, settings, means, part, stop))
    images = {name: image for each in found for name, image in each.images.items()}
    return replace(found[-1], images={name: images[name] for name in outputs}, hashes=found[0].hashes, pictures=n,
                   **_sums(found))


def subframes(opened: Scene, closed: Scene, device: Any = None) -> int:
    """How many scenes `blurred` needs between two, 1 to 64: so many that no point of strands or corner of the body goes
    further than 1.5 pixels from one to the next.

    opened, closed: a `Scene` when the shutter opens and when it closes, of the same strands and faces. device: as for
    `clfur.render`. Points count whose way is before the camera, and no further beside the picture than it is large.
    Raises `clfur.Error` where strands or faces differ.
    """
    for name, scene in ("opened", opened), ("closed", closed):
        if not isinstance(scene, Scene):
            raise Error(f"subframes {name} is {shown(scene)}; allowed: a clfur.Scene")
    gpu, still = schedulers(device)[0], Settings(shadows="off", shadow_map=0)
    with gpu.frame():
        there = plan_before(closed.local, opened.seen_from(closed.origin), still)
        far = farthest(gpu, Plan(Rig.of(closed.local, still), (), before=there))
    return max(1, min(math.ceil(far / APART), MOST))


def _scenes(value):
    """Return scenes that can be one picture."""
    scenes = tuple(value) if isinstance(value, (tuple, list)) else ()
    if not 1 <= len(scenes) <= MOST or not all(isinstance(each, Scene) for each in scenes):
        raise Error(f"scenes is {shown(value)}; allowed: a list of 1 to {MOST} clfur.Scenes")
    sizes = {each.camera.size for each in scenes}
    if len(sizes) > 1:
        told = " and ".join(f"{width} x {height}" for width, height in sorted(sizes))
        raise Error(f"scenes have pictures of {told}; allowed: one size")
    return scenes


def _mean(gpus, scenes, settings, outputs, region, stop):
    """`Frame` of what is a mean."""
    n, gpu, frames, sums, aside = len(scenes), gpus[0], [], {}, 0
    for k, scene in enumerate(scenes):
        each, sample = _samples(scene, settings, k, n)
        frame = drawn(gpus, scene, each, outputs, stop=stop, region=region, sample=sample, aside=aside)
        if settings.goal:   # what the first one has chosen, the others take
            settings = frame.settings
        aside = sum(shutter.SUMS.bytes * image.size for image in frame.images.values())
        with gpu.frame(stop):
            for name, image in frame.images.items():
                sums[name] = shutter.add(gpu, gpu.upload(image), sums.get(name))
            images = {name: gpu.download(shutter.mean(gpu, each, n)) for name, each in sums.items() if k == n - 1}
            more = replace(frame, images={}, stages=gpu.seconds(), seconds=0.0, building=0.0)
        frames += [replace(frame, images={}), more]
    return replace(frames[-1], images=images, settings=settings, error=frames[0].error, why=frames[0].why,
                   **_sums(frames))


def _samples(scene, settings, k, n):
    """(Settings of picture k of n, the row of `layout.PATTERNS` where its only sample is, or None)."""
    if settings.raster != "coverage" or settings.goal or scene.strands is None or n < settings.samples:
        return settings, None
    places = max(each for each in PATTERNS if each <= n)
    return attrs.evolve(settings, samples=1), pattern_start(places) + k % places


def _sums(frames):
    """What several frames took together."""
    stages: dict[str, float] = {}
    for frame in frames:
        for name, spent in frame.stages.items():
            stages[name] = stages.get(name, 0.0) + spent
    return {"stages": stages, "seconds": sum(frame.seconds for frame in frames),
            "building": sum(frame.building for frame in frames), "memory": max(frame.memory for frame in frames)}
