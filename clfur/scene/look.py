"""What hair looks like: how it scatters the light that falls on it."""

import functools
import math
from typing import Any

import attrs
import numpy as np

from ..errors import Error
from . import checks
from .display import brief
from .remembered import remembered


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

    @property
    def lobes(self) -> tuple[float, float, float, float]:
        """Member `lobes` of `layout.HairType`."""
        return 0.0, 0.0, 0.0, 0.0

    @property
    def color(self) -> None:
        """The colour that it gives hair: none, it takes the hair's own."""
        return None


EUMELANIN = np.array([0.419, 0.697, 1.37])       # what one of each absorbs of a radius: r, g, b (Chiang et al. 2016)
PHEOMELANIN = np.array([0.187, 0.4, 1.05])


def _triple(value, where):
    """Return 3 numbers >= 0 as a tuple, so that looks can be compared."""
    return tuple(checks.vector(3, low=0)(value, where).tolist())


@attrs.frozen
class Chiang:
    """Hair that scatters light as a rough cylinder of glass with pigment in it: Chiang, Bitterli, Tappan and Burley
    (EGSR 2016), the mean over the strand's width. For strands, not for shells.

    longitudinal_roughness: 0.05..1, how wide light spreads along the strand; azimuthal_roughness: 0.1..1, around it.
    tilt: -20..20 degrees by which its scales lean, so that the highlight moves to the root. index: of refraction,
    1.1..3. Its pigment is what gives many such hairs the colour that the strand has: its type's, with texture and
    variation, or its own in Curves. Or, in place of the type's color, eumelanin (black and brown) and pheomelanin (red)
    say it, concentrations >= 0 of which 1.3 is brown and 8 black; or absorption, [3] >= 0, that of a radius for r, g,
    b. Raises Error for anything else.
    """

    longitudinal_roughness: float = checks.field(checks.real(low=0.05, high=1), default=0.3)
    azimuthal_roughness: float = checks.field(checks.real(low=0.1, high=1), default=0.3)
    tilt: float = checks.field(checks.real(low=-20, high=20), default=2.0)
    index: float = checks.field(checks.real(low=1.1, high=3), default=1.55)
    eumelanin: float = checks.field(checks.optional(checks.real(low=0)), default=None, kw_only=True)
    pheomelanin: float = checks.field(checks.optional(checks.real(low=0)), default=None, kw_only=True)
    absorption: checks.Given = checks.field(checks.optional(_triple), default=None, kw_only=True)
    __repr__ = brief

    def __attrs_post_init__(self):
        if self.absorption is not None and (self.eumelanin, self.pheomelanin) != (None, None):
            raise Error(f"Chiang.absorption is {self.absorption}, but melanin is given too; allowed: one of them")

    @property
    def model(self) -> str:
        """Which of `layout.MODELS` it is."""
        return "chiang"

    @property
    def numbers(self) -> tuple[float, float]:
        """The two numbers by which kernels know it: none, and the exponent of a highlight as narrow as its lobes."""
        return 0.0, max(1 / min(self.variances), 1 / (2 * self.scale**2))

    @property
    def lobes(self) -> tuple[float, float, float, float]:
        """Member `lobes` of `layout.HairType`."""
        return self.longitudinal_roughness, self.azimuthal_roughness, math.radians(self.tilt), self.index

    @property
    def variances(self) -> tuple[float, float, float, float]:
        """Of angles along the strand, of R, TT, TRT and the rest (the paper's equation 7)."""
        b = self.longitudinal_roughness
        v = (0.726 * b + 0.812 * b**2 + 3.7 * b**20)**2
        return v, v / 4, 4 * v, 4 * v

    @property
    def scale(self) -> float:
        """Of the logistic distribution of angles around the strand (the paper's equation 8)."""
        b = self.azimuthal_roughness
        return math.sqrt(math.pi / 8) * (0.265 * b + 1.194 * b**2 + 5.372 * b**22)

    @property
    def depth(self) -> float:
        """By which -ln(colour) is divided for the square root of what a radius absorbs (the paper's fit)."""
        b = self.azimuthal_roughness
        return 5.969 - 0.215 * b + 2.532 * b**2 - 10.73 * b**3 + 5.574 * b**4 + 0.245 * b**5

    @functools.cached_property
    def color(self) -> np.ndarray | None:
        """The colour that its pigment gives hair, linear float64 [3]; None if it takes the hair's own."""
        absorption = self.absorption
        if (absorption, self.eumelanin, self.pheomelanin) == (None, None, None):
            return None
        if absorption is None:
            absorption = (self.eumelanin or 0) * EUMELANIN + (self.pheomelanin or 0) * PHEOMELANIN
        return checks.frozen(np.exp(-np.sqrt(absorption) * self.depth))


LOOKS = (Kajiya, Chiang)
Look = Kajiya | Chiang


@attrs.frozen(eq=False)
class Looking:
    """What has a look; `specular` and `exponent` are those of a Kajiya without more words."""

    _look: Look = checks.field(checks.optional(checks.instance(*LOOKS)), default=None, kw_only=True)
    _specular: float = checks.field(checks.optional(checks.real(low=0)), default=None, kw_only=True)
    _exponent: float = checks.field(checks.optional(checks.positive()), default=None, kw_only=True)

    def __attrs_post_init__(self):
        for name in ("specular", "exponent"):
            if self._look is not None and getattr(self, f"_{name}") is not None:
                raise Error(f"{type(self).__name__}.{name} is {getattr(self, f'_{name}')}, but look is given too; "
                            f"allowed: one of them")

    @functools.cached_property
    def look(self) -> Look:
        """How it scatters light, also where none is given: a Kajiya."""
        given: dict[str, Any] = {"specular": self._specular, "exponent": self._exponent}
        return self._look or Kajiya(**{name: value for name, value in given.items() if value is not None})

    @property
    def specular(self) -> float:
        """Strength of the look's highlight; 0 where it has none apart from the hair's own light."""
        return self.look.numbers[0]

    @property
    def exponent(self) -> float:
        """How narrow the look's highlight is."""
        return self.look.numbers[1]


@remembered(8)   # what is drawn again must be the very same
def highlighted(fur: Any, highlight: str) -> Any:
    """Return fur, or each of a tuple, whose looks have this highlight; a Chiang has none to choose."""
    if fur is None or isinstance(fur, tuple):
        return fur and tuple(highlighted(part, highlight) for part in fur)
    if types := getattr(fur, "types", None):
        return attrs.evolve(fur, types=[_highlighted(kind, highlight) for kind in types])
    return _highlighted(fur, highlight)


def _highlighted(fur, highlight):
    if not isinstance(fur.look, Kajiya):
        return fur
    return attrs.evolve(fur, look=attrs.evolve(fur.look, highlight=highlight), specular=None, exponent=None)
