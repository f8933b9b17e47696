"""Strands that move on a device, and what laws of them are known."""

import numpy as np

import clfur
from clfur import layout
from clfur.stages import motion
from clfur.stages.strands import upload_curves

G = np.array([0, -9.81, 0])
# Tip's drop of a clamped bar of length 1 under its weight, of its length, exactly (the elastica), by K = g / bend.
DROPS = {1: 0.12347, 5: 0.49591, 10: 0.70020}


def axes_of(direction):
    """Three unit vectors [3, 3], the first along a direction."""
    d = np.asarray(direction, float) / np.linalg.norm(direction)
    side = np.cross(d, [0, 0, 1] if abs(d[2]) < 0.6 else [1, 0, 0])
    side /= np.linalg.norm(side)
    return np.stack([d, side, np.cross(d, side)])


class Hair:
    """Strands that move on a device: of points [strands][points, 3] or [points, 3]."""

    def __init__(self, gpu, strands, bend, air=0.0, damping=0.0, carried=0.0, weighted=True):
        self.gpu, self.strands = gpu, [np.asarray(each, np.float32) for each in strands]
        counts = np.array([len(each) for each in self.strands])
        curves = clfur.Curves(np.concatenate(self.strands), counts=counts)
        self.drawn = upload_curves(gpu, curves)
        self.n, self.order = len(counts), 1
        self.axes = [axes_of(each[1] - each[0] if len(each) > 1 else (0, 1, 0)) for each in self.strands]
        self.root = np.zeros((4, 3, motion.padded(gpu, self.n)), np.float32)
        for i, each in enumerate(self.strands):
            self.root[:, :, i] = each[0], *self.axes[i]
        self.roots = gpu.upload(self.root)
        types = np.zeros(1, layout.MotionType)
        types["hair"] = bend, air, damping, carried
        self.types = gpu.upload(types)
        self.state, self.soft = motion.hang(gpu, self.drawn, counts.max(), self.roots, self.types,
                                            G if weighted else 0 * G)

    def step(self, step, wind=(0, 0, 0), root=None, jumped=False, skin=0.0, felt=None):
        roots = self.roots if root is None else self.gpu.upload(np.asarray(root, np.float32))
        winds = motion.blow(self.gpu, self.state, roots, wind)
        motion.advance(self.gpu, self.state, self.types, roots, self.roots, step, G, winds, self.order, jumped, skin,
                       felt)
        self.roots, self.order = roots, 2
        return self

    def array(self, name="places"):
        """[strands][points, 3] of the state, float64."""
        rows = self.gpu.download(getattr(self.state, name)).reshape(self.state.points, 3, -1).astype(float)
        return [rows[:len(each), :, i] for i, each in enumerate(self.strands)]

    def stretch(self):
        """The largest share by which a segment is longer or shorter than it was groomed."""
        return max(np.abs(np.linalg.norm(np.diff(now, axis=0), axis=1)
                          / np.linalg.norm(np.diff(each.astype(float), axis=0), axis=1) - 1).max()
                   for now, each in zip(self.array(), self.strands) if len(each) > 1)


def bar(segments, direction=(1, 0, 0)):
    return np.linspace(0, 1, segments + 1)[:, None] * np.array(direction, float) / np.linalg.norm(direction)


def curl(segments, rng, turns=1.0, radius=0.05):
    """A curl of length 1 in any direction."""
    u = np.linspace(0, 1, segments + 1)
    angle = 2 * np.pi * turns * u
    way = np.diff(np.stack([u, radius * np.cos(angle), radius * np.sin(angle)], 1), axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None] * segments
    return np.vstack([np.zeros(3), np.cumsum(way, axis=0)]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
