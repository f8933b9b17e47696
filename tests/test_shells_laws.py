"""What shell fur is held to in pictures: little error and flicker from near to far, whatever the number of layers."""

import importlib.util
from pathlib import Path

import pytest

import clfur

spec = importlib.util.spec_from_file_location("shells_laws", Path(__file__).parents[1] / "tools" / "shells_laws.py")
laws = importlib.util.module_from_spec(spec)
spec.loader.exec_module(laws)


@pytest.fixture(params=["cells", "sine"])
def furred(gpu, request):
    return laws.Furred(gpu, laws.ball(), clfur.Shells(length=0.1, pattern=request.param, frequency=100.0))


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(laws, "SIZE", (48, 36))
    monkeypatch.setattr(laws.before, "__defaults__", ((48, 36),))


@pytest.mark.parametrize("apart", [0.5, 0.25, 0.1])
def test_the_filter_takes_two_thirds_of_the_error(furred, apart):
    _, _, _, ratio, *_, bright = laws.errors(furred, apart)
    assert ratio <= 1 / 3 and abs(bright - 1) < 0.05


@pytest.mark.parametrize("apart", [1, 0.25, 0.1])
def test_the_filter_takes_two_thirds_of_the_flicker(furred, apart):
    assert laws.flicker(furred, apart)[3] < 1 / 3


@pytest.mark.parametrize("apart", [4, 1, 0.25])
def test_brightness_does_not_hang_on_layers(furred, apart):
    _, fewer, more, *_ = laws.layers(furred, apart)
    assert abs(fewer) < 2 and abs(more) < 2


def test_edges_show_no_layers(furred):
    """With half the layers or twice as many the silhouette is the same, within 1 % of white."""
    camera = laws.frame(furred.mesh, furred.fur, (80, 60))
    pictures = [furred.draw(camera, True, layers=layers) for layers in (15, 30, 60)]
    alpha = pictures[1][..., 3]
    edge = (alpha > 0.001) & (alpha < 0.999)
    assert edge.sum() > 100
    for other in (pictures[0], pictures[2]):
        assert laws.rms(other - pictures[1], edge) < 0.01
