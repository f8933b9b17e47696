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


def test_a_motion_goes_on_from_its_state(gpu, scene):
    """In another Motion of the same arguments, on a mesh that moves, in wind: the same bits."""
    def moving(seconds):
        return attrs.evolve(scene, mesh=_posed(scene.mesh, shift=(np.sin(3 * seconds), seconds**2, 0)))
    one, other = (clfur.Motion(moving, device=gpu, wind=clfur.Wind((3, 0, 1), 0.5, 0.5, 0.1)) for _ in range(2))
    one.at(5)
    state = one.state()
    one.at(9)
    there = other.restore(state)
    assert other.time == state["time"] == 5 / 24 and (points(there) == points(other.at(5))).all()
    assert (points(one.at(9)) == points(other.at(9))).all() and one.time == other.time
    places = [_posed(scene.mesh, shift=(x, 1, 0)) for x in (0.5, 0.6)]   # not those of the function
    one.step(0.01, places[0])
    other.restore(one.state(), places[0])
    assert (points(one.step(0.01, places[1])) == points(other.step(0.01, places[1]))).all()
    wind, state_then = clfur.Wind((-5, 0, 0)), one.state()
    there = points(one.step(0.01, places[0], wind))
    assert (points(one.restore(state_then, places[1])) == points(other.restore(state_then, places[1]))).all()
    assert (points(one.step(0.01, places[0])) != there).any()   # in the wind of before
    other.restore(state_then, places[1], wind)
    assert (points(other.step(0.01, places[0])) == there).all()
    unknown = "is not what Motion.state has given"
    for wrong, words in [({}, unknown), (3, unknown), *((state | each, unknown) for each in (
                             {"time": float("nan")}, {"frame": -1}, {"frame": float("inf")}, {"last_step": "a"})),
                         (state | {"roots": state["roots"][:2]}, r"has roots float32 \[2, 3")]:
        with pytest.raises(clfur.Error, match=words):
            one.restore(wrong)


def test_between_begins_and_ends_where_the_step_does(gpu, scene):
    """To the bit; and so do the mesh, lights and camera."""
    def at(t):
        light = clfur.Light(intensity=1 + t)
        return attrs.evolve(scene, mesh=_posed(scene.mesh, TURN if t > 0.06 else None, (t, 0, 0)), light=light)
    for given, carried in (at, 1.0), (at, 0.3), (scene, 1.0):
        motion = clfur.Motion(given, clfur.HairMotion(inertia=carried), gpu, wind=clfur.Wind((4, 0, 1)))
        before = motion.step(0.05)
        after = motion.step(0.005)
        for share, scene_then in (0, before), (1, after):
            now = motion.between(share)
            np.testing.assert_array_equal(now.fur.on_host.points, scene_then.fur.on_host.points)
            np.testing.assert_array_equal(now.fur.on_host.root_normal, scene_then.fur.on_host.root_normal)
            np.testing.assert_array_equal(now.mesh.positions, scene_then.mesh.positions)
            assert now.light.intensity == scene_then.light.intensity
    step = motion.step(0.01, _posed(scene.mesh, shift=(0.1, 0, 0)))
    half = motion.between(0.5)
    np.testing.assert_allclose(half.mesh.positions - scene.mesh.positions, [[0.05, 0, 0]] * len(scene.mesh.positions),
                               atol=1e-6)
    np.testing.assert_allclose(half.mesh.normals, scene.mesh.normals, atol=1e-6)
    assert np.abs(points(half) - points(step)).max() > 0.01


def test_between_is_exact_to_the_fourth_power_of_the_step(gpu, scene):
    """Of a swing, against steps of a sixteenth; lengths stay to the float32 of places."""
    errors = []
    for step in 1 / 12, 1 / 24:
        coarse, fine = (clfur.Motion(scene, clfur.HairMotion(bend_length=0.3), gpu, rate=768) for _ in range(2))
        for motion in coarse, fine:
            motion.step(0.25, wind=clfur.Wind((3, 0, 1)))   # bent: it swings back
            motion.step(0.25, wind=clfur.Wind())
        worst = 0.0
        for _ in range(round(1 / 12 / step)):
            coarse.step(step)
            for k in range(1, 17):
                worst = max(worst, np.abs(points(coarse.between(k / 16)) - points(fine.step(step / 16))).max())
        errors.append(worst)
        lengths = [np.linalg.norm(np.diff(points(each).reshape(-1, 7, 3), axis=1), axis=2)
                   for each in (coarse.between(0.37), coarse.between(1))]
        assert np.abs(lengths[0] - lengths[1]).max() < 3e-7
    assert errors[1] < errors[0] / 8 < 2e-5


def test_between_goes_with_the_skin(gpu, scene):
    """Of a function of seconds: roots stand on its mesh, and hair of no inertia as it does at both ends."""
    def at(t):
        turn = np.array([[np.cos(9 * t), 0, np.sin(9 * t)], [0, 1, 0], [-np.sin(9 * t), 0, np.cos(9 * t)]])
        return attrs.evolve(scene, mesh=_posed(scene.mesh, turn))
    motion = clfur.Motion(at, clfur.HairMotion(inertia=0, bend_length=9, air=None), gpu, jump=9)
    groom = points(motion.at(0))
    motion.step(1 / 24)
    now = motion.between(0.4)
    turn = at(0.4 / 24).mesh.positions.T @ np.linalg.pinv(scene.mesh.positions.T)
    assert np.abs(points(now) - groom @ turn.T).max() < 2e-3
    assert np.abs(points(now) - groom).max() > 0.1


def test_a_cut_is_over_at_once(gpu, scene):
    motion = clfur.Motion(scene, device=gpu)
    motion.step(0.05)
    now = motion.step(0.05, _posed(scene.mesh, TURN, (0.3, 0, 0)), cut=True)
    then = motion.between(0.2)
    assert then.mesh is now.mesh and np.abs(points(then) - points(now)).max() < 0.02


def test_strands_of_no_and_one_point(gpu, scene):
    """They stand where the mesh does, wherever that is, and strands beside them do not notice."""
    mesh = _posed(scene.mesh, shift=(30, 0, 0))
    root = mesh.positions[0] + mesh.origin
    strand = root + np.linspace(0, 0.4, 5)[:, None] * (root - [30, 0, 0])
    found = []
    for counts in (5,), (0, 5, 1, 0):
        curves = clfur.Curves(np.concatenate([strand] + [[root]] * (1 in counts)), counts=counts, width=0.01)
        motion = clfur.Motion(clfur.Scene(mesh=mesh, fur=curves), clfur.HairMotion(bend_length=0.8), gpu, body=True,
                              hair_on_hair=0.1, wind=clfur.Wind((0, 0, 3), 1, shelter=1))
        found.append(points(motion.step(0.1, _posed(scene.mesh, shift=(30.1, 0, 0)))))
    assert (found[0] == found[1][:5]).all() and np.abs(found[0] - strand).max() > 0.01
    np.testing.assert_allclose(found[1][5], root + [0.1, 0, 0], atol=1e-5)


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
            (lambda: motion.step(1, cut="no"), "Motion.step cut is 'no'"),
            (lambda: motion.restore({"time": 0}, wind=3), "is not what Motion.state has given"),
            (lambda: motion.restore(motion.state(), wind=3), "Motion.restore wind is 3"),
            (lambda: motion.between(0.5), "Motion.between is asked for before any step"),
            (lambda: [motion.at(2), motion.at(1)], "Motion.at frame is 1; allowed: 2 and later"),
            (lambda: motion.between(1.5), "Motion.between share is 1.5"),
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
