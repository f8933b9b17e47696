"""The panels of a state: which sections there are, and which fields and buttons each has."""

from collections.abc import Callable
from typing import Any

import attrs
import numpy as np

from ..budget import PRESETS
from ..scene import Chiang, Curves, Environment, Ground, Kajiya, Light, Scene, Shells, Strands, Tufts, extent
from ..scene.origin import copied
from ..settings import CHOSEN, Settings
from . import fields
from .changes import Path, found
from .coats import COATS, dressed, short_fur
from .document import Document, State, usual_motion
from .fields import FLOOR, TRANSPARENCY, Field, angles_of, color_of, direction_of, hex_of
from .shades import SHADES, switched_on

LOOKS = {"Kajiya": "Kajiya-Kay", "Chiang": "Chiang"}
STRANDS = "scene", "strands"
ON: Any = object()   # what a person has chosen of a field that was off: to have it again
KEY = Field(("key",), "Map colour", "key", hint="This hair grows where the type map has this colour")
GRADIENT = (0.25, 0.42, 0.75), (0.75, 0.8, 0.85), (0.2, 0.18, 0.15)   # of a sky: zenith, horizon, below


@attrs.frozen
class Action:
    """A button: what is written on it, its icon, and what it does to a document."""

    label: str
    icon: str
    do: Callable[[Document], Any]


@attrs.frozen
class Switch:
    """Whether a part is there at all: where it stands, and what it becomes when it is switched on."""

    path: Path
    on: bool
    make: Callable[[State], Any]


@attrs.frozen
class Section:
    """A group of fields under a title, with groups within and buttons; swatch: path of a colour shown beside it."""

    title: str
    fields: tuple[Field, ...] = attrs.field(default=(), converter=tuple)
    inner: "tuple[Section, ...]" = attrs.field(default=(), converter=tuple)
    actions: tuple[Action, ...] = attrs.field(default=(), converter=tuple)
    switch: Switch | None = None
    hint: str = ""
    swatch: Path | None = None

    @property
    def shape(self) -> Any:
        """What has to be built anew where it is another: all but values."""
        return (self.title, self.hint, self.swatch,
                [(each.path, each.label, each.low, each.high) for each in self.fields],
                [each.label for each in self.actions], self.switch and self.switch.on,
                [each.shape for each in self.inner])


def sections(state: State) -> list[Section]:
    """Return the sections of a state, in their order."""
    scene = state.scene
    radius = _radius(scene)
    found = [_coats(scene), *_hair(scene, radius)]
    if scene.mesh is not None:
        found += [_shells(scene, radius), _motion(state, radius)]
    return [*found, _lights(scene, radius), _sky(scene), _ground(scene, radius), _body(scene), _quality(state.settings)]


def value_of(field: Field, state: State) -> Any:
    """Return what a field's widget shows of a state: numbers, texts and flags; None where it is off."""
    value = found(state, field.path)
    if field.kind == "look":
        return type(value).__name__
    if field.kind == "preset":
        return next((name for name, settings in PRESETS.items() if settings == value), "")
    if field.given is not None and (value is None or (isinstance(value, str) and value == field.off)):
        return None
    if field.kind == "key":
        return "#" + bytes(value).hex()
    if field.kind in ("color", "from"):
        return hex_of(value) if field.kind == "color" else tuple(round(angle, 1) for angle in angles_of(value))
    return tuple(float(each) for each in value) if field.kind == "vector" else value


def put(field: Field, document: Document, shown: Any) -> None:
    """Set what a field's widget shows in a document; None switches it off, `ON` on. Raises Error where it does not
    fit."""
    if shown is ON and field.path[-1] in SHADES:
        usual = field.given(found(document.state, field.path[:-1]))
        value, chosen = switched_on(document.state, field.path, usual)
        document.set(field.path, value, chosen)
        return
    shown = switch_on(field) if shown is ON else shown
    if field.kind == "preset":
        document.set(field.path, PRESETS[shown])
    elif field.path[-1] in ("max_error", "seconds") and field.path[0] == "settings" and shown is not None:
        document.set(("settings",), with_goal(document.settings, str(field.path[-1]), shown))
    else:
        document.set(field.path, _meant(field, shown))


def _meant(field, shown):
    """What a widget's value means."""
    if shown is None:
        return field.off
    if field.kind == "look":
        return {"Kajiya": Kajiya, "Chiang": Chiang}[shown]()
    if field.kind == "color":
        return color_of(shown)
    if field.kind == "from":
        return direction_of(*shown)
    return int(shown) if field.kind == "whole" and float(shown).is_integer() else shown


def switch_on(field: Field) -> Any:
    """Return what a widget shows of a field that is switched on for the first time."""
    return hex_of(field.given) if field.kind == "color" else field.given


def with_goal(settings: Settings, name: str, value: float) -> Settings:
    """Return settings of which "max_error" or "seconds" chooses what it may."""
    usual = Settings()
    fields: dict[str, Any] = {"scattering": "off", name: value}
    fields |= {each: getattr(usual, each) for each in CHOSEN}
    return attrs.evolve(settings, **fields)


