"""hair_grid against its twin, and the laws of a grid: sums, momentum, order, one strand alone."""

import numpy as np
import pytest
from support.hair import G, Hair, bar, curl

from clfur.stages import hair_grid
from clfur.twin import hair_grid as twin
from clfur.twin import motion as strand_twin

STEP, FRICTION = 1 / 60, 20.0
CELL, GRID = 0.15, hair_grid.grid_around((-1.2,) * 3, (1.2,) * 3, 0.15)


def tangle(n, seed=0):
    """Curls and a few shorter strands around the middle, [strands][points, 3]."""
    rng = np.random.default_rng(seed)
    return [(0.5 * curl(8, rng) + rng.normal(size=3) * 0.04)[:9 if i % 5 else 6] for i in range(n)]


def moved(gpu, strands):
    """Two steps on, of which the second has more wind."""
    return Hair(gpu, strands, 0.5, 1).step(STEP, (9, 0, 0)).step(STEP, (9, 0, 30))


def points_of(hair, ahead=0):
    """Places [n, 3], masses [n] and speeds [n, 3] of all free points."""
    places = np.concatenate([now[1:] + each[0] for now, each in zip(hair.array(), hair.strands)])
    lengths = [np.append(np.linalg.norm(np.diff(each.astype(float), axis=0), axis=1), 0) for each in hair.strands]
    now, then = (np.concatenate([each[1:] for each in hair.array(name)]) for name in ("speeds", "speeds_before"))
    return places, np.concatenate([(each[:-1] + each[1:]) / 2 for each in lengths]), now + ahead * (now - then)


def unit_of(hair):
    return hair_grid.mass_unit(len(np.concatenate(hair.strands)), max(points_of(hair)[1]))


def gathered(gpu, hair, ahead=False, grid=GRID):
    """The sums, and the averages, on the device."""
    unit = unit_of(hair)
    sums = hair_grid.deposit(gpu, hair.state, hair.roots, grid, unit, STEP, ahead)
    return sums, hair_grid.average(gpu, sums, grid, unit, STEP)


def felt_by(gpu, hair, groomed, cells, push=0.0, rub=0.0, grid=GRID):
    return hair_grid.feel(gpu, hair.state, hair.roots, groomed, grid, cells, FRICTION, push, rub, 40.0)


def rows_of(gpu, hair, felt, rows=4):
    """[n, rows] of all free points, strand after strand."""
    there = gpu.download(felt).reshape(hair.state.points, rows, -1)
    return np.concatenate([there[1:len(each), :, i] for i, each in enumerate(hair.strands)]).astype(float)


@pytest.mark.small
@pytest.mark.parametrize("ahead", [False, True])
def test_a_grid_is_the_twins(gpu, ahead):
    """Points are snapped to 1/1024 of a cell, which is what allows for."""
    hair = moved(gpu, tangle(60))
    cells = gpu.download(gathered(gpu, hair, ahead)[1]).reshape(*GRID.size[::-1], 4).transpose(2, 1, 0, 3)
    velocity, density = twin.grid_of(*points_of(hair, ahead), GRID.low, CELL, GRID.size)
    assert density.max() > 4 and np.abs(velocity).max() > 0.1
    np.testing.assert_allclose(cells[..., 3], density, rtol=0, atol=2e-3 * density.max())
    np.testing.assert_allclose(cells[..., :3], velocity * np.clip(density - twin.ALONE, 0, 1)[..., None], rtol=0,
                               atol=3e-3 * np.abs(velocity).max())


@pytest.mark.small
def test_what_points_feel_is_the_twins(gpu):
    hair = moved(gpu, tangle(60))
    cells = gathered(gpu, hair)[1]
    densities = hair_grid.density(gpu, hair.state, hair.roots, GRID, cells)
    places, masses, speeds = points_of(hair)
    velocity, density = twin.grid_of(places, masses, speeds, GRID.low, CELL, GRID.size)
    now = twin.density_at(places, density, GRID.low, CELL)[0]
    np.testing.assert_allclose(rows_of(gpu, hair, densities, 1)[:, 0], now, rtol=0, atol=2e-3 * now.max())
    felt = rows_of(gpu, hair, felt_by(gpu, hair, densities * np.float32(0.5), cells, 30.0, 5.0))
    pull, friction = twin.felt_at(places, now / 2, velocity, density, GRID.low, CELL, FRICTION, 30.0, 5.0, 40.0)
    # Those near where a push begins are let off.
    sure = np.abs(now / (twin.DENSER * np.maximum(now / 2, twin.ALONE)) - 1) > 0.01
    assert sure.mean() > 0.8 and (friction > FRICTION).any() and (friction < FRICTION).any()
    np.testing.assert_allclose(felt[sure, :3], pull[sure], rtol=0, atol=0.01 * np.abs(pull).max())
    np.testing.assert_allclose(felt[sure, 3], friction[sure], rtol=0, atol=0.01 * friction.max())


