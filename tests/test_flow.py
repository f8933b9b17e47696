"""Motion vectors: the twin's on every device, and what is known of scenes and cameras that move."""

import attrs
import numpy as np
import pytest
from support.scenes import icosphere, squares
from support.views import perspective

import clfur
from clfur import layout
from clfur.pipeline.flow import plan_before
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig, view_of
from clfur.stages import flow
from clfur.stages.raster import raster
from clfur.stages.strands import no_strands, upload_curves
from clfur.stages.tessellate import no_surface, tessellate
from clfur.twin import flow as twin
from clfur.twin import shade

SIZE = 64, 48
OUTPUTS = "motion_vector", "id", "depth", "position"
OFF = clfur.Settings(shadows="off")


def turn_of(degrees):
    a = np.radians(degrees)
    return np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])


def hairs(n, seed=3, points=4):
    rng = np.random.default_rng(seed)
    away = rng.normal(size=(n, 1, 3))
    away /= np.linalg.norm(away, axis=2, keepdims=True)
    return away * np.linspace(.6, 1, points)[:, None] + rng.normal(size=(n, points, 3)) * .02


def scene_of(points=None, turn=None, shift=(0, 0, 0), camera=None, width=.03, **known):
    """A ball and its hair, which have turned and moved."""
    turn = np.eye(3) if turn is None else turn
    positions, faces = icosphere(2)
    mesh = clfur.Mesh(.6 * positions @ turn.T + shift, faces=faces)
    points = hairs(200) if points is None else points
    fur = clfur.Curves(points @ turn.T + shift, width=width, lod_by="number")
    camera = camera or clfur.Camera(eye=(0, .4, 3.2), size=SIZE)
    return clfur.Scene(**{"mesh": mesh, "fur": fur, "camera": camera, "light": clfur.Light(shadows=False), **known})


def seen_from(eye, target=None):
    return clfur.Camera(eye=eye, target=np.add(eye, (0, -.4, -3.2)) if target is None else target, size=SIZE)


@pytest.mark.small
def test_vectors_are_the_twins(gpu):
    """Of strands in another order, of the body, the ground, and of nothing."""
    size = 13, 11
    scenes = [scene_of(hairs(30), turn_of(6), (.05, .02, 0), clfur.Camera(eye=(.1, .5, 3), size=size)),
              scene_of(hairs(30), camera=clfur.Camera(eye=(0, .4, 3.2), size=size))]
    order = np.random.default_rng(1).permutation(30)
    strands = [upload_curves(gpu, scene.fur) for scene in scenes]
    moved = upload_curves(gpu, clfur.Curves(scenes[1].fur.points.reshape(30, 4, 3)[order]))
    stored = gpu.upload((4 * np.argsort(order)).astype(np.uint32))
    before = type("Before", (), {"points": moved.points, "stored": stored, "run": 4})()
    bodies = [tessellate(gpu, scene.mesh, 1, 1, "flat") for scene in scenes]
    views = [view_of(scene, 4) for scene in scenes]
    visible = raster(gpu, views[0], strands[0], bodies[0])
    keys = visible.get()
    keys[0, :3] = int(5e8) << 32 | layout.CONSTANTS["GROUND"]
    visible = gpu.upload(keys)
    made = flow.still(gpu, *views, visible)
    flow.moving(gpu, *views, visible, (strands[0], bodies[0]), (before, bodies[1]), made)
    nearest = keys.argmin(2)
    only = np.full(keys.shape, shade.NONE, np.uint64)
    np.put_along_axis(only, nearest[..., None], keys.min(2)[..., None], 2)
    on, number, p, _ = shade.samples_of(views[0], only)
    meant = np.zeros((*keys.shape[:2], 2))
    y, x = np.nonzero(~on.any(2))
    meant[y, x] = twin.endless(*views, x, y)
    ground, hair = number == layout.CONSTANTS["GROUND"], number < layout.CONSTANTS["BODY"]
    now, then = p.copy(), p.copy()
    k = number[hair]
    ends = [s.points.get()[k + j] for s in strands for j in (0, 1)]
    now[hair], then[hair] = twin.on_strands(*ends, p[hair])
    skin = ~hair & ~ground
    triangles = bodies[0].triangles.get()[number[skin] - layout.CONSTANTS["BODY"], :3]
    now[skin], then[skin] = twin.on_faces(*(body.positions.get()[triangles] for body in bodies), p[skin])
    meant[on.any(2)] = twin.vectors(*views, now, then)
    assert min(hair.sum(), skin.sum(), ground.sum(), len(y)) > 2 and np.ptp(meant[on.any(2)], axis=0).min() > .3
    np.testing.assert_allclose(made.get(), meant, atol=2e-4)   # float32 of places some pixels away


