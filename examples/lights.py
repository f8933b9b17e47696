"""A warm key light and a blue fill, each with a size, a rim light from behind, and their shadow on a ground."""

from pathlib import Path

import clfur


def main(folder=".", size=(640, 480), roots=80_000):
    fur = clfur.Strands(roots=roots, force=(0, -1, 0), types=clfur.HairType(
        color=(.55, .3, .12), segments=8, segment_length=.011, width=.002, force_weight=.15, length_variation=.3,
        direction_variation=.3))
    lights = [clfur.Light((-.6, -.9, -.8), color=(1, .86, .7), size=6, ambient=.05),
              clfur.Light((1, -.3, -.6), color=(.55, .7, 1), intensity=.4, size=20, ambient=0),
              clfur.Light((.3, -1.2, .8), intensity=1.2, size=3, ambient=0)]
    scene = clfur.Scene(clfur.load_mesh("teapot"), fur, clfur.Camera((.5, .8, 2.1), (.08, -.04, 0), fov=45, size=size),
                        lights, ground=clfur.Ground())
    clfur.save(Path(folder) / "lights.png", clfur.over(clfur.render(scene), (.42, .45, .48)))


if __name__ == "__main__":
    main()
