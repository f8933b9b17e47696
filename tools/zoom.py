"""Whether hair pops up or vanishes as the camera goes away: change from frame to frame, against the truth's.

    python tools/zoom.py                       coverage and samples, with and without lod, on the teapot
    python tools/zoom.py --frames 60 --size 96x72 --samples 8

The camera goes from where the teapot fills the picture to 20 times as far, each frame by the same factor.  A frame's
change is the mean difference (sRGB, over black) to the one before, over what is fur in either.  Exit code 1: some
change is more than twice the truth's own.
"""

import argparse
import json
import sys

import numpy as np
from rich.progress import track

import clfur
from clfur import truth
from clfur.color import linear_to_srgb

KNOBS = {
    "coverage": {"raster": "coverage"},
    "coverage, lod 0.5": {"raster": "coverage", "lod": 0.5},
    "coverage, lod 1": {"raster": "coverage", "lod": 1.0},
    "4 samples": {"raster": "samples"},
    "4 samples, lod 1": {"raster": "samples", "lod": 1.0},
}


def furry(strands, width, distance, size):
    """The teapot from this many times as far as fills the picture."""
    hair = clfur.HairType(segments=8, segment_length=0.02, width=width, force_weight=0.15, length_variation=0.3,
                          direction_variation=0.3, color_variation=0.2)
    eye = np.array([0.8, 0.7, 2.2]) * distance
    return clfur.Scene(mesh=clfur.load_mesh("teapot"), fur=clfur.Strands(inner=1, outer=1, roots=strands, types=[hair]),
                       camera=clfur.Camera(eye, size=size))


def changes(pictures):
    """Mean difference of each picture to the one before, where either shows anything."""
    shown = [linear_to_srgb(np.clip(p[..., :3], 0, 1)) for p in pictures]
    found = []
    for k in range(1, len(shown)):
        there = (pictures[k][..., 3] > 0) | (pictures[k - 1][..., 3] > 0)
        found.append(float(np.abs(shown[k] - shown[k - 1])[there].mean()))
    return np.array(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--strands", type=int, default=20_000)
    parser.add_argument("--width", type=float, default=0.004)
    parser.add_argument("--size", default="96x72")
    parser.add_argument("--samples", type=int, default=8, help="of the truth, squared, a pixel")
    parser.add_argument("--grid", type=int, default=clfur.Settings().grid)
    parser.add_argument("--device")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    size, gpu = tuple(map(int, arguments.size.split("x"))), clfur.Scheduler(arguments.device)
    distances = 20 ** (np.arange(arguments.frames) / (arguments.frames - 1))
    scenes = [furry(arguments.strands, arguments.width, d, size) for d in distances]
    true = changes([truth.cached_picture(scene, arguments.samples) for scene in
                    track(scenes, "truth", disable=not sys.stderr.isatty())])
    worst = 0.0
    for name, knobs in KNOBS.items():
        settings = clfur.Settings(grid=arguments.grid, **knobs)
        ratio = changes([clfur.render(scene, gpu, settings) for scene in scenes]) / true
        row = {"settings": name, "median": float(np.median(ratio)), "largest": float(ratio.max()),
               "at": float(distances[1 + ratio.argmax()])}
        if name.startswith("coverage"):
            worst = max(worst, row["largest"])
        print(json.dumps(row) if arguments.json else f"{name:20} change / truth's: median {row['median']:.2f}, "
              f"largest {row['largest']:.2f} at {row['at']:.1f} times the distance", flush=True)
    return int(worst > 2)


if __name__ == "__main__":
    sys.exit(main())
