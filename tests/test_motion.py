"""motion against its twin, and the laws of bars, chains and roots that shake (docs/motion.md has longer runs)."""

import numpy as np
import pytest
from support.hair import DROPS, SOFTEST, G, Hair, bar, blown, curl, period, swing, uneven

from clfur.stages import motion, wind
from clfur.twin import motion as twin


def shaken(root, rng, far):
    """Roots that have gone up to so far, and turned."""
    root = root.copy()
    root[0] += rng.uniform(-far, far, root[0].shape)
    for i in range(root.shape[2]):
        root[1:, :, i] = root[1:, :, i] @ np.linalg.qr(rng.normal(size=(3, 3)) * far + np.eye(3))[0]
    return root


@pytest.mark.small
@pytest.mark.parametrize("air, damping, carried", [(0, 0, 0), (3, 0.05, 0), (1, 0, 0.7), (0, 0.02, 1)])
def test_a_step_is_the_twins(gpu, air, damping, carried):
    """Strands of many lengths side by side, whose roots move and turn."""
    rng = np.random.default_rng(3)
    strands = uneven(rng, (5, 9, 2, 7, 3, 9, 4, 6, 8))
    hair = Hair(gpu, strands, 0.5, air, damping, carried)
    twins = [twin.Strand(each, axes, 0.5, G, air, damping, carried)
             for each, axes in zip(hair.strands, hair.axes)]
    velocity, root = wind.moment((1, 0.3, -2), 3.0, 0.5, skin=0.1, longest=1), hair.root
    for number in range(4):
        before, root = root, shaken(root, rng, 0.02)
        hair.step(1 / 60, velocity, root)
        winds = gpu.download(hair.winds).reshape(hair.state.points, 3, -1).astype(float)
        for i, each in enumerate(twins):
            now, then = ((rows[0, :, i].astype(float), rows[1:, :, i].astype(float)) for rows in (root, before))
            each.advance(now, then, 1 / 60, winds[:len(each.places), :, i], min(number + 1, 2))
    for now, speed, each in zip(hair.array(), hair.array("speeds"), twins):
        # Rounding of float32, which stiff joints of short segments make larger.
        np.testing.assert_allclose(now, each.places, rtol=0, atol=3e-5)
        np.testing.assert_allclose(speed, each.speeds, rtol=0, atol=5e-3)


@pytest.mark.small
def test_what_hangs_is_the_twins(gpu):
    rng = np.random.default_rng(4)
    hair = Hair(gpu, uneven(rng, (5, 9, 2, 7)), 0.05)
    soft = gpu.download(hair.soft)
    for i, (each, axes) in enumerate(zip(hair.strands, hair.axes)):
        groomed, rest, is_soft = twin.hang(each.astype(float), axes, 0.05, G)
        np.testing.assert_allclose(hair.array("groomed")[i], groomed, rtol=0, atol=1e-6)
        np.testing.assert_allclose(hair.array("rest")[i][:-1], rest, rtol=0, atol=1e-5)
        assert soft[i] == is_soft
    assert 0 < soft.sum() < len(soft)


@pytest.mark.parametrize("segments, allowed", [(8, 0.015), (16, 0.005), (32, 0.002)])
@pytest.mark.parametrize("k", DROPS)
def test_a_bar_bends_under_its_weight(gpu, segments, allowed, k):
    hair = Hair(gpu, [bar(segments)], 9.81 / k, air=5, weighted=False)
    for _ in range(300):
        hair.step(1 / 60)
    assert -hair.array()[0][-1, 1] == pytest.approx(DROPS[k], rel=allowed)


@pytest.mark.parametrize("segments", [8, 32])
def test_a_chain_swings_in_time(gpu, segments):
    """The first period of a hanging chain is 2π / (2.4048 / 2) · sqrt(L / g) (Bernoulli)."""
    times, _ = swing(gpu, segments, 1.0, 1 / 60, 3.7)
    assert np.diff(times)[0] == pytest.approx(period(1.0), rel=0.007)


def test_a_short_chain_swings_on_and_in_time(gpu):
    """5 cm by the scene's clock: its period, and how far it swings after six of them."""
    times, most = swing(gpu, 8, 0.05, 1 / 120, 7.2 * period(0.05))
    assert np.diff(times)[0] == pytest.approx(period(0.05), rel=0.02) and most[6] > 0.9


@pytest.mark.parametrize("step", [1 / 24, 1 / 60, 1 / 240])
def test_a_long_chain_swings_on(gpu, step):
    """Without air it still swings as far after six periods."""
    _, most = swing(gpu, 8, 1.0, step, 7.2 * period(1.0))
    assert most[6] > 0.9


@pytest.mark.parametrize("k", [0.5, 10])
@pytest.mark.parametrize("shape, allowed", [("bar", 1e-3), ("curl", 5e-3)])
def test_a_groom_is_at_rest(gpu, k, shape, allowed):
    """In 64 directions; tools/motion_laws.py does 512."""
    rng = np.random.default_rng(1)
    strands = [bar(16, rng.normal(size=3)) if shape == "bar" else curl(16, rng) for _ in range(64)]
    hair = Hair(gpu, strands, 9.81 / k, air=5)
    assert gpu.download(hair.soft).sum() == 0
    began = hair.array()
    for _ in range(120):
        hair.step(1 / 60)
    assert max(np.linalg.norm(now - then, axis=1).max() for now, then in zip(hair.array(), began)) < allowed


