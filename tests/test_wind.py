"""wind against its twin, and the laws of what it bends."""

import numpy as np
import pytest
from support.hair import G, Hair, axes_of, uneven

import clfur
from clfur.stages import motion, wind
from clfur.stages.strands import upload_curves
from clfur.twin import wind as twin

MEAN, GUST, SIZE, TIME, SEED = (1.5, -0.5, 3), 2.0, 0.7, 12.3, 5


@pytest.mark.small
@pytest.mark.parametrize("longest, skin", [(0, 0), (1, 0), (1, 0.2)])
def test_wind_is_the_twins(gpu, longest, skin):
    """At roots, or at each point of long hair, and less beside the skin."""
    hair = Hair(gpu, uneven(np.random.default_rng(10), (4, 2, 6, 3, 3)), 0.5)
    moment = wind.moment(MEAN, GUST, SIZE, TIME, SEED, skin, longest=longest)
    state = hair.state
    winds = gpu.download(wind.blow(gpu, moment, hair.roots, state.places, state.points, state.padded))
    winds = winds.reshape(state.points, 3, -1)
    for i, places in enumerate(hair.array()):
        where = hair.root[0, :, i] + places if longest else hair.root[0, :, [i] * len(places)]
        there = twin.wind_at(where, MEAN, GUST, SIZE, TIME, SEED)
        there *= twin.held(places, hair.root[3, :, i], skin)[:, None] if skin else 1
        np.testing.assert_allclose(winds[1:len(places), :, i], there[1:], rtol=0, atol=3e-4)   # cells away from 0
        assert (winds[0, :, i] == 0).all()
    assert skin or np.ptp(winds[1, :, :hair.n], axis=1).min() > 0.1


def _slab(rng, n=4000, width=0.004):
    """Hair across x, at random in a block of 1 x 1 x 1 around 0: it covers what comes along x so often in all."""
    middles = rng.uniform(-0.5, 0.5, (n, 1, 3))
    points = middles + np.array([[[0, 0, -0.05]], [[0, 0, 0]], [[0, 0, 0.05]]]).transpose(1, 0, 2)
    return clfur.Curves(points.astype(np.float32), width=width), n * width * 0.1


@pytest.mark.small
def test_hair_upwind_is_the_twins(gpu):
    rng = np.random.default_rng(11)
    curves, _ = _slab(rng, 300, 0.02)
    direction = np.array((0.6, 0, 0.8))
    strands, most = upload_curves(gpu, curves), (900, 90.0, 2.0)
    there = wind.upwind(gpu, direction, (np.zeros(3), 1.0), strands, most, 1, cells=16)
    hair = Hair(gpu, [each * 0.3 for each in uneven(rng, (4, 2, 6, 3, 3))], 0.5)
    state, moment = hair.state, wind.moment(direction, shelter=0.7)
    shares = wind.shelter(gpu, moment, there, hair.roots, state.places, state.points, state.padded)
    winds = gpu.download(wind.blow(gpu, moment, hair.roots, state.places, state.points, state.padded, shares))
    shares = gpu.download(shares).reshape(state.points, -1)
    for i, places in enumerate(hair.array()):
        crossed = twin.crossings(there[0], gpu.download(there[1]), hair.root[0, :, i] + places)
        np.testing.assert_allclose(shares[1:len(places), i], np.exp(-0.7 * crossed)[1:], rtol=0, atol=3e-6)
        blown = winds.reshape(state.points, 3, -1)[1:len(places), 0, i]
        np.testing.assert_allclose(blown, 0.6 * shares[1:len(places), i], rtol=1e-6)
    assert np.ptp(shares[1, :hair.n]) > 0.1


def test_shelter_is_what_covers_the_way(gpu):
    """exp(-shelter x) of the wind is left behind hair that covers its way x times; half of that in its middle."""
    curves, covers = _slab(np.random.default_rng(12))
    strands, most = upload_curves(gpu, curves), (8000, 400.0, 2.0)
    there = wind.upwind(gpu, np.array((1.0, 0, 0)), (np.zeros(3), 1.0), strands, most, 1)
    places = np.array([(x, y, z) for x in (-0.6, 0.0, 0.6) for y in np.linspace(-0.4, 0.4, 41)
                       for z in np.linspace(-0.4, 0.4, 41)])
    found = twin.crossings(there[0], gpu.download(there[1]), places).reshape(3, -1).mean(1)
    # 1,681 places of the slab's random hair; its two edges stand 0.1 in front of and behind the places at the ends.
    np.testing.assert_allclose(found, [0, covers / 2, covers], rtol=0.03, atol=1e-6)


