"""Light that goes from hair to hair and to the body, and on: paths from places that are seen, in float64."""

from types import SimpleNamespace

import numpy as np

from .lobes import Seen
from .places import on_body, on_strand
from .sky import around, space_of
from .space import dot

AT_ONCE = 1 << 15        # paths: fewer, and NumPy's calls cost more than what they do
PARTS = 8                # of a strand's width, in each of which a place is asked how it sends light to the eye
LEAST = 3                # times that light is scattered before a path may end by chance


class Paths:
    """What paths go through in a scene.

    lights: objects with ambient and arriving(p, strand, triangle), see
    `lights`.  sky: a `Sky`, or None.  orders: how many times light is scattered at most.
    """

    def __init__(self, scene, hair, body, lights, sky, orders):
        self.scene, self.hair, self.body, self.lights = scene, hair, body, lights
        self.space = space = sky.space if sky else space_of(hair, body)
        self.sky, self.orders = sky, orders
        self.bias = 1e-7 * float(space.cell * space.n.max())
        self.ambient = sum(light.ambient for light in lights)
        self.aims = sky is not None and not sky.even     # at what is bright of the sky

    def light(self, p, v, fibre, triangle, share, random):
        """Estimates [n, 3] of the light that places send towards v, one path each.

        p, v: [n, 3]; each lies on a segment ``fibre`` [n], a share of the way along it, or on a triangle [n] (-1: not).
        random: a generator.
        """
        sent, begun = np.zeros((len(p), 3)), 0
        paths = self._begin(p, v, fibre, triangle, share, 0, 0)
        while begun < len(p) or len(paths.number):
            end = min(len(p), begun + AT_ONCE - len(paths.number))
            paths = _both(paths, self._begin(p, v, fibre, triangle, share, begun, end))
            begun = end
            paths = self._follow(paths, sent, random)
        return sent

    def _begin(self, p, v, fibre, triangle, share, begin, end):
        some = slice(begin, end)
        n = end - begin
        return SimpleNamespace(number=np.arange(begin, end), p=p[some], v=v[some], fibre=fibre[some],
                               triangle=triangle[some], share=share[some], weight=np.ones((n, 3)),
                               order=np.zeros(n, int))

    def _follow(self, paths, sent, random):
        """Add the light that comes straight to where paths are to ``sent`` [all, 3], and go on -> those that do."""
        on_hair = paths.fibre >= 0
        n = len(on_hair)
        w, factor, chance, light = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3))
        strand = np.full(n, -1)
        strand[on_hair] = self.hair.owner[paths.fibre[on_hair]]
        for some, step in (on_hair, self._from_hair), (~on_hair, self._from_body):
            some = np.flatnonzero(some)
            if len(some):
                light[some], w[some], factor[some], chance[some] = step(_some(paths, some), strand[some], random)
        sent[paths.number] += light * paths.weight
        paths.weight, paths.order = paths.weight * factor, paths.order + 1
        goes = self._goes_on(paths, random)
        paths, w, chance, strand = _some(paths, goes), w[goes], chance[goes], strand[goes]
        distance, fibre, triangle = self.space.nearest(paths.p, w, strand, paths.triangle, self.bias, random)
        if self.sky:
            out = np.flatnonzero(distance == np.inf)
            others = self.sky.chance(w[out]) if self.aims else 0.0
            counts = chance[out] / (chance[out] + others) if self.aims else np.ones(len(out))
            sent[paths.number[out]] += paths.weight[out] * counts[:, None] * self.sky.radiance(w[out])
        goes = np.flatnonzero((distance < np.inf) & (paths.order < self.orders))
        paths, distance, w = _some(paths, goes), distance[goes], w[goes]
        paths.p, paths.v = paths.p + distance[:, None] * w, -w
        paths.fibre, paths.triangle = fibre[goes], triangle[goes]
        paths.share = self._share(paths.p, paths.fibre)
        return paths

    def _goes_on(self, paths, random):
        """Which paths go on: some of what counts little, and that for more (Russian roulette)."""
        most = paths.weight.max(1, initial=0)
        stays = np.where(paths.order < LEAST, most > 0, np.minimum(most, 1))
        paths.weight = paths.weight / np.where(stays > 0, stays, 1)[:, None]
        goes = random.random(len(most)) < stays
        return np.flatnonzero(goes if self.sky else goes & (paths.order < self.orders))

    def _share(self, p, fibre):
        """How far along segments places are; 0 where there is no segment."""
        a, d = self.space.a[fibre, :3] if len(self.space.a) else p, self.space.d[fibre, :3] if len(self.space.a) else p
        return np.where(fibre >= 0, np.clip(dot(p - a, d) / np.maximum(dot(d, d), 1e-300), 0, 1), 0)

    def _from_hair(self, at, strand, random):
        """Light that hair sends on of what comes straight to it, and where to go on.

        -> (light, directions, what goes that way over how likely it is) [n, 3], how likely directions are [n].
        """
        _, t, color = on_strand(self.hair, at.fibre, at.share)
        light, w, factor = np.zeros(t.shape), np.zeros(t.shape), np.zeros(t.shape)
        chance = np.zeros(len(t))
        looks = self.hair.lobes[self.hair.kind[strand]]
        for look in np.unique(looks, axis=0):
            some = np.flatnonzero((looks == look).all(1))
            seen, weight = Seen(t[some], at.v[some], color[some], look), at.weight[some]
            w[some], factor[some], h = seen.choose(weight, random)
            if self.aims:
                chance[some] = seen.sent(w[some], h[:, None], weight)[1][:, 0]

            def sends(those, towards, others):
                """What is sent of light from a direction, of ways to choose it that are known to be as likely."""
                h = (np.arange(PARTS) + random.random((len(those), PARTS))) / PARTS * 2 - 1
                s, likely = seen.take(those).sent(towards, h, weight[those])
                return (s if others is None else s * (others / (others + likely))[..., None]).mean(1)
            light[some] = self._straight(at.p[some], strand[some], at.triangle[some], sends, random)
        return light + color * (self.ambient * (at.order == 0))[:, None], w, factor, chance

    def _from_body(self, at, strand, random):
        """The same of the body."""
        n, color = on_body(self.scene, self.body, at.triangle, at.p, at.v)
        edges = self.space.edges[at.triangle]
        flat = np.cross(edges[:, 0], edges[:, 1])
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        flat = np.where(dot(flat, at.v)[:, None] < 0, -flat, flat)
        w = around(n, np.ones(len(n), bool), *random.random((2, len(n))))
        w = np.where(dot(flat, w)[:, None] < 0, _mirrored(w, flat), w)

        def sends(those, towards, others):
            if others is None:
                return color[those] * (np.maximum(dot(n[those], towards), 0) / np.pi)[:, None]
            likely = _facing(n[those], flat[those], towards)
            return color[those] * (likely * others[:, 0] / (others[:, 0] + likely))[:, None]
        light = self._straight(at.p, strand, at.triangle, sends, random)
        light += color * (self.ambient * (at.order == 0))[:, None]
        return light, w, np.minimum(color, 1), _facing(n, flat, w)   # or light would never end

    def _straight(self, p, strand, triangle, sends, random):
        """What places send on [n, 3] of light that comes to them straight; sends(places, directions, how likely these
        are [n, 1], None for a light's one) -> [n, 3]."""
        result = np.zeros(p.shape)
        for light in self.lights:
            towards, comes = light.arriving(p, strand, triangle)
            lit = np.flatnonzero(comes.any(1))
            result[lit] += np.pi * comes[lit] * sends(lit, towards[lit], None)
        if self.aims:
            w = self.sky.towards(*random.random((2, len(p))))
            left = self.space.light_left(p, w, strand, triangle, self.bias)
            lit = np.flatnonzero(left)
            chance = self.sky.chance(w[lit])[:, None]
            result[lit] += self.sky.radiance(w[lit]) * (left[lit, None] / chance) * sends(lit, w[lit], chance)
        return result


def _mirrored(w, flat):
    return w - 2 * dot(w, flat)[:, None] * flat


def _facing(n, flat, w):
    """How likely paths go on in directions w from a surface: as their cosine with its normal n, where that leads under
    the triangle mirrored by it."""
    both = np.maximum(dot(n, w), 0) + np.maximum(dot(n, _mirrored(w, flat)), 0)
    return np.where(dot(flat, w) > 0, both / np.pi, 0)


def _some(paths, which):
    return SimpleNamespace(**{name: value[which] for name, value in vars(paths).items()})


def _both(paths, others):
    return SimpleNamespace(**{name: np.concatenate([value, vars(others)[name]]) for name, value in vars(paths).items()})
