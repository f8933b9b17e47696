"""The truth against what can be worked out by hand; it needs no device."""

import math

import numpy as np
import pytest

from clfur.judge.truth import transmittance

UP = np.array([0.0, 0, 1])       # towards the light, unless a test turns everything


def fibres(ends, width):
    """Straight fibres [n, 2, 3] -> (points [2 n, 4], spans [n, 2])."""
    ends = np.asarray(ends, float)
    points = np.concatenate([ends, np.full((*ends.shape[:2], 1), width)], 2).reshape(-1, 4)
    return points, np.stack([2 * np.arange(len(ends)), np.full(len(ends), 2)], 1)


def stripes(pitch, height, along, half=2.0):
    """Parallel fibres at this height, `pitch` apart, along axis 0 or 1 -> ends [n, 2, 3]."""
    at = np.arange(-half, half, pitch) + pitch / 3
    a, b = np.full(len(at), -half), np.full(len(at), half)
    z = np.full(len(at), height)
    return np.stack([np.stack([a, at, z] if along == 0 else [at, a, z], 1),
                     np.stack([b, at, z] if along == 0 else [at, b, z], 1)], 1)


def rotation(seed):
    """A random rotation [3, 3]."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


@pytest.mark.parametrize("turned", [None, 1, 2])
@pytest.mark.parametrize("width, alpha", [(.02, .5), (.2, .3), (.5, 0)])
def test_one_fibre_covers_its_share_of_the_footprint(turned, width, alpha):
    turn = np.eye(3) if turned is None else rotation(turned)
    points, spans = fibres(np.array([[(-3, 0, 1), (3, 0, 2)]]) @ turn.T, width)     # tilted along the light too
    radius, half, rays = .5, width / 2, 40000
    share = 2 * (half * math.sqrt(radius**2 - half**2) + radius**2 * math.asin(half / radius)) / (math.pi * radius**2)
    t = transmittance(points, spans, alpha, turn @ UP, np.zeros((1, 3)), [-1], radius, rays)[0]
    # Each ray is 1 or alpha: four standard deviations of their mean.
    assert t == pytest.approx(1 - share * (1 - alpha), abs=4 * (1 - alpha) * math.sqrt(share * (1 - share) / rays))


@pytest.mark.parametrize("layers", [1, 2, 7])
def test_layers_that_cover_everything_multiply(layers):
    ends = [[(-9, 0, 1 + .1 * i), (9, .2, 1 + .1 * i)] for i in range(layers)]
    points, spans = fibres(ends, 4)
    t = transmittance(points, spans, .7, UP, np.random.default_rng(0).uniform(-.2, .2, (9, 3)), [-1] * 9, .3)
    np.testing.assert_allclose(t, .7**layers, rtol=1e-12)


def test_each_strand_lets_its_own_share_through():
    points, spans = fibres([[(-9, 0, i), (9, 0, i)] for i in (1, 2, 3)], 4)
    t = transmittance(points, spans, [.5, .2, .9], UP, np.zeros((4, 3)), [-1, 0, 1, 2], .3)
    np.testing.assert_allclose(t, [.09, .18, .45, .1], rtol=1e-12)


def test_crossed_stripes_multiply_their_means():
    """Two sheets of stripes at right angles: whether a ray meets one says nothing of the other."""
    pitch, width, alpha = .05, .02, .4
    points, spans = fibres(np.concatenate([stripes(pitch, 1, 0), stripes(pitch, 1.5, 1)]), width)
    places = np.random.default_rng(3).uniform(-.5, .5, (200, 3)) * (1, 1, 0)
    mean = transmittance(points, spans, alpha, UP, places, [-1] * 200, 4 * pitch, 200).mean()
    assert mean == pytest.approx((1 - width / pitch * (1 - alpha)) ** 2, abs=.005)      # 40,000 rays: .0015


@pytest.mark.parametrize("tilt", [0, 50])
@pytest.mark.parametrize("alpha", [0, .5, .9])
def test_random_fibres_darken_exponentially(alpha, tilt):
    """Crossings at random with mean C = length · width · sine / area leave exp(-C (1 - alpha)) of the light."""
    rng, n, length, width = np.random.default_rng(4), 2500, .2, .01
    angle = rng.uniform(0, 2 * math.pi, n)
    along = np.stack([np.cos(angle), np.sin(angle), np.full(n, math.tan(math.radians(tilt)))], 1)
    along *= length / 2 / np.linalg.norm(along, axis=1, keepdims=True)
    middle = rng.uniform((-1, -1, 1), (1, 1, 2), (n, 3))
    points, spans = fibres(np.stack([middle - along, middle + along], 1), width)
    crossings = n * length * width * math.cos(math.radians(tilt)) / 4
    places = rng.uniform(-.85, .85, (300, 3)) * (1, 1, 0)
    mean = transmittance(points, spans, alpha, UP, places, [-1] * 300, .05, 48).mean()
    # One draw of 2,500 fibres: their number over the places varies by 2 or 3 %.
    assert mean == pytest.approx(math.exp(-crossings * (1 - alpha)), abs=.02)


def test_the_own_strand_is_left_out():
    points, spans = fibres([[(-1, 0, 0), (1, 0, 0)], [(-1, 0, .5), (1, 0, .5)]], .4)
    place = [(0, 0, 0)]
    alone = transmittance(points[:2], spans[:1], .5, UP, place, [0], .1)[0]
    assert alone == 1
    assert transmittance(points, spans, .5, UP, place, [0], .1)[0] == .5
    assert transmittance(points, spans, .5, UP, place, [1], .1)[0] == 1      # at its own height it isn't before itself


def test_what_lies_behind_the_place_does_not_count():
    points, spans = fibres([[(-1, 0, z), (1, 0, z)] for z in (-2, -1e-3, 1e-3, 2)], 1)
    places = [(0, 0, -3), (0, 0, -1), (0, 0, 0), (0, 0, 1), (0, 0, 3)]
    t = transmittance(points, spans, .5, UP, places, [-1] * 5, .1)
    np.testing.assert_allclose(t, [.5**4, .5**3, .5**2, .5, 1])


def test_a_slanted_fibre_counts_where_it_lies_before_the_place():
    points, spans = fibres([[(-1, 0, -1), (1, 0, 1)]], 1)
    t = transmittance(points, spans, .5, UP, [(-.5, 0, 0), (.5, 0, 0)], [-1, -1], .1)
    np.testing.assert_allclose(t, [1, .5])


@pytest.mark.parametrize("off", [0, 1e-12, 1e-6, 1e-3])
def test_a_fibre_along_the_light_hides_next_to_nothing(off):
    """Seen from its end a fibre is a disc of its width at most; beside it nothing is hidden."""
    width, radius, alpha = .02, .2, .5
    points, spans = fibres([[(0, 0, 1), (off, 0, 2)]], width)
    t = transmittance(points, spans, alpha, UP, [(0, 0, 0), (.35, 0, 0)], [-1, -1], radius, 4000)
    assert t[0] >= 1 - (1 - alpha) * (width * (width + off)) / (math.pi * radius**2) * 2
    assert t[1] == 1


def test_no_strands_and_no_places():
    points, spans = np.zeros((0, 4)), np.zeros((0, 2))
    np.testing.assert_array_equal(transmittance(points, spans, .5, UP, np.zeros((3, 3)), [-1] * 3, .1), 1)
    assert transmittance(*fibres([[(0, 0, 0), (1, 0, 0)]], 1), .5, UP, np.zeros((0, 3)), [], .1).shape == (0,)


def test_strands_without_a_segment_hide_nothing():
    points = np.zeros((3, 4)) + (0, 0, 1, .5)
    t = transmittance(points, [(0, 1), (1, 0), (1, 2)], .5, UP, [(0, 0, 0)], [-1], .1)
    assert t[0] == 1                                         # a point, nothing, and two points in one place


def test_the_same_seed_gives_the_same_rays():
    points, spans = fibres([[(-1, 0, 1), (1, 0, 1)]], .1)
    one, same, other = (transmittance(points, spans, .5, UP, np.zeros((1, 3)), [-1], .3, 64, s)[0] for s in (0, 0, 1))
    assert one == same != other
