"""How many pictures motion blur needs: a ball of 15,000 strands that turns, against 64 of them.

    python tools/figures_blur.py [--picture ball.png]

Prints for n pictures the root mean square of sRGB-coded values (0 to 1) to 64, and the processor's time over that of
one picture: the median of three runs, in turn with it.
"""

import argparse
import statistics
import time

import attrs
import numpy as np

import clfur

DEGREES, SIZE = 8, (320, 240)


def turned(scene, degrees):
    """The scene with its mesh and Curves turned around y."""
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    return attrs.evolve(
        scene, mesh=clfur.Mesh(scene.mesh.positions @ turn.T, faces=scene.mesh.faces),
        fur=attrs.evolve(scene.fur, points=(scene.fur.points @ turn.T).astype(np.float32),
                         root_normal=(scene.fur.root_normal @ turn.T).astype(np.float32)))


def during(scene, n):
    """The scene at the middles of n parts of its turn."""
    return [turned(scene, (k + 0.5) / n * DEGREES) for k in range(n)]


def seconds_of(draw):
    """The processor's time of a call."""
    began = time.process_time()
    draw()
    return time.process_time() - began


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", help="where to save the blurred ball")
    given = parser.parse_args()
    gpu = clfur.Scheduler()
    hair = clfur.HairType(length=0.4, stiffness=4, segments=8, width=0.004)
    scene = clfur.Scene(clfur.load_mesh("sphere"), clfur.Strands(roots=15_000, types=hair, force=(0.5, -1, 0.2)),
                        clfur.Camera(eye=(0, 0.5, 3.4), size=SIZE))
    scene = attrs.evolve(scene, fur=clfur.grow(scene, gpu))
    enough = clfur.subframes(turned(scene, 0), turned(scene, DEGREES), gpu)
    true = clfur.to_uint8(clfur.blurred(during(scene, 64), gpu).images["color"]).astype(float)
    single = [during(scene, 1), [turned(scene, DEGREES / 2 + 0.01)]]   # in turn: neither finds its strands there
    print(f"{enough} pictures are enough, as `subframes` says\npictures   RMS      time")
    for n in sorted({1, 2, 4, 8, 16, enough}):
        scenes, ratios = during(scene, n), []
        for run in range(3):
            one = seconds_of(lambda: clfur.blurred(single[run % 2], gpu))
            ratios.append(seconds_of(lambda: clfur.blurred(scenes, gpu)) / one)
        image = clfur.blurred(scenes, gpu).images["color"]
        error = np.sqrt(((clfur.to_uint8(image) - true)[..., :3] ** 2).mean()) / 255
        print(f"{n:8} {error:8.4f} {statistics.median(ratios):8.1f}")
    if given.picture:
        clfur.save(given.picture, image)


if __name__ == "__main__":
    main()
