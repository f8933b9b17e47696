"""Strands that are brought, with all that grown ones have: types, roots, bounds; and arrays that lie on a device."""

import attrs
import numpy as np
import pytest

import clfur
from clfur.cache import digest
from clfur.scene import Bounds, extent, hair_bounds
from clfur.stages.strands import upload_curves

OUTPUTS = "color", "depth", "id", "tangent", "normal", "uv", "coverage"
TYPES = clfur.HairType(alpha=.2, specular=.6, exponent=20), clfur.HairType(alpha=.9, specular=0)


def whisk(strands=60, points=5, seed=1):
    """Random bent strands about the origin, [strands, points, 3] float32."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, .12, (strands, points, 3))
    steps[:, 0] = rng.uniform(-.5, .5, (strands, 3))
    return steps.cumsum(1).astype(np.float32)


def everything(points, **changes):
    """Curves with every field that has values of its own for strands and points."""
    rng, (strands, each, _) = np.random.default_rng(2), points.shape
    normals = rng.normal(size=(strands, 3))
    fields = {"width": rng.uniform(.004, .03, (strands, each)), "color": rng.random((strands, each, 3)),
              "types": TYPES, "type_of": rng.integers(0, 2, strands), "root_uv": rng.random((strands, 2)),
              "root_normal": normals / np.linalg.norm(normals, axis=1, keepdims=True)}
    return clfur.Curves(points, **fields | changes)


def scene_of(curves, **changes):
    return clfur.Scene(fur=curves, camera=clfur.Camera(size=(61, 47), eye=(0, .3, 2.4)), **changes)


def same(one, other):
    for name, image in one.items():
        np.testing.assert_array_equal(image, other[name], err_msg=name)


def test_what_is_brought_is_on_the_device(gpu):
    curves = everything(whisk())
    there = upload_curves(gpu, curves, (7, 30))
    np.testing.assert_array_equal(there.uv.get()[:, :2], curves.root_uv[7:30])
    np.testing.assert_array_equal(there.uv.get()[:, 2], curves.type_of[7:30])
    np.testing.assert_array_equal(there.normals.get()[:, :3], curves.root_normal[7:30])
    np.testing.assert_array_equal(there.colors.get()[:, :3], curves.color[35:150])
    np.testing.assert_array_equal(there.points.get()[:, 3], curves.width[35:150])
    assert there.types.get()["shine"][:, :3].tolist() == [[np.float32(t.specular), t.exponent, np.float32(t.alpha)]
                                                          for t in TYPES]


def test_without_roots_they_are_zero(gpu):
    there = upload_curves(gpu, clfur.Curves(whisk()))
    assert not there.uv.get().any() and not there.normals.get().any() and there.color_per == 0


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_each_type_is_drawn_as_if_it_were_alone(gpu, raster):
    """With nothing between them: left of the picture one type, right the other."""
    points = whisk(40, 4) * np.float32(.4)
    sides = points - np.float32((.6, 0, 0)), points + np.float32((.6, 0, 0))
    both = clfur.Curves(np.concatenate(sides), width=.02, types=TYPES, type_of=np.repeat([0, 1], 40))
    settings = clfur.Settings(raster=raster, shadows="off")
    image = clfur.render(scene_of(both), gpu, settings)
    for kind, half, where in zip(TYPES, sides, (slice(0, 30), slice(31, 61))):
        alone = clfur.Curves(half, width=.02, specular=kind.specular, exponent=kind.exponent, alpha=kind.alpha)
        # Other bounds, and with them another near plane: depths differ in their last bits, and the light with them,
        # by 1.5e-5 (measured).
        np.testing.assert_allclose(clfur.render(scene_of(alone), gpu, settings)[:, where], image[:, where], atol=1e-4)
        assert image[:, where, 3].max() > .9


def test_a_type_shades_as_much_as_its_alpha_lets(gpu):
    """The same strands cast darker shadows as a type that lets less light through: measured, 0.893 of the light."""
    points = whisk(400, 4)
    dark, bright = (clfur.render(scene_of(clfur.Curves(points, width=.02, types=TYPES, type_of=np.full(400, kind))),
                                 gpu)[..., :3].sum() for kind in (0, 1))
    one = clfur.render(scene_of(clfur.Curves(points, width=.02, types=TYPES[:1])), gpu)
    assert dark < .93 * bright and abs(one[..., :3].sum() / dark - 1) < 1e-5


def test_types_give_the_colour_and_width_that_are_not_given():
    red, blue = clfur.HairType(color=(.9, .1, .1), width=.02), clfur.HairType(color=(.1, .1, .9), width=.01)
    of = np.arange(60) % 2
    both = clfur.Curves(whisk(), types=[red, blue], type_of=of)
    np.testing.assert_array_equal(both.color, np.float32([red.color, blue.color])[of])
    np.testing.assert_array_equal(both.width, np.float32([.02, .01])[of])
    one = clfur.Curves(whisk(), types=[red])
    assert one.width.tolist() == [np.float32(.02)] and one.color.tolist() == [np.float32(red.color).tolist()]
    given = clfur.Curves(whisk(), types=[red, blue], type_of=of, color=(1, 1, 1), width=.5)
    assert given.color.tolist() == [[1, 1, 1]] and given.width.tolist() == [.5]
    plain = clfur.Curves(whisk())
    assert plain.width.tolist() == [np.float32(.002)] and plain.color.tolist() == [np.float32((.8, .6, .4)).tolist()]
    none = clfur.Curves(np.zeros((0, 2, 3)), types=[red, blue], type_of=np.zeros(0, int))
    assert len(none.width) == len(none.color) == 1


def test_root_uv_is_told(gpu):
    out = clfur.render(scene_of(everything(whisk())), gpu, outputs=("id", "uv"))
    there = out["id"] >= 0
    assert there.sum() > 300
    np.testing.assert_array_equal(out["uv"][there], everything(whisk()).root_uv[out["id"][there]])


def test_a_root_normal_keeps_the_skins_shadow_off(gpu, sphere):
    """Hair that lies on a sphere which the light grazes is shaded by the body it lies on, unless
    that is known (measured: 2.7 % more light)."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(3000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    along = np.cross(normals, (0, 0, 1.0))
    points = (normals * 1.004)[:, None] + along[:, None] * np.array([0, .02, .04])[:, None]
    settings = clfur.Settings(shadow_map=128, grid=16, pcf=2)
    light = clfur.Light(direction=(-1, 0, .3), ambient=0)
    plain, known = (clfur.render(clfur.Scene(sphere, fur, clfur.Camera(size=(61, 47)), light, (0, 0, 0)), gpu, settings)
                    for fur in (clfur.Curves(points, width=.01, alpha=1), clfur.Curves(
                        points, width=.01, alpha=1, root_normal=normals)))
    assert known[..., :3].sum() > 1.02 * plain[..., :3].sum()


