"""Large meshes in the command: how many strands they get without options, and what is told while one waits."""

import importlib
import json
import sys
import time

import numpy as np
import pytest
from support.scenes import icosphere

from clfur.command import described, waiting
from clfur.device import caches


@pytest.mark.parametrize("faces, inner", [
    (0, 5), (12, 5), (6320, 5), (6756, 5), (6757, 4), (10_417, 3), (19_231, 2), (41_667, 1), (4_000_000, 1)])
def test_default_density(faces, inner):
    """As many strands by area on every mesh, as fine as 250,000 triangles allow, at most 5: 37 of a face."""
    none = dict.fromkeys(("inner", "outer", "roots"))
    assert described.density(none, faces) == {"inner": inner, "outer": inner, "roots": 100_000}
    for roots in 7, "faces":
        assert described.density(none | {"roots": roots}, faces) == {"inner": inner, "outer": inner, "roots": roots}


def test_what_is_given_counts():
    given = {"inner": 3, "outer": None, "roots": None}
    assert described.density(given, 10**6) == {"inner": 3, "outer": 5, "roots": "faces"}
    assert described.density(given | {"inner": None, "outer": 2}, 10**6) == {"inner": 5, "outer": 2, "roots": "faces"}
    assert described.density(given | {"roots": "faces", "inner": None}, 10**6)["roots"] == "faces"


@pytest.mark.parametrize("level", range(1, 7))
def test_triangles_of_a_face(level):
    from clfur.stages.tessellate import counts_of, levels_of
    assert described.triangles_of_face(level) == counts_of(levels_of(level, level, 1))[1][0]


def test_a_large_mesh(clfur, tmp_path):
    """20,480 faces with a strand a triangle get level 2 and six, said in the line and in JSON; --inner counts more."""
    positions, faces = icosphere(5)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in positions] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    draw = ["render", "ball.obj", "--size", "32x24", "--segments", "1", "--roots", "faces", "-o", "a.npz"]
    code, out, err = clfur(*draw)
    assert (code, err) == (0, "") and "a.npz: 122,880 strands" in out
    assert out.endswith("\n    tessellation level 2 in place of 5, as the mesh is large\n")
    told = json.loads(clfur(*draw, "--json")[1])
    assert told["strands"] == 6 * 20_480 and told["fewer"] == "tessellation level 2 in place of 5, as the mesh is large"
    before = np.load(tmp_path / "a.npz")["color"]
    told = json.loads(clfur(*draw, "--json", "--inner", "2", "--outer", "2")[1])
    assert told["fewer"] == "" and np.array_equal(np.load(tmp_path / "a.npz")["color"], before)


@pytest.mark.parametrize("options, strands", [([], 100_000), (["--roots", 9], 9), (["--roots", "faces"], 37),
                                              (["--inner", 3, "--outer", 3], 13)])
def test_a_mesh_of_one_face(clfur, tmp_path, options, strands):
    """It is not bald without options; nothing is told, as nothing is fewer."""
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    code, out, err = clfur("grow", "a.obj", "-o", "a.npz", "--segments", 1, *options)
    assert (code, out, err) == (0, f"a.npz: {strands:,} strands, {2 * strands:,} points\n", "")


class Terminal:
    """A stderr that says whether it is a terminal."""

    def __init__(self, is_terminal):
        self.is_terminal, self.text = is_terminal, ""

    def isatty(self):
        return self.is_terminal

    def write(self, text):
        self.text += text
        return len(text)

    def flush(self):
        pass


@pytest.mark.parametrize("is_terminal, patience, told", [(True, 0.05, True), (True, 60, False), (False, 0.05, False)])
def test_waiting(monkeypatch, is_terminal, patience, told):
    """After a while, on a terminal, and gone at the end."""
    stderr = Terminal(is_terminal)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(waiting, "PATIENCE", patience)
    with waiting.waiting("reading [a]") as tell:
        time.sleep(0.3)
        tell("drawing it")
        time.sleep(0.3)
        with caches.taking_kernels("a driver"):
            time.sleep(0.3)
    assert all((words in stderr.text) == told for words in ("reading [a]", "drawing it", "it, building kernels"))
    assert stderr.text == "" or "\x1b[2K" in stderr.text


@pytest.mark.parametrize("command", ["render", "compare", "chart"])
def test_that_a_mesh_is_read_is_told(monkeypatch, command):
    """Before there is a picture to tell of, by each command that draws."""
    module = importlib.import_module(f"clfur.command.{command}")

    def slow(given, options):
        time.sleep(0.3)
        raise InterruptedError(given)
    stderr = Terminal(True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(waiting, "PATIENCE", 0.05)
    monkeypatch.setattr(module, "load_moving" if command == "render" else "load_scene", slow)
    with pytest.raises(InterruptedError):
        getattr(module, command).main(["large.obj"], standalone_mode=False)
    assert "reading large.obj" in stderr.text
