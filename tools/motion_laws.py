"""Laws of strands that move, longer than the tests': the table of docs/motion.md.

    python tools/motion_laws.py
"""

import sys
from pathlib import Path

import numpy as np

import clfur

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.hair import DROPS, SOFTEST, Hair, ball, bar, blown, curl, depths, fallen, period, shot, swing
from support.piles import densities, points, scene_of, wall


def drops(gpu):
    """How far tips of clamped bars are from the elastica's, in shares of it."""
    for segments in (8, 16, 32):
        for k, exact in (*DROPS.items(), SOFTEST):
            hair = Hair(gpu, [bar(segments)], 9.81 / k, air=5, weighted=False)
            for _ in range(300):
                hair.step(1 / 60)
            yield f"tip of a clamped bar, K = {k}, {segments} segments", f"{-hair.array()[0][-1, 1] / exact - 1:+.2%}"


def drops_by_step(gpu):
    """How much the drop of a tip depends on the step, in shares of it."""
    for k in DROPS:
        found = []
        for step in (1 / 24, 1 / 60, 1 / 240):
            hair = Hair(gpu, [bar(8)], 9.81 / k, air=5, weighted=False)
            for _ in range(round(5 / step)):
                hair.step(step)
            found.append(-hair.array()[0][-1, 1])
        yield f"the same by steps of 1/24, 1/60, 1/240 s, K = {k}, 8 segments", f"{np.ptp(found) / found[0]:.1e}"


def swings(gpu):
    """First period of a hanging chain against Bernoulli's, and how far it swings after six, in shares of the first."""
    for length in (1.0, 0.05):
        for segments in (8, 32):
            for rate in (24, 60, 120, 240) if length == 1 else (120, 240):
                times, most = swing(gpu, segments, length, 1 / rate, 7.2 * period(length))
                yield (f"chain of {length:g} m, {segments} segments, 1/{rate} s: first period; swing left after six",
                       f"{np.diff(times)[0] / period(length) - 1:+.2%}; {most[6]:.3f}")


def energies(gpu):
    """How far the energy of a bar that is let go from the level rises above its start, and in a step, in m g L."""
    for order, name in ((1, "Euler"), (2, "BDF2")):
        above, rise = -np.inf, -np.inf
        for segments in (16, 32):
            for bend in (0.0, 0.2, 2.0):
                for rate in (60, 240):
                    hair = Hair(gpu, [bar(segments)], bend, weighted=False)
                    found = [next(hair.energy(bend))]
                    for _ in range(2 * rate):
                        hair.order = min(hair.order, order)
                        found.append(next(hair.step(1 / rate).energy(bend)))
                    found = np.array(found) / 9.81
                    above, rise = max(above, found[1:].max() - found[0]), max(rise, np.diff(found).max())
        yield f"energy, {name}: above its start; most in a step", f"{above:+.1e}; {rise:+.1e}"


def gusts(gpu):
    """How far tips are from those of 1,920 steps a second at worst, in 2 s of violent gusts."""
    exact = blown(gpu, 1920, 2)
    worst = [np.linalg.norm(blown(gpu, rate, 2) - exact, axis=2).max() for rate in (24, 60, 120, 240, 480)]
    yield ("violent gusts, K = 1: tips by 1/24, 1/60, 1/120, 1/240, 1/480 s, in lengths",
           ", ".join(f"{each:.4f}" for each in worst))


def rests(gpu):
    """How far grooms in 512 directions go from where they were in 4 s, in lengths."""
    for shape in ("straight", "curls"):
        for k in (0.5, 10):
            rng = np.random.default_rng(1)
            strands = [bar(16, rng.normal(size=3)) if shape == "straight" else curl(16, rng) for _ in range(512)]
            hair = Hair(gpu, strands, 9.81 / k, air=5)
            began = hair.array()
            for _ in range(240):
                hair.step(1 / 60)
            ways = [np.linalg.norm(now - then, axis=1).max() for now, then in zip(hair.array(), began)]
            yield (f"groom at rest, {shape}, K = {k}, 512 directions, 4 s",
                   f"{np.median(ways):.1e}, worst {max(ways):.1e}")


def shakes(gpu):
    """Stretch of strands whose roots jump and turn at random in each step, and how fast they go 10 s later."""
    for step in (1.0, 1 / 24, 1 / 240):
        rng = np.random.default_rng(2)
        hair = Hair(gpu, [curl(8, rng) for _ in range(64)], 0.1, air=5)
        for _ in range(100):
            root = hair.root.copy()
            root[0] += rng.uniform(-100, 100, root[0].shape)
            for i in range(64):
                root[1:, :, i] = root[1:, :, i] @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
            hair.step(step, (100, 0, 0), root)
        stretch = hair.stretch()
        for _ in range(1200):
            hair.step(1 / 120)
        speed = np.abs(np.concatenate(hair.array("speeds"))).max()
        yield (f"roots jump 100 lengths, steps of {step:.3g} s: stretch; lengths a second, 10 s later",
               f"{stretch:.1e}; {speed:.1e}")


def balls(gpu):
    """Hair through which a fast ball flies, and hair that has fallen on one: points and speeds, in lengths."""
    for rate in (24, 60, 240):
        hair, nearest, _ = shot(gpu, rate, 512)
        yield f"a ball at 20 lengths a second, {rate} frames a second: nearest point", f"{nearest:.4f}"
    body = ball(gpu, 2.5, 5)
    for friction in (0.3, 1):
        for segments in (8, 32):
            for rate in (24, 120, 240):
                hair = fallen(gpu, body, 512, segments, friction=friction)
                for _ in range(5 * rate):
                    hair.step(1 / rate)
                speeds = np.array([np.linalg.norm(each, axis=1).max() for each in hair.array("speeds")])
                yield (f"hair on a ball after 5 s, friction {friction}, {segments} segments, steps of 1/{rate} s",
                       f"90 % {np.quantile(speeds, 0.9):.1e}, worst {speeds.max():.1e}, nearest "
                       f"{depths(hair, 2.5).min():.4f}")


def piles(gpu):
    """Limp hair that has fallen from a wall: how dense it lies, by what was groomed, and its thickness."""
    for seconds in (None, 0.5, 0.1, 0.02):
        motion = clfur.Motion(scene_of(wall(), 3000), clfur.HairMotion(bend_length=0.05), gpu, body=False,
                              hair_on_hair=seconds)
        began, now = points(motion.at(0)), points(motion.at(72))
        fastest = np.abs(points(motion.at(73)) - now).max() * motion.fps
        yield (f"hair of 0.3 fallen from a wall after 3 s, hair on hair {seconds}",
               f"{np.mean(densities(now) / densities(began)):.2f} times as dense, thick "
               f"{np.ptp(np.percentile(now[:, 1:, 0], [5, 95])):.3f}, fastest {fastest:.1e}")


def main():
    gpu = clfur.Scheduler()
    print("| law | reached |\n|---|---|")
    for law in (drops, drops_by_step, swings, energies, gusts, rests, shakes, balls, piles):
        for name, value in law(gpu):
            print(f"| {name} | {value} |", flush=True)


if __name__ == "__main__":
    main()
