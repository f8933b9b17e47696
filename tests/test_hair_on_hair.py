"""clfur.Motion(hair_on_hair=...): grooms at rest, piles that keep their volume, hair that moves as one."""

import numpy as np
import pytest
from support.piles import ball, densities, points, scene_of, wall

import clfur


def test_a_groom_is_at_rest(gpu):
    """As it is without other hair, which it touches everywhere."""
    scene = scene_of(ball(), 4000)
    motion = clfur.Motion(scene, device=gpu, hair_on_hair=0.05)
    began = points(motion.at(0))
    cells = densities(began, 0.12)
    assert np.median(cells) * 0.0375 / 0.12 > 3
    assert np.abs(points(motion.at(12)) - began).max() < 1e-5


@pytest.mark.parametrize("move", ["goes", "turns"])
def test_a_groom_that_goes_with_its_body_stays(gpu, move):
    """The grid goes along; as a body turns in it, it sees other densities, by less than what is allowed."""
    def at(t):
        return scene_of(ball((4000 * t, 300 * t, 0)) if move == "goes" else ball(turn=2 * t), 4000)
    motion = clfur.Motion(at, clfur.HairMotion(inertia=0, bend_length=0.3), gpu, gravity=(0, 0, 0), jump=1e6,
                          rate=480 if move == "turns" else 120, hair_on_hair=0.05)
    began, now = points(motion.at(0)), points(motion.at(6))
    if move == "turns":
        c, s = np.cos(0.5), np.sin(0.5)
        began = began @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    assert np.abs(now - began).max() < 3e-3   # a hundredth of its length


def test_a_pile_keeps_its_volume(gpu):
    """Limp hair that stands level from a wall falls to it: without other hair into a sheet."""
    after = {}
    for seconds in (None, 0.1):
        with pytest.warns(RuntimeWarning, match="too soft"):
            motion = clfur.Motion(scene_of(wall(), 2000), clfur.HairMotion(bend_length=0.05), gpu,
                                  hair_on_hair=seconds)
        began = points(motion.at(0))
        now = points(motion.at(60))
        thick = np.ptp(np.percentile(now[:, 1:, 0], [5, 95]))
        after[seconds] = (densities(now) / densities(began)).mean(), thick
        assert np.abs(points(motion.at(61)) - now).max() * 24 < 0.05   # it rests
    (alone, sheet), (dense, thick) = after[None], after[0.1]
    assert alone > 2.2 and dense < 1.4 and thick > 4 * sheet


def test_a_shaken_head_keeps_its_hair(gpu):
    rng, turn = np.random.default_rng(1), 0.0
    motion = clfur.Motion(scene_of(ball(), 2000), clfur.HairMotion(bend_length=0.1, air=None, damping=0), gpu, jump=1e6,
                          hair_on_hair=0.02)
    began = np.linalg.norm(np.diff(points(motion.at(0)), axis=1), axis=2)
    with pytest.warns(RuntimeWarning, match="32 substeps"):
        for _ in range(4):
            turn += 1
            now = points(motion.step(rng.choice([1.0, 1 / 24]), ball(rng.uniform(-5, 5, 3), turn)))
    assert np.abs(np.linalg.norm(np.diff(now, axis=1), axis=2) / began - 1).max() < 1e-4
    assert np.abs(now).max() < 1.31


def test_other_hair_takes_hair_along(gpu):
    """Of two halves of a head of hair, one is blown at: the sooner hair takes the speed of the other, the less
    apart."""
    motions = [clfur.Motion(scene_of(ball(), 3000), clfur.HairMotion(bend_length=0.15), gpu, hair_on_hair=seconds,
                            wind=clfur.Wind((2, 0, 0), gust=2, size=0.1)) for seconds in (None, 0.3, 0.02)]
    apart = []
    for motion in motions:
        began = points(motion.at(0))
        tips = (points(motion.at(8)) - began)[:, -1]
        near = np.linalg.norm(began[:, None, 0] - began[None, :300, 0], axis=2) < 0.06
        apart.append(np.mean([tips[near[:, i]].std(0).mean() for i in range(300) if near[:, i].sum() > 2]))
    assert apart[0] > 1.1 * apart[1] > 1.2 * apart[2]


def test_what_is_refused(gpu):
    for value in 0, -1, "0.1", True:
        with pytest.raises(clfur.Error, match="Motion.hair_on_hair is"):
            clfur.Motion(scene_of(ball(), 10), device=gpu, hair_on_hair=value)