@pytest.mark.small
def test_shells_go_with_their_faces(gpu):
    rng = np.random.default_rng(5)
    corners = np.zeros((6, 3, 4), np.float32)
    corners[..., :3] = rng.uniform(-.5, .5, (6, 3, 3))
    moved = corners + np.pad(rng.normal(size=(6, 3, 3)) * .1, ((0, 0), (0, 0), (0, 1))).astype(np.float32)
    views = perspective(4, 3, 1), perspective(4, 3, 1, eye=(.2, .4, 3))
    face, ids = rng.integers(0, 6, (3, 4, 1)), np.full((3, 4), layout.CONSTANTS["ID_SHELLS"], np.int32)
    ids[1, 2] = 5
    keys = (rng.integers(2**27, 2**28, (3, 4, 1)).astype(np.uint64) << np.uint64(32)) | face.astype(np.uint64)
    made = flow.VECTORS.empty(gpu, (3, 4))
    front = gpu.upload(keys)
    flow.of_shells(gpu, *views, front, front, gpu.upload(ids), gpu.upload(corners), gpu.upload(moved), made)
    p = shade.samples_of(views[0], keys)[2]
    which = face.ravel()
    meant = twin.vectors(*views, *twin.on_faces(corners[which], moved[which], p, lifted=True)).reshape(3, 4, 2)
    meant[1, 2] = 0
    np.testing.assert_allclose(made.get(), meant, rtol=1e-4, atol=1e-3)


@pytest.mark.small
def test_the_farthest_is_the_twins(gpu):
    """Of points before the cameras, beside the picture, and behind one or both."""
    rng = np.random.default_rng(6)
    views = perspective(40, 30, 1), perspective(40, 30, 1, eye=(.1, .3, 3.3))
    seen = 0
    for far, away in (.02, 0), (.3, 0), (.3, 1.7), (1.5, 1.2), (.1, 20):
        points = np.zeros((24, 4), np.float32)
        points[:, :3] = rng.uniform(-.6, .6, (24, 3)) + [0, 0, away]
        before = points + np.pad(rng.normal(size=(24, 3)) * far, ((0, 0), (0, 1))).astype(np.float32)
        strands = [upload_curves(gpu, clfur.Curves(each[:, :3].reshape(6, 4, 3))) for each in (points, before)]
        none = no_surface(gpu)
        meant = twin.farthest(*views, points, before)
        most = flow.farthest(gpu, *views, (strands[0], none), (strands[1], none))
        np.testing.assert_allclose(most.get().view(np.float32), meant, rtol=1e-4, atol=1e-4)
        body, body_before = (type("Body", (), {"positions": gpu.upload(each)})() for each in (points, before))
        nobody = no_strands(gpu)
        most = flow.farthest(gpu, *views, (nobody, body), (nobody, body_before))
        np.testing.assert_allclose(most.get().view(np.float32), meant, rtol=1e-4, atol=1e-4)
        seen += meant > 0
    assert seen == 4   # not of those that are behind both


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_what_stays_has_gone_nowhere(gpu, raster):
    scene = scene_of(ground=clfur.Ground(color=(.5, .5, .5)))
    found = clfur.render(scene, gpu, attrs.evolve(OFF, raster=raster), OUTPUTS, before=scene)
    assert set(np.unique(np.minimum(found["id"], 0))) == {-4, -2, -1, 0}
    assert (found["motion_vector"] == 0).all()


