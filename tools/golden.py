"""Draws the golden pictures: small frames, one a feature, that tests/test_golden.py compares every device's with.

    python tools/golden.py                        draw all that are not there yet
    python tools/golden.py curl wave              draw these anew: after a change that is meant to be seen
    python tools/golden.py --sheet golden.png     all that are there, side by side, to look at

A picture lies over grey, as an 8-bit sRGB PNG in tests/golden.  Look at the sheet before you commit a new one: it is to
show its feature, and it says from then on what is right.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import clfur
from clfur.color import linear_to_srgb

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "golden"
SIZE, GREY, TIMES = (64, 48), .18, 8
BROWN, BODY = (.55, .32, .14), (.06, .04, .05)
SPHERE = clfur.load_mesh("sphere")


def scene(fur, mesh=SPHERE, eye=(.8, .9, 2.6), body=BODY, light=(-1, -.4, -.1), **options):
    """Fur before a camera near by; ``light``: a direction, or a Light."""
    light = light if isinstance(light, clfur.Light) else clfur.Light(direction=light)
    return clfur.Scene(mesh, fur, clfur.Camera(eye=eye, fov=45, size=SIZE), light, body, **options)


def hair(**options):
    """A type of hair that is wide enough to be seen in so few pixels."""
    return clfur.HairType(**{"color": BROWN, "segments": 8, "segment_length": .035, "force_weight": .12,
                             "width": .014, "alpha": .2, **options})


def grown(roots=3500, types=None, **options):
    return clfur.Strands(**{"types": types or hair(), "roots": roots, "inner": 3, "outer": 3, "seed": 1, **options})


def stripes(*colors):
    """A picture of upright stripes, for a type map."""
    return np.array([colors], np.uint8)


def whiskers(colors=None):
    """Polylines that bend outwards from a line, each thinner towards its tip."""
    x, t = np.linspace(-1.1, 1.1, 23)[:, None], np.linspace(0, 1, 9)
    points = np.stack([x + x * t**2 * .3, -.8 + 1.5 * t - .5 * t**2 * x**2, .3 * np.sin(4 * t + 3 * x)], 2)
    return clfur.Curves(points, width=np.tile(.05 * (1 - t), (len(x), 1)),
                        color=(.8, .5, .2) if colors is None else np.tile(colors(t), (len(x), 1, 1)))


def combed():
    """Guides on the ball, which are combed away from a line before the eye."""
    k, t = np.arange(120)[:, None], np.linspace(0, 1, 7)[:, None]
    y = 1 - (k + .5) / 60
    root = np.concatenate([np.sqrt(1 - y * y) * np.cos(2.399963 * k), y, np.sqrt(1 - y * y) * np.sin(2.399963 * k)], 1)
    aside = np.where(root[:, :1] > .2, 1, -1) * (1, .3, 0)
    return clfur.Curves(root[:, None] * (1 + .12 * np.sqrt(t)) + .45 * t * aside[:, None])


def rainbow(t):
    return np.clip(1.5 - np.abs(4 * t[:, None] - (3, 2, 1)), 0.02, 1)


def coarse():
    """A ball of 20 large faces."""
    g = (1 + 5**.5) / 2
    p = np.array([(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g),
                  (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]) / np.hypot(1, g)
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
             (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5),
             (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    return clfur.Mesh(p, p, None, faces)


def strip():
    """Seven triangles in a row, seen from the side: one strand stands on each."""
    x = np.linspace(-1, 1, 8)
    p = np.array([(a, -.7, z) for a in x for z in (-.1, .1)])
    return clfur.Mesh(p, None, None, [(2 * k, 2 * k + 1, 2 * k + 2) for k in range(7)])


def standing(**options):
    """The strip's strands, upright."""
    one = hair(segments=60, segment_length=.025, force_weight=0, width=.06, **options)
    return grown("faces", one, inner=1, outer=1)


