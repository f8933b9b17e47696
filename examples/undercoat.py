"""Both furs: guard hairs over an undercoat of shells."""

from pathlib import Path

import clfur


def main(folder=".", size=(640, 480)):
    undercoat = clfur.Shells(length=.06, layers=24, hairs=30_000, density=.9, color=(.75, .7, .6))
    guard = clfur.Strands(roots=15_000, force=(0, -1, 0), types=clfur.HairType(
        color=(.25, .18, .12), segments=10, segment_length=.02, width=.004, force_weight=.15, length_variation=.3,
        direction_variation=.2))
    scene = clfur.Scene(mesh=clfur.load_mesh("sphere"), fur=[undercoat, guard], body_color=(.5, .4, .35),
                        camera=clfur.Camera(eye=(0, .6, 3.2), size=size))
    clfur.save(Path(folder) / "undercoat.png", clfur.render(scene))


if __name__ == "__main__":
    main()
