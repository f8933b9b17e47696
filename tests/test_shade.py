"""Shading: the twin's values on every device, and the laws of light."""

import dataclasses
import functools

import numpy as np
import pytest
from support.scenes import icosphere
from support.stages import on_host

import clfur
from clfur import layout
from clfur.pipeline.views import light_of, view_of
from clfur.stages import shade
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import raster
from clfur.stages.strands import grow, no_strands, upload_curves
from clfur.stages.tessellate import no_surface, tessellate
from clfur.twin import shade as twin
from clfur.twin import vectors

NONE = np.uint64(twin.NONE)
FORMS = ["kajiya-kay", "half-vector"]
BOTH = pytest.mark.parametrize("form", FORMS)

# sqrt(1 - c²) where it should be 0, of a cosine that is wrong by two roundings of 2^-24.
SINE_AT_ZERO = 5e-4


def unit(a):
    return np.asarray(a, float) / np.linalg.norm(a, axis=-1, keepdims=True)


def random_units(seed, *shape):
    return unit(np.random.default_rng(seed).normal(size=(*shape, 3)))


def shaded(gpu, tangents, to_light, to_eye, form="kajiya-kay", color=(0, 0, 0), specular=1.0, exponent=150.0,
        light=(1, 1, 1), ambient=0.0, ids=None):
    """Light of fibres [N, 3] seen all from one direction, one in a pixel -> [N, 4], and the twin's.

    ``ids``: [N, samples] which fibre each sample of each pixel sees instead, -1 for none.
    """
    n = len(tangents)
    ids = np.arange(n)[:, None] if ids is None else np.asarray(ids)
    view = np.zeros((), layout.View)
    view["to_screen"] = view["to_world"] = np.eye(4)
    view["eye"][:3] = to_eye
    view["size"] = len(ids), 1, ids.shape[1], layout.pattern_start(ids.shape[1])
    view["rows"][1] = 1
    packed = light_of(clfur.Light(-np.asarray(to_light, float), light, ambient))
    points = np.zeros((2 * n, 4), np.float32)
    points[:, :3] = np.repeat(np.asarray(tangents), 2, 0) * np.tile([[0], [1]], (n, 1))
    fur = dataclasses.replace(
        no_strands(gpu), points=gpu.upload(points),
        strand_of=gpu.upload(np.arange(n, dtype=np.uint32)), run=2,
        stored=gpu.upload(2 * np.arange(n, dtype=np.uint32)),
        spans=gpu.upload(np.stack([2 * np.arange(n), np.full(n, 2)], 1).astype(np.uint32)),
        colors=gpu.upload(np.array([[*color, 0]], np.float32)), color_per=0, uv=gpu.full((n, 4), np.float32, 0),
        types=upload_curves(gpu, clfur.Curves(np.zeros((0, 2, 3)), look=clfur.Kajiya(specular, exponent, form))).types)
    keys = np.where(ids < 0, NONE, (1 << 29 << 32) + 2 * ids.astype(np.uint64))[None]
    image = shade.color(gpu, view, unshadowed(gpu, packed), gpu.upload(keys), fur, no_surface(gpu), (0, 0, 0)).get()[0]
    bare = on_host(no_surface(gpu))
    return image, twin.color(view, [packed], keys, on_host(fur), bare, (0, 0, 0))[0]


# --- the twin's values ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ball(sphere):
    uv = np.random.default_rng(0).random((len(sphere.faces), 3, 2))
    return clfur.Mesh(sphere.positions * 0.5, sphere.normals, uv, sphere.faces)


def picture(gpu, scene, samples):
    """The stages' results for a scene: view, light, visible, strands, body, as `clfur.render` has them."""
    view = view_of(scene, samples)
    body = tessellate(gpu, scene.mesh, *((2, 2) if isinstance(scene.fur, clfur.Strands) else ()))
    strands = grow(gpu, body, scene.fur) if isinstance(scene.fur, clfur.Strands) else upload_curves(gpu, scene.fur)
    return view, light_of(scene.light), raster(gpu, view, strands, body), strands, body