def uneven():
    """A square of one large face and many small ones."""
    x = np.linspace(-1, 1, 9)
    p = np.array([(-1, -1, 0), *((a, 1, 0) for a in x[::-1]), (1, -1, 0)])
    return clfur.Mesh(p, None, None, [(0, 10, 1), *((0, k, k + 1) for k in range(1, 9))])


def lawn():
    """A level square, seen along its surface."""
    corners = [(-.9, -.5, -.3), (.5, -.5, -.3), (.5, -.5, .3), (-.9, -.5, .3)]
    return clfur.Mesh(corners, None, None, [(0, 2, 1), (0, 3, 2)])


def shells(**options):
    return clfur.Shells(**{"length": .18, "frequency": 14, "color": BROWN, **options})


KEYS = (255, 0, 0), (0, 0, 255)
SHORT = hair(key=KEYS[0], color=(.75, .7, .6), segment_length=.012)
BALD = hair(key=KEYS[0], segments=0)
LONG = hair(key=KEYS[1], segment_length=.04)
COARSE = {"samples": 4, "grid": 32, "shadow_map": 128}
LINES = {"raster": "samples", "samples": 1}
SPOT = clfur.Light(direction=(-.5, -.6, -2), position=(.6, .7, 2.4), angle=24, ambient=.05)
SHINY = clfur.Kajiya(specular=.6, exponent=25)
REPORTS = clfur.Kajiya(specular=.6, exponent=25, highlight="half-vector")
BLOND = clfur.Chiang(eumelanin=.2, pheomelanin=.4)
DARK, SKY = clfur.Light(color=(0, 0, 0)), clfur.Environment([(.4, .8, 2), (1.5, 1.1, .8), (.3, .2, .1)])
DIM = clfur.Environment([(.1, .2, .5), (.4, .3, .2), (.1, .07, .03)])
TEXTURE = np.array([(.7, .3, .02), (.02, .1, .6)])[np.indices((6, 12)).sum(0) % 2]
PAINTED = clfur.Maps(density=[[1, .1]], length={1001: [[.3], [1.8]]}, width=[[1, 1], [.4, .4]])

BLOWN = shells(length=.9, frequency=5, density=.4, noise=(0, 8), wind=(2.5, 0, 0), time=.2)

