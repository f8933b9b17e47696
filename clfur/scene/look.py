"""What hair looks like: how it scatters the light that falls on it."""

import functools
from typing import Any

import attrs

from ..errors import Error
from . import checks


@attrs.frozen
class Kajiya:
    """Hair that scatters light as Kajiya and Kay (SIGGRAPH 1989) have it: as a thin cylinder, and with a highlight.

    specular: strength of the highlight, >= 0. exponent: how narrow it is, > 0. highlight: "kajiya-kay", their own,
    around the cone of mirror directions, which has a value in every direction; or "half-vector", the report's, by the
    half vector, which has none where the eye looks against the light. Raises Error for anything else.
    """

    specular: float = checks.field(checks.real(low=0), default=0.3)
    exponent: float = checks.field(checks.positive(), default=150.0)
    highlight: str = checks.field(checks.choice("kajiya-kay", "half-vector"), default="kajiya-kay")

    @property
    def model(self) -> str:
        """Which of `layout.MODELS` it is."""
        return self.highlight

    @property
    def numbers(self) -> tuple[float, float]:
        """The two numbers by which kernels know it."""
        return self.specular, self.exponent


LOOKS = (Kajiya,)


@attrs.frozen(eq=False)
class Looking:
    """What has a look; `specular` and `exponent` are those of a Kajiya without more words."""

    _look: Kajiya = checks.field(checks.optional(checks.instance(*LOOKS)), default=None, kw_only=True)
    _specular: float = checks.field(checks.optional(checks.real(low=0)), default=None, kw_only=True)
    _exponent: float = checks.field(checks.optional(checks.positive()), default=None, kw_only=True)

    def __attrs_post_init__(self):
        for name in ("specular", "exponent"):
            if self._look is not None and getattr(self, f"_{name}") is not None:
                raise Error(f"{type(self).__name__}.{name} is {getattr(self, f'_{name}')}, but look is given too; "
                            f"allowed: one of them")

    @functools.cached_property
    def look(self) -> Kajiya:
        """How it scatters light, also where none is given: a Kajiya."""
        given: dict[str, Any] = {"specular": self._specular, "exponent": self._exponent}
        return self._look or Kajiya(**{name: value for name, value in given.items() if value is not None})

    @property
    def specular(self) -> float:
        """Strength of the look's highlight."""
        return self.look.specular

    @property
    def exponent(self) -> float:
        """How narrow the look's highlight is."""
        return self.look.exponent


@functools.lru_cache(maxsize=8)   # what is drawn again must be the very same
def highlighted(fur: Any, highlight: str) -> Any:
    """Return fur, or each of a tuple, whose looks have this highlight: what `Settings.specular` chose once for all."""
    if fur is None or isinstance(fur, tuple):
        return fur and tuple(highlighted(part, highlight) for part in fur)
    if types := getattr(fur, "types", None):
        return attrs.evolve(fur, types=[highlighted.__wrapped__(kind, highlight) for kind in types])
    return attrs.evolve(fur, look=attrs.evolve(fur.look, highlight=highlight), specular=None, exponent=None)
