"""Speed against accuracy: the truth that is compared to, what is tried, what is kept, and who is on the frontier."""

import json

import attrs
import numpy as np
import pytest

import clfur
from clfur import cache
from clfur.cache import digest
from clfur.device import scheduler
from clfur.device import selection as device
from clfur.judge import frontier as library  # the module: clfur.frontier is its function
from clfur.judge.frontier import label, sweep

WAYS = [clfur.Settings(samples=1, shadows="off"), clfur.Settings(), clfur.Settings(samples=16, grid=32)]
TIMED = {"times", "seconds", "best"}


def like_truth(scene, samples, seed=0, progress=None, orders=0):
    """In place of `clfur.truth.picture`."""
    if progress:
        progress(0.5)
    return clfur.render(scene, settings=clfur.Settings(samples=4, scattering="grid" if orders else "off"))


@pytest.fixture(scope="module")
def gpu():
    return clfur.Scheduler()


@pytest.fixture(autouse=True)
def cheap(tmp_path, monkeypatch, gpu):
    """A truth that is drawn at once, an empty cache, and one scheduler, whose kernels are built once."""
    monkeypatch.setattr(library, "Scheduler", lambda name: gpu if device.choose(name) == gpu.device else None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(library.truth, "picture", like_truth, raising=False)
    monkeypatch.setattr(library.truth, "VERSION", 0, raising=False)
    monkeypatch.setattr(library, "OVER", 4)


def scene(mesh, fur="strands", size=(32, 24), **options):
    return clfur.Scene(mesh=mesh, camera=clfur.Camera(size=size), **options, fur={
        "strands": clfur.Strands(inner=1, outer=1, roots=200), "none": None,
        "shells": clfur.Shells(frequency=8)}[fur] if isinstance(fur, str) else fur)


@pytest.fixture
def drawn(monkeypatch):
    """[(settings, scene)] of all that is drawn from here on."""
    calls = []

    def draw(scene, gpu, settings):
        calls.append((settings, scene))
        return real(scene, gpu, settings)
    real = library.draw
    monkeypatch.setattr(library, "draw", draw)
    return calls


def same(one, other):
    """Whether two frontiers are equal in all but times."""
    points = [sorted(({name: value for name, value in attrs.asdict(point).items() if name not in TIMED}
                      for point in found.points), key=lambda point: point["label"]) for found in (one, other)]
    return points[0] == points[1] and one.noise == other.noise


def test_what_is_measured(sphere):
    progress = []
    found = clfur.frontier(scene(sphere), WAYS, repeat=2, tell=lambda *what: progress.append(what))
    assert (found.size, found.earlier, found.truth) == ((32, 24), 0, "brute force")
    assert found.device == device.describe(device.choose("auto"))
    by_settings = {point.settings: point for point in found.points}
    assert set(by_settings) == set(WAYS)
    for point in found.points:
        assert len(point.times) == 2 and point.seconds.min <= point.seconds.median <= point.seconds.max
        assert (point.strands, point.segments, point.layers) == (200, 1600, None)
        assert 0 < point.error < 1 and 0 < point.flip < 1 and 0.5 < point.area < 2 and 0 < point.flicker < 1
    assert by_settings[WAYS[2]].error < by_settings[WAYS[1]].error < by_settings[WAYS[0]].error
    assert by_settings[WAYS[0]].bias > by_settings[WAYS[1]].bias   # without shadows it is brighter
    assert [point.name for point in found.points if point.name] == ["default"]
    assert by_settings[WAYS[1]].name == "default"
    assert [what for what in progress if what[0] == "pictures"] == [("pictures", n, 3) for n in range(3)]
    assert progress[-1] == ("times", 6, 6) and ("truth", 50, 100) in progress
    assert json.loads(json.dumps(found.as_dict(), allow_nan=False))["points"][0]["settings"]["samples"] in (1, 4, 16)


def test_the_frontier_is_what_no_other_beats(sphere, monkeypatch):
    errors = iter([.5, .4, .6, np.nan, .1, .1])
    seconds = iter([1., 2., 3., .5, 5., 5.])
    monkeypatch.setattr(library, "_judge", lambda *_: {
        "error": next(errors), "rmse": 0., "bias": 0., "area": None, "flip": None, "flicker": None, "strands": 1,
        "segments": 1})
    monkeypatch.setattr(library, "_time", lambda *_: next(seconds))
    ways = [clfur.Settings(grid=grid) for grid in range(16, 112, 16)]
    found = clfur.frontier(scene(sphere), ways, repeat=1)
    assert [point.seconds.median for point in found.points] == [.5, 1, 2, 3, 5, 5]
    assert [point.seconds.median for point in found.best] == [1, 2, 5]
    assert json.dumps(found.as_dict(), allow_nan=False)   # what is no number is null


def test_candidates_take_turns(sphere, drawn):
    clfur.frontier(scene(sphere), WAYS, repeat=2, pan=False)
    assert [settings for settings, _ in drawn[3::2]] == WAYS * 2   # after their pictures; each is drawn once to warm up


def test_the_same_again_but_for_times(sphere, drawn):
    first = clfur.frontier(scene(sphere), WAYS, repeat=1)
    count = len(drawn)
    again = clfur.frontier(scene(sphere), WAYS, repeat=1, fresh=True)
    assert len(drawn) == 2 * count and same(first, again) and again.earlier == 0
    kept = clfur.frontier(scene(sphere), WAYS, repeat=1)
    assert len(drawn) == 2 * count and same(first, kept) and kept.earlier == 3
    assert [point.times for point in kept.points] == [point.times for point in again.points]
    more = clfur.frontier(scene(sphere), WAYS, repeat=2)   # only what is missing
    assert len(drawn) == 2 * count + 6 and more.earlier == 3 and {len(point.times) for point in more.points} == {2}
    other = clfur.frontier(scene(sphere, light=clfur.Light(ambient=0.2)), WAYS[:1], repeat=1)
    assert other.earlier == 0 and len(drawn) > 2 * count + 6


@pytest.mark.parametrize("where", [("truth", 50), ("pictures", 1), ("pictures", 2), ("times", 1), ("times", 5)])
def test_a_run_cut_short_goes_on(sphere, drawn, where):
    def stop(*what):
        if what[:2] == where:
            raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt):
        clfur.frontier(scene(sphere), WAYS, repeat=2, tell=stop)
    cut = len(drawn)
    found = clfur.frontier(scene(sphere), WAYS, repeat=2)
    assert len(drawn) == 3 * 5 + 2 * 2 * 3                     # nothing twice
    assert found.earlier == (where[1] if where[0] == "times" else 0) and cut <= len(drawn)
    whole = clfur.frontier(scene(sphere), WAYS, repeat=2, fresh=True)
    assert same(found, whole)


