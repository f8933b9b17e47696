"""A meadow in the evening: blades of grass as strands of one's own, and flowers whose petals are strands, too."""

from pathlib import Path

import numpy as np
import studio
from animals import noise

import clfur

settings = clfur.Settings(masks=4)
POINTS = 8


def meadow(blades=120_000, flowers=420):
    random = np.random.default_rng(5)
    depth = .8 * (45 / .8)**random.uniform(0, 1, blades)**.9                   # of the camera, denser where it is near
    root = np.stack([random.uniform(-.75, .75, blades) * (depth + .6), 0 * depth, 3 - depth], 1)
    clump, t = noise(root, .5, 1), np.linspace(0, 1, POINTS)[:, None]
    height = (.34 + .07 * clump) * random.uniform(.45, 1.15, blades)
    lean = np.stack([.35 + .3 * noise(root, 1.5, 2), 0 * clump, .2 * noise(root, .8, 3)], 1)
    lean += random.normal(0, .35, (blades, 3)) * (1, 0, 1)
    bend = .6 * t**2 * lean[:, None] - .3 * t**3 * (lean**2).sum(1)[:, None, None] * (0, 1, 0)
    grass = root[:, None] + height[:, None, None] * (t * (0, 1, 0) + bend)
    dry = np.clip(.2 + .25 * noise(root, .9, 4) + random.normal(0, .2, blades), 0, 1)[:, None, None]
    green, straw = (.02, .06, .006) + t * (.09, .2, .015), (.13, .1, .03) + t * (.32, .22, .07)
    color = green * (1 - dry) + straw * dry
    width = .0045 * (.9 + .25 * depth[:, None]) * np.clip(1.3 - 1.3 * t[:, 0], .08, 1)
    where = random.choice(np.flatnonzero(depth > 1.7), flowers)
    around = 2 * np.pi * np.arange(24) / 24
    petal = np.stack([np.cos(around), .55 + 0 * around, np.sin(around)], 1)[:, None] * t * .045 + (0, .01, 0) * (t * t)
    head = root[where] + (0, 1, 0) * (.36 + .16 * random.uniform(0, 1, (flowers, 1))) + .1 * lean[where]
    stem = root[where][:, None] + t * (head - root[where])[:, None]
    petals = (head[:, None, None] + petal * random.uniform(.7, 1.4, (flowers, 1, 1, 1))).reshape(-1, POINTS, 3)
    kinds = np.array([(.75, .05, .03), (.8, .6, .06), (.78, .76, .72), (.3, .16, .6)])
    kinds = kinds[random.choice(4, flowers, p=(.4, .2, .25, .15))]
    far = (.9 + .25 * depth[where])[:, None]
    points = np.concatenate([grass, stem, petals])
    colors = np.concatenate([color, np.tile((.06, .13, .03), (flowers, POINTS, 1)),
                             np.repeat(np.repeat(kinds[:, None], 24, 0), POINTS, 1)])
    widths = np.concatenate([width, np.repeat(.0045 * far, POINTS, 1), np.repeat(.016 * far, 24, 0)
                             * np.array([.3, .7, 1, 1.1, 1.1, 1, .7, .2])])
    return clfur.Curves(points, width=widths, color=np.clip(colors, 0, 1), alpha=.15, look=clfur.Chiang(.4, .5))


def scene(size=(800, 600), blades=120_000):
    sun = clfur.Light((-.35, -.28, 1), color=(1, .66, .32), intensity=1.2)
    return clfur.Scene(fur=meadow(blades), camera=clfur.Camera((0, .4, 3), (0, .36, 0), fov=34, size=size),
                       light=[sun], environment=clfur.Environment([(.25, .36, .6), (.6, .45, .32), (.1, .09, .05)],
                                                                  intensity=.4),
                       ground=clfur.Ground(height=0, color=(.12, .1, .03)))


def behind(size):
    """An evening sky."""
    width, height = size
    up = np.clip(1 - np.arange(height) / height / .52, 0, 1)[:, None, None] * np.ones((1, width, 1))
    x = np.abs(np.arange(width) / width - .78)[None, :, None]
    glow = np.exp(-(x / .3)**2 - (up / .35)**2)
    return ((.95, .5, .22) * (1 - up)**1.5 + (.16, .24, .42) * up + glow * (.9, .5, .15)).astype(np.float32)


def main(folder=".", size=(800, 600), blades=120_000):
    studio.shoot(scene(size, blades), Path(folder) / "meadow.png", settings, behind)


if __name__ == "__main__":
    main()
