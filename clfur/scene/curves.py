"""Strands that the user brings."""

import attrs
import numpy as np

from ..errors import Error
from . import checks


def _points(value, where):
    allowed = "an array [strands, points, 3], or [total, 3] with counts, of numbers"
    array = checks.numbers(value, where, allowed)
    if array.ndim not in (2, 3) or array.shape[-1] != 3:
        checks.refuse(where, value, allowed)
    return checks.float32(array, where)


def _counts(value, where):
    allowed = "an array [strands] of whole numbers >= 0"
    array = checks.numbers(value, where, allowed, kinds="iu")
    if array.ndim != 1 or (array.size and (int(array.min()) < 0 or int(array.max()) >= 2**32)):
        checks.refuse(where, value, allowed)
    return checks.frozen(array.astype(np.uint32))


def _values(value, where):
    return checks.numbers(value, where, "numbers >= 0")


@attrs.frozen(eq=False)
class Curves:
    """Strands that the user brings, as polylines.

    points: [strands, points, 3], or [total, 3] with counts [strands] when strands differ in length; the root
    comes first. width: diameter in world units >= 0: one, [strands], or one for each point ([total], or
    [strands, points]). color: linear RGB >= 0, shaped like width with [..., 3]. specular: strength >= 0.
    exponent: of the highlight, > 0. alpha: 0..1, how much light one hair lets through. No strands at all are
    allowed.

    As stored: `points` float32 [total, 3], `counts` uint32 [strands], `uniform` the points per strand where
    all have the same, else None, `width` float32 [1], [strands] or [total], `color` float32 [1, 3],
    [strands, 3] or [total, 3]. Raises Error for other shapes and values, and for a width or colour
    that could be meant per strand or per point.
    """

    points: np.ndarray = checks.field(_points)
    counts: np.ndarray = checks.field(checks.optional(_counts), default=None)
    width: np.ndarray = checks.field(_values, default=0.002)
    color: np.ndarray = checks.field(_values, default=(0.8, 0.6, 0.4))
    specular: float = checks.field(checks.real(low=0), default=0.3)
    exponent: float = checks.field(checks.real(above=0), default=150.0)
    alpha: float = checks.field(checks.real(low=0, high=1), default=0.5)
    uniform: int | None = attrs.field(init=False)

    def __attrs_post_init__(self):
        points, counts = self.points, self.counts
        if points.ndim == 3:
            if counts is not None:
                checks.refuse("Curves.counts", counts, "None when points is [strands, points, 3]")
            counts = checks.frozen(np.full(len(points), points.shape[1], np.uint32))
            points = points.reshape(-1, 3)
        elif counts is None:
            checks.refuse("Curves.counts", counts, "an array [strands] when points is [total, 3]")
        elif int(counts.sum(dtype=np.uint64)) != len(points):
            raise Error(f"Curves.counts add up to {counts.sum(dtype=np.uint64)}; "
                        f"allowed: {len(points)}, the number of points")
        same = not len(counts) or bool((counts == counts[0]).all())
        uniform = (int(counts[0]) if len(counts) else 0) if same else None
        sizes = len(counts), len(points), uniform
        for name, value in [
            ("points", points),
            ("counts", counts),
            ("uniform", uniform),
            ("width", _spread(self.width, (), *sizes, "Curves.width")),
            ("color", _spread(self.color, (3,), *sizes, "Curves.color")),
        ]:
            object.__setattr__(self, name, value)


def _spread(values, tail, strands, total, uniform, where):
    """Return values as float32 [1, *tail], [strands, *tail] or [total, *tail]; anything else is an Error."""
    shapes = {tail: "for all", (1, *tail): "for all", (strands, *tail): "per strand",
              (total, *tail): "per point"}
    if uniform is not None:
        shapes[(strands, uniform, *tail)] = "per point"
    allowed = "one for all, " + " or ".join(
        f"{list(shape)} {meaning}" for shape, meaning in shapes.items() if meaning != "for all"
    )
    if values.shape not in shapes or (values.dtype.kind == "f" and np.isnan(values).any()):
        checks.refuse(where, values, allowed + ", of finite numbers >= 0")
    if strands == total != 1 and values.shape == (strands, *tail) and strands and uniform != 1:
        raise Error(f"{where} of shape {list(values.shape)} could be per strand or per point, as there are "
                    f"as many points as strands; allowed: one for all")
    values = checks.float32(values, where).reshape(-1, *tail)
    if (values < 0).any():
        checks.refuse(where, values, "finite numbers >= 0")
    # No strands need no values, but an empty array would be trouble for every buffer down the line.
    return values if len(values) else checks.frozen(np.zeros((1, *tail), np.float32))
