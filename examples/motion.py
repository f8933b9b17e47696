"""A film of a teapot that turns back and forth in gusty wind: its hair swings, and hangs still where it does not."""

import math
from pathlib import Path

import numpy as np

import clfur


def main(folder=".", size=(640, 480), frames=24, roots=20_000):
    rest, gpu = clfur.load_mesh("teapot"), clfur.Scheduler()
    rest = clfur.Mesh(positions=rest.positions, faces=rest.faces)
    fur = clfur.Strands(roots=roots, types=clfur.HairType(length=.22, stiffness=1.2, length_variation=.3, width=.004),
                        collision=True)

    def scene(seconds):
        a = .8 * math.sin(2 * math.pi * seconds)
        turn = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
        mesh = clfur.Mesh(positions=rest.positions @ turn.T, faces=rest.faces)
        return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=(0, .9, 2.6), size=size))
    motion = clfur.Motion(scene, clfur.HairMotion(bend_length=.3, air=.3), gpu, units_per_metre=2,
                          wind=clfur.Wind((1.5, 0, 0), gust=1, size=.3, skin=.01))
    for frame in range(frames):
        clfur.save(Path(folder) / f"motion-{frame:03}.png", clfur.render(motion.at(frame), gpu))


if __name__ == "__main__":
    main()
