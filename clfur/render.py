"""The order of the stages: one straight line from a scene to its picture."""

import functools
import hashlib
import threading
import time
import warnings
from contextlib import ExitStack
from dataclasses import dataclass, replace

import attrs
import numpy as np

from . import budget
from .device.scheduler import Scheduler
from .device.selection import choose
from .device.team import Team
from .errors import Error
from .parts import Work
from .scene import Scene, highlighted
from .settings import Settings
from .shadows import cast, plan_shadows, settle
from .stages import coverage, march, shade, shells
from .stages.blur import blur, reach_of
from .stages.raster import raster
from .views import band_of, light_of, one_sample, view_of

OUTPUTS = {"color": 4, "depth": None, "id": None, "tangent": 3, "normal": 3, "uv": 2, "coverage": None}


@dataclass(frozen=True)
class Frame:
    """A picture, and what it took.

    images: {output: array}; see `render`.  triangles, strands, segments: what was drawn.  device: its name, or
    those of all that did not fail.  seconds: the whole frame, reading back included.  stages: {kernel file: seconds
    on the device}.
    memory: most bytes that its arrays took on the device at once.  hashes: SHA-256 of what integer stages gave,
    {"visibility": ..., "voxels": ..., "shadow_map": ...}, if asked for.  settings: what it was drawn with.  error: what
    `Settings.max_error` limits, as far as can be told without the truth; why: how the settings were chosen, in a line;
    None and "" if they were given.
    """

    images: dict
    device: str
    triangles: int
    strands: int
    segments: int
    seconds: float
    stages: dict
    memory: int
    hashes: dict
    settings: Settings | None = None
    error: float | None = None
    why: str = ""


def render(scene, device=None, settings=None, outputs=None):
    """Draw a `Scene` -> float32 [height, width, 4]: linear, premultiplied, coverage in alpha.

    ``device``: what `Scheduler` accepts, or a `Scheduler` to keep between frames, or a list of these, which then draw
    the frame together: they share the strands' shadows by speed (and with `Settings.raster` "samples" what is seen),
    and the picture is the same.  ``outputs``: names of pictures to return as {name: array} instead: "color" as above,
    "depth" float32 [h, w] (distance along the view axis, inf where nothing is), "id" int32 [h, w] (strand, -1 nothing,
    -2 body, -3 shells), "tangent" and "normal" float32 [h, w, 3], "uv" float32 [h, w, 2], "coverage" float32 [h, w].
    All but color and coverage tell of what fills most of a pixel, with raster "samples" of its nearest sample.  Of
    shells they tell where half of the light from behind is gone; coverage is what color's alpha is.
    Raises `clfur.Error` for an unknown device or output, and for a picture that the device cannot hold.
    """
    frame = draw(scene, device, settings, ("color",) if outputs is None else outputs)
    return frame.images["color"] if outputs is None else frame.images


def draw(scene, device=None, settings=None, outputs=("color",), hashes=False):
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
            raise Error(f"there is no output {name!r}; allowed: {', '.join(OUTPUTS)}")
    if not isinstance(scene, Scene):
        raise Error(f"scene is {scene!r:.60}; allowed: a clfur.Scene")
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise Error(f"settings is {settings!r:.60}; allowed: a clfur.Settings")
    gpus = schedulers(device)
    with ExitStack() as frames:
        for gpu in gpus:
            frames.enter_context(gpu.frame())
        team = Team(gpus)
        drawn = scene
        if settings.specular is not None:   # as once all looks had it
            drawn = attrs.evolve(scene, fur=highlighted(scene.fur, settings.specular))
        if not settings.goal:
            return _draw(team, drawn, settings, outputs, hashes)
        chosen = budget.choose(team, scene, settings, functools.partial(_draw, team, drawn))
        for gpu in team.gpus:
            gpu.start()
        return replace(_draw(team, drawn, chosen.settings, outputs, hashes), error=chosen.error, why=chosen.why)


