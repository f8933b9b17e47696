"""Width and colour along a strand: against the twin, by area, in the picture, grown and brought alike."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import truth
from clfur.twin import strands as twin

FINE = {"width": .05, "tip_width": .1, "taper": .3, "segment_length": .05, "length_variation": .2}
DARK = {"root_color": (.1, .05, .02), "tip_color": (.8, .6, .3), "color_variation": .2}


def ball():
    positions, faces = icosphere(1)
    return clfur.Mesh(positions, positions, np.abs(positions[faces][..., :2]), faces)


def furred(mesh=None, size=48, **hair):
    return clfur.Scene(mesh or ball(), clfur.Strands(types=clfur.HairType(**{**FINE, **hair}), roots=200),
                       clfur.Camera(eye=(0, 0, 4), size=(size, size)))


@pytest.mark.small
@pytest.mark.parametrize("hair", [
    {}, {"tip_width": 0, "taper": .5}, {"root_width": .2, "tip_width": 3, "taper": .999}, {"segments": 1},
    {"segments": 37, "root_width": 0, "taper": .001}])
def test_widths_are_the_twins(gpu, hair):
    kind = clfur.HairType(**{**FINE, **hair})
    grown = clfur.grow(furred(**hair), gpu)
    width = grown.width.reshape(200, -1)
    expected = twin.widths_along(kind)
    np.testing.assert_allclose(width, np.tile(expected, (200, 1)), rtol=0, atol=2e-7 * kind.widest)
    if kind.root_width == 0:
        assert not width[:, 0].any()
    if kind.tip_width == 0:
        assert not width[:, -1].any()   # exactly: a point, not a sliver


@pytest.mark.small
@pytest.mark.parametrize("ends", [DARK, {"root_color": (.1, .2, .3)}, {"tip_color": (.9, .2, .3)}])
def test_colours_are_the_twins(gpu, ends):
    scene = furred(color=(.3, .5, .7), **ends)
    grown, kind = clfur.grow(scene, gpu), scene.strands.types[0]
    vary = twin.signed(twin.random3(np.arange(200), 0, 1))[:, :1]
    expected = twin.colors_along(kind) * (1 + kind.color_variation * vary)[:, None]
    np.testing.assert_allclose(grown.color.reshape(expected.shape), expected, rtol=0, atol=3e-7)
    root, tip = kind.ends
    np.testing.assert_allclose(twin.colors_along(kind)[[0, -1]], [root, tip], rtol=0, atol=1e-15)


def test_types_without_ends_keep_their_colour_beside_others_that_have(gpu):
    map_ = np.zeros((1, 2, 3), np.uint8)
    map_[0, 1] = 255
    plain, dark = clfur.HairType(key=(0, 0, 0), color=(.5, .25, .125), segments=3), clfur.HairType(
        key=(255, 255, 255), segments=5, **DARK)
    fur = clfur.Strands(types=[plain, dark], type_map=map_, roots=100)
    grown = clfur.grow(clfur.Scene(ball(), fur), gpu)
    first = np.cumsum(grown.counts) - grown.counts
    for strand, start in enumerate(first):
        own = grown.color[start:start + grown.counts[strand]]
        assert (len(own), len(np.unique(own, axis=0))) == ((4, 1) if grown.type_of[strand] == 0 else (6, 6))
    assert (grown.color[first[grown.type_of == 0]] == np.float32([.5, .25, .125])).all()


@pytest.mark.parametrize("taper", [.5, .2])
def test_a_strands_area_is_its_widths(gpu, taper):
    """Of one opaque strand across the picture: the sum of alpha is the integral of its widths."""
    mesh = clfur.Mesh([[-1e-3, 0, 0], [0, 0, 1e-3], [0, 0, -1e-3]], [[0, 1, 0]] * 3, None, [[0, 1, 2]])
    kind = clfur.HairType(segments=8, segment_length=.25, width=.2, tip_width=.1, taper=taper, alpha=0)
    scene = clfur.Scene(mesh, clfur.Strands(types=kind, inner=1, outer=1, force=(0, 0, 0), surface="flat"),
                        clfur.Camera(eye=(.003, 1, 1000), target=(.003, 1, 0), fov=.2, size=(96, 96)), body_color=None)
    alpha = clfur.render(scene, gpu)[..., 3].sum()
    pixel = 2 * 1000 * np.tan(np.radians(.1)) / 96
    widths = twin.widths_along(kind)
    area = ((widths[1:] + widths[:-1]) / 2 * .25).sum() / pixel**2
    assert alpha == pytest.approx(area, rel=2e-3)   # width is in 1/256 of a pixel at each end


def test_the_picture_is_the_truths(gpu):
    scene = furred(size=32, **DARK)
    seen = clfur.render(scene, gpu)
    true = truth.picture(scene, samples=8)[..., :4]
    apart = np.abs(seen[..., 3] - true[..., 3])
    assert np.sqrt((apart**2).mean()) < .04 and abs(seen[..., 3].sum() / true[..., 3].sum() - 1) < .01
    plain = clfur.render(attrs.evolve(scene, fur=furred(size=32, tip_width=1, taper=.5, **DARK).fur), gpu)
    assert abs(plain[..., 3].sum() / true[..., 3].sum() - 1) > .05   # so that the test above can fail


@pytest.mark.parametrize("settings", [clfur.Settings(grid=32), clfur.Settings(grid=32, lod=2.0),
                                      clfur.Settings(grid=32, raster="samples")])
def test_brought_alike_they_give_the_same_picture(gpu, settings):
    scene = furred(**DARK)
    grown = clfur.grow(scene, gpu)
    np.testing.assert_array_equal(clfur.render(scene, gpu, settings),
                                  clfur.render(attrs.evolve(scene, fur=grown), gpu, settings))


def test_the_wider_end_counts_for_bounds():
    scene = furred(width=.01, root_width=1, tip_width=10)
    assert scene.strands.types[0].widest == pytest.approx(.1)
    with pytest.raises(clfur.Error, match=r"HairType.tip_width is -1; allowed: a finite number >= 0, <= 16"):
        clfur.HairType(tip_width=-1)
    with pytest.raises(clfur.Error, match="by its pigment"):
        clfur.HairType(look=clfur.Chiang(eumelanin=.5), tip_color=(1, 1, 1))
