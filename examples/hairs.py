"""Few and wide hairs, left by a grid of cells, right as single hairs that shade and hide each other."""

from pathlib import Path

import numpy as np

import clfur


def main(folder=".", size=(320, 240), roots=4_000):
    fur = clfur.Strands(roots=roots, force=(0, -1, 0), types=clfur.HairType(
        color=(.7, .45, .2), alpha=0, segments=8, segment_length=.04, width=.012, force_weight=.15,
        length_variation=.3, direction_variation=.4))
    scene = clfur.Scene(clfur.load_mesh("sphere"), fur, clfur.Camera((0, .4, 4), size=size))
    halves = [clfur.render(scene, settings=settings)
              for settings in (clfur.Settings(), clfur.Settings(shadows="deep", masks=4))]
    clfur.save(Path(folder) / "hairs.png", np.concatenate(halves, axis=1))


if __name__ == "__main__":
    main()
