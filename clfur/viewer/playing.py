"""Time that goes on while somebody looks: hair that moves, and scenes that are functions of time."""

import threading
import time
from collections.abc import Callable
from typing import Any

import attrs

from ..cache import digest
from ..motion.motion import Motion
from ..scene import Scene, Strands

LONGEST = 1 / 12   # seconds of one step: what is slower to draw goes slower
LEAST = 1e-4       # seconds below which nothing is moved
# Of a hair type, what has no say in how it grows and moves: hair stays where it is while these are changed.
LOOKS = {"color", "color_texture", "color_variation", "alpha", "root_color", "tip_color", "width", "root_width",
         "tip_width", "taper", "_look", "_specular", "_exponent"}


class Player:
    """Plays a document's state; `advance` is for one thread, the one that draws, all else for any."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock, self._turn = clock, threading.RLock(), threading.Lock()
        self._run = 0   # rises when all begins anew
        self._clear()

    def _clear(self) -> None:
        self.playing, self.time = False, 0.0
        self._last: float | None = None
        self._moved: Scene | None = None
        self._motion: Motion | None = None
        self._state: Any = None   # that the motion, or the moved scene, is of
        self._base: Any = None

    def shown(self, state: Any) -> Scene:
        """The scene of a state as it is now; of one that is newer than the last `advance` but for hair."""
        with self._lock:
            if self._moved is None:
                return state.scene
            if state is not self._state and state.scene.fur is not self._state.scene.fur:
                return state.scene if self._state.scene.mesh is not state.scene.mesh else self._moved
            return _worn(state.scene if state.given is None else self._base, self._moved)

    def play(self) -> None:
        """Let time go on."""
        with self._lock:
            self.playing, self._last = True, None

    def pause(self) -> None:
        """Hold time."""
        self.playing = False

    def stop(self) -> None:
        """Forget all motion: time is 0."""
        with self._lock:
            self._run += 1
            self._clear()

    def advance(self, state: Any, device: Any) -> bool:
        """Go on by the time that has gone by -> whether the scene is another."""
        with self._turn:
            with self._lock:
                if not state.moves:   # any more
                    moved = self._moved is not None
                    self.stop()
                    return moved
                now = self._clock()
                seconds = 0.0 if self._last is None else min(now - self._last, LONGEST)
                began = self.playing and self._moved is None
                if not (self.playing and (began or seconds >= LEAST)) and (
                        self._moved is None or state is self._state):
                    return False
                seconds = seconds if self.playing else 0.0
                run, self._last = self._run, now
            base, moved = self._go(state, seconds, device)
            with self._lock:
                if run != self._run:   # somebody has stopped it meanwhile
                    return False
                self._state, self._base, self._moved = state, base, moved
                return True

    def _go(self, state, seconds, device):
        """(The scene of a state, so many seconds later, as it is groomed; as it has moved)."""
        if state.motion is None:
            self._motion, self.time = None, self.time + seconds
            scene = state.at(self.time)
            return scene, scene
        motion = self._motion_of(state, device)
        # Frames are not counted here: at 0 it is as it is.
        moved = motion.step(seconds, wind=state.motion.wind) if seconds else motion.at(0)
        self.time = motion.time
        return state.at(self.time), moved

    def _motion_of(self, state, device):
        """The `Motion` of a state: the one there is, or another where hair is another; it goes on from where the last
        one was where only looks have changed."""
        before, motion = self._state, self._motion
        self._now = state
        if motion is not None and before is not None and _parts(before) == _parts(state):
            return motion
        after = Motion(lambda seconds: self._now.at(seconds), device=device, **state.motion.arguments)
        if motion is not None and before is not None and _shape(before) == _shape(state):
            after.restore(motion.state())
        self._motion = after
        return after


def _worn(scene, moved):
    """A scene whose fur and mesh are as they have moved."""
    if scene is moved or (scene.mesh is moved.mesh and scene.fur is moved.fur):
        return moved
    return attrs.evolve(scene, mesh=moved.mesh, fur=moved.fur)


def _parts(state):
    """What a Motion is made of, by identity: all that it does not take over as it goes on."""
    still = [getattr(state.motion, field.name) for field in attrs.fields(type(state.motion))
             if field.name not in ("wind", "hair")]
    return [id(each) for each in (state.given, state.scene.strands, state.scene.shells,
                                  None if state.given else state.scene.mesh, *state.motion.hair)], [
        each.tolist() if hasattr(each, "tolist") else each for each in still]


def _shape(state):
    """A hash of all that hair's growth and motion depend on."""
    strands, shells = state.scene.strands, state.scene.shells
    types = []
    if isinstance(strands, Strands):
        types = [[getattr(kind, field.name) for field in attrs.fields(type(kind)) if field.name not in LOOKS]
                 for kind in strands.types]
        strands = [getattr(strands, field.name) for field in attrs.fields(Strands) if field.name != "types"]
    if shells is not None:   # they lean by what is kept for each vertex
        shells = [shells.length, shells.layers, shells.pattern, shells.seed]
    motion = attrs.evolve(state.motion, wind=type(state.motion.wind)())
    return digest(id(state.given), strands, types, shells, state.scene.mesh, motion)
