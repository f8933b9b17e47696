"""Animals by code: a body of balls and cones that flow into each other, its surface as a mesh, and what grows where."""

from collections.abc import Callable, Sequence

import attrs
import numpy as np

import clfur

CELLS = 80   # across the longest side of a body


def ball(center, radii, turn=(0, 0, 0)):
    """An ellipsoid, turned by degrees about x, then y, then z: a function of places [..., 3] that gives distances."""
    radii, axes = np.broadcast_to(np.asarray(radii, float), 3), np.eye(3)
    for axis, angle in enumerate(np.radians(turn)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one = np.eye(3)
        one[[i, j], [i, j]], one[j, i], one[i, j] = np.cos(angle), np.sin(angle), -np.sin(angle)
        axes = one @ axes

    def distance(p):
        away = (p - center) @ axes / radii + 1e-9
        length = np.sqrt((away**2).sum(-1))
        return length * (length - 1) / np.maximum(np.sqrt(((away / radii)**2).sum(-1)), 1e-9)
    return distance


def cone(begin, end, radius, other):
    """A cone with round ends."""
    begin, way = np.asarray(begin, float), np.subtract(end, begin)

    def distance(p):
        along = np.clip((p - begin) @ way / (way @ way), 0, 1)
        return np.sqrt(((p - begin - along[..., None] * way)**2).sum(-1)) - radius - along * (other - radius)
    return distance


def both(shape):
    """The same left and right."""
    return lambda p: shape(np.concatenate([abs(p[..., :1]), p[..., 1:]], -1))


def joined(*shapes, soft=.1):
    """Shapes that flow into each other over a length."""
    def distance(p):
        d = shapes[0](p)
        for shape in shapes[1:]:
            other = shape(p)
            d = np.minimum(d, other) - np.maximum(soft - abs(d - other), 0)**2 / (4 * soft)
        return d
    return distance


def surface(shape, low, high, cells=None):
    """(positions, normals, faces) where a shape's distance is 0: naive surface nets (Gibson 1998)."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    step = (high - low).max() / (cells or CELLS)
    count = np.ceil((high - low) / step).astype(int) + 1
    at = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), -1)
    inside = shape(low + step * at) < 0
    corners = np.sum([inside[x:count[0] - 1 + x, y:count[1] - 1 + y, z:count[2] - 1 + z]
                      for x in (0, 1) for y in (0, 1) for z in (0, 1)], 0)
    number = np.full(count - 1, -1)
    mixed = (corners > 0) & (corners < 8)
    number[mixed] = np.arange(mixed.sum())
    places, faces = low + step * (np.argwhere(mixed) + .5), []
    for _ in range(3):
        slope = np.stack([shape(places + e) - shape(places - e) for e in .2 * step * np.eye(3)], -1) / (.4 * step)
        places = places - np.clip(shape(places), -step, step)[:, None] * slope / (slope**2).sum(-1, keepdims=True)
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        change = np.diff(inside.astype(int), axis=axis)
        edge = np.argwhere(change)
        edge = edge[(edge[:, i] > 0) & (edge[:, j] > 0)]
        around = [number[tuple((edge - a * np.eye(3, dtype=int)[i] - b * np.eye(3, dtype=int)[j]).T)]
                  for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        quad = np.stack(around, -1)
        quad = np.where(change[tuple(edge.T)][:, None] < 0, quad, quad[:, ::-1])
        faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return places, slope, np.concatenate(faces)


def noise(p, size, seed=0):
    """Smooth random numbers about 0 with a standard deviation of 1, of waves of a size."""
    random = np.random.default_rng(seed)
    waves = random.normal(0, 1, (3, 24)) * 2.5 / size
    return np.cos(p @ waves + random.uniform(0, 2 * np.pi, 24)).sum(-1) / np.sqrt(12)


def eyes(center, radius, iris, pupil=.5, gaze=(.3, 0, 1)):
    """Bare balls for an `Animal`: two eyes with pupils and, where the light is seen in them, a white spot."""
    parts, black, white = [], (.004, .004, .005), (2, 2, 2)
    for side in (1, -1):
        at, way = np.array(center) * (side, 1, 1), np.array(gaze) * (side, 1, 1) / np.linalg.norm(gaze)
        parts += [(at, radius, iris),
                  (at + .42 * radius * way, radius * np.array([pupil * .9, .75, .65]), black),
                  (at + radius * (.93 * way + (-.25, .36, 0)), .15 * radius, white)]
    return parts


@attrs.frozen
class Animal:
    """A body: the surface of ``shape`` between two corners, with ``bare`` balls (center, radius, colour) in it.

    ``front`` is where its hair is combed away from.  ``kind`` is a function of places [n, 3] that gives 0 to 1: where
    on the v of ``type_map``, from .1 to .6, the hair type is.
    """

    shape: Callable
    low: tuple
    high: tuple
    front: tuple = (0, 0, 0)
    bare: Sequence = ()
    kind: Callable | None = None
    type_map: np.ndarray | None = None

    def build(self, skin=(.3, .2, .13), coat=None, length=None):
        """(Mesh, Maps, body_color), with skin of a colour.

        ``coat`` and ``length`` are functions of places that give 0 to 1: where on a picture's u, from .17 to .83,
        colours of hair are (.5 if None), and how long it is.
        """
        places, normals, faces = surface(self.shape, self.low, self.high)
        u, long, v = (np.full(len(places), other) if function is None else np.clip(function(places), 0, 1)
                      for function, other in ((coat, .5), (length, 1.), (self.kind, 0.)))
        uv, grown, ball = np.stack([.17 + .66 * u, .1 + .5 * v], -1), np.ones(len(places)), clfur.load_mesh("sphere")
        for number, (center, radius, _) in enumerate(self.bare):
            faces = np.concatenate([faces, ball.faces.astype(int) + len(places)])
            places = np.concatenate([places, ball.positions * np.asarray(radius) + center])
            normals = np.concatenate([normals, ball.positions / np.asarray(radius)])
            uv = np.concatenate([uv, np.tile([(number + .5) / len(self.bare), .875], (len(ball.positions), 1))])
            long, grown = (np.concatenate([each, np.zeros(len(ball.positions))]) for each in (long, grown))
        paint = np.tile(np.array(skin, np.float32), (8, max(len(self.bare), 1), 1))
        paint[:2] = np.array([color for _, _, color in self.bare] or [skin])
        maps = clfur.Maps(density={"vertex": grown}, length={"vertex": long})
        return clfur.Mesh(places, normals=normals, uv=uv, faces=faces), maps, paint

    def backwards(self, down=.5):
        """Which way hair is combed, for `clfur.Comb`: away from the front, and down."""
        def way(places, normals):
            go = places - self.front
            return go / np.linalg.norm(go, axis=1, keepdims=True) - (0, down, 0)
        return way


def rows(*keys):
    """A type map of rows of keys of hair types, from v = 1 down."""
    return np.array([[key] for key in keys], np.uint8)


def area(center, radii):
    """A function of places: 1 at a center, on both sides, and less around it, a bell curve of these radii."""
    return lambda p: np.exp(-(((np.abs(p) * (1, 0, 0) + p * (0, 1, 1) - center) / radii)**2).sum(1))