def test_what_is_damaged_is_made_anew(sphere, drawn, tmp_path):
    first = clfur.frontier(scene(sphere), WAYS, repeat=1)
    folder, count = tmp_path / "cache/clfur/charts", len(drawn)
    lines, = folder.glob("*.jsonl")
    with lines.open("a") as stream:
        stream.write('\n{"settings": {"samples": 1')        # killed while it wrote
    assert clfur.frontier(scene(sphere), WAYS, repeat=1).earlier == 3 and len(drawn) == count
    assert clfur.frontier(scene(sphere), WAYS, repeat=2).earlier == 3
    assert clfur.frontier(scene(sphere), WAYS, repeat=2).earlier == 6
    picture, = folder.glob("*.npz")
    picture.write_bytes(picture.read_bytes()[:1000])
    assert same(first, clfur.frontier(scene(sphere), WAYS, repeat=1, fresh=True))


def test_all_frames_of_an_earlier_run_count(sphere):
    clfur.frontier(scene(sphere), WAYS[:2], repeat=3)
    found = clfur.frontier(scene(sphere), WAYS[:2], repeat=1)
    assert found.earlier == sum(len(point.times) for point in found.points) == 6


def test_own_settings(sphere, drawn):
    own = clfur.Settings(samples=16, grid=48)
    found = clfur.frontier(scene(sphere), WAYS[:1], repeat=1, pan=False, own=own)
    assert [point.settings for point in found.points if point.name == "own"] == [own] and len(found.points) == 2
    found = clfur.frontier(scene(sphere), WAYS, repeat=1, pan=False, own=WAYS[1])
    assert {point.name for point in found.points} == {"", "default, own"} and len(found.points) == 3


def test_light_from_hair_to_hair_is_in_the_truth_where_it_is_asked_for(sphere):
    """And is kept apart from the truth without."""
    kind = clfur.HairType(look=clfur.Chiang(), color=(.9, .9, .9), alpha=0)
    furry = scene(sphere, clfur.Strands(inner=1, outer=1, roots=200, types=[kind]), body_color=None)
    ways = [clfur.Settings(), clfur.Settings(scattering="grid")]
    both = library.frontier(furry, ways, repeat=1, pan=False)
    alone = library.frontier(furry, ways[:1], repeat=1, pan=False)
    errors = {point.settings.scattering: point.error for point in both.points}
    assert both.truth == "brute force, light from hair to hair" and alone.truth == "brute force"
    assert errors["grid"] < .5 * errors["off"] and alone.points[0].error < .5 * errors["off"]