def furry(ball, kind, exponent, form="kajiya-kay"):
    rng = np.random.default_rng(1)
    steps = rng.normal(size=(300, 4, 3)) * 0.15
    points = np.concatenate([rng.uniform(-1, 1, (300, 1, 3)), steps], 1).cumsum(1)
    colors = {"all": rng.random(3), "strand": rng.random((300, 3)), "point": rng.random((300, 5, 3))}
    look = clfur.Kajiya(0.3, exponent, form)
    types = clfur.HairType(width=0.02, segment_length=0.03, look=look, color_variation=0.5)
    fur = (clfur.Strands(inner=2, outer=2, types=types) if kind == "grown"
           else clfur.Curves(points, width=0.02, color=colors[kind], look=look))
    return clfur.Scene(ball, fur, clfur.Camera(size=(97, 61)), clfur.Light((-1, -0.3, -0.5), (1, 0.8, 0.6)))


@BOTH
@pytest.mark.parametrize("kind, samples, exponent", [
    ("point", 1, 8), ("point", 1, 150), ("point", 4, 1000), ("strand", 16, 150), ("all", 1, 150),
    ("grown", 4, 150)])
def test_color_is_the_twins(gpu, ball, form, kind, samples, exponent):
    """Measured on four drivers: 1.5e-5, and 2.2e-5 at an exponent of 1000.

    The point that a sample sees is wrong by some 5e-7, a few roundings of the eye's distance; where a strand
    turns sharply, or is seen from its end, that is some 1e-5 of its tangent, and where it is parallel to the light
    the sine takes the root of its rounding.  The power multiplies a highlight's relative error by the exponent.
    """
    scene = furry(ball, kind, exponent, form)
    view, light, visible, strands, body = picture(gpu, scene, samples)
    image = shade.color(gpu, view, unshadowed(gpu, light), visible, strands, body, scene.body_color).get()
    meant = twin.color(view, [light], visible.get(), on_host(strands), on_host(body), scene.body_color)
    assert np.isfinite(image).all()
    off = np.abs(image - meant).max(2)
    assert off.max() < 2e-5 + 2e-8 * exponent
    assert np.quantile(off, 0.99) < 1.5e-6 + 5e-9 * exponent
    np.testing.assert_array_equal(image[..., 3], meant[..., 3])
    ids = visible.get() & np.uint64(0xFFFFFFFF)
    assert (ids < twin.BODY).any() and ((ids >= twin.BODY) & (ids < 0xFFFFFFFF)).any()


@pytest.mark.parametrize("samples", [1, 4])
def test_light_over_a_picture_is_that_of_sums(gpu, ball, samples):
    """Straight into a picture whose alpha is known, or added up first: the same bits, with that alpha."""
    scene = furry(ball, "grown", 40)
    view, light, visible, strands, body = picture(gpu, scene, samples)
    rng, size = np.random.default_rng(samples), visible.shape[:2]
    image, alpha = rng.random((*size, 4), np.float32), gpu.upload(rng.random(size, np.float32))
    color = functools.partial(shade.color, gpu, view, unshadowed(gpu, light), visible, strands, body, scene.body_color)
    apart = shade.blend(gpu, color(sums=shade.no_light(gpu, *size)), gpu.upload(image), coverage=alpha)
    np.testing.assert_array_equal(color(gpu.upload(image), coverage=alpha).get(), apart.get())


@pytest.mark.parametrize("kind", ["point", "grown"])
def test_several_lights_are_the_twins(gpu, ball, kind):
    """A distant light, a spot and one that is out but for its ambient."""
    scene = furry(ball, kind, 40)
    view, light, visible, strands, body = picture(gpu, scene, 4)
    lights = [light, light_of(clfur.Light((1, -1, -1), (.2, .4, 1), .05, position=(-1, 1, 1.5), angle=50)),
              light_of(clfur.Light((0, -1, 0), (0, 0, 0), .3))]
    image = shade.color(gpu, view, unshadowed(gpu, *lights), visible, strands, body, scene.body_color).get()
    meant = twin.color(view, lights, visible.get(), on_host(strands), on_host(body), scene.body_color)
    off = np.abs(image - meant).max(2)
    edge = off > 6e-5                     # a place on the border of the spot's cone may be within or not
    assert edge.mean() < 1e-3 and np.quantile(off, .99) < 5e-6
    np.testing.assert_array_equal(image[..., 3], meant[..., 3])


