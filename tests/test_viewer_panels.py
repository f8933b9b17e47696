"""The panels in a real Chromium: what they change is drawn, undo brings the same bytes back, and files come and go."""

import base64
import http.client
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.browser import WAIT, chromium, serving, until

from clfur.command.main import main

pytest.importorskip("nicegui", reason='clfur view needs pip install "clfur[view]"')

OBJ = b"v -1 -1 0\nv 1 -1 0\nv 1 1 0.5\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
HAIR = "scene.strands.types.0"
# A file as if it were dropped; size: what it says of itself, if it is not so large.
DROP = """([name, data, size]) => {
  const file = new File([Uint8Array.from(atob(data), (each) => each.charCodeAt(0))], name);
  if (size) Object.defineProperty(file, "size", { value: size });
  const event = new Event("drop", { bubbles: true, cancelable: true });
  Object.defineProperty(event, "dataTransfer", { value: { files: [file], types: ["Files"] } });
  window.dispatchEvent(event);
}"""


@pytest.fixture(scope="module", name="chromium")
def _chromium():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def served():
    with serving("sphere", "--roots", "300") as server:
        yield server
        assert "Traceback" not in server.said(), server.said()


@pytest.fixture(scope="module")
def context(chromium):
    context = chromium.new_context(viewport={"width": 720, "height": 180})
    yield context
    context.close()


@pytest.fixture(scope="module")
def opened(context, served):
    return open_page(context, served)


@pytest.fixture
def page(opened):
    """A page whose document is as it was at first."""
    undo = opened.locator("[aria-label=Undo]")
    while undo.is_enabled():
        undo.evaluate("(it) => it.click()")   # it may be off by now
        opened.wait_for_timeout(300)
    shown(opened)
    return opened


def open_page(context, served):
    page = context.new_page()
    page.goto(served.address)
    shown(page)
    return page


def shown(page):
    """The bytes of the final picture, when it has come to rest."""
    known = None
    while known is None or known != page.evaluate("clfur.header.picture"):
        page.wait_for_function("window.clfur && clfur.header && clfur.header.final", timeout=WAIT)
        known = page.evaluate("clfur.header.picture")
        page.wait_for_timeout(350)
    return base64.b64decode(page.evaluate(
        "btoa(clfur.bytes.reduce((all, each) => all + String.fromCharCode(each), ''))"))


def another(page, *seen):
    """The bytes of a final picture that is none of these, when it has come: on a busy machine it is late."""
    return until(lambda: (now := shown(page)) not in seen and now)


def unfold(page, *titles):
    for title in titles:
        section = page.locator(f'[data-section="{title}"]').first
        if "q-expansion-item--expanded" not in section.get_attribute("class"):
            section.locator(".section-title").click()
    page.wait_for_timeout(400)   # it unfolds slowly


def widget(page, path, kind="input"):
    found = page.locator(f'[data-path="{path}"] {kind}').first
    found.wait_for()
    return found


def pick(page, path, color):
    widget(page, path, "input[type=color]").evaluate(
        "(it, color) => { it.value = color; it.dispatchEvent(new Event('input', { bubbles: true })); }", color)


def choose(page, path, name):
    widget(page, path, ".q-select").click()
    page.locator(f".q-menu .q-item:has-text('{name}')").first.click()


def said(page, wrong=None):
    """The line that the page says of a dropped file, once it is done."""
    line = page.locator(".drop-said")
    until(lambda: line.inner_text() and "reading …" not in line.inner_text())
    assert wrong is None or ("wrong" in line.get_attribute("class")) == wrong, line.inner_text()
    return line.inner_text()


def test_colour_length_light_and_settings_change_the_picture_and_undo_brings_it_back(page):
    first = shown(page)
    unfold(page, "Hair", "Lights", "Final picture")
    undo = page.locator("[aria-label=Undo]")
    assert not undo.is_enabled() and "drawn in" in page.locator(".told").inner_text()
    for change in (lambda: pick(page, f"{HAIR}.color", "#ff2010"),
                   lambda: widget(page, f"{HAIR}.length").fill("0.5"),
                   lambda: widget(page, "scene.lights.0.intensity").fill("0.2"),
                   lambda: choose(page, "settings.samples", "16")):
        change()
        until(lambda: undo.is_enabled())
        assert shown(page) != first
        undo.click()
        until(lambda: not undo.is_enabled())
        assert shown(page) == first
    assert widget(page, f"{HAIR}.length").input_value() == "0.1386"   # what undo has brought back is shown


