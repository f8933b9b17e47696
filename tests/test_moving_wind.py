"""clfur.Motion in the wind: shells that it moves alone or under strands, and what hair upwind leaves of it."""

import gc
import weakref

import attrs
import numpy as np
import pytest
from support.scenes import icosphere

import clfur
from clfur.stages import wind

G = np.array((0, -9.81, 0))
TURN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])   # upside down


def _mesh(turn=None, shift=(0, 0, 0)):
    positions, faces = icosphere(1)
    return clfur.Mesh(positions=positions @ (np.eye(3) if turn is None else turn).T + shift, faces=faces)


def _scene(*fur):
    camera = clfur.Camera(eye=(0, 0.5, 4), size=(32, 32))
    return clfur.Scene(mesh=_mesh(), fur=fur if len(fur) > 1 else fur[0], camera=camera)


SHELLS = clfur.Shells(length=0.2, layers=6, frequency=9, force=(0.2, -0.3, 0))
HAIR = clfur.HairMotion(bend_length=0.25, air=0.1)
BY = wind.oscillator(9.81 * 0.25**3, 10.0, 0.02, 0.2)[2]   # lean by a force, of these


def leans(scene, normal=None):
    """How shells lean in all [vertices, 3], or along the skin alone."""
    shells = scene.shells.on_host
    lean = shells.lean.astype(float) + shells.force - shells.acceleration
    return lean if normal is None else lean - (lean * normal).sum(1)[:, None] * normal


def test_shells_at_rest_stay(gpu):
    """As they were groomed, leaning by a force, and draw as they did; nothing is read back."""
    scene = _scene(SHELLS)
    motion = clfur.Motion(scene, HAIR, gpu)
    now, settings = motion.at(0), clfur.Settings(shadows="off", shadow_map=0)
    now.shells.lean.get = None
    np.testing.assert_array_equal(clfur.render(now, gpu, settings), clfur.render(scene, gpu, settings))
    assert np.abs(leans(motion.at(6)) - SHELLS.force).max() < 1e-6


def test_shells_lean_with_a_steady_wind_and_gravity(gpu):
    """By what bends a bar of their length: the wind over what air slows down; upside down by twice their weight."""
    normals, velocity = _mesh().normals, np.array((6.0, 0, 1.5))
    motion = clfur.Motion(_scene(SHELLS), HAIR, gpu, wind=clfur.Wind(velocity))
    for _ in range(24):
        now = motion.step(1 / 8)
    wants = SHELLS.force + BY * velocity / 0.1
    np.testing.assert_allclose(leans(now, normals), wants - (normals @ wants)[:, None] * normals, rtol=0, atol=2e-4)
    assert ((leans(now) * normals).sum(1) > -0.9001).all() and (normals @ wants).min() < -1   # and not into the skin
    motion.wind = clfur.Wind()
    turned = _mesh(TURN)
    motion.step(1 / 24, turned, cut=True)
    for _ in range(24):
        now = motion.step(1 / 8)
    wants = TURN @ SHELLS.force + BY * (G - TURN @ G)
    normals = turned.normals
    np.testing.assert_allclose(leans(now, normals), wants - (normals @ wants)[:, None] * normals, rtol=0, atol=2e-4)


def test_shells_lag_behind_the_skin(gpu):
    """Where it is pushed, by inertia; and not where it is cut."""
    lags = []
    for inertia, cut in ((0, False), (0.5, False), (1, False), (1, True)):
        motion = clfur.Motion(_scene(SHELLS), clfur.HairMotion(0.25, None, 0, inertia), gpu, jump=9)
        now = motion.step(1 / 120, _mesh(shift=(0.05, 0, 0)), cut=cut)
        lags.append(-(leans(now) - SHELLS.force)[:, 0].mean())
    assert abs(lags[0]) < 1e-6 and lags[2] == pytest.approx(2 * lags[1], rel=1e-3) and abs(lags[3]) < 1e-6
    # A push by 6 world / s gives leans 1.8751⁴ / 4 length times that, at the mean half of it in the step that pushes.
    assert lags[2] == pytest.approx(1.8751**4 / 4 / 0.2 * 6 / 120 / 2, rel=0.01)