def test_the_twin_sees_swapped_arrays(gpu, ball, monkeypatch):
    """Two float4 arrays under each other's names are the kernel's own mistake: no signature tells them apart."""
    launch = gpu.launch

    def swapped(name, size, /, **arguments):
        arguments["points"], arguments["strand_uv"] = arguments["strand_uv"], arguments["points"]
        return launch(name, size, **arguments)
    scene = furry(ball, "grown", 150)
    view, light, visible, strands, body = picture(gpu, scene, 1)
    meant = twin.color(view, [light], visible.get(), on_host(strands), on_host(body), scene.body_color)

    def off():
        image = shade.color(gpu, view, unshadowed(gpu, light), visible, strands, body, scene.body_color).get()
        return np.nan_to_num(np.abs(image - meant), nan=1.0).max()
    assert off() < 2.5e-5
    monkeypatch.setattr(gpu, "launch", swapped)
    assert off() > 0.01


@pytest.mark.small
@pytest.mark.parametrize("kind, form", [("all", FORMS[0]), ("strand", FORMS[1]), ("point", FORMS[0])])
def test_a_small_picture_is_the_twins(gpu, kind, form):
    positions, faces = icosphere(0)
    rng = np.random.default_rng(14)
    points = np.concatenate([rng.uniform(-1, 1, (20, 1, 3)), rng.normal(size=(20, 3, 3)) * 0.2], 1).cumsum(1)
    colors = {"all": rng.random(3), "strand": rng.random((20, 3)), "point": rng.random((20, 4, 3))}[kind]
    scene = clfur.Scene(clfur.Mesh(positions * 0.5, positions, rng.random((20, 3, 2)), faces),
                        clfur.Curves(points, width=0.05, color=colors, look=clfur.Kajiya(highlight=form)),
                        clfur.Camera(size=(23, 17)))
    view, light, visible, strands, body = picture(gpu, scene, 4)
    image = shade.color(gpu, view, unshadowed(gpu, light), visible, strands, body, scene.body_color).get()
    keys, hair, bare = visible.get(), on_host(strands), on_host(body)
    np.testing.assert_allclose(
        image, twin.color(view, [light], keys, hair, bare, scene.body_color), rtol=0, atol=2.5e-5)
    found, meant = shade.outputs(gpu, view, visible, strands, body), twin.outputs(view, keys, hair, bare)
    assert {-2, -1} < set(np.unique(meant["id"]))
    for name, tolerance in ("id", 0), ("coverage", 1e-7), ("tangent", 3e-5), ("normal", 8e-5), ("uv", 5e-6):
        np.testing.assert_allclose(found[name].get(), meant[name], rtol=0, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("kind", ["point", "grown"])
@pytest.mark.parametrize("raster", ["samples", "coverage"])
def test_places_lit_side_by_side_are_lit_as_one(gpu, another, ball, kind, raster):
    """For any number of them the same bits, shadows and all: what is no + - * / is a series of these."""
    scene = furry(ball, kind, 40)
    spot = clfur.Light((1, -1, -1), (.2, .4, 1), .05, position=(-1, 1, 1.5), angle=50)
    scene = clfur.Scene(scene.mesh, scene.fur, scene.camera, (scene.light, spot))
    settings = clfur.Settings(raster=raster, samples=4, pcf=2)
    drawn = clfur.render(scene, gpu, settings)
    one_by_one = clfur.render(scene, another(lanes=1), settings)
    np.testing.assert_allclose(drawn, one_by_one, rtol=0, atol=0)
    dark = clfur.render(clfur.Scene(scene.mesh, scene.fur, scene.camera, spot), gpu, settings)
    assert (np.abs(drawn - dark).max(2) > .01).mean() > .1


@pytest.mark.small
@pytest.mark.parametrize("samples", [1, 4])
def test_coverage_becomes_alpha(gpu, samples):
    """What fur hides of the samples that see nothing, and what is known already: neither is a sum of rounded shares."""
    rng = np.random.default_rng(samples)
    image, visible = rng.random((7, 9, 4), np.float32), rng.integers(0, 1 << 40, (7, 9, samples), np.uint64)
    visible[rng.random(visible.shape) < .5] = np.uint64(twin.NONE)
    through = rng.choice(np.float32([0, .25, 1 / 3, 1]), visible.shape)
    covered = gpu.upload(image)
    shade.cover(gpu, gpu.upload(visible), gpu.upload(through), covered)
    np.testing.assert_allclose(covered.get()[..., 3], twin.cover(visible, through), rtol=2e-7)
    np.testing.assert_array_equal(covered.get()[..., :3], image[..., :3])
    assert covered.get()[..., 3].max() == 1
    sums, alpha = gpu.upload(rng.integers(0, 1 << 32, (7, 9, 4))), rng.random((7, 9), np.float32)
    known = shade.blend(gpu, sums, gpu.upload(image), coverage=gpu.upload(alpha)).get()
    np.testing.assert_array_equal(known[..., :3], shade.blend(gpu, sums, gpu.upload(image)).get()[..., :3])
    np.testing.assert_array_equal(known[..., 3], alpha)


@pytest.mark.parametrize("samples", [1, 4, 16])
@pytest.mark.parametrize("kind", ["point", "grown"])
def test_outputs_are_the_twins(gpu, ball, kind, samples):
    """Unit vectors by the same 5e-7 of a point as colours; a vector across a strand seen from its end is the
    small rest of two nearly equal ones.  Measured on four drivers: 2.7e-7, 2.1e-5, 5.6e-5 and 3.9e-6."""
    scene = furry(ball, kind, 150)
    view, _, visible, strands, body = picture(gpu, scene, samples)
    found = {name: array.get() for name, array in shade.outputs(gpu, view, visible, strands, body).items()}
    meant = twin.outputs(view, visible.get(), on_host(strands), on_host(body))
    assert set(found) == set(meant)
    np.testing.assert_array_equal(found["id"], meant["id"])
    np.testing.assert_array_equal(found["coverage"], meant["coverage"].astype(np.float32))
    np.testing.assert_allclose(found["depth"], meant["depth"], rtol=4e-7)
    for name, tolerance in ("tangent", 3e-5), ("normal", 8e-5), ("uv", 5e-6):
        np.testing.assert_allclose(found[name], meant[name], rtol=0, atol=tolerance)
        assert np.quantile(np.abs(found[name] - meant[name]), 0.99) < 2e-6
    assert len(np.unique(found["id"])) > 50


@BOTH
@pytest.mark.parametrize("exponent", [1, 20, 150, 3000])
def test_light_of_a_fibre_is_the_twins(gpu, form, exponent):
    """Every direction against every other; without a picture there is nothing but the formula's rounding.

    Some roundings of 2^-24 in a cosine are divided by the sine, but give at most SINE_AT_ZERO; the power
    multiplies them by the exponent (measured on four drivers: half of what is allowed).  exp(-16) is the part
    of the power that the kernel leaves out.
    """
    tangents = random_units(2, 300)
    for to_light, to_eye in random_units(3, 12, 2):
        image, meant = shaded(gpu, tangents, to_light, to_eye, form, (0.2, 0.5, 0.9), 0.7, exponent, ambient=0.1)
        assert np.isfinite(image).all()
        others = [to_light, to_eye] + [unit(to_light + to_eye)] * (form == "half-vector")
        least = np.min([vectors.sine(tangents, each) for each in others], 0)
        t = 1 + np.minimum(1 / least, SINE_AT_ZERO * 2**24)
        tolerance = 2 * 2.0**-24 * t * (1 + exponent) + np.exp(-16)
        assert (np.abs(image - meant).max(1) <= tolerance).all()


# --- diffuse light --------------------------------------------------------------------------------------


def test_diffuse_is_proportional_to_the_sine(gpu):
    for seed, to_light in enumerate(random_units(4, 4)):
        tangents = random_units(seed, 200)
        color, light = np.array([0.3, 0.6, 0.9]), np.array([2, 1, 0.5])
        image, _ = shaded(gpu, tangents, to_light, (0, 0, 1), color=color, specular=0, light=light)
        angle = np.arccos(tangents @ to_light)
        tolerance = 4 * 2.0**-24 * (1 + 1 / np.sin(angle))       # see SINE_AT_ZERO, which stays far
        assert (np.abs(image[:, :3] - color * light * np.sin(angle)[:, None]).max(1) < 2 * tolerance).all()


def test_light_along_the_fibre_gives_nothing(gpu):
    tangents = random_units(5, 50)
    for t in tangents:
        for sign in (1, -1):
            image, _ = shaded(gpu, t[None], sign * t, (0, 0, 1), color=(1, 1, 1), specular=0)
            assert (image[:, :3] >= 0).all() and (image[:, :3] <= SINE_AT_ZERO).all()


def test_ambient_alone_where_the_light_is_black(gpu, ball):
    tangents, color = random_units(6, 100), np.array([0.3, 0.6, 0.9], np.float32)
    image, _ = shaded(gpu, tangents, (0, 1, 0), (0, 0, 1), color=color, light=(0, 0, 0), ambient=0.25)
    np.testing.assert_array_equal(image[:, :3], np.broadcast_to(color / 4, (100, 3)))
    scene = clfur.Scene(ball, light=clfur.Light(color=(0, 0, 0), ambient=0.5), body_color=(0.5, 0.25, 1))
    image = clfur.render(scene, gpu)
    np.testing.assert_allclose(image[..., :3], image[..., 3:] * np.array([0.25, 0.125, 0.5]), atol=1e-7)


# --- the highlight --------------------------------------------------------------------------------------


def around(t, cosine, count):
    """Unit vectors with this cosine to t, evenly around it: [count, 3]."""
    a = unit(np.cross(t, (0.3, 0.9, -0.4)))
    b = np.cross(t, a)
    phi = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    return cosine * np.asarray(t) + np.sqrt(1 - cosine**2) * (np.cos(phi) * a + np.sin(phi) * b)


@BOTH
def test_the_highlight_is_strongest_on_the_mirror_cone(gpu, form):
    """There, at t·v = -t·l, it is `specular`, whatever the form; nowhere is it stronger."""
    for t, to_light in random_units(7, 4, 2):
        rounding = 150 * 4 * 2.0**-24
        for to_eye in around(t, -float(t @ to_light), 7):
            image, _ = shaded(gpu, t[None], to_light, to_eye, form, specular=0.8)
            np.testing.assert_allclose(image[0, :3], 0.8, rtol=rounding)
        other = np.array([shaded(gpu, t[None], to_light, to_eye, form, specular=0.8)[0][0, 0]
                          for to_eye in random_units(8, 30)])
        assert (other <= 0.8 * (1 + rounding)).all() and other.min() < 0.4
        # It falls off with the angle to the cone, on both sides.
        tilt = np.arccos(-t @ to_light) + np.radians([-20, -10, -5, 0, 5, 10, 20])
        slope = np.array([shaded(gpu, t[None], to_light, around(t, np.cos(a), 1)[0], form)[0][0, 0]
                          for a in tilt])
        assert (np.diff(slope[:4]) > 0).all() and (np.diff(slope[3:]) < 0).all()


def test_kajiya_and_kays_highlight_where_there_is_no_half_vector(gpu):
    """Around l = -v: theirs is continuous and `specular` there; the report's jumps (its figure 12)."""
    tangents = random_units(9, 40)
    to_light = unit((0.3, 0.5, -0.6))
    side = unit(np.cross(to_light, (1, 2, 3)))
    at = {form: [shaded(gpu, tangents, to_light, unit(-to_light + step * side), form)[0][:, 0]
                 for step in (-1e-2, -1e-3, -1e-5, 0, 1e-5, 1e-3, 1e-2)] for form in FORMS}
    own, report = (np.array(at[form]) for form in FORMS)
    assert np.isfinite(own).all() and np.isfinite(report).all()
    # By Kajiya and Kay cos^p of an angle below 1e-2 to the mirror cone: 1 - p·1e-4/2 or more.
    assert (own > 1 - 150 * 0.5e-4 - 150 * 4 * 2.0**-24).all()
    assert np.abs(own[2:5] - 1).max() < 150 * 4 * 2.0**-24
    # The half vector of two that almost cancel is `side`, and at l = -v nothing.
    across = np.linalg.norm(np.cross(tangents, side), axis=1) ** 150
    assert (across > 0.1).any() and (report[3] == 0).all()
    np.testing.assert_allclose(report[1], across, atol=0.01)
    assert np.abs(np.diff(report, axis=0)).max() > 0.5


@BOTH
def test_nothing_changes_with_rotation_around_the_fibre(gpu, form):
    """Light and eye turned together; Kajiya and Kay's highlight also if the eye turns alone."""
    for seed, t in enumerate(random_units(10, 3)):
        cos_l, cos_v = np.random.default_rng(seed).uniform(-0.9, 0.9, 2)
        lights, eyes = around(t, cos_l, 16), around(t, cos_v, 16)
        together = [shaded(gpu, t[None], li, v, form, (0.5, 0.5, 0.5), exponent=20)[0][0, 0]
                    for li, v in zip(lights, np.roll(eyes, 3, 0))]
        alone = [shaded(gpu, t[None], lights[0], v, form, exponent=20)[0][0, 0] for v in eyes]
        np.testing.assert_allclose(together, together[0], rtol=0, atol=20 * 8 * 2.0**-24)
        assert (np.ptp(alone) < 20 * 8 * 2.0**-24) == (form == "kajiya-kay")


@BOTH
def test_helmholtz_reciprocity_of_the_highlight(gpu, form):
    tangents = random_units(11, 100)
    for one, other in random_units(12, 8, 2):
        there = shaded(gpu, tangents, one, other, form, exponent=20)[0]
        back = shaded(gpu, tangents, other, one, form, exponent=20)[0]
        np.testing.assert_allclose(there, back, rtol=0, atol=20 * 8 * 2.0**-24)
        assert np.ptp(there[:, 0]) > 0.3


@BOTH
def test_no_direction_gives_nan(gpu, form):
    axes = np.concatenate([np.eye(3), [[0, 0, -1]], random_units(13, 2)])
    for to_light in axes:
        for to_eye in (*axes, to_light, -to_light):
            for exponent in (1e-3, 1e6):
                image, _ = shaded(gpu, np.concatenate([axes, [to_light]]), to_light, to_eye, form, (1, 1, 1),
                               exponent=exponent)
                assert np.isfinite(image).all() and (image >= 0).all()
                assert (image <= 2 + 1e6 * 2.0**-22).all()


# --- the body -------------------------------------------------------------------------------------------


def wall(distance=0.0, half=2.0, normal=(0, 0, 1)):
    """A square across the view, with uv from (0, 0) at the lower left to (1, 1)."""
    corners = np.array([(-half, -half, distance), (half, -half, distance), (half, half, distance),
                        (-half, half, distance)])
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1.0)])
    return clfur.Mesh(corners, np.tile(normal, (4, 1)), uv, [(0, 1, 2), (0, 2, 3)])


