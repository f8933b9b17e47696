"""The whole way from a scene to its picture."""

import sys

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.device import scheduler
from clfur.pipeline.views import view_of
from clfur.render import OUTPUTS
from clfur.stages.raster import raster
from clfur.stages.strands import grow, upload_curves
from clfur.stages.tessellate import tessellate

SETTINGS = clfur.Settings(raster="samples", samples=1)


@pytest.fixture(scope="module")
def scene(sphere):
    hair = clfur.HairType(segments=4, segment_length=.05, force_weight=.3, width=.004, length_variation=.3)
    return clfur.Scene(mesh=sphere, fur=clfur.Strands(inner=2, outer=3, types=hair),
                       camera=clfur.Camera(size=(97, 61)))


def seen_from(scene, **camera):
    return clfur.Scene(mesh=scene.mesh, fur=scene.fur, camera=clfur.Camera(size=scene.camera.size, **camera))


def test_two_runs_and_a_kept_scheduler_give_the_same_bits(gpu, scene):
    first = clfur.render(scene, gpu, SETTINGS, outputs=tuple(OUTPUTS))
    kept = clfur.render(scene, gpu, SETTINGS, outputs=tuple(OUTPUTS))
    gpu.forget()
    anew = clfur.render(scene, gpu, SETTINGS, outputs=tuple(OUTPUTS))
    for name in OUTPUTS:
        assert first[name].tobytes() == kept[name].tobytes() == anew[name].tobytes(), name


@pytest.mark.parametrize("samples", [1, 4])
def test_every_device_sees_the_same_bits(gpu, another, scene, samples):
    hair = clfur.HairType(segments=9, segment_length=.03, width=.004, curl=(.02, 2), wave=(.01, 3), force_weight=.3,
                          length_variation=.3, direction_variation=.4)
    fur = clfur.Strands(inner=4, outer=3, types=hair, force=(.1, -1, 0), point_forces=clfur.PointForce((1, 1, 1), 2),
                        roots=7001)
    curly = clfur.Scene(mesh=scene.mesh, fur=fur, camera=clfur.Camera(eye=(.3, .9, 1.6), size=(641, 479)))
    narrow = another(int64_atomics=False)
    for scene in curly, crossed():
        first, *others = (visible_of(scene, on, samples) for on in (gpu, narrow, clfur.Scheduler()))
        for other in others:
            np.testing.assert_array_equal(first, other)


def crossed():
    """A triangle larger than the picture, behind the eye too, and strands from thin to wide through it.

    The widest covers some 20,000 samples: Mesa's llvmpipe ends a work-item's loops after 65,535 steps, silently.
    """
    mesh = clfur.Mesh([(-9, -3, 4), (9, -3, 4), (0, 6, -9)], faces=[(0, 1, 2)])
    points = np.random.default_rng(3).uniform(-2, 2, (40, 3, 3))
    return clfur.Scene(mesh=mesh, fur=clfur.Curves(points, width=np.linspace(0, .01, 40)),
                       camera=clfur.Camera(size=(641, 479)))


def visible_of(scene, gpu, samples):
    """The raster's result, read back: [height, width, samples] uint64."""
    fur = scene.fur
    if isinstance(fur, clfur.Curves):
        body, strands = tessellate(gpu, scene.mesh, surface="flat"), upload_curves(gpu, fur)
    else:
        body = tessellate(gpu, scene.mesh, fur.inner, fur.outer, fur.surface)
        strands = grow(gpu, body, fur)
    return raster(gpu, view_of(scene, samples), strands, body).get()


@pytest.mark.small
@pytest.mark.parametrize("method, light, roots", [
    ("length", {"position": (1, 2, 2), "direction": (-1, -2, -2), "angle": 60}, 90),
    ("trilinear", {"direction": (-1, -.4, -.5)}, "faces")])
