"""Each picture of the gallery is made by its script, small, and shows something; the page shows all that there are."""

import functools
import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import attrs
import imageio.v3
import numpy as np
import pytest

import clfur

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = sorted({path.stem for path in (ROOT / "examples" / "gallery").glob("*.py")} - {"studio"})
SHOWN = ROOT / "docs" / "gallery"
SMALLER = {"dandelion": {"seeds": 20}, "meadow": {"blades": 800}, "portrait": {"strands": 800}, "wind": {"roots": 4000}}


@pytest.fixture
def gallery(monkeypatch):
    """A function that imports a module of the gallery, whose bodies are coarse and whose hair is sparse."""
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "gallery"))
    before, fewer = set(sys.modules), clfur.Strands.__init__

    def init(self, *args, roots="faces", **options):
        fewer(self, *args, roots=roots if isinstance(roots, str) else min(roots, 3000), **options)
    monkeypatch.setattr(clfur.Strands, "__init__", init)
    monkeypatch.setattr(importlib.import_module("models.animals"), "CELLS", 24)
    yield importlib.import_module
    for name in set(sys.modules) - before:
        if name.split(".")[0] in {*SCRIPTS, "studio", "models"}:
            del sys.modules[name]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_picture_of_the_gallery_shows_something(name, gallery, tmp_path):
    picture = getattr(gallery(name), name)
    if name == "wind":
        picture = attrs.evolve(picture, shoot=functools.partial(picture.shoot, frames=range(2)))
    picture.draw(tmp_path / f"{name}.png", (32, 24), **SMALLER.get(name, {}))
    image = imageio.v3.imread(tmp_path / f"{name}.png")
    assert image[..., :3].std() > 5 and image.shape[-3:-1] == (24, 32)


@pytest.mark.parametrize("name", SCRIPTS)
def test_scripts_of_the_gallery_take_the_same_arguments(name, gallery, monkeypatch, capsys):
    picture, drawn = getattr(gallery(name), name), []
    monkeypatch.setattr(type(picture), "draw", lambda self, file, size: drawn.append((file, size)))
    for arguments, code in (([], 0), (["--size", "40x30", "-o", "there.png"], 0), (["--sizes", "40x30"], 2),
                            (["there.png"], 2), (["--size", "40"], 2)):
        with pytest.raises(SystemExit) as end:
            picture(arguments)
        assert end.value.code == code
    assert drawn == [(f"{name}.png", picture.size), ("there.png", (40, 30))]
    assert "WIDTHxHEIGHT" in capsys.readouterr().err


def test_what_a_script_of_the_gallery_cannot_do_is_told(gallery, capsys):
    def refuse(scene, file):
        raise clfur.Error(f"{file} is refused")
    with pytest.raises(SystemExit) as end:
        attrs.evolve(gallery("dandelion").dandelion, scene=lambda size: None, shoot=refuse)(["-o", "there.png"])
    assert end.value.code == 2 and "Error: there.png is refused" in capsys.readouterr().err


def test_a_script_of_the_gallery_runs_as_it_stands(tmp_path):
    script = str(ROOT / "examples" / "gallery" / "dandelion.py")
    subprocess.run([sys.executable, script, "--size", "40x30"], cwd=tmp_path, check=True, timeout=100,
                   env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert [path.name for path in tmp_path.iterdir()] == ["dandelion.png"]
    assert imageio.v3.imread(tmp_path / "dandelion.png").shape[:2] == (30, 40)


def test_a_body_of_the_gallery_is_closed_and_where_its_shape_is(gallery):
    animals = gallery("models.animals")
    shape = animals.joined(animals.ball((0, 0, 0), (1, .7, .8), (10, 20, 30)),
                           animals.both(animals.cone((.5, .5, 0), (.8, 1, 0), .3, .2)))
    places, normals, faces = animals.surface(shape, (-1.5, -1.5, -1.5), (1.5, 1.5, 1.5), 40)
    assert abs(shape(places)).max() < 1e-3
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), 1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    corners = places[faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fi->f", facing, normals[faces[:, 0]]) > 0).mean() > .99


def test_the_page_shows_every_picture():
    page, measured = (ROOT / "docs" / "gallery.md").read_text(), json.loads((SHOWN / "measured.json").read_text())
    assert set(SCRIPTS) <= set(measured) and len(measured) >= 15
    assert all({"cpu", "error"} <= set(one) for one in measured.values())
    assert {path.stem for path in SHOWN.glob("*.webp")} == {*measured, "banner"}
    for name in measured:
        assert f"(gallery/{name}.webp)" in page and (SHOWN / f"{name}.webp").stat().st_size < 400_000
    assert set(re.findall(r"examples/gallery/(\w+)\.py", page)) >= set(SCRIPTS)
    for path in re.findall(r"docs/gallery/[\w.]+", (ROOT / "README.md").read_text()):
        assert (ROOT / path).is_file()


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_of_the_gallery_is_short(name):
    text = (ROOT / "examples" / "gallery" / f"{name}.py").read_text()
    assert text.startswith('"""') and len(text.splitlines()) <= 25 and "/work" not in text