@pytest.mark.parametrize("degrees", [0, 30, 60, 89, 91, 150])
@pytest.mark.parametrize("facing", [1, -1])
def test_the_body_is_lamberts(gpu, degrees, facing):
    """color · (light · cos + ambient), on the side that is seen, whichever way its normal points."""
    a = np.radians(degrees)
    light = clfur.Light((np.sin(a), 0, -np.cos(a)), (1, 0.5, 0.25), 0.1)
    scene = clfur.Scene(wall(normal=(0, 0, facing)), camera=clfur.Camera(eye=(0, 0, 3), size=(9, 7), fov=30),
                        light=light, body_color=(0.8, 0.6, 0.4))
    image = clfur.render(scene, gpu)
    expected = np.array([0.8, 0.6, 0.4]) * (np.array([1, 0.5, 0.25]) * max(np.cos(a), 0) + 0.1)
    np.testing.assert_allclose(image, np.broadcast_to([*expected, 1], image.shape), rtol=3e-7, atol=1e-7)


# --- the picture ----------------------------------------------------------------------------------------


def test_a_pixel_is_the_mean_of_its_samples(gpu):
    """Also where some of them see nothing: then it is premultiplied, and alpha is the covered share."""
    rng = np.random.default_rng(14)
    tangents = random_units(15, 50)
    look = dict(form="kajiya-kay", color=(0.9, 0.5, 0.2), ambient=0.2)
    alone, _ = shaded(gpu, tangents, (0.6, 0.8, 0), (0, 0, 1), **look)
    for samples in (1, 4, 16):
        ids = rng.integers(-25, 50, (200, samples))
        image, _ = shaded(gpu, tangents, (0.6, 0.8, 0), (0, 0, 1), ids=ids, **look)
        each = np.where(ids[..., None] >= 0, alone[ids], 0)
        np.testing.assert_allclose(image, each.mean(1), rtol=0, atol=4 * 2.0**-24 * each.max())
        np.testing.assert_array_equal(image[:, 3], (ids >= 0).mean(1))


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_alpha_is_coverage_and_colour_is_premultiplied(gpu, samples):
    rng = np.random.default_rng(16)
    fur = clfur.Curves(rng.uniform(-1, 1, (40, 3, 3)), width=0.05, color=(0.5, 0.25, 1))
    scene = clfur.Scene(fur=fur, camera=clfur.Camera(size=(97, 61)),
                        light=clfur.Light(color=(0, 0, 0), ambient=1))
    images = clfur.render(scene, gpu, clfur.Settings(raster="samples", samples=samples), ["color", "coverage"])
    alpha = images["color"][..., 3]
    np.testing.assert_array_equal(alpha, images["coverage"])
    assert set(np.unique(alpha)) <= set(np.arange(samples + 1) / samples) and 0.02 < alpha.mean() < 0.9
    assert samples == 1 or len(np.unique(alpha)) > 2
    np.testing.assert_array_equal(images["color"][..., :3], alpha[..., None] * np.float32([0.5, 0.25, 1]))


