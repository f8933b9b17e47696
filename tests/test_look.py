"""What hair looks like: where looks are given, and that all that draws takes them."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur import truth
from clfur.scene import highlighted

SHARP = clfur.Kajiya(specular=.7, exponent=20, highlight="half-vector")
OFF = clfur.Settings(samples=1, shadows="off")
HOLDERS = [clfur.HairType, clfur.Shells, lambda **given: clfur.Curves(np.zeros((1, 2, 3)), **given)]


@pytest.mark.parametrize("holder", HOLDERS, ids=["HairType", "Shells", "Curves"])
def test_a_look_or_its_numbers(holder):
    plain = holder()
    assert plain.look == clfur.Kajiya() == clfur.Kajiya(.3, 150, "kajiya-kay")
    assert (plain.specular, plain.exponent) == (.3, 150)
    short = holder(specular=.5)
    assert short.look == clfur.Kajiya(specular=.5) and (short.specular, short.exponent) == (.5, 150)
    held = holder(look=SHARP)
    assert held.look == SHARP and (held.specular, held.exponent) == (.7, 20)
    assert attrs.evolve(short, exponent=9.0).look == clfur.Kajiya(.5, 9)
    assert attrs.evolve(held, alpha=.1).look == SHARP


@pytest.mark.parametrize("holder", HOLDERS, ids=["HairType", "Shells", "Curves"])
@pytest.mark.parametrize("given", [{"specular": 0}, {"exponent": 1}])
def test_a_look_and_its_numbers_are_one_too_many(holder, given):
    with pytest.raises(clfur.Error, match=f"{next(iter(given))} is .* look is given too; allowed: one of them"):
        holder(look=SHARP, **given)


@pytest.mark.parametrize("given, words", [
    ({"specular": -1}, "Kajiya.specular is -1"), ({"exponent": 0}, "Kajiya.exponent is 0"),
    ({"highlight": "phong"}, "Kajiya.highlight is 'phong'; allowed: 'kajiya-kay' or 'half-vector'")])
def test_looks_are_checked(given, words):
    with pytest.raises(clfur.Error, match=words):
        clfur.Kajiya(**given)
    with pytest.raises(clfur.Error, match="HairType.look is 3; allowed: an object of class Kajiya"):
        clfur.HairType(look=3)


def scene_of(fur):
    positions, faces = icosphere(1)
    return clfur.Scene(clfur.Mesh(positions, positions, None, faces), fur, clfur.Camera(size=(24, 18)),
                       clfur.Light((-1, -1, -.4)))


def furs(look):
    hair = clfur.HairType(segments=3, segment_length=.1, width=.02, look=look)
    strands = clfur.Strands(roots=300, types=[hair])
    points = np.random.default_rng(0).normal(size=(60, 4, 3))
    return {"strands": strands, "curves": clfur.Curves(points, width=.03, look=look),
            "typed": clfur.Curves(points, width=.03, types=[hair]),
            "shells": clfur.Shells(length=.2, frequency=8, layers=8, look=look),
            "both": [clfur.Shells(length=.2, frequency=8, layers=8, look=look), strands]}


@pytest.mark.parametrize("kind", ["strands", "curves", "typed", "shells", "both"])
def test_highlighted_changes_all_looks(gpu, kind):
    """The very picture that looks with this highlight give: what --specular does."""
    scene = scene_of(furs(clfur.Kajiya(.5, 30))[kind])
    meant = clfur.render(scene_of(furs(clfur.Kajiya(.5, 30, "half-vector"))[kind]), gpu, OFF)
    fur = highlighted(scene.fur, "half-vector")
    np.testing.assert_array_equal(clfur.render(attrs.evolve(scene, fur=fur), gpu, OFF), meant)
    assert np.abs(clfur.render(scene, gpu, OFF) - meant).max() > .01


def test_what_is_highlighted_again_is_the_very_same():
    fur = tuple(furs(clfur.Kajiya())["both"])
    assert highlighted(fur, "half-vector") is highlighted(fur, "half-vector")
    assert highlighted(None, "half-vector") is None


def test_the_truth_sees_looks():
    """Each highlight's own picture is nearer to its truth than the other's."""
    scenes = [scene_of(clfur.Curves(np.random.default_rng(0).normal(size=(40, 4, 3)) * .5, width=.1, color=(.1, .1, .1),
                                    look=clfur.Kajiya(1, 10, highlight), alpha=1))
              for highlight in ("kajiya-kay", "half-vector")]
    true = [truth.picture(attrs.evolve(scene, body_color=None), 4) for scene in scenes]
    drawn = [clfur.render(attrs.evolve(scene, body_color=None), None, clfur.Settings(samples=16, shadow_map=0))
             for scene in scenes]
    off = np.array([[np.abs(one - other).mean() for other in true] for one in drawn])
    assert off[0, 0] < off[0, 1] / 2 and off[1, 1] < off[1, 0] / 2
