"""Strands that move on a device, and what laws of them are known."""

import numpy as np

import clfur
from clfur import layout
from clfur.stages import distance, motion
from clfur.stages import wind as air
from clfur.stages.strands import upload_curves
from clfur.stages.tessellate import tessellate
from clfur.twin import motion as twin
from clfur.twin.distance import near

from .scenes import icosphere

G = np.array([0, -9.81, 0])
# Tip's drop of a clamped bar of length 1 under its weight, of its length, exactly (the elastica), by K = g / bend.
DROPS = {1: 0.12347, 5: 0.49591, 10: 0.70020}
SOFTEST = 50, 0.90792   # the same of hair that hangs all but straight down


def axes_of(direction):
    """Three unit vectors [3, 3], the first along a direction."""
    d = np.asarray(direction, float) / np.linalg.norm(direction)
    side = np.cross(d, [0, 0, 1] if abs(d[2]) < 0.6 else [1, 0, 0])
    side /= np.linalg.norm(side)
    return np.stack([d, side, np.cross(d, side)])


class Hair:
    """Strands that move on a device: of points [strands][points, 3] or [points, 3]."""

    def __init__(self, gpu, strands, bend, air=0.0, damping=0.0, carried=0.0, weighted=True, body=None, friction=0.0,
                 width=0.0):
        self.gpu, self.strands = gpu, [np.asarray(each, np.float32) for each in strands]
        counts = np.array([len(each) for each in self.strands])
        curves = clfur.Curves(np.concatenate(self.strands), counts=counts, width=width)
        self.drawn = upload_curves(gpu, curves)
        self.n, self.order = len(counts), 1
        self.axes = [axes_of(each[1] - each[0] if len(each) > 1 else (0, 1, 0)) for each in self.strands]
        self.root = np.zeros((4, 3, motion.padded(gpu, self.n)), np.float32)
        for i, each in enumerate(self.strands):
            self.root[:, :, i] = each[0], *self.axes[i]
        self.roots = gpu.upload(self.root)
        types = np.zeros(1, layout.MotionType)
        types["hair"], types["touch"][:, 0] = (bend, air, damping, carried), friction
        self.types = gpu.upload(types)
        self.state, self.soft = motion.hang(gpu, self.drawn, counts.max(), self.roots, self.types,
                                            G if weighted else 0 * G, body is not None)
        self.deepest = motion.stand_off(gpu, self.state, self.drawn, body) if body else None
        self.body = body

    def step(self, step, wind=(0, 0, 0), root=None, jumped=False, body=None, of_hair=None):
        """``wind``: [3], or a `layout.Wind`."""
        roots = self.roots if root is None else self.gpu.upload(np.asarray(root, np.float32))
        moment = wind if getattr(wind, "dtype", None) == layout.Wind else air.moment(wind)
        self.winds = air.blow(self.gpu, moment, roots, self.state.places, self.state.points, self.state.padded)
        motion.advance(self.gpu, self.state, self.types, roots, self.roots, step, G, self.winds, self.order, jumped,
                       body or self.body, of_hair)
        self.roots, self.order = roots, 2
        return self

    def array(self, name="places"):
        """[strands][points, 3] of the state, float64."""
        rows = self.gpu.download(getattr(self.state, name)).reshape(self.state.points, 3, -1).astype(float)
        return [rows[:len(each), :, i] for i, each in enumerate(self.strands)]

    def energy(self, bend):
        """Of each strand, kinetic, of bending and of height, over its mass a length; its clamp points along the root's
        first axis.  bend: what ``Hair`` was given."""
        for x, v, each, axes in zip(self.array(), self.array("speeds"), self.strands, self.axes):
            lengths = np.linalg.norm(np.diff(each.astype(float), axis=0), axis=1)
            masses = 0.5 * (lengths + np.append(lengths[1:], 0))
            t = np.vstack([axes[:1], np.diff(x, axis=0) / lengths[:, None]])
            yield (masses * ((v[1:]**2).sum(1) / 2 - x[1:] @ G)).sum() + (
                twin.stiffnesses(bend, lengths) * (np.diff(t, axis=0)**2).sum(1) / 2).sum()

    def stretch(self):
        """The largest share by which a segment is longer or shorter than it was groomed."""
        return max(np.abs(np.linalg.norm(np.diff(now, axis=0), axis=1)
                          / np.linalg.norm(np.diff(each.astype(float), axis=0), axis=1) - 1).max()
                   for now, each in zip(self.array(), self.strands) if len(each) > 1)


def uneven(rng, counts):
    """Bent strands of so many points, with segments of many lengths."""
    return [np.cumsum(rng.normal(size=(n, 3)) * 0.04 + [0, 0.1, 0], axis=0) + rng.normal(size=3) for n in counts]


def swing(gpu, segments, length, step, seconds, order=2):
    """Times [s] at which the tip of a chain that hangs and swings a little falls through the middle, and its largest
    way aside in each period, in shares of the first."""
    u = np.linspace(0, 1, segments + 1)
    x = 2.4048 * np.sqrt(1 - u)   # its slowest wave (Bernoulli): J0(x)
    shape = np.cos(x[:, None] * np.sin((np.arange(64) + 0.5) * np.pi / 64)).mean(1)
    hair, sides = Hair(gpu, [length * np.stack([0.02 * shape, -u, 0 * u], 1)], 0.0, weighted=False), []
    for _ in range(round(seconds / step)):
        hair.order = min(hair.order, order)
        sides.append(hair.step(step).array()[0][-1, 0])
    sides = np.array(sides)
    falls = np.flatnonzero((sides[:-1] > 0) & (sides[1:] <= 0))
    most = np.array([sides[a:b].max() for a, b in zip(np.append(0, falls), falls)])
    return (falls + 1 + sides[falls] / (sides[falls] - sides[falls + 1])) * step, most / (0.02 * length)