@pytest.mark.parametrize("samples", [1, 4])
def test_outputs_of_a_strand_before_a_wall(gpu, samples):
    """A vertical strand half a unit before a wall that fills the middle of the picture."""
    eye = np.array([0, 0, 3.0])
    strand = np.array([[(0, -1.5, 0.5), (0, 1.5, 0.5)]])
    scene = clfur.Scene(wall(half=1), clfur.Curves(strand, width=0.06), clfur.Camera(eye=eye, size=(97, 61)))
    found = clfur.render(scene, gpu, clfur.Settings(raster="samples", samples=samples),
                        ["depth", "id", "tangent", "normal", "uv", "coverage", "color"])
    ids = found["id"]
    assert ids[30, 48] == 0 and ids[30, 40] == -2 and ids[30, 3] == -1
    assert set(np.unique(ids)) == {-2, -1, 0}

    nothing = ids == -1
    assert np.isposinf(found["depth"][nothing]).all()
    for name in ("tangent", "normal", "uv", "coverage", "color"):
        assert (found[name][nothing] == 0).all()

    # The strand: 2.5 along the view axis; up; its normal is level and towards the eye.
    hair = ids == 0
    np.testing.assert_allclose(found["depth"][hair], 2.5, rtol=4e-7)
    np.testing.assert_array_equal(found["tangent"][hair], np.broadcast_to([0, 1, 0], (hair.sum(), 3)))
    focal = scene.camera.intrinsics[0, 0]
    if samples == 1:
        y, x = np.nonzero(hair)
        to_eye = np.stack([-(x + 0.5 - 48.5) / focal, 0 * x, 1 + 0 * x], 1)
        np.testing.assert_allclose(found["normal"][hair], unit(to_eye), atol=1e-6)
    np.testing.assert_allclose(found["normal"][30, 48], (0, 0, 1), atol=0.01)
    assert (found["uv"][hair] == 0).all()

    # The wall: 3 along the view axis; no tangent; uv is the place on it.
    body = ids == -2
    np.testing.assert_allclose(found["depth"][body], 3, rtol=4e-7)
    assert (found["tangent"][body] == 0).all()
    np.testing.assert_allclose(found["normal"][body], np.broadcast_to([0, 0, 1], (body.sum(), 3)), atol=1e-6)
    y, x = np.nonzero(body & (found["coverage"] == 1) if samples > 1 else body)
    place = np.stack([(x + 0.5 - 48.5), -(y + 0.5 - 30.5)], 1) * 3 / focal
    # With more samples it is a place somewhere in the pixel, 3/focal wide of a wall 2 wide.
    tolerance = 1e-6 if samples == 1 else 0.51 * 1.5 / focal
    np.testing.assert_allclose(found["uv"][y, x], place / 2 + 0.5, rtol=0, atol=tolerance)
    assert (found["coverage"][hair | body] > 0).all() and found["coverage"][30, 40] == 1


