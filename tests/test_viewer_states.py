"""What is taken as shown by a window of `clfur view`, when what it shows changes at an awkward moment."""

import asyncio
import re
import threading
import time
from types import SimpleNamespace

import attrs
import numpy as np
import pytest
from support.browser import until
from support.pages import Page, fur

import clfur

pytest.importorskip("nicegui", reason='clfur view needs pip install "clfur[view]"')

from clfur.budget import LADDER
from clfur.viewer import drawing as module
from clfur.viewer import panels
from clfur.viewer.document import Document
from clfur.viewer.drawing import Drawing
from clfur.viewer.told import expected
from clfur.viewer.windows import REST

FORCE = "scene", "strands", "force"
SHOWN = SimpleNamespace(images={"color": np.zeros((2, 2, 4), np.float32)}, building=0, strands=1, settings=None,
                        device="none", seconds=0, error=0.1, why="")


@pytest.fixture
def drawn(monkeypatch):
    """Function (what a picture is made by, document) -> its `Drawing`, which draws."""
    there = []

    def begin(draw, document=None):
        monkeypatch.setattr(module, "draw", draw)
        there.append(Drawing(document or Document(fur()), None))
        there[-1].start()
        return there[-1]
    yield begin
    for each in there:
        assert each.close(20)


def force(scene):
    return scene.strands.force.tolist()


def test_nobody_asks_a_document_while_who_hears_of_its_changes_waits(drawn):
    free = []

    class Asked(Document):
        @property
        def scene(self):
            thread = threading.Thread(target=self.drawing._on_change, daemon=True)
            thread.start()
            thread.join(5)
            free.append(not thread.is_alive())
            return self.state.scene
    document = Asked(fur())
    document.drawing = drawn(lambda *_, stop: SHOWN, document)
    Page(document.drawing).connect().settled()
    assert len(free) > 3 and all(free)


def test_an_error_is_of_the_state_that_was_drawn(drawn):
    """And the next one, which came meanwhile, is drawn."""
    def draw(scene, devices, settings, stop):
        if force(scene) == [0, -9, 0]:
            document.undo()
            raise clfur.Error("too much")
        return SHOWN
    document = Document(fur())
    page = Page(drawn(draw, document)).connect()
    page.settled()
    count = len(page.got)
    document.set(FORCE, (0, -9, 0))
    until(lambda: len(page.got) > count and page.last["final"], 5)
    assert [line for line in page.lines if "error" in line] == [{"error": "too much"}]


def test_an_error_while_it_plays_is_told_once(drawn):
    def draw(scene, devices, settings, stop):
        if document.time:
            raise clfur.Error("too much")
        return SHOWN
    document = Document(lambda seconds: fur())
    page = Page(drawn(draw, document)).connect()
    page.settled()
    document.play()
    until(lambda: any("error" in line for line in page.lines), 5)
    time.sleep(3 * REST)
    assert not document.playing and sum("error" in line for line in page.lines) == 1


def test_a_change_while_a_picture_begins_is_in_the_next(drawn):
    """As it is not in this one, whose scene was asked for already."""
    class Changed(Document):
        asked = 0

        @property
        def settings(self):
            if threading.current_thread().name == "drawing":
                self.asked += 1
                if self.asked == 2:   # of the final picture
                    self.set(FORCE, (0, -9, 0))
            return self.state.settings
    document, seen = Changed(fur()), []

    def draw(scene, devices, settings, stop):
        if stop():
            raise clfur.Stopped("by a change")
        seen.append(force(scene))
        return SHOWN
    page = Page(drawn(draw, document)).connect()
    page.settled()
    assert seen[-1] == [0, -9, 0] and page.window.shown == ((page.window.orbit, document.version), True)


def test_a_page_that_comes_back_while_its_picture_ends_gets_one(drawn):
    other, calls = [], []

    def draw(scene, devices, settings, stop):
        calls.append(scene)
        if len(calls) == 2:   # the final one
            drawing.disconnect(page.window, page.link)
            other.append(Page(drawing))
            other[0].window = page.window
            other[0].connect()
        return SHOWN
    drawing = drawn(draw)
    page = Page(drawing).connect()
    until(lambda: other and other[0].got and other[0].last["final"], 5)


def test_who_gives_up_what_was_asked_for_does_no_harm(drawn):
    drawing, held = drawn(lambda *_, stop: SHOWN), threading.Event()
    first, second = drawing.do(lambda: held.wait(20)), drawing.do(lambda: 1)
    assert second.cancel()
    third = drawing.do(lambda: 3)
    held.set()
    assert first.result(5) is True and third.result(5) == 3


