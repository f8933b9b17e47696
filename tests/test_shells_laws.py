"""What shell fur is held to in pictures: little error and flicker from near to far, whatever the number of layers."""

import importlib.util
from pathlib import Path

import attrs
import numpy as np
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


@pytest.mark.parametrize("mesh, pattern", [("sphere", "cells"), ("sphere", "sine"), ("teapot", "cells")])
def test_time_does_not_grow_beyond_what_a_pixel_shows(gpu, mesh, pattern):
    """Frequency a thousand times as high costs less than twice the time: resolved, it would be 20 to 40 times."""
    mesh = clfur.load_mesh(mesh)
    radius = mesh.bounds[1]
    fur = clfur.Shells(length=0.1 * radius, frequency=20 / radius, pattern=pattern)
    camera = laws.frame(mesh, fur, (160, 120))

    def seconds(frequency):
        scene = clfur.Scene(mesh, attrs.evolve(fur, frequency=fur.frequency * frequency), camera)
        frames = [clfur.draw(scene, gpu, clfur.Settings(shadows="off")) for _ in range(4)]
        return min(dict(frame.stages)["march"] for frame in frames[1:])
    few = seconds(1)
    assert max(seconds(100), seconds(1000)) < 2 * few


def test_crowds_are_as_their_cells_would_be(furred):
    """On either side of the brink where no cell is looked for any more: as bright as the truth, to 3 %."""
    truths = [laws.errors(furred, apart) for apart in (.7, .4)]
    for _, error, unfiltered, *_, bright in truths:
        assert error < .5 * unfiltered and abs(bright - 1) < .03


@pytest.mark.parametrize("options", [{}, {"pattern": "sine"}, {"frequency": 10.0}, {"frequency": 200.0},
                                     {"frequency": 4000.0}, {"density": .3}, {"wind": (.5, 0, .2)}], ids=str)
def test_a_picture_twice_as_large_covers_the_same(gpu, options):
    """Averaged down its coverage is the same within .02 on average, with one sample a pixel and with four."""
    mesh, fur = laws.ball(), clfur.Shells(length=.12, **options)
    small = laws.frame(mesh, fur, (64, 48))
    large = laws.Camera.calibrated(small.pose, small.intrinsics * [[2], [2], [1]], (128, 96))
    for samples in (1, 4):
        settings = clfur.Settings(samples=samples, shadows="off")
        one, other = (clfur.draw(clfur.Scene(mesh, fur, camera, body_color=None), gpu, settings, ("coverage",)
                                 ).images["coverage"].astype(float) for camera in (small, large))
        off = other.reshape(48, 2, 64, 2).mean((1, 3)) - one
        assert abs(off.mean()) < .02 and np.sqrt((off**2).mean()) < .08
