"""`clfur chart`: what it prints and writes, what it refuses, and that it ends when it is told to."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from support.command import wrong

from clfur import Settings
from clfur.command import chart as cli_chart
from clfur.judge import frontier as library
from clfur.judge.frontier import sweep

TINY = ["--size", "16x12", "--roots", "50", "--inner", "1", "--outer", "1"]


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


@pytest.fixture
def made(measured, monkeypatch):
    """`clfur.frontier` gives the Frontier made up; the list gets its arguments."""
    given = []
    monkeypatch.setattr(cli_chart, "frontier", lambda scene, **how: given.append((scene, how)) or measured)
    return given


def test_chart(clfur, tmp_path, monkeypatch):
    """All of it, from a mesh to the page; in the second run nothing is measured."""
    def truth(scene, **_):
        (width, height) = scene.camera.size
        return np.full((height, width, 4), .5)
    monkeypatch.setattr(library.truth, "picture", truth, raising=False)
    monkeypatch.setattr(library.truth, "VERSION", 0, raising=False)
    monkeypatch.setattr(library, "sweep", lambda scene: sweep(scene)[::4])
    code, out, err = clfur("chart", "sphere", *TINY, "--repeat", "1", "--no-pan", "-o", "a.html", "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert (result["scene"], result["chart"], result["size"], result["earlier"]) == ("sphere", "a.html", [16, 12], 0)
    assert len(result["points"]) >= 8 and any(point["best"] for point in result["points"])
    assert {point["strands"] for point in result["points"]} >= {50}
    code, out, err = clfur("chart", "sphere", *TINY, "--repeat", "1", "--no-pan", "-o", "a.png", "--json")
    assert code == 0 and json.loads(out)["earlier"] == len(result["points"])
    assert "sphere: speed against accuracy" in (tmp_path / "a.html").read_text(encoding="utf-8")
    assert {file.name for file in tmp_path.iterdir()} == {"a.html", "a.png"}


def test_table(clfur, made):
    code, out, err = clfur("chart", "--repeat", "7", "--device", "auto", "--fresh", "--roots", "50")
    assert (code, err) == (0, "")
    scene, how = made[0]
    how.pop("tell")
    assert how == {"device": "auto", "repeat": 7, "pan": True, "fresh": True, "own": None}
    assert scene.camera.size == (320, 240)
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert lines[0] == "teapot: 32x24 on PoCL 3.0 · <b>Chip</b>; 41 settings, 41 warm frames"
    assert lines[1] == "the truth: brute force, itself 0.0040 in error"
    assert "1 sample, shadow grid 16 20.0 (18.0–22.0) 0.2000 – -0.0100 90.0% 0.1000" in lines
    assert "4 samples, coverage, shadow grid 96 (default) 500 (500–500) 0.1000 0.0300 +0.0200 – –" in lines
    assert lines[-1] == "not on it: default"
    assert len(lines) == 2 + 1 + 2 + 12 + 2 and "\x1b" not in out and max(map(len, out.splitlines())) <= 120


def test_a_scene_file_brings_its_own_camera(clfur, made, tmp_path):
    (tmp_path / "fur.py").write_text("import clfur\nscene = clfur.Scene(mesh=clfur.load_mesh('sphere'))\n")
    assert clfur("chart", "fur.py")[0] == 0
    assert made[0][0].camera.size == (640, 480) and made[0][0].strands is None and made[0][1]["own"] is None


@pytest.mark.parametrize("given, expected", [("samples=16", Settings(samples=16)), ("max_error=.1", None)])
def test_a_scene_files_settings_are_charted_too(clfur, made, tmp_path, given, expected):
    (tmp_path / "fur.py").write_text("import clfur\nscene = clfur.Scene(mesh=clfur.load_mesh('sphere'))\n"
                                     f"settings = clfur.Settings({given})\n")
    assert clfur("chart", "fur.py")[0] == 0
    assert made[0][1]["own"] == expected


@pytest.mark.parametrize("arguments, words", [
    (["--device", "abacus"], ["no OpenCL device matches 'abacus'"]),
    (["--repeat", "0"], ["--repeat"]),
    (["-o", "a.pdf"], ["a.pdf", ".html"]),
    (["-o", "missing/a.html"], ["missing"]),
    (["cow"], ["cow"]),
    (["--samples", "4"], ["--samples"]),
    (["--size", "4000x10"], ["4000x10", "2047"]),
])
def test_wrong_arguments(clfur, tmp_path, monkeypatch, arguments, words):
    monkeypatch.setattr(library, "draw", None)   # nothing is drawn
    monkeypatch.setattr(library.truth, "picture", None, raising=False)
    wrong(clfur("chart", *arguments), *words)
    assert not list(tmp_path.iterdir())


def test_without_the_extra(clfur, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr(library, "draw", None)
    wrong(clfur("chart", *TINY, "-o", "a.png"), 'pip install "clfur[report]"')
    assert not list(tmp_path.iterdir())


def test_interrupted(tmp_path):
    """Ctrl-C ends it at once, leaves no chart, and what was measured stays."""
    cache = tmp_path / "cache"
    command = subprocess.Popen(
        [sys.executable, "-m", "clfur", "chart", "sphere", "--fur", "shells", "--frequency", "8", "--size", "16x12",
         "--repeat", "9999", "--no-pan", "-o", "a.png"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1]), "XDG_CACHE_HOME": str(cache)})
    began = time.monotonic()

    def found():
        return sum(file.read_text().count('"found"') for file in cache.glob("clfur/charts/*.jsonl"))
    while not found():
        assert command.poll() is None and time.monotonic() - began < 120
        time.sleep(0.05)
    command.send_signal(signal.SIGINT)
    began = time.monotonic()
    out, err = command.communicate(timeout=10)
    assert time.monotonic() - began < 2
    assert (command.returncode, out, err.strip()) == (130, "", "clfur: interrupted")
    assert [file.name for file in tmp_path.iterdir()] == ["cache"] and found() > 0
