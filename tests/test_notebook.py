"""What notebooks show of frames and scenes, the scene that turns with the mouse there, and reprs that are short."""

import base64
import dataclasses
import io
import os
import queue
import sys
import threading
import time
import warnings
from pathlib import Path

import attrs
import nbclient
import nbformat
import numpy as np
import pytest
from PIL import Image
from support.browser import chromium

import clfur
from clfur.files.images import png_bytes
from clfur.scene.display import brief
from clfur.viewer import notebook, pace, pictures
from clfur.viewer.orbit import Orbit

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE = ROOT / "examples" / "notebook.ipynb"
OFF = """import os
os.environ["CLFUR_NOTEBOOK"] = "off"
scene"""
NOWHERE = """os.environ.update(CLFUR_NOTEBOOK="", CLFUR_DEVICE="no such device")
scene"""


def executed():
    """The outputs of the example's cells of code, and of two more: switched off, and without a device."""
    written = nbformat.read(EXAMPLE, 4)
    written.cells += [nbformat.v4.new_code_cell(source) for source in (OFF, NOWHERE)]
    environment = os.environ | {"CLFUR_DEVICE": "pocl", "PYTHONPATH": os.pathsep.join(
        [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])}
    nbclient.NotebookClient(written, kernel_name="python3", timeout=120).execute(env=environment)
    return [cell.outputs for cell in written.cells if cell.cell_type == "code"]


def given(outputs):
    """{media type: data} of what a cell gave."""
    assert {each.output_type for each in outputs} <= {"execute_result", "stream"}
    return next(each.data for each in outputs if each.output_type == "execute_result")


def picture_of(data):
    return np.asarray(Image.open(io.BytesIO(data)))


def test_the_example_is_kept_without_outputs():
    cells = [cell for cell in nbformat.read(EXAMPLE, 4).cells if cell.cell_type == "code"]
    assert len(cells) == 3 and not any(cell.outputs or cell.execution_count for cell in cells)


def test_the_example_shows_pictures():
    """Of a scene, a frame and a widget there is a picture in the file, and a small one; else there is text alone."""
    *shown, off, nowhere = map(given, executed())
    for data, text in zip(shown, ["Scene(", "Frame(", "clfur.view(Scene("], strict=True):
        assert data["text/plain"].startswith(text) and len(data["text/plain"]) < 400
        assert 1000 < len(data["image/png"]) < 100_000   # as it is stored: base64
        picture = picture_of(base64.b64decode(data["image/png"]))
        assert picture.shape == (240, 320, 4) and picture[..., 3].std() > 50 and picture[..., 0].std() > 50
    assert ["application/vnd.jupyter.widget-view+json" in data for data in shown] == [False, False, True]
    for data in (off, nowhere):
        assert set(data) == {"text/plain"} and data["text/plain"].startswith("Scene(")


@pytest.fixture
def scene(sphere):
    return clfur.Scene(sphere, clfur.Strands(roots=500, types=[clfur.HairType(length=.3, width=.02)]),
                       clfur.Camera(eye=(0, .4, 3.2), size=(80, 60)), body_color=(1, 0, 0))


def test_a_scene_shows_itself_small(gpu, scene, monkeypatch):
    assert pictures.scene_png(scene, gpu) == png_bytes(clfur.render(scene, gpu, pictures.CHEAP))
    monkeypatch.setattr(pictures, "SIZE", (40, 40))
    large = attrs.evolve(scene, camera=clfur.Camera(eye=(0, .4, 3.2), size=(400, 300)))
    small = pictures.scene_png(large, gpu)
    assert picture_of(small).shape == (30, 40, 4)
    seen = attrs.evolve(large, camera=clfur.Camera(eye=(0, .4, 3.2), size=(40, 30)))
    assert small == png_bytes(clfur.render(seen, gpu, pictures.CHEAP))


def test_a_frame_shows_itself(gpu, scene, monkeypatch):
    frame = clfur.draw(scene, gpu, outputs=("color", "depth"))
    assert frame._repr_png_() == png_bytes(frame.images["color"])
    assert clfur.draw(scene, gpu, outputs=("depth",))._repr_png_() is None
    monkeypatch.setenv("CLFUR_NOTEBOOK", "off")
    assert frame._repr_png_() is None and scene._repr_png_() is None


def test_what_cannot_be_drawn_fails_no_cell(scene, monkeypatch):
    monkeypatch.setenv("CLFUR_DEVICE", "no such device")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert scene._repr_png_() is None   # silently
        monkeypatch.delenv("CLFUR_DEVICE")
        monkeypatch.setattr(pictures, "render", lambda *_, **__: 1 / 0)
        assert scene._repr_png_() is None   # though a warning is an error
    with pytest.warns(RuntimeWarning, match="no picture of this Scene: division by zero"):
        assert scene._repr_png_() is None


