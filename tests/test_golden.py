"""Small pictures, one a feature, look as they did: a change that nobody meant is seen, and can be looked at."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

spec = importlib.util.spec_from_file_location("golden", Path(__file__).parents[1] / "tools" / "golden.py")
golden = importlib.util.module_from_spec(spec)
spec.loader.exec_module(golden)

APART = 2   # of 255: sines, powers and exponentials differ between drivers, and are rounded to 8 bits


def check(name, drawn, folder):
    """Fails where a picture is not the golden one, and leaves both in the folder to be looked at."""
    right = golden.expected(name)
    apart = np.abs(drawn.astype(int) - right).max(2)
    if apart.max() > APART:
        path = folder / f"{name}.png"
        golden.sheet(path, [("expected", right), ("drawn", drawn),
                            (f"difference x {golden.TIMES}", golden.difference(drawn, right))])
        pytest.fail(f"{(apart > APART).sum()} pixels of {name} differ, by up to {apart.max()} of 255: see {path}\n"
                    f"If it is meant to look so: python tools/golden.py {name}")


@pytest.mark.parametrize("name", golden.PICTURES)
def test_a_picture_looks_as_it_did(gpu, tmp_path, name):
    check(name, golden.picture(name, gpu), tmp_path)


def test_a_difference_is_shown(tmp_path):
    """A planted one: the samples' picture in place of that by area."""
    said = r"pixels of strands differ, .*see .*strands\.png\n.*golden\.py strands"
    with pytest.raises(pytest.fail.Exception, match=said):
        check("strands", golden.expected("samples"), tmp_path)
    shown = np.asarray(golden.Image.open(tmp_path / "strands.png"))
    assert shown.shape == (206, 768, 3) and shown[20:, 520:].max() > 200


def test_one_picture_a_feature():
    """Each is there and small, none is left over, and no two are nearly the same."""
    files = sorted(golden.FOLDER.glob("*.png"))
    assert {file.stem for file in files} == set(golden.PICTURES) and len(files) >= 20
    assert all(file.stat().st_size < 7000 for file in files)
    pictures = [golden.expected(file.stem).astype(int) for file in files]
    assert all(picture.shape == (48, 64, 3) for picture in pictures)
    alike = [(a.stem, b.stem) for i, a in enumerate(files) for j, b in enumerate(files[:i])
             if (np.abs(pictures[i] - pictures[j]).max(2) > 10 * APART).mean() < .02]
    assert not alike
