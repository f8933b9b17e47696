"""Pages: whole in themselves, escaped, and honest about what failed."""

import re
import sys
from xml.etree import ElementTree

import attrs
import numpy as np
import pytest

import clfur
from clfur.judge import report


@pytest.fixture
def text(comparison, tmp_path):
    report.save_report(tmp_path / "a.html", comparison, "tea & pot", "clfur compare 'a b'")
    assert [file.name for file in tmp_path.iterdir()] == ["a.html"]
    return (tmp_path / "a.html").read_text(encoding="utf-8")


def test_the_page_needs_nothing_else(text):
    names = {'xmlns="http://www.w3.org/2000/svg"', 'xmlns:xlink="http://www.w3.org/1999/xlink"'}
    for name in names:
        text = text.replace(name, "")
    assert "//" not in re.sub(r"data:image/png;base64,[\w+/=]*", "", text)   # an address
    assert all(source.startswith("data:") for source in re.findall(r'src="([^"]*)', text))
    assert not re.search(r"<script|<link|@import|url\((?!#)", text)


def test_the_page_shows_every_device(text):
    for words in ("tea &amp; pot on 4 devices", "PoCL 3.0 · &lt;b&gt;Chip", "2 of",
                  "the process died of SIGSEGV (after 1 of 5 frames)", "other bits in voxels", "500 (250–1,000)",
                  "pocl is fastest, 500 ms a frame; rusticl takes about as long.", "500 ms, differs",
                  f"clfur {clfur.__version__}, {report.system()}, 20", "<code>clfur compare &#39;a b&#39;</code>",
                  "2,000", "not reported", "Difference to pocl", "same bits", "0.521 %", "125<br>"):
        assert words in text, words
    assert text.count("data:image/png;base64,") == 7   # the picture and the difference of three, and the scale
    assert text.count("<svg") == 3
    for chart in re.findall(r"<svg.*?</svg>", text, re.S):
        ElementTree.fromstring(chart)
        assert "currentColor" in chart and report.INK not in chart
    ids = re.findall(r'<(?:clipPath|path|pattern) id="([^"]*)"', text)
    assert len(ids) == len(set(ids)) > 0


def test_the_page_answers_speed_first(text):
    """Which device is fastest stands ahead of all else, then how long each takes."""
    body = text[text.index("<body>"):]
    assert body.index("is fastest") < body.index('class="bars"') < body.index('class="verdict') < body.index("<table>")


def test_a_page_of_failures(comparison, tmp_path):
    lost = attrs.evolve(comparison, rows=[comparison.rows[2]], reference=None, strands=None, segments=None,
                        triangles=None)
    report.save_report(tmp_path / "a.html", lost, "teapot")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "SIGSEGV" in text and "<svg" not in text and "fastest" not in text and "<code>" not in text


def test_no_folder_of_anybody_is_told(comparison, tmp_path):
    """Whatever a driver says, in every text of a page; pictures and what is no path stay."""
    rows = [attrs.evolve(row, message=f"cannot open '/HOME/karl may/x/{row.device}.so': no {row.device}",
                         name="Chip of C:\\Users\\Karl May\\a.dll") for row in comparison.rows]
    told = attrs.evolve(comparison, rows=rows)
    report.save_report(tmp_path / "a.html", told, "/srv/karl/teapot", "clfur compare ~karl/a.obj")
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "karl" not in text.lower() and "cannot open &#39;.../pocl.so&#39;: no pocl" in text and ".../teapot" in text
    assert "Chip of .../a.dll" in text and ".../a.obj" in text
    report.save_report(tmp_path / "b.html", comparison, "teapot")
    pictures = [re.findall(r'data:image[^"]*', (tmp_path / f"{name}.html").read_text(encoding="utf-8"))
                for name in "ab"]
    assert pictures[0] == pictures[1] and "/" in pictures[0][0][22:]


def test_colours_of_a_difference():
    one = np.zeros((1, 4, 4), np.float32)
    other = one.copy()
    other[0, 1:, 2] = 1e-5, 1, np.nan
    picture = report.difference_picture(one, other)
    brightness = picture.sum(axis=2)[0]
    assert picture.shape == (1, 4, 3) and brightness[0] < 0.01
    assert brightness[0] < brightness[1] < brightness[2] == brightness[3]


@pytest.mark.parametrize("seconds, words", [
    (0, "0.00"), (1.234e-3, "1.23"), (12.34e-3, "12.3"), (0.1234, "123"), (0.09996, "100"), (1.5, "1,500")])
def test_milliseconds(seconds, words):
    assert report.milliseconds(seconds) == words


@pytest.mark.parametrize("path, words", [
    ("a.pdf", "a.pdf: .pdf is not supported; allowed: .html, .htm"), ("missing/a.html", "there is no folder missing")])
def test_where_it_cannot_be_written(comparison, tmp_path, monkeypatch, path, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(clfur.Error, match=re.escape(words)):
        report.save_report(path, comparison, "teapot")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("package", ["matplotlib", "jinja2"])
def test_without_the_extra(tmp_path, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(clfur.Error, match=rf'a report needs {package}: pip install "clfur\[report\]"'):
        report.check_report(tmp_path / "a.html")
    assert not list(tmp_path.iterdir())


def test_a_failed_page_leaves_nothing(comparison, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "page", lambda *_, **__: 1 / 0)
    with pytest.raises(clfur.Error, match="a.html: cannot be written: division by zero"):
        report.save_report(tmp_path / "a.html", comparison, "teapot")
    assert not list(tmp_path.iterdir())
