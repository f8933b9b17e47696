"""clfur.Motion: scenes whose strands move."""

import warnings

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur

TURN = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])   # a quarter around y


@pytest.fixture
def scene():
    return _scene()


def _scene(roots=40, fur=None):
    positions, faces = icosphere(1)
    mesh = clfur.Mesh(positions=positions, faces=faces)
    fur = fur or clfur.Strands(roots=roots, types=_hair(1), force=(0.5, -1, 0.2))
    return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=(0, 0.5, 4), size=(32, 32)))


def _hair(scale):
    return clfur.HairType(length=0.4 * scale, stiffness=4, segments=6, width=0.02)


def _posed(mesh, turn=None, shift=(0, 0, 0)):
    places = mesh.positions @ (np.eye(3) if turn is None else turn).T + shift
    return clfur.Mesh(positions=places, faces=mesh.faces)


def points(scene):
    return np.asarray(scene.fur.on_host.points, float) + scene.fur.origin


@pytest.mark.parametrize("kind", ["strands", "curves"])
def test_a_groom_is_at_rest(gpu, scene, kind):
    """Grown strands, and Curves that stand on the mesh, stay as they were, and draw as they did."""
    groom = clfur.grow(scene, gpu)
    if kind == "curves":
        scene = _scene(fur=groom)
    motion = clfur.Motion(scene, device=gpu)
    assert np.abs(points(motion.at(0)) - groom.points).max() < 1e-6
    now = motion.at(12)
    assert motion.time == pytest.approx(0.5) and np.abs(points(now) - groom.points).max() < 1e-5
    settings = clfur.Settings(shadows="off", shadow_map=0)
    assert np.abs(clfur.render(now, gpu, settings) - clfur.render(scene, gpu, settings)).max() < 2e-3


def test_strands_are_not_read_back(gpu, scene):
    now = clfur.Motion(scene, device=gpu).step(1 / 24, _posed(scene.mesh, shift=(0.1, 0, 0)))
    now.fur.points.get = now.fur.root_normal.get = None
    assert clfur.render(now, gpu)[..., 3].max() > 0


def test_a_scene_that_is_a_function_of_seconds(gpu, scene):
    """Its mesh, lights, camera, body and shells are drawn as they are then; its hair is that of the beginning."""
    def scene_at(seconds):
        return attrs.evolve(
            scene, mesh=_posed(scene.mesh, shift=(seconds, 0, 0)), body_color=(seconds, 0, 0),
            camera=clfur.Camera(eye=(seconds, 0.5, 4), size=(32, 32)), light=clfur.Light(intensity=1 + seconds),
            fur=scene.fur if seconds < 0.3 else [clfur.Shells(length=0.1), clfur.Strands(roots=7)])
    motion, by_hand = clfur.Motion(scene_at, device=gpu), clfur.Motion(scene, device=gpu)
    for seconds in 0.25, 0.5:
        now = motion.step(0.25)
        there = by_hand.step(0.25, _posed(scene.mesh, shift=(seconds, 0, 0)))
        np.testing.assert_array_equal(now.strands.on_host.points, there.fur.on_host.points)
        np.testing.assert_array_equal(now.mesh.positions, there.mesh.positions)
        assert now.camera.eye[0] == now.body_color[0] == seconds and now.light.intensity == 1 + seconds
    assert now.shells.length == 0.1 and len(now.strands.counts) == 40
    assert clfur.render(now, gpu)[..., 3].max() > 0
    # A mesh that is given counts more.
    assert motion.step(0.25, _posed(scene.mesh, shift=(2, 0, 0))).mesh.bounds[0][0] == pytest.approx(2)


def test_a_cut_and_a_jump_carry_hair_along(gpu, scene):
    """Places, normals and what they do next."""
    there = (30.0, -2, 5)
    for cut, far in (True, 0.3), (False, 1):
        motion = clfur.Motion(scene, device=gpu)
        before = points(motion.at(2))
        now = motion.step(1 / 24, _posed(scene.mesh, TURN, np.multiply(there, far)), cut=cut)
        # It hung under gravity in its frame, and hangs there for a 24th of a second in another: no kick.
        assert np.abs(points(now) - np.multiply(there, far) - before @ TURN.T).max() < 0.02
        normals = now.fur.on_host.root_normal
        assert np.abs(normals - clfur.grow(scene, gpu).root_normal @ TURN.T).max() < 0.1   # of PN faces, and flat ones


def test_hair_lags_behind_its_root_by_inertia(gpu, scene):
    """And its roots go with the skin."""
    lags = []
    for inertia in (0, 0.5, 1):
        motion = clfur.Motion(scene, clfur.HairMotion(inertia=inertia, damping=0, air=None), gpu)
        start = points(motion.at(0)).reshape(-1, 7, 3)
        now = points(motion.step(1 / 24, _posed(scene.mesh, shift=(0.2, 0, 0)))).reshape(-1, 7, 3)
        assert np.abs(now[:, 0] - start[:, 0] - (0.2, 0, 0)).max() < 1e-5
        lags.append(-(now[:, -1] - start[:, -1] - (0.2, 0, 0))[:, 0].mean())
    assert abs(lags[0]) < 1e-4 and 0.02 < 1.5 * lags[1] < lags[2]


