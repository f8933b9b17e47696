"""Human hair from strands of one's own: guides that walk over a head, and 70,000 strands in locks along them."""

import numpy as np
import studio
from models.head import POINTS, locks, mesh

import clfur


@studio.picture(studio.backdrop((.16, .17, .21)))
def portrait(size, strands=70_000, guides=420):
    random, t = np.random.default_rng(2), np.linspace(0, 1, POINTS)[:, None]
    points, lock = locks(strands, guides, random)
    shade = random.uniform(.6, 1.35, (guides, 1))[lock] * random.uniform(.8, 1.2, (strands, 1))
    color = np.clip(shade[:, None] * (np.array([.16, .045, .012]) + t * (.2, .085, .03)), 0, 1)
    counts = random.integers(int(.75 * POINTS), POINTS + 1, strands)   # hairs end here and there
    along = np.arange(POINTS) / counts[:, None]
    width, kept = .0042 * np.minimum(1, 4 * (1 - along) + .05), along < 1
    hair = clfur.Curves(points[kept], counts=counts, width=width[kept], color=color[kept], alpha=.15,
                        look=clfur.Chiang(.25, .3))
    return studio.stage(mesh(), hair, (-3.5, .35, 2.5), (-.08, -.36, -.11), size, (.5, .3, .21), 38, height=-4)


if __name__ == "__main__":
    portrait()
