"""A camera as OpenCV calibrates it, and outputs for training data: where each pixel's strand runs in the picture."""

from pathlib import Path

import numpy as np

import clfur


def from_opencv(rotation, translation, matrix, size):
    """The camera of OpenCV's world-to-camera rotation [3, 3] and translation [3], and its matrix [3, 3] in pixels."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.T, -rotation.T @ translation
    pose[:, 1:3] *= -1        # OpenCV looks along +Z with +Y down
    return clfur.Camera.calibrated(pose, matrix + [[0, 0, .5], [0, 0, .5], [0, 0, 0]], size)


def main(folder=".", size=(640, 480)):
    width, height = size
    matrix = np.array([[1.1 * width, 0, .5 * width - .5], [0, 1.1 * width, .5 * height - .5], [0, 0, 1]])
    camera = from_opencv(np.diag([1.0, -1, -1]), np.array([0, .1, 2.6]), matrix, size)
    fur = clfur.Strands(roots=40_000, types=clfur.HairType(segment_length=.015, direction_variation=.5, curl=(.01, 1)))
    scene = clfur.Scene(mesh=clfur.load_mesh("teapot"), fur=fur, camera=camera)
    images = clfur.render(scene, outputs=("color", "depth", "id", "tangent", "coverage"))
    clfur.save(Path(folder) / "calibrated.exr", images)
    clfur.save(Path(folder) / "calibrated.npz", images)


if __name__ == "__main__":
    main()
