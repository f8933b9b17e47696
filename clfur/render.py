"""The order of the stages: one straight line from a scene to its picture."""

import time
from dataclasses import dataclass

import numpy as np

from . import layout
from .device import describe
from .errors import Error
from .scene import Curves, Scene, Strands, extent
from .scheduler import Scheduler
from .settings import Settings
from .stages import shade
from .stages.raster import raster
from .stages.strands import bring, grow, no_strands
from .stages.tessellate import no_surface, tessellate

OUTPUTS = {"color": 4, "depth": None, "id": None, "tangent": 3, "normal": 3, "uv": 2, "coverage": None}


@dataclass(frozen=True)
class Frame:
    """A picture, and what it took.

    images: {output: array}; see `render`.  triangles, strands, segments: what was drawn.  device: its name.
    seconds: the whole frame, reading back included.  stages: {kernel file: seconds on the device}.
    """

    images: dict
    device: str
    triangles: int
    strands: int
    segments: int
    seconds: float
    stages: dict


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


def draw(scene, device=None, settings=None, outputs=("color",)):
    """Draw a `Scene` and tell what it took -> `Frame`; arguments and errors as for `render`."""
    outputs = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    for name in outputs:
        if name not in OUTPUTS:
            raise Error(f"there is no output {name!r}; allowed: {', '.join(OUTPUTS)}")
    if not isinstance(scene, Scene):
        raise Error(f"scene is {scene!r:.60}; allowed: a clfur.Scene")
    settings = settings or Settings()
    gpu = device if isinstance(device, Scheduler) else Scheduler(device)
    began = time.perf_counter()
    gpu.start()

    mesh, fur = scene.mesh, scene.fur
    view = view_of(scene, settings.samples)
    body, strands = no_surface(gpu), no_strands(gpu)
    if mesh is not None and (scene.body_color is not None or isinstance(fur, Strands)):
        levels = (fur.inner, fur.outer, fur.surface) if isinstance(fur, Strands) else (1, 1, "flat")
        body = gpu.keep("body", (mesh, *levels), lambda: tessellate(gpu, mesh, *levels))
    if isinstance(fur, Strands):
        strands = gpu.keep("strands", (body, fur), lambda: grow(gpu, body, fur))
    elif isinstance(fur, Curves):
        strands = gpu.keep("strands", (fur,), lambda: bring(gpu, fur))
    if scene.body_color is None:
        body = no_surface(gpu)
    visible = raster(gpu, view, strands, body)
    images = {}
    if "color" in outputs:
        skin = (0, 0, 0) if scene.body_color is None else scene.body_color
        images["color"] = shade.color(gpu, view, light_of(scene.light), settings.specular, visible, strands, body, skin)
    if set(outputs) - {"color"}:
        images |= shade.about(gpu, view, visible, strands, body)

    images = {name: np.ascontiguousarray(images[name].get()[..., :OUTPUTS[name]]) for name in outputs}
    seconds = time.perf_counter() - began
    points = strands.spans.get()[:, 1]
    return Frame(images, describe(gpu.device), len(body.triangles), int((points > 0).sum()),
                 int(np.maximum(points.astype(np.int64) - 1, 0).sum()), seconds, gpu.seconds())


def view_of(scene, samples):
    """The camera as a `layout.View`; its near plane stands just before all that can be seen."""
    camera = scene.camera
    center, radius = extent(scene.mesh, scene.fur)
    pose, k = camera.pose, camera.intrinsics
    # Camera axes right, down, forward: forward is the distance that "depth" tells.
    world_to_camera = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(pose)
    distance = (world_to_camera @ [*center, 1.0])[2]
    radius = radius or abs(distance) or 1.0
    near = max(distance - 1.01 * radius, 1e-3 * radius)
    to_screen = np.zeros((4, 4))
    to_screen[:2] = k[:2, :3] @ world_to_camera[:3]
    to_screen[2, 3] = near
    to_screen[3] = world_to_camera[2]
    view = np.zeros((), layout.View)
    view["to_screen"] = to_screen.T
    view["to_world"] = np.linalg.inv(to_screen).T
    view["eye"] = *pose[:3, 3], 1
    view["size"] = *camera.size, samples, layout.pattern_start(samples)
    view["scale"][0] = np.sqrt(k[0, 0] * k[1, 1])
    return view


def light_of(light):
    """A `clfur.Light` as a `layout.Light`."""
    packed = np.zeros((), layout.Light)
    packed["direction"][:3] = light.direction
    packed["color"] = *light.color, light.ambient
    return packed
