"""A meadow in the evening: blades of grass as strands of one's own, and flowers whose petals are strands, too."""

import numpy as np
import studio
from models.animals import noise
from models.meadow import far, flowers, grass

import clfur


@studio.picture(studio.evening_sky, settings=clfur.Settings(masks=4))
def meadow(size, blades=120_000):
    random, t = np.random.default_rng(5), np.linspace(0, 1, 8)[:, None]
    points, depth, lean = grass(blades, random)
    dry = np.clip(.2 + .25 * noise(points[:, 0], .9, 4) + random.normal(0, .2, blades), 0, 1)[:, None, None]
    color = ((.02, .06, .006) + t * (.09, .2, .015)) * (1 - dry) + ((.13, .1, .03) + t * (.32, .22, .07)) * dry
    width = .0045 * far(depth) * np.clip(1.3 - 1.3 * t[:, 0], .08, 1)
    both = zip((points, color, width), flowers(420, points, depth, lean, random))
    points, color, width = map(np.concatenate, both)
    fur = clfur.Curves(points, width=width, color=np.clip(color, 0, 1), alpha=.15, look=clfur.Chiang(.4, .5))
    return studio.evening(fur, (0, .4, 3), (0, .36, 0), size)


if __name__ == "__main__":
    meadow()