def test_a_frame_with_everything_in_it(gpu, another, method, light, roots):
    """Every stage and every output, also without 64-bit atomics: the same bits."""
    positions, faces = icosphere(1)
    mesh = clfur.Mesh(positions, positions, np.abs(positions[faces][..., :2]), faces)
    texture = np.linspace(0, 1, 60, dtype=np.float32).reshape(5, 4, 3)
    types = [clfur.HairType(segments=5, segment_length=.06, width=.02, curl=(.02, 1), length_variation=.5,
                            color_texture=texture, key=(0, 0, 0)),
             clfur.HairType(segments=2, segment_length=.1, width=.03, alpha=.5, key=(9, 9, 9))]
    fur = clfur.Strands(inner=1, outer=1, types=types, type_map=np.array([[(0, 0, 0), (9, 9, 9)]], np.uint8),
                        roots=roots, force=(0, -1, 0), point_forces=clfur.PointForce((1, 1, 1), 1))
    scene = clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(size=(21, 17)), light=clfur.Light(**light))
    settings = clfur.Settings(raster="samples", samples=4, shadows=method, grid=16, shadow_map=32)
    narrow = another(int64_atomics=False)
    one, other = (clfur.render(scene, on, settings, outputs=tuple(OUTPUTS)) for on in (gpu, narrow))
    assert {-2, -1} < set(np.unique(one["id"]))
    for name in OUTPUTS:
        assert one[name].tobytes() == other[name].tobytes(), name


