"""What `Settings(max_error=)` and `Settings(seconds=)` choose: cheap enough, near enough, and the same every time."""

import importlib
import itertools
import warnings

import attrs
import numpy as np
import pytest

import clfur
from clfur import budget, measures, truth
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig
from clfur.settings import CHOSEN

GOALS = 0.3, 0.12, 0.09, 0.07, 0.05, 0.03


def scene(mesh, fur="strands", size=(64, 48), eye=(0, 0.4, 3.2), **options):
    hair = clfur.HairType(segment_length=0.04, force_weight=0.1, width=0.012)
    strands = clfur.Strands(inner=1, outer=1, roots=600, types=[hair])
    points = np.random.default_rng(3).normal(size=(50, 4, 3)) * 0.4
    return clfur.Scene(mesh=mesh, camera=clfur.Camera(eye=eye, size=size), **options, fur={
        "strands": strands, "none": None, "shells": clfur.Shells(frequency=8, layers=8), "curves": clfur.Curves(points),
        "bald": clfur.Curves(np.zeros((0, 3)), counts=np.zeros(0, int)),
        "both": (clfur.Shells(frequency=8, layers=8), strands)}[fur])


def place_of(settings, drawn):
    """Where settings stand on the ladder of a scene."""
    return rungs(drawn).index(settings)


def rungs(scene):
    """Settings of its ladder."""
    return [rung.settings for rung in budget.ladder(Rig.of(scene))]


def error_of(picture, truths):
    """Of a picture without the noise of two truths, as that of one is not that of the other."""
    here = (picture[..., 3] > 0) | (truths[0][..., 3] > 0) | (truths[1][..., 3] > 0)
    one, other = ((measures.shown(picture) - measures.shown(true))[here] for true in truths)
    return float(np.sqrt((one * other).mean()))


@pytest.fixture
def frames(monkeypatch):
    """[(settings, bands)] of all that is drawn from here on."""
    render, calls = importlib.import_module("clfur.render"), []   # clfur.render is its function
    real = render.draw_frame

    def draw(team, scene, settings, *rest, bands=None, **how):
        calls.append((settings, bands))
        return real(team, scene, settings, *rest, bands=bands, **how)
    monkeypatch.setattr(render, "draw_frame", draw)
    return calls