def period(length):
    """Of the slowest wave of a hanging chain [s]."""
    return 2 * np.pi / (2.4048 / 2) * np.sqrt(length / -G[1])


def blown(gpu, rate, seconds, bend=9.81):
    """Tips [12 seconds, 4, 3] of hair in violent gusts, 20 units a second at most, by so many steps a second."""
    bars = [bar(8, (0, -1, 0)), bar(16, (1, 0, 0)), bar(8, (0, 1, 0))]
    hair = Hair(gpu, [*bars, curl(8, np.random.default_rng(3))], bend, air=5)
    tips = []
    for number in range(1, round(rate * seconds) + 1):
        time = number / rate
        hair.step(1 / rate, 20 * np.sin(7 * time) * np.array((1, 0.3 * np.cos(3 * time), 0.5 * np.cos(2 * time))))
        if number % (rate // 12) == 0:
            tips.append([each[-1] for each in hair.array()])
    return np.array(tips)


def bar(segments, direction=(1, 0, 0)):
    return np.linspace(0, 1, segments + 1)[:, None] * np.array(direction, float) / np.linalg.norm(direction)


def curl(segments, rng, turns=1.0, radius=0.05):
    """A curl of length 1 in any direction."""
    u = np.linspace(0, 1, segments + 1)
    angle = 2 * np.pi * turns * u
    way = np.diff(np.stack([u, radius * np.cos(angle), radius * np.sin(angle)], 1), axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None] * segments
    return np.vstack([np.zeros(3), np.cumsum(way, axis=0)]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]


def body_of(gpu, positions, faces):
    """How far a body is, everywhere."""
    mesh = clfur.Mesh(positions=positions, faces=faces)
    grid = distance.grid_of(np.min(positions, 0), np.max(positions, 0))
    return distance.deepened(gpu, distance.distance(gpu, grid, lambda: [tessellate(gpu, mesh, 1, 1, "flat")]))


def ball(gpu, radius, level=4):
    positions, faces = icosphere(level)
    return body_of(gpu, positions * radius, faces)


def look_of(gpu, body, rotation=None, offset=(0, 0, 0)):
    """What `twin.contact.Contact` asks of a distance: (distance, unit normal) at places of the world."""
    values, turn = gpu.download(body.values), np.eye(3) if rotation is None else rotation

    def look(places):
        value, slope = near(body.grid, values, (places - offset) @ turn)
        return value, slope / np.linalg.norm(slope, axis=1)[:, None] @ turn.T
    return look


def fallen(gpu, body, n=64, segments=8, radius=2.5, friction=0.3, bend=0.3, seed=0):
    """Hair of length 1 that stands on a ball, unloaded, so that it falls on it."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(n, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    strands = [way * radius * 1.0005 + bar(segments, way + 0.25 * rng.uniform(-1, 1, 3)) for way in ways]
    return Hair(gpu, strands, 9.81 * bend**3, 5, 0.02, weighted=False, body=motion.Felt(body, motion.RESTING),
                friction=friction, width=0.01)


def shot(gpu, rate, n=40, radius=0.4, speed=20.0):
    """A ball at so many lengths a second through hair that hangs, at a rate of frames -> (hair, how far the nearest of
    its points has been from the ball in any substep, the fastest speed of hair)."""
    rng, body, begins = np.random.default_rng(3), ball(gpu, radius), np.array([-1.6, -0.7, 0.05])
    strands = [np.array([x, 0, z]) + bar(8, (rng.normal() * 0.1, -1, rng.normal() * 0.1))
               for x, z in rng.uniform(-0.5, 0.5, (n, 2))]
    hair = Hair(gpu, strands, 9.81 * 0.3**3, 5, 0.02, weighted=False, friction=0.3, width=0.01,
                body=motion.Felt(body, motion.body_at(np.eye(3), begins)))
    substeps = min(int(np.ceil(speed / rate / (0.5 * float(body.grid["reach"][0])))), 32)
    step, nearest, fastest = 1 / rate / substeps, np.inf, 0.0
    carry = np.column_stack([np.eye(3), (speed * step, 0, 0)])
    for number in range(round(0.16 / step)):
        at = begins + [speed * step * (number + 1), 0, 0]
        hair.step(step, body=motion.Felt(body, motion.body_at(np.eye(3), at, carry)))
        nearest = min(nearest, depths(hair, radius, at).min())
        fastest = max(fastest, np.abs(np.concatenate(hair.array("speeds"))).max())
    return hair, nearest, fastest


def depths(hair, radius, middle=(0, 0, 0)):
    """How far all points that are not roots are from a ball."""
    return np.concatenate([np.linalg.norm(now[1:] + each[0] - middle, axis=1) - radius
                           for now, each in zip(hair.array(), hair.strands)])