def test_a_picture_of_fur(gpu, scene):
    out = clfur.render(scene, gpu, SETTINGS, outputs=("color", "id", "depth", "coverage"))
    color, who, depth = out["color"], out["id"], out["depth"]
    assert color.shape == (61, 97, 4) and color.dtype == np.float32 and np.isfinite(color).all()
    assert (who >= 0).sum() > (who == -2).sum() > 0          # fur, with skin between
    assert who.max() < 320 * 13                              # levels 2 and 3 make 9 triangles a face
    np.testing.assert_array_equal(color[..., 3] > 0, who != -1)
    np.testing.assert_array_equal(np.isinf(depth), who == -1)
    assert depth[who != -1].min() > 3.2 - 1.3                # the eye is 3.22 from the centre, hair reaches 1.26
    corners = color[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert not corners.any()


def test_the_frame_tells_what_was_drawn(gpu, scene):
    frame = clfur.draw(scene, gpu, SETTINGS)
    assert frame.triangles == frame.strands == 320 * 9
    assert frame.segments == 4 * frame.strands
    assert set(frame.stages) == {"tessellate", "strands", "raster", "voxelize", "zscan", "shadow_map", "shade"}
    assert min(frame.stages.values()) > 0
    assert frame.seconds > 0 and frame.device


def test_only_raster_and_shade_run_again_for_a_new_camera(gpu, scene):
    clfur.draw(scene, gpu, SETTINGS)
    frame = clfur.draw(seen_from(scene, eye=(1, 1, 3)), gpu, SETTINGS)
    assert set(frame.stages) == {"raster", "shade"}
    gpu.forget()
    anew = clfur.render(seen_from(scene, eye=(1, 1, 3)), gpu, SETTINGS)
    assert frame.images["color"].tobytes() == anew.tobytes()


@pytest.mark.parametrize("mesh, fur, body", [
    (True, False, True),     # no hair
    (True, True, False),     # hair alone, grown on a body that isn't drawn
    (False, "curves", True),
    (True, "curves", True),
    (True, "none", True),    # no strands at all
])
def test_a_scene_pays_for_what_it_holds(gpu, sphere, mesh, fur, body):
    points = np.random.default_rng(1).uniform(-1, 1, (50, 3, 3))
    fur = {False: None, True: clfur.Strands(inner=1, outer=1), "curves": clfur.Curves(points, width=.01),
           "none": clfur.Strands(roots=0)}[fur]
    frame = clfur.draw(clfur.Scene(mesh=sphere if mesh else None, fur=fur, body_color=(.3, .2, .1) if body else None),
                       gpu, SETTINGS, outputs=tuple(OUTPUTS))
    who = frame.images["id"]
    assert (who == -2).any() == bool(mesh and body)
    assert (who >= 0).any() == (frame.strands > 0)
    assert np.isfinite(frame.images["color"]).all()


def test_a_light_that_is_out_casts_no_shadows(gpu, scene):
    """And the picture is what it is with shadows: ambient light has none."""
    dark = clfur.Scene(mesh=scene.mesh, fur=scene.fur, camera=scene.camera,
                       light=clfur.Light(color=(0, 0, 0), ambient=.3))
    frame = clfur.draw(dark, gpu, SETTINGS)
    assert not {"voxelize", "zscan", "shadow_map"} & set(frame.stages)
    dim = clfur.Scene(mesh=scene.mesh, fur=scene.fur, camera=scene.camera,
                      light=clfur.Light(color=(0, 0, 1e-30), ambient=.3))
    frame_dim = clfur.draw(dim, gpu, SETTINGS)
    assert "voxelize" in frame_dim.stages
    assert np.array_equal(frame.images["color"], frame_dim.images["color"]) and frame.images["color"].any()


def test_a_calibrated_camera_draws_the_same(gpu, scene):
    camera = scene.camera
    again = clfur.Scene(mesh=scene.mesh, fur=scene.fur,
                        camera=clfur.Camera.calibrated(camera.pose, camera.intrinsics, camera.size))
    assert clfur.render(scene, gpu, SETTINGS).tobytes() == clfur.render(again, gpu, SETTINGS).tobytes()


def test_a_shifted_principal_point_shifts_the_picture(gpu, scene):
    camera = scene.camera
    intrinsics = camera.intrinsics.copy()
    intrinsics[0, 2] += 7
    shifted = clfur.Scene(mesh=scene.mesh, fur=scene.fur,
                          camera=clfur.Camera.calibrated(camera.pose, intrinsics, camera.size))
    a = clfur.render(scene, gpu, SETTINGS, outputs=("id",))["id"]
    b = clfur.render(shifted, gpu, SETTINGS, outputs=("id",))["id"]
    # Sums with another cx round differently: a point may snap one sub-pixel aside.
    assert (a[:, :-7] != b[:, 7:]).mean() < 0.01


def test_the_view_projects_as_a_camera_should(scene):
    view = view_of(seen_from(scene, eye=(0, 0, 3), target=(0, 0, 0), fov=90), 1)
    def project(p):
        x, y, e, w = view["to_screen"].T @ [*p, 1]
        return np.array([x, y, e]) / w
    np.testing.assert_allclose(project((0, 0, 0))[:2], (48.5, 30.5), atol=1e-5)
    np.testing.assert_allclose(project((0, 3, 0))[:2], (48.5, 0), atol=1e-5)        # +Y is up, rows run down
    np.testing.assert_allclose(project((3, 0, 0))[:2], (48.5 + 30.5, 30.5), atol=1e-5)
    assert project((0, 0, 1))[2] > project((0, 0, 0))[2] > project((0, 0, -9))[2] > 0   # depth is reversed
    for p in [(0, 0, 0), (.5, -.3, .2), (2, 2, -5)]:
        x, y, e = project(p)
        q = view["to_world"].T @ [x, y, e, 1]
        np.testing.assert_allclose(q[:3] / q[3], p, atol=1e-5)


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_the_size_of_the_world_does_not_matter(gpu, scene, scale):
    hair = scene.fur.types[0]
    grown = clfur.Strands(inner=2, outer=3, types=clfur.HairType(
        segments=hair.segments, segment_length=hair.segment_length * scale, force_weight=hair.force_weight,
        width=hair.width * scale, length_variation=hair.length_variation))
    mesh = clfur.Mesh(scene.mesh.positions * scale, scene.mesh.normals, scene.mesh.uv, scene.mesh.faces)
    other = clfur.Scene(mesh=mesh, fur=grown, camera=clfur.Camera(eye=scene.camera.eye * scale, size=(97, 61)))
    a = clfur.render(scene, gpu, SETTINGS, outputs=("id",))["id"]
    b = clfur.render(other, gpu, SETTINGS, outputs=("id",))["id"]
    # Sizes that are no powers of two round differently: a strand may snap one sub-pixel aside.
    assert (a != b).mean() < 0.02


def test_frames_of_ever_new_sizes_do_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr(scheduler, "SPARE", 1 << 20)
    gpu = clfur.Scheduler()
    for n in np.random.default_rng(4).integers(1, 20_000, 30):
        fur = clfur.Curves(np.zeros((n, 9, 3), np.float32))
        clfur.render(clfur.Scene(fur=fur, camera=clfur.Camera(size=(97, 61))), gpu, SETTINGS)
    gpu.forget()
    held = gpu._pool.managed_bytes
    gpu.start()
    assert gpu._pool.managed_bytes <= 2 * gpu._pool.active_bytes + scheduler.SPARE < held


def test_calls_without_a_scheduler_share_one(scene):
    clfur.render(scene, settings=SETTINGS)
    mine = sys.modules["clfur.render"]._here.schedulers   # clfur.render is the function
    before = dict(mine)
    clfur.render(scene, settings=SETTINGS)
    assert before and mine == before


@pytest.mark.parametrize("scale", [1e-7, 1e10])
def test_worlds_beyond_float32_are_refused(sphere, scale):
    with pytest.raises(clfur.Error, match="allowed: 2e-06 to 2e"):
        clfur.Scene(mesh=clfur.Mesh(sphere.positions.astype(float) * scale, sphere.normals, faces=sphere.faces))


def test_bad_arguments_are_named(gpu, scene):
    for bad in (5, ["color", 3], [["color"]]):
        with pytest.raises(clfur.Error, match="no output"):
            clfur.render(scene, gpu, outputs=bad)
    with pytest.raises(clfur.Error, match="allowed: a clfur.Settings"):
        clfur.render(scene, gpu, settings=4)
    with pytest.raises(clfur.Error, match="no output 'colour'; allowed: color, depth"):
        clfur.render(scene, gpu, outputs=("colour",))
    with pytest.raises(clfur.Error, match="allowed: a clfur.Scene"):
        clfur.render(scene.mesh, gpu)
    with pytest.raises(clfur.Error, match="no OpenCL device matches 'nosuch'"):
        clfur.render(scene, "nosuch")
    with pytest.raises(clfur.Error, match="samples"):
        clfur.Settings(samples=2)


def test_a_picture_too_large_for_the_device_is_refused(another, sphere):
    scene = clfur.Scene(mesh=sphere, camera=clfur.Camera(size=(16384, 480)))
    small = another(4 << 20)
    with pytest.raises(clfur.Error, match="4.0 MiB has no room for .*Settings.grid 96, .* a row of 16384 pixels"):
        clfur.render(scene, small, clfur.Settings(raster="samples", samples=16))


@pytest.mark.parametrize("change", [{"pcf": 4}, {"body_color": None}])
def test_light_that_is_kept_goes_by_all_that_it_depends_on(gpu, sphere, change):
    """A kept Scheduler draws what a fresh one does after a change of the filter, or of whether there is a body."""
    scene = clfur.Scene(sphere, clfur.Strands(inner=1, outer=1, types=clfur.HairType(segment_length=.05)),
                        clfur.Camera(size=(48, 36)))
    settings = clfur.Settings(grid=16, shadow_map=64)
    clfur.render(scene, gpu, settings)
    scene = attrs.evolve(scene, **{k: v for k, v in change.items() if k == "body_color"})
    settings = attrs.evolve(settings, **{k: v for k, v in change.items() if k == "pcf"})
    kept = clfur.render(scene, gpu, settings)
    gpu.forget()
    np.testing.assert_array_equal(kept, clfur.render(scene, gpu, settings))
