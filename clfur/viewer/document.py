"""What is viewed: a scene, settings and motion that many windows change and see alike."""

import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from ..motion.hair import HairMotion, Wind
from ..scene import Ground, Mesh, Scene, Shells, Strands, Tufts, checks
from ..scene.origin import copied
from ..settings import Settings
from .changes import Path as Steps
from .changes import changed, found
from .coats import fitted, spread
from .playing import Player
from .shades import carried, with_shades

TOGETHER = 1.0   # seconds within which changes of one path are one step of undo
MOST = 100       # steps of undo
BYTES = 1 << 29  # of arrays and dropped files that they hold, but for the last step, which is there in any case
STRANDS = "scene", "strands"


@attrs.frozen(eq=False)
class Moving:
    """How hair moves: arguments of `clfur.Motion`; hair: a tuple of HairMotion, one for all or one for each type."""

    hair: tuple[HairMotion, ...] = checks.field(checks.tuple_of(HairMotion), default=HairMotion())
    wind: Wind = checks.field(checks.instance(Wind), default=Wind())
    units_per_metre: float = checks.field(checks.positive(), default=1.0)
    gravity: checks.Given = checks.field(checks.vector(3), default=(0.0, -9.81, 0.0))
    rate: float = checks.field(checks.real(1, 10_000), default=120.0)
    jump: float | None = checks.field(checks.optional(checks.positive()), default=None)
    body: bool | str = "auto"
    hair_on_hair: float | None = checks.field(checks.optional(checks.positive()), default=None)

    @classmethod
    def of(cls, motion: "dict[str, Any] | Moving | None") -> "Moving | None":
        """Return it of what a scene file sets as `motion`; None of None."""
        if motion is None or isinstance(motion, Moving):
            return motion
        return cls(**{name: value for name, value in motion.items() if value is not None or name == "hair_on_hair"})

    @property
    def arguments(self) -> dict[str, Any]:
        """{argument: value} of `clfur.Motion`."""
        return {field.name: getattr(self, field.name) for field in attrs.fields(Moving)}


@attrs.frozen(eq=False)
class MeshFile:
    """The file that a mesh was read from: a path or built-in name, or, of one that was dropped, its bytes and suffix.

    mesh: what `clfur.load_mesh` gave of it. up: "y", or "z" if it was turned by `clfur.scene.upright`.
    """

    mesh: Mesh
    path: str | Path | None = None
    data: bytes = b""
    suffix: str = ""
    up: str = "y"


@attrs.frozen(eq=False)
class State:
    """All that undo brings back: paths of changes begin with the name of one of these.

    scene: as it is groomed. settings: of the final picture. motion: how its hair moves, or None. given: None, or a
    function of seconds that gives the scene, with changes, (path, value) of `changed`, on top. mesh_file: where its
    mesh is from, or None. kept: {path: (a part, the mesh it was with)} of parts that were switched off.
    shades: {path: a `shades.Shade`} of root and tip colours that went with their hair's colour, or were chosen.
    """

    scene: Scene
    settings: Settings
    motion: Moving | None = None
    given: Callable[[float], Scene] | None = None
    changes: tuple[tuple[Steps, Any], ...] = ()
    mesh_file: MeshFile | None = None
    kept: dict[Steps, tuple[Any, Mesh | None]] = attrs.field(factory=dict)
    shades: dict[Steps, Any] = attrs.field(factory=dict)

    @property
    def moves(self) -> bool:
        """Whether there is anything to play."""
        return self.motion is not None or self.given is not None

    def at(self, seconds: float) -> Scene:
        """The scene at a time, with its hair as it is groomed."""
        if self.given is None:
            return self.scene
        scene = self.given(seconds)
        for path, value in self.changes:
            scene = changed(scene, path, value)
        return copied(scene, camera=self.scene.camera)   # who looks has a camera of their own

    def changed(self, path: Steps, value: Any) -> "State":
        """Another state with this value at a path; raises Error where it does not fit."""
        if path == ("scene",):
            scene = checks.instance(Scene)(value, "Document.scene")
            return attrs.evolve(self, scene=scene, given=None, changes=(), shades=self._shades(scene))
        after = changed(self, path, value)
        if len(path) <= len(STRANDS) + 2:   # else within a hair type
            after = attrs.evolve(after, shades=self._shades(after.scene))
        if path[0] != "scene" or self.given is None:
            return after
        others = [each for each in self.changes if each[0][:len(path) - 1] != path[1:]]
        return attrs.evolve(after, changes=(*others, (path[1:], value)))

    def switched(self, path: Steps, on: bool, make: Callable[["State"], Any]) -> "State":
        """Another state without the part at a path, or with it as it was, or make(state) if it has not been there."""
        there, mesh = found(self, path), self.scene.mesh
        if on == (there is not None):
            return self
        if not on:
            return attrs.evolve(self.changed(path, None), kept={**self.kept, path: (there, mesh)}, shades=self.shades)
        return self.changed(path, _refitted(*self.kept[path], mesh) if path in self.kept else make(self))

    def _shades(self, scene):
        """Its shades in another scene; where it has no strands, those of the ones that were switched off."""
        if self.scene.strands is None and scene.strands is None:
            return self.shades
        before = self.scene.strands or self.kept.get(STRANDS, (None,))[0]
        return carried(self.shades, before, scene.strands)


