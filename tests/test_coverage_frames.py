"""Whole frames of strands by area: every output, what is kept, and scenes of any kind."""

import attrs
import numpy as np
import pytest
from support.coverage import OFF, SETTINGS, ball, furry, wild
from support.pictures import same
from support.plans import bands_of, recorded
from support.scenes import scene_of

import clfur
from clfur import truth
from clfur.pipeline.views import view_of
from clfur.render import OUTPUTS
from clfur.stages import march


def check_outputs(out):
    """The alpha of shells is up to 5e-5 off what they let through, with samples too."""
    for name, image in out.items():
        assert not np.isnan(image).any() and (name in ("depth", "position") or np.isfinite(image).all()), name
    np.testing.assert_allclose(out["coverage"], out["color"][..., 3], rtol=0, atol=1e-4)
    assert out["coverage"].min() >= 0 and out["coverage"].max() <= 1 + 1e-6 and out["color"].min() >= 0
    np.testing.assert_array_equal(np.isinf(out["depth"]), out["id"] == -1)


@pytest.mark.parametrize("shells", [pytest.param(False, marks=pytest.mark.small), True])
def test_a_frame_with_everything_in_it(gpu, shells):
    """Every stage and every output."""
    fur = [clfur.Strands(inner=1, outer=1, types=clfur.HairType(segments=3, segment_length=.1, width=.02))]
    fur += [clfur.Shells(length=.1, frequency=6, layers=3)] * shells
    scene = clfur.Scene(ball(.8, 0), fur, clfur.Camera(size=(15, 11)), clfur.Light((-1, -1, -1)))
    out = clfur.render(scene, gpu, attrs.evolve(SETTINGS, samples=1), tuple(OUTPUTS))
    assert {-1} | ({-3} if shells else {-2}) < set(np.unique(out["id"])) and out["id"].max() >= 0
    check_outputs(out)


def test_two_runs_and_every_device_give_the_same_bits(gpu):
    """Shares, depths and hiding need + - * / and sqrt alone."""
    scene = furry("grown", size=(121, 83))
    one, again = (clfur.draw(scene, gpu, SETTINGS, tuple(OUTPUTS), hashes=True) for _ in range(2))
    same(one, again)
    other = clfur.draw(scene, clfur.Scheduler(), SETTINGS, tuple(OUTPUTS), hashes=True)
    assert one.hashes == other.hashes
    for name in ("coverage", "id"):
        np.testing.assert_array_equal(one.images[name], other.images[name])
    check_outputs(one.images)


@pytest.mark.parametrize("change, anew", [
    ({}, 0), ({"camera": clfur.Camera(eye=(.5, .9, 3), size=(61, 47))}, 0), ({"light": clfur.Light((1, -1, 0))}, 1),
    ({"fur": None}, 1), ({"body_color": None}, 1)])
@pytest.mark.parametrize("lod", [0, 1])
def test_light_on_strands_is_kept_while_only_the_camera_moves(gpu, monkeypatch, change, anew, lod):
    """For all bands of the picture, and for later frames, unless strands are thinned for the camera."""
    scene, settings = furry("grown", size=(61, 47)), attrs.evolve(SETTINGS, lod=lod)
    if "fur" in change:
        change = {"fur": attrs.evolve(scene.strands, seed=9)}
    launch, names = gpu.launch, []
    monkeypatch.setattr(gpu, "launch", lambda name, size, /, **rest: names.append(name) or launch(name, size, **rest))
    clfur.draw(scene, gpu, settings)
    assert names.count("strand_light.transmittance") == 1
    other = attrs.evolve(scene, **change)
    drawn = clfur.draw(other, gpu, settings, tuple(OUTPUTS), hashes=True)
    assert names.count("strand_light.transmittance") == 1 + (anew or (lod > 0 and "camera" in change))
    gpu.forget()
    right = clfur.draw(other, gpu, settings, tuple(OUTPUTS), hashes=True)
    assert right.hashes == drawn.hashes
    for name, image in right.images.items():
        np.testing.assert_array_equal(drawn.images[name], image, err_msg=name)