@pytest.mark.parametrize("body", [False, True])
@pytest.mark.parametrize("memory", [None, 1_500_000])
def test_arrays_on_the_device_draw_the_same_bits(gpu, another, sphere, body, memory):
    device = gpu if memory is None else another(memory)
    host = everything(whisk(3000 if memory else 60), inner=2, outer=2, surface="pn")
    placed = attrs.evolve(host, **{name: device.upload(getattr(host, name)) for name in (
        "points", "width", "color", "root_uv", "root_normal")})
    assert placed.uniform == 5 and placed.points.shape == host.points.shape
    # Those of another scheduler are brought over.
    other = attrs.evolve(placed, points=another().upload(host.points.reshape(-1, 5, 3)), counts=None)
    mesh = sphere if body else None
    settings = clfur.Settings(grid=16, shadow_map=64)
    drawn = [clfur.render(scene_of(curves, mesh=mesh), device, settings, OUTPUTS) for curves in (host, placed, other)]
    same(drawn[0], drawn[1])
    same(drawn[0], drawn[2])
    assert drawn[0]["coverage"].mean() > .05


def test_bounds_on_a_device_are_measured(gpu):
    host = clfur.Curves(whisk(), width=.02)
    placed = attrs.evolve(host, points=gpu.upload(host.points))
    assert hair_bounds(placed, 60) == hair_bounds(host, 60)
    np.testing.assert_array_equal(extent(None, placed)[0], extent(None, host)[0])


