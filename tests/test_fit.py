"""What the near plane and the lights' grids and maps are fitted to: what is seen, and nothing else."""

import itertools
import warnings

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.pipeline.shadows import plan_shadows
from clfur.pipeline.views import Rig, view_of
from clfur.scene import extent
from clfur.scene.seen import PIECE, seen, times

SUN = clfur.Light(direction=(-1, -2, -.5))
SPOT = clfur.Light(direction=(-1, -1, -1), position=(2, 2.5, 2.2), angle=70, color=(.5, .4, .9))
CAMERA = clfur.Camera((.3, .7, 3), (0, 0, 0), size=(64, 48))
SETTINGS = clfur.Settings(samples=4, grid=64, shadow_map=256)
OUTPUTS = "color", "depth", "coverage"


def hairs(n=500, scale=1.0, at=(0, 0, 0), seed=1):
    """Points [n, 4, 3] of strands around a ball."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n, 3))
    root /= np.linalg.norm(root, axis=1)[:, None]
    points = root[:, None] * (1 + .06 * np.arange(4)[None, :, None]) + random.normal(size=(n, 4, 3)) * .01
    return scale * points + at


def curves(*points, width=.02):
    return clfur.Curves(np.concatenate(points), width=width, color=(.8, .5, .2))


def ball(scale=1.0, at=(0, 0, 0)):
    positions, faces = icosphere(2)
    return scale * positions + at, faces


def ground(half, height, n=1, rough=0.0):
    """A level square of 2 n² faces; ``rough``: how uneven."""
    line = np.linspace(-half, half, n + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    y = height + rough * np.random.default_rng(0).normal(size=x.shape)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + n + 1], 1), np.stack([a + 1, a + n + 2, a + n + 1], 1)])
    return np.stack([x, y, z], 2).reshape(-1, 3), faces


def joined(*parts):
    """Meshes (positions, faces) as one."""
    before = np.cumsum([0] + [len(positions) for positions, _ in parts])
    return clfur.Mesh(np.concatenate([positions for positions, _ in parts]),
                      faces=np.concatenate([faces + first for (_, faces), first in zip(parts, before)]))


def rms(a, b):
    return float(np.sqrt(((a.astype(float) - b) ** 2).mean()))


def around(camera, times):
    """The camera's picture with so many times as much around it, and where in it that is."""
    (width, height), k = camera.size, camera.intrinsics.copy()
    k[:2, 2] += (times - 1) / 2 * np.array([width, height])
    whole = clfur.Camera.calibrated(camera.pose, k, (times * width, times * height))
    return whole, (slice((times - 1) // 2 * height, (times + 1) // 2 * height),
                   slice((times - 1) // 2 * width, (times + 1) // 2 * width))


UNSEEN = {
    "behind": hairs(200, .5, (0, 3, 30), 2),
    "aside": hairs(200, .5, (40, 0, -2), 3),
    "far aside": hairs(200, 1, (-1e4, 0, 0), 4),
    "a stray": np.array([[[1e4, .1 * k, 0] for k in range(4)]]),
    "a long stray": np.array([[[1e4, 1e3 * k, 0] for k in range(4)]]),
}


@pytest.mark.parametrize("raster", ["coverage", "samples"])
@pytest.mark.parametrize("skin", [True, False])
def test_strands_that_cannot_be_seen_change_no_bit(gpu, skin, raster):
    mesh, settings = joined(ball()) if skin else None, attrs.evolve(SETTINGS, raster=raster)
    scene = clfur.Scene(mesh, curves(hairs()), CAMERA, [SUN, SPOT])
    alone = clfur.render(scene, gpu, settings, OUTPUTS)
    for name, points in UNSEEN.items():
        more = clfur.render(attrs.evolve(scene, fur=curves(hairs(), points)), gpu, settings, OUTPUTS)
        for output in OUTPUTS:
            np.testing.assert_array_equal(more[output], alone[output], f"{name}: {output}")


@pytest.mark.parametrize("raster", ["coverage", "samples"])
@pytest.mark.parametrize("skin", [True, False])
def test_nor_do_they_where_what_is_seen_is_cropped(gpu, skin, raster):
    mesh, settings = joined(ball()) if skin else None, attrs.evolve(SETTINGS, raster=raster)
    random = np.random.default_rng(3)
    for _ in range(8):
        camera = clfur.Camera(eye=random.uniform((-.9, -.5, .3), (.9, .5, 2.1)), target=random.uniform(-.3, .3, 3),
                              fov=random.uniform(20, 60), size=(64, 48))
        scene = clfur.Scene(mesh, curves(hairs()), camera, [SUN, SPOT])
        alone = clfur.render(scene, gpu, settings, OUTPUTS)
        behind = camera.pose[:3, 3] + 50 * camera.pose[:3, 2] + np.array([[[0, .1 * k, 0] for k in range(4)]])
        more = clfur.render(attrs.evolve(scene, fur=curves(hairs(), behind)), gpu, settings, OUTPUTS)
        for output in OUTPUTS:
            np.testing.assert_array_equal(more[output], alone[output], output)


def test_strands_without_points_count_as_they_do_where_all_are_seen():
    """The widest has no points; another strand lies far behind the camera."""
    points = hairs(50).reshape(-1, 3)
    counts, width = np.append(np.full(50, 4), 0), np.append(np.full(50, .02), .5)
    alone = clfur.Scene(None, clfur.Curves(points, counts=counts, width=width[:, None]), CAMERA, SUN)
    more = attrs.evolve(alone, fur=clfur.Curves(np.concatenate([points, UNSEEN["behind"][0]]),
                                                counts=np.append(counts, 4), width=np.append(width, .02)[:, None]))
    (center, radius), (other, another) = seen(alone).ball, seen(more).ball
    assert (center == other).all() and radius == another and near_of(alone) == near_of(more)


def test_what_stands_compact_before_the_camera_is_fitted_as_a_ball():
    for mesh, fur in [(joined(ball()), curves(hairs())), (joined(ball()), clfur.Strands(inner=1, outer=1)),
                      (None, curves(hairs())), (joined(ball()), clfur.Shells())]:
        rig = Rig.of(clfur.Scene(mesh, fur, CAMERA, SUN), SETTINGS)
        center, radius = extent(mesh, fur)
        assert not rig.fit.seen.cropped and rig.radius == radius and (rig.center == center).all()
        assert rig.grids[0]["face"][1] == pytest.approx(2 * 1.001 * radius / 64, rel=1e-6)
        distance = np.linalg.norm(CAMERA.eye - center)
        assert rig.view["to_screen"][3, 2] == pytest.approx(distance - 1.01 * radius, rel=1e-4)


@pytest.mark.parametrize("light", [SUN, SPOT], ids=["sun", "spot"])
@pytest.mark.parametrize("furry", [True, False])
def test_a_large_ground_takes_nothing(gpu, furry, light):
    """Shadows on a ground of half side 1,500 are as sharp as on one of half side 3, and nothing is cut off."""
    pictures = []
    camera = clfur.Camera((.5, .7, 2.4), (0, -.3, 0), size=(64, 48))
    for half, n in ((3, 1), (1500, 1), (1500, 6)):
        mesh = joined(ball(.5), ground(half, -.55, n))
        scene = clfur.Scene(mesh, curves(hairs(scale=.5)) if furry else None, camera, light)
        pictures.append(clfur.render(scene, gpu, SETTINGS, ("color", "depth")))
    near = (pictures[0]["depth"] < 4) & (pictures[0]["color"][..., 3] == 1)        # the small ground ends
    assert near.mean() > .4
    for large in pictures[1:]:
        assert np.abs(large["depth"] - pictures[0]["depth"])[near].max() < 1e-3   # ends are snapped to 1/256 pixel
        assert rms(large["color"][near], pictures[0]["color"][near]) < .002


def test_fur_into_the_distance_is_told(gpu):
    """One grid for all of it has cells wider than hair is long: no shadows without a word."""
    camera = clfur.Camera((.5, .7, 2.4), (0, -.3, 0), size=(64, 48))
    fur = clfur.Strands(roots=500, types=[clfur.HairType(segments=4, segment_length=.05, width=.01)])
    for half, told in ((1, 0), (1500, 1)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            clfur.render(clfur.Scene(joined(ball(.5), ground(half, -.55, 1)), fur, camera, SUN), gpu, SETTINGS)
        assert len(caught) == told and all("cells of the light's grid are" in str(each.message) for each in caught)


def test_faces_with_more_shells_than_they_hold_are_told(gpu):
    """4096 on the root of the area, which is 2 here: 2896 a unit."""
    camera = clfur.Camera((0, 3, 0), (0, 0, 0), up=(0, 0, 1), size=(16, 12))
    for half, frequency, told in ((1, 40, 0), (1, 2800, 0), (1, 2950, 1), (1, 29500, 1)):
        mesh = joined(ground(half, 0, 1))
        for rest in (None, mesh):
            scene = clfur.Scene(mesh, clfur.Shells(length=.05, frequency=frequency, rest=rest), camera, SUN)
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                clfur.render(scene, gpu, SETTINGS)
            assert len(caught) == told and all("hairs of shells along a side" in str(each.message) for each in caught)


def test_a_bald_ground_takes_nothing_either(gpu):
    """Strands grow on the ball alone, by their map: the other half of it is of the ground."""
    hair = clfur.HairType(segments=4, segment_length=.05, width=.01, key=(255, 0, 0))
    bald = clfur.HairType(segments=0, key=(0, 0, 0))
    fur = clfur.Strands(inner=1, outer=1, types=[hair, bald], type_map=np.array([[(255, 0, 0), (0, 0, 0)]], np.uint8))
    camera, halves = clfur.Camera((.5, .7, 2.4), (0, -.3, 0), size=(32, 24)), []
    for half in (3, 1500):
        parts = ball(.5), ground(half, -.7)
        uv = np.repeat([(.2, .5), (.8, .5)], [len(faces) for _, faces in parts], 0)[:, None] + np.zeros((1, 3, 1))
        mesh = joined(*parts)
        scene = clfur.Scene(clfur.Mesh(mesh.positions, faces=mesh.faces, uv=uv), fur, camera, SUN)
        halves.append(32 * float(Rig.of(scene, SETTINGS).grids[0]["face"][1]))
        assert clfur.draw(scene, gpu, SETTINGS).strands == len(parts[0][1])
    assert halves[1] <= halves[0] < 2


def test_hair_that_is_too_much_for_small_cells_is_counted_in_large_ones(gpu):
    """So near that the cells that fit what is seen would need counters of more than 32 bits."""
    hair = clfur.HairType(segments=8, segment_length=.005, width=.1)
    fur = clfur.Strands(roots=10**6, inner=1, outer=1, types=[hair])
    mesh = joined(ground(1, 0, 40))
    settings = clfur.Settings(grid=256)
    camera = clfur.Camera((0, .5, 0), (0, 0, 0), up=(0, 0, 1), size=(8, 8), fov=1)
    rig = Rig.of(clfur.Scene(mesh, fur, camera, SUN), settings)
    plan, = plan_shadows(rig, 10**6, True)
    assert rig.grids[0]["face"][1] < .5 * plan.grid["face"][1] and plan.crossing_unit >= 4


def test_a_large_ground_errs_no_more_than_a_small_one(gpu):
    camera = clfur.Camera((.5, .7, 2.4), (0, -.3, 0), size=(40, 30))
    errors, near = [], None
    for half in (3, 1500):
        scene = clfur.Scene(joined(ball(.5), ground(half, -.55)), curves(hairs(200, .5)), camera, SUN)
        image, truth = clfur.render(scene, gpu, SETTINGS), clfur.truth.picture(scene, samples=3)
        near = clfur.render(scene, gpu, SETTINGS, "depth")["depth"] < 4 if near is None else near
        errors.append(rms(image[near], truth[near]))
    assert errors[1] < 1.1 * errors[0]


@pytest.mark.parametrize("light", [clfur.Light(direction=(-1.5, -2.8, -1)),
                                   clfur.Light(direction=(-1.5, -2.8, -1), position=(2.2, 3.4, 1.6), angle=60)],
                         ids=["sun", "spot"])
@pytest.mark.parametrize("caster", ["hair", "body"])
def test_what_is_out_of_sight_still_shades(gpu, caster, light):
    """High above a rough ground, of which the camera sees a little: the picture is the middle of one that shows all."""
    camera = clfur.Camera((.4, .6, .8), (0, -.8, 0), size=(40, 30))
    parts = [ground(6, -1, 24, .03), ball(.2, (0, -.8, 0))]
    above = curves(hairs(2000, .25, (1.5, 2, 1)), width=.01)
    lit = clfur.Scene(joined(*parts), None, camera, light)
    scene = attrs.evolve(lit, fur=above) if caster == "hair" else attrs.evolve(
        lit, mesh=joined(*parts, ball(.3, (1.5, 2, 1))))
    settings = attrs.evolve(SETTINGS, grid=128, shadow_map=512)
    fit = Rig.of(scene, settings).fit
    assert fit.seen.cropped
    if light.position is None:
        assert Rig.of(scene, settings).grids[0]["face"][1] * 128 < .7 * 2 * extent(scene.mesh, scene.fur)[1]
    whole, middle = around(camera, 9)
    image = clfur.render(scene, gpu, settings)
    expected = clfur.render(attrs.evolve(scene, camera=whole), gpu, settings)[middle]
    without = rms(clfur.render(lit, gpu, settings), expected)
    assert without > .02 and rms(image, expected) < .5 * without   # whose cells are larger


def test_a_shadow_far_below_what_casts_it_is_as_it_is_near(gpu):
    """The ground lies many times as deep as the map: where nothing stands before the light, it is lit."""
    sun, far = clfur.Light(direction=(.6, -1, .001), ambient=0), 16.0
    for height in (4, far):
        camera = clfur.Camera((.6 * height, far + 5, .01), (.6 * height, -height, 0), up=(0, 0, 1), size=(96, 72))
        scene = clfur.Scene(joined(ball(), ground(3000, -height)), None, camera, sun)
        assert height < far or (Rig.of(scene, SETTINGS).light_views[0]["to_screen"].astype(float).T
                                @ (0, -height, 0, 1))[2] < -3
        lit = clfur.render(scene, gpu, attrs.evolve(SETTINGS, shadow_map=0))[..., 0]
        at = clfur.render(scene, gpu, SETTINGS, "depth")["depth"] > far + 7   # the ground
        dark = 1 - clfur.render(scene, gpu, SETTINGS)[at, 0] / lit[at]
        pixel = (height + far + 5) / scene.camera.intrinsics[0, 0]
        assert dark.sum() * pixel**2 == pytest.approx(np.pi * np.hypot(1, .6), rel=.05)   # an ellipse


def test_a_fit_that_follows_the_camera_keeps_its_size_and_its_cells():
    """Steps of a panning camera: the cells stay at the same places of the world, of a few sizes."""
    mesh = joined(ground(20, -1, 40, .03))
    sizes, shifts = set(), []
    for at in np.linspace(0, 1, 21):
        camera = clfur.Camera((at, 1, 2), (at, -1, 0), size=(64, 48), fov=40)
        grid = Rig.of(clfur.Scene(mesh, None, camera, SUN), SETTINGS).grids[0]
        sizes.add(float(grid["face"][1]))
        shifts.append(grid["to_grid"].astype(float)[3, :3])
    assert len(sizes) <= 2 and max(sizes) < .5 * 2 * extent(mesh, None)[1] / 64
    if len(sizes) == 1:
        off = np.array(shifts) - np.array(shifts)[0]
        np.testing.assert_allclose(off, np.rint(off), atol=1e-3)
        assert np.abs(off).max() >= 1


def test_the_kept_light_stays_while_the_camera_moves_around(gpu):
    """It goes by the fit: a compact scene keeps its light, a cropped one whose fit changes has it anew."""
    launched = []
    launch = gpu.launch

    def count(name, *args, **given):
        launched.append(name)
        return launch(name, *args, **given)

    gpu.forget()
    fur = curves(hairs())
    mesh = joined(ball())
    gpu.launch = count
    try:
        for angle in np.linspace(0, 2, 4):
            camera = clfur.Camera((3 * np.sin(angle), .7, 3 * np.cos(angle)), size=(32, 24))
            clfur.render(clfur.Scene(mesh, fur, camera, SUN), gpu, SETTINGS)
        assert launched.count("voxelize.lengths") == 1
        scene = clfur.Scene(joined(ground(30, -1, 40, .03)), fur, CAMERA, SUN)
        for x in (0, 12, 12):
            camera = clfur.Camera((x, 1, 2), (x, -1, 0), size=(32, 24))
            clfur.render(attrs.evolve(scene, camera=camera), gpu, SETTINGS)
        assert launched.count("voxelize.lengths") == 3
    finally:
        del gpu.launch


# --- the near plane ----------------------------------------------------------------------------------------


def near_of(scene):
    return float(view_of(scene, 1)["to_screen"][3, 2])


def test_the_near_plane_goes_by_what_is_seen():
    camera = clfur.Camera((0, 0, 3), (0, 0, 0), size=(64, 48))
    stray = hairs(400)
    stray[7, 2] = 1e4, 0, 0                 # one point of a strand that begins before the camera
    assert 1.4 < near_of(clfur.Scene(None, curves(stray), camera)) < 1.95
    large = joined(ball(), ground(1500, -1.2))
    assert .9 < near_of(clfur.Scene(large, None, camera)) <= 1.5
    within = clfur.Camera((0, 0, 1.05), (0, 0, 0), size=(64, 48))     # among the hair on a large ground
    for fur, least in ((clfur.Strands(types=[clfur.HairType(segments=5, segment_length=.1)]), 1e-3), (None, .04)):
        assert least < near_of(clfur.Scene(large, fur, within)) < .06


def test_what_lies_behind_a_near_camera_cuts_nothing_off(gpu):
    """Two hundredths of a ball's radius before its skin, far from the ends of a large triangle behind the camera."""
    behind = np.array([(-4000, 0, 1e4), (4000, 0, 1e4), (0, 4000, 1e4)]), np.array([[0, 1, 2]])
    hair = clfur.HairType(segments=8, segment_length=.05, width=.001)
    for fur in None, clfur.Strands(inner=1, outer=1, surface="flat", types=[hair]):
        for z in (1.02, .98):       # before the skin, and behind it
            camera = clfur.Camera((0, 0, z), (0, .1, 0), size=(32, 24))
            alone, more = (clfur.Scene(joined(*parts), fur, camera) for parts in ([ball()], [ball(), behind]))
            assert z < 1 or near_of(more) <= .02
            one, other = (clfur.render(scene, gpu, SETTINGS, ("depth", "coverage")) for scene in (alone, more))
            np.testing.assert_array_equal(one["coverage"], other["coverage"])
            assert np.quantile(np.abs(one["depth"] - other["depth"]) / one["depth"], .98) < 1e-3


def test_grown_strands_drawn_as_curves_are_seen_as_near(gpu):
    """They have bounds, of the large ground too, and are on the host."""
    hair = clfur.HairType(segments=6, segment_length=.06, width=.01)
    scene = clfur.Scene(joined(ball(), ground(1500, -1.3)), clfur.Strands(inner=5, outer=5, types=[hair]),
                        clfur.Camera((0, .1, 1.25), (0, 0, 0), size=(32, 24)), SUN)
    curved = attrs.evolve(scene, fur=clfur.grow(scene, gpu))
    one, other = (clfur.render(each, gpu, SETTINGS, ("depth", "coverage", "color")) for each in (scene, curved))
    assert rms(one["coverage"], other["coverage"]) < 1e-3
    assert (np.abs(one["depth"] - other["depth"]) > 1e-3).mean() < .01
    assert rms(one["color"], other["color"]) < .05      # cells of the light are smaller


def test_curves_on_a_device_with_bounds_are_not_read_back(gpu, monkeypatch):
    import pyopencl.array as cla

    fur = curves(hairs())
    bounds = clfur.scene.Bounds(*extent(None, fur), 2000, 500, 10)
    places = gpu.upload(fur.points.reshape(-1, 4, 3))
    placed = clfur.Curves(places, width=.02, color=(.8, .5, .2), bounds=bounds)
    mesh = joined(ball(), ground(1500, -1.3))
    monkeypatch.setattr(cla.Array, "get", None)
    for eye in (.3, .7, 3), (.3, .1, 1.1):
        scene = clfur.Scene(mesh, placed, clfur.Camera(eye, size=(32, 24)), SUN)
        assert near_of(scene) < 2 and Rig.of(scene, SETTINGS).fit.seen.cropped


def test_nothing_that_is_seen_is_cut_off():
    """Random scenes and cameras: no point of a face or strand in the picture lies before the near plane, unless nearer
    than the least distance."""
    random = np.random.default_rng(5)
    for _ in range(60):
        large = 10 ** random.uniform(0, 4)
        points = random.normal(size=(30, 4, 3)) * random.choice([.3, 1, large], (30, 1, 1))
        mesh = joined(ground(large, -random.uniform(.3, 2))) if random.random() < .7 else None
        camera = clfur.Camera(random.normal(size=3) + (0, .5, 0), random.normal(size=3), size=(64, 48),
                              fov=random.uniform(10, 120))
        scene = clfur.Scene(mesh, curves(points, width=1e-4), camera)
        near = near_of(scene)
        share = np.linspace(0, 1, 200)[:, None]
        there = [a + share * (b - a) for strand in points for a, b in itertools.pairwise(strand)]
        if mesh is not None:
            a, b, c = mesh.positions[mesh.faces[0]].astype(float)
            u, v = np.sort(random.random((2, 20000)) ** 3, 0)[..., None]
            there.append(a + u * (b - a) + v * (c - b))
        places = np.column_stack([np.concatenate(there), np.ones(sum(map(len, there)))])
        x, y, _, w = (places @ view_of(scene, 1)["to_screen"].astype(float)).T
        seen_at = (w > 0) & (np.abs(x / w - 32) < 32) & (np.abs(y / w - 24) < 24)
        least = 1e-5 * extent(mesh, scene.fur)[1]
        assert not (seen_at & (w < near * (1 - 1e-6)) & (w > least)).any()
        assert near > 0 and np.isfinite(near)
        assert seen(scene).near == pytest.approx(near, rel=1e-6)


def test_the_ball_holds_all_points_of_the_curves_that_are_seen():
    """Found from their boxes: the furthest point is not always in the box whose middle is furthest."""
    corner = 1 + np.concatenate([np.zeros((1, 3)), np.eye(3)])          # its box's middle is further than its points
    heap = np.full((1, 4, 3), 2.5 / 3**.5) - 1e-3 * np.arange(4)[None, :, None]
    points = np.concatenate([corner[None], -corner[None], heap])
    camera = clfur.Camera((0, 0, 12), size=(64, 48))
    center, radius = seen(clfur.Scene(None, curves(points, UNSEEN["aside"]), camera)).ball
    expected, reach = extent(None, curves(points))
    np.testing.assert_array_equal(center, expected)
    assert radius == reach == pytest.approx(2.51)


@pytest.mark.parametrize("shape", [(0, 3), (1, 3), (PIECE - 1, 3), (PIECE, 3), (2 * PIECE + 7, 3), (PIECE, 3, 3)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_points_are_multiplied_in_pieces(shape, dtype):
    rng = np.random.default_rng(1)
    points = rng.normal(size=shape).astype(dtype)
    for matrix in rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(5, 3)).T:
        np.testing.assert_allclose(times(points, matrix), points.astype(float) @ matrix, rtol=0, atol=1e-14)
    wide = np.broadcast_to(points[:1], points.shape)
    np.testing.assert_allclose(times(wide, matrix), wide.astype(float) @ matrix, rtol=0, atol=1e-14)


@pytest.mark.parametrize("known", [True, False])
def test_curves_without_a_point_are_seen_nowhere(gpu, sphere, known):
    """Strands of no points at all, also where not all that there is is in sight."""
    mesh = sphere if known else None
    fur = clfur.Curves(np.zeros((0, 3)), counts=[0, 0, 0])
    scene = clfur.Scene(mesh, fur, camera=clfur.Camera(eye=(0, 0, .4), target=(0, 0, -1), size=(24, 16)))
    other = clfur.Scene(mesh, clfur.Curves(np.zeros((0, 2, 3))), camera=scene.camera)
    np.testing.assert_array_equal(*(clfur.render(each, gpu, SETTINGS) for each in (scene, other)))


def test_a_mesh_that_is_not_drawn_under_curves(gpu):
    """Of which a part lies outside of the frustum, with a ground that catches shadow."""
    positions, faces = icosphere(1)
    mesh = clfur.Mesh(positions * .8, positions, None, faces)
    fur = clfur.Curves(np.random.default_rng(0).normal(size=(60, 5, 3)) * .5, width=.02)
    scene = clfur.Scene(mesh, fur, clfur.Camera(eye=(0, .2, 1.2), size=(41, 34)), body_color=None,
                        ground=clfur.Ground(), light=clfur.Light((-1, -.3, -.5)))
    assert clfur.render(scene, gpu)[..., 3].any()
