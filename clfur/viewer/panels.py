"""Panels beside the picture: all that a person turns, what was drawn, undo, play, and what is saved."""

import asyncio
import functools
from importlib.resources import files
from typing import Any

import attrs
from nicegui import ui

from .. import draw
from ..errors import Error, Stopped
from ..scene.origin import copied
from .changes import Path, found
from .drawing import Drawing
from .dropped import ALLOWED, MOST
from .fields import Field, hex_of, refused
from .saving import PICTURES, STRANDS, picture_file, scene_file, strand_file
from .sections import Section, put, sections, value_of
from .widgets import ALONE, ROWS, Row, beside
from .windows import Window

SOON = 0.1    # seconds after which what was refused is shown no longer
OFTEN = 0.2   # seconds between two looks at the document: other windows, undo and motion change it


def build(drawing: Drawing, window: Window) -> None:
    """Build the panels of a window where NiceGUI is building just now."""
    here = files(__package__)
    ui.add_css(here.joinpath("panels.css").read_text(encoding="utf-8"))
    script = here.joinpath("panels.js").read_text(encoding="utf-8").replace("MOST", str(MOST)).replace(
        "ALLOWED", ",".join(ALLOWED))
    ui.add_body_html(f"<script>{script}</script>")
    Panels(drawing, window)


