"""Picks the cheapest settings that are near enough to the truth, or the best that are fast enough."""

import functools
import math
import warnings
from dataclasses import dataclass, replace

import attrs
import numpy as np

from . import measures
from .errors import Error
from .fitted import COSTS, ERRORS, RANGES
from .pipeline.plan import Plan
from .pipeline.views import Rig
from .scene import Curves, Strands, hair_bounds
from .scene.guides import reach_of
from .settings import CHOSEN, Settings

# From cheap to dear; docs/budget.md tells why these.
LADDER = (
    Settings(samples=1, lod=0.5, grid=48, shadow_map=256, pcf=0, raster="samples"),
    Settings(samples=4, grid=64, raster="samples"),
    Settings(samples=1, lod=0.45, grid=64, pcf=0, raster="coverage"),
    Settings(samples=1, grid=64, pcf=0, raster="coverage"),
    Settings(samples=4, grid=96, raster="coverage"),
    Settings(samples=4, grid=160, raster="coverage"),
    Settings(samples=4, grid=160, raster="coverage", masks=4),
    Settings(samples=4, grid=256, raster="coverage", masks=4),
    Settings(samples=4, grid=96, raster="coverage", masks=4, shadows="deep"),
)
PRESETS = {"draft": LADDER[0], "sketch": LADDER[1], "preview": LADDER[3], "final": LADDER[5], "reference": LADDER[8]}
BANDS, SHARE = 3, 0.1   # so many runs of rows, this share of the picture, are drawn to compare
CELL = 0.6              # widths of a strand; in finer cells than that its shadow is narrower than itself
HOPELESS = 2.0          # what is predicted to err so many times too much is not tried
MARGIN = 1.15           # estimates are wrong by about as much: so much is added to each


@dataclass(frozen=True)
class Rung:
    """Settings of `LADDER` as they suit a scene, and by the fit what they cost, in CPU time of the first, and err."""

    settings: Settings
    cost: float
    error: float


@dataclass(frozen=True)
class Choice:
    """What `choose` found: settings, the error that they surely do not exceed, why they, in a line, a warning or ""."""

    settings: Settings
    error: float
    why: str
    warning: str = ""


def choose(team, scene, settings, draw):
    """The `Choice` for `Settings` with max_error or seconds; ``draw(settings, bands=None)`` gives a `Frame`.

    It is kept on the team's first device for the very same mesh, fur and light, a camera that sees strands about as
    wide (by half an octave), and the same goals.
    """
    rig = Rig.of(scene)
    half_octaves = round(2 * math.log2(features(rig, 0)[0]))   # of a strand's width in pixels
    what = (scene.mesh, scene.strands, scene.shells, scene.environment, *scene.lights, str(scene.camera.size),
            half_octaves)
    goals = str([settings.max_error, settings.seconds, settings.filtered, scene.body_color is None, scene.body,
                 scene.ground is None])

    def find():
        choice = _choose(team, rig, settings, functools.partial(_unseen, draw))
        if settings.seconds is not None:   # the frame that comes is one of those seconds: done anew, as they were timed
            for gpu in team.gpus:
                gpu.forget()
        return choice
    choice = team.gpus[0].keep("choice", (*what, goals), find)
    if choice.warning:
        warnings.warn(choice.warning, stacklevel=3)
    # What is not chosen stays as it is given, and may have changed.
    fixed = {field.name: getattr(settings, field.name) for field in attrs.fields(Settings)
             if field.name not in (*CHOSEN, "max_error", "seconds")}
    return replace(choice, settings=attrs.evolve(choice.settings, **fixed))