def test_depth_and_id_are_those_of_the_nearest_sample(gpu):
    """Two strands in one pixel: the nearer one is told of, however little it covers."""
    strands = np.array([[(-1, 0.001, 0), (1, 0.001, 0)], [(0.001, -1, 0.5), (0.001, 1, 0.5)]])
    scene = clfur.Scene(fur=clfur.Curves(strands, width=np.array([[0.5, 0.5], [0.001, 0.001]])),
                        camera=clfur.Camera(eye=(0, 0, 3), size=(33, 33)))
    found = clfur.render(scene, gpu, clfur.Settings(raster="samples", samples=16), ["id", "depth", "coverage"])
    assert (found["id"][14:19, 16] == 1).all() and (found["coverage"][14:19, 16] == 1).all()
    np.testing.assert_allclose(found["depth"][14:19, 16], 2.5, rtol=4e-7)
    assert (found["id"][16, :12] == 0).sum() > 3


def test_colour_of_strands_and_points(gpu):
    """One for all, each strand's, or each point's with a ramp between."""
    strands = np.array([[(-1, 0.5, 0), (1, 0.5, 0)], [(-1, -0.5, 0), (1, -0.5, 0)]])
    camera, light = clfur.Camera(eye=(0, 0, 3), size=(97, 61)), clfur.Light(color=(0, 0, 0), ambient=1)

    def rows(color):
        scene = clfur.Scene(fur=clfur.Curves(strands, width=0.2, color=color), camera=camera, light=light)
        image = clfur.render(scene, gpu, clfur.Settings(raster="samples", samples=1))
        return [image[y, 30:67, :3] for y in (18, 42)]
    red, blue = np.float32([0.75, 0, 0]), np.float32([0, 0, 0.5])
    for row in rows(red):
        np.testing.assert_array_equal(row, np.broadcast_to(red, row.shape))
    for row, color in zip(rows(np.array([[red, red], [blue, blue]])), (red, blue)):
        np.testing.assert_allclose(row, np.broadcast_to(color, row.shape), atol=1e-7)
    upper, _ = rows(np.array([[red, blue], [blue, red]]))
    share = ((np.arange(30, 67) + 0.5 - 48.5) * 3 / camera.intrinsics[0, 0] + 1) / 2
    np.testing.assert_allclose(upper, red + (blue - red) * share[:, None], atol=1e-6)


@pytest.mark.parametrize("scale", [1e-5, 1e5])
def test_tiny_and_huge_worlds_have_the_same_light(gpu, ball, scale):
    """Pixels that see the same: float32 rounds other digits, so as against the twin but twice."""
    def render(s):
        rng = np.random.default_rng(17)
        roots, steps = rng.uniform(-1, 1, (60, 1, 3)), rng.normal(size=(60, 3, 3)) * 0.3
        points = np.concatenate([roots, steps], 1).cumsum(1)
        mesh = clfur.Mesh(ball.positions * s, ball.normals, faces=ball.faces)
        scene = clfur.Scene(mesh, clfur.Curves(points * s, width=0.03 * s),
                            clfur.Camera(eye=np.array([0, 0.4, 3.2]) * s, size=(97, 61)))
        return clfur.render(scene, gpu, clfur.Settings(raster="samples", samples=1), ["color", "id"])
    one, other = render(1), render(scale)
    same = one["id"] == other["id"]
    assert same.mean() > 0.998
    off = np.abs(one["color"] - other["color"]).max(2)[same]
    # A line's depth moves with the sub-pixel of its ends, and with it the place on the segment.
    assert np.quantile(off, 0.99) < 1e-3 and off.max() < 0.05