class Panels:
    """The panels of one window.  They look at the document, as other threads and windows change it, now and then."""

    def __init__(self, drawing: Drawing, window: Window) -> None:
        self.drawing, self.document, self.window = drawing, drawing.document, window
        self._seen: Any = None
        self._told: str | None = None
        self._frame: ui.label | None = None
        self._shape: Any = None
        self._rows: list[Row] = []
        self._swatches: list[tuple[ui.element, Path]] = []
        self._open: dict[str, bool] = {}
        self._toolbar()
        self._trouble = ui.label().classes("panel-trouble").props("role=alert")
        self._trouble.set_visibility(False)
        self._body = ui.element("div").classes("panel-body")
        self.refresh()
        ui.timer(OFTEN, self.refresh)

    def refresh(self) -> None:
        """Show what the document has now."""
        seen = (self.document.state, self.document.playing, self.document.problem, self.document.can_undo,
                self.document.can_redo)
        if self._told is not self.window.told:
            self._told = self.window.told
            self._show_told()
        if seen == self._seen:
            return
        if self._seen is None or seen[2] != self._seen[2]:
            self.say(seen[2])
        self._seen = seen
        self._undo.set_enabled(self.document.can_undo)
        self._redo.set_enabled(self.document.can_redo)
        self._play.props(f"icon={'pause' if self.document.playing else 'play_arrow'}")
        self._show(seen[0])

    def say(self, line: str) -> None:
        """Show a line of what went wrong; "" takes it away."""
        self._trouble.set_text(line)
        self._trouble.set_visibility(bool(line))

    def do(self, action: Any, *given: Any, field: Field | None = None) -> bool:
        """Call action(*given) -> whether it could be done; what a person got wrong, of a field, becomes a line."""
        try:
            action(*given)
        except Error as error:
            self.say(str(error) if field is None else refused(field, str(error)))
            return False
        except LookupError:   # another window has taken it away just now
            self.say("it is not there any more")
            return False
        self.say("")
        self.refresh()
        return True

    def _put(self, field: Field, value: Any) -> None:
        """Set a field to what a person has chosen; what is refused is shown no longer."""
        if not self.do(put, field, self.document, value, field=field):
            with self._body:   # NiceGUI hears of what was chosen after this
                ui.timer(SOON, lambda: self._show(self.document.state), once=True)

    # The bar on top ---------------------------------------------------------------------------------------------

    def _toolbar(self):
        with ui.element("div").classes("panel-bar"):
            self._undo = _button("undo", "Undo", lambda: self.do(self.document.undo))
            self._redo = _button("redo", "Redo", lambda: self.do(self.document.redo))
            ui.element("div").classes("gap")
            self._play = _button("play_arrow", "Play or pause", lambda: self.do(
                self.document.pause if self.document.playing else self.document.play))
            _button("stop", "Back to rest", lambda: self.do(self.document.stop))
            ui.element("div").classes("gap")
            _button("folder_open", "Open a mesh, a type map, strands or a sky, or drop it on the page").props(
                "data-open-file")
            self._saver = _button("download", "Save")
            with self._saver, ui.menu().classes("panel-menu"):
                for suffix in PICTURES:
                    _item(f"Picture {suffix}", functools.partial(self._save_picture, suffix))
                _item("Scene file", self._save_scene)
                with _item("Strands"), ui.menu().classes("panel-menu").props('anchor="top end" self="top start"'):
                    for suffix, name in STRANDS.items():
                        _item(f"{name} {suffix}", functools.partial(self._save_strands, suffix))

    # Sections ---------------------------------------------------------------------------------------------------

    def _show(self, state):
        there = sections(state)
        shape = [each.shape for each in there]
        if shape != self._shape:
            self._shape, self._rows, self._swatches = shape, [], []
            self._body.clear()
            with self._body:
                for section in there:
                    self._section(section)
        for row in self._rows:
            row.show(value_of(row.field, state))
        for swatch, path in self._swatches:
            swatch.style(f"background: {hex_of(found(state, path))}")

    def _section(self, section: Section) -> None:
        expansion = ui.expansion(value=self._open.get(section.title, False)).props(
            f'dense dense-toggle expand-icon-class="chevron" data-section="{section.title}"').classes("section")
        expansion.on_value_change(lambda event: self._open.__setitem__(section.title, bool(event.value)))
        with expansion.add_slot("header"), ui.element("div").classes("section-head"):
            ui.label(section.title).classes("section-title")
            if section.swatch:
                with ui.element("div").classes("swatch") as swatch:
                    beside("Hair colour")
                self._swatches.append((swatch, section.swatch))
            self._switch(section)
        with expansion, ui.element("div").classes("section-body"):
            if section.hint or (section.switch and not section.switch.on):
                ui.label(section.hint or "Off").classes("hint")
            self._contents(section)
            if section.title == "Final picture":
                self._frame = ui.label().classes("hint told")
                self._show_told()

    def _contents(self, section):
        for field in section.fields:
            self._rows.append(ROWS[field.kind](field, self._put, self.say))
        for inner in section.inner:
            with ui.element("div").classes("inner").props(f'data-section="{inner.title}"'):
                with ui.element("div").classes("inner-head"):
                    ui.label(inner.title)
                    self._switch(inner)
                    for action in inner.actions:
                        _button(action.icon, action.label, functools.partial(self.do, action.do, self.document))
                if inner.hint:
                    ui.label(inner.hint).classes("hint")
                self._contents(attrs.evolve(inner, actions=()))   # which are in its head
        if section.actions:
            with ui.element("div").classes("actions"):
                for action in section.actions:
                    ui.button(action.label, icon=action.icon or None, on_click=functools.partial(
                        self.do, action.do, self.document)).props(
                            "dense no-caps unelevated color=grey-9 text-color=grey-4").classes("action")

    def _switch(self, section):
        if (switch := section.switch) is not None:
            def turn(event):
                self._open[section.title] = self._open.get(section.title, False) or bool(event.args)
                self.do(self.document.switch, switch.path, bool(event.args), switch.make)
            ui.switch(value=switch.on).props("dense size=xs").on(
                "update:model-value", turn, js_handler=ALONE).on(
                    "click", js_handler="(event) => event.stopPropagation()")

    def _show_told(self):
        if self._frame is not None and not self._frame.is_deleted:
            self._frame.set_text(self._told or "")

    # Saving -----------------------------------------------------------------------------------------------------

    async def _save(self, name, work):
        """Bring the browser the bytes of work(scene, camera), which runs in the thread that draws."""
        self.say("")
        self._saver.props("loading")   # and takes no click
        try:
            data = await asyncio.wrap_future(self.drawing.do(
                lambda: work(self.document.scene, self.window.camera)))
        except Stopped:   # nobody waits for it
            pass
        except Exception as error:   # of a device, a disk or a format
            self.say(str(error) if isinstance(error, Error) else f"{type(error).__name__}: {error}")
        else:
            ui.download.content(data[1] if isinstance(data, tuple) else data,
                                data[0] if isinstance(data, tuple) else name)
        finally:
            if not self._saver.is_deleted:
                self._saver.props(remove="loading")

    async def _save_picture(self, suffix):
        devices, settings = self.drawing.devices, self.document.settings
        await self._save(f"clfur{suffix}", lambda scene, camera: picture_file(
            draw(copied(scene, camera=camera), devices, settings, stop=self._is_over), camera, suffix))

    def _is_over(self):
        """Whether the page has gone for good, or the server ends."""
        return self.drawing.closed or self._trouble.is_deleted

    async def _save_scene(self):
        state, seconds = self.document.state, self.document.time
        await self._save("", lambda scene, camera: scene_file(state, camera, seconds=seconds))

    async def _save_strands(self, suffix):
        await self._save(f"strands{suffix}", lambda scene, camera: strand_file(
            scene, suffix, self.drawing.devices, stop=self._is_over))


def _button(icon, hint, on_click=None):
    button = ui.button(icon=icon, on_click=on_click).props(f'flat dense round size=sm aria-label="{hint}"')
    with button:
        beside(hint).props("delay=600")
    return button


def _item(label, on_click=None):
    return ui.menu_item(label, on_click=on_click, auto_close=on_click is not None).props("dense")
