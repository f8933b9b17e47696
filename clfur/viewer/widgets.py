"""Widgets of fields: each shows the value that a document has, and puts what a person chooses there."""

import math
import re
from collections.abc import Callable
from typing import Any

from nicegui import ui

from .fields import Field
from .sections import ON

OFTEN = 0.06   # seconds between two values of a slider that is dragged
TYPED = 700    # milliseconds after the last key at which a number is taken
ALONE = "(value) => emit(value)"   # of what a switch emits: else the mouse's event comes along


def beside(hint: str) -> ui.tooltip:
    """A tooltip of the element that is being built: it is shown beside the panel, where it hides nothing of it."""
    return ui.tooltip(hint).classes("beside").props('anchor="center left" self="center right"')   # see panels.css


class Row:
    """The widgets of one field; `show` shows a value, put(field, value) is called with what a person has chosen.

    say: takes a line of what a person has typed that is no value.
    """

    def __init__(self, field: Field, put: Callable[[Field, Any], None], say: Callable[[str], None]) -> None:
        self.field, self._put, self._say = field, put, say
        self._on: ui.checkbox | None = None
        self._shown: Any = ()
        self._last: Any = None   # when it was switched off
        with ui.element("div").classes("field").props(f'data-path="{".".join(map(str, field.path))}"'):
            with ui.element("div").classes("field-label"):
                if field.given is not None:
                    self._on = ui.checkbox().props("dense size=xs").on(
                        "update:model-value", self._switch, js_handler=ALONE)
                name = ui.label(field.label)
                if field.hint:
                    name.classes("hinted")
                    with name:
                        beside(field.hint)
            with ui.element("div").classes("field-value") as self._value:
                self._build()

    def show(self, value: Any) -> None:
        """Show a value, None where the field is off."""
        if value == self._shown:
            return
        self._shown = value
        if self._on is not None:
            self._on.set_value(value is not None)
            self._value.set_visibility(value is not None)
        if value is not None:
            self._show(value)

    def _switch(self, event):
        if not event.args:
            self._last = self._shown
        # What goes with another field is not as it was.
        again = ON if self._last is None or callable(self.field.given) else self._last
        self._put(self.field, again if event.args else None)

    def _chosen(self, value):
        self._shown = value
        self._put(self.field, value)

    def _input(self, kind, put, reads, allowed):
        """An input that calls put(reads(text)) some time after a text was typed, or when it is left; then a text of
        which reads makes None is told, and what holds is there again."""
        def typed(event):
            if (value := reads(event.args)) is not None:
                put(value)

        def left():
            if reads(text := entry.value) is None:
                self._say(f"{self.field.label}: {text or 'nothing'} is not allowed; allowed: {allowed}")
                self._show(self._shown)
        entry = ui.input().props(f"dense borderless debounce={TYPED}").classes(kind)
        # Unlike update:value, this comes of what is typed alone.
        return entry.on("update:model-value", typed).on("blur", left, args=[])

    def _number(self, put):
        return self._input("number", put, _read, "a number").props("type=number step=any")

    def _build(self) -> None:
        raise NotImplementedError

    def _show(self, value: Any) -> None:
        raise NotImplementedError


class Number(Row):
    """A slider, and a number that may be typed."""

    def _build(self):
        self._slider = ui.slider(min=0, max=1, step=0.001).props("dense").on(
            "update:model-value", self._slid, throttle=OFTEN)
        self._entry = self._number(self._typed)
        ui.label(self.field.unit).classes("unit")

    def _show(self, value):
        self._slider.set_value(self.field.share(value))
        self._entry.set_value(_text(value))

    def _slid(self, event):
        value = self.field.value(float(event.args))
        self._entry.set_value(_text(value))
        self._chosen(value)

    def _typed(self, value):
        self._slider.set_value(self.field.share(value))
        self._chosen(value)


