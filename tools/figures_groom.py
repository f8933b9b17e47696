"""Makes docs/figures/groom.png: the same hair with curls of its own, in tufts, in tufts that curl, and frizzy.

    pip install -e ".[figures]" && python tools/figures_groom.py [--mesh spot.obj]

Sphere, teapot and, where a mesh is given, that.
"""

import argparse
import sys
from pathlib import Path

import sheets

import clfur

OUT = Path(__file__).resolve().parents[1] / "docs" / "figures" / "groom.png"
COLOR = .5, .28, .12


def grooms(size):
    """{what: fields of `clfur.HairType`} for a mesh of a size."""
    curls = {"curl": (.03 * size, 3)}
    nested = clfur.Tufts(1200, strength=.9, profile=.6, within=clfur.Tufts(250))
    return {"curls alone": curls, "tufts": {"tufts": clfur.Tufts(1500)}, "curls of tufts": {**curls, "tufts": nested},
            "frizzy tufts": {"tufts": nested, "frizz": (.012 * size, 4)}}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh")
    arguments = parser.parse_args()
    gpu, rows = clfur.Scheduler(), []
    for name in ["sphere", "teapot", *([arguments.mesh] if arguments.mesh else [])]:
        mesh, images = clfur.load_mesh(name), []
        size = sheets.size_of(mesh) * (1 if name == "sphere" else .6)
        for fields in grooms(size).values():
            hair = clfur.HairType(
                color=COLOR, root_color=[part / 2 for part in COLOR], length=.3 * size, segments=20, width=.0016 * size,
                tip_width=.2, length_variation=.3, direction_variation=.3, color_variation=.2, **fields)
            strands = clfur.Strands(types=hair, roots=120_000)
            camera = clfur.Scene(mesh, strands).camera
            camera = clfur.Camera(eye=camera.eye, target=camera.target, fov=.85 * camera.fov, size=(240, 240))
            body = [.6 * part for part in COLOR]
            images.append(clfur.render(clfur.Scene(mesh, strands, camera, body_color=body), gpu))
        rows.append((Path(name).stem, images))
    sheets.sheet(OUT, "Hair of one length and stiffness", list(grooms(1)), rows)


if __name__ == "__main__":
    sys.exit(main())
