"""Makes docs/figures/light.png: white, blond, red and black fur under one light, three lights and a sky.

    pip install -e ".[figures]" && python tools/figures_light.py [--mesh spot.obj]

Sphere, teapot and, where a mesh is given, that; looks of `clfur.Chiang`, light from hair to hair.
"""

import argparse
import sys
from pathlib import Path

import sheets

import clfur

OUT = Path(__file__).resolve().parents[1] / "docs" / "figures" / "light.png"
COLORS = {"white": (.9, .88, .85), "blond": (.62, .42, .2), "red": (.45, .13, .04), "black": (.02, .018, .016)}
SUN = clfur.Light((-.6, -.8, -1), color=(1, .95, .88), intensity=1.2, ambient=.04)
THREE = [SUN, clfur.Light((1, -.3, -.6), color=(.6, .75, 1), intensity=.5, ambient=0),
         clfur.Light((.4, -.5, 1), intensity=1.2, ambient=0)]
SKY = clfur.Environment([(.55, .7, 1), (.9, .9, .9), (.25, .22, .18)])
LIGHTS = {"one light": {"light": SUN}, "three lights": {"light": THREE},
          "a sky": {"light": clfur.Light((0, -1, 0), intensity=0.0), "environment": SKY}}


def fur(color, size):
    """Strands of a colour on a mesh of a size, as the command grows them."""
    hair = clfur.HairType(
        look=clfur.Chiang(), color=color, segments=8, segment_length=.01 * size, width=.0015 * size, tip_width=.2,
        force_weight=.2, length_variation=.3, direction_variation=.3, color_variation=.1)
    return clfur.Strands(types=hair, roots=120_000)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh")
    arguments = parser.parse_args()
    gpu, settings = clfur.Scheduler(), clfur.Settings(scattering="grid", masks=4)
    rows = []
    for name in ["sphere", "teapot", *([arguments.mesh] if arguments.mesh else [])]:
        mesh = clfur.load_mesh(name)
        for light, lit in LIGHTS.items():
            images = []
            for color in COLORS.values():
                strands = fur(color, sheets.size_of(mesh))
                camera = clfur.Scene(mesh, strands).camera
                camera = clfur.Camera(eye=camera.eye, target=camera.target, fov=camera.fov, size=(160, 120))
                scene = clfur.Scene(mesh, strands, camera, body_color=tuple(.6 * part for part in color), **lit)
                images.append(clfur.render(scene, gpu, settings))
            rows.append((f"{Path(name).stem}, {light}", images))
    sheets.sheet(OUT, "Chiang's hair, light from hair to hair", list(COLORS), rows)


if __name__ == "__main__":
    sys.exit(main())