class Page:
    """Stands for the page: pictures as they come."""

    def __init__(self, scene, gpu, settings=None, size=(80, 60)):
        self.put = queue.Queue()
        self.drawing = notebook.Drawing(scene, gpu.device, settings or clfur.Settings(), Orbit.of(scene, size),
                                        lambda *picture: self.put.put(picture))

    def take(self):
        return self.put.get(timeout=60)

    def until_idle(self):
        for thread in threading.enumerate():
            if thread.name == "clfur.view":
                thread.join(60)


def test_a_drag_turns_and_rest_gives_the_final_picture(gpu, scene):
    settings = clfur.Settings(samples=1, grid=48)
    page = Page(scene, gpu, settings)
    begun = page.drawing.orbit
    page.drawing.heed({"turn": [.25, .1], "pan": [.1, 0], "zoom": 2})
    content, moving = page.take()
    orbit = begun.turned(.25, .1).panned(.1, 0).zoomed(2)
    meant = attrs.evolve(scene, camera=orbit.camera())
    assert content == {"final": False} and page.drawing.orbit == orbit
    fast, divided = pace.ways(settings)[pace.FIRST]
    small = attrs.evolve(scene, camera=orbit.resized([each // divided for each in (80, 60)]).camera())
    assert divided == 2 and moving == png_bytes(clfur.render(small, gpu, fast))
    page.drawing.heed({"rest": True})
    content, final = page.take()
    assert content == {"final": True} and final == png_bytes(clfur.render(meant, gpu, settings)) != moving
    page.drawing.heed({"turn": [float("nan"), 0]})
    page.take()
    assert page.drawing.orbit == orbit   # a camera that is none is not taken
    page.drawing.heed({"reset": True, "rest": True})
    assert page.take()[1] == png_bytes(clfur.render(attrs.evolve(scene, camera=begun.camera()), gpu, settings))
    page.until_idle()
    assert not page.drawing._draws and page.put.empty()


def test_the_newest_camera_wins(gpu, scene, monkeypatch):
    """While a picture is drawn, only the last of those asked for waits; a final one that is old is not shown."""
    begins, goes_on, asked = threading.Event(), threading.Event(), []

    def slow(scene, settings, device, stop):
        asked.append(scene.camera)
        begins.set()
        assert goes_on.wait(60)
        return None if stop() else b"picture"
    monkeypatch.setattr(notebook, "drawn", slow)
    page = Page(scene, gpu)
    page.drawing.heed({"rest": True})
    assert begins.wait(60)
    for _ in range(5):
        page.drawing.heed({"turn": [.01, 0]})
    goes_on.set()
    assert page.take() == ({"final": False}, b"picture")
    page.until_idle()
    assert page.put.empty() and len(asked) == 2
    assert (asked[-1].eye == page.drawing._begun.turned(.05, 0).camera().eye).all()


def test_a_view_that_rests_does_not_leave_another_waiting(gpu, scene, monkeypatch):
    """What one view has asked for as it moves is drawn, though another rests before it begins."""
    begins, goes_on, asked = threading.Event(), threading.Event(), []

    def slow(scene, settings, *_):
        asked.append(settings)
        begins.set()
        assert goes_on.wait(60)
        return b"picture"
    monkeypatch.setattr(notebook, "drawn", slow)
    page = Page(scene, gpu)
    page.drawing.heed({"turn": [.1, 0]})
    assert begins.wait(60)
    page.drawing.heed({"turn": [.1, 0]})
    page.drawing.heed({"rest": True})   # a view that opens
    goes_on.set()
    page.until_idle()
    assert [page.take()[0] for _ in range(2)] == [{"final": False}] * 2 and asked == [
        pace.ways(clfur.Settings())[pace.FIRST][0]] * 2
    page.drawing.heed({"rest": True})
    assert page.take()[0] == {"final": True}


def test_a_page_that_cannot_be_reached_costs_no_later_picture(gpu, scene, monkeypatch):
    monkeypatch.setattr(notebook, "drawn", lambda *_: b"picture")
    page = Page(scene, gpu)

    def gone(*_):
        raise RuntimeError("the connection is closed")
    with monkeypatch.context() as patch:
        patch.setattr(page.drawing, "_send", gone)
        page.drawing.heed({"rest": True})
        page.until_idle()
    page.drawing.heed({"rest": True})
    assert page.put.get(timeout=5) == ({"final": True}, b"picture")


def test_a_picture_is_given_up(gpu, scene):
    answers = iter([False, True])
    assert pictures.drawn(scene, clfur.Settings(), gpu.device, lambda: next(answers, True)) is None
    assert pictures.drawn(scene, clfur.Settings(), gpu.device, lambda: False) == png_bytes(clfur.render(scene, gpu))


def test_slow_pictures_are_smaller_while_they_move(gpu, scene, monkeypatch):
    monkeypatch.setattr(pace, "GOAL", 0)
    page = Page(scene, gpu)

    def shape(**asked):
        page.drawing.heed(asked)
        return picture_of(page.take()[1]).shape[:2]
    assert [shape(turn=[.1, 0]) for _ in range(4)] == [(30, 40)] * 3 + [(20, 27)]
    assert shape(rest=True) == (60, 80)
    monkeypatch.setattr(pace, "GOAL", 60)
    assert (30, 40) in [shape(turn=[.1, 0]) for _ in range(16)]


def test_an_error_is_a_line_in_the_page(gpu, scene, monkeypatch):
    def fails(*_):
        raise clfur.DeviceError("the device\nis gone")
    page = Page(scene, gpu)
    with monkeypatch.context() as patch:
        patch.setattr(notebook, "drawn", fails)
        page.drawing.heed({"rest": True})
        assert page.take() == ({"error": "the device is gone"}, None)
    page.drawing.heed({"rest": True})
    assert page.take()[0] == {"final": True}


def test_a_widget_answers_its_page(gpu, scene, monkeypatch):
    sent = queue.Queue()
    widget = clfur.view(scene, gpu, size=(40, 30))
    monkeypatch.setattr(widget, "send", lambda content, buffers=None: sent.put((content, buffers)))
    widget._handle_custom_msg({"rest": True}, [])   # as ipywidgets does with what comes from the page
    content, buffers = sent.get(timeout=60)
    assert content == {"final": True} and picture_of(buffers[0]).shape == (30, 40, 4)
    data, _ = widget._repr_mimebundle_()
    assert data["image/png"] == pictures.scene_png(attrs.evolve(scene, camera=Orbit.of(scene, (40, 30)).camera()), gpu)
    assert "application/vnd.jupyter.widget-view+json" in data and "pan" in widget._esm


def test_what_view_refuses(scene, monkeypatch):
    for given, line in [((1,), "scene is 1"), ((scene, None, 2), "settings is 2"), ((scene, "no such"), "no such"),
                        ((scene, None, None, (0, 5)), "size")]:
        with pytest.raises(clfur.Error, match=line):
            clfur.view(*given)
    monkeypatch.setitem(sys.modules, "anywidget", None)
    notebook._widget.cache_clear()
    with pytest.raises(clfur.Error, match=r'pip install "clfur\[notebook\]"'):
        clfur.view(scene)
    notebook._widget.cache_clear()


PLAIN = {"int", "float", "str", "bool", "None"}


def holds_more(kind):
    """Whether a class of attrs or a dataclass has fields that are not a number or a text each."""
    fields = attrs.fields(kind) if attrs.has(kind) else dataclasses.fields(kind)
    names = [each.type if isinstance(each.type, str) else getattr(each.type, "__name__", str(each.type))
             for each in fields if each.repr]
    return any(set(name.split(" | ")) - PLAIN for name in names)


def test_public_classes_with_arrays_have_short_reprs():
    classes = [each for name in clfur.__all__ if isinstance(each := getattr(clfur, name), type)
               and (attrs.has(each) or dataclasses.is_dataclass(each))]
    plain = [kind for kind in classes if not holds_more(kind)]
    assert clfur.Settings in plain and clfur.Mesh not in plain and len(classes) > 20
    assert [kind for kind in classes if kind not in plain and kind.__repr__ is not brief] == []


def test_reprs_are_short(gpu, sphere, scene, comparison, measured):
    picture = np.ones((64, 64, 3), np.uint8)
    kinds = [clfur.HairType(color=(.1 * k, 0, 0), color_texture=picture, key=(k, 0, 0)) for k in range(5)]
    fur = clfur.Strands(types=kinds, type_map=picture, inner=np.ones(320, int), maps=clfur.Maps(length=picture[..., 0]))
    lights = [clfur.Light(position=(9, 9, 9))] * 4
    frame = clfur.draw(scene, gpu, outputs=("color", "depth"), hashes=True)
    scene = clfur.Scene(sphere, [fur, clfur.Shells(rest=sphere, length=.2)], light=lights,
                        environment=clfur.Environment(picture), ground=clfur.Ground(-1.5, (1, 1, 1)),
                        camera=clfur.Camera(size=(16, 12)), body_color=clfur.Material(texture=picture))
    on_device = clfur.Curves(gpu.upload(np.zeros((8, 3), np.float32)), counts=[8])
    for thing in (sphere, sphere.numbering, *kinds, fur, fur.maps, scene, lights[0], scene.environment, scene.camera,
                  scene.body_color[0], frame, on_device, comparison, comparison.rows[0], measured, measured.points[0],
                  clfur.Comb(np.ones((320, 3))), clfur.Camera.calibrated(scene.camera.pose, np.eye(3), (9, 9))):
        text = repr(thing)
        assert len(text) < 400 and "array(" not in text and text.startswith(type(thing).__name__ + "(")
    assert "points=float32 [8, 3] on a device" in repr(on_device)


def test_reprs_say_what_is_not_by_default():
    camera = clfur.Camera(eye=(0, 1.5, 3), size=(320, 240))
    assert repr(camera) == "Camera(eye=[0, 1.5, 3], size=(320, 240))"
    assert repr(clfur.Strands(types=[clfur.HairType(segments=4)], roots=9)) == (
        "Strands(types=(HairType(segments=4, length=0.16, stiffness=0.625),), roots=9)")
    assert repr(clfur.Maps(length={"face": np.ones(9)})) == "Maps(length=Skin(per='face', data=float32 [9]))"
    with pytest.raises(clfur.Error, match="scene is Camera"):
        clfur.render(camera)


@pytest.fixture
def page():
    """A page in a real Chromium, without a window."""
    with chromium() as browser:
        yield browser.new_page()


MODEL = """source => import(URL.createObjectURL(new Blob([source], {type: "text/javascript"}))).then((module) => {
    let take;
    window.open = window.most = 0;   // pictures that the page waits for, now and at most
    const send = (content) => { if (!content.rest) most = Math.max(most, ++open); heed(content); };
    module.default.render({model: {send, on: (_, f) => { take = f; }, off() {}}, el: document.body});
    window.put = (content, bytes) => {
        if (!content.final) open = 0;
        take(content, bytes && [new DataView(Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0)).buffer)]);
    };
    window.pixels = () => {
        const canvas = document.querySelector("canvas"), {width, height} = canvas;
        return [width, height, ...canvas.getContext("2d").getImageData(0, 0, width, height).data];
    };
})"""


def test_the_mouse_turns_the_scene_in_a_browser(page, gpu, scene):
    """The widget's page asks by its own events for pictures, for one at a time, and ends with the final one."""
    there = Page(scene, gpu, clfur.Settings(samples=1, grid=48), size=(160, 120))
    page.expose_function("heed", there.drawing.heed)
    page.evaluate(MODEL, notebook.JAVASCRIPT.read_text())

    def until_final():
        end = time.monotonic() + 30
        while time.monotonic() < end:
            page.wait_for_timeout(1)   # the page's events are heard meanwhile
            while not there.put.empty():
                content, picture = there.put.get()
                page.evaluate("both => put(...both)", [content, picture and base64.b64encode(picture).decode()])
                if content.get("final") or "error" in content:
                    page.wait_for_function("expected => document.querySelector('div').textContent === expected",
                                           arg=content.get("error", ""))
                    return picture
        pytest.fail("no final picture came")

    def drag(*keys):
        for key in keys:
            page.keyboard.down(key)
        box = page.locator("canvas").bounding_box()
        page.mouse.move(box["x"] + 40, box["y"] + 40)
        page.mouse.down()
        page.mouse.move(box["x"] + 70, box["y"] + 52, steps=9)
        page.mouse.up()
        for key in keys:
            page.keyboard.up(key)
        return until_final()
    begun = there.drawing.orbit
    first = until_final()
    turned = drag()
    assert there.drawing.orbit.azimuth == pytest.approx(begun.azimuth - 90) and turned != first
    assert there.drawing.orbit.elevation == pytest.approx(begun.elevation + 36)
    assert there.drawing.orbit.target == begun.target
    drag("Shift")
    assert there.drawing.orbit.target != begun.target
    page.mouse.wheel(0, -200)
    final = until_final()
    assert there.drawing.orbit.distance == pytest.approx(begun.distance / 1.1**2)
    width, height, *colors = page.evaluate("pixels()")
    expected, found = picture_of(final), np.reshape(colors, (height, width, 4))
    assert (width, height) == (160, 120) and (found[..., 3] == expected[..., 3]).all()
    opaque = expected[..., 3] == 255
    assert opaque.any() and (found == expected)[opaque].all()   # canvases hold premultiplied colours
    assert page.evaluate("most") == 1
    page.locator("canvas").dblclick()
    assert until_final() == first and there.drawing.orbit == begun
    page.evaluate("put({error: 'no more memory'})")
    page.wait_for_function("document.querySelector('div').textContent === 'no more memory'")
