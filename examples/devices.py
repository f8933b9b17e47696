"""Several devices: each alone, and all of them on one frame, which comes out as the same picture."""

from pathlib import Path

import numpy as np

import clfur
from clfur import device


def main(folder=".", size=(640, 480)):
    scene = clfur.Scene(mesh=clfur.load_mesh("teapot"), camera=clfur.Camera(eye=(.8, .7, 2.2), size=size),
                        fur=clfur.Strands(roots=60_000, types=clfur.HairType(segment_length=.012)))
    gpus = [clfur.Scheduler(each) for each in device.find()]
    for gpu in gpus:
        frame = clfur.draw(scene, gpu)
        print(f"{gpu.name}: {frame.seconds:.2f} s")
    together = clfur.draw(scene, gpus)
    print(f"{together.device}: {together.seconds:.2f} s")
    difference = np.abs(together.images["color"] - frame.images["color"]).max()
    print(f"largest difference to the last one alone: {difference:.1e}")
    clfur.save(Path(folder) / "devices.png", together.images["color"])


if __name__ == "__main__":
    main()
