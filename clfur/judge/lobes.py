"""How hair of the look `clfur.Chiang` sends a path of light on, in float64: directions by chance, how likely they are.

Of a place h across the strand that is chosen at random: the mean over all of them is `twin.chiang.scattering`.
"""

import numpy as np

from ..twin import chiang
from .space import dot

ASIDE = 2.0, -1.0, -4.0, 0.0   # tilts by which each lobe leans, as in `twin.chiang.longitudinal`


class Seen:
    """Strands of one look as light meets them that comes from the eye.

    t, v: [n, 3] unit: along the strands, back to where the path came from; color: [n, 3]; lobes: [4] as
    `layout.HairType` has them.
    """

    def __init__(self, t, v, color, lobes):
        self.t, (self.roughness, self.around, tilt, self.index) = t, map(float, lobes)
        self.sigma = chiang.absorption_of(color, self.around)
        sine = np.clip(dot(t, v), -1, 1)
        self.theta = np.arcsin(sine)
        across = v - sine[:, None] * t
        other = np.cross(t, np.eye(3)[np.abs(t).argmin(1)])
        across = np.where(dot(across, across)[:, None] > 1e-20, across, other)   # seen along itself
        self.x = across / np.linalg.norm(across, axis=1, keepdims=True)
        self.y = np.cross(t, self.x)
        leaning = self.theta[:, None] + tilt * np.array(ASIDE)
        self.sines, self.cosines = -np.sin(leaning), np.abs(np.cos(leaning))     # of each lobe's middle [n, 4]
        self.variances = chiang.variances(self.roughness)

    def take(self, some):
        """The same of some of the strands."""
        result = object.__new__(Seen)
        result.__dict__.update({name: value[some] if isinstance(value, np.ndarray) and name != "variances" else value
                                for name, value in self.__dict__.items()})
        return result

    def shares(self, h):
        """What leaves by each lobe of light at places h [n, k] -> [n, k, 4, 3]."""
        theta = self.theta[:, None]
        return np.stack([chiang.attenuations(theta, h, self.sigma[:, c, None], self.index) for c in range(3)], -1)

    def choose(self, weight, random):
        """Directions by chance, of a path that counts by weight [n, 3]; random: a generator -> (directions [n, 3], what
        goes that way over how likely it is [n, 3], places h [n])."""
        n = len(self.t)
        h = 2 * random.random(n) - 1
        shares = self.shares(h[:, None])[:, 0]
        sums = np.cumsum(_chances(shares, weight), 1)
        lobe = (random.random(n)[:, None] >= sums[:, :3]).sum(1)
        chance = np.take_along_axis(np.diff(sums, axis=1, prepend=0), lobe[:, None], 1)
        its = np.arange(n), lobe
        factor = shares[its] / np.where(chance > 0, chance, 1)
        sine, turn = self._along(its, random), self._turn(h, lobe, random)
        cosine = np.sqrt(np.maximum(1 - sine * sine, 0))
        aside = np.cos(turn)[:, None] * self.x + np.sin(turn)[:, None] * self.y
        return sine[:, None] * self.t + cosine[:, None] * aside, factor, h

    def sent(self, w, h, weight):
        """How much of light from directions w [n, 3] goes on at places h [n, k] -> (S [n, k, 3], how likely `choose`
        chooses w there [n, k])."""
        shares = self.shares(h)
        turn = np.arctan2(dot(w, self.y), dot(w, self.x))[:, None]
        around = chiang.turned(turn, self.theta[:, None], h, self.around, self.index)
        both = around * self._how_far_along(np.clip(dot(w, self.t), -1, 1))[:, None]
        chances = _chances(shares, weight[:, None])
        return (shares * both[..., None]).sum(2), (chances * both).sum(2)

    def _along(self, its, random):
        """Sines of angles along the strand: of directions about a lobe's middle as von Mises and Fisher have them."""
        v = self.variances[its[1]]
        u = random.random(len(v))
        cosine = np.clip(1 + v * np.log(u + (1 - u) * np.exp(-2 / v)), -1, 1)
        aside = np.sqrt(1 - cosine**2) * np.cos(2 * np.pi * random.random(len(v)))
        return np.clip(cosine * self.sines[its] + aside * self.cosines[its], -1, 1)

    def _turn(self, h, lobe, random):
        """Angles around the strand: logistic about where a lobe sends light, all alike in the last."""
        s, u = chiang.scale(self.around), random.random(len(h))
        least = 1 / (1 + np.exp(np.pi / s))
        away = -s * np.log(1 / (least + u * (1 - 2 * least)) - 1)
        inside = np.arcsin(h * np.cos(self.theta) / np.sqrt(self.index**2 - np.sin(self.theta)**2))
        middle = 2 * lobe * inside - 2 * np.arcsin(h) + lobe * np.pi
        return np.where(lobe < chiang.LOBES - 1, middle + away, 2 * np.pi * u)

    def _how_far_along(self, sine):
        """M of each lobe towards sines [n] -> [n, 4], see `twin.chiang.longitudinal`."""
        v, cosine = self.variances, np.sqrt(1 - sine * sine)[:, None]
        x = self.cosines * cosine / v
        return _bessel(x) * np.exp(x + (self.sines * sine[:, None] - 1) / v) / (v * -np.expm1(-2 / v))


def _chances(shares, weight):
    """Of lobes [..., 4, 3], by what they would leave of a path's weight [..., 3] -> [..., 4]."""
    left = (shares * weight[..., None, :]).sum(-1)
    all_of_it = left.sum(-1, keepdims=True)
    return np.where(all_of_it > 0, left / np.where(all_of_it > 0, all_of_it, 1), 1 / chiang.LOBES)


def _bessel(x):
    """exp(-x) I0(x), x >= 0."""
    small, large = np.minimum(x, 50), np.maximum(x, 50)
    term, series = 1.0, 1.0
    for k in range(1, 12):
        term = term * (2 * k - 1)**2 / (8 * k * large)
        series = series + term
    return np.where(x < 50, np.i0(small) * np.exp(-small), series / np.sqrt(2 * np.pi * large))
