"""Motion blur: means of pictures against the twin, clfur.blurred, and how many pictures it needs."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig
from clfur.stages import shutter
from clfur.twin import shutter as twin

SIZE = 48, 40
MEANS = ("color", "coverage", "hair_alpha", "body_alpha", "type_alpha", "orientation")


def turned(degrees, shift=(0, 0, 0), curves=True, roots=300, size=SIZE, **known):
    """A ball of hair that has turned around y, and moved."""
    positions, faces = icosphere(2)
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    rng = np.random.default_rng(1)
    away = rng.normal(size=(roots, 1, 3))
    away /= np.linalg.norm(away, axis=2, keepdims=True)
    points = away * np.linspace(1, 1.4, 5)[:, None] + [0, .3, 0] * np.linspace(0, 1, 5)[:, None]**2
    mesh = clfur.Mesh(positions=positions @ turn.T + shift, faces=faces)
    fur = clfur.Curves(points @ turn.T + shift, width=.03, lod_by="number") if curves else None
    return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=(0, .4, 4), size=size), **known)


def bits(images):
    return {name: image.tobytes() for name, image in images.items()}


@pytest.mark.small
def test_a_mean_is_the_twins(gpu):
    """In any order the same bits; of equal pictures theirs, where they are multiples of 2^-32."""
    rng = np.random.default_rng(2)
    pictures = (rng.normal(size=(7, 5, 3, 4)) * 10.0 ** rng.integers(-6, 4, (7, 5, 3, 4))).astype(np.float32)
    pictures[2, 0] = [3e9, -3e9, np.inf, 0]
    found = []
    for order in range(7), [3, 6, 0, 2, 5, 1, 4]:
        sums = None
        for k in order:
            sums = shutter.add(gpu, gpu.upload(pictures[k]), sums)
        found.append(gpu.download(shutter.mean(gpu, sums, 7)))
    np.testing.assert_array_equal(*found)
    np.testing.assert_allclose(found[0], twin.mean(pictures), rtol=1e-7, atol=2**-32)
    same = rng.integers(-2**23, 2**23, 50).astype(np.float32) * np.float32(2**-20)
    for n in 3, 5, 7:
        sums = None
        for _ in range(n):
            sums = shutter.add(gpu, gpu.upload(same), sums)
        np.testing.assert_array_equal(gpu.download(shutter.mean(gpu, sums, n)), same)


@pytest.mark.parametrize("settings", [clfur.Settings(), clfur.Settings(raster="samples", shadows="off")],
                         ids=["coverage", "samples"])
def test_blur_is_the_mean_of_pictures(gpu, settings):
    """Of all that is a share; the rest is of the middle, to the bit; one picture alone is `draw`'s."""
    outputs = ("id", *MEANS, "depth", "matte_id", "matte_alpha", "type", "strand_area")
    scenes = [turned(k) for k in (0, 7, 14)]
    one = clfur.blurred(scenes[1:2], gpu, settings, outputs, hashes=True)
    middle = clfur.draw(scenes[1], gpu, settings, outputs, hashes=True)
    assert bits(one.images) == bits(middle.images) and one.hashes == middle.hashes and one.pictures == 1
    frame = clfur.blurred(scenes, gpu, settings, outputs, hashes=True)
    assert list(frame.images) == list(outputs) and frame.pictures == 3 and frame.hashes == middle.hashes
    assert frame.settings == middle.settings and frame.stages["shutter"] > 0
    alone = [clfur.render(each, gpu, settings, (*MEANS, "strand_area")) for each in scenes]
    for name in outputs:
        if name in MEANS or name == "strand_area":   # 3 · 4 samples of the body in place of 4
            meant = np.mean([each[name] for each in alone], axis=0)
            np.testing.assert_allclose(frame.images[name], meant, atol=2e-7 * max(1, meant.max()), err_msg=name)
        else:
            np.testing.assert_array_equal(frame.images[name], middle.images[name])


def test_order_and_region_do_not_matter(gpu):
    """The same bits, whichever way time runs where the body is hidden, and of a part of the picture alone."""
    bare = {"body_color": None}
    scenes = [turned(3 * k, **bare) for k in range(5)]
    whole = clfur.blurred(scenes, gpu, outputs=("color", "hair_alpha"))
    assert bits(whole.images) == bits(clfur.blurred(scenes[::-1], gpu, outputs=("color", "hair_alpha")).images)
    x, y, width, height = region = 11, 9, 23, 17
    part = clfur.blurred([turned(3 * k) for k in range(5)], gpu, region=region).images["color"]
    full = clfur.blurred([turned(3 * k) for k in range(5)], gpu).images["color"]
    np.testing.assert_array_equal(part, full[y:y + height, x:x + width])
    still = [turned(0, **bare)] * 3
    np.testing.assert_allclose(clfur.blurred(still, gpu).images["color"], clfur.render(still[0], gpu), atol=2**-32)


