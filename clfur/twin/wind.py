"""What cl/wind.cl means, in float64."""

import numpy as np

from .strands import random3


def wind_at(places, mean, gust, size, time, seed):
    """The wind [n, 3] at places: Perlin's smooth steps between random numbers at whole cells, which mean carries."""
    at = (np.asarray(places, float) - np.asarray(mean, float) * time) / size
    low = np.floor(at).astype(int)
    step = np.polyval([6, -15, 10, 0, 0, 0], at - low)
    sums = np.zeros_like(at)
    for corner in np.ndindex(2, 2, 2):
        cell = (low + corner) % 1024
        words = random3(cell @ [1, 1024, 1024**2], seed, 9)
        share = np.where(corner, step, 1 - step).prod(1)
        sums += share[:, None] * ((words >> np.uint32(8)) / 2**23 - 1)
    return mean + gust * sums


def held(places, normal, skin):
    """The share [n] of the wind that is felt at places, relative to the root, beside skin of this normal."""
    height = np.clip(np.abs(np.asarray(places, float) @ normal) / skin, 0, 1)
    return height**2 * (3 - 2 * height)


def crossings(grid, sums, places):
    """Crossings of hair upwind of places [n, 3], linear between the middles of columns and the borders of layers."""
    q = places @ grid["to_grid"][:3, :3].astype(float) + grid["to_grid"][3, :3]
    sums = np.asarray(sums, float).transpose(2, 1, 0)
    q = np.clip(q - [0.5, 0.5, 0], 0, np.array(sums.shape) - 1)
    low = np.minimum(q.astype(int), np.array(sums.shape) - 2)
    total = np.zeros(len(q))
    for corner in np.ndindex(2, 2, 2):
        share = np.where(corner, q - low, 1 - (q - low)).prod(1)
        total += share * sums[tuple((low + corner).T)]
    return total


class Lean:
    """Shell fur at a vertex: `lean` and `speed` [3] in the axes of its root, followed in many small steps."""

    def __init__(self, axes, rest, gravity, bend, air, damping, inertia, length):
        self.rest, self.weight, self.length = np.asarray(rest, float), axes @ np.asarray(gravity, float), length
        self.stiff = 1.8751**4 * bend / length**4
        self.resist, self.by = air + damping * self.stiff, length**3 / (4 * bend)
        self.air, self.inertia = air, inertia
        self.lean, self.speed, self.going = np.zeros(3), np.zeros(3), np.zeros(3)

    def advance(self, root, root_before, step, gravity, wind, jumped=False, parts=400):
        """Go on by ``step`` seconds; roots: (place [3], axes [3, 3]) -> what it leans by in the world."""
        going = self.going if jumped else (root[0] - root_before[0]) / step
        force = gravity + self.air * (wind - self.inertia * going) - self.inertia * (going - self.going) / step
        self.going = going
        target = self.by * (root[1] @ force - self.weight)

        def change(x, v):
            return v, -self.stiff * (x - target) - self.resist * v
        h = step / parts
        for _ in range(parts):   # Runge's and Kutta's rule
            x, v = self.lean, self.speed
            a = change(x, v)
            b = change(x + h / 2 * a[0], v + h / 2 * a[1])
            c = change(x + h / 2 * b[0], v + h / 2 * b[1])
            d = change(x + h * c[0], v + h * c[1])
            self.lean = x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
            self.speed = v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        shown = self.rest + self.lean
        shown[2] = max(shown[2], min(self.rest[2], -0.9))
        return shown @ root[1]