@pytest.mark.parametrize("damping", [0.02, 0.1])
def test_bent_hair_comes_to_rest(gpu, damping):
    """Strands of 5 cm that are groomed with a sharp bend in one joint, as where the body turned it, or in all."""
    bends = [np.where(np.arange(7) == joint, angle, 5) for angle in (50, 80, 110, 140) for joint in range(7)]
    bends += [angle * (-1.0) ** np.arange(7) for angle in (50, 80, 110)]
    strands = []
    for angles in bends:
        turn = np.radians(np.concatenate([[90], 90 + np.cumsum(angles)]))
        along = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
        strands.append(np.vstack([np.zeros(3), np.cumsum(along, 0)]) * 0.05 / 8)
    hair = Hair(gpu, strands, 9.81 * 0.06**3, air=4, damping=damping)
    began = hair.array()
    for number in range(360):
        hair.step(1 / 120, (0.1, 0, 0.1) if number < 12 else (0, 0, 0))
    assert np.abs(np.concatenate(hair.array("speeds"))).max() < 1e-3 * 0.05
    assert max(np.abs(now - then).max() for now, then in zip(hair.array(), began)) < 1e-3 * 0.05


@pytest.mark.parametrize("step", [1.0, 1 / 24, 1 / 240])
@pytest.mark.parametrize("far", [0.3, 100])
def test_a_shaken_head_keeps_its_hair(gpu, step, far):
    rng = np.random.default_rng(2)
    hair = Hair(gpu, [curl(8, rng) for _ in range(20)], 0.1, air=5)
    root = hair.root
    for _ in range(20):
        root = shaken(root, rng, far)
        hair.step(step, (100, 0, 0), root)
    assert np.isfinite(np.concatenate(hair.array())).all() and hair.stretch() < 1e-5
    for _ in range(round(10 / max(step, 1 / 60))):
        hair.step(max(step, 1 / 60))
    assert np.abs(np.concatenate(hair.array("speeds"))).max() < 0.1


def test_shorter_steps_are_nearer(gpu):
    """In violent gusts twice as many steps err by less than half as much; tools/motion_laws.py goes further."""
    tips = {rate: blown(gpu, rate, 1) for rate in (120, 240, 960)}
    far, near = (np.linalg.norm(tips[rate] - tips[960], axis=2).max(0) for rate in (120, 240))
    assert (far > 2 * near).all() and far.max() < 0.05 and np.ptp(tips[960], axis=0).max() > 0.5


@pytest.mark.parametrize("segments, allowed", [(16, 0.01), (32, 0.003)])
def test_a_soft_bar_hangs(gpu, segments, allowed):
    k, drop = SOFTEST
    hair = Hair(gpu, [bar(segments)], 9.81 / k, air=5, weighted=False)
    for _ in range(300):
        hair.step(1 / 60)
    assert -hair.array()[0][-1, 1] == pytest.approx(drop, rel=allowed)


def test_a_bar_bends_alike_by_any_step(gpu):
    drops = []
    for step in (1 / 24, 1 / 60, 1 / 240):
        hair = Hair(gpu, [bar(8)], 9.81 / 5, air=5, weighted=False)
        for _ in range(round(5 / step)):
            hair.step(step)
        drops.append(-hair.array()[0][-1, 1])
    assert np.ptp(drops) < 0.001 * drops[0]


def test_limp_hair_leans_with_the_wind(gpu):
    """Steadily by atan(wind · air / g)."""
    hair = Hair(gpu, [bar(8, (0, -1, 0))], 0.0, air=4, weighted=False)
    for _ in range(900):
        hair.step(1 / 60, (2.5, 0, 0))
    tip = hair.array()[0][-1]
    assert np.degrees(np.arctan2(tip[0], -tip[1])) == pytest.approx(np.degrees(np.arctan(4 * 2.5 / 9.81)), abs=0.01)


@pytest.mark.parametrize("order, ways", [(1, 1e-4), (2, 0.03)])
@pytest.mark.parametrize("bend", [0.2, 0.0])
def test_energy_does_not_grow(gpu, bend, order, ways):
    """Of a bar that is let go from the level, without air: above its start, or in any step."""
    hair = Hair(gpu, [bar(16)], bend, weighted=False)
    energies = [next(hair.energy(bend))]
    for _ in range(240):
        hair.order = min(hair.order, order)
        energies.append(next(hair.step(1 / 240).energy(bend)))
    energies = np.array(energies) / 9.81
    assert energies.max() < energies[0] + (0.01 if order == 2 else 1e-4) and np.diff(energies).max() < ways