def test_what_is_kept_of_a_scene_goes_by_what_is_on_the_device(gpu):
    """Charts are kept under a hash of the scene."""
    host = clfur.Curves(whisk(), width=.02)
    placed, other = (attrs.evolve(host, points=gpu.upload(points)) for points in (host.points, host.points + 1))
    assert digest(placed) == digest(host) != digest(other)


def test_bounds_are_taken_as_given(gpu, sphere):
    given = Bounds((0, 0, 0), 1.5, 10_000, 500.0, 10.0)
    curves = clfur.Curves(whisk(), width=.02, bounds=given)
    assert extent(None, curves)[1] == 1.5 and hair_bounds(curves, 60) == (10_000, 500.0, 10.0)
    near = clfur.Curves(whisk(), bounds=Bounds((0, 0, 0), .5, 10_000, 500.0, 10.0))
    assert abs(extent(sphere, near)[1] - 1) < 1e-6      # the mesh is never outside
    wide, narrow = (clfur.render(scene_of(one), gpu, outputs=("color", "id")) for one in (
        curves, attrs.evolve(curves, bounds=None)))
    np.testing.assert_array_equal(wide["id"], narrow["id"])
    assert np.abs(wide["color"] - narrow["color"]).mean() < .01     # coarser cells of the light: measured, .001


def test_levels_tessellate_the_mesh_as_strands_do(gpu, sphere):
    curves = clfur.Curves(np.zeros((0, 2, 3)), inner=3, outer=3, surface="pn", bounds=Bounds((0, 0, 0), 1.2, 0, 0, 0))
    grown = clfur.Strands(inner=3, outer=3, types=clfur.HairType(segments=0))
    frames = [clfur.draw(scene_of(fur, mesh=sphere), gpu, outputs=("coverage", "normal")) for fur in (curves, grown)]
    assert frames[0].triangles == frames[1].triangles > 1000
    np.testing.assert_allclose(frames[0].images["coverage"], frames[1].images["coverage"], atol=1e-6)


@pytest.mark.parametrize("fields, words", [
    ({"types": TYPES}, "Curves.type_of is None but Curves.types has 2 types"),
    ({"types": TYPES, "type_of": [0, 2] + [0] * 58}, "Curves.type_of has 2; allowed: 0 to 1"),
    ({"types": TYPES, "type_of": [0, 1]}, "Curves.type_of has 2 rows; allowed: 60"),
    ({"types": TYPES, "type_of": [.5] * 60}, "Curves.type_of"),
    ({"types": [3]}, "Curves.types is"), ({"types": []}, "Curves.types has 0 types"),
    ({"root_uv": np.zeros((60, 3))}, "Curves.root_uv is"), ({"root_uv": np.zeros((59, 2))}, "59 rows; allowed: 60"),
    ({"root_normal": np.full((60, 3), np.nan)}, "Curves.root_normal[0, 0] is nan"),
    ({"bounds": (0, 1)}, "Curves.bounds is"), ({"inner": 65}, "Curves.inner is 65"),
    ({"seed": -1}, "Curves.seed is -1")])
def test_what_does_not_fit_is_refused(fields, words):
    with pytest.raises(clfur.Error) as error:
        clfur.Curves(whisk(), **fields)
    assert words in str(error.value)


@pytest.mark.parametrize("numbers, words", [
    (((0, 0), 1, 0, 0, 0), "Bounds.center"), (((0, 0, 0), -1, 0, 0, 0), "Bounds.radius is -1"),
    (((0, 0, 0), 1, .5, 0, 0), "Bounds.segments"), (((0, 0, 0), 1, 0, float("nan"), 0), "Bounds.length is nan"),
    (((0, 0, 0), 1, 0, 0, -1.0), "Bounds.area is -1.0")])
