"""Hair that is combed along a flow: it leans as a function of its place says, in colours of a picture by uv."""

from pathlib import Path

import numpy as np
import studio
from animals import noise

import clfur

behind = studio.backdrop((.02, .02, .03))
settings = clfur.Settings(masks=4, shadows="deep", scattering="grid")
COLORS = np.array([(.01, .08, .16), (.02, .28, .33), (.45, .06, .2), (.75, .2, .06), (.85, .5, .14)])
N = 60


def flow(places, normals=None):
    """Along the level lines of a smooth random height: eddies that close."""
    slope = [noise(places + e, 1.1, 8) - noise(places - e, 1.1, 8) for e in 1e-3 * np.eye(3)]
    way = np.stack([slope[2], 0 * slope[0], -slope[0]], 1)
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)


def scene(size=(800, 600)):
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, N), np.linspace(0, 1, N)))
    places = np.stack([4.8 * u - 2.4, 0 * u, 3.9 * v - 2.4], 1)
    places[:, 1] = .09 * noise(places, 1.1, 8)
    shade = np.clip(2 + 1.15 * noise(places, 1.1, 8) + .25 * noise(places, .3, 3), 0, 4)
    paint = np.stack([np.interp(shade, range(5), part) for part in COLORS.T], 1).reshape(N, N, 3)[::-1]
    first = np.arange(N * (N - 1)).reshape(N - 1, N)[:, :-1].reshape(-1, 1)
    mesh = clfur.Mesh(places, uv=np.stack([u, v], 1), faces=np.concatenate([first + (0, N, 1), first + (1, N, N + 1)]))
    hair = clfur.HairType(
        color=(1, 1, 1), color_texture=paint, root_color=(.4, .4, .4), tip_color=(1.15, 1.15, 1.15), alpha=.1,
        look=clfur.Chiang(),
        length=.34, stiffness=1.5, segments=14, width=.0045, tip_width=.08, length_variation=.4, direction_variation=.2,
        color_variation=.2, tufts=clfur.Tufts(2600, strength=.75, profile=.3))
    fur = clfur.Strands(inner=1, outer=1, types=hair, roots=180_000, force=(0, -.25, 0), comb=clfur.Comb(flow, .75))
    light = [clfur.Light((-.8, -.6, -.3), color=(1, .9, .78), intensity=1.5),
             clfur.Light((.7, -.5, .5), color=(.7, .85, 1), intensity=.6)]
    return clfur.Scene(mesh, fur, clfur.Camera((.1, 1.75, 1.75), (0, 0, -.12), fov=42, size=size), light,
                       .35 * paint, environment=studio.SKY)


def main(folder=".", size=(800, 600)):
    studio.shoot(scene(size), Path(folder) / "swirl.png", settings, behind)


if __name__ == "__main__":
    main()