def _unseen(draw, settings, bands=None):
    """The `Frame` of ``draw`` without its warnings: the picture that is chosen tells its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return draw(settings, bands=bands)


def _choose(team, rig, settings, draw):
    rungs = ladder(rig, settings.filtered, team.gpus)
    most, timing, late = len(rungs) - 1, "", ""
    if settings.seconds is not None:
        most, took = fastest(rungs, settings.seconds, lambda rung: _time(team, rung.settings, draw))
        timing = f"its frame took {took:.3g} s of {settings.seconds:g}, done anew"
        late = (f"Settings.seconds is {settings.seconds:g}, but the fastest frame there is takes {took:.3g}, done anew"
                if took > settings.seconds else "")
    preview = Preview(rig, rungs, draw)
    if settings.max_error is None:
        return Choice(rungs[most].settings, preview.error(most), timing, late)
    tried = preview.cheapest(settings.max_error, most)
    best = max(tried)   # what was tried last, the dearest
    why = (f"tried {len(tried)} of {len(rungs)} settings on {preview.rows} rows of the picture"
           + (timing and f"; {timing}"))
    missed = (f"Settings.max_error is {settings.max_error:g}, but the best there is{timing and ' in that time'} errs "
              f"by about {tried[best]:.3g}" if tried[best] > settings.max_error else "")
    return Choice(rungs[best].settings, tried[best], why, "; ".join(filter(None, [late, missed])))


def fastest(rungs, seconds, time):
    """(place of the dearest rung that takes no more than seconds by ``time(rung)``, what it took); 0 if none does."""
    took = time(rungs[0])
    place = max((n for n, rung in enumerate(rungs) if took * rung.cost / rungs[0].cost <= seconds), default=0)
    times = {0: took}
    while place and times.setdefault(place, time(rungs[place])) > seconds:   # only ever down: it comes to an end
        place -= 1
    return place, times[place]


def _time(team, rung, draw):
    """Seconds of a frame, everything done anew."""
    for _ in range(2):   # the first builds kernels
        for gpu in team.gpus:
            gpu.forget()
        frame = draw(rung)
    return frame.seconds


def ladder(rig, filtered=True, gpus=()):
    """[`Rung`] for a `Rig`, from cheap to dear: what is `suited`, but for what is no cheaper than a finer one."""
    rungs = suited(rig, filtered, gpus)
    return [rung for n, rung in enumerate(rungs) if all(rung.cost < finer.cost for finer in rungs[n + 1:])]


def suited(rig, filtered=True, gpus=()):
    """[`Rung`] for a `Rig`: of `LADDER` all but what its scene refuses or ``gpus`` cannot hold, with no finer cells
    than its strands cast right shadows in, or an eighth of their memory holds."""
    width = _hair(rig.scene)[0]
    room = min((min(gpu.memory // 8, gpu.largest) for gpu in gpus), default=1 << 32)
    finest = 2 * _radius(rig) / (CELL * width) if width else 1024
    most = max(int(min(finest, (room / 4) ** (1 / 3) - 1, 1024)) // 16 * 16, 16)
    settings = [attrs.evolve(rung, grid=min(rung.grid, most), filtered=filtered) for rung in LADDER]
    costs, errors = predicted(*features(rig, Plan(rig, ()).strands))
    if rig.scene.strands is None:   # nothing is known of it, but how its pictures differ
        errors = np.zeros(len(LADDER))
    rungs = [Rung(*each) for each in zip(settings, costs, errors)]
    return rungs[:1] + [rung for rung in rungs[1:] if not refused(rig.scene, rung.settings, gpus)]


def refused(scene, settings, gpus=()):
    """Why a scene is not drawn with settings, on devices: what the frame would raise before it begins, or ""."""
    try:
        plan = Plan(Rig.of(scene, settings), ("color",))
        for gpu in gpus:
            plan.cut(gpu)
    except Error as error:
        return str(error)
    return ""


def features(rig, strands):
    """(width of a strand in pixels, how many of ``strands`` cover a pixel of the ball around the scene), both > 0."""
    (width, length), pixels = _hair(rig.scene), _pixels(rig)
    covered = strands * length * width / (math.pi * _radius(rig)**2 or 1)
    (least, most), (thin, dense) = RANGES   # of what was fitted: beyond, nothing is known
    return (min(max(width * pixels, least), most) if width else 1.0, min(max(covered, thin), dense))


def _radius(rig):
    """Radius of the ball around the scene, or of what its distant lights' grids hold, if that is less."""
    halves = [float(grid["face"][1]) * int(grid["size"][0]) / 2 for grid in rig.grids
              if grid is not None and not grid["light"][3]]
    return min(rig.radius, max(halves, default=rig.radius))