class Document:
    """A scene that is viewed and changed by many windows, with undo; it may be asked and told from any thread.

    scene: a Scene, or a function of seconds that gives one. settings: those of the final picture, or None. motion:
    None, or {argument: value} of `clfur.Motion`, as scene files set it. mesh_file: where the scene's mesh is from.
    """

    def __init__(self, scene: Scene | Callable[[float], Scene], settings: Settings | None = None,
                 motion: "dict[str, Any] | Moving | None" = None, mesh_file: MeshFile | None = None,
                 clock: Callable[[], float] = time.monotonic) -> None:
        given = scene if callable(scene) else None
        first = checks.instance(Scene)(scene(0.0) if callable(scene) else scene, "Document.scene")
        self._state = State(first, settings or Settings(), Moving.of(motion), given, (), mesh_file)
        self._lock, self._clock = threading.RLock(), clock
        self._before: list[State] = []
        self._after: list[State] = []
        self._last: tuple[Any, float] = (None, 0.0)   # path of the last change, and when
        self._listeners: list[Callable[[], Any]] = []
        self._version, self.problem = 0, ""
        self._player = Player(clock)

    @property
    def state(self) -> State:
        """All that can be changed."""
        return self._state

    @property
    def scene(self) -> Scene:
        """The scene as it is now, with its hair where motion has brought it, which may be on a device."""
        with self._lock:
            return self._player.shown(self._state)

    @property
    def settings(self) -> Settings:
        """Of the final picture."""
        return self._state.settings

    @property
    def version(self) -> int:
        """A number that rises whenever the picture may be another."""
        return self._version

    @property
    def playing(self) -> bool:
        """Whether time goes on."""
        return self._player.playing

    @property
    def time(self) -> float:
        """Seconds that were played."""
        return self._player.time

    def subscribe(self, callback: Callable[[], Any]) -> Callable[[], None]:
        """Have callback() called after each change, in the thread that made it, which then holds no lock of the
        document -> function that ends this."""
        with self._lock:
            self._listeners.append(callback)

        def end():
            with self._lock:
                if callback in self._listeners:
                    self._listeners.remove(callback)
        return end

    def set(self, path: Steps, value: Any, chosen: bool = True) -> bool:
        """Set what stands at a path, such as ("scene", "strands", "types", 0, "length") -> whether it was another.

        Raises Error where it does not fit; then all is as before. Changes of one path within a second are one step of
        `undo`. A hair type's root and tip colour go with its colour; chosen: of one of these, whether from now on it is
        to stay.
        """
        with self._changing():
            if _same(found(self._state, path), value):
                return False
            return self._become(with_shades(self._state, path, value, chosen), path)

    def switch(self, path: Steps, on: bool, make: Callable[[State], Any]) -> bool:
        """Switch the part at a path off, or on as it was, see `State.switched` -> whether it was the other way."""
        with self._changing():
            return self._become(self._state.switched(path, on, make), path)

    def change(self, scene: Scene | None = None, settings: Settings | None = None, *, step: Any = None,
               **others: Any) -> bool:
        """Set the scene, the settings, or other fields of the `State`, in one step of undo -> whether any is another.

        step: what the change is called; changes of the same name within a second are one step.
        """
        with self._changing():
            after = self._state
            for name, value in {"scene": scene, "settings": settings}.items():
                after = after if value is None else after.changed((name,), value)
            return self._become(attrs.evolve(after, **others), step)

    def undo(self) -> bool:
        """Go back by a step -> whether there was one."""
        return self._go(self._before, self._after)

    def redo(self) -> bool:
        """Take an undo back -> whether there was one."""
        return self._go(self._after, self._before)

    @property
    def can_undo(self) -> bool:
        return bool(self._before)

    @property
    def can_redo(self) -> bool:
        return bool(self._after)

    def play(self) -> None:
        """Let time go on from where it is; a scene of which nothing moves gets a `Moving`. Raises Error where it has
        no hair that could."""
        with self._changing():
            if not self._state.moves:
                self._become(attrs.evolve(self._state, motion=usual_motion(self._state.scene)), None)
            self.problem = ""
            self._player.play()
            self._version += 1

    def pause(self) -> None:
        """Hold time where it is; the picture stays as it is."""
        self._player.pause()
        self._tell()

    def stop(self) -> None:
        """Go back to rest, where time is 0."""
        with self._changing():
            self._player.stop()
            self._version += 1

    def advance(self, device: Any = None) -> bool:
        """Bring hair to where it is now -> whether the scene is another than before.

        For the thread that draws, before each picture: the device is what it draws with. Time goes on by as much as has
        gone by since the last time, at most 1/12 s. An Error ends the play and is told as `problem`.
        """
        state = self._state
        try:
            moved = self._player.advance(state, device)
        except Exception as error:   # a function that gives scenes may raise anything
            with self._changing():
                self._player.stop()
                self.problem = str(error) if isinstance(error, Error) else f"{type(error).__name__}: {error}"
                self._version += 1
            return True
        if moved:
            with self._lock:
                self._version += 1
        return moved

    def _become(self, after, step):
        """Make a step to another state -> whether it is one."""
        before, now = self._state, self._clock()
        fields = attrs.fields(State)
        if all(getattr(after, field.name) is getattr(before, field.name) for field in fields):
            return False
        last, when = self._last
        if step is None or step != last or now - when > TOGETHER or not self._before:
            self._before = [*_recent(self._before[-MOST + 1:], before), before]
        self._after, self._last, self._state = [], (step, now), after
        self._version += 1
        return True

    def _go(self, one, other):
        with self._changing():
            if not one:
                return False
            other.append(self._state)
            self._state, self._last = one.pop(), (None, 0.0)
            self._version += 1
            return True

    @contextlib.contextmanager
    def _changing(self):
        """Hold the lock; whoever listens is told of another version after that, as they hold locks of their own."""
        with self._lock:
            before = self._version
            yield
            is_other = self._version != before
        if is_other:
            self._tell()

    def _tell(self):
        for each in list(self._listeners):
            each()


