"""A camera as OpenCV calibrates it, and outputs for training data: where each pixel's strand runs in the picture."""

from pathlib import Path

import numpy as np

import clfur


def main(folder=".", size=(640, 480)):
    width, height = size
    matrix = np.array([[1.1 * width, 0, .5 * width - .5], [0, 1.1 * width, .5 * height - .5], [0, 0, 1]])
    camera = clfur.Camera.from_opencv(matrix, np.diag([1, -1, -1]), (0, .1, 2.6), size)
    fur = clfur.Strands(roots=40_000, types=clfur.HairType(segment_length=.015, direction_variation=.5, curl=(.01, 1)))
    scene = clfur.Scene(mesh=clfur.load_mesh("teapot"), fur=fur, camera=camera)
    images = clfur.render(scene, outputs=("color", "depth", "id", "tangent", "coverage"))
    clfur.save(Path(folder) / "calibrated.exr", images)
    clfur.save(Path(folder) / "calibrated.npz", images)


if __name__ == "__main__":
    main()