def test_a_slider_is_dragged_and_what_is_wrong_is_told(page):
    unfold(page, "Hair")
    slider = widget(page, f"{HAIR}.stiffness", ".q-slider")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 5, y)
    page.mouse.down()
    for share in np.linspace(.1, .9, 6):
        page.mouse.move(box["x"] + share * box["width"], y)
    page.mouse.up()
    number = widget(page, f"{HAIR}.stiffness")
    until(lambda: float(number.input_value()) > 3)
    before = shown(page)
    widget(page, f"{HAIR}.length").fill("-1")
    until(lambda: "Length: -1 is not allowed; allowed: a finite" in page.locator(".panel-trouble").inner_text())
    until(lambda: widget(page, f"{HAIR}.length").input_value() == "0.1386")   # as it is, not as it was typed
    for path, text, line in [(f"{HAIR}.length", "", "Length: nothing is"), (f"{HAIR}.color", "red", "Colour: red is")]:
        typed = widget(page, path, "input:not([type=color])")
        held = typed.input_value()
        typed.fill(text)
        typed.press("Enter")
        until(lambda line=line: line in page.locator(".panel-trouble").inner_text())
        until(lambda typed=typed, held=held: typed.input_value() == held)
    assert shown(page) == before
    widget(page, f"{HAIR}.width").fill("0.004")
    until(lambda: not page.locator(".panel-trouble").is_visible())
    page.locator("[aria-label=Undo]").click()
    page.locator("[aria-label=Undo]").click()   # all of the drag was one step
    until(lambda: not page.locator("[aria-label=Undo]").is_enabled())


def test_keys_undo_what_was_typed(page):
    unfold(page, "Hair")
    length, stiffness = widget(page, f"{HAIR}.length"), widget(page, f"{HAIR}.stiffness")
    first = stiffness.input_value()
    for field, text in (length, "0.3"), (stiffness, "2"):
        field.fill(text)
        field.press("Enter")
        page.wait_for_timeout(300)
    length.focus()
    page.keyboard.press("Control+z")
    until(lambda: stiffness.input_value() == first and length.input_value() == "0.3")
    page.keyboard.press("Control+z")
    until(lambda: length.input_value() == "0.1386")
    page.keyboard.press("Control+Shift+z")
    until(lambda: length.input_value() == "0.3")


def test_parts_are_switched_and_coats_put_on(page):
    first = shown(page)
    unfold(page, "Coats", "Sky", "Undercoat (shells)")
    page.locator("button:has-text('Spikes')").click()
    until(lambda: page.locator('[data-path="scene.shells.length"]').count())
    page.locator('[data-section="Undercoat (shells)"] .q-toggle').click()
    until(lambda: not page.locator('[data-path="scene.shells.length"]').count())
    spikes = shown(page)
    assert page.locator('[data-section="Sky"] .section-body').inner_text() == "Off"
    page.locator('[data-section="Sky"] .q-toggle').click()
    until(lambda: shown(page) != spikes)   # without another change
    lit = shown(page)
    pick(page, "scene.environment.sky.0", "#ff00ff")
    until(lambda: shown(page) not in (first, spikes, lit))


def apart(one, other):
    """Whether two boxes do not overlap."""
    return one["x"] + one["width"] <= other["x"] or other["x"] + other["width"] <= one["x"] or (
        one["y"] + one["height"] <= other["y"]) or other["y"] + other["height"] <= one["y"]


@pytest.mark.parametrize("wide", [720, 600])
def test_nothing_lies_over_the_panels(wide, chromium, served):
    """Neither what is said of a file, nor tooltips; in a narrow window they are under the picture."""
    context = chromium.new_context(viewport={"width": wide, "height": 480})
    page = open_page(context, served)
    if wide < 700:
        page.locator("[aria-label=Panels]").click()
        page.wait_for_timeout(400)
    stage, panels = (page.locator(each).bounding_box() for each in ("#stage", ".q-drawer"))
    assert apart(stage, panels) and stage["width"] + panels["width"] == (wide if wide > 700 else 2 * wide)
    unfold(page, "Hair")
    page.evaluate(DROP, ["a.doc", base64.b64encode(b"1").decode(), 0])
    until(lambda: page.locator(".drop-said").is_visible())
    for target in "[aria-label=Redo]", "[aria-label=Save]", f'[data-path="{HAIR}.length"] .hinted', ".section .swatch":
        page.locator(target).first.hover()
        hint = page.locator(".q-tooltip.beside")
        until(lambda hint=hint: hint.count() == 1)
        page.wait_for_timeout(300)   # it comes slowly
        assert apart(hint.bounding_box(), panels) and apart(page.locator(".drop-said").bounding_box(), panels)
        page.mouse.move(5, 5)
        until(lambda hint=hint: not hint.count())
    context.close()


