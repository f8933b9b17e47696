"""A type that is bald is as none: what else it says is not asked for, in strands that grow and in those read back."""

import attrs
import numpy as np
import pytest
from support.pictures import same

import clfur
from clfur import budget
from clfur.judge import truth
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig
from clfur.scene import hair_bounds

QUICK = clfur.Settings(samples=1, grid=16, shadow_map=16)
MAP = np.array([[(255, 0, 0), (0, 0, 0)]], np.uint8)
WILD = {
    "curl": {"curl": (3, 4), "wave": (2, 1)}, "frizz": {"frizz": (.5, 1)}, "width": {"width": 4.0},
    "tufts": {"tufts": clfur.Tufts(density=1e9)}, "alpha": {"alpha": 1e-6}, "look": {"look": clfur.Chiang(.05, .1)},
    "clear": {"alpha": 1.0}, "length": {"length": 1.0}}


def scene(hairs=None, **wild):
    hair = clfur.HairType(segments=4, length=.3, width=.01, key=(255, 0, 0), look=hairs or clfur.Kajiya())
    bald = clfur.HairType(**{"segments": 0, "key": (0, 0, 0)} | wild)
    fur = clfur.Strands(roots=300, types=[hair, bald], type_map=MAP)
    return clfur.Scene(clfur.load_mesh("sphere"), fur, light=clfur.Light((-1, -1, -1)))


def small(one):
    return attrs.evolve(one, camera=attrs.evolve(one.camera, size=(40, 30)))


def as_curves(one, gpu):
    return attrs.evolve(one, fur=clfur.grow(one, gpu), camera=None)


@pytest.mark.parametrize("brought", [False, True], ids=["grown", "brought"])
@pytest.mark.parametrize("wild", WILD)
def test_what_a_bald_type_says_changes_nothing(gpu, wild, brought):
    plain, wild = (as_curves(each, gpu) if brought else each for each in (scene(), scene(**WILD[wild])))
    assert clfur.scene.fur_extent(plain.fur) == clfur.scene.fur_extent(wild.fur)
    assert hair_bounds(plain.strands, 300) == hair_bounds(wild.strands, 300)
    np.testing.assert_array_equal(plain.camera.pose, wild.camera.pose)
    one, other = (Rig.of(small(each), QUICK) for each in (plain, wild))
    assert budget.features(one, 300) == budget.features(other, 300)
    assert Plan(one, ("color",)).kernel_files == Plan(other, ("color",)).kernel_files
    same(*(clfur.draw(small(each), gpu, QUICK, ("color", "depth"), hashes=True) for each in (plain, wild)))


@pytest.mark.parametrize("brought", [False, True], ids=["grown", "brought"])
def test_light_goes_from_hair_to_hair_whatever_a_bald_type_looks_like(gpu, brought):
    """It was refused where a type without strands had another look."""
    settings, pictures = attrs.evolve(QUICK, scattering="grid"), []
    for look in clfur.Chiang(), clfur.Kajiya(), clfur.Chiang(.05, .1):
        one = scene(clfur.Chiang(), look=look)
        one = small(as_curves(one, gpu) if brought else one)
        truth._check_looks(one)
        pictures.append(clfur.draw(one, gpu, settings, hashes=True))
        assert np.isfinite(pictures[-1].images["color"]).all()
    same(*pictures[:2])
    same(*pictures[1:])
    with pytest.raises(clfur.Error, match="the look of hair is kajiya-kay"):
        clfur.render(small(scene(look=clfur.Chiang())), gpu, settings)


def test_wholly_bald_is_drawn_with_any_look(gpu):
    for look in clfur.Kajiya(), clfur.Chiang():
        bald = clfur.Strands(roots=50, types=clfur.HairType(segments=0, look=look, width=3, curl=(1, 1)))
        one = small(clfur.Scene(clfur.load_mesh("sphere"), bald, environment=clfur.Environment((.3, .4, .5))))
        drawn = clfur.draw(one, gpu, attrs.evolve(QUICK, scattering="grid"))
        none = clfur.draw(attrs.evolve(one, fur=clfur.Strands(roots=50, types=clfur.HairType(segments=0))), gpu, QUICK)
        np.testing.assert_allclose(drawn.images["color"], none.images["color"], atol=1e-6)
