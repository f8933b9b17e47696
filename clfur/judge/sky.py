"""The light that a sky sends to places of a scene, by one ray each, in float64."""

import numpy as np

from .space import Space, dot

GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])   # 1 / g and 1 / g², g the root of g³ = g + 1


def space_of(hair, body):
    """The `Space` of a scene's strands and body."""
    with np.errstate(divide="ignore"):
        depth = np.maximum(np.log(hair.shine[hair.kind[hair.owner], 2]), -1e3)
    return Space(hair.points[hair.first], hair.points[hair.first + 1], hair.owner, depth,
                 body.positions[body.triangles[:, :3]])


class Sky:
    """A scene's sky, and what of the scene hides it."""

    def __init__(self, scene, hair, body):
        picture = scene.environment.picture.astype(float)
        self.picture, self.rotation = picture, np.radians(scene.environment.rotation)
        height, width = picture.shape[:2]
        self.edges = np.sin(np.pi * (np.arange(height + 1) / height - 0.5))            # from below, upwards
        chance = picture[::-1].sum(2) * np.diff(self.edges)[:, None]
        self.total = chance.sum() * 2 * np.pi / width
        self.sums = np.cumsum(chance) / (chance.sum() or 1.0)
        self.space = space_of(hair, body)
        self.bias = 1e-7 * float(self.space.cell * self.space.n.max())

    def radiance(self, w):
        """Light [n, 3] from directions [n, 3], that of the picture's pixel there."""
        row, column = self._pixel(w)
        return self.picture[row, column]

    def on_level(self):
        """Light [3] that falls on a level plane where nothing hides the sky, over that of a sky of 1."""
        width = self.picture.shape[1]
        counts = np.diff(np.maximum(self.edges, 0) ** 2) / width   # of cosines, over pi
        return (self.picture[::-1] * counts[:, None, None]).sum((0, 1))

    @property
    def even(self):
        """Whether it is the same all around."""
        return bool((self.picture == self.picture[0, 0]).all())

    def chance(self, w):
        """How likely `towards` gives directions w [n, 3] -> [n]; of a sky that is not all black."""
        return self.radiance(w).sum(1) / self.total

    def light(self, p, axis, surface, strand, triangle, random):
        """Estimates [n, 3] of the light that comes to places p [n, 3] from all around, over that of a sky of 1.

        It counts by its cosine with ``axis`` [n, 3] where that is the normal of a ``surface`` [n], else by its sine.
        For ``strand`` and ``triangle`` see `Space.light_left`; ``random`` [n, 3] chooses one direction each, see
        `spread`: half of them are towards what is bright, half go by the place (Veach's balance heuristic).
        """
        choice, u, v = random.T
        bright = (choice == 0) & (self.total > 0)
        w = np.where(bright[:, None], self.towards(u, v), around(axis, surface, u, v))
        counts = np.where(surface, np.maximum(dot(axis, w), 0), np.sqrt(np.maximum(1 - dot(axis, w) ** 2, 0)))
        radiance = self.radiance(w)
        of_sky = radiance.sum(1) / self.total if self.total > 0 else 0.0
        of_place = np.where(surface, counts / np.pi, 1 / (4 * np.pi))
        chance = 0.5 * (of_sky + of_place) if self.total > 0 else of_place
        weight = np.where(chance > 0, counts / np.where(surface, np.pi, np.pi**2) / np.where(chance > 0, chance, 1), 0)
        some = np.flatnonzero(weight * radiance.sum(1))
        weight[weight * radiance.sum(1) == 0] = 0
        weight[some] *= self.space.light_left(p[some], w[some], strand[some], triangle[some], self.bias)
        return weight[:, None] * radiance

    def _pixel(self, w):
        height, width = self.picture.shape[:2]
        row = np.clip(np.searchsorted(self.edges, w[:, 1], "right") - 1, 0, height - 1)
        turn = (np.arctan2(w[:, 0], -w[:, 2]) - self.rotation) / (2 * np.pi) + 0.5
        return height - 1 - row, np.floor(turn % 1.0 * width).astype(int) % width

    def towards(self, u, v):
        """Directions [n, 3] by two numbers 0..1 each, as likely as a place of the sky is bright."""
        width = self.picture.shape[1]
        k = np.minimum(np.searchsorted(self.sums, u, "right"), len(self.sums) - 1)
        before = np.where(k > 0, self.sums[k - 1], 0.0)
        share = np.clip((u - before) / np.maximum(self.sums[k] - before, 1e-300), 0, 1)
        row, column = np.divmod(k, width)
        up = self.edges[row] + share * (self.edges[row + 1] - self.edges[row])
        turn = 2 * np.pi * ((column + v) / width - 0.5) + self.rotation
        aside = np.sqrt(np.maximum(1 - up * up, 0))
        return np.stack([aside * np.sin(turn), up, -aside * np.cos(turn)], 1)


def spread(n, start):
    """Numbers [..., n, 3] for `Sky.light`: turn by turn 0 and 1, and two of 0..1 that fill a square evenly, from
    ``start`` [..., 1, 2] on (by Roberts' sequence)."""
    k = np.broadcast_to(np.arange(n)[:, None], (*start.shape[:-2], n, 1))
    return np.concatenate([k % 2, (start + (k // 2 + 1) * GOLDEN) % 1.0], -1)


def around(axis, surface, u, v):
    """Directions by two numbers: as likely as their cosine with the normal of a surface, else all alike."""
    turn = 2 * np.pi * v
    along = np.where(surface, np.sqrt(u), 2 * u - 1)
    aside = np.sqrt(np.maximum(1 - along**2, 0))
    x = np.cross(axis, np.eye(3)[np.abs(axis).argmin(1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(axis, x)
    return along[:, None] * axis + (aside * np.cos(turn))[:, None] * x + (aside * np.sin(turn))[:, None] * y