def test_lengths_stay_however_fast_roots_move(gpu, scene):
    motion = clfur.Motion(scene, device=gpu, jump=1e6)
    start = np.linalg.norm(np.diff(points(motion.at(0)).reshape(-1, 7, 3), axis=1), axis=2)
    rng = np.random.default_rng(0)
    with pytest.warns(RuntimeWarning, match="32 substeps"):
        for _ in range(4):
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            now = motion.step(1 / 24, _posed(scene.mesh, turn * np.linalg.det(turn), rng.normal(size=3) * 9))
    # Places so far away are in float32 at 1e-6 of a length of 10.
    assert np.abs(np.linalg.norm(np.diff(points(now).reshape(-1, 7, 3), axis=1), axis=2) / start - 1).max() < 1e-4


def test_a_scene_s_clock_and_not_the_frame_s(gpu, scene):
    """As many substeps in two frames of a half as in one: the same bits."""
    one, two = (clfur.Motion(scene, device=gpu, rate=96, wind=clfur.Wind((3, 0, 1), 0.5, 0.5, 0.1)) for _ in range(2))
    two.step(1 / 48)
    a, b = points(one.step(1 / 24)), points(two.step(1 / 48))
    assert np.abs(a - b).max() < 1e-6
    assert np.abs(a - points(clfur.Motion(scene, device=gpu).at(0))).max() > 1e-3


def test_scale_is_in_metres(gpu):
    """Twice the mesh with twice the units a metre is the same motion, twice as large."""
    small = _scene(10)
    places = []
    for scale in (1, 2):
        mesh = clfur.Mesh(positions=small.mesh.positions * scale, faces=small.mesh.faces)
        scene = clfur.Scene(mesh=mesh, fur=clfur.Strands(roots=10, types=_hair(scale)), camera=small.camera)
        motion = clfur.Motion(scene, device=gpu, units_per_metre=scale, wind=clfur.Wind((2, 0, 0), 0.5, 0.7, 0.1))
        places.append(points(motion.at(6)) / scale)
    assert np.abs(places[1] - places[0]).max() < 1e-4


def test_soft_hair_is_told(gpu, scene):
    with pytest.warns(RuntimeWarning, match="40 of 40 strands are too soft"):
        clfur.Motion(scene, clfur.HairMotion(bend_length=0.01), gpu)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        clfur.Motion(scene, clfur.HairMotion(bend_length=0.4), gpu)


def test_what_is_refused(gpu, scene):
    motion = clfur.Motion(scene, device=gpu)
    other = clfur.Mesh(positions=scene.mesh.positions, faces=scene.mesh.faces[:-1])
    for call, words in [
            (lambda: motion.step(1 / 24, other), "Motion.scene.mesh has 80 faces and Scene.mesh 79"),
            (lambda: motion.step(0), "Motion.step seconds is 0"),
            (lambda: motion.step(1, "mesh"), "Motion.step mesh is"),
            (lambda: [motion.at(2), motion.at(1)], "Motion.at frame is 1; allowed: 2 and later"),
            (lambda: clfur.Motion(clfur.Scene(mesh=scene.mesh)), "Motion.scene is"),
            (lambda: clfur.Motion(scene, [clfur.HairMotion()] * 3, gpu), "Motion.hair has 3 HairMotions"),
            (lambda: clfur.Motion(scene, 3, gpu), "Motion.hair is 3"),
            (lambda: clfur.Motion(scene, device=gpu, rate=0), "Motion.rate is 0"),
            (lambda: clfur.Motion(scene, device=gpu, wind=(1, 0, 0)), "Motion.wind is"),
            (lambda: clfur.Motion(3, device=gpu), "Motion.scene is 3; allowed: a clfur.Scene with a mesh, or a func"),
            (lambda: clfur.Motion(lambda t: 3, device=gpu), r"Motion.scene\(0\) is 3; allowed: a clfur.Scene with a"),
            (lambda: clfur.Motion(lambda t: clfur.Scene(mesh=scene.mesh), device=gpu), "Motion.scene is Sc.*Strands"),
            (lambda: clfur.Motion(lambda t: None if t else scene, device=gpu).step(.5), r"Motion.scene\(0.5\) is None"),
            (lambda: clfur.Motion(lambda t: clfur.Scene(other) if t else scene, device=gpu).step(.5),
             "Motion.scene.mesh has 80 faces and Scene.mesh 79"),
            (lambda: clfur.Motion(_scene(fur=clfur.Curves(np.array([[[9.0, 0, 0], [9, 1, 0]]]))), device=gpu),
             "Motion.scene.fur has 1 of 1 roots"),
            (lambda: clfur.HairMotion(air=0), "HairMotion.air is 0"),
            (lambda: clfur.Wind(gust=-1), "Wind.gust is -1")]:
        with pytest.raises(clfur.Error, match=words):
            call()