def _draw(team, scene, settings, outputs=("color",), hashes=False, bands=None):
    """``bands``: [(first row, one past the last)] of the picture alone; the others hold anything."""
    began, gpus = time.perf_counter(), team.gpus[:]
    if not np.any(scene.light.color):   # what stands before a light that is out cannot matter
        settings = attrs.evolve(settings, shadows="off")
    digests = {}
    work = Work(gpus[0], scene)
    for gpu in gpus:
        gpu.load((settings, scene.camera.size, work.faces, work.strands, work.points,
                  scene.shells and scene.shells.layers))
    others, lit = set(outputs) - {"color"}, "color" in outputs
    covering = work.covering(settings)
    whole = view_of(scene, settings.samples)
    width, height = scene.camera.size
    light, skin = light_of(scene.light), (0, 0, 0) if scene.body_color is None else scene.body_color
    # The report's methods count strands, however wide: they take all there are.
    shadow_lod = settings.lod if settings.shadows == "length" else 0.0

    def lit_by(lod):
        """What light depends on that falls on strands thinned so: the camera only where they are thinned for it."""
        return (scene.mesh, scene.strands, scene.shells, scene.light, int(work.body), settings.shadows, settings.grid,
                settings.shadow_map, settings.pcf, str(lod), scene.camera if lod else None)

    def known_light(gpu):
        """{"reached": how much light reaches strands}, if that is known; it goes with what it depends on."""
        return gpu.keep("lit", (*lit_by(settings.lod), settings.raster), dict)
    for gpu in gpus:
        known_light(gpu)   # what is out of date goes now, before anything new is made
    row_pieces = 0      # of strands in the fullest row that did not fit
    cut_short = set()   # what is wrong where a device has ended a loop before its time

    @functools.cache
    def plan(gpu, strands=None, body=True):
        return work.plan(gpu, settings, bool(others), strands, body, row_pieces)

    def make(gpu, part, lod=settings.lod):
        return work.make(gpu, part, lod)

    def look(view, gpu, strands=None, body=True):
        """Depth and id of what is nearest in each sample; of the body alone where strands are transparent."""
        visible = None
        for part in plan(gpu, strands, body)[0]:
            visible = raster(gpu, view, *opaque(*make(gpu, part)), visible)
        return [visible]

    def opaque(hair, skin):   # no name here may outlive a part: it must go before the next one is made
        return None if covering else hair, skin

    def shadows_on(gpu):
        """Shadows, or those of the frame before if only the camera has moved."""
        furred = scene.shells is not None and settings.shadows != "off"

        def build():
            bounds = shells.bounds_of(gpu, work.make_shell(gpu, settings)[0]) if furred else None
            planned = plan_shadows(scene, settings, work.strands, work.body, bounds)

            def before_light(gpu, strands, body):
                counted = None, None
                # With the body, shells are in one device's share, and there in the first part.
                shell = work.make_shell(gpu, settings) if furred and body else None
                for part in plan(gpu, strands, body)[0]:
                    counted = cast(gpu, planned, *make(gpu, part, shadow_lod), *counted, shell)
                    shell = None
                return counted

            add = np.maximum if settings.shadows == "binary" else np.add
            cells, seen = team.gather("cast", before_light, [add, np.minimum], work.strands)
            told = {"voxels": cells, "shadow_map": seen} if hashes else {}
            told = {name: hashlib.sha256(_bytes(gpu, array)).hexdigest()
                    for name, array in told.items() if array is not None}
            return settle(gpu, planned, *(on(gpu, array) for array in (cells, seen))), told
        return gpu.keep("shadows", (*lit_by(shadow_lod), int(hashes)), build)

    def reached_on(gpu, hair, shadows):
        """How much light reaches strands: in one part they are all there, and it stays for other rows and cameras."""
        known = known_light(gpu) if len(plan(gpu)[0]) == 1 else {}
        if gpu.steps and work.longest * (2 * settings.pcf + 2) ** 2 > gpu.steps:
            cut_short.add(f"{gpu.name} ends long loops: light is wrong on strands of {work.longest:,} points with "
                          f"Settings.pcf {settings.pcf}")
        if "reached" not in known:
            known["reached"] = coverage.reach(gpu, light, hair, shadows)
        return known["reached"]

    def pictures(view, visible, gpu):
        """{output: array} of a view's rows, and under "seen" what its integers gave; how many pieces, if too many."""
        if len(plan(gpu)[0]) > 1:
            known_light(gpu).clear()   # what a smaller picture in one part has left
        # Transparent strands aren't shared: whoever draws them looks for itself, also after another was lost.
        visible = look(view, gpu)[0] if covering else on(gpu, visible)
        parts, shadows = plan(gpu)[0], None
        image = through = fur = known = None
        if lit:
            shadows, told = shadows_on(gpu)
            digests.update(told)
        if scene.shells:
            shell, packed = work.make_shell(gpu, settings)
            image, through, fur = march.march(gpu, view, shell, packed, light, visible, shadows)
        seen = view, visible, through, fur
        if covering:
            pixels, lights = coverage.bound(gpu, visible), None
            for part in parts:
                coverage.count(gpu, view, make(gpu, part)[0], pixels)
            counted = gpu.download(pixels)
            light_to_come = 0 if "reached" in known_light(gpu) else 4 * work.points
            if work.too_many(gpu, settings, counted, plan(gpu), row_pieces, light_to_come):
                return int(counted[..., 1].sum(dtype=np.int64))
            fragments = coverage.room_for(gpu, counted)
            for part in parts:
                coverage.gather(gpu, view, make(gpu, part)[0], fragments)
            resolved = coverage.resolve(gpu, visible, fragments, through, fur)
            if gpu.steps and coverage.steps_of(counted[..., 1], gpu.download(resolved.used)) > gpu.steps:
                cut_short.add(f"{gpu.name} ends long loops: strands are missing where thousands lie in a pixel; "
                              "Settings.lod makes them fewer")
            through = resolved.through
            seen = one_sample(view), resolved.seen, resolved.alpha, resolved.seen_fur

            def add(hair, lights):
                reached = reached_on(gpu, hair, shadows) if settings.shadows != "off" else None
                return coverage.light(gpu, view, light, fragments, resolved, hair, reached, lights)
            for part in parts if lit else []:
                lights = add(make(gpu, part)[0], lights)
            image = coverage.blend(gpu, lights, resolved, image) if lit else None
        if lit:
            # Part by part each sample of a pixel is added in its turn, so that the sum is the same bits.
            for sample in range(settings.samples) if len(parts) > 1 else [None]:
                for part in parts:
                    image = shade.color(gpu, view, light, visible, *make(gpu, part), skin,
                                        shadows, image, None if sample is None else (sample, sample + 1), through)
        for part in parts if others else []:
            known = shade.about(gpu, *seen[:2], *make(gpu, part), known)
        if scene.shells and others:
            known = shells.about(gpu, seen[0], shell, seen[1], *seen[2:], known)
        if covering and others:
            known["coverage"] = resolved.alpha
        found = {"color": image, **(known or {})}
        bands = {name: np.ascontiguousarray(gpu.download(found[name])[..., :OUTPUTS[name]]) for name in outputs}
        if hashes:
            # What shells let through differs in the last bits, and with it what is seen of strands among them.
            bands["seen"] = [_bytes(gpu, array) for array in (
                (visible,) if not covering else (visible, counted) if scene.shells else
                (resolved.seen, resolved.alpha))]
        return bands

    rows = min(team.each(lambda gpu: plan(gpu)[1]))
    images, seen = {}, [hashlib.sha256() for _ in range(2 if covering else 1)]
    todo = [(top, min(top + rows, until)) for first, until in bands or [(0, height)]
            for top in range(first, until, rows)]
    while todo:
        top, end = todo.pop(0)
        view = band_of(whole, top, end)
        visible = None
        if not covering:
            visible, = team.gather("look", functools.partial(look, view), [np.minimum], work.strands)
        drawn = team.first(functools.partial(pictures, view, visible))
        if isinstance(drawn, int):
            if end - top > 1:
                middle = (top + end) // 2
                todo = [(top, middle), (middle, end), *todo]
                continue
            row_pieces = drawn   # smaller parts of the scene leave room for it, or there is none
            plan.cache_clear()
            rows = min(team.each(lambda gpu: plan(gpu)[1]))
            todo = [(a, min(a + rows, b)) for first, b in [(top, end), *todo] for a in range(first, b, rows)]
            continue
        for digest, band in zip(seen, drawn.pop("seen", [])):
            digest.update(band)
        for name, band in drawn.items():
            if len(band) == height:
                images[name] = band
            else:   # each into its place at once: to join them in the end would take twice the memory
                images.setdefault(name, np.empty((height, *band.shape[1:]), band.dtype))[top:end] = band
    if lit and settings.blur != "off":
        images["color"] = team.first(functools.partial(_blurred, images["color"], settings, rows))
    if hashes:
        digests["visibility"] = hashlib.sha256(b"".join(digest.digest() for digest in seen)).hexdigest()
    seconds = time.perf_counter() - began
    for what in cut_short:
        warnings.warn(what, RuntimeWarning, stacklevel=4)

    points = team.first(lambda gpu: [_points(gpu, make(gpu, part)[0]) for part in plan(gpu)[0]])
    stages = {}
    for of_one in team.each(lambda gpu: gpu.seconds()):   # not of those that were dropped: a lost device tells nothing
        for name, spent in of_one.items():
            stages[name] = stages.get(name, 0.0) + spent
    return Frame(images, " + ".join(gpu.name for gpu in team.gpus), int(work.triangles[-1]) if work.body else 0,
                 sum(strands for strands, _ in points), sum(segments for _, segments in points), seconds, stages,
                 sum(gpu.peak for gpu in team.gpus), digests, settings)