def _radius(scene):
    """The size that lengths are beside."""
    if scene.mesh is not None:
        return scene.mesh.bounds[1]
    return float(extent(None, scene.fur)[1]) or 1.0


def _of(thing, table, path, radius=1.0):
    """Fields of a table that have a say in a thing that stands at a path."""
    return tuple(field.sized(path, radius) for field in table if field.when is None or field.when(thing))


def _coats(scene):
    actions = [Action(name, "", lambda document, name=name: document.set(
        ("scene", "fur"), dressed(document.state.scene, name).fur)) for name in COATS] if scene.mesh is not None else []
    return Section("Coats", actions=actions,
                   hint="Presets: each takes the place of all fur" if actions else "There is no mesh")


def _hair(scene, radius):
    """Sections of strands: their types, and where and how they grow."""
    strands = scene.strands
    if strands is None:
        return [] if scene.mesh is None else [Section("Hair", switch=_strands_switch(False))]
    if isinstance(strands, Curves):
        return [_curves(strands, radius)]
    several = len(strands.types) > 1 or strands.type_map is not None
    found = [Section(
        f"Hair {n + 1}" if several else "Hair", (KEY.sized((*STRANDS, "types", n), radius),) * (kind.key is not None),
        _of_type(kind, (*STRANDS, "types", n), radius), swatch=(*STRANDS, "types", n, "color"),
        switch=None if several else _strands_switch(True),
        actions=[Action("Remove", "delete", lambda document, n=n: document.set(STRANDS, without(
            document.state.scene.strands, n)))] if len(strands.types) > 1 else [])
        for n, kind in enumerate(strands.types)]
    growth = Section("Growth and force", _of(strands, fields.GROWTH, STRANDS, radius), actions=[
        Action("Add a hair type", "add", lambda document: document.set(STRANDS, with_type(
            document.state.scene.strands)))] if several else [],
        hint="" if several else "A painted picture that is dropped here gives places hair of their own")
    return [*found, growth]


def _strands_switch(on):
    return Switch(STRANDS, on, lambda state: short_fur(state.scene.mesh)[0])


def _of_type(kind, path, radius):
    return [Section("Shape", _of(kind, fields.SHAPE, path, radius)),
            Section("Colour", _of(kind, fields.COLORS, path)),
            _look(kind, path),
            Section("Curl and wave", _of(kind, fields.CURLS, path, radius)),
            Section("Tufts (clumps)", () if kind.tufts is None else _of(kind.tufts, fields.TUFTS, (*path, "tufts")),
                    switch=Switch((*path, "tufts"), kind.tufts is not None, lambda state: Tufts(3000))),
            Section("Random variation", _of(kind, fields.VARIES, path))]


def _look(thing, path):
    path = (*path, "look")
    glassy = isinstance(thing.look, Chiang)
    table = fields.CHIANG if glassy else fields.KAJIYA
    model = Field(path, "Model", "look", choices=LOOKS, hint="Kajiya-Kay: a colour and a highlight, fast; Chiang: "
                  "light through glass with pigment, as in Principled Hair")
    return Section("Shading", (model, *_of(thing.look, table, path)),
                   hint="As bright as real hair with 'Multiple scattering', under Final picture" * glassy)


def _curves(curves, radius):
    """The section of strands that were brought."""
    count = f"{len(curves.counts):,} strands of a file or script"
    if curves.types is None:
        return Section("Hair", (TRANSPARENCY.sized(STRANDS, radius),), [_look(curves, STRANDS)], hint=count)
    inner = []
    for n, kind in enumerate(curves.types):
        path = (*STRANDS, "types", n)
        inner += [Section(f"Type {n + 1}", (TRANSPARENCY.sized(path, radius),)), _look(kind, path)]
    return Section("Hair", inner=inner, hint=count)


def with_type(strands: Strands) -> Strands:
    """Return strands with one more type, as the last is, whose key is far from those of all others."""
    keys = np.array([kind.key or (0, 0, 0) for kind in strands.types])
    grid = np.stack(np.meshgrid(*[np.array([0, 85, 170, 255])] * 3), -1).reshape(-1, 3)
    apart = np.abs(grid[:, None] - keys).sum(2).min(1)
    key = tuple(int(each) for each in grid[np.argmax(apart)])
    return attrs.evolve(strands, types=(*strands.types, attrs.evolve(strands.types[-1], key=key)))


def without(strands: Strands, n: int) -> Strands:
    """Return strands without one of their types, of which the first of the others takes the place; of one that is left
    alone without a type map."""
    types = [kind for k, kind in enumerate(strands.types) if k != n]
    if len(types) == 1:
        return attrs.evolve(strands, types=[copied(types[0], key=None)], type_map=None)
    keys = np.array([kind.key for kind in strands.types], np.uint8)
    keys[n] = types[0].key
    indices: Any = strands.type_indices
    painted = {number: keys[each] for number, each in indices.items()} if isinstance(indices, dict) else keys[indices]
    return attrs.evolve(strands, types=types, type_map=painted)