def test_without_a_pan(sphere, drawn):
    found = clfur.frontier(scene(sphere), WAYS[:1], repeat=1, pan=False)
    assert found.points[0].flicker is None and len(drawn) == 1 + 2
    assert clfur.frontier(scene(sphere), WAYS[:1], repeat=1).points[0].flicker > 0


def test_the_pan_of_the_truth(sphere, gpu):
    """Each step, cut from one large picture, is what the camera sees that is turned by so much."""
    there = scene(sphere)
    truths, _ = library._truths(there, gpu, lambda *_: None)
    assert truths.shape == (5, 24, 32, 4)
    for step, truth in enumerate(truths):
        fine = like_truth(library._moved(there, step / 4, 4), 1)
        np.testing.assert_allclose(truth, fine.reshape(24, 4, 32, 4, 4).mean((1, 3)), atol=2e-5)
    assert np.abs(truths[4, :, 1:] - truths[0, :, :-1]).max() < 2e-5 < np.abs(truths[1] - truths[0]).max()


def test_noise_of_the_truth(sphere, monkeypatch, gpu):
    random = np.random.default_rng(1)

    def noisy(scene, **_):
        width, height = scene.camera.size
        return np.concatenate([random.normal(.5, .1, (height, width, 3)), np.ones((height, width, 1))], 2)
    monkeypatch.setattr(library.truth, "picture", noisy)
    truths, noise = library._truths(scene(sphere), gpu, lambda *_: None)
    level = library.measures.measure(truths[0], np.broadcast_to([.5, .5, .5, 1], truths[0].shape))["error"]
    assert noise == pytest.approx(level, rel=.1)


def test_shells_are_their_own_truth(sphere, drawn):
    """In many unfiltered layers; how many a picture has is another thing to try."""
    shells = clfur.Shells(frequency=8, length=.2)
    found = clfur.frontier(scene(sphere, [clfur.Strands(inner=1, outer=1, roots=10), shells]),
                           [(clfur.Settings(), 1), (clfur.Settings(), 60), clfur.Settings()], repeat=1, pan=False)
    settings, fine = drawn[0]
    assert (settings.filtered, fine.shells.layers, fine.strands.roots) == (False, 120, 10)
    assert fine.camera.size == (33 * 4, 24 * 4) and "120 unfiltered layers" in found.truth
    assert {there.shells.layers for _, there in drawn[1:]} == {1, 30, 60}
    by_layers = {point.layers: point for point in found.points}
    assert set(by_layers) == {1, 30, 60} and by_layers[60].error < by_layers[1].error
    assert by_layers[1].label == "4 samples, coverage, 1 layer, shadow grid 96"
    assert {layers: point.name for layers, point in by_layers.items()} == {1: "", 30: "default", 60: ""}


@pytest.mark.parametrize("fur", ["strands", "shells", "none", "both"])
def test_sweep(sphere, fur):
    furs = {"both": [clfur.Strands(), clfur.Shells()]}
    ways = sweep(scene(sphere, furs.get(fur, fur)))
    assert (clfur.Settings(), 30 if fur in ("shells", "both") else None) in ways
    assert len(ways) == len(set(ways)) == len({label(*way) for way in ways}) <= 70
    assert len(ways) >= (10 if fur == "none" else 29)
    assert {settings.samples for settings, _ in ways} == {1, 4, 16}
    assert {layers for _, layers in ways} == ({8, 15, 30, 60} if fur in ("shells", "both") else {None})
    assert {settings.grid for settings, _ in ways} == (
        {96} if fur == "none" else {32, 48, 64, 96, 128} | (
            {160, 256} if fur in ("strands", "both") else set()))
    named = {settings for settings, _ in ways} & {*clfur.PRESETS.values()}
    assert len(named) == {"strands": 5, "both": 4}.get(fur, 0)   # shells refuse "deep"
    assert {(settings.shadows, settings.masks) for settings, _ in ways if settings.masks} == {
        "strands": {("length", 4), ("deep", 4)}, "both": {("length", 4)}}.get(fur, set())
    assert {settings.filtered for settings, _ in ways} == ({True, False} if fur in ("shells", "both") else {True})


