"""What else is known of each pixel: depth, strand, tangent, normal and coverage, as pictures side by side."""

from pathlib import Path

import numpy as np

import clfur


def main(folder=".", size=(320, 240)):
    fur = clfur.Strands(roots=40_000, types=clfur.HairType(segment_length=.015, length_variation=.4))
    mesh = clfur.load_mesh("teapot")
    scene = clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(eye=(.8, .7, 2.2), size=size))
    images = clfur.render(scene, outputs=("color", "depth", "id", "tangent", "normal", "coverage"))

    there = np.isfinite(images["depth"])
    near, far = images["depth"][there].min(), images["depth"][there].max()
    depth = np.where(there, 1 - .9 * (images["depth"] - near) / (far - near), 0)
    random = np.random.default_rng(0).uniform(.1, 1, (images["id"].max() + 4, 3))
    strand = np.where(there[..., None], random[images["id"] + 3], 0)   # -3 shells, -2 body, -1 nothing
    grey = [np.repeat(each[..., None], 3, 2) for each in (depth, images["coverage"])]
    panels = [images["color"][..., :3], grey[0], strand, abs(images["tangent"]), abs(images["normal"]), grey[1]]
    sheet = np.concatenate([np.concatenate(panels[row:row + 3], 1) for row in (0, 3)], 0)
    clfur.save(Path(folder) / "outputs.png", sheet.astype(np.float32))


if __name__ == "__main__":
    main()
