"""Direct light on places of a scene, in float64: of lights with what stands before each, and on a ground."""

import math

import attrs
import numpy as np

from .. import layout
from ..scene import extent
from ..scene.environment import ambient_of
from ..scene.ground import ground_from, height_of
from ..twin import ground, scatter
from ..twin.vectors import dot, unit
from .geometry import before
from .places import on_body, on_strand
from .rays import Eye, frame_along

STEEP = 1.5              # radians aside that a point light looks for what shades
DISC = 64                # points of a disc from which it shines
EVEN = (math.sqrt(5) - 1) / 2


class Straight:
    """Light that comes to what is seen straight from lights and a sky."""

    def __init__(self, scene, hair, body, lights, sky):
        self.scene, self.hair, self.body, self.lights, self.sky = scene, hair, body, lights, sky

    def light(self, p, v, fibre, triangle, share, random):
        """Light [n, 3] that places send towards v.

        p, v: [n, 3]; each lies on a segment ``fibre`` [n], a share of the way along it, or on a triangle [n] (-1: not).
        random: [n, 3], see `Sky.light`; None without a sky.
        """
        sent = np.zeros(p.shape)
        for some, of, on in ((fibre >= 0, self._of_hair, (fibre, share)), (fibre < 0, self._of_body, (triangle,))):
            its = p[some], v[some], *(each[some] for each in on)
            sent[some] = of(*its, None if random is None else random[some])
        return sent

    def _of_hair(self, p, v, fibre, share, random):
        strand, t, color = on_strand(self.hair, fibre, share)
        kind, none, sent = self.hair.kind[strand], np.full(len(p), -1), 0
        for light in self.lights:
            to_light, direct = light.arriving(p, strand, none)
            sent = sent + scatter.fibre(color, self.hair.shine[kind], t, to_light, v, direct, light.ambient,
                                        self.hair.lobes[kind])
        return sent + color * self.sky.light(p, t, none > 0, strand, none, random) if self.sky else sent

    def _of_body(self, p, v, triangle, random):
        n, color = on_body(self.scene, self.body, triangle, p, v)
        none = np.full(len(p), -1)
        sent = sum(color * (light.arriving(p, none, triangle, n)[1] + light.ambient) for light in self.lights)
        return sent + color * self.sky.light(p, n, none < 0, none, triangle, random) if self.sky else sent


class Light:
    """One light of a scene on places in it."""

    def __init__(self, scene, light, hair, body, scatters=False):
        self.light, self.hair = light, hair
        self.ambient = ambient_of(light, scene.environment, scatters)
        spot, direction = self.light.position is not None, self.light.direction
        center, radius = extent(scene.mesh, scene.fur)
        if light.everywhere:
            direction = _ahead(light, center)
        self.eye = Eye(self.light.position if spot else np.zeros(3), frame_along(direction), not spot)
        near = 1e-6 * (radius or 1.0)
        if spot:
            half = math.radians(self.light.angle) / 2
            if light.everywhere:   # what lies behind it shades nothing that it may stand before
                off = max(float(np.linalg.norm(center - light.position)), 1e-30)
                half = min(math.asin(min(1.01 * radius / off, 1)), STEEP)
            window = np.array([[-1], [1]]) * np.full(2, math.tan(half))
        else:
            places = self.eye.places(self.eye.frame(np.concatenate([hair.points[:, :3], body.positions])))
            grown = hair.points[:, 3].max(initial=0)
            window = places.min(0, initial=np.inf) - grown, places.max(0, initial=-np.inf) + grown
        self.fibres, self.triangles = before(self.eye, hair, body, near, window)
        with np.errstate(divide="ignore"):
            self.depth = np.log(hair.shine[hair.kind[hair.owner], 2])     # of a crossing; alpha 0 lets nothing through
        self.bias = 1e-7 * radius                                         # a place on the body is not before itself

    def arriving(self, p, strand, triangle, normal=None):
        """What comes to places p [n, 3], which lie on a strand or a triangle [n] (-1: not) -> (unit vectors to the
        light, its light) [n, 3]; by its cosine with a normal [n, 3], if that is given."""
        to_light, direct = self._unshadowed(p)
        if normal is not None:
            direct *= np.maximum(dot(normal, to_light), 0)[:, None]
        some = np.flatnonzero(direct.any(1))
        direct[some] *= self._transmittance(p[some], triangle[some], strand[some])[:, None]
        return to_light, direct

    def on_ground(self, p):
        """What falls on places p of a level plane: (all of it, what is left of it) [n, 3]."""
        to_light, direct = self._unshadowed(p)
        direct = direct * np.maximum(to_light[:, 1:2], 0)
        left, some = direct.copy(), np.flatnonzero(direct.any(1))
        none = np.full(len(some), -1)
        left[some] *= self._transmittance(p[some], none, none)[:, None]
        return direct + self.ambient, left + self.ambient

    def _unshadowed(self, p):
        """(unit vectors to the light, its colour where nothing is in its way) [n, 3]."""
        light = self.light
        direct = np.repeat(light.strength[None].astype(float), len(p), 0)
        if light.position is None:
            return np.broadcast_to(-light.direction, p.shape), direct
        to_light = unit(light.position - p)
        if not light.everywhere:
            direct[-to_light @ light.direction < math.cos(math.radians(light.angle) / 2)] = 0
        return to_light, direct

    def _transmittance(self, p, triangle, strand):
        """Share of the light [n] that is left at places p, which lie on a triangle or a strand (-1: not)."""
        if not len(p) or not self.light.shadows:
            return np.ones(len(p))
        framed = self.eye.frame(p)
        places, z = self.eye.places(framed), framed[:, 2]
        share = np.where(self.triangles.any_before(places, z - self.bias, triangle), 0.0, 1.0)
        if (self.depth < 0).any():
            some = np.flatnonzero(share)
            share[some] = np.exp(self.fibres.sum_before(
                places[some], z[some], strand[some], self.hair.owner, self.depth))
        return share