def test_shells_and_strands_go_together(gpu):
    """In gusts an undercoat leans whither the tips of as long strands in the same places do, when they do."""
    mesh = _mesh()
    along = np.linspace(0, 0.2, 7)[:, None] * mesh.normals[:, None]
    strands = clfur.Curves(mesh.positions[:, None] + along, width=0.01)
    motion = clfur.Motion(_scene(attrs.evolve(SHELLS, force=(0, 0, 0)), strands), HAIR, gpu,
                          wind=clfur.Wind((0.6, 0, 0), 1.5, 0.5))
    tips, shells = [], []
    for frame in range(1, 17):
        now = motion.at(frame)
        points = np.asarray(now.strands.on_host.points).reshape(-1, 7, 3)
        for to, way in (tips, points[:, -1] - points[:, 0]), (shells, leans(now) * 0.1):   # half a length
            to.append(way - (way * mesh.normals).sum(1)[:, None] * mesh.normals)
    tips, shells = np.ravel(tips), np.ravel(shells)
    # Gravity bears on strands that lean, and they bend in more waves than one.
    assert np.corrcoef(tips, shells)[0, 1] > 0.95 and np.polyfit(shells, tips, 1)[0] == pytest.approx(1, abs=0.15)
    assert np.abs(tips).max() > 0.01


def test_slow_motion_is_instant_motion(gpu):
    """In a weak wind that turns in seconds strands, and shells, are where hair is that grows under its force then.

    One is a bar that a load bends, the other a curve that turns evenly along its length: a share u
    of the way they go u² (6 - 4 u + u²) / 3 and u² as far as it.  The force is such that tips agree.
    """
    length, stiffness, air = 0.2, 4.0, 0.1
    hair = clfur.HairMotion(bend_length=0.6, air=air)
    by = wind.oscillator(9.81 * 0.6**3, 1 / air, 0.02, length)[2]
    kind = clfur.HairType(length=length, stiffness=stiffness, segments=8)
    still = clfur.Strands(roots=60, types=kind, force=(0, 0, 0))
    motion = clfur.Motion(_scene(attrs.evolve(SHELLS, force=(0, 0, 0)), still), hair, gpu, gravity=(0, 0, 0))
    start = np.asarray(motion.at(0).strands.on_host.points).reshape(-1, 9, 3)
    for turn in np.linspace(0, 1, 25):
        velocity = 10 * np.array((np.cos(turn), 0, np.sin(turn)))
        now = motion.step(1 / 6, wind=clfur.Wind(velocity))
    lean = by * velocity / air
    grown = clfur.grow(_scene(attrs.evolve(still, force=stiffness * lean)), gpu).points.reshape(-1, 9, 3)
    moved, instant = (np.asarray(each).reshape(-1, 9, 3) - start for each in (now.strands.on_host.points, grown))
    most = np.linalg.norm(instant, axis=2).max()
    assert most > 0.03 * length
    assert np.linalg.norm((moved - instant)[:, -1], axis=1).max() < 0.03 * most
    u = np.linspace(0, 1, 100)
    assert np.linalg.norm(moved - instant, axis=2).max() < ((u**2 * (3 - 4 * u + u**2)).max() / 3 + 0.01) * most
    assert np.linalg.norm(leans(now) - lean, axis=1).max() < 0.03 * np.linalg.norm(lean)


def test_a_frame_in_parts_is_the_same(gpu):
    """Where wind and skin are the same, however many substeps make a step, or steps a second."""
    ends = []
    for rate, parts in ((24, 1), (96, 1), (24, 4)):
        motion = clfur.Motion(_scene(SHELLS), HAIR, gpu, rate=rate, wind=clfur.Wind((1, 0, 0)))
        for _ in range(parts):
            now = motion.step(1 / 24 / parts)
        ends.append(leans(now))
    assert np.abs(ends[0] - ends[1]).max() < 2e-6 and np.abs(ends[0] - ends[2]).max() < 2e-6
    assert np.abs(ends[0] - SHELLS.force).max() > 0.01


def test_an_undercoat_is_kept(gpu):
    """From what it holds another goes on to the same bits; and it can be drawn as it was within a step."""
    motions = [clfur.Motion(_scene(SHELLS), HAIR, gpu, wind=clfur.Wind((1, 0, 0), 1, 0.4)) for _ in range(2)]
    for _ in range(3):
        before = motions[0].step(1 / 24)
    motions[1].restore(motions[0].state())
    now = [leans(each.step(1 / 24)) for each in motions]
    np.testing.assert_array_equal(*now)
    at = [leans(attrs.evolve(before, fur=motions[0]._undercoat.drawn(SHELLS, _mesh(), share))) for share in (0, 0.5)]
    np.testing.assert_allclose(at, [leans(before), (leans(before) + now[0]) / 2], rtol=0, atol=1e-6)
    assert np.abs(now[0] - leans(before)).max() > 1e-3


