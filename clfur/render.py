"""The order of the stages: one straight line from a scene to its picture."""

import hashlib
import threading
import time
from dataclasses import dataclass

import numpy as np

from . import layout
from .device import choose, describe
from .errors import Error
from .fur import Curves, Strands, hair_bounds
from .scene import Scene
from .scheduler import Scheduler
from .settings import Settings
from .stages import shade
from .stages.raster import raster
from .stages.strands import bring, grow, no_strands
from .stages.tessellate import no_surface, tessellate
from .stages.voxelize import depths_for, most_of, own_share, unit_for, voxelize
from .stages.zscan import zscan
from .views import grid_of, light_of, light_view_of, view_of

OUTPUTS = {"color": 4, "depth": None, "id": None, "tangent": 3, "normal": 3, "uv": 2, "coverage": None}


@dataclass(frozen=True)
class Frame:
    """A picture, and what it took.

    images: {output: array}; see `render`.  triangles, strands, segments: what was drawn.  device: its name.
    seconds: the whole frame, reading back included.  stages: {kernel file: seconds on the device}.
    memory: most bytes that its arrays took on the device at once.  hashes: SHA-256 of what integer stages gave,
    {"visibility": ..., "voxels": ..., "shadow_map": ...}, if asked for.
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


def render(scene, device=None, settings=None, outputs=None):
    """Draw a `Scene` -> float32 [height, width, 4]: linear, premultiplied, coverage in alpha.

    ``device``: what `Scheduler` accepts, or a `Scheduler` to keep between frames.  ``outputs``: names of pictures to
    return as {name: array} instead: "color" as above, "depth" float32 [h, w] (distance along the view axis, inf
    where nothing is), "id" int32 [h, w] (strand, -1 nothing, -2 body), "tangent" and "normal" float32 [h, w, 3],
    "uv" float32 [h, w, 2], "coverage" float32 [h, w]; all but color and coverage tell of a pixel's nearest sample.
    Raises `clfur.Error` for an unknown device or output, and for a picture that the device cannot hold.
    """
    frame = draw(scene, device, settings, ("color",) if outputs is None else outputs)
    return frame.images["color"] if outputs is None else frame.images


def draw(scene, device=None, settings=None, outputs=("color",), hashes=False):
    """Draw a `Scene` and tell what it took -> `Frame`; arguments and errors as for `render`.

    ``hashes``: also hash the bits of the integer stages, which are the same on every device.
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
    gpu = device if isinstance(device, Scheduler) else _scheduler(device)
    began = time.perf_counter()
    gpu.start()

    mesh, fur = scene.mesh, scene.fur
    view = view_of(scene, settings.samples)
    body, strands = no_surface(gpu), no_strands(gpu)
    if mesh is not None and (scene.body_color is not None or isinstance(fur, Strands)):
        levels = (fur.inner, fur.outer, fur.surface) if isinstance(fur, Strands) else (1, 1, "flat")
        body = gpu.keep("body", (mesh, *levels), lambda: tessellate(gpu, mesh, *levels))
    if isinstance(fur, Strands):
        strands = gpu.keep("strands", (mesh, fur), lambda: grow(gpu, body, fur))
    elif isinstance(fur, Curves):
        strands = gpu.keep("strands", (fur,), lambda: bring(gpu, fur))
    if scene.body_color is None:
        body = no_surface(gpu)
    visible = raster(gpu, view, strands, body)
    digests = {"visibility": _digest(visible)} if hashes else {}
    images = {}
    if "color" in outputs:
        skin = (0, 0, 0) if scene.body_color is None else scene.body_color
        cost = settings.shadows, settings.grid, settings.shadow_map, settings.pcf
        shadows = gpu.keep("shadows", (mesh, fur, scene.light, int(scene.body_color is None), *cost, int(hashes)),
                           lambda: cast_shadows(gpu, scene, settings, strands, body, hashes))
        digests |= shadows.hashes
        images["color"] = shade.color(gpu, view, light_of(scene.light), settings.specular,
                                      visible, strands, body, skin, shadows)
    if set(outputs) - {"color"}:
        images |= shade.about(gpu, view, visible, strands, body)

    images = {name: np.ascontiguousarray(images[name].get()[..., :OUTPUTS[name]]) for name in outputs}
    seconds = time.perf_counter() - began
    points = strands.spans.get()[:, 1]
    return Frame(images, describe(gpu.device), len(body.triangles), int((points > 0).sum()),
                 int(np.maximum(points.astype(np.int64) - 1, 0).sum()), seconds, gpu.seconds(), gpu.peak, digests)


_here = threading.local()   # a scheduler belongs to one thread


def _scheduler(device):
    """The scheduler of a caller who keeps none: a new one for each call would cost its start and some memory."""
    device = choose(device)
    mine = _here.__dict__.setdefault("schedulers", {})
    gpu = mine.get(device) or mine.setdefault(device, Scheduler(device))
    gpu.forget()
    return gpu


def _digest(array):
    """SHA-256 of a device array's bytes."""
    return hashlib.sha256(np.ascontiguousarray(array.get())).hexdigest()


def cast_shadows(gpu, scene, settings, strands, body, hashes=False):
    """What of the scene stands before the light: hair in a grid, the body in a shadow map -> `shade.Shadows`."""
    none = shade.no_shadows(gpu)
    if settings.shadows == "off":
        return none
    packed = np.zeros((), layout.Shadow)
    digests = {}
    grid, sums, seen, seen_body = none.grid, none.sums, none.seen, none.map
    hairs = scene.fur.types if isinstance(scene.fur, Strands) else [scene.fur] if scene.fur else []
    depths = depths_for([hair.alpha for hair in hairs], settings.shadows)
    if len(strands.spans) and depths.any():
        method, grid = settings.shadows, grid_of(scene, settings.grid)
        unit = unit_for(most_of(grid, method, *hair_bounds(scene.fur, len(strands.spans))))
        weights = np.rint(unit * depths / depths.max()).astype(np.uint32)
        if min(weights[depths > 0]) < 4:
            raise Error(f"Settings.grid is {settings.grid}; allowed: fewer cells, less hair, hair types of more equal "
                        f"alpha or a spot with a wider angle, so that 32-bit counters can hold the hair's shadow")
        cells = voxelize(gpu, grid, strands, method, weights)
        sums = zscan(gpu, cells, unit)
        if hashes:
            digests["voxels"] = _digest(cells)
        packed["hair"] = depths.max(), *own_share(grid, method), method == "length"
    if len(body.triangles) and settings.shadow_map:
        seen = light_view_of(scene, settings.shadow_map)
        with gpu.called("shadow_map"):
            seen_body = raster(gpu, seen, None, body)
        packed["body"][:2] = 1, settings.pcf
        if hashes:
            digests["shadow_map"] = _digest(seen_body)
    return shade.Shadows(packed, grid, sums, seen, seen_body, digests)