def test_parts_and_teams_do_not_matter(gpu, another):
    """The same bits on a device where strands are drawn in parts beside the sums, and on two."""
    outputs = "color", "hair_alpha", "depth"
    scenes = [turned(2 * k, roots=14000) for k in range(2)]
    little, settings = another(memory=6 << 20), clfur.Settings(grid=32, shadow_map=64)
    whole = clfur.blurred(scenes, gpu, settings, outputs, hashes=True)
    assert len(Plan(Rig.of(scenes[0], settings), outputs, aside=48 * 40 * 5 * 8).parts(little)) > 1
    for device in little, [another(), another()]:
        frame = clfur.blurred(scenes, device, settings, outputs, hashes=True)
        assert bits(frame.images) == bits(whole.images) and frame.hashes == whole.hashes


def test_settings_are_chosen_once(gpu):
    """By the first picture, for all of them; which is told."""
    frame = clfur.blurred([turned(0), turned(3)], gpu, clfur.Settings(max_error=.1))
    assert frame.settings.goal is None and frame.error <= .1 and "tried" in frame.why and frame.pictures == 2


def test_bodies_are_smooth_with_one_sample_a_picture(gpu):
    """Of a still ball: four pictures are as good as one with four samples, sixteen better."""
    scene = attrs.evolve(turned(0, roots=1, light=clfur.Light(shadows=False)))
    settings = clfur.Settings(shadows="off")
    truth = np.mean([clfur.render(each, gpu, attrs.evolve(settings, samples=16)) for each in (
        attrs.evolve(scene, camera=_nudged(scene.camera, dx, dy)) for dx in (-.25, .25) for dy in (-.25, .25))], 0)
    errors = {}
    for n in 1, 4, 16:
        picture = clfur.blurred([scene] * n, gpu, settings).images["color"]
        errors[n] = np.sqrt(((picture - truth)[..., 3].astype(float)**2).mean())
    assert errors[4] == pytest.approx(errors[1], rel=1e-3) and errors[16] < 0.75 * errors[1]


def _nudged(camera, dx, dy):
    """A camera whose picture is moved by a part of a pixel."""
    k = camera.intrinsics.copy()
    k[:2, 2] += dx, dy
    return clfur.Camera.calibrated(camera.pose, k, camera.size)


def test_as_many_pictures_as_it_takes(gpu):
    large = {"size": (480, 400)}
    still, moved = turned(0, **large), turned(0, (.3, 0, 0), **large)
    assert clfur.subframes(still, still, gpu) == 1
    f = still.camera.intrinsics[0, 0]
    nearest = 4 - 1.4   # of the tips, along the axis
    far = .3 * f / nearest
    assert clfur.subframes(still, moved, gpu) == pytest.approx(far / 1.5, abs=2)
    assert clfur.subframes(still, turned(0, (2, 0, 0), **large), gpu) == 64
    beside = [turned(0, (x, 0, 0), **large) for x in (-90, -91)]
    assert clfur.subframes(*beside, gpu) == 1
    bald, gone = turned(0, curves=False, **large), turned(0, (.3, 0, 0), curves=False, **large)
    assert 1 < clfur.subframes(bald, gone, gpu) < clfur.subframes(still, moved, gpu)
    panned = attrs.evolve(still, camera=clfur.Camera(eye=(.3, .4, 4), target=(.3, 0, 0), **large))
    assert clfur.subframes(still, panned, gpu) == clfur.subframes(moved, still, gpu)


def test_what_is_refused(gpu):
    scene = turned(0)
    for call, words in [
            (lambda: clfur.blurred([], gpu), "scenes is"),
            (lambda: clfur.blurred(scene, gpu), "scenes is"),
            (lambda: clfur.blurred([scene] * 65, gpu), "allowed: a list of 1 to 64 clfur.Scenes"),
            (lambda: clfur.blurred([scene, turned(0, size=(9, 9))], gpu), "pictures of 9 x 9 and 48 x 40"),
            (lambda: clfur.blurred([scene] * 2, gpu, outputs=("colour",)), "there is no output 'colour'"),
            (lambda: clfur.subframes(scene, 3), "subframes closed is 3"),
            (lambda: clfur.subframes(scene, turned(0, roots=9), gpu), "before has 300 strands and scene 9")]:
        with pytest.raises(clfur.Error, match=words):
            call()
