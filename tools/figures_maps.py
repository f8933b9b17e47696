"""docs/figures/maps.png: a mesh with a painted density, length and type map with soft edges, and combed.

    python tools/figures_maps.py MESH OUT.png [WIDTH]

MESH needs uv.  Pictures are painted by code: smooth spots, a parting line, a soft gradient.
"""

import io
import sys

import attrs
import numpy as np
from PIL import Image

import clfur

N = 512


def spots(seed, count, radius):
    """Soft round spots that repeat, [N, N], 0 to 1."""
    rng, at = np.random.default_rng(seed), (np.arange(N) + 0.5) / N
    x, y = np.meshgrid(at, at)
    picture = np.zeros((N, N))
    for u, v, r in zip(rng.random(count), rng.random(count), radius * (0.6 + 0.8 * rng.random(count))):
        away = np.hypot((x - u + 0.5) % 1 - 0.5, (y - v + 0.5) % 1 - 0.5)
        picture = np.maximum(picture, np.clip(1.5 - away / r, 0, 1))
    return picture


def as_jpeg(colors):
    """8-bit colours as a JPEG file has them."""
    file = io.BytesIO()
    Image.fromarray(colors).save(file, "JPEG", quality=85)
    return np.asarray(Image.open(file))


def furs(radius):
    """[(title, Strands)]."""
    dark = clfur.HairType(color=(0.10, 0.05, 0.03), root_color=(0.05, 0.02, 0.01), length=0.05 * radius, tip_width=0.2,
                          width=0.0014 * radius, length_variation=0.3, direction_variation=0.25, color_variation=0.2)
    light = attrs.evolve(dark, color=(0.75, 0.55, 0.38), root_color=(0.5, 0.33, 0.2))
    soft = spots(1, 14, 0.07)[:, :, None]
    keys = (soft * (255, 0, 0) + (1 - soft) * (0, 0, 255)).astype(np.uint8)   # a soft brush, through JPEG
    kinds = {"types": [attrs.evolve(dark, key=(255, 0, 0)), attrs.evolve(light, key=(0, 0, 255))],
             "type_map": as_jpeg(keys)}
    plain = clfur.Strands(roots=150_000, types=light, force=(0, -0.4, 0))
    down = clfur.Comb(lambda p, n: np.tile((0.0, -0.3, -1.0), (len(p), 1)), 0.75)
    return [
        ("no map", plain),
        ("density", attrs.evolve(plain, maps=clfur.Maps(density=1 - spots(2, 9, 0.08)))),
        ("length", attrs.evolve(plain, maps=clfur.Maps(length=0.25 + 2.5 * spots(3, 10, 0.09)))),
        ("type map, soft, JPEG", attrs.evolve(plain, **kinds)),
        ("combed", attrs.evolve(plain, comb=down)),
        ("all", attrs.evolve(plain, **kinds, comb=down, maps=clfur.Maps(
            density=1 - 0.9 * spots(2, 9, 0.08), length=0.4 + 1.6 * spots(3, 10, 0.09)))),
    ]


def main(mesh, out, width=420):
    mesh = clfur.load_mesh(mesh)
    pictures = []
    for title, fur in furs(mesh.bounds[1]):
        camera = clfur.scene.frame(mesh, fur, (int(width), int(width)), direction=(-0.8, 0.4, -1.0))
        scene = clfur.Scene(mesh, fur, camera, light=clfur.Light((1, -1.2, 0.8)), body_color=(0.22, 0.15, 0.12))
        frame = clfur.draw(scene)
        print(f"{title}: {frame.strands:,} strands, {fur.inexact:,} pixels that are no key")
        pictures.append(clfur.over(frame.images["color"], np.ones(3)))
    rows = [np.concatenate(pictures[k:k + 3], 1) for k in (0, 3)]
    clfur.save(out, np.concatenate(rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
