"""A film of a teapot that turns: the camera goes round, and all that it does not change stays on the device."""

import math
from pathlib import Path

import clfur


def main(folder=".", size=(640, 480), frames=24):
    mesh, gpu = clfur.load_mesh("teapot"), clfur.Scheduler()
    fur = clfur.Strands(roots=60_000, force=(0, -1, 0), types=clfur.HairType(
        color=(.5, .28, .12), segment_length=.012, force_weight=.2, length_variation=.3, direction_variation=.3))
    for frame in range(frames):
        angle = 2 * math.pi * frame / frames
        camera = clfur.Camera(eye=(2.3 * math.sin(angle), .7, 2.3 * math.cos(angle)), size=size)
        image = clfur.render(clfur.Scene(mesh=mesh, fur=fur, camera=camera), gpu)
        clfur.save(Path(folder) / f"turntable-{frame:03}.png", image)


if __name__ == "__main__":
    main()
