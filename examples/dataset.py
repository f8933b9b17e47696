"""Pictures of one head of hair from random places, with depth, strands and cameras: data to train on."""

from pathlib import Path

import numpy as np

import clfur


def main(folder=".", size=(320, 240), poses=16):
    hair = clfur.HairType(color=(.3, .15, .06), length=.15, length_variation=.3, direction_variation=.3, width=.003)
    scene = clfur.Scene(clfur.load_mesh("teapot"), clfur.Strands(roots=30_000, types=hair, force=(0, -1, 0)))
    cameras = clfur.Camera.on_sphere(poses, radius=2.6, seed=1, elevation=(-10, 60), size=size)
    outputs = "color", "depth", "id", "coverage"
    for number, (camera, frame) in enumerate(zip(cameras, clfur.frames(scene, cameras, outputs=outputs))):
        K, R, t, _ = camera.to_opencv()
        np.savez_compressed(Path(folder) / f"dataset-{number:04}.npz", K=K, R=R, t=t, **frame.images)


if __name__ == "__main__":
    main()
