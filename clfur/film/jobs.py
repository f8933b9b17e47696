"""Frames of a film as they are drawn: a job holds all that one needs, on this machine or another."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from ..files.images import encoded
from ..motion.shutter import blurred
from ..render import draw
from ..scene import Scene, over
from ..settings import Settings


@attrs.frozen(eq=False)
class Job:
    """A frame of a film that is to be drawn; it can be pickled.

    number: of the frame. scenes: Scenes without arrays on a device, whose pictures count alike: one, or those of a
    shutter that is open (`clfur.blurred`). settings: `Settings`. suffix: ".png" or ".exr", the file that it becomes.
    background: linear RGB [3] that it is laid over, or None: it has alpha.
    """

    number: int
    scenes: tuple[Scene, ...]
    settings: Settings
    suffix: str
    background: np.ndarray | None = None

    def draw(self, device: Any, stop: Callable[[], bool] | None = None) -> bytes:
        """The bytes of the frame's file; device, stop and errors: as for `clfur.draw`."""
        scene = self.scenes[len(self.scenes) // 2]
        if len(self.scenes) == 1:
            image = draw(scene, device, self.settings, stop=stop).images["color"]
        else:
            image = blurred(self.scenes, device, self.settings, stop=stop).images["color"]
        if self.background is not None:
            image = over(image, self.background)
        return encoded(self.suffix, image, scene.camera, self.settings)


def alone(jobs: Iterable[Job], device: Any, stop: Callable[[], bool] | None = None) -> Iterator[tuple[int, bytes]]:
    """Draw jobs one after the other here -> (number, bytes of the frame's file) of each; an Error tells which it is
    of."""
    for job in jobs:
        try:
            yield job.number, job.draw(device, stop)
        except Error as error:
            raise type(error)(f"frame {job.number}: {error}") from error
