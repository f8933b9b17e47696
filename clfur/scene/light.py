"""Lights."""

import attrs
import numpy as np

from . import checks
from .display import brief

EVERYWHERE = 360.0   # the angle of a point light
WIDEST = 90.0        # degrees of a distant disc: wider light is a sky's
AMBIENT = 0.1        # of a light that tells none, where no sky or scattering stands for it


def _angle(value, where):
    number = checks.real()(value, where)
    if number != EVERYWHERE and not 0.5 <= number < 180:
        checks.refuse(where, value, "0.5 to below 180, or 360: everywhere")
    return number


@attrs.frozen(eq=False)
class Light:
    """A distant light, or one at a position, which shines into a cone (a spot) or everywhere (a point light).

    direction [3]: the way the light travels, stored at unit length; a point light has no use for it. color: linear
    RGB >= 0 (arrays of uint8 or uint16 are sRGB). ambient: white light from everywhere, >= 0; None is 0.1, but 0 under
    an Environment and where light goes from hair to hair, for which it stands.
    position: [3], or None of a distant light. angle: the whole cone of a spot, degrees; 360 of a point light, which
    must stand outside of all that is drawn if it casts shadows. Light does not fall off with distance.
    size: of the disc that it shines from, across the way it looks: of a distant light its angular diameter, 0 to 90
    degrees (the sun's is 0.53), of others its radius in the scene's units; 0 casts hard shadows. shadows: whether it
    casts any. intensity: >= 0, by which its colour is multiplied, not its ambient.
    Raises Error otherwise.
    """

    direction: checks.Given = checks.field(checks.direction, default=(-1.0, -1.0, -1.0))
    color: checks.Given = checks.field(checks.color, default=(1.0, 1.0, 1.0))
    ambient: float | None = checks.field(checks.optional(checks.real(low=0)), default=None)
    position: checks.Given = checks.field(checks.optional(checks.vector(3)), default=None)
    angle: float = checks.field(_angle, default=60.0)
    size: float = checks.field(checks.real(low=0), default=0.0)
    shadows: bool = checks.field(checks.flag, default=True)
    intensity: float = checks.field(checks.real(low=0), default=1.0)
    __repr__ = brief

    def __attrs_post_init__(self):
        if self.position is None and self.size > WIDEST:
            checks.refuse("Light.size", self.size, f"at most {WIDEST:g} degrees of a light without a position")
        if self.position is None and self.angle == EVERYWHERE:
            checks.refuse("Light.angle", self.angle, "below 180 of a light without a position")

    @property
    def strength(self) -> np.ndarray:
        """Its light without ambient, linear RGB float64 [3]."""
        return self.color * self.intensity

    @property
    def casts(self) -> bool:
        """Whether it shines and casts shadows."""
        return self.shadows and bool(np.any(self.strength))

    @property
    def everywhere(self) -> bool:
        """Whether it is a point light."""
        return self.angle == EVERYWHERE
