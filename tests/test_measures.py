"""What is measured of a picture against the truth: numbers worked out by hand."""

import sys

import numpy as np
import pytest

from clfur.color import linear_to_srgb
from clfur.measures import flicker, measure


def picture(*pixels):
    """[1, n, 4] of (value of three channels, alpha)."""
    return np.array([[(value, value, value, alpha) for value, alpha in pixels]])


def test_the_truth_itself_is_without_error():
    truth = picture((.5, 1), (.2, .3), (0, 0))
    assert measure(truth, truth) == {"error": 0, "rmse": 0, "bias": 0, "area": 1, "flip": 0}


def test_by_hand():
    """Only where either covers anything: the last of the pixels says nothing."""
    truth = picture((.25, 1), (.25, .5), (0, 0), (0, 0))
    given = picture((.5, 1), (.25, .5), (.25, .5), (0, 0))
    found = measure(given, truth)
    steps = linear_to_srgb([.5, .25]).astype(float) @ (1, -1), linear_to_srgb(.25)
    assert found["error"] == pytest.approx(np.sqrt((steps[0]**2 + steps[1]**2) / 3), rel=1e-6)
    assert found["rmse"] == pytest.approx(np.sqrt(2 * .25**2 / 3)) and found["bias"] == pytest.approx(.5 / 3)
    assert found["area"] == pytest.approx(2 / 1.5) and 0 < found["flip"] < 1
    assert measure(truth, given)["bias"] == pytest.approx(-.5 / 3)


def test_beyond_white_is_white():
    found = measure(picture((3, 1)), picture((1, 1)))
    assert found["error"] == 0 and found["rmse"] == 2


def test_nothing_to_see():
    nothing = picture((0, 0))
    assert measure(nothing, nothing) == {"error": 0, "rmse": 0, "bias": 0, "area": None, "flip": 0}
    assert flicker([nothing, nothing], [nothing, nothing]) == 0


def test_what_is_no_number_is_no_error_of_0():
    found = measure(picture((np.nan, np.nan), (0, 0)), picture((0, 0), (0, 0)))
    assert np.isnan(found["error"]) and np.isnan(found["rmse"])


def test_flicker():
    """A constant error does not flicker; standing still while the truth moves does."""
    truths = [picture((value, 1), (0, 0)) for value in (.1, .3, .2)]
    coded = linear_to_srgb([.1, .3, .2]).astype(float)
    assert flicker(truths, truths) == 0
    assert flicker([truths[0]] * 3, truths) == pytest.approx(np.abs(np.diff(coded)).mean(), rel=1e-6)
    assert flicker([truths[0]] * 3, [truths[1]] * 3) == 0


def test_without_flip(monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert measure(picture((.5, 1)), picture((.5, 1)))["flip"] is None
