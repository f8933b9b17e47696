"""One frame under way: bands of rows drawn and put together."""

import functools
import hashlib
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..device.team import Team
from ..scene import Scene
from ..scene.display import brief, repr_png
from ..settings import Settings
from ..stages import march, shells
from ..stages.blur import blur, blur_radius
from ..stages.lighting import unshadowed
from . import build, flow
from .mattes import TOLD, UNIT, positions
from .passes import Band, Coverage, Front, Samples
from .plan import Plan
from .views import Rig

# How many of four values of a pixel on the device are an output's, None: it has one; more are told on the host.
OUTPUTS = {"color": 4, "depth": None, "id": None, "tangent": 3, "normal": 3, "uv": 2, "coverage": None,
           "position": None} | dict.fromkeys(TOLD)
OF_TWO = {"motion_vector": 2}   # and those of a scene and another, which was before


@dataclass(frozen=True)
class Frame:
    """A picture, and what it took; in notebooks it shows itself.

    images: {output: array}; see `render`.  triangles, strands, segments: what was drawn.  device: its name, or
    those of all that did not fail.  seconds: the whole frame, reading back included; building: those of them that it
    waited for kernels to be built or loaded, in a device's first frames.  stages: {kernel file: seconds on the device}.
    memory: most bytes that its arrays took on the device at once.  hashes: SHA-256 of what integer stages gave,
    {"visibility": ..., "voxels": ..., "shadow_map": ...}, if asked for.  settings: what it was drawn with.  error: what
    `Settings.max_error` limits, as far as can be told without the truth; why: how the settings were chosen, in a line;
    None and "" if they were given.  pictures: how many it is the mean of, see `clfur.blurred`.
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
    building: float = 0.0
    pictures: int = 1
    __repr__ = brief
    _repr_png_ = repr_png


def draw_frame(team: Team, scene: Scene, settings: Settings, outputs: Sequence[str] = ("color",), hashes: bool = False,
               bands: list | None = None, region: tuple | None = None, before: Scene | None = None,
               sample: int | None = None, aside: int = 0) -> Frame:
    """Draw a scene by a `Team` -> `Frame`.

    ``bands``: [(first row, one past the last)] of the picture alone; the others hold anything.  ``region``: (column,
    row, columns, rows) that the images hold, of all if None.  ``before``: where motion vectors come from.  ``sample``:
    see `Rig.of`.  ``aside``: see `Plan`.
    """
    began = time.perf_counter()
    there = flow.plan_before(scene, before, settings) if before and "motion_vector" in outputs else None
    plan = Plan(Rig.of(scene, settings, sample), outputs, region, there, aside)
    picture = Picture(team, plan, outputs, hashes)
    team.each(functools.partial(build.let_go, plan))
    for top, end in bands or [(plan.top, plan.bottom)]:
        while top < end:
            top = picture.put(*team.first(functools.partial(draw_band, picture, top, end)))
    if "color" in outputs and plan.settings.blur != "off":   # what coverage is told of is not blurred
        team.first(picture.blur)
    seconds = time.perf_counter() - began
    for what in [*picture.warnings, *team.first(functools.partial(build.told, plan))]:
        warnings.warn(what, RuntimeWarning, stacklevel=5)
    return picture.frame(seconds)


def draw_band(picture: "Picture", top: int, end: int, gpu: Any) -> tuple:
    """Rows of a picture from ``top`` on, as many as fit the device, ``end`` at most
    -> ((first, one past the last), {output: array [rows, width(, n)]}, [bits to hash])."""
    plan, strands, lighting = picture.plan, picture.strands, None
    strands.count(gpu, top, end)
    if plan.wants_color:
        lighting, digests = build.lighting(gpu, picture.team, plan, picture.hashes)
        picture.digests |= digests
        build.sky(gpu, plan)   # before anything holds a part of the scene, as it takes all of them
        build.deep(gpu, plan, lighting)
    band = strands.rasterize(gpu, top, end)
    image = shell_transmittance = shell_front = None
    if plan.scene.shells:
        shell = build.shell(gpu, plan)
        any_light = lighting or unshadowed(gpu, *plan.rig.lights)   # which the other outputs do not see
        image, shell_transmittance, shell_front = march.march(gpu, band.view, *shell, any_light, band.visible,
                                                              build.sky(gpu, plan) if plan.wants_color else None)
    front = strands.resolve(gpu, band, lighting, image, shell_transmittance, shell_front)
    image, known = strands.shade(gpu, band, front, lighting)
    if plan.scene.shells and plan.others:
        shells.outputs(gpu, front.view, shell[0], front.keys, front.shell_transmittance, front.shell_front, known)
    if plan.before:
        known = known | {"motion_vector": flow.vectors(gpu, plan, strands.parts(gpu, band), front, known)}
    return picture.read(gpu, band, front, {"color": image, **known, **front.outputs})


class Picture:
    """What there is of a frame so far."""

    def __init__(self, team: Team, plan: Plan, outputs: Sequence[str], hashes: bool) -> None:
        self.team, self.plan, self.outputs, self.hashes = team, plan, outputs, hashes
        self.warnings = plan.warnings   # what is known to be wrong in the picture
        self.digests: dict[str, str] = {}
        self._images: dict[str, np.ndarray] = {}
        self._areas = np.zeros(plan.strands if "strand_area" in outputs else 0)
        self.strands = (Coverage if plan.uses_coverage else Samples)(plan, team)
        self._visibility = [hashlib.sha256() for _ in range(self.strands.digests)]

    def read(self, gpu: Any, band: Band, front: Front, found: dict) -> tuple:
        """What `draw_band` gives: the outputs that are ``found``, on the host."""
        numbers = OUTPUTS | OF_TWO
        images = {name: np.ascontiguousarray(gpu.download(found[name])[..., :numbers[name]]) for name in self.outputs
                  if name in found}
        if "position" in self.outputs:
            depth = images["depth"] if "depth" in images else gpu.download(found["depth"])
            images["position"] = positions(self.plan.scene.camera, depth, self.plan.left, band.rows[0])
        if self.plan.tells:
            images |= self.strands.tell(gpu, band, front)
        if self.plan.seen_through and "coverage" in images:   # what color's alpha is
            images["coverage"] = np.ascontiguousarray(gpu.download(found["color"])[..., 3])
        return band.rows, images, self.strands.hashed(gpu, band, front) if self.hashes else []

    def put(self, rows: tuple[int, int], images: dict, bits: list) -> int:
        """Put rows where they belong -> the row after them."""
        height, first = self.plan.size[1], self.plan.top
        for digest, each in zip(self._visibility, bits):
            digest.update(each)
        if "strand_area" in images:
            self._areas += images.pop("strand_area")
        for name, image in images.items():
            if len(image) == height:
                self._images[name] = image
            else:   # each into its place at once: to join them in the end would take twice the memory
                whole = self._images.setdefault(name, np.empty((height, *image.shape[1:]), image.dtype))
                whole[rows[0] - first:rows[1] - first] = image
        return rows[1]

    def blur(self, gpu: Any) -> None:
        """Blur the colour, with as many rows on the device at a time as fit."""
        picture, settings, rows = self._images["color"], self.plan.settings, self.plan.rows_to_blur(gpu)
        height, radius = len(picture), blur_radius(settings.blur_sigma)
        each, result = height if rows >= height else max(rows - 2 * radius, 1), np.empty_like(picture)
        for top in range(0, height, each):
            end = min(top + each, height)
            low, high = max(top - radius, 0), min(end + radius, height)
            strip = gpu.upload(picture[low:high])
            result[top:end] = gpu.download(
                blur(gpu, strip, settings.blur_sigma, settings.blur == "edges", (top - low, end - low)))
        self._images["color"] = result

    def frame(self, seconds: float) -> Frame:
        """The `Frame`, after so many seconds."""
        plan, team = self.plan, self.team
        if "strand_area" in self.outputs:
            self._images["strand_area"] = (self._areas / UNIT).astype(np.float32)
        if self.hashes:
            whole = b"".join(digest.digest() for digest in self._visibility)
            self.digests["visibility"] = hashlib.sha256(whole).hexdigest()
        strands, segments = team.first(self._tally)
        stages: dict[str, float] = {}
        for of_one in team.each(_seconds):   # not of those that were dropped: a lost device tells nothing
            for name, spent in of_one.items():
                stages[name] = stages.get(name, 0.0) + spent
        images = self._images
        if plan.size != plan.region[2:]:
            images = {name: image if name == "strand_area" else np.ascontiguousarray(image[plan.wanted(plan.top)])
                      for name, image in images.items()}
        names, memory = " + ".join(gpu.name for gpu in team.gpus), sum(gpu.peak for gpu in team.gpus)
        triangles = plan.triangles if plan.body else 0
        images = {name: images[name] for name in self.outputs}
        return Frame(images, names, triangles, strands, segments, seconds, stages, memory, self.digests,
                     plan.settings, building=max(gpu.held_up for gpu in team.gpus))

    def _tally(self, gpu):
        found = [build.tally(gpu, self.plan, part) for part in self.plan.parts(gpu)]
        return sum(strands for strands, _ in found), sum(segments for _, segments in found)


def _seconds(gpu):
    return gpu.seconds()
