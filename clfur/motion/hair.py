"""How hair of a type moves, and the wind."""

import attrs
import numpy as np

from ..errors import Error
from ..scene import checks
from ..scene.display import brief
from ..stages.wind import moment

STANDARD = 9.81   # m / s², by which bend_length is meant, whatever the scene's gravity


@attrs.frozen(eq=False)
class HairMotion:
    """How hair of a type moves.

    bend_length: world units, > 0: hair shorter than this stands, longer droops, under 9.81 m/s²; (bending stiffness
    over weight a length)^(1/3). None: as long as the longest of its type. air: seconds, > 0, in which air slows hair
    down and wind takes it along, or None: there is none. damping: seconds >= 0 of Kelvin's and Voigt's, by which
    bending slows down. inertia: 0..1, how much of its root's motion it does not go along with by itself. friction:
    0..10 on the body, Coulomb's. Raises Error otherwise.
    """

    bend_length: float | None = checks.field(checks.optional(checks.positive()), default=None)
    air: float | None = checks.field(checks.optional(checks.positive()), default=0.2)
    damping: float = checks.field(checks.real(low=0), default=0.02)
    inertia: float = checks.field(checks.real(low=0, high=1), default=1.0)
    friction: float = checks.field(checks.real(low=0, high=10), default=0.3)

    def row(self, longest: float, units_per_metre: float) -> tuple:
        """What `layout.MotionType` has of it; longest: of its type, world units."""
        length = self.bend_length or longest
        return (STANDARD * units_per_metre * length**3, 1 / self.air if self.air else 0.0, self.damping,
                1 - self.inertia)


@attrs.frozen(eq=False)
class Wind:
    """Wind that carries its gusts along.

    velocity: [3] m/s, its mean. gust: 0..16, how strong gusts are, in speeds of the mean. size: metres, > 0, of gusts.
    skin: metres >= 0: below this height above the skin air is held back, wholly at the skin. shelter: 0..16: where hair
    upwind covers the wind's way once, exp(-shelter) of it is left; half the drag coefficient of a hair, about 0.5 for
    coarse hair and 1.5 for the finest, or 0: none. seed: of gusts, 0..2**32-1. Raises Error otherwise.
    """

    velocity: checks.Given = checks.field(checks.vector(3), default=(0.0, 0.0, 0.0))
    gust: float = checks.field(checks.real(low=0, high=16), default=0.0)
    size: float = checks.field(checks.positive(), default=1.0)
    skin: float = checks.field(checks.real(low=0), default=0.0)
    shelter: float = checks.field(checks.real(low=0, high=16), default=0.0, kw_only=True)
    seed: int = checks.field(checks.whole(0, 2**32 - 1), default=0)
    __repr__ = brief

    def at(self, seconds: float, units_per_metre: float, longest: float) -> np.void:
        """The wind of a moment in the scene's units, for strands no longer than ``longest``, as `layout.Wind`."""
        mean = np.asarray(self.velocity) * units_per_metre
        return moment(mean, self.gust * float(np.linalg.norm(mean)), self.size * units_per_metre, seconds, self.seed,
                      self.skin * units_per_metre, self.shelter, longest)


def of_types(value, types, shells):
    """Return (a HairMotion for each of so many types, that of shells if there are): one alone is of all."""
    given, n = checks.safely(checks.tuple_of(HairMotion), value, "Motion.hair"), types + shells
    if len(given) not in (1, n):
        raise Error(f"Motion.hair has {len(given)} HairMotions but Scene.fur has {types} types"
                    f"{' and shells' * shells}; allowed: one, or one for each")
    given = given * n if len(given) == 1 else given
    return given[:types] or given, given[-1]