@pytest.mark.small
def test_a_step_that_feels_hair_is_the_twins(gpu):
    strands, rng = tangle(4), np.random.default_rng(2)
    hair = Hair(gpu, strands, 0.5, 1, 0.02)
    twins = [strand_twin.Strand(each, axes, 0.5, G, 1, 0.02) for each, axes in zip(hair.strands, hair.axes)]
    felt = np.zeros((9, 4, hair.state.padded), np.float32)
    felt[:, :, :4] = rng.uniform(-3, 30, (9, 4, 4))
    felt[:, 3] = np.abs(felt[:, 3])
    for number in range(3):
        hair.step(STEP, of_hair=gpu.upload(felt))
        for i, each in enumerate(twins):
            root = np.zeros(3), hair.axes[i]
            each.advance(root, root, STEP, (0, 0, 0), min(number + 1, 2), of_hair=(felt[:, :3, i], felt[:, 3, i]))
    for now, each, groomed in zip(hair.array(), twins, strands):
        assert np.abs(now - groomed + groomed[0]).max() > 5e-3
        np.testing.assert_allclose(now, each.places, rtol=0, atol=3e-5)


@pytest.mark.small
def test_friction_gives_what_it_takes(gpu):
    """Momentum, by the speeds that were deposited, is that of all hair before and after; a push keeps none."""
    hair = moved(gpu, tangle(60))
    cells = gathered(gpu, hair)[1]
    groomed = hair_grid.density(gpu, hair.state, hair.roots, GRID, cells)
    _, masses, speeds = points_of(hair)
    felt = rows_of(gpu, hair, felt_by(gpu, hair, groomed, cells))
    forces = masses[:, None] * (felt[:, :3] - felt[:, 3:] * speeds)
    cut = CELL / STEP / hair_grid.SPEEDS / 2   # of a speed, in whole units
    assert np.abs(forces.sum(0)).max() < 1e-4 * np.abs(forces).sum() + FRICTION * masses.sum() * cut
    assert np.abs(forces).sum() > 1


@pytest.mark.small
def test_what_moves_as_one_is_not_held_back(gpu):
    """All hair at one speed, which grows: it feels none of the friction that it would at another."""
    hair = Hair(gpu, tangle(60), 0.5)
    now, then = np.array([3.0, -1, 7]), np.array([2.0, -1.5, 7])
    for name, speed in ("speeds", now), ("speeds_before", then):
        rows = np.broadcast_to(speed[:, None], (hair.state.points, 3, hair.state.padded)).astype(np.float32).ravel()
        getattr(hair.state, name).set(rows, hair.gpu.queue)
    for ahead, speed in (False, now), (True, 2 * now - then):
        cells = gathered(gpu, hair, ahead)[1]
        groomed = hair_grid.density(gpu, hair.state, hair.roots, GRID, cells)
        felt = rows_of(gpu, hair, felt_by(gpu, hair, groomed, cells, 30.0, 5.0))
        assert felt[:, 3].max() == pytest.approx(FRICTION, rel=1e-5)
        cut = CELL / STEP / hair_grid.SPEEDS   # of a speed, in whole units
        np.testing.assert_allclose(felt[:, :3], felt[:, 3:] * speed, rtol=1e-5, atol=FRICTION * cut)


@pytest.mark.small
def test_the_same_bits_in_any_order_and_lanes(gpu, another):
    """Of strands, and with and without 64-bit atomics."""
    strands = tangle(70)
    mixed = np.random.default_rng(3).permutation(70)
    one, *others = moved(gpu, strands), moved(gpu, [strands[i] for i in mixed])
    there = one.state
    sums, cells = gathered(gpu, one)
    assert (gpu.download(gathered(gpu, others[0])[0]) == gpu.download(sums)).all()
    felt = gpu.download(felt_by(gpu, one, there.lengths * np.float32(0), cells, 30.0, 5.0)).reshape(9, 4, -1)
    dense = gpu.download(hair_grid.density(gpu, there, one.roots, GRID, cells)).reshape(9, -1)
    for built in {"lanes": 1}, {"lanes": 1, "int64_atomics": False}, {"int64_atomics": False}:
        device = another(**built)
        same = Hair(device, strands, 0.5, 1)
        for name in "places", "speeds", "speeds_before", "lengths":
            rows = gpu.download(getattr(there, name)).reshape(-1, there.padded)[:, :70]
            to = device.download(getattr(same.state, name)).reshape(-1, same.state.padded)
            to[:, :70] = rows
            getattr(same.state, name).set(to.reshape(getattr(same.state, name).shape), device.queue)
        again, cells = gathered(device, same)
        assert (device.download(again) == gpu.download(sums)).all()
        other = device.download(felt_by(device, same, same.state.lengths * np.float32(0), cells, 30.0, 5.0))
        assert (other.reshape(9, 4, -1)[1:, :, :70] == felt[1:, :, :70]).all()
        other = device.download(hair_grid.density(device, same.state, same.roots, GRID, cells)).reshape(9, -1)
        assert (other[:, :70] == dense[:, :70]).all() and dense.max() > 4


