"""Grow, read back, draw: Curves that are grown strands give the same picture, bit for bit."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur

OUTPUTS = "color", "depth", "id", "tangent", "normal", "uv", "coverage"
LONG = clfur.HairType(color=(.6, .4, .2), segments=7, segment_length=.05, width=.01, force_weight=.3, alpha=.4,
                      length_variation=.4, direction_variation=.3, color_variation=.3)
CURLY = attrs.evolve(LONG, curl=(.03, 2), wave=(.01, 3), segments=12, segment_length=.02, exponent=20)
PAINTED = np.zeros((4, 4, 3), np.uint8)
PAINTED[:2, :, 0], PAINTED[2:, :2, 1] = 255, 255
PAINTS = (attrs.evolve(LONG, key=(255, 0, 0)), attrs.evolve(CURLY, key=(0, 255, 0), alpha=.9, specular=.8),
          clfur.HairType(segments=0, key=(0, 0, 0)))
POINTED = clfur.PointForce((.5, 1, .5), 2.0)
SHELLS = clfur.Shells(length=.1, frequency=10, layers=8)


def ball():
    positions, faces = icosphere(1)
    return clfur.Mesh(positions * .7, positions, np.abs(positions[faces][..., :2]), faces)


def same_picture(gpu, scene, settings=None, device=None):
    settings = settings or clfur.Settings(grid=16, shadow_map=64)
    grown = clfur.grow(scene, gpu)
    one, other = (clfur.render(each, device or gpu, settings, OUTPUTS)
                  for each in (scene, attrs.evolve(scene, fur=[SHELLS, grown] if scene.shells else grown)))
    for name, image in one.items():
        np.testing.assert_array_equal(image, other[name], err_msg=name)
    assert (one["id"] >= 0).mean() > .05
    return grown


def furred(fur, **changes):
    return clfur.Scene(ball(), fur, clfur.Camera(eye=(.3, .5, 2.6), size=(57, 43)), **changes)


@pytest.mark.parametrize("raster", ["coverage", "samples"])
@pytest.mark.parametrize("fur", [
    clfur.Strands(inner=2, outer=2, types=LONG), clfur.Strands(roots=800, types=CURLY, point_forces=POINTED),
    clfur.Strands(roots=900, types=PAINTS, type_map=PAINTED, surface="flat", seed=7)], ids=["faces", "area", "map"])
def test_grown_strands_come_back(gpu, fur, raster):
    grown = same_picture(gpu, furred(fur), clfur.Settings(raster=raster, grid=16, shadow_map=64))
    assert len(grown.counts) >= 320 and grown.on_host is grown


@pytest.mark.parametrize("changes", [
    {"light": clfur.Light((-1, -1, -1), position=(1.5, 2, 1.5), angle=40)}, {"body_color": None},
    {"fur": [SHELLS, clfur.Strands(roots=400, types=LONG)]}], ids=["spot", "no-body", "shells"])
def test_whatever_else_is_there(gpu, changes):
    same_picture(gpu, attrs.evolve(furred(clfur.Strands(roots=800, types=LONG)), **changes))


@pytest.mark.parametrize("changes", [
    {"lod": 2.0}, {"shadows": "count"}, {"shadows": "off"}, {"samples": 1}, {"raster": "samples", "lod": 1.0}])
def test_however_it_is_drawn(gpu, changes):
    """The seed tells which strands `Settings.lod` keeps."""
    fur = clfur.Strands(roots=800, types=LONG, seed=3)
    same_picture(gpu, furred(fur), clfur.Settings(**{"grid": 16, "shadow_map": 64, **changes}))


def test_in_parts_too(gpu):
    small = clfur.Scheduler(gpu.device, memory=1_200_000)
    same_picture(small, furred(clfur.Strands(roots=6000, types=LONG)), device=gpu)


def test_growing_after_drawing_stays_within_the_memory(another):
    """What a frame has kept goes first."""
    scene, small = furred(clfur.Strands(roots=6000, types=LONG)), another(4_000_000)
    clfur.draw(scene, small, clfur.Settings(grid=48, shadow_map=128))
    clfur.grow(scene, small)
    assert small.peak <= 4_000_000


def test_arrays_stay_where_they_are_put(gpu):
    """Read back and put on the device again: the base of strands that move there."""
    scene = furred(clfur.Strands(roots=800, types=LONG))
    grown = clfur.grow(scene, gpu)
    placed = attrs.evolve(grown, points=gpu.upload(grown.points), root_normal=gpu.upload(grown.root_normal))
    one, other = (clfur.render(attrs.evolve(scene, fur=fur), gpu) for fur in (scene.fur, placed))
    np.testing.assert_array_equal(one, other)


def test_bald_strands_keep_their_numbers(gpu):
    """As many points as strands: width and colour are of strands nonetheless."""
    types = attrs.evolve(LONG, segments=1, key=(255, 0, 0)), clfur.HairType(segments=0, key=(0, 0, 0))
    halves = np.zeros((2, 2, 3), np.uint8)
    halves[:, 0, 0] = 255
    grown = clfur.grow(furred(clfur.Strands(roots=500, types=types, type_map=halves)), gpu)
    assert set(grown.counts.tolist()) == {0, 2} and len(grown.counts) == len(grown.width) == len(grown.color) == 500
    with pytest.raises(clfur.Error, match="has no Strands"):
        clfur.grow(clfur.Scene(ball()), gpu)
    with pytest.raises(clfur.Error, match="scene is 3"):
        clfur.grow(3, gpu)


def test_no_strand_is_no_trouble(gpu):
    grown = clfur.grow(furred(clfur.Strands(roots=0)), gpu)
    assert not len(grown.counts) and clfur.render(furred(grown), gpu)[..., 3].any()