@pytest.mark.parametrize("raster", ["coverage", "samples"])
def test_a_camera_that_moves_and_turns(gpu, raster):
    """Aside by d: all goes d · f / depth the other way, but for a strand's half width; what is endlessly far stays."""
    settings, d = attrs.evolve(OFF, raster=raster), .1
    scene = scene_of(width=.004)
    now = attrs.evolve(scene, camera=seen_from((d, .4, 3.2)))
    before = attrs.evolve(scene, camera=seen_from((0, .4, 3.2)))
    found = clfur.render(now, gpu, settings, OUTPUTS, before=before)
    f, on = now.camera.intrinsics[0, 0], found["id"] != -1
    np.testing.assert_allclose(found["motion_vector"][on][:, 0], -d * f / found["depth"][on], rtol=5e-3)
    assert np.abs(found["motion_vector"][on][:, 1]).max() < 1e-4
    assert np.abs(found["motion_vector"][~on]).max() < 1e-4 and 0 < on.mean() < 1
    a = np.radians(3)   # a pan: what is in the middle now was beside it
    panned = attrs.evolve(scene, camera=seen_from((0, 0, 3.2), (np.sin(a) * 3.2, 0, 3.2 - np.cos(a) * 3.2)))
    ahead = attrs.evolve(scene, camera=seen_from((0, 0, 3.2), (0, 0, 0)))
    found = clfur.render(panned, gpu, settings, OUTPUTS, before=ahead)["motion_vector"]
    c = np.arange(SIZE[0]) + .5 - SIZE[0] / 2
    was = f * np.tan(np.arctan(c / f) + a)
    np.testing.assert_allclose(found[24, :, 0], c - was, atol=.03)   # samples are up to half a pixel aside


def test_a_ball_that_turns(gpu):
    """Hair and body go with it: as float64 turns the places that are seen back."""
    turn, shift = turn_of(5), np.array([.1, 0, .05])
    now, before = scene_of(turn=turn, shift=shift, width=.004), scene_of(width=.004)
    found = clfur.render(now, gpu, attrs.evolve(OFF, samples=1), OUTPUTS, before=before)
    on = found["id"] != -1
    p = found["position"][on].astype(float)
    view = view_of(now, 1)
    meant = twin.vectors(view, view_of(before, 1), p, (p - shift) @ turn)
    error = np.abs(found["motion_vector"][on] - meant).max(1)
    assert np.median(error) < 3e-3 and error.max() < .1   # a strand's axis, and beyond its ends its end
    assert not found["motion_vector"][~on].any() and np.abs(meant).max() > 3


@pytest.mark.parametrize("settings", [
    OFF, attrs.evolve(OFF, lod=4), attrs.evolve(OFF, raster="samples", samples=16), attrs.evolve(OFF, masks=4)],
    ids=["all", "lod", "samples", "masks"])
def test_parts_order_and_regions_do_not_matter(gpu, another, settings):
    """Strands that are in another order on the device, in parts, and thinned, keep their numbers."""
    rng = np.random.default_rng(8)
    points = hairs(5000, points=9)
    turn = turn_of(4)
    now, before = (scene_of(points @ each.T + rng.normal(size=(5000, 1, 3)) * 1e-4, width=.004) for each in (
        turn, np.eye(3)))
    now = attrs.evolve(now, mesh=scene_of(turn=turn).mesh)
    whole = clfur.render(now, gpu, settings, OUTPUTS, before=before)
    hair = whole["id"] >= 0
    p = whole["position"][hair].astype(float)
    meant = twin.vectors(view_of(now, 1), view_of(before, 1), p, p @ turn)
    error = np.abs(whole["motion_vector"][hair] - meant).max(1)
    assert np.median(error) < .02 and error.max() < .5 and np.abs(meant).max() > 1.5
    x, y, w, h = region = 19, 9, 30, 31
    part = clfur.render(now, gpu, settings, OUTPUTS, before=before, region=region)
    small = another(memory=4 << 20)
    plan = Plan(Rig.of(now, settings), OUTPUTS, before=plan_before(now, before, settings))
    assert len(plan.parts(small)) > 1
    split = clfur.render(now, small, settings, OUTPUTS, before=before)
    for name in OUTPUTS:
        np.testing.assert_array_equal(part[name], whole[name][y:y + h, x:x + w])
        np.testing.assert_array_equal(split[name], whole[name])