def usual_motion(scene: Scene) -> Moving:
    """How hair moves of a scene that does not tell: of something half a metre across, in a light wind."""
    if scene.mesh is None or scene.fur is None:
        raise Error("nothing of this scene can move; allowed: one with a mesh and fur on it")
    return Moving(units_per_metre=4 * scene.mesh.bounds[1], wind=Wind((1.0, 0.0, 0.0), gust=1.0, size=0.3, skin=0.01))


def _recent(steps, before):
    """Of the steps that came before a state, the last ones, as far as they and it hold no more than `BYTES`."""
    seen = set()   # what several of them hold counts once
    held = _bytes(before, seen)
    for number, state in enumerate(reversed(steps)):
        held += _bytes(state, seen)
        if held > BYTES:
            return steps[len(steps) - number:]
    return steps


def _bytes(value, seen):
    """Bytes of the arrays and files in a value, but of what was seen before."""
    if id(value) in seen:
        return 0
    if isinstance(value, (np.ndarray, bytes)):
        seen.add(id(value))
        return value.nbytes if isinstance(value, np.ndarray) else len(value)
    if attrs.has(type(value)):
        seen.add(id(value))
        return sum(_bytes(getattr(value, field.name), seen) for field in attrs.fields(type(value)))
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, (tuple, list)) else ()
    return sum(_bytes(each, seen) for each in inner)


def _refitted(part, before, mesh):
    """A part of a scene with one mesh for one with another, as large beside it."""
    if before is mesh:
        return part
    if isinstance(part, Ground):
        return attrs.evolve(part, height=None)
    if before is None or mesh is None:
        return part
    times = mesh.bounds[1] / before.bounds[1]
    if isinstance(part, Moving):
        return attrs.evolve(part, units_per_metre=part.units_per_metre * times)
    if isinstance(part, Tufts):
        return spread(part, times)
    return fitted((part,), before, mesh)[0] if isinstance(part, Strands | Shells) else part


def _same(one, other):
    """Whether two values are the same, also of arrays and of tuples and lists."""
    if one is other:
        return True
    if one is None or other is None:
        return False
    if attrs.has(type(one)):
        return type(one) is type(other) and bool(one == other)
    try:
        one, other = np.asarray(one), np.asarray(other)
        return one.dtype.kind != "O" and one.shape == other.shape and bool((one == other).all())
    except (TypeError, ValueError):
        return False