class Disc:
    """A light of a scene that is a disc: as many lights without a size, one of which shines to each place."""

    def __init__(self, scene, light, hair, body, scatters=False):
        center, _ = extent(scene.mesh, scene.fur)
        x, y, z = frame_along(_ahead(light, center) if light.everywhere else light.direction)
        across = light.size if light.position is not None else math.tan(math.radians(light.size) / 2)
        self.points, self.turn = [], 0.0
        for a, b in layout.disc(DISC).astype(float) * across:
            where = {"direction": z + a * x + b * y} if light.position is None else {
                "position": light.position + a * x + b * y}
            self.points.append(Light(scene, attrs.evolve(light, size=0.0, **where), hair, body, scatters))

    @property
    def ambient(self):
        """That of the light."""
        return self.points[0].ambient

    def arriving(self, p, *rest):
        """See `Light.arriving`: of a point each, neighbours of others, all over the disc."""
        return self._from_each(p, "arriving", *rest)

    def on_ground(self, p):
        """See `Light.on_ground`."""
        return self._from_each(p, "on_ground")

    def _from_each(self, p, name, *rest):
        """Two results [n, 3] of the points, of one for each place."""
        which = ((np.arange(len(p)) * EVEN + self.turn) % 1 * DISC).astype(int)
        self.turn += EVEN * (len(p) + .5)
        result = np.zeros((2, len(p), 3))
        for number, point in enumerate(self.points):
            its = np.flatnonzero(which == number)
            if len(its):
                result[:, its] = getattr(point, name)(p[its], *(each[its] for each in rest))
        return result


def _ahead(light, center):
    """The way [3] from a point light to the middle of a scene."""
    way = center - light.position
    length = np.linalg.norm(way)
    return way / length if length else np.array([0.0, 0, -1])


class Ground:
    """The scene's ground, as its camera sees it."""

    def __init__(self, scene):
        self.color, self.seen = scene.ground.color, ground_from(scene.camera, height_of(scene))

    def distances(self, pixels):
        """How far ahead each ray [n, 2] meets it, [n]: infinite where it does not."""
        if self.seen is None:
            return np.full(len(pixels), np.inf)
        down, above = self.seen
        falls = np.column_stack([pixels, np.ones(len(pixels))]) @ down
        return np.where(falls > 0, above / np.where(falls > 0, falls, 1), np.inf)

    def light(self, p, lights, sky, random):
        """Light and alpha [n, 4] at places p of it, also of a sky; for ``random`` see `Sky.light`."""
        if not len(p):
            return np.zeros((0, 4))
        whole, left = (sum(each) for each in zip(*(light.on_ground(p) for light in lights)))
        if sky:
            none, up = np.full(len(p), -1), np.tile((0.0, 1.0, 0.0), (len(p), 1))
            whole = whole + sky.on_level()
            left = left + sky.light(p, up, none < 0, none, none, random)
        if self.color is not None:
            return np.column_stack([self.color * left, np.ones(len(p))])
        all_of_it = whole @ ground.LUMINANCE
        alpha = np.where(all_of_it > 0, 1 - left @ ground.LUMINANCE / np.where(all_of_it > 0, all_of_it, 1), 0)
        return np.column_stack([np.zeros((len(p), 3)), alpha])