def test_the_same_bits_with_any_neighbours(gpu):
    rng = np.random.default_rng(6)
    strands = uneven(rng, (5, 9, 2, 12, 3, 9, 4, 6, 7, 33))

    def run(which):
        hair, rng = Hair(gpu, [strands[i] for i in which], 0.5, 2, 0.03, 0.3), np.random.default_rng(7)
        root = hair.root
        for _ in range(6):
            root = root.copy()
            root[0] += rng.normal(size=3)[:, None] * 0.05
            hair.step(1 / 60, (1, 0, 0), root)
        return hair.array()
    together = run(range(10))
    for i in range(10):
        assert (run([i])[0] == together[i]).all()


@pytest.mark.small
def test_points_are_put_where_strands_are(gpu):
    hair = Hair(gpu, uneven(np.random.default_rng(8), (4, 2, 6)), 0.5, air=2)
    hair.step(1 / 30, (3, 0, 0))
    packed, normals = map(gpu.download, motion.place_points(gpu, hair.state, hair.roots, hair.drawn))
    where = np.concatenate([now + each[0] for now, each in zip(hair.array(), hair.strands)])
    np.testing.assert_allclose(packed, where, rtol=0, atol=1e-6)
    assert (normals == hair.root[3, :, :3].T).all() and np.abs(packed - np.concatenate(hair.strands)).max() > 1e-3


@pytest.mark.small
@pytest.mark.parametrize("carried, jumped", [(0, False), (0.7, False), (1, False), (0, True)])
def test_within_a_step_is_the_twins(gpu, carried, jumped):
    """Strands of many lengths whose roots move and turn, at shares of a step; at its ends what was there."""
    rng = np.random.default_rng(6)
    strands = uneven(rng, (5, 9, 2, 7, 3, 1, 4, 6, 8))
    hair = Hair(gpu, strands, 0.5, carried=carried)
    hair.step(1 / 60, (1, 2, 0), shaken(hair.root, rng, 0.02))
    then, root, roots = motion.remember(gpu, hair.state), gpu.download(hair.roots), [hair.roots]
    placed = [hair.array(name) for name in ("places", "speeds")]
    ends = root, shaken(root, rng, 0.02), shaken(root, rng, 0.02)
    hair.step(1 / 60, (-1, 0, 2), ends[1], jumped=jumped)
    roots += [gpu.upload(each) for each in ends[1:]]
    carried = 1 if jumped else carried
    for share in 0, 0.3, 1:
        there = ends[{0: 0, 0.3: 2, 1: 1}[share]]
        points, normals = (gpu.download(each) for each in motion.between(
            gpu, hair.state, hair.types, hair.drawn, then, (*roots[:2], gpu.upload(there)), share, 1 / 60, jumped))
        np.testing.assert_array_equal(normals, there[3, :, :hair.n].T)
        first = 0
        for i, each in enumerate(hair.strands):
            frames = [(rows[0, :, i].astype(float), rows[1:, :, i].astype(float)) for rows in (*ends[:2], there)]
            lengths = np.linalg.norm(np.diff(each.astype(float), axis=0), axis=1)
            now = hair.array()[i], hair.array("speeds")[i]
            meant = twin.between([part[i] for part in placed], now, frames, share, 1 / 60, carried, lengths)
            found = points[first:first + len(each)].astype(float)
            first += len(each)
            np.testing.assert_allclose(found, meant, rtol=0, atol=1e-5)
            if share != 0.3:
                np.testing.assert_allclose(found - frames[2][0], (now if share else [part[i] for part in placed])[0],
                                           rtol=0, atol=1e-5)
            np.testing.assert_allclose(np.linalg.norm(np.diff(found - found[:1], axis=0), axis=1), lengths, atol=1e-6)


@pytest.mark.small
def test_roots_are_the_twins(gpu):
    """On faces that move and turn, between two poses."""
    rng = np.random.default_rng(9)
    faces, n = 4, 9
    corners, normals = rng.normal(size=(faces, 3, 3)), rng.normal(size=(faces, 3, 3)) * 0.2 + [0, 0, 1]
    moved, turned = corners + rng.normal(size=(faces, 3, 3)) * 0.1, normals + rng.normal(size=(faces, 3, 3)) * 0.1
    face, weights, offsets = rng.integers(0, faces, n), rng.dirichlet([1, 1, 1], n), rng.normal(size=(n, 4)) * 0.1
    feet = np.zeros((n, 4), np.float32)
    feet[:, 1], feet[:, 2:] = face.astype(np.uint32).view(np.uint32).view(np.float32), weights[:, 1:]
    poses = [[gpu.upload(np.pad(each, ((0, 0), (0, 0), (0, 1))).astype(np.float32)) for each in pose]
             for pose in ((corners, normals), (moved, turned))]
    rows = motion.padded(gpu, n)
    roots = gpu.download(motion.place_roots(
        gpu, gpu.upload(feet), gpu.upload(offsets.astype(np.float32)), *poses, 0.25, rows))
    places, axes = twin.roots_on(face, weights, offsets[:, :3], 0.75 * corners + 0.25 * moved,
                                 0.75 * normals + 0.25 * turned)
    np.testing.assert_allclose(roots[0, :, :n].T, places, rtol=0, atol=3e-6)
    np.testing.assert_allclose(roots[1:, :, :n].transpose(2, 0, 1), axes, rtol=0, atol=3e-6)
