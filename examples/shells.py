"""Short dense fur as a pattern in layers, in a wind that comes in gusts."""

from pathlib import Path

import clfur


def main(folder=".", size=(640, 480), frames=4):
    mesh, camera, gpu = clfur.load_mesh("sphere"), clfur.Camera(size=size), clfur.Scheduler()
    for frame in range(frames):
        fur = clfur.Shells(length=.12, layers=30, hairs=30_000, density=.8, color=(.6, .45, .3), force=(0, -.3, 0),
                           wind=(.6, 0, 0), time=frame / frames)
        image = clfur.render(clfur.Scene(mesh=mesh, fur=fur, camera=camera), gpu)
        clfur.save(Path(folder) / f"shells-{frame}.png", image)


if __name__ == "__main__":
    main()
