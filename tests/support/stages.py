"""What stands in for the stages' classes: as much of them as a stage or its twin looks at."""

import dataclasses
from types import SimpleNamespace

import numpy as np


def strands_on(gpu, points, spans, kinds=None):
    """Strands on the device, of points [P, 4] and spans [strands, 2]; ``kinds``: the type of each strand."""
    uv = np.zeros((len(spans), 4), np.float32)
    uv[:, 2] = 0 if kinds is None else kinds
    return SimpleNamespace(points=gpu.upload(np.asarray(points, np.float32).reshape(-1, 4)),
                           spans=gpu.upload(np.asarray(spans, np.uint32).reshape(-1, 2)), uv=gpu.upload(uv),
                           shifts=gpu.full(len(spans), np.uint32, 0),
                           first_point=0)


def body_on(gpu, positions, triangles):
    """A body on the device, of positions [V, 4] and triangles [T, 4], of which any may be as long as it likes."""
    return SimpleNamespace(longest=np.inf, positions=gpu.upload(positions), triangles=gpu.upload(triangles),
                           first_triangle=0)


def on_host(arrays):
    """A stage's dataclass with NumPy arrays in place of the device's."""
    values = {field.name: getattr(arrays, field.name) for field in dataclasses.fields(arrays)}
    return SimpleNamespace(**{name: value.get() if hasattr(value, "get") else value for name, value in values.items()})
