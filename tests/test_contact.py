"""Hair in motion that touches the body: against its twin, and what must hold (tools/motion_laws.py has longer runs)."""

import numpy as np
import pytest
from support.hair import G, Hair, ball, bar, body_of, depths, fallen, look_of, shot

from clfur.stages import distance, motion
from clfur.twin import contact
from clfur.twin import motion as twin


def turn(angle, axis=(0, 0, 1)):
    """A rotation [3, 3] (Rodrigues)."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


@pytest.mark.parametrize("friction, deforms, carried", [
    (0, False, 0), (0.3, False, 0.4), (2, False, 0), pytest.param(0.3, True, 0, marks=pytest.mark.small)])
def test_a_step_is_the_twins(gpu, friction, deforms, carried, monkeypatch):
    """Strands that lie on a ball, fall on it and are hit by it, which moves and turns, while their roots do."""
    rng = np.random.default_rng(3)
    monkeypatch.setattr(distance, "NODES", 14)
    body = ball(gpu, 0.5, 1)
    strands = [np.array([x, 0.62, z]) + bar(n, (rng.normal(), -0.6, rng.normal())) * 0.5
               for n, x, z in zip((4, 6, 3, 5, 6), *rng.uniform(-0.35, 0.35, (2, 5)))]
    hair = Hair(gpu, strands, 0.05, 2, 0.02, carried, body=motion.Felt(body, motion.RESTING), friction=friction,
                width=0.02)
    cell = float(body.grid["reach"][1])
    twins = [twin.Strand(each, axes, 0.05, G, 2, 0.02, carried, contact.Contact(
        look_of(gpu, body), each, np.full(len(each), 0.02), cell, friction))
        for each, axes in zip(hair.strands, hair.axes)]
    at, rotation, root, touched = np.zeros(3), np.eye(3), hair.root, 0
    for number in range(6):
        before, root = root, root.copy()
        root[0, 0] += 0.003
        root[1:, :, :hair.n] = np.einsum("ij,ajn->ain", turn(0.01), root[1:, :, :hair.n])
        was, at, spin = at, at + [0.004, 0.01, 0], turn(0.02)
        rotation = spin @ rotation
        carry = np.column_stack([spin, at - spin @ was])
        hair.step(1 / 60, root=root, body=motion.Felt(body, motion.body_at(rotation, at, carry, 1e-4, deforms)))
        for i, each in enumerate(twins):
            now, then = ((rows[0, :, i].astype(float), rows[1:, :, i].astype(float)) for rows in (root, before))
            each.advance(now, then, 1 / 60, (0, 0, 0), min(number + 1, 2),
                         body=(look_of(gpu, body, rotation, at), carry, 1e-4, deforms))
            touched += each.contact.touched
    assert touched > 5
    pressed, free = hair.array("pressed"), gpu.download(hair.state.free).reshape(hair.state.points, -1)
    for i, (now, speed, each) in enumerate(zip(hair.array(), hair.array("speeds"), twins)):
        # Rounding of float32, of which a contact's spring makes more.
        np.testing.assert_allclose(now, each.places, rtol=0, atol=3e-5)
        np.testing.assert_allclose(speed, each.speeds, rtol=0, atol=5e-3)
        np.testing.assert_allclose(pressed[i][1:], each.contact.forces[1:], rtol=0, atol=0.02)
        np.testing.assert_allclose(free[1:len(now), i], each.contact.free[1:], rtol=0, atol=3e-5)


@pytest.mark.parametrize("rate", [24, 60, 240])
def test_a_fast_ball_never_passes_through(gpu, rate):
    """A ball at 20 lengths a second through hair that hangs: no point inside, in any substep."""
    hair, nearest, fastest = shot(gpu, rate)
    assert nearest > 0 and fastest > 10 and hair.stretch() < 1e-5


@pytest.mark.parametrize("friction", [0.3, 1])
def test_hair_that_lies_on_a_ball_rests(gpu, friction):
    """After 5 s at 1/120 s; where it lies, friction has held it."""
    hair = fallen(gpu, ball(gpu, 2.5, 5), 200, friction=friction)
    for _ in range(600):
        hair.step(1 / 120)
    speeds = np.array([np.linalg.norm(each, axis=1).max() for each in hair.array("speeds")])
    assert np.quantile(speeds, 0.9) < 1e-3 and speeds.max() < 0.05
    # Half a width off, but for what a ball of flat faces lacks.
    assert 0.0035 < depths(hair, 2.5).min() < 0.005 and hair.stretch() < 1e-5
    assert (gpu.download(hair.state.pressed).reshape(-1, 3, hair.state.padded)[1:] != 0).any(1).mean() > 0.02


def test_friction_holds_and_lets_slip(gpu):
    """Limp hair that lies level across a slope of 30 degrees: held by friction above tan 30, else it slides."""
    x, y, z = np.meshgrid((-2, 2), (-1, 0), (-2, 2), indexing="ij")
    slab = body_of(gpu, np.stack([x, y, z], -1).reshape(-1, 3), [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
        (1, 5, 7), (1, 7, 3)])
    slope = turn(np.pi / 6)
    lies = (bar(6, (0, 0, 1)) + [0, 0.0105, 0]) @ slope.T
    ways = {}
    for friction in (0.45, 0.7):
        hair = Hair(gpu, [lies] * 3, 1e-6, 5, weighted=False, friction=friction, width=0.02,
                    body=motion.Felt(slab, motion.body_at(slope, np.zeros(3))))
        for _ in range(240):
            hair.step(1 / 120)
        ways[friction] = np.linalg.norm(hair.array()[0] - (lies - lies[0]), axis=1).max()
        heights = (hair.array()[0] + lies[0]) @ slope
        assert heights[1:, 1].min() > 0.0099
    assert ways[0.7] < 2e-3 and ways[0.45] > 0.1


@pytest.mark.parametrize("k", [0.5, 10])
def test_a_groom_close_to_the_body_is_at_rest(gpu, k):
    """Hair that was groomed along a ball, nearer than its width, and some of it inside."""
    rng, radius = np.random.default_rng(4), 2.0
    ways = rng.normal(size=(64, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    strands = []
    for way, height in zip(ways, np.linspace(-0.01, 0.01, 64)):
        side = np.cross(way, rng.normal(size=3))
        side /= np.linalg.norm(side)
        a = np.linspace(0, 1 / radius, 17)[:, None]
        strands.append((radius + height) * (np.cos(a) * way + np.sin(a) * side))
    hair = Hair(gpu, strands, 9.81 / k, air=5, body=motion.Felt(ball(gpu, radius), motion.RESTING), friction=0.3,
                width=0.02)
    began, deepest = hair.array(), gpu.download(hair.deepest)[:64]
    assert deepest.min() < -0.008 and deepest.max() > 0.008
    for _ in range(120):
        hair.step(1 / 60)
    assert max(np.linalg.norm(now - then, axis=1).max() for now, then in zip(hair.array(), began)) < 1e-3


def test_the_same_bits_with_any_neighbours_and_lanes(gpu, another):
    body = ball(gpu, 2.5)

    def run(gpu, body, which):
        hair = fallen(gpu, body, 20)
        if which is not None:
            strands = [hair.strands[i] for i in which]
            hair = Hair(gpu, strands, 9.81 * 0.3**3, 5, 0.02, weighted=False, body=hair.body, friction=0.3, width=0.01)
        for number in range(80):
            at = np.array([0.01 * number, 0, 0])
            carry = np.column_stack([np.eye(3), (0.01, 0, 0)])
            hair.step(1 / 60, body=motion.Felt(body, motion.body_at(np.eye(3), at, carry)))
        return hair.array(), hair.array("pressed")
    together, forces = run(gpu, body, None)
    assert sum((each != 0).any() for each in forces) > 5
    for i in (0, 5, 19):
        alone, force = run(gpu, body, [i])
        assert (alone[0] == together[i]).all() and (force[0][1:] == forces[i][1:]).all()
    for lanes in {1, 8, 16} - {gpu.lanes}:
        other = another(lanes=lanes, device=gpu.device)
        assert all((a == b).all() for a, b in zip(run(other, ball(other, 2.5), None)[0], together))