@pytest.mark.small
def test_shells_sway_as_the_twin(gpu):
    """In wind, on roots that move and turn, two of them past each other's damping; what is pushed in stays out."""
    rng = np.random.default_rng(13)
    n, step, length = 5, 1 / 60, 0.3
    rows = motion.padded(gpu, n)
    state = wind.Leans.empty(gpu, {"vector": 3 * rows}, n=n, padded=rows)
    axes = [axes_of(rng.normal(size=3)) for _ in range(n)]
    root = np.zeros((4, 3, rows), np.float32)
    for i in range(n):
        root[0, :, i], root[1:, :, i] = rng.normal(size=3), np.roll(axes[i], -1, 0)
    rest = np.zeros((3, rows), np.float32)
    rest[:, :n] = rng.normal(size=(3, n)) * 0.2
    state.rest[:] = gpu.upload(rest.ravel())
    weight = np.einsum("axn,x->an", root[1:], G).astype(np.float32)
    state.weight[:] = gpu.upload(weight.ravel())
    hair = (0.05, 3.0, 0.01, 0.7, length)
    twins = [twin.Lean(root[1:, :, i].astype(float), rest[:, i], G, *hair) for i in range(n)]
    velocity = np.array((4.0, -1, 2))
    for number in range(5):
        before, root = root, root.copy()
        root[0] += rng.uniform(-0.05, 0.05, root[0].shape)
        for i in range(n):
            root[1:, :, i] = root[1:, :, i] @ np.linalg.qr(rng.normal(size=(3, 3)) * 0.1 + np.eye(3))[0]
        roots, roots_before = gpu.upload(root), gpu.upload(before)
        winds = wind.blow(gpu, wind.moment(velocity), roots, wind.stand(gpu, roots, length, rows), 2, rows)
        out = gpu.download(wind.sway(gpu, state, roots, roots_before, step, G, winds, hair, number == 3))
        for i, each in enumerate(twins):
            ends = ((rows_[0, :, i].astype(float), rows_[1:, :, i].astype(float)) for rows_ in (root, before))
            leans = each.advance(*ends, step, G, velocity, number == 3)
            np.testing.assert_allclose(out[i], leans, rtol=2e-5, atol=2e-5)
    assert np.abs(out).max() > 0.5 and min(each.lean[2] + each.rest[2] for each in twins) < -0.9


@pytest.mark.small
def test_between_two_leans(gpu):
    before, now = np.random.default_rng(15).normal(size=(2, 5, 3)).astype(np.float32)
    found = [gpu.download(wind.lean_between(gpu, gpu.upload(before), gpu.upload(now), share)) for share in (0, 0.25, 1)]
    np.testing.assert_allclose(found, [before, 0.75 * before + 0.25 * now, now], rtol=0, atol=1e-6)


@pytest.mark.parametrize("w, zeta", [(5, 0), (30, 0.1), (20, 1), (12, 3), (400, 60)])
def test_a_step_in_parts_is_the_same(w, zeta):
    """About a target that stays: one step is two of half of it, or a hundred; and a long one is at rest."""
    def matrix(step):
        return np.reshape(wind.onward(w, zeta, step), (2, 2))
    for step in (1e-3, 1 / 120, 1 / 24, 1.0):
        for parts in (2, 100):
            there = np.linalg.matrix_power(matrix(step / parts), parts)
            np.testing.assert_allclose(there, matrix(step), rtol=1e-6, atol=1e-6 * (1 + w))
    assert zeta == 0 or np.abs(matrix(1e4)).max() < 1e-6
    # Energy of what swings freely stays; all else loses some.
    energy = np.diag([w * w, 1.0])
    lost = energy - matrix(0.03).T @ energy @ matrix(0.03)
    assert np.linalg.eigvalsh(lost / np.sqrt(np.outer([w * w, 1], [w * w, 1]))).min() > -1e-9


def test_shells_swing_and_bend_as_strands_do():
    """Their lean, as the slowest wave of a clamped bar in finite differences, and its tip under a small load."""
    bend, length, force, n = 0.3, 0.2, 1e-3, 200
    w, zeta, by = wind.oscillator(bend, 0.0, 0.0, length)
    # Curvature at the clamp, half a place's share of it, and at the n places but the free end.
    curved = np.eye(n, k=1) - 2 * np.eye(n) + np.eye(n, k=-1)
    curved = np.vstack([np.sqrt(2) * np.eye(1, n), curved[:-1]]) / (length / n)**2
    stiff = bend * curved.T @ curved
    assert w == pytest.approx(np.sqrt(np.linalg.eigvalsh(stiff)[0]), rel=0.01) and zeta == 0
    assert by * force * length / 2 == pytest.approx(np.linalg.solve(stiff, np.full(n, force))[-1], rel=0.01)