def test_light_on_parts_is_their_own(gpu, another, sphere):
    """What a picture in one part has left does not count against the memory of one in several, nor the other way."""
    scene = scene_of(9001, sphere)
    small = another(16_000_000)
    names, parts = recorded(small), []
    tiny = attrs.evolve(scene, camera=clfur.Camera(eye=(0, .4, 3.2), size=(12, 8)))
    large = attrs.evolve(scene, camera=clfur.Camera(eye=(0, .4, 3.2), size=(200, 150)))
    for one in (tiny, large, tiny, large, large):
        names.clear()
        frame = clfur.draw(one, small, SETTINGS)
        assert frame.memory <= 16_000_000
        np.testing.assert_array_equal(frame.images["color"], clfur.render(one, gpu, SETTINGS))
        parts.append(names.count("coverage.fill") // bands_of(names))
    assert parts == [parts[0], 1, parts[0], 1, 1] and parts[0] > 1   # in the tiny one all strands are in a row of tiles
    assert names.count("strand_light.transmittance") == 0   # known of all parts for the picture before


def test_any_order_of_strands_gives_the_same_bits(gpu):
    """Strands whose depths are nowhere equal."""
    strands = wild(80, 6, .8, .03)[:, :2]
    pictures = set()
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(80)
        scene = clfur.Scene(ball(), clfur.Curves(strands[order, :, :3], width=strands[order, :, 3]),
                            clfur.Camera(size=(41, 31)))
        out = clfur.render(scene, gpu, OFF, ["color", "coverage", "depth"])
        pictures.add(tuple(image.tobytes() for image in out.values()))
    assert len(pictures) == 1


@pytest.mark.parametrize("fur", [
    None, clfur.Strands(roots=0), clfur.Strands(roots=50, types=clfur.HairType(segments=0)),
    clfur.Curves(np.ones((3, 1, 3))), clfur.Curves(wild(9, 7)[..., :3], width=0)],
    ids=["none", "no-strands", "bald", "points", "no-width"])
def test_without_strands_there_is_the_body_alone(gpu, fur):
    mesh, camera = ball(), clfur.Camera(size=(41, 31))
    scene = clfur.Scene(mesh, fur or (), camera)
    keys = dict(samples=4, shadows="off")
    one = clfur.render(scene, gpu, clfur.Settings(raster="coverage", **keys), tuple(OUTPUTS))
    fur = fur if isinstance(fur, clfur.Strands) else ()      # samples show a strand without a width, and PN faces curve
    other = clfur.render(clfur.Scene(mesh, fur, camera), gpu, clfur.Settings(raster="samples", **keys), tuple(OUTPUTS))
    np.testing.assert_array_equal(one["id"] == -2, one["coverage"] > 0)
    np.testing.assert_allclose(one["color"], other["color"], atol=1e-5)
    np.testing.assert_array_equal(one["coverage"], other["coverage"])


def test_outputs_tell_of_what_fills_most_of_a_pixel(gpu):
    """Not of what is nearest: thin strands before a wide one before a plate."""
    focal = clfur.Camera(eye=(0, 0, 4), size=(33, 33)).intrinsics[0, 0]
    lines = np.array([[(-2, 0, z), (2, 0, z)] for z in (2, 1)], float)
    corners = np.array([(-2, 0, 0), (2, 0, 0), (2, 2, 0), (-2, 2, 0)], float)
    for width, expected in (.3, 1), (.6, 0):
        scene = clfur.Scene(clfur.Mesh(corners - (0, 1, 0), faces=[(0, 1, 2), (0, 2, 3)]),
                            clfur.Curves(lines, width=np.array([[width * 2 / focal] * 2, [.9 * 3 / focal] * 2])),
                            clfur.Camera(eye=(0, 0, 4), size=(33, 33)))
        out = clfur.render(scene, gpu, SETTINGS, tuple(OUTPUTS))
        assert (out["id"][16] == expected).all() and (out["id"][14] == -2).all() and (out["id"][1] == -1).all()
        np.testing.assert_allclose(out["depth"][16], (2, 3)[expected], rtol=1e-6)
        np.testing.assert_allclose(np.abs(out["tangent"][16]), np.broadcast_to([1, 0, 0], (33, 3)), atol=1e-6)
        np.testing.assert_allclose(out["depth"][14], 4, rtol=1e-6)
        assert (out["coverage"][16] == 1).all() and (out["coverage"][1] == 0).all()
        check_outputs(out)
    scene = clfur.Scene(fur=clfur.Curves(lines, width=.4 * 2 / focal), camera=scene.camera)
    out = clfur.render(scene, gpu, SETTINGS, tuple(OUTPUTS))
    np.testing.assert_allclose(out["coverage"][16], 1 - .6 * (1 - .4 * 2 / 3), atol=1e-5)
    check_outputs(out)


def test_shells_under_strands(gpu):
    fur = [clfur.Strands(inner=2, outer=2, types=clfur.HairType(segments=4, segment_length=.06, width=.01)),
           clfur.Shells(length=.15, frequency=20, layers=12)]
    scene = clfur.Scene(ball(.8, 2), fur, clfur.Camera(size=(61, 47)))
    out = clfur.render(scene, gpu, SETTINGS, tuple(OUTPUTS))
    assert {-3, -1} < set(np.unique(out["id"])) and out["id"].max() > 100
    check_outputs(out)
    # Without strands the shells are what they are with samples, and strands change nothing where they are not.
    bare = clfur.Scene(scene.mesh, [fur[1], clfur.Strands(roots=0)], scene.camera)
    one, other = (clfur.render(bare, gpu, clfur.Settings(raster=name, samples=4, shadows="off")) for name in (
        "coverage", "samples"))
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_hashes_with_shells_are_of_integers_alone(gpu, monkeypatch):
    """What shells let through comes of exp: another device may have other last bits."""
    fur = [clfur.Strands(inner=1, outer=1, roots=60), clfur.Shells(length=.15, frequency=20, layers=12)]
    scene = clfur.Scene(ball(.8, 2), fur, clfur.Camera(size=(31, 23)))
    whole = march.march

    def other(*arguments):
        image, transmittance, front = whole(*arguments)
        return image, gpu.upload(gpu.download(transmittance) * np.float32(1 - 1e-6)), front
    one = clfur.draw(scene, gpu, OFF, hashes=True)
    monkeypatch.setattr(march, "march", other)
    two = clfur.draw(scene, gpu, OFF, hashes=True)
    assert one.hashes == two.hashes and (one.images["color"] != two.images["color"]).any()
    three = clfur.draw(attrs.evolve(scene, fur=[fur[1], attrs.evolve(fur[0], roots=59)]), gpu, OFF, hashes=True)
    assert three.hashes["visibility"] != one.hashes["visibility"]


def test_a_strand_that_crosses_the_whole_picture_and_the_near_plane(gpu):
    points = np.array([[(-40, -30, -50), (0, 0, 0), (.1, .05, 40)], [(-900, .2, 0), (0, .2, 0), (900, .2, 0)]])
    scene = clfur.Scene(fur=clfur.Curves(points, width=.05), camera=clfur.Camera(eye=(0, .4, 3.2), size=(61, 47)))
    out = clfur.render(scene, gpu, SETTINGS, tuple(OUTPUTS))
    assert (out["coverage"].max(0) > .1).all()
    check_outputs(out)


def test_scenes_of_any_kind_give_numbers(gpu):
    """200 tiny pictures of whatever there may be: widths beyond the picture, eyes within hair, equal points."""
    rng, filled = np.random.default_rng(13), 0
    for number in range(200):
        n, size = int(rng.integers(1, 9)), tuple(int(v) for v in rng.integers(1, 20, 2))
        points = rng.normal(size=(n, rng.integers(2, 5), 3)) * 10.0 ** rng.integers(-3, 4, (1, 1, 1))
        points[rng.random(points.shape[:2]) < .2] = rng.normal(size=3) * (rng.random() < .5)
        width = rng.random(points.shape[:2]) * (.05 if rng.random() < .5 else 10.0 ** rng.integers(-9, 3))
        eye = rng.normal(size=3) * 10.0 ** rng.integers(-2, 3)
        mesh = ball(10.0 ** rng.integers(-1, 2), 0) if rng.random() < .5 else None
        target = points[0, 0] * (rng.random() < .7)
        camera = clfur.Camera(eye=eye + .01, target=target, fov=rng.uniform(1, 170), size=size)
        fur = [clfur.Curves(points, width=width)]
        if mesh is not None and rng.random() < .1:
            fur.append(clfur.Shells(length=.1, frequency=3, layers=3))
        scene = clfur.Scene(mesh, fur, camera)
        settings = clfur.Settings(raster="coverage", samples=(1, 4, 16)[number % 3], grid=16, shadow_map=16,
                                  shadows=("off", "length")[number % 2])
        out = clfur.render(scene, gpu, settings, tuple(OUTPUTS))
        check_outputs(out)
        filled += (out["id"] >= 0).any()
    assert filled > 50


def test_thin_strands_cover_what_the_truth_says(gpu):
    """At 0.36 pixels: the area is the truth's, where opaque lines one pixel wide cover more than twice of it."""
    rng = np.random.default_rng(5)
    roots = rng.uniform(-1, 1, (60, 3))
    points = roots[:, None] + np.linspace(0, 1, 5)[None, :, None] * rng.normal(0, .35, (60, 1, 3))
    camera = clfur.Camera(eye=(0, 0, 4), size=(72, 54))
    width = .36 * 4 / view_of(clfur.Scene(fur=clfur.Curves(points), camera=camera), 1)["scale"][0]
    scene = clfur.Scene(fur=clfur.Curves(points, width=width), camera=camera)
    true = truth.picture(scene, samples=16)[..., 3].sum()
    areas = {name: clfur.render(scene, gpu, clfur.Settings(**knobs))[..., 3].sum() for name, knobs in (
        ("coverage", {"raster": "coverage"}), ("coverage, lod", {"raster": "coverage", "lod": .3}),
        ("lines", {"raster": "samples", "samples": 1}))}
    assert areas["coverage"] == pytest.approx(true, rel=.02)
    assert areas["coverage, lod"] == pytest.approx(true, rel=.02)
    assert areas["lines"] > 2 * true
