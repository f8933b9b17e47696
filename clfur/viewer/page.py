"""The page: a canvas that fills the window, beside a drawer with panels."""

import secrets
from importlib.resources import files
from typing import Any

from nicegui import ui

from . import coding, panels
from .drawing import Drawing

RECONNECT = 10.0   # seconds that the page's elements are kept for a page that has gone


def build(app: Any, drawing: Drawing, title: str) -> None:
    """Let a FastAPI app serve the page of a drawing."""
    title = f"{title} · clfur"

    @ui.page("/", title=title, dark=True)
    def _():
        show(drawing)
    ui.run_with(app, title=title, dark=True, gzip_middleware_factory=None, reconnect_timeout=RECONNECT,
                show_welcome_message=False, favicon=_icon())


def show(drawing: Drawing) -> None:
    """Build the page for a new window."""
    window = drawing.open(secrets.token_hex(8))
    ui.colors(primary="#c9955c", dark="#1e1f21")
    here = files(__package__)
    ui.add_css(here.joinpath("page.css").read_text(encoding="utf-8").replace("BACKGROUND", coding.background()))
    ui.query(".nicegui-content").classes("stage-content")
    stage = ui.element("div").props('id="stage"')
    stage.props(f'data-window="{window.key}"')
    # In windows up to 700 wide it is under the picture, see panels.css; a slider's drag is no swipe that closes it.
    drawer = ui.right_drawer(bordered=False).classes("panels").props(
        "width=360 breakpoint=700 no-swipe-open no-swipe-close no-swipe-backdrop")
    with drawer:
        panels.build(drawing, window)
    ui.button(icon="tune", on_click=drawer.toggle).props('flat round dense size=sm aria-label="Panels"').classes(
        "panels-button")
    ui.add_body_html(f"<script>{here.joinpath('page.js').read_text(encoding='utf-8')}</script>")


def _icon():
    """A tuft, as SVG."""
    return ('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="7" '
            'fill="#26272a"/><path d="M6 27q1-13 7-20m-2 20q1-13 5-22m0 22q0-12 4-20m1 20q-1-10 5-16" fill="none" '
            'stroke="#c9955c" stroke-width="2.4" stroke-linecap="round"/></svg>')
