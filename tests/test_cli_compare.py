"""`clfur compare`: what it prints, its page, its exit codes, and that it ends when it is told to."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import attrs
import click
import pytest
from support.command import wrong

from clfur.command import compare as cli_compare
from clfur.command import devices as cli_devices
from clfur.command.options import command_line
from clfur.judge.isolated import Outcome

TINY = ["--size", "32x24", "--roots", "100", "--inner", "1", "--outer", "1", "--repeat", "1"]


def test_compare(clfur, tmp_path):
    """All of it, from a scene file to the page, on the device there is."""
    (tmp_path / "fur.py").write_text(
        "import clfur\nsettings = clfur.Settings(samples=1)\nscene = clfur.Scene(mesh=clfur.load_mesh('sphere'), "
        "fur=clfur.Strands(inner=1, outer=1, roots=100), camera=clfur.Camera(size=(32, 24)))\n")
    code, out, err = clfur("compare", "fur.py", "--devices", "auto", "--repeat", "1", "-o", "a.html", "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert (result["scene"], result["report"], result["agree"]) == ("fur.py", "a.html", True)
    assert (result["size"], result["strands"], result["settings"]["samples"], result["repeat"]) == ([32, 24], 100, 1, 1)
    assert [row["status"] for row in result["rows"]] == ["ok"]
    assert result["rows"][0]["difference"]["same"]["voxels"] is True
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "fur on 1 device<" in page and page.count("<img") == 2
    assert "<code>clfur compare fur.py --devices auto --repeat 1 -o a.html --json</code>" in page
    assert result["fastest"].startswith(f"{result['rows'][0]['device']} takes ")
    assert {file.name for file in tmp_path.iterdir()} == {"fur.py", "a.html"}


def test_a_page_tells_no_folders():
    given = ["compare", "/srv/karl may/fur.obj", "--map", "length=../karl/a=b.png", "--types=C:\\Users\\karl\\t.json",
             "-o/srv/karl/a.html", "--on", "left ear", "--size", "32x24", "karl/"]
    with click.Context(click.Command("compare"), obj=given):
        assert command_line() == ("clfur compare fur.obj --map length=a=b.png --types=t.json -oa.html "
                                  "--on 'left ear' --size 32x24 karl/")


@pytest.fixture
def made(comparison, monkeypatch):
    """`clfur.compare` gives the Comparison made up; the list gets its arguments."""
    given = []
    monkeypatch.setattr(cli_compare, "compare_devices", lambda *arguments, tell: given.append(arguments) or comparison)
    return given


def test_tables(clfur, made):
    code, out, err = clfur("compare", *TINY, "--devices", "pocl, rusticl", "--repeat", "7", "--grid", "32")
    assert (code, err) == (1, "")   # one crashed, one differs
    scene, devices, settings, repeat = made[0]
    assert (devices, settings.grid, repeat, scene.camera.size) == ("pocl, rusticl", 32, 7, (32, 24))
    assert out.startswith("teapot: 16x12, 1,000 strands, 8,000 segments, 3 warm frames a device\n")
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert lines[1] == "pocl is fastest, 500 ms a frame; rusticl takes about as long"   # what differs is not named
    for line in ("pocl PoCL 3.0 · <b>Chip</b> ok, the reference", "odd Odd driver · Chip differs: other bits in voxels",
                 "bad Bad driver · Chip crash: the process died of SIGSEGV (after 1 of 5 frames)",
                 "pocl 500 (250–1,000) 8,000 2,500 2,000 3 600", "rusticl not reported", "pocl 125 250",
                 "62.5–250 125–500",
                 "odd 0.25 0.521% 0.01 same bits differs", "difference to pocl"):
        assert line in lines, line
    assert "\x1b" not in out and max(map(len, out.splitlines())) <= 120


def test_all_agree(clfur, made, comparison):
    comparison.rows[2:] = []
    assert clfur("compare", *TINY)[0] == 0


def test_none_works(clfur, made, comparison, monkeypatch):
    lost = attrs.evolve(comparison, rows=[comparison.rows[2]], reference=None, strands=None, segments=None)
    monkeypatch.setattr(cli_compare, "compare_devices", lambda *_, **__: lost)
    code, out, err = clfur("compare", *TINY)
    assert (code, err) == (1, "") and "SIGSEGV" in out and "difference" not in out and "fast" not in out
    assert json.loads(clfur("compare", *TINY, "--json")[1])["reference"] is None


def test_without_flip(clfur, made, comparison):
    row = comparison.rows[0]
    comparison.rows[0] = attrs.evolve(row, difference=attrs.evolve(row.difference, flip=None))
    code, out, _ = clfur("compare", *TINY)
    assert code == 1 and "needs pip install flip_evaluator" in out


@pytest.mark.parametrize("arguments, words", [
    (["--devices", "auto,abacus"], ["no OpenCL device matches 'abacus'; allowed: auto, ", "what is there: "]),
    (["--devices", ""], ["''"]),
    (["--repeat", "0"], ["--repeat"]),
    (["-o", "a.pdf"], ["a.pdf", ".html"]),
    (["-o", "missing/a.html"], ["missing"]),
    (["cow"], ["cow"]),
    (["missing.py"], ["missing.py: no such file"]),
    (["--size", "0x1"], ["--size"]),
])
def test_wrong_arguments(clfur, tmp_path, monkeypatch, arguments, words):
    monkeypatch.setattr("clfur.judge.compare.isolated", None)   # nothing is drawn
    wrong(clfur("compare", *arguments), *words)
    assert not list(tmp_path.iterdir())


def test_a_page_without_the_extra(clfur, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    wrong(clfur("compare", *TINY, "-o", "a.html"), 'pip install "clfur[report]"')
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [("compare", *TINY), ("render", "sphere", *TINY[:-2])])
def test_a_driver_that_crashes_while_it_loads(clfur, tmp_path, monkeypatch, command):
    """It would take this process along: it is told before OpenCL starts here, and what crashed is not remembered."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    crash = Outcome("crash", None, "the process died of SIGABRT")
    monkeypatch.setattr(cli_devices, "isolated", lambda *_, **__: crash)
    for _ in range(2):
        wrong(clfur(*command), "OpenCL does not start: the process died of SIGABRT", "clfur devices --why")


def test_interrupted(tmp_path):
    """Ctrl-C ends it and the process of the device at once, and leaves no page."""
    def children(pid):
        return Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    command = subprocess.Popen(
        [sys.executable, "-m", "clfur", "compare", "sphere", *TINY, "--devices", "auto", "--repeat", "9999", "-o",
         "a.html"], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    began = time.monotonic()
    while not children(command.pid):
        assert command.poll() is None and time.monotonic() - began < 60
        time.sleep(0.05)
    child = children(command.pid)[0]
    time.sleep(1)
    command.send_signal(signal.SIGINT)
    out, err = command.communicate(timeout=10)
    assert (command.returncode, out, err.strip()) == (130, "", "clfur: interrupted")
    assert not Path(f"/proc/{child}").exists() and not list(tmp_path.iterdir())