def _blurred(picture, settings, rows, gpu):
    """A picture blurred, with so many of its rows on the device at a time, or the fewest that it takes."""
    height, reach = len(picture), reach_of(settings.blur_sigma)
    each, result = height if rows >= height else max(rows - 2 * reach, 1), np.empty_like(picture)
    for top in range(0, height, each):
        end = min(top + each, height)
        low, high = max(top - reach, 0), min(end + reach, height)
        strip = gpu.upload(picture[low:high])
        result[top:end] = gpu.download(
            blur(gpu, strip, settings.blur_sigma, settings.blur == "edges", (top - low, end - low)))
    return result


def on(gpu, array):
    """An array on the device: it is there already, or comes from the host; None stays None."""
    return gpu.upload(array) if isinstance(array, np.ndarray) else array


def _points(gpu, strands):
    """(strands that are not bald, segments)."""
    points = gpu.download(strands.spans)[:, 1].astype(np.int64)
    return int((points > 0).sum()), int(np.maximum(points - 1, 0).sum())


def _bytes(gpu, array):
    return np.ascontiguousarray(array if isinstance(array, np.ndarray) else gpu.download(array))


def schedulers(device):
    """The `Scheduler`s that ``device`` means; one or, for a list, several different ones."""
    several = device if isinstance(device, (list, tuple)) else [device]
    gpus = [one if isinstance(one, Scheduler) else _scheduler(one) for one in several]
    if not gpus or len(set(gpus)) < len(gpus):
        raise Error(f"device is {device!r:.200}; allowed: a device, or a list of different ones")
    return gpus


_here = threading.local()   # a scheduler belongs to one thread


def _scheduler(device):
    """The scheduler of a caller who keeps none: a new one for each call would cost its start and some memory."""
    device = choose(device)
    mine = _here.__dict__.setdefault("schedulers", {})
    gpu = mine.get(device) or mine.setdefault(device, Scheduler(device))
    gpu.forget()
    return gpu