@pytest.mark.small
@pytest.mark.parametrize("atomics", [True, False])
def test_no_sum_overflows(gpu, another, atomics):
    """All hair in one cell, faster than a grid takes: exactly what is promised for as many strands as there can be."""
    gpu = gpu if atomics else another(int64_atomics=False)
    strands = [[(0.5, 0.5, 0.5), (0.5, 1.5, 0.5)]] * 40
    hair = Hair(gpu, strands, 0.5)
    for name in "speeds", "speeds_before":
        getattr(hair.state, name).fill(-1e30)
    grid, unit = hair_grid.HairGrid((0, 0, 0), 1.0, (3, 3, 3)), hair_grid.mass_unit(40, 0.5)
    sums = gpu.download(hair_grid.deposit(gpu, hair.state, hair.roots, grid, unit, STEP))
    mass = 40 << 16
    assert sums.reshape(3, 3, 3, 4)[0, 1, 0].tolist() == [-mass << 24] * 3 + [mass] and sums[:, 3].sum() == mass
    for points in 1, 40, 1 << 22, (1 << 22) + 1, 1 << 26, (1 << 31) - 1:
        unit = hair_grid.mass_unit(points, 0.5)
        assert 2**6 <= unit / 2 <= 2**16 and points * int(unit / 2) * hair_grid.FASTEST <= 2**62


@pytest.mark.parametrize("shape", ["bar", "curl"])
def test_one_strand_alone_feels_nothing_of_itself(gpu, shape):
    """Straight or a little curled, in any direction and place, as long as its segments are no longer than a cell."""
    rng, most = np.random.default_rng(4), 0.0
    for _ in range(60):
        strand = (bar(8, rng.normal(size=3)) if shape == "bar" else curl(8, rng)) + rng.uniform(-0.1, 0.1, 3)
        hair = Hair(gpu, [strand], 0.5)
        hair.step(STEP, (5, 0, 0))
        grid = hair_grid.grid_around((-1.2,) * 3, (1.2,) * 3, rng.uniform(0.126, 0.5))
        cells = gathered(gpu, hair, grid=grid)[1]
        most = max(most, gpu.download(cells)[:, 3].max())
        felt = felt_by(gpu, hair, hair.state.lengths * np.float32(0), cells, 30.0, 5.0, grid)
        assert (rows_of(gpu, hair, felt) == 0).all()
    assert 0.8 < most < twin.ALONE


@pytest.mark.small
def test_what_is_outside_gives_and_feels_nothing(gpu):
    hair = moved(gpu, tangle(20))
    grid = hair_grid.HairGrid((-1.2, -1.2, -1.2), CELL, (8, 16, 16))
    sums, cells = gathered(gpu, hair, grid=grid)
    felt = rows_of(gpu, hair, felt_by(gpu, hair, hair.state.lengths * np.float32(0), cells, 30.0, 5.0, grid))
    at = (points_of(hair)[0][:, 0] + 1.2) / CELL - 0.5
    assert (at > 7.001).any() and (felt[at > 7.001] == 0).all() and (felt[at < 6] != 0).any()
    inside = points_of(hair)[1][at < 7].sum()
    assert gpu.download(sums)[:, 3].sum() / unit_of(hair) == pytest.approx(inside, rel=0.01)


def test_a_grid_is_no_larger_than_it_may_be():
    for low, high in ((-1, -1, -1), (1, 1, 1)), ((0, 0, 0), (1e4, 2e-3, 5)), ((5, 5, 5), (5, 5, 5)):
        for cell in 1e-4, 0.01, 3.0:
            grid = hair_grid.grid_around(low, high, cell)
            assert np.prod(grid.size) <= hair_grid.MOST_CELLS and min(grid.size) >= 2
            middle = np.add(grid.low, np.multiply(grid.size, cell / 2))
            np.testing.assert_allclose(middle, np.add(low, high) / 2, atol=1e-9 * np.abs(high).max())