# Name: what is drawn, and what is particular to how.
PICTURES = {
    "strands": (lambda: scene(grown()), {}),
    "samples": (lambda: scene(grown()), LINES),
    "curl": (lambda: scene(standing(curl=(.12, 3)), strip(), (0, 0, 2.6)), {}),
    "wave": (lambda: scene(standing(wave=(.1, 2.5)), strip(), (0, 0, 2.6)), {}),
    "tufts": (lambda: scene(grown(types=hair(tufts=clfur.Tufts(60, within=clfur.Tufts(12)), curl=(.03, 1)))), {}),
    "frizz": (lambda: scene(standing(frizz=(.1, 9)), strip(), (0, 0, 2.6)), {}),
    "law": (lambda: scene(grown(types=hair(segment_length=None, force_weight=None, length=.28, stiffness=.5))), {}),
    "type-map": (lambda: scene(grown(types=[SHORT, LONG], type_map=stripes(*KEYS * 6))), {}),
    "bald-type": (lambda: scene(grown(types=[BALD, LONG], type_map=stripes(*KEYS * 2))), {}),
    "texture": (lambda: scene(grown(4000, hair(color=(1, 1, 1), color_texture=TEXTURE))), {}),
    "maps": (lambda: scene(grown(6000, maps=PAINTED, comb=clfur.Comb((0, -1, 0), .8))), {}),
    "guides": (lambda: scene(grown(guides=combed(), surface="flat", inner=1, outer=1)), {}),
    "curves": (lambda: scene(whiskers(), None), {}),
    "color-per-point": (lambda: scene(whiskers(rainbow), None), {}),
    "cells": (lambda: scene(shells()), {}),
    "sine": (lambda: scene(shells(pattern="sine", frequency=10)), {}),
    "wind": (lambda: scene(BLOWN, lawn(), (0, .3, 2)), {}),
    "both-furs": (lambda: scene([shells(length=.12, color=(.9, .85, .8)), grown(250, hair(width=.02))]), {}),
    "spot": (lambda: scene(grown(), light=SPOT), {}),
    "highlight": (lambda: scene(grown(types=hair(look=SHINY)), light=(-.3, -1, -.8)), {}),
    "half-vector": (lambda: scene(grown(types=hair(look=REPORTS)), light=(-.3, -1, -.8)), {}),
    "chiang": (lambda: scene(grown(types=hair(look=BLOND)), light=(-.6, -.7, .6)), {}),
    "scattering": (lambda: scene(grown(types=hair(look=BLOND, alpha=0)), body=(.8, .1, .1), light=(-.6, -.7, .6),
                                 environment=DIM), {"scattering": "grid"}),
    "sky": (lambda: scene(grown(types=hair(color=(.8, .8, .8))), light=DARK, environment=SKY), {}),
    "no-shadows": (lambda: scene(grown()), {"shadows": "off"}),
    "lod": (lambda: scene(grown(), eye=(1.2, 1.35, 3.9)), {"lod": 4}),
    "blur-edges": (lambda: scene(grown()), {"blur": "edges", "blur_sigma": 1.5}),
    "motion-blur": (lambda: [scene(grown(), eye=(.8 + .05 * k, .9, 2.6)) for k in range(6)], {}),
    "roots-by-area": (lambda: scene(grown(900, hair(force_weight=.05), force=(0, -1, 0)), uneven(), (.5, .8, 2.4)), {}),
    "flat-surface": (lambda: scene(grown(2500, types=hair(segment_length=.012), surface="flat"), coarse()), {}),
}


def picture(name, device=None):
    """A golden picture as a device draws it: uint8 [48, 64, 3]."""
    build, settings = PICTURES[name]
    made = build()   # a scene, or several whose mean is the picture
    scenes = made if isinstance(made, list) else [made]
    color = clfur.blurred(scenes, device, clfur.Settings(**COARSE | settings)).images["color"]
    return (255 * linear_to_srgb(color[..., :3] + GREY * (1 - color[..., 3:])) + .5).astype(np.uint8)


def expected(name):
    return np.asarray(Image.open(FOLDER / f"{name}.png").convert("RGB"))


def sheet(path, titled, columns=5, times=4):
    """Save pictures [h, w, 3] side by side, enlarged and with a title each: [(title, picture)]."""
    across, down = SIZE[0] * times, SIZE[1] * times + 14
    rows = -(-len(titled) // columns)
    whole = Image.new("RGB", (across * min(columns, len(titled)), down * rows), "white")
    for place, (title, image) in enumerate(titled):
        x, y = place % columns * across, place // columns * down
        whole.paste(Image.fromarray(image).resize((across, down - 14), Image.Resampling.NEAREST), (x, y + 14))
        ImageDraw.Draw(whole).text((x + 4, y + 1), title, "black")
    whole.save(path)


def difference(one, other):
    """How two pictures differ, 8 times as strong."""
    return np.minimum(TIMES * np.abs(one.astype(int) - other), 255).astype(np.uint8)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[*PICTURES, []], help=", ".join(PICTURES))
    parser.add_argument("--device", help="as `clfur.Scheduler` takes it")
    parser.add_argument("--sheet", metavar="PNG", help="only show those that are there")
    asked = parser.parse_args()
    if asked.sheet:
        return sheet(asked.sheet, [(name, expected(name)) for name in PICTURES])
    FOLDER.mkdir(exist_ok=True)
    for name in asked.names or [name for name in PICTURES if not (FOLDER / f"{name}.png").exists()]:
        path = FOLDER / f"{name}.png"
        Image.fromarray(picture(name, asked.device)).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
