"""The shortest: a built-in mesh with fur."""

from pathlib import Path

import clfur


def main(folder=".", size=(640, 480)):
    scene = clfur.Scene(
        mesh=clfur.load_mesh("sphere"),
        fur=clfur.Strands(roots=60_000, types=[clfur.HairType(color=(.75, .5, .25), segments=10, segment_length=.03,
                                                              length_variation=.3, direction_variation=.4)],
                          force=(0, -.3, 0)),
        camera=clfur.Camera(eye=(0, .4, 3.8), size=size))
    clfur.save(Path(folder) / "sphere.png", clfur.render(scene))


if __name__ == "__main__":
    main()