class Vector(Row):
    """Three numbers."""

    def _build(self):
        self._value.classes("triple")
        self._numbers = [self._number(lambda value, n=n: self._typed(n, value)).props(f"prefix={axis}")
                         for n, axis in enumerate("xyz")]
        ui.label(self.field.unit).classes("unit")

    def _show(self, value):
        for number, each in zip(self._numbers, value):
            number.set_value(_text(each))

    def _typed(self, n, value):
        values = list(self._shown)
        values[n] = value
        self._chosen(tuple(values))


class From(Row):
    """Where light comes from: around, and above the level."""

    def _build(self):
        self._value.classes("stacked")
        self._sliders = []
        for n, (name, low, high) in enumerate((("azimuth", -180, 180), ("elevation", -90, 90))):
            with ui.element("div").classes("field-value"):
                slider = ui.slider(min=low, max=high, step=1).props("dense").on(
                    "update:model-value", lambda event, n=n: self._turned(n, float(event.args)), throttle=OFTEN)
                number = self._number(lambda value, n=n: self._turned(n, value)).props(f'aria-label="{name}"')
                ui.label(f"° {name}").classes("unit")
                self._sliders.append((slider, number))

    def _show(self, value):
        for (slider, number), angle in zip(self._sliders, value):
            slider.set_value(angle)
            number.set_value(_text(angle))

    def _turned(self, n, angle):
        angles = list(self._shown)
        angles[n] = angle
        self._show(angles)
        self._chosen(tuple(angles))


class Color(Row):
    """A colour, by the browser's own picker or as #rrggbb."""

    def _build(self):
        self._picker = ui.element("input").props("type=color").on(
            "input", lambda event: self._picked(str(event.args)), js_handler="(event) => emit(event.target.value)",
            throttle=OFTEN)
        self._hex = self._input("hex", self._picked, _hex, "#rrggbb").props("maxlength=7")

    def _show(self, value):
        self._picker.props(f"value={value}")
        self._hex.set_value(value)

    def _picked(self, text):
        self._show(text)
        self._chosen(text)


class Key(Row):
    """A colour that is told alone."""

    def _build(self):
        self._swatch, self._hex = ui.element("div").classes("swatch"), ui.label()

    def _show(self, value):
        self._swatch.style(f"background: {value}")
        self._hex.set_text(value)


class Choice(Row):
    """One of several."""

    def _build(self):
        self._quiet = False
        self._select = ui.select(dict(self.field.choices), on_change=self._changed).props(
            "dense options-dense borderless popup-content-class=panel-menu")
        ui.label(self.field.unit).classes("unit")

    def _show(self, value):
        self._quiet = True
        options = self.field.choices if value in self.field.choices else {
            **self.field.choices, value: str(value) or "of your own"}
        self._select.set_options(options, value=value)
        self._quiet = False

    def _changed(self, event):
        if not self._quiet and event.value in self.field.choices:
            self._chosen(event.value)


class Flag(Row):
    """On or off."""

    def _build(self):
        self._flag = ui.switch().props("dense size=xs").on(
            "update:model-value", lambda event: self._chosen(bool(event.args)), js_handler=ALONE)

    def _show(self, value):
        self._flag.set_value(bool(value))


ROWS: dict[str, type[Row]] = {"number": Number, "whole": Number, "color": Color, "vector": Vector, "from": From,
                              "choice": Choice, "look": Choice, "preset": Choice, "flag": Flag, "key": Key}


def _read(text):
    """The number that a text is, or None, also of half of one."""
    try:
        value = float(text)
    except (TypeError, ValueError):
        return None
    return value if math.isfinite(value) else None


def _hex(text):
    """The colour that a text is, as pickers have it, or None."""
    digits = re.fullmatch(r"\s*#?([0-9a-fA-F]{6})\s*", text or "")
    return f"#{digits[1].lower()}" if digits else None


def _text(value):
    """A number as it is shown: four digits, three of what is small, and no more than are needed."""
    return f"{value}" if isinstance(value, int) else f"{float(f'{value:.{3 + (abs(value) >= 0.01)}g}'):.10g}"