def saved(page, *words):
    """(name, bytes) of what the browser gets of an item of the menu."""
    with page.expect_download(timeout=WAIT) as download:
        page.locator("[aria-label=Save]").click()
        for word in words:
            page.locator(f".q-menu .q-item:has-text('{word}')").last.click()
    return download.value.suggested_filename, Path(download.value.path()).read_bytes()


def test_what_is_saved_draws_the_same_bytes(page, tmp_path):
    unfold(page, "Hair")
    widget(page, f"{HAIR}.tip_color", ".q-checkbox").click()   # which is off at first
    pick(page, f"{HAIR}.tip_color", "#20ff40")
    there = shown(page)
    name, scene = saved(page, "Scene file")
    assert name == "scene.py"
    (tmp_path / name).write_bytes(scene)
    with pytest.raises(SystemExit, match="0"):
        main(["render", str(tmp_path / name), "-o", str(tmp_path / "a.png")])
    assert (tmp_path / "a.png").read_bytes() == there
    for visible in (False, True):   # it is off, and then as it was
        widget(page, f"{HAIR}.tip_color", ".q-checkbox").click()
        picker = page.locator(f'[data-path="{HAIR}.tip_color"] input[type=color]')
        until(lambda picker=picker, visible=visible: picker.is_visible() == visible)
    assert shown(page) == there
    page.wait_for_timeout(300)
    assert saved(page, "Picture .png") == ("clfur.png", there)
    page.wait_for_timeout(300)
    name, strands = saved(page, "Strands", ".npz")
    assert name == "strands.npz" and len(np.load(io.BytesIO(strands))["counts"]) == 300


def test_files_are_dropped(page, served):
    before = shown(page)
    pixels = np.zeros((32, 32, 3), np.uint8)
    pixels[:, 16:] = 255, 0, 0
    picture = io.BytesIO()
    Image.fromarray(pixels).save(picture, "PNG")

    def drop(name, data, size=0):
        page.evaluate(DROP, [name, base64.b64encode(data).decode(), size])
    for name, data, size, line in [
            ("a.py", b"raise SystemExit", 0, "a scene file is a program, and a page may not run one"),
            ("a.obj", b"", 0, "the file is empty"), ("a.obj", b"\x00\xffgarbage", 0, "has no faces"),
            ("a.png", b"\x89PNG\r\n\x1a\n" + b"\x00" * 99, 0, ""), ("a.obj", OBJ, 1 << 29, "has 512.0 MiB; allowed"),
            ("a.doc", b"1", 0, "files .doc cannot be dropped")]:
        drop(name, data, size)
        until(lambda name=name, line=line: line in said(page) and said(page, wrong=True).startswith(f"{name}: "))
    assert shown(page) == before
    drop("map.png", picture.getvalue())
    until(lambda: "a type map of 2 types" in said(page))
    unfold(page, "Hair 2")
    head, key = (page.locator(f"{each} .swatch") for each in (
        '.section[data-section="Hair 2"] .section-head', '[data-path="scene.strands.types.1.key"]'))
    pick(page, "scene.strands.types.1.color", "#00ffff")
    until(lambda: "rgb(0, 255, 255)" in head.get_attribute("style"))
    assert "rgb(255, 0, 0)" in key.get_attribute("style")
    painted = another(page, before)
    drop("mesh.obj", OBJ)
    until(lambda: "a mesh of 2 faces" in said(page))
    another(page, before, painted)
    connection = http.client.HTTPConnection("127.0.0.1", served.port, timeout=20)
    connection.request("POST", "/drop?name=a.obj", b"", {   # the body is never sent
        "Cookie": f"clfur-view-{served.port}={served.token}", "Content-Length": str(1 << 29)})
    assert connection.getresponse().status == 413
    connection.close()


def test_two_windows_show_the_same_and_hair_moves_in_both(page, context, served):
    before = shown(page)
    other = open_page(context, served)
    unfold(page, "Hair")
    unfold(other, "Hair")
    widget(page, f"{HAIR}.length").fill("0.4")
    number = widget(other, f"{HAIR}.length")
    until(lambda: number.input_value() == "0.4")
    assert shown(other) != before
    other.locator("[aria-label=Undo]").click()
    until(lambda: widget(page, f"{HAIR}.length").input_value() == "0.1386")
    page.reload()
    assert shown(page) == before
    drawn = page.evaluate("clfur.drawn")
    page.locator("[aria-label='Play or pause']").click()
    until(lambda: page.evaluate("clfur.drawn") > drawn + 5 and not page.evaluate("clfur.header.final"))
    assert " a second" in page.locator(".status").inner_text()
    other.locator("[aria-label='Play or pause']").click()   # holds it
    held = shown(page)
    other.locator("[aria-label='Back to rest']").click()
    until(lambda: shown(page) == before)
    assert held != before
