"""White fur under a sky and a low sun: light that goes from hair to hair, without which it is grey."""

from pathlib import Path

import clfur


def main(folder=".", size=(640, 480), roots=40_000):
    fur = clfur.Strands(roots=roots, force=(0, -.4, 0), types=clfur.HairType(
        color=(.93, .9, .84), look=clfur.Chiang(azimuthal_roughness=.4), segments=10, segment_length=.02, width=.005,
        length_variation=.35, direction_variation=.35))
    scene = clfur.Scene(clfur.load_mesh("sphere"), fur, clfur.Camera((0, .5, 3.4), size=size),
                        clfur.Light((.6, -.8, -1), color=(1, .85, .65), intensity=1.2), (.8, .75, .7),
                        environment=clfur.Environment([(.35, .5, .9), (.6, .6, .65), (.15, .12, .1)]))
    clfur.save(Path(folder) / "white.png", clfur.render(scene, settings=clfur.Settings(scattering="grid")))


if __name__ == "__main__":
    main()
