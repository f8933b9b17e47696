"""The scenes of a film's frames, and hashes of what they show."""

import functools
from collections.abc import Callable
from typing import Any

from ..cache import digest
from ..errors import Error, shown
from ..motion.motion import Motion
from ..scene import Scene, Strands
from ..scene.maps import planes
from ..scene.origin import copied
from ..shutter import subframes

STATES = 24   # frames from one state of the motion that is kept to the next


class Moments:
    """Scenes of the frames of a film, in their order.

    scene: a Scene, or a function of seconds that gives one. motion: None, or keyword arguments of `Motion`. shutter:
    share of a frame in which it is open, up to the frame's moment; 0: none. blur: how many pictures of that time make a
    frame, or "auto".
    """

    def __init__(self, scene: Any, motion: dict | None, fps: float, shutter: float, blur: Any, gpu: Any) -> None:
        self._fps, self._shutter, self._blur, self._gpu = fps, shutter, blur, gpu
        self._given = scene
        # Whoever asks for the same moment gets the very same: it may take long to make.
        self._at = functools.lru_cache(maxsize=2)(scene if callable(scene) else lambda _: scene)
        self._of_part = functools.lru_cache(maxsize=4)(_hash)
        self._hashes: dict[int, str] = {}
        self.motion = None if motion is None else Motion(self._at if callable(scene) else scene, device=gpu, fps=fps, **motion)