def test_strands_that_grow_and_shells(gpu):
    """On a mesh that has moved: all go as it does."""
    positions, faces = icosphere(2)
    hair = clfur.HairType(length=.3, stiffness=5, segments=4, width=.01)
    shells = clfur.Shells(length=.1, frequency=20)
    for fur in clfur.Strands(types=[hair], roots=300), shells, (shells, clfur.Strands(types=[hair], roots=50)):
        now, before = (scene_of(mesh=clfur.Mesh(.6 * positions + [x, 0, 0], faces=faces), fur=fur) for x in (.1, 0))
        found = clfur.render(now, gpu, OFF, OUTPUTS, before=before)
        on, f = found["id"] != -1, now.camera.intrinsics[0, 0]
        assert (found["id"] == -3).any() == (fur is not now.strands)
        np.testing.assert_allclose(found["motion_vector"][on][:, 0], .1 * f / found["depth"][on], rtol=.02)


def test_a_ground_stays_where_it_is(gpu):
    scene = clfur.Scene(mesh=squares((3, 0)), ground=clfur.Ground(height=-.5, color=(.5, .5, .5)),
                        camera=seen_from((0, 1, 3)))
    now = attrs.evolve(scene, camera=seen_from((.1, 1, 3)))
    found = clfur.render(now, gpu, OFF, OUTPUTS, before=scene)
    for which in -4, -2:
        on = found["id"] == which
        assert on.any()
        np.testing.assert_allclose(found["motion_vector"][on][:, 0],
                                   -.1 * now.camera.intrinsics[0, 0] / found["depth"][on], rtol=1e-3)


def test_far_from_the_origin(gpu):
    """Both scenes are drawn from one place."""
    there = np.array([3e5, -2e5, 1e5])
    found = []
    for away in np.zeros(3), there:
        now, before = (scene_of(shift=shift + away, camera=seen_from(np.array([0, .4, 3.2]) + away)) for shift in (
            np.array([.1, 0, 0]), np.zeros(3)))
        found.append(clfur.render(now, gpu, OFF, OUTPUTS, before=before))
    on = (found[0]["id"] == found[1]["id"]) & (found[0]["id"] != -1)
    assert on.mean() > .3
    np.testing.assert_allclose(found[1]["motion_vector"][on], found[0]["motion_vector"][on], atol=.02)


def test_what_is_refused(gpu):
    scene = scene_of()
    for before, words in [(None, "motion_vector needs before"), (3, "before is 3"),
                          (scene_of(hairs(9)), "before has 9 strands and scene 200"),
                          (attrs.evolve(scene, mesh=None), "before has 0 faces"),
                          (attrs.evolve(scene, camera=clfur.Camera(size=(9, 48))), "before has 9 columns")]:
        with pytest.raises(clfur.Error, match=words):
            clfur.render(scene, gpu, OFF, "motion_vector", before=before)


def test_exr_has_them(gpu, tmp_path):
    scene = scene_of()
    found = clfur.render(scene, gpu, OFF, ("color", "motion_vector"), before=scene_of(turn=turn_of(3)))
    clfur.save(tmp_path / "a.exr", found)
    read = clfur.load(tmp_path / "a.exr")
    np.testing.assert_array_equal(read["motion_vector"], found["motion_vector"])