def test_bounds_are_checked(numbers, words):
    with pytest.raises(clfur.Error) as error:
        Bounds(*numbers)
    assert words in str(error.value)


def test_no_strand_on_a_device_is_no_trouble(gpu):
    empty = clfur.Curves(gpu.upload(np.zeros((0, 3), np.float32)), counts=[0, 0])
    assert not clfur.render(scene_of(empty, mesh=None), gpu).any()
    with pytest.raises(clfur.Error, match="Curves.points is on a device without a queue"):
        clfur.Curves(gpu.upload(whisk()).with_queue(None))
    with pytest.raises(clfur.Error, match="Curves.types say what strands look like"):
        clfur.Curves(whisk(), types=TYPES[:1], alpha=.1)


def test_arrays_on_a_device_must_fit_too(gpu):
    with pytest.raises(clfur.Error, match=r"Curves.points is float64 \[60, 5, 3\] on a device"):
        clfur.Curves(gpu.upload(whisk().astype(float)))
    with pytest.raises(clfur.Error, match="Curves.width is"):
        clfur.Curves(gpu.upload(whisk()), width=gpu.upload(np.ones(7, np.float32)))
    with pytest.raises(clfur.Error, match="Curves.counts is None"):
        clfur.Curves(gpu.upload(whisk().reshape(-1, 3)))


def test_as_many_points_as_strands():
    """Values are of strands where their shape says so."""
    points, counts = np.zeros((4, 3)), [2, 0, 2, 0]
    curves = clfur.Curves(points, counts, width=np.ones((4, 1)), color=np.ones((4, 1, 3)))
    assert curves.width.shape == (4,) and curves.color.shape == (4, 3)
    with pytest.raises(clfur.Error, match=r"could be per strand or per point.*or \[4, 1\] per strand"):
        clfur.Curves(points, counts, width=np.ones(4))
    again = attrs.evolve(curves, seed=3)
    np.testing.assert_array_equal(again.width, curves.width)
    assert again.color.shape == (4, 3) and attrs.evolve(again, points=points + 1).width.shape == (4,)


def test_what_stood_behind_color_goes_by_name():
    """Specular and exponent stood before alpha: by place they would be taken for it."""
    for make in (lambda: clfur.Curves(whisk(), None, .1, (1, 0, 0), 0.0),
                 lambda: clfur.HairType((.8, .6, .4), None, 8, .02, 1., .002, (0, 0), (0, 0), 0., 0., 0., .9),
                 lambda: clfur.Shells(.1, 30, 40., "cells", 1.4, 1., (.5, 8.), .3, (1, 1, 1), .3)):
        with pytest.raises(TypeError, match="positional"):
            make()


def test_levels_must_fit_the_mesh(sphere):
    with pytest.raises(clfur.Error, match="Curves.inner has levels for 3 faces"):
        clfur.Scene(sphere, clfur.Curves(whisk(), inner=[1, 2, 3]))


def test_the_truth_knows_types(gpu):
    """A picture of two types is near the truth (measured: 0.0276, the noise of 36 rays a pixel among it), and less so
    with the types swapped (0.0397)."""
    curves = clfur.Curves(whisk(40, 3), width=.03, types=TYPES, type_of=np.arange(40) % 2)
    scene = scene_of(curves, light=clfur.Light((-1, -1, -1), ambient=.3))
    truth, image = clfur.truth.picture(scene, 6), clfur.render(scene, gpu, clfur.PRESETS["reference"])
    other = clfur.render(scene_of(attrs.evolve(curves, type_of=1 - curves.type_of), light=scene.light), gpu,
                         clfur.PRESETS["reference"])
    error, swapped = (np.sqrt(((each - truth) ** 2).mean()) for each in (image, other))
    assert error < .03 and swapped > 1.3 * error
