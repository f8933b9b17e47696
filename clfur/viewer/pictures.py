"""How frames and scenes show themselves in notebooks, which ask what a cell gives for `_repr_png_`."""

import os
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from ..budget import PRESETS
from ..device.scheduler import Scheduler
from ..device.selection import choose
from ..errors import Error, Stopped
from ..files.images import png_bytes
from ..render import Frame, render
from ..scene import Camera, Scene
from ..scene.origin import copied
from ..settings import Settings

SIZE = 320, 240   # of the picture of a scene, at most
CHEAP = PRESETS["preview"]

_kept: dict[Any, tuple] = {}   # of each device: a Scheduler, and a lock for who draws with it
_making = threading.Lock()


def device_of(device: Any) -> Any:
    """The OpenCL device that what `Scheduler` takes means, or that a Scheduler has: who made it may be drawing with it.
    Raises Error where there is none."""
    return device.device if isinstance(device, Scheduler) else choose(device)


@contextmanager
def _scheduler(device: Any) -> Iterator[Scheduler]:
    """The one Scheduler by which all of a notebook is drawn on an OpenCL device, for one thread at a time."""
    with _making:
        if device not in _kept:
            _kept[device] = Scheduler(device), threading.Lock()
    gpu, lock = _kept[device]
    with lock:
        yield gpu


def drawn(scene: Scene, settings: Settings, device: Any, stop: Callable[[], bool]) -> bytes | None:
    """The bytes of a PNG file of a Scene, drawn on an OpenCL device; None where ``stop`` has said True meanwhile."""
    try:
        with _scheduler(device) as gpu:
            picture = render(scene, gpu, settings, stop=stop)
    except Stopped:
        return None
    return None if stop() else png_bytes(picture)


def small(camera: Camera) -> Camera:
    """The same Camera with a picture of at most `SIZE`."""
    share = min(1.0, *(most / size for most, size in zip(SIZE, camera.size)))
    size = [max(round(share * each), 1) for each in camera.size]
    scale = np.diag([size[0] / camera.size[0], size[1] / camera.size[1], 1])
    return Camera.calibrated(camera.pose, scale @ camera.intrinsics, size)


def scene_png(scene: Scene, device: Any = None) -> bytes | None:
    """A small picture of a Scene, drawn here and now: the bytes of a PNG file. None without a device, and where it
    cannot be drawn, which is warned of; never an error, which would fail a cell that is right."""
    try:
        device = device_of(device)
    except Error:
        return None
    try:
        return drawn(copied(scene, camera=small(scene.camera)), CHEAP, device, lambda: False)
    except Exception as error:
        with suppress(RuntimeWarning):   # where warnings are errors
            warnings.warn(f"no picture of this Scene: {error}", RuntimeWarning, stacklevel=2)
        return None


def png_of(shown: Scene | Frame) -> bytes | None:
    """What a Scene or a Frame shows of itself in a notebook, or None."""
    if not wanted():
        return None
    if isinstance(shown, Scene):
        return scene_png(shown)
    return png_bytes(shown.images["color"]) if "color" in shown.images else None


def wanted() -> bool:
    """Whether frames and scenes show themselves: unless CLFUR_NOTEBOOK is "off"."""
    return os.environ.get("CLFUR_NOTEBOOK", "").strip().lower() != "off"