def test_sweep_takes_light_from_hair_to_hair_where_looks_allow_it(sphere):
    kajiya, chiang = (clfur.HairType(look=look) for look in (clfur.Kajiya(), clfur.Chiang()))
    points = np.random.default_rng(1).normal(size=(2, 4, 3))
    for types, there in (([kajiya], False), ([chiang], True), ([kajiya, chiang], False)):
        furry = scene(sphere, clfur.Curves(points, types=types, type_of=[0, len(types) - 1]))
        assert any(settings.scattering == "grid" for settings, _ in sweep(furry)) == there
    assert not any(settings.scattering == "grid" for settings, _ in sweep(scene(sphere, "none")))


def test_sweep_takes_the_knobs_that_matter(sphere):
    ways = sweep(scene(sphere))
    good = {(s.samples, s.raster, s.lod) for s, _ in ways if (s.shadows, s.grid, s.pcf) == ("length", 64, 1)}
    assert len(good) == 3 * 2 * 4
    assert {(s.raster, s.lod) for s, _ in sweep(scene(sphere, "shells"))} == {("coverage", 0)}
    assert {(s.grid, s.shadow_map, s.pcf) for s, _ in ways if s.shadows == "off"} == {(64, 512, 1)}


def test_a_change_anywhere_measures_anew(monkeypatch):
    """Of any module or kernel of clfur."""
    read = []
    monkeypatch.setattr(cache, "digest", read.append)
    scheduler.sources.__wrapped__()
    names = {name for name, _ in read[0]}
    assert {"layout.py", "render.py", "plan.py", "coverage.py", "frontier.py", "light.h", "coverage.cl"} <= names


def test_label():
    assert label(clfur.Settings()) == "4 samples, coverage, shadow grid 96"
    assert label(clfur.Settings(lod=.5)) == "4 samples, coverage, shadow grid 96, lod 0.5"
    odd = clfur.Settings(samples=1, raster="samples", pcf=0, shadow_map=2048, filtered=False, blur="all")
    assert label(odd, 8) == "1 sample, 8 layers, shadow grid 96, unfiltered, map 2048, pcf 0, blur all"
    assert label(clfur.Settings(shadows="deep")) == "4 samples, coverage, deep shadows, shadow grid 96"
    assert label(attrs.evolve(odd, shadows="off"), 8) == (
        "1 sample, 8 layers, no shadows, unfiltered, blur all")


def test_digest(sphere):
    one, same = (scene(clfur.Mesh(sphere.positions, sphere.normals, sphere.uv, sphere.faces)) for _ in range(2))
    assert digest(one) == digest(same)
    others = [attrs.evolve(one, body_color=None), scene(sphere, size=(24, 32)), scene(sphere, "shells"),
              scene(sphere, clfur.Strands(inner=1, outer=1, roots=200, seed=1)),
              scene(sphere, clfur.Strands(inner=1, outer=1, roots=200, types=clfur.HairType(width=.003)))]
    assert len({digest(each) for each in [one, *others]}) == 6
    assert digest([1, 2], 3) != digest([1, 2, 3]) and digest("1") != digest(1)


@pytest.mark.parametrize("arguments, words", [
    ({"device": "abacus"}, "no OpenCL device matches 'abacus'"), ({"scene": "teapot"}, "scene is 'teapot'"),
    ({"repeat": 0}, "repeat is 0"), ({"candidates": []}, "candidates is"), ({"candidates": ["fast"]}, "'fast'"),
    ({"candidates": [(clfur.Settings(), 5)]}, "the scene has no shells"),
    ({"size": (2048, 4)}, "Camera.size is 2048x4")])
def test_wrong_arguments_are_refused_before_anything_is_drawn(sphere, monkeypatch, arguments, words):
    monkeypatch.setattr(library, "draw", None)
    monkeypatch.setattr(library.truth, "picture", None)
    monkeypatch.setattr(library, "OVER", 8)
    there = scene(sphere, size=arguments.pop("size", (32, 24)))
    with pytest.raises(clfur.Error, match=words):
        clfur.frontier(**{"scene": there, "candidates": WAYS, **arguments})


def test_nothing_to_see(sphere):
    away = clfur.Scene(mesh=sphere, camera=clfur.Camera(eye=(0, 0, 5), target=(0, 0, 9), size=(16, 12)))
    with pytest.raises(clfur.Error, match="nothing of the scene is to be seen"):
        clfur.frontier(away, WAYS)


def test_a_body_alone(sphere):
    found = clfur.frontier(scene(sphere, "none"), WAYS, repeat=1)
    assert {point.strands for point in found.points} == {0} and all(point.error < .2 for point in found.points)


def test_no_cache_folder(sphere, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(library.truth, "picture", None)
    with pytest.raises(clfur.Error, match="cannot write to"):
        clfur.frontier(scene(sphere), WAYS)