@pytest.mark.parametrize("fur", [SHELLS, (SHELLS, clfur.Strands(roots=200))], ids=["shells", "both"])
def test_what_a_motion_holds_is_free_without_it(gpu, monkeypatch, fur):
    """At once, and not when Python happens to look for what holds itself: it is the memory of a device."""
    monkeypatch.setattr(gpu, "on_host", False)   # so that all of it is the pool's
    motion = clfur.Motion(_scene(fur), HAIR, gpu, wind=clfur.Wind((1, 0, 0), 1, shelter=1), body=True, hair_on_hair=0.1)
    motion.step(1 / 24)
    gc.disable()
    try:
        held = gpu._pool.active_bytes
        del motion
        assert gpu._pool.active_bytes < held - 10_000
        motion = clfur.Motion(_scene(fur), HAIR, gpu)
        kept = weakref.ref(motion)
        del motion
        assert kept() is None
    finally:
        gc.enable()


def test_a_pose_whose_vertices_touch(gpu):
    """Shells keep how each corner leans where a pose makes two vertices one."""
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0), (3, 0, 0), (2, 1, 0.0)])
    faces = np.array([(0, 1, 2), (3, 4, 5)])
    mesh = clfur.Mesh(positions=positions, faces=faces)
    scene = clfur.Scene(mesh=mesh, fur=SHELLS, camera=clfur.Camera(eye=(0, 0, 9)))
    motion = clfur.Motion(scene, HAIR, gpu, wind=clfur.Wind((1, 0, 0)))
    one = motion.step(1 / 24)
    shift = (positions[:, :1] > 1.5) * np.array([1, 0, 0.0])
    two = motion.step(1 / 24, clfur.Mesh(positions=positions - shift, faces=faces))
    assert len(two.mesh.positions) == 5 == len(two.shells.lean) and len(one.shells.lean) == 6


def test_hair_upwind_gives_shelter(gpu):
    """Tips behind much hair are blown less than those before it."""
    strands = clfur.Strands(roots=3000, types=clfur.HairType(length=0.4, segments=5, width=0.02))
    ways = []
    for shelter in (0, 1):
        motion = clfur.Motion(_scene(strands), clfur.HairMotion(0.4, 0.1), gpu,
                              wind=clfur.Wind((3, 0, 0), shelter=shelter))
        start = np.asarray(motion.at(0).fur.on_host.points).reshape(-1, 6, 3)
        now = np.asarray(motion.step(1 / 6).fur.on_host.points).reshape(-1, 6, 3)
        ways.append((now - start)[:, -1, 0])
    before, behind = start[:, 0, 0] < -0.7, start[:, 0, 0] > 0.7
    free, left = (each[before].mean() for each in ways), (each[behind].mean() for each in ways)
    (before_free, before_left), (behind_free, behind_left) = free, left
    assert before_left > 0.5 * before_free and behind_left < 0.2 * behind_free
    assert ways[1].min() > -0.05
    alone = [clfur.Motion(_scene(SHELLS), HAIR, gpu, wind=clfur.Wind((1, 0, 0), shelter=shelter)).step(1 / 24)
             for shelter in (0, 1)]
    np.testing.assert_array_equal(*map(leans, alone))   # without strands there is none


def test_strands_shelter_the_undercoat(gpu):
    strands = clfur.Strands(roots=3000, types=clfur.HairType(length=0.4, segments=5, width=0.02))
    found = []
    for shelter in (0, 1):
        motion = clfur.Motion(_scene(SHELLS, strands), HAIR, gpu, wind=clfur.Wind((3, 0, 0), shelter=shelter))
        found.append((leans(motion.step(1 / 6)) - SHELLS.force)[:, 0])
    assert found[1].min() > 0 and found[1].max() < 0.7 * found[0].min() and found[1].mean() < 0.3 * found[0].mean()


def test_what_is_refused(gpu):
    strands = clfur.Strands(roots=3)
    for call, words in [
            (lambda: clfur.Motion(_scene(attrs.evolve(SHELLS, wind=(1, 0, 0))), HAIR, gpu), "have a wind of their own"),
            (lambda: clfur.Motion(_scene(SHELLS, strands), [HAIR] * 3, gpu),
             "Motion.hair has 3 HairMotions but Scene.fur has 1 types and shells"),
            (lambda: clfur.Wind(shelter=17), "Wind.shelter is 17")]:
        with pytest.raises(clfur.Error, match=words):
            call()
    clfur.Motion(_scene(SHELLS, strands), [HAIR] * 2, gpu)
