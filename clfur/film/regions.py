"""One picture, drawn region by region on a cluster."""

import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from ..render import Frame, draw
from ..scene import Scene
from ..settings import Settings
from .cluster import drawn

EACH = 8      # rows that are drawn together, whatever part of them is wanted
PIECES = 24   # regions of a picture: a few for each of some workers, as some hold more than others


@attrs.frozen(eq=False)
class Region:
    """A region of a picture that is to be drawn: its number, (x, y, width, height), and arguments of `clfur.draw`."""

    number: int
    region: tuple[int, int, int, int]
    scene: Scene
    settings: Settings
    outputs: tuple[str, ...]

    def draw(self, device: Any) -> Frame:
        """Its `Frame`."""
        return draw(self.scene, device, self.settings, self.outputs, region=self.region)


def picture(scene: Scene, cluster: str, settings: Settings | None = None, outputs: Sequence[str] = ("color",),
            region: Sequence[int] | None = None, device: Any = None) -> Frame:
    """Draw a `Scene` by the workers of a cluster -> its `Frame`, with the same bits as `clfur.draw` gives.

    cluster: as for `clfur.film`; device: of "local". Other arguments as for `clfur.draw`. Seconds of the frame are
    those that it took here, those of its stages are of all workers. Raises `clfur.Error` as these do, and for what
    only the whole picture tells: the output "strand_area", and settings that are to be chosen.
    """
    settings, outputs = Settings() if settings is None else settings, tuple(outputs)
    if settings.goal:
        raise Error("settings that are chosen by max_error or seconds differ between machines; allowed with a cluster: "
                    "given ones")
    if "strand_area" in outputs:
        raise Error("strand_area is a sum over the picture; allowed with a cluster: other outputs")
    began = time.perf_counter()
    left, top, width, height = region or (0, 0, *scene.camera.size)
    jobs = [Region(number, (left, first, width, end - first), scene, settings, outputs)
            for number, (first, end) in enumerate(rows(top, top + height))]
    images: dict[str, np.ndarray] = {}
    frames = []
    for job, frame in drawn(jobs, cluster, device, (Scene,), "region"):
        for name, image in frame.images.items():
            if name not in images:
                images[name] = np.empty((height, *image.shape[1:]), image.dtype)
            first = job.region[1] - top
            images[name][first:first + len(image)] = image
        frames.append(replace(frame, images={}))
    stages = {name: sum(frame.stages.get(name, 0.0) for frame in frames) for frame in frames for name in frame.stages}
    return replace(
        frames[0], images={name: images[name] for name in outputs}, seconds=time.perf_counter() - began, stages=stages,
        device=" + ".join(sorted({frame.device for frame in frames})), memory=max(frame.memory for frame in frames),
        building=max(frame.building for frame in frames))


def rows(top: int, end: int) -> list[tuple[int, int]]:
    """Cut rows into `PIECES` of about the same height, (first, one past the last), between tiles of `EACH`."""
    step = -(-(end - top) // (PIECES * EACH)) * EACH
    cuts = [top, *range(-(-(top + 1) // EACH) * EACH, end, step), end]
    return [*pairwise(cuts)]
