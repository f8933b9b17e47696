"""The chart of speed against accuracy: what it shows, that it can be read, and that a file is whole or not there."""

import re
import sys
from xml.etree import ElementTree

import attrs
import numpy as np
import pytest
from matplotlib.text import Text

import clfur
from clfur.files.images import load_picture
from clfur.judge import chart


def texts(figure):
    """{text: its box on the page}."""
    figure.draw_without_rendering()
    return {text.get_text(): Text.get_window_extent(text) for text in figure.axes[0].texts}


def test_labels_of_the_frontier_can_be_read(measured):
    """None is upon another, upon a point, or out of the chart."""
    figure = chart.draw_chart(measured)
    boxes, frame = texts(figure), figure.axes[0].get_window_extent()
    shown = [point.label for point in measured.best]
    assert len(shown) == 12 and set(shown) | {"default"} <= set(boxes)
    for name in shown + ["default"]:
        box = boxes[name]
        assert frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1, name
        assert not any(box.overlaps(boxes[other]) for other in shown if other != name), name
        for point in measured.points:
            at = figure.axes[0].transData.transform((1e3 * point.seconds.median, point.error))
            assert not box.contains(*at) or name == "default", (name, point.label)


def test_small_steps_have_no_label(measured):
    point = measured.best[-1]
    close = attrs.evolve(point, error=point.error * .99, label="hardly better",
                         seconds=attrs.evolve(point.seconds, median=1.0))
    assert "hardly better" not in texts(chart.draw_chart(attrs.evolve(measured, points=[*measured.points, close])))


@pytest.mark.parametrize("count", [0, 1])
def test_few_points(measured, count):
    few = attrs.evolve(measured, points=[attrs.evolve(p, error=e) for p, e in zip(measured.points[:count + 2],
                                                                                [np.nan, 0.0, .1][2 - count:])])
    figure = chart.draw_chart(few)
    figure.draw_without_rendering()


def test_the_noise_can_be_read(measured):
    """Points that only the truth's noise keeps from it lie on its line."""
    points = [attrs.evolve(point, error=.04) if point.seconds.median > .05 else point for point in measured.points]
    slow = attrs.evolve(points[-1], name="")
    points += [attrs.evolve(slow, seconds=attrs.evolve(slow.seconds, median=t)) for t in (.35, .4, .45)]
    figure = chart.draw_chart(attrs.evolve(measured, points=points, noise=.0395))
    box, axes = texts(figure)["noise of the truth"], figure.axes[0]
    frame = axes.get_window_extent()
    assert frame.y0 <= box.y0 and box.x1 <= frame.x1
    for point in points:
        x, y = axes.transData.transform((1e3 * point.seconds.median, point.error))
        assert not (box.x0 - 5 < x < box.x1 and box.y0 - 5 < y < box.y1 + 3)


@pytest.mark.parametrize("field, values, words", [
    ("shadows", ("length", "count"), {"shadows: length", "shadows: count"}),
    ("filtered", (True, False), {"filtered", "unfiltered"})])
def test_colours_say_what_differs(measured, field, values, words):
    points = [attrs.evolve(point, settings=attrs.evolve(clfur.Settings(), **{field: values[n % 2]}))
              for n, point in enumerate(measured.points)]
    figure = chart.draw_chart(attrs.evolve(measured, points=points))
    assert {text.get_text() for text in figure.legends[0].get_texts()} == words | {"4 samples", "frontier"}


@pytest.mark.parametrize("name", ["a.html", "a.svg"])
def test_no_folder_of_anybody_is_told(measured, tmp_path, name):
    chart.save_chart(tmp_path / name, attrs.evolve(measured, device="a driver of /HOME/karl/lib"), "/srv/karl/pot")
    text = (tmp_path / name).read_text(encoding="utf-8")
    assert "karl" not in text and ".../lib" in text and ".../pot" in text


@pytest.mark.parametrize("name", ["a.png", "a.svg", "a.html"])
def test_files(measured, tmp_path, name):
    chart.save_chart(tmp_path / name, measured, "tea & pot")
    assert [file.name for file in tmp_path.iterdir()] == [name]
    if name == "a.png":
        assert load_picture(tmp_path / name).shape == (990, 1650, 3)
        return
    text = (tmp_path / name).read_text(encoding="utf-8")
    if name == "a.svg":
        ElementTree.fromstring(text)
        assert "shadow grid 16" in text
        return
    for words in ("tea &amp; pot", "PoCL 3.0 · &lt;b&gt;Chip", "1 sample, shadow grid 16", "(default)", "0.2000",
                  "90.0%", "20.0 (18.0–22.0)", "–", "0.0040 in error", "currentColor"):
        assert words in text, words
    assert text.count("<tr") == 2 + 12 + 41 and text.count('class="best"') == 24
    text = re.sub(r'xmlns(:xlink)?="http://[^"]*"', "", text)
    assert "//" not in text and not re.search(r"<script|<link|@import|url\((?!#)", text)   # it needs nothing else


@pytest.mark.parametrize("path, words", [
    ("a.pdf", "a.pdf: .pdf is not supported; allowed: .html, .htm, .png, .svg"),
    ("missing/a.png", "there is no folder missing"), ("folder.png", "is a folder")])
def test_where_it_cannot_be_written(measured, tmp_path, monkeypatch, path, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(clfur.Error, match=re.escape(words)):
        chart.save_chart(path, measured, "teapot")
    assert [file.name for file in tmp_path.iterdir()] == ["folder.png"]


@pytest.mark.parametrize("package, name", [("matplotlib", "a.png"), ("matplotlib", "a.html"), ("jinja2", "a.html")])
def test_without_the_extra(tmp_path, monkeypatch, package, name):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(clfur.Error, match=rf'a chart needs {package}: pip install "clfur\[report\]"'):
        chart.check_chart(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_failed_chart_leaves_nothing(measured, tmp_path, monkeypatch):
    monkeypatch.setattr(chart, "draw_chart", lambda *_: 1 / 0)
    for name in "a.png", "a.html":
        with pytest.raises(clfur.Error, match=f"{name}: cannot be written: division by zero"):
            chart.save_chart(tmp_path / name, measured, "teapot")
    assert not list(tmp_path.iterdir())
