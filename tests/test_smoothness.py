"""Shape apart from smoothness: length, stiffness and force tell a curve, segments only how smooth it is drawn."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.twin import strands as twin

SMOOTH = 4, 8, 32
BENT = {"stiffness": .3, "direction_variation": .6}
FIELD = {"force": (.2, -.6, 0),
         "point_forces": [clfur.PointForce((.3, 1.4, .2), -1.5), clfur.PointForce((-2, 0, 0), 3)]}


def ball():
    positions, faces = icosphere(1)
    return clfur.Mesh(positions, positions, faces=faces)


def grow(gpu, segments, force=(0, -1, 0), point_forces=(), length=.8, **hair):
    """`Curves` of 300 strands on a ball."""
    kind = clfur.HairType(segments=segments, length=length, **hair)
    fur = clfur.Strands(types=kind, roots=300, inner=1, outer=1, force=force, point_forces=point_forces, seed=4)
    return clfur.grow(clfur.Scene(ball(), fur), gpu)


def curves(gpu, segments, **options):
    """Points of those, [strands, segments + 1, 3]."""
    return grow(gpu, segments, **options).points.reshape(300, segments + 1, 3)


@pytest.mark.parametrize("hair, field", [
    *[({"stiffness": stiffness}, {}) for stiffness in (1e-3, .02, .1, .625, 3, 1e3)],
    ({"stiffness": .5}, {"force": (0, 0, 0)}), ({"stiffness": .5}, {"force": (40, 3, -8)}),
    (BENT, {}), (BENT, FIELD), ({**BENT, "stiffness": .02}, FIELD),
    ({**BENT, "curl": (.1, 3)}, FIELD), ({**BENT, "wave": (.1, 2.5)}, FIELD),
    ({**BENT, "curl": (.05, -2), "wave": (.1, 1), "length_variation": .5}, {"force": (0, -2, 1)})])
def test_segments_do_not_tell_the_shape(gpu, hair, field):
    """At the points that all of them have, roots, tips and quarters, within 2 % of the length; that is an error of the
    steps in which the law is followed, as of a hair that turns within one of them."""
    coarse, usual, fine = (curves(gpu, n, **{**field, **hair}) for n in SMOOTH)
    for points, each in (coarse, 1), (usual, 2):
        apart = np.linalg.norm(points[:, ::each] - fine[:, ::8], axis=2)
        assert apart.max() < .02 * .8
    if hair["stiffness"] >= .1 and not field:
        assert np.linalg.norm(coarse - fine[:, ::8], axis=2).max() < 1e-4 * .8


def test_by_the_reports_rule_they_do(gpu):
    """So that the test above can fail."""
    few, more = (clfur.HairType(segments=n, segment_length=.8 / n, force_weight=.2) for n in (8, 32))
    tips = [clfur.grow(clfur.Scene(ball(), clfur.Strands(types=kind, roots=300)), gpu).points.reshape(300, -1, 3)[:, -1]
            for kind in (few, more)]
    assert np.linalg.norm(tips[0] - tips[1], axis=1).max() > .1 * .8


@pytest.mark.parametrize("stiffness", [.05, .3, 2])
def test_a_hair_bends_as_its_law_has_it(gpu, stiffness):
    """Under a force F: tan(angle / 2) falls as exp(-|F| s / (stiffness length)) does."""
    grown = grow(gpu, 255, stiffness=stiffness, force=(0, -.7, 0))
    chords = np.diff(grown.points.reshape(300, 256, 3), axis=1)
    angle = np.arccos(np.clip(-chords[..., 1] / np.linalg.norm(chords, axis=2), -1, 1))
    start = np.arccos(-grown.root_normal[:, 1:2])
    expected = 2 * np.arctan(np.tan(start / 2) * np.exp(-.7 * (np.arange(255) + .5) / 255 / stiffness))
    np.testing.assert_allclose(angle, expected, rtol=0, atol=2e-3)   # .05: 14 radians in all, .05 of them a chord
    assert np.ptp(expected, axis=1).max() > .3


def test_the_steps_are_enough():
    """Those that the device takes, against 2,048 in float64; of hair that turns at once a step is lost in part."""
    corner = twin.unit_or(np.random.default_rng(1).normal(size=(50, 3)), 0)
    frame = twin.frames(np.broadcast_to(np.eye(3), (50, 3, 3)), corner)
    for stiffness, field, worst in (.625, {}, 1e-5), (.05, {}, 1e-5), (.001, {}, 2e-2), (.2, FIELD, 1e-3):
        kind = clfur.HairType(segments=4, length=.8, stiffness=stiffness, direction_variation=.5)
        given = {"force": (0, -1, 0), **field}
        one, other = (twin.grow(corner, frame, np.zeros((50, 2)), [kind], substeps=n, **given)[0]
                      for n in (None, 512))
        assert np.linalg.norm(one - other, axis=2).max() < worst * .8


def test_a_shorter_hair_is_the_same_curve_cut(gpu):
    whole, varied = (curves(gpu, 64, stiffness=.2, length_variation=v) for v in (0, .6))
    lengths = np.linalg.norm(np.diff(varied, axis=1), axis=2).sum(1) / .8
    assert lengths.min() < .5 and lengths.max() > 1.5
    for strand in np.flatnonzero(lengths <= 1):
        place = lengths[strand] * 64
        k = min(int(place), 63)
        tip = whole[strand, k] + (place - k) * (whole[strand, k + 1] - whole[strand, k])
        np.testing.assert_allclose(varied[strand, -1], tip, rtol=0, atol=1e-3 * .8)


def test_one_rule_or_the_other():
    report, law = clfur.HairType(segments=5, force_weight=1), clfur.HairType(segments=5, length=.3)
    assert (report.segment_length, report.force_weight, report.full_length) == (.02, 1, pytest.approx(.1))
    assert (law.length, law.stiffness, law.full_length, law.step) == (.3, .625, pytest.approx(.3), pytest.approx(.06))
    assert law.segment_length is law.force_weight is report.length is report.stiffness is None
    assert attrs.evolve(law, segments=9).full_length == pytest.approx(.3)
    assert clfur.HairType(segments=32).full_length == pytest.approx(.16)   # of neither: the law
    assert clfur.HairType(stiffness=2).length == .16 and clfur.HairType(segments=0, length=1).full_length == 0
    for one in "length", "stiffness":
        for other in "segment_length", "force_weight":
            with pytest.raises(clfur.Error, match=f"HairType.{one} and {other} are of two rules of growth; allowed: "):
                clfur.HairType(**{one: .1, other: .1})
    with pytest.raises(clfur.Error, match="HairType.stiffness is 0; allowed: a finite number >= 1e-06"):
        clfur.HairType(stiffness=0)


def test_hair_that_turns_keeps_its_length(gpu):
    points = curves(gpu, 255, stiffness=.1, direction_variation=.5, **FIELD)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(1)
    np.testing.assert_allclose(lengths, .8, rtol=3e-3)
