"""A dandelion clock of strands alone: 150 seeds on stalks, each with a parachute, some of which the wind has taken."""

from pathlib import Path

import numpy as np
import studio

import clfur

behind = studio.backdrop((.12, .18, .06), (.32, .35))
settings = clfur.Settings(masks=4, shadows="deep", scattering="grid")
HAIRS, POINTS = 56, 9


def seed(center, way, reach, random):
    """Strands [n, POINTS, 3] of one seed: its grain, its stalk, and the hairs at the end of it."""
    aside = np.linalg.svd(way[None])[2][1:]
    t = np.linspace(0, 1, POINTS)[:, None]
    stalk, grain = center + reach * way * (.12 + .88 * t), center + reach * way * (-.04 + .2 * t)
    turn = random.uniform(0, 2 * np.pi, HAIRS)
    out = np.cos(turn)[:, None] * aside[0] + np.sin(turn)[:, None] * aside[1]
    rise = random.uniform(.08, .4, (HAIRS, 1))
    end = .2 * random.uniform(.75, 1.1, (HAIRS, 1)) * (out + rise * way) / np.sqrt(1 + rise**2)
    hairs = stalk[-1] + end[:, None] * t + .03 * way * (t * (1 - t))
    return np.concatenate([grain[None], stalk[None], hairs])


def clock(seeds=150):
    random, strands = np.random.default_rng(4), []
    k = np.arange(seeds) + .5
    y, turn = 1 - 2 * k / seeds, 2.399963 * k
    ways = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], 1)
    for way in ways + random.normal(0, .05, ways.shape):
        way = way / np.linalg.norm(way)
        gone = way @ (.75, .6, .25) + random.normal(0, .12) > .72
        if way[1] > -.93 and not gone:
            strands.append(seed(.07 * way, way, .5 * random.uniform(.93, 1.05), random))
    for place in [(.78, .36, .2), (1.05, .62, -.1), (.62, .72, .3), (1.32, .3, 0), (1.4, .78, -.3), (.98, .1, .1)]:
        way = np.array([.45, .8, .1]) + random.normal(0, .25, 3)
        strands.append(seed(np.array(place), way / np.linalg.norm(way), .4, random))
    t = np.linspace(0, 1, POINTS)[:, None]
    stem = np.array([[.02, -.05, 0]]) + t * (-.22, -1.6, 0) + .12 * t * (1 - t) * (1, 0, 0)
    stems = stem + .025 * np.array([(np.cos(a), 0, np.sin(a)) for a in np.arange(40)])[:, None]
    core = np.array([[w * .09 * s for s in np.linspace(.1, 1, POINTS)] for w in ways])
    return np.concatenate(strands), np.concatenate([stems, core])


def scene(size=(800, 600), seeds=150):
    white, green = clock(seeds)
    along = np.linspace(1, .35, POINTS)
    width = np.concatenate([np.full(len(white), .0019), np.full(len(green), .013)])[:, None] * along
    kind = np.arange(len(white)) % (HAIRS + 2)
    width[:len(white)][kind == 0] = .014 * np.sin(np.linspace(.4, 3, POINTS))
    color = np.concatenate([np.tile((.9, .88, .84), (len(white), 1)), np.tile((.1, .16, .03), (len(green), 1))])
    color[:len(white)][kind == 0], color[:len(white)][kind == 1] = (.22, .11, .05), (.6, .52, .38)
    fur = clfur.Curves(np.concatenate([white, green]), width=width, color=color, alpha=.3,
                       look=clfur.Chiang(azimuthal_roughness=.5))
    return clfur.Scene(fur=fur, camera=clfur.Camera((.3, .25, 4.1), (.3, .12, 0), fov=29, size=size),
                       environment=studio.SKY,
                       light=[clfur.Light((-.75, -.7, .9), color=(1, .86, .62), intensity=1.7),
                              clfur.Light((.6, -.5, -1), intensity=.5)])


def main(folder=".", size=(800, 600), seeds=150):
    studio.shoot(scene(size, seeds), Path(folder) / "dandelion.png", settings, behind)


if __name__ == "__main__":
    main()
