"""Shell fur: hair as a pattern in layers above a mesh, for fur too short and dense to grow strand by strand."""

import math

import attrs
import numpy as np

from . import checks
from .display import brief
from .look import Kajiya, Looking
from .mesh import Mesh


def _noise(value, where):
    amount, size = (float(each) for each in checks.vector(2)(value, where))
    if amount < 0 or size < 1:
        checks.refuse(where, value, "two finite numbers, the first >= 0, the second >= 1")
    return amount, size


def _lean(value, where):
    allowed = "None or an array [vertices, 3] of numbers"
    array = checks.placed(value, where, allowed)
    if array.ndim != 2 or array.shape[1] != 3:
        checks.refuse(where, value, allowed)
    return array if checks.is_on_device(array) else checks.float32(array, where, checks.LARGEST)


def _wind(value, where):
    wind = checks.vector(3)(value, where)
    return checks.frozen(np.where(np.float32(wind) != 0, wind, 0.0))   # what is none on the device has no direction


def gust(wind: np.ndarray, time: float, place: np.ndarray, radius: float) -> float:
    """Return how strong, 0.4 to 1, the wind over shells is at a place [3] on a mesh of this radius, as `bend` has it: a
    wave of one second that goes with the wind, two parabolas long."""
    turn = (time - float(np.dot(wind, place)) / (float(np.linalg.norm(wind)) * radius)) % 1
    return 0.7 + 0.3 * (16 * turn * (0.5 - turn) if turn < 0.5 else -16 * (turn - 0.5) * (1 - turn))


@attrs.frozen(eq=False)
class Shells(Looking):
    """Fur that is a pattern on the mesh, drawn in layers from the roots to the tips; an eye within it sees none.

    length: height of the fur, world units, > 0. layers: 1..1000 steps from roots to tips. pattern: "cells", one hair
    in each cell of every face, on any mesh; or "sine", the report's |sin(2fs) + sin(ft)| with s = 2πu and t = 2πv, on a
    mesh with uv. frequency > 0: of "cells", hairs along a unit of length, so that a unit of area holds its square and
    every face at least one and at most 4096²; of "sine", f. hairs: None, or in place of frequency how many "cells" have
    on the whole mesh, 1..10**9. sharpness > 1: where the smoothstep of a hair's edge ends, times its start. density:
    above 0, at most 1, how much of its cell a hair fills. noise: (how far hairs are moved, >= 0, size of the noise's
    waves, >= 1), both in hairs. length_variation: 0..1, how much hairs differ ("cells" only).
    color: linear RGB >= 0 (arrays of uint8 or uint16 are sRGB). look: how hair scatters light, a Kajiya, no Chiang; or
    specular and exponent, to make one. alpha: 0..1, how much light one hair lets through. root_shade: 0..1, the share
    of light at the roots; it rises to 1 at the tips. shading: "kajiya-kay", by the hair's direction, or "turned", by
    the report's turned normals.

    wind, force, acceleration: [3]. At height h of 0..1 a hair goes along n + h · (wind, which gusts with time, + force
    − acceleration) for the normal n; force is gravity and the like, acceleration that of the object itself.
    time: seconds. seed: of all that is random, 0..2**32-1. lean: None or [vertices, 3], what is added to the force at
    each vertex of the mesh, as Motion gives it; it may be a float32 array on a device.

    rest: None or the Mesh in rest, of the same faces as the scene's, which is posed. Cells and noise belong to the skin
    and are laid on the mesh in rest, so that they stay where they are on it in every pose; frequency is of its units.
    None: the scene's mesh is in rest. Raises Error for anything else.
    """

    length: float = checks.field(checks.positive(), default=0.1)
    layers: int = checks.field(checks.whole(1, 1000), default=30)
    frequency: float = checks.field(checks.positive(), default=40.0)
    pattern: str = checks.field(checks.choice("cells", "sine"), default="cells")
    sharpness: float = checks.field(checks.real(above=1), default=1.4)
    density: float = checks.field(checks.positive(high=1), default=1.0)
    noise: checks.Given = checks.field(_noise, default=(0.5, 8.0))
    length_variation: float = checks.field(checks.real(low=0, high=1), default=0.3)
    color: checks.Given = checks.field(checks.color, default=(0.8, 0.6, 0.4))
    alpha: float = checks.field(checks.real(low=0, high=1), default=0.5, kw_only=True)
    root_shade: float = checks.field(checks.real(low=0, high=1), default=0.6, kw_only=True)
    shading: str = checks.field(checks.choice("kajiya-kay", "turned"), default="kajiya-kay", kw_only=True)
    wind: checks.Given = checks.field(_wind, default=(0.0, 0.0, 0.0), kw_only=True)
    force: checks.Given = checks.field(checks.vector(3), default=(0.0, 0.0, 0.0), kw_only=True)
    acceleration: checks.Given = checks.field(checks.vector(3), default=(0.0, 0.0, 0.0), kw_only=True)
    time: float = checks.field(checks.real(), default=0.0, kw_only=True)
    seed: int = checks.field(checks.whole(0, 2**32 - 1), default=0, kw_only=True)
    rest: Mesh | None = checks.field(checks.instance(Mesh, none=True), default=None, kw_only=True)
    lean: checks.Given = checks.field(checks.optional(_lean), default=None, kw_only=True)
    hairs: int | None = checks.field(checks.optional(checks.whole(1, 10**9)), default=None, kw_only=True)
    __repr__ = brief

    def __attrs_post_init__(self):
        super().__attrs_post_init__()
        if not isinstance(self.look, Kajiya):
            checks.refuse("Shells.look", self.look, "a Kajiya: the pattern of shells has no single hairs")
        if self.hairs is not None and self.pattern == "sine":
            checks.refuse("Shells.hairs", self.hairs, "None with the pattern 'sine', whose frequency is of uv")

    @property
    def on_host(self) -> "Shells":
        """The same Shells with no array on a device."""
        return attrs.evolve(self, lean=self.lean.get()) if checks.is_on_device(self.lean) else self

    def frequency_on(self, mesh: Mesh) -> float:
        """Hairs along a unit of length on a scene's mesh, as its ``frequency`` or its ``hairs`` tell; of sines f."""
        if self.hairs is None:
            return self.frequency
        area = max((self.rest or mesh).area, checks.SMALLEST**2)
        return min(max(math.sqrt(self.hairs / area), checks.SMALLEST), checks.LARGEST)
