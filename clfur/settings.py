"""What a picture may cost."""

import attrs

from .errors import Error
from .scene import checks

RASTERS = ("coverage", "samples")
CHOSEN = ("samples", "raster", "shadows", "grid", "shadow_map", "pcf", "masks", "lod")   # by max_error, seconds
SCATTERING = ("off", "grid")
SHADOWS = ("off", "binary", "count", "trilinear", "length", "deep")


def _samples(value, where):
    try:
        number = checks.whole(1, 16)(value, where)
    except Error:
        number = 0
    return number if number in (1, 4, 16) else checks.refuse(where, value, "1, 4 or 16")


def _cells(value, where):
    number = checks.whole(16, 1024)(value, where)
    return number if number % 16 == 0 else checks.refuse(where, value, "a multiple of 16 from 16 to 1024")


def _masks(value, where):
    return value if value in (0, 4) and not isinstance(value, bool) else checks.refuse(where, value, "0 or 4")


@attrs.frozen
class Settings:
    """How a scene is drawn.

    samples: 1, 4 or 16 a pixel.  raster: "coverage" takes the area that each strand covers of each pixel, transparent
    and sorted by depth, and samples for the body alone; "samples" draws strands as opaque and at least 1/samples of a
    pixel wide.
    shadows: "length" deposits what rays of light are expected to cross; "binary", "count" and "trilinear" are the
    report's voxels; "off"; "deep" is "length" for the body, while each piece of a strand that is seen looks at the
    single hairs before each light; of raster "coverage", without shells and lights with a size.
    grid: cells a side, a multiple of 16.  shadow_map: texels a side of the body's shadow map, 0 for none.  pcf: radius
    in texels over which its comparisons are averaged (the report's equation 8).
    masks: 0 or 4; 4: strands hide each other in 4x4 parts of a pixel by the area that they have in each, else as if
    they lay at random in it; with raster "coverage" alone.
    scattering: "grid" follows light from hair to hair, where all strands have the look `clfur.Chiang`, in cells of the
    world; lights leave out the flat ambient that they have by default, which stands for that light.  For raster
    "coverage"; not where max_error or seconds choose.
    lod: pixels, 0 to 4; strands that are thinner are drawn as fewer and wider ones, at least 1/8 of them, and points
    within lod/4 pixels of a straight line are left out; 0: all there is.
    filtered: whether the pattern of shell fur is averaged over the pixel.  blur: where the report's Gaussian is laid
    over the picture: "off", "all", or "edges", which leaves the interior of the fur untouched.  blur_sigma: its width
    in pixels, above 0, at most 16.
    max_error: None, or how wrong the picture may be: root mean square of the difference of sRGB-coded values (0 to 1)
    to the true picture.  seconds: None, or how many seconds a frame may take, by the clock, everything done anew and
    kernels built: `Frame.seconds` of the first one; those that follow keep what has not changed, and take less.
    Where either is given, samples, raster, shadows, grid, shadow_map, pcf, masks and lod are chosen (see `clfur.draw`),
    and may not be given here.
    Raises `clfur.Error` for anything else.
    """

    samples: int = checks.field(_samples, default=4)
    raster: str = checks.field(checks.choice(*RASTERS), default="coverage")
    shadows: str = checks.field(checks.choice(*SHADOWS), default="length")
    grid: int = checks.field(_cells, default=96)
    shadow_map: int = checks.field(checks.whole(0, 8192), default=512)
    pcf: int = checks.field(checks.whole(0, 16), default=1)
    masks: int = checks.field(_masks, default=0)
    scattering: str = checks.field(checks.choice(*SCATTERING), default="off")
    lod: float = checks.field(checks.real(low=0, high=4), default=0.0)
    filtered: bool = checks.field(checks.flag, default=True)
    blur: str = checks.field(checks.choice("off", "all", "edges"), default="off")
    blur_sigma: float = checks.field(checks.positive(high=16), default=1.0)
    max_error: float | None = checks.field(checks.optional(checks.positive()), default=None)
    seconds: float | None = checks.field(checks.optional(checks.positive()), default=None)

    def __attrs_post_init__(self):
        if self.masks and self.raster != "coverage":
            raise Error(f"Settings.masks is {self.masks}, but Settings.raster is {self.raster!r}; allowed: 0, or "
                        "raster 'coverage'")
        if self.scattering != "off" and (self.goal or self.raster != "coverage"):
            field = self.goal or "raster"
            raise Error(f"Settings.scattering is {self.scattering!r}, but Settings.{field} is "
                        f"{getattr(self, field)!r}; allowed: 'off', or raster 'coverage' without max_error and seconds")
        if self.shadows == "deep" and self.raster != "coverage":
            raise Error(f"Settings.shadows is 'deep', but raster is {self.raster!r}; allowed: raster 'coverage'")
        if goal := self.goal:
            for field in attrs.fields(Settings):
                if field.name in CHOSEN and getattr(self, field.name) != field.default:
                    raise Error(f"Settings.{field.name} is {getattr(self, field.name)!r}, but Settings.{goal} chooses "
                                f"it; allowed: one of them")

    @property
    def method(self) -> str:
        """How hair is put into the lights' grids: one of `layout.METHODS`, or "off"."""
        return "length" if self.shadows == "deep" else self.shadows

    @property
    def goal(self) -> str | None:
        """Name of the field by which the others are chosen: "seconds", "max_error", or None."""
        return next((name for name in ("seconds", "max_error") if getattr(self, name) is not None), None)


def label(settings, layers=None):
    """What is particular to settings, in a few words: "4 samples, coverage, shadow grid 48"."""
    words = [f"{settings.samples} sample{'s' * (settings.samples > 1)}"]
    words += ["coverage"] * (settings.raster == "coverage")
    words += [] if layers is None else [f"{layers} layer{'s' * (layers > 1)}"]
    words += [f"{settings.shadows} shadows"] * (settings.shadows not in ("length", "off"))
    words.append("no shadows" if settings.shadows == "off" else f"shadow grid {settings.grid}")
    words += ["unfiltered"] * (not settings.filtered)
    written = {"samples", "raster", "shadows", "grid", "filtered"}
    written |= {"shadow_map", "pcf"} if settings.shadows == "off" else set()   # without shadows nothing reads these
    for field in attrs.fields(Settings):
        value = getattr(settings, field.name)
        if value != field.default and field.name not in written:
            words.append(f"{field.name.replace('_', ' ').replace('shadow map', 'map')} "
                         f"{value if isinstance(value, str) else f'{value:g}'}")
    return ", ".join(words)
