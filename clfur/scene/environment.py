"""Skies."""

import functools
from typing import Any

import attrs
import numpy as np

from ..color import linear_of
from . import checks

ROWS = 64   # of a gradient's picture, and about as many of a large one's


def _sky(value, where):
    """Return what `Environment.sky` takes: a float32 picture [h, w, 3], one colour [3], or three colours [3, 3]."""
    allowed = "a colour [3], colours of zenith, horizon and ground [3, 3], or a picture [h, w, 3], all >= 0 and finite"
    array = linear_of(checks.numbers(value, where, allowed))
    if array.ndim not in (1, 2, 3) or array.shape[-1] != 3 or (array.ndim == 2 and len(array) != 3) or not array.size:
        checks.refuse(where, value, allowed)
    if not (np.isfinite(array).all() and (array >= 0).all() and (array <= checks.LARGEST).all()):
        checks.refuse(where, value, allowed)
    return checks.frozen(np.array(array, np.float32))


@attrs.frozen(eq=False)
class Environment:
    """Light that comes from all around, hidden by hair and body.

    sky: linear RGB >= 0 (arrays of uint8 or uint16 are sRGB): one colour [3]; the colours of zenith, horizon and
    ground [3, 3], between which it changes with the sine of the height; or an equirectangular picture [h, w, 3], whose
    top row is up (+Y) and whose middle looks along -Z. intensity: factor of all of it, >= 0. rotation: of a picture
    about +Y, degrees, to the right as it is seen from inside. Raises Error for anything else.
    """

    sky: checks.Given = checks.field(_sky, default=(1.0, 1.0, 1.0))
    intensity: float = checks.field(checks.real(low=0, high=checks.LARGEST), default=1.0)
    rotation: float = checks.field(checks.real(low=-checks.LARGEST, high=checks.LARGEST), default=0.0)

    @functools.cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places of the sky: (unit directions towards them [n, 3], their light [n, 3], solid angles [n]), float64."""
        picture: Any = self.sky.astype(float)
        if picture.ndim == 1:
            picture = np.broadcast_to(picture, (ROWS, 2 * ROWS, 3))
        elif picture.ndim == 2:
            up = np.sin(np.pi * (0.5 - (np.arange(ROWS) + 0.5) / ROWS))[:, None]
            zenith, horizon, ground = picture
            rows = horizon + np.where(up > 0, up * (zenith - horizon), -up * (ground - horizon))
            picture = np.broadcast_to(rows[:, None], (ROWS, 2 * ROWS, 3))
        for axis, most in (0, ROWS), (1, 2 * ROWS):   # a large picture's places are means
            length = picture.shape[axis]
            if length > most:
                starts = np.arange(most) * length // most
                counts = np.diff(np.append(starts, length)).reshape([-1 if a == axis else 1 for a in range(3)])
                picture = np.add.reduceat(picture, starts, axis) / counts
        height, width = picture.shape[:2]
        edges = np.sin(np.pi * (0.5 - np.arange(height + 1) / height))
        up = (edges[1:] + edges[:-1]) / 2
        turn = 2 * np.pi * ((np.arange(width) + 0.5) / width - 0.5) + np.radians(self.rotation)
        aside = np.sqrt(1 - up * up)[:, None]
        towards = np.stack([aside * np.sin(turn), np.repeat(up[:, None], width, 1), -aside * np.cos(turn)], 2)
        angles = np.repeat((edges[:-1] - edges[1:])[:, None] * 2 * np.pi / width, width, 1)
        return towards.reshape(-1, 3), self.intensity * picture.reshape(-1, 3), angles.reshape(-1)
