"""Skies."""

import functools
from typing import Any

import attrs
import numpy as np

from ..color import linear_of
from ..errors import Error
from . import checks
from .display import brief
from .light import AMBIENT, Light

ROWS = 64   # of a gradient's picture, and about as many of a large one's


def _sky(value, where):
    """Return what `Environment.sky` takes: a float32 picture [h, w, 3], one colour [3], or three colours [3, 3]."""
    allowed = "a colour [3], colours of zenith, horizon and ground [3, 3], or a picture [h, w, 3], all >= 0 and finite"
    array = linear_of(checks.numbers(value, where, allowed))
    array = array.astype(np.result_type(array, np.float32), copy=False)   # the limit is more than float16 holds
    if array.ndim not in (1, 2, 3) or array.shape[-1] != 3 or (array.ndim == 2 and len(array) != 3) or not array.size:
        checks.refuse(where, value, allowed)
    bad = np.argwhere(~((array >= 0) & (array <= checks.LARGEST)))   # no number is neither
    if len(bad):
        raise Error(f"{where} is {array[tuple(bad[0])]} at {bad[0].tolist()}; allowed: {allowed}")
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
    __repr__ = brief

    @property
    def picture(self) -> np.ndarray:
        """The sky's light [h, w, 3], as a picture: what `places` are means of."""
        sky: Any = self.sky
        if sky.ndim == 2:
            up = np.sin(np.pi * (0.5 - (np.arange(ROWS) + 0.5) / ROWS))[:, None]
            zenith, horizon, ground = sky.astype(float)
            sky = (horizon + np.where(up > 0, up * (zenith - horizon), -up * (ground - horizon)))[:, None]
        return self.intensity * (np.broadcast_to(sky, (ROWS, 2 * ROWS, 3)) if self.sky.ndim < 3 else sky)

    @functools.cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places of the sky: (unit directions towards them [n, 3], their light [n, 3], solid angles [n]), float64."""
        picture, shares = self.picture, []
        for axis, most in (0, ROWS), (1, 2 * ROWS):   # a large picture's places are means
            times = -(-most // picture.shape[axis])   # a small one's pixels are many places each
            picture = picture.repeat(times, axis)
            length = picture.shape[axis]
            n = most if times == 1 else length
            starts = np.arange(n) * length // n
            counts = np.diff(np.append(starts, length))
            picture = np.add.reduceat(picture, starts, axis, np.float64)
            picture = picture / counts.reshape([-1 if a == axis else 1 for a in range(3)])
            shares.append(np.append(starts, length) / length)
        edges = np.sin(np.pi * (0.5 - shares[0]))
        up = (edges[1:] + edges[:-1]) / 2
        width = picture.shape[1]
        turn = np.pi * (shares[1][1:] + shares[1][:-1] - 1) + np.radians(self.rotation)
        aside = np.sqrt(1 - up * up)[:, None]
        towards = np.stack([aside * np.sin(turn), np.repeat(up[:, None], width, 1), -aside * np.cos(turn)], 2)
        angles = (edges[:-1] - edges[1:])[:, None] * (2 * np.pi * np.diff(shares[1]))
        return towards.reshape(-1, 3), picture.reshape(-1, 3), angles.reshape(-1)


def ambient_of(light: Light, environment: Environment | None, scatters: bool = False) -> float:
    """The flat ambient of a light: where it tells none, none under a sky or where light goes from hair to hair."""
    if light.ambient is not None:
        return light.ambient
    return 0.0 if scatters or environment is not None else AMBIENT
