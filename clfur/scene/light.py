"""Lights."""

import attrs

from . import checks


@attrs.frozen(eq=False)
class Light:
    """A distant light, or a spot light where it has a position: `direction` [3] is the way the light travels.

    direction is stored at unit length. color: linear RGB >= 0 (arrays of uint8 or uint16 are sRGB). ambient: white
    light from everywhere, >= 0.
    position: [3] of a spot, or None. angle: a spot's whole cone, degrees; its light does not fall off with distance.
    Raises Error otherwise.
    """

    direction: checks.Given = checks.field(checks.direction, default=(-1.0, -1.0, -1.0))
    color: checks.Given = checks.field(checks.color, default=(1.0, 1.0, 1.0))
    ambient: float = checks.field(checks.real(low=0), default=0.1)
    position: checks.Given = checks.field(checks.optional(checks.vector(3)), default=None)
    angle: float = checks.field(checks.real(low=0.5, below=180), default=60.0)
