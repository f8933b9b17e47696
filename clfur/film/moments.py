"""The scenes of a film's frames, and hashes of what they show."""

import functools
import inspect
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from ..cache import digest
from ..errors import Error, go_on, shown
from ..motion.motion import Motion
from ..motion.shutter import subframes
from ..scene import Scene, Strands, on_host
from ..scene.maps import planes
from ..scene.origin import copied
from .record import Record

LARGE = "mesh", "strands", "shells", "body_color", "environment"   # parts of scenes, which may take long to hash
EVERY = 24   # frames from one state of the motion that is kept to the next
OF_MOTION = [name for name in inspect.signature(Motion).parameters if name not in ("scene", "device", "fps")]


class Moments:
    """Scenes of the frames of a film, in their order.

    scene: a Scene, or a function of seconds that gives one. motion: None, or arguments of `Motion` beside scene,
    device and fps. gpu: a Scheduler for it. shutter: share of a frame's time in which it is open, up to the frame's
    moment; but frame 0 stands still. subframes: how many pictures that is, or "auto".
    """

    def __init__(self, scene: Any, motion: dict | None, fps: float, gpu: Any, shutter: float = 0.0,
                 subframes: int | str = "auto") -> None:
        self.fps, self._given, self._gpu, self._motion = fps, scene, gpu, motion
        self._subframes, self._shutter = subframes, shutter if callable(scene) or motion is not None else 0.0
        # Whoever asks for the same moment again gets the very same: it may take long to make.
        self._made = functools.lru_cache(maxsize=2)(scene) if callable(scene) else None
        self._parts: deque[tuple[Any, str]] = deque(maxlen=2 * len(LARGE))
        self._hashes: list[str] = []
        self._size: tuple[int, int] | None = None   # of all pictures

    def hash(self, number: int) -> str:
        """A hash of what a frame shows: of its scene, and with motion of those of all frames before."""
        if self._motion is None:
            opened = [number - self._shutter] if self._shutter and number else []
            return digest([self._digest(self._scene(each / self.fps)) for each in [*opened, number]])
        for each in range(len(self._hashes), number + 1):
            self._hashes.append(digest(self._hashes[-1:], self._digest(self._scene(each / self.fps))))
        return self._hashes[number]

    def scenes(self, numbers: Iterable[int], record: Record, tell: Callable[[int, int], None],
               stop: Callable[[], bool] | None = None) -> Iterator[tuple[int, tuple[Scene, ...]]]:
        """(number, the Scenes of which its picture is, without arrays on a device) of frames in rising order.

        tell: called with (frame that hair has come to, that it goes to), on its way to the first.  stop: as for
        `clfur.draw`.
        """
        if self._motion is None:
            for number in numbers:
                go_on(stop)
                yield number, self._taken(number, lambda back: self._scene((number - back) / self.fps))
            return
        motion, here = None, 0
        for number in numbers:
            if first := motion is None:
                motion = Motion(self._made or self._given, device=self._gpu, fps=self.fps, **self._motion)
                # With a shutter the step to a frame is looked into.
                if kept := record.state(number - (self._shutter > 0), self.hash):
                    here = kept[0]
                    motion.restore(kept[1])
            while here < number:
                motion.at(here + 1, stop)
                here += 1
                if first:
                    tell(here, number)
                if here % EVERY == 0:
                    record.put_state(here, motion.state(), self.hash(here))
            go_on(stop)
            yield number, self._taken(number, lambda back: self._within(motion, number, back))

    def _within(self, motion, number, back):
        return motion.between(1 - back) if back else motion.at(number)

    def _taken(self, number, at):
        """The Scenes of a frame, of which ``at`` gives one so many frames back."""
        if not (self._shutter and number):
            return (on_host(at(0)),)
        n = subframes(at(self._shutter), at(0), self._gpu) if self._subframes == "auto" else self._subframes
        return tuple(on_host(at(self._shutter * (1 - (k + 0.5) / n))) for k in range(n))

    def _scene(self, seconds):
        scene = self._given if self._made is None else self._made(seconds)
        if not isinstance(scene, Scene):
            where = "scene" if self._made is None else f"scene({seconds:g})"
            raise Error(f"{where} is {shown(scene)}; allowed: a clfur.Scene, or a function of seconds that gives one")
        if (size := tuple(scene.camera.size)) != (self._size or size):
            raise Error(f"scene({seconds:g}) has a picture of {size[0]} x {size[1]}, but others of the film have "
                        f"{self._size[0]} x {self._size[1]}; allowed: one size")
        self._size = size
        return scene

    def _digest(self, scene):
        """A hash of a Scene, by what it holds."""
        parts = {name: getattr(scene, name) for name in LARGE}
        strands, combed = parts["strands"], None
        if isinstance(strands, Strands) and strands.comb is not None and strands.comb.direction.per == "function":
            combed = planes(scene.mesh, strands.maps, strands.comb)   # what it says, not where it lies in memory
            parts["strands"] = copied(strands, comb=None)
        rest = copied(scene, fur=None, **dict.fromkeys(LARGE))
        return digest([self._of_part(part) for part in parts.values()], combed, rest)

    def _of_part(self, part):
        """A hash of a part of scenes, which may be the very same in many of them."""
        for each, known in self._parts:
            if each is part:
                return known
        self._parts.append((part, digest(part)))
        return self._parts[-1][1]