def test_a_final_picture_that_came_too_late_is_drawn_again(drawn):
    """For who goes away while it is coded, and comes back."""
    held, drawing = threading.Event(), None

    def draw(scene, devices, settings, stop):
        if settings == drawing.document.settings and not held.is_set():
            drawing._coder.submit(held.wait, 20)
        return SHOWN
    drawing = drawn(draw)
    page = Page(drawing).connect()
    until(lambda: page.window.shown[1], 5)
    page.tell(n=2, turn=[0.3, 0], hidden=True)
    held.set()
    until(lambda: not page.link.under_way, 5)
    assert not page.last.get("final")
    page.tell(n=3, home=True, hidden=False)
    until(lambda: page.last["final"] and page.last["gesture"] == 3, 5)


def test_a_picture_holds_what_was_told_while_it_was_coded(drawn, monkeypatch):
    """If that has moved nothing; else a page would wait for a picture of it."""
    def coded(image):
        page.tell(n=7)
        return b""
    monkeypatch.setattr(module, "png_bytes", coded)
    page = Page(drawn(lambda *_, stop: SHOWN)).connect()
    until(lambda: page.got and page.last["final"], 5)
    assert page.lines[-1] == {"gesture": 7} and page.last["gesture"] == 7


def test_a_picture_that_cannot_be_coded_is_told_once(drawn, monkeypatch, capsys):
    monkeypatch.setattr(module, "png_bytes", lambda image: 1 / 0)
    drawing = drawn(lambda *_, stop: SHOWN)
    page = Page(drawing).connect()
    until(lambda: any("error" in line for line in page.lines), 5)
    time.sleep(3 * REST)
    assert [line for line in page.lines if "error" in line] == [{"error": "ZeroDivisionError: division by zero"}]
    assert not page.link.under_way and capsys.readouterr().err.count("Traceback") == 1


def test_the_error_that_is_told_is_of_the_windows_camera(drawn):
    """A small picture of the same scene errs otherwise."""
    frame = SimpleNamespace(**vars(SHOWN) | {"error": None, "settings": LADDER[4], "strands": 200})
    page = Page(drawn(lambda *_, stop: frame)).connect()
    page.settled()
    line = until(lambda: page.window.told, 5)
    scene = fur()
    own, other = (f"{expected(frame, each):.2g}" for each in (attrs.evolve(scene, camera=page.window.camera), scene))
    assert own != other and re.search("error about (.*)", line)[1] == own


def test_a_picture_whose_error_cannot_be_told_is_shown(drawn, monkeypatch, capsys):
    monkeypatch.setattr("clfur.viewer.told.expected", lambda frame, scene: 1 / 0)
    page = Page(drawn(lambda *_, stop: SimpleNamespace(**vars(SHOWN) | {"error": None}))).connect()
    page.settled()
    until(lambda: page.window.told == "drawn in 0.00 s", 5)
    assert not any("error" in line for line in page.lines) and not page.link.under_way
    assert capsys.readouterr().err.count("Traceback") == 1


@pytest.mark.parametrize("what", ["draw", "strand_file"])
@pytest.mark.parametrize("ends", ["page", "server"])
def test_what_is_saved_for_nobody_ends(ends, what, drawn, monkeypatch):
    drawing, held, said = drawn(lambda *_, stop: SHOWN), threading.Event(), []

    def made(scene, *_, stop):
        assert not stop() and shown == ["loading"]
        held.set()
        until(stop, 5)
        raise clfur.Stopped("by a test")
    monkeypatch.setattr(panels, what, made)
    shown: list = []
    panel = object.__new__(panels.Panels)
    panel.drawing, panel.document, panel.window, panel.say = drawing, drawing.document, drawing.open("0"), said.append
    panel._trouble = SimpleNamespace(is_deleted=False)
    panel._saver = SimpleNamespace(is_deleted=False, props=lambda add="", remove="": shown.append(
        add or f"no {remove}"))
    work = panel._save_picture(".png") if what == "draw" else panel._save_strands(".pbrt")
    saving = threading.Thread(target=lambda: asyncio.run(work))
    saving.start()
    assert held.wait(5)
    if ends == "page":
        panel._trouble.is_deleted = True
    else:
        assert drawing.close(5)
    saving.join(10)
    assert not saving.is_alive() and said == [""] and not drawing._works and shown == ["loading", "no loading"]