def quiet(*arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return clfur.draw(*arguments, **options)


def test_the_ladder():
    """It goes up, and the presets are rungs of it; what is fitted is of each rung."""
    assert len(set(budget.LADDER)) == len(budget.LADDER) == len(budget.COSTS) == len(budget.ERRORS)
    assert list(clfur.PRESETS) == ["draft", "sketch", "preview", "final", "reference"]
    places = [budget.LADDER.index(settings) for settings in clfur.PRESETS.values()]
    assert places == sorted(places)
    for width, covered in itertools.product((0.2, 0.3, 1), (2, 4, 8)):
        costs, errors = budget.predicted(width, covered)
        assert costs[0] == 1
        if width < 1:   # lod, the third, is for thin strands
            assert all(0.005 < finer < 1.02 * coarser < 0.2 for coarser, finer in itertools.pairwise(errors))
        of_presets = [(costs[place], errors[place]) for place in places]
        assert all(one[0] < other[0] and one[1] > other[1] for one, other in itertools.pairwise(of_presets))
    deep = clfur.PRESETS["reference"]
    assert (deep.shadows, deep.masks) == ("deep", 4) and budget.predicted(0.3, 4)[1][-1] < 0.015


@pytest.mark.parametrize("fur, left_out", [("strands", 0), ("curves", 0), ("none", 0), ("both", 1), ("shells", 1)])
def test_what_a_scene_refuses_is_no_rung(sphere, fur, left_out, monkeypatch):
    """Of the others each keeps what is predicted of it; one that is no cheaper than a finer one is left out too."""
    every, furry = len(budget.LADDER), scene(sphere, fur)
    count = np.arange(1, every + 1)
    monkeypatch.setattr(budget, "predicted", lambda *_: (count, 1 / count))
    kept = budget.ladder(Rig.of(furry))
    assert [rung.cost for rung in kept] == list(range(1, every + 1 - left_out))
    assert [rung.error for rung in kept] == [1 / rung.cost * (fur not in ("none", "shells")) for rung in kept]
    assert kept[-1].settings.shadows == ("length" if left_out else "deep")
    monkeypatch.setattr(budget, "predicted", lambda *_: (np.array([1, 2, 5, 3, 4, 6, 7, 9, 8]), 1 / count))
    assert [rung.cost for rung in budget.ladder(Rig.of(furry))] == [1, 2, 3, 4, 6, 7, 9 if left_out else 8]
    for settings in budget.LADDER:
        why = budget.refused(furry, settings)
        assert bool(why) == (left_out and settings.shadows == "deep") and (not why or "the scene has shells" in why)


def test_what_no_frame_shows_is_not_told(gpu, sphere, monkeypatch):
    """Of settings that were only tried no warning comes: of the picture alone."""
    monkeypatch.setattr(Plan, "warnings", property(lambda plan: ["deep"] * (plan.settings.shadows == "deep")))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert clfur.draw(scene(sphere), gpu, clfur.Settings(max_error=0.3)).settings.shadows == "length"
    with pytest.warns(RuntimeWarning, match="deep") as told:
        clfur.draw(scene(sphere), gpu, clfur.Settings(seconds=1e3))
    assert len(told) == 1


def test_max_error(gpu, sphere):
    """A smaller one is never cheaper, the picture is that of the settings chosen, and it errs as Frame.error says."""
    furry = scene(sphere)
    truths, places, errors = [truth.picture(furry, 6, seed) for seed in (0, 1)], [], []
    for goal in GOALS:
        drawn = quiet(furry, gpu, clfur.Settings(max_error=goal))
        places.append(place_of(drawn.settings, furry))
        errors.append(drawn.error)
        assert drawn.settings.goal is None and drawn.why
        assert np.array_equal(drawn.images["color"], clfur.render(furry, gpu, drawn.settings))
        error = error_of(drawn.images["color"], truths)
        assert 0.6 * drawn.error < error < 1.15 * drawn.error
        assert drawn.error <= goal or drawn.settings == rungs(furry)[-1]
    assert places == sorted(places) and places[0] == 0 and len(set(places)) >= 3
    assert errors == sorted(errors, reverse=True)


def test_the_same_every_time(gpu, another, sphere):
    first, again, other = (quiet(scene(sphere), device, clfur.Settings(max_error=0.07)) for device in (
        gpu, gpu, another()))
    assert first.settings == again.settings == other.settings and first.error == again.error == other.error
    assert np.array_equal(first.images["color"], other.images["color"])
    together = quiet(scene(sphere), [gpu, another()], clfur.Settings(max_error=0.07))
    assert (together.settings, together.error) == (first.settings, first.error)


def test_it_is_chosen_once_for_a_scene(gpu, sphere, frames):
    """Not again for another place of the camera; again for another distance, light, sky, fur or goal."""
    furry, goal = scene(sphere), clfur.Settings(max_error=0.07)

    def tried(drawn, settings=goal):
        del frames[:]
        quiet(drawn, gpu, settings)
        return len(frames) - 1   # the picture itself
    assert tried(furry) >= 2 and all(bands for _, bands in frames[:-1]) and frames[-1][1] is None
    assert tried(furry) == 0
    assert tried(attrs.evolve(furry, camera=clfur.Camera(eye=(3.2, 0.4, 0), size=(64, 48)))) == 0
    assert tried(furry, attrs.evolve(goal, blur="all")) == 0
    assert frames[-1][0].blur == "all"
    assert tried(attrs.evolve(furry, camera=clfur.Camera(eye=(0, 1, 9), size=(64, 48)))) > 0
    for change in ({"fur": scene(sphere).fur}, {"light": clfur.Light((0, -1, 0))}, {"body_color": None},
                   {"environment": clfur.Environment((1, 1, 1))}):
        assert tried(furry) > 0
        assert tried(attrs.evolve(furry, **change)) > 0
    assert tried(furry) > 0 and tried(furry, clfur.Settings(max_error=0.08)) > 0


def test_it_cannot_be_had(gpu, sphere):
    furry = scene(sphere)
    with pytest.warns(UserWarning, match=r"^Settings.max_error is 1e-06, but the best there is errs by about 0\.0\d+$"):
        drawn = clfur.draw(furry, gpu, clfur.Settings(max_error=1e-6))
    assert drawn.settings == rungs(furry)[-1] and drawn.error > 1e-6
    with pytest.warns(UserWarning, match="^Settings.seconds is 1e-09, but the fastest frame there is takes "):
        drawn = clfur.draw(furry, gpu, clfur.Settings(seconds=1e-9))
    assert drawn.settings == rungs(furry)[0]
    with pytest.warns(UserWarning, match="^Settings.seconds is 1e-09, .*; Settings.max_error is 1e-06, but the best"):
        clfur.draw(furry, gpu, clfur.Settings(seconds=1e-9, max_error=1e-6))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        clfur.draw(furry, gpu, clfur.Settings(max_error=0.5, seconds=1e3))


@pytest.mark.parametrize("seconds, place", [(0.05, 0), (0.1, 0), (0.31, 1), (0.35, 1), (0.45, 2), (5, 3)])
def test_seconds(gpu, sphere, monkeypatch, seconds, place):
    """The dearest that its own time allows, with max_error too; a wrong prediction only costs a try."""
    furry, goal = scene(sphere), clfur.Settings(seconds=seconds)
    times = [0.1, 0.3, 0.4, 0.5, *[9] * 9]
    monkeypatch.setattr(budget, "_time", lambda team, settings, draw: times[place_of(settings, furry)])
    drawn = quiet(furry, gpu, goal)
    assert place_of(drawn.settings, furry) == place and drawn.why.startswith(f"its frame took {times[place]:g} s of")
    assert drawn.error == quiet(furry, gpu, goal).error > 0
    near = quiet(furry, gpu, clfur.Settings(seconds=seconds, max_error=1e-6))
    assert place_of(near.settings, furry) == place
    far = quiet(furry, gpu, clfur.Settings(seconds=seconds, max_error=0.5))
    assert place_of(far.settings, furry) == 0


def test_seconds_are_of_a_frame_done_anew(gpu, sphere, frames):
    """So that the frame tells what was promised; the next one keeps what has not changed, and the choice."""
    furry, goal = scene(sphere), clfur.Settings(seconds=1e3)
    first = quiet(furry, gpu, goal)
    assert {"tessellate", "strands", "voxelize", "shade"} <= set(first.stages) and first.why.endswith(", done anew")
    del frames[:]
    again = quiet(furry, gpu, goal)
    assert len(frames) == 1 and again.settings == first.settings and "strands" not in again.stages
    assert np.array_equal(again.images["color"], first.images["color"])


@pytest.mark.parametrize("fur", ["none", "shells", "both", "curves", "bald"])
def test_other_furs(gpu, sphere, fur):
    furry = scene(sphere, fur)
    drawn = quiet(furry, gpu, clfur.Settings(max_error=0.06, filtered=False))
    assert 0 <= drawn.error < 0.12 and not drawn.settings.filtered
    assert np.array_equal(drawn.images["color"], clfur.render(furry, gpu, drawn.settings))
    assert place_of(quiet(furry, gpu, clfur.Settings(max_error=9)).settings, furry) == 0


@pytest.mark.parametrize("height, eye", [(1, (0, 0, 3)), (3, (0, 0, 3)), (48, (0, 0, 3)), (480, (0, 1, 30)),
                                         (100, (0, 0, 0.1)), (100, (0, 9, 0.1))])
def test_bands(sphere, height, eye):
    """About a tenth of the rows, in order, and within the picture."""
    found = budget.bands(Rig.of(scene(sphere, size=(8, height), eye=eye)))
    rows = [row for top, end in found for row in range(top, end)]
    assert rows and rows == sorted(set(rows)) and rows[0] >= 0 and rows[-1] < height
    assert len(rows) <= max(0.13 * height, 5)


def test_bands_lie_on_the_fur(sphere):
    """Where the scene is small in its picture, the rows are there."""
    furry = scene(sphere, size=(64, 480), eye=(0, 0, 20))
    covered = clfur.render(furry, settings=clfur.Settings(samples=1))[..., 3].any(1)
    assert all(covered[top:end].any() for top, end in budget.bands(Rig.of(furry))) and covered.mean() < 0.3


def test_cells_are_no_finer_than_strands(sphere):
    def grids(width):
        hair = clfur.HairType(width=width, segments=1, segment_length=1)
        furry = clfur.Scene(mesh=sphere, fur=clfur.Strands(types=[hair]))
        return {rung.settings.grid for rung in budget.suited(Rig.of(furry))}
    assert grids(0.001) == grids(0) == {rung.grid for rung in budget.LADDER} and max(grids(0.001)) == 256
    assert grids(0.05) == {48, 64, 96, 128}   # 2 times a radius of 2 / (0.6 * 0.05) = 135
    assert grids(1) == {16}


def test_a_small_device(another, sphere):
    """Cells that do not fit are not tried: the cheap picture can be had."""
    small = another(12 << 20)
    drawn = quiet(scene(sphere), small, clfur.Settings(max_error=0.06))
    assert drawn.memory <= 12 << 20 and drawn.error <= 0.06
    with pytest.raises(clfur.Error, match="Settings.grid 256"):
        clfur.draw(scene(sphere), small, attrs.evolve(budget.LADDER[4], grid=256))


@pytest.mark.parametrize("name, value", [("samples", 1), ("raster", "samples"), ("shadows", "off"), ("grid", 64),
                                         ("shadow_map", 64), ("pcf", 0), ("masks", 4), ("lod", 1.0)])
def test_what_is_chosen_cannot_be_given(name, value):
    assert name in CHOSEN
    for goal in ("max_error", "seconds"):
        with pytest.raises(clfur.Error, match=f"Settings.{name} is .*Settings.{goal} chooses it"):
            clfur.Settings(**{goal: 0.1, name: value})
    assert clfur.Settings(seconds=1, max_error=0.1, blur="all", filtered=False).goal == "seconds"


@pytest.mark.parametrize("value", [0, -1, float("nan"), "fast", True])
def test_wrong_goals(value):
    for name in ("max_error", "seconds"):
        with pytest.raises(clfur.Error, match=f"Settings.{name} is .*; allowed: "):
            clfur.Settings(**{name: value})


def test_goals_have_no_place_in_charts_and_comparisons(sphere):
    with pytest.raises(clfur.Error, match="candidates is"):
        clfur.frontier(scene(sphere), [clfur.Settings(max_error=0.1)])
    with pytest.raises(clfur.Error, match="Settings.seconds is given"):
        clfur.compare(scene(sphere), settings=clfur.Settings(seconds=1))