def _pixels(rig):
    """How many pixels a world unit is in the middle of the scene."""
    distance = float(rig.view["to_screen"].T[3] @ [*rig.center, 1])
    return float(rig.view["scale"][0]) / max(distance, rig.radius / 8, 1e-9)


def _hair(scene):
    """(width, length) in world units that a strand has on average; (0, 0) without strands."""
    fur = scene.strands
    types = () if fur is None else fur.hairy_types
    if isinstance(fur, Strands) and types:
        length = [kind.full_length if fur.guides is None else reach_of(fur.guides)[1] for kind in types]
        return (float(np.mean([kind.width * (kind.root_width + kind.tip_width) / 2 for kind in types])),
                float(np.mean(length)))
    if isinstance(fur, Curves) and types:
        return float(fur.on_host.width.mean()), hair_bounds(fur, len(fur.counts))[1] / len(fur.counts)
    return 0.0, 0.0


class Preview:
    """Some rows of the picture with the finest rung, and how far others are from these.

    rows: how many.
    """

    def __init__(self, rig, rungs, draw):
        self.rungs, self.bands = rungs, bands(rig)
        self.rows = sum(end - top for top, end in self.bands)
        self._draw = draw
        self.expected = [rung.error for rung in rungs]
        self._finest = self._picture(rungs[-1])
        self._found = {}

    def _picture(self, rung):
        picture = self._draw(rung.settings, bands=self.bands).images["color"]
        return np.concatenate([picture[top:end] for top, end in self.bands])

    def error(self, place):
        """What a rung's picture errs, surely no more: by its difference to the finest, and what that one errs."""
        if place not in self._found:
            apart = 0.0 if place == len(self.rungs) - 1 else measures.error(
                self._picture(self.rungs[place]), self._finest)
            self._found[place] = MARGIN * float(np.hypot(apart, self.expected[-1]))
        return self._found[place]

    def cheapest(self, most_error, last):
        """{place: error} of the rungs that were tried, from the cheapest on until one surely errs no more."""
        tried = {}
        for place in range(last + 1):
            if self.expected[place] > HOPELESS * most_error and place < last:
                continue
            tried[place] = self.error(place)
            if tried[place] <= most_error:
                break
        return tried


def predicted(width, covered):
    """(What each of `LADDER` costs, in CPU time of the first, what it errs), by the fit."""
    return np.exp(np.array([COSTS, ERRORS]) @ [1, math.log(width), math.log(covered)])


def bands(rig):
    """[(first row, one past the last)] of a tenth of the picture, spread over where the scene is."""
    scene, height = rig.scene, rig.scene.camera.size[1]
    points = scene.mesh.positions if scene.mesh is not None else scene.strands.on_host.points
    _x, y, _, w = rig.view["to_screen"].T @ np.column_stack([points, np.ones(len(points))]).T
    rows = y[w > 0] / w[w > 0]
    top, end = np.percentile(rows, (1, 99)) if len(rows) else (0, height)
    hair = _hair(scene)[1] * _pixels(rig)
    top, end = np.clip([top - hair, end + hair], 0, height)
    each = max(round(SHARE * height / BANDS), 1)
    found = []
    for n in range(BANDS):
        first = int(np.clip(round(top + (end - top) * (n + 0.5) / BANDS - each / 2), 0, max(height - each, 0)))
        first = max(first, found[-1][1] if found else 0)
        if first < height:
            found.append((first, min(first + each, height)))
    return found
