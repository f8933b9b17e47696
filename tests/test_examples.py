"""Each script of examples/ runs, small, and writes pictures that show something."""

import runpy
from pathlib import Path

import imageio.v3
import numpy as np
import pytest

import clfur

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SMALLER = {"curves": {"strands": 200, "points": 8}, "turntable": {"frames": 2},
           "motion": {"frames": 2, "roots": 500}, "turning": {"frames": 2}, "shells": {"frames": 2},
           "dataset": {"poses": 2}, "budget": {"max_error": .3, "seconds": 5.0}}


def test_there_are_seventeen():
    assert len(EXAMPLES) == 17 and set(SMALLER) <= {path.stem for path in EXAMPLES}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_writes_pictures(path, tmp_path, monkeypatch):
    fewer = clfur.Strands.__init__

    def init(self, *args, roots="faces", **options):   # as many strands as so small a picture can show
        fewer(self, *args, roots=roots if isinstance(roots, str) else min(roots, 2000), **options)
    monkeypatch.setattr(clfur.Strands, "__init__", init)
    runpy.run_path(str(path))["main"](tmp_path, size=(32, 24), **SMALLER.get(path.stem, {}))
    written = sorted(tmp_path.iterdir())
    assert written and all(file.stem.startswith(path.stem) for file in written)
    for file in written:
        if file.suffix == ".npz":
            with np.load(file) as saved:
                assert saved["color"].shape == (24, 32, 4) and (saved["id"] >= 0).any()
        elif file.suffix == ".png":
            assert imageio.v3.imread(file)[..., :3].std() > 5
        else:
            assert file.suffix == ".exr" and file.stat().st_size > 1000


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short(path):
    text = path.read_text()
    assert text.startswith('"""') and len(text.splitlines()) <= 50 and "/work" not in text
