"""What a picture may cost."""

import attrs

from .scene import _choice, _refuse, _to


def _samples(value, where):
    return value if value in (1, 4, 16) and not isinstance(value, bool) else _refuse(where, value, "1, 4 or 16")


@attrs.frozen
class Settings:
    """How a scene is drawn.

    samples: 1, 4 or 16 a pixel.  specular: "kajiya-kay", the highlight of Kajiya and Kay (1989), which has a value
    in every direction, or "half-vector", the report's, which has none where the eye looks against the light.
    Raises `clfur.Error` for anything else.
    """

    samples: int = attrs.field(converter=_to(_samples), default=4)
    specular: str = attrs.field(converter=_to(_choice("kajiya-kay", "half-vector")), default="kajiya-kay")