def _shells(scene, radius):
    path, shells = ("scene", "shells"), scene.shells
    switch = Switch(path, shells is not None, lambda state: usual_shells(state.scene))
    rows = () if shells is None else _of(shells, fields.SHELLS, path, radius)
    return Section("Undercoat (shells)", rows, switch=switch)


def usual_shells(scene: Scene) -> Shells:
    """Return shells that look well under a scene's strands, or alone."""
    radius, strands = _radius(scene), scene.strands
    length, color = 0.05 * radius, (0.42, 0.24, 0.11)
    if isinstance(strands, Strands):
        longest = max(strands.types, key=lambda kind: kind.full_length)
        length, color = max(0.45 * longest.full_length, 0.005 * radius), tuple(0.7 * longest.color)
    return Shells(length=min(length, 0.1 * radius), layers=24, hairs=60_000, color=color, specular=0.15, exponent=40)


def _motion(state, radius):
    motion, inner = state.motion, []
    rows = () if motion is None else _of(motion, fields.MOTION, ("motion",), radius)
    for n, hair in enumerate(motion.hair if motion else ()):
        title = "Hair" if len(motion.hair) == 1 else f"Hair {n + 1}"
        inner.append(Section(title, _of(hair, fields.HAIR_MOTION, ("motion", "hair", n), radius)))
    return Section("Motion and wind", rows, inner, switch=Switch(
        ("motion",), motion is not None, lambda state: usual_motion(state.scene)))


def _lights(scene, radius):
    path, several = ("scene", "lights"), len(scene.lights) > 1
    inner = [Section(f"Light {n + 1}", _of(light, fields.LIGHT, (*path, n), radius), actions=[
        Action("Remove", "delete", lambda document, n=n: document.set(path, tuple(
            light for k, light in enumerate(document.state.scene.lights) if k != n)))] if several else [])
        for n, light in enumerate(scene.lights)]
    add = Action("Add a distant light", "add", lambda document: document.set(path, (
        *document.state.scene.lights, Light((1.0, -0.6, -0.5), ambient=0.0, intensity=0.6))))
    lamp = Action("Add a spot light", "add", lambda document: document.set(path, (
        *document.state.scene.lights, usual_lamp(document.state.scene))))
    return Section("Lights", inner=inner, actions=[add, lamp])


def usual_lamp(scene: Scene) -> Light:
    """Return a lamp over a scene, in front to the right, that shines on all of it."""
    center, radius = extent(scene.mesh, scene.fur)
    away = 1.5 * (radius or 1) * np.array([1.0, 1.5, 1.2])
    return Light(direction=-away, position=center + away, angle=50, ambient=0.0, size=0.1 * radius)


def _sky(scene):
    path, sky = ("scene", "environment"), scene.environment
    switch = Switch(path, sky is not None, lambda state: Environment(GRADIENT, intensity=0.6))
    if sky is None:
        return Section("Sky", switch=switch)
    plain = Action("One colour", "", lambda document: document.set((*path, "sky"), (0.7, 0.75, 0.8)))
    gradient = Action("Gradient", "", lambda document: document.set((*path, "sky"), GRADIENT))
    return Section("Sky", _of(sky, fields.SKY, path), switch=switch, actions=[
        each for each, axes in ((plain, 1), (gradient, 2)) if sky.sky.ndim != axes],
        hint="A picture of a sky (.hdr, .exr) may be dropped here" if sky.sky.ndim < 3 else "")


def _ground(scene, radius):
    path, ground = ("scene", "ground"), scene.ground
    return Section("Ground", () if ground is None else _of(ground, fields.GROUND, path, radius),
                   switch=Switch(path, ground is not None, lambda state: Ground(color=FLOOR)))


def _body(scene):
    if scene.mesh is None:
        return Section("Body", hint="There is no mesh")
    body = Field(("scene", "body"), "Visibility", "choice", choices={"drawn": "visible", "holdout": "holdout"},
                 hint="Holdout: it hides what is behind it, but is not seen itself")
    if isinstance(scene.body_color, tuple):
        colors = [Field(("scene", "body_color", n, "color"), f"Material {n + 1}" if len(scene.body_color) > 1 else (
            "Colour"), "color", hint="Of the mesh, times its texture") for n in range(min(len(scene.body_color), 16))]
    else:
        colors = [Field(("scene", "body_color"), "Colour", "color", given=(0.3, 0.2, 0.12),
                        hint="Of the mesh; off: not drawn")]
    return Section("Body", (*colors, body))


def _quality(settings):
    preset = Field(("settings",), "Preset", "preset", choices={name: name for name in PRESETS},
                   hint="Settings from the fastest to the best")
    return Section("Final picture", (*[preset] * (settings.goal is None),
                                     *_of(settings, fields.SETTINGS, ("settings",))))
