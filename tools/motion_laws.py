"""Laws of strands that move, longer than the tests': the table of docs/motion.md.

    python tools/motion_laws.py
"""

import sys
from pathlib import Path

import numpy as np

import clfur

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support.hair import DROPS, Hair, ball, bar, curl, depths, fallen, shot
from support.piles import densities, points, scene_of, wall


def drops(gpu):
    """How far tips of clamped bars are from the elastica's, in shares of it."""
    for segments in (8, 16, 32):
        for k, exact in DROPS.items():
            hair = Hair(gpu, [bar(segments)], 9.81 / k, air=5, weighted=False)
            for _ in range(300):
                hair.step(1 / 60)
            yield f"tip of a clamped bar, K = {k}, {segments} segments", f"{-hair.array()[0][-1, 1] / exact - 1:+.2%}"


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
    """Stretch of strands whose roots jump and turn at random in each step."""
    for step in (1.0, 1 / 24, 1 / 240):
        rng = np.random.default_rng(2)
        hair = Hair(gpu, [curl(8, rng) for _ in range(64)], 0.1, air=5)
        for _ in range(100):
            root = hair.root.copy()
            root[0] += rng.uniform(-100, 100, root[0].shape)
            for i in range(64):
                root[1:, :, i] = root[1:, :, i] @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
            hair.step(step, (100, 0, 0), root)
        yield f"stretch, roots anywhere within 100 lengths, steps of {step:.3g} s", f"{hair.stretch():.1e}"


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
    for law in (drops, rests, shakes, balls, piles):
        for name, value in law(gpu):
            print(f"| {name} | {value} |", flush=True)


if __name__ == "__main__":
    main()
