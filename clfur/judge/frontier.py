"""Speed against accuracy: what each of many settings takes and how far its pictures are from the truth."""

import io
import itertools
import json
import zipfile
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import attrs
import numpy as np

from .. import cache, measures
from ..budget import PRESETS, refused
from ..cache import digest
from ..device.scheduler import Scheduler, sources
from ..errors import Error
from ..render import draw
from ..scene import Camera, Scene, checks
from ..scene.display import brief
from ..settings import Settings, label
from . import truth
from .compare import Spread, plain

OVER = 8                # truth's samples a pixel, across and down
STEPS = 4               # of the pan, each of a pixel / STEPS
LAYERS = 120            # of the shells that count as true
FINEST = {"raster": "samples", "samples": 1, "filtered": False, "grid": 128, "shadow_map": 2048}   # how these are drawn
NAMED = {"default": Settings(), **PRESETS}   # settings that a chart points at


@attrs.frozen
class Point:
    """What one way to draw the scene takes and gives.

    settings: `Settings`.  layers: of the scene's shells, or None without.  label: what is particular to it, in a few
    words.  name: of `NAMED` settings, "own", or "".  times: seconds of each warm frame, everything done anew;
    seconds: their `Spread`.  strands, segments: what was drawn.  error, rmse, bias, area, flip: as `measures.measure`
    has them; flicker: of `measures.flicker`, None without a pan.  best: whether no other is both faster and nearer
    the truth.
    """

    settings: Settings
    layers: int | None
    label: str
    name: str
    times: list
    seconds: Spread
    strands: int
    segments: int
    error: float
    rmse: float
    bias: float
    area: float | None
    flip: float | None
    flicker: float | None
    best: bool = False
    __repr__ = brief


@attrs.frozen(eq=False)
class Frontier:
    """What `frontier` found.

    device: its description.  size: of the picture.  noise: error of the truth itself, as far
    as two halves of its samples differ.  truth: what it is, in a line.  earlier: how many of the frames were timed by
    an earlier run.  points: a `Point` for each candidate, the fastest first.
    """

    device: str
    size: tuple
    noise: float
    truth: str
    earlier: int
    points: list
    __repr__ = brief

    @property
    def best(self) -> list[Point]:
        """The points that no other beats in both time and error, the fastest first."""
        return [point for point in self.points if point.best]

    def as_dict(self) -> dict:
        """All of it, as what JSON can hold; numbers that are not finite become None."""
        return plain(attrs.asdict(self))


def sweep(scene):
    """What a chart tries on a `Scene` -> [(`Settings`, layers of shells or None)].

    Every product of every knob would be thousands of pictures, nearly all of them foolish.  Knobs that change each
    other's worth are multiplied: samples, raster and lod all spend time on edges of strands (or, of shells: samples,
    layers and the filter), so these meet in full under good shadows.  How hair shades and in how fine a grid hardly
    depends on them, so each method meets each grid under one good raster; masks, which cost more than they, the finer
    ones; single hairs before lights ("deep") need no fine grid, light from hair to hair neither.  Then the body's
    shadow map and its filter alone.  Last come the two ends, where every knob is cheap or every knob is dear.  Knobs
    that this scene, or what is without shadows, has no use for stay as they are, and settings that it refuses are left
    out.
    """
    strands, shells = scene.strands is not None, scene.shells is not None
    used = {field.name for field in attrs.fields(Settings)}
    used -= (set() if strands else {"raster", "lod", "masks"}) | (set() if strands or shells else {"grid"})
    good, found = {"grid": 64, "raster": "coverage"}, []

    def add(layers=(30,), **knobs):
        for *values, layer in itertools.product(*knobs.values(), layers if shells else [None]):
            chosen = {**good, **dict(zip(knobs, values))}
            found.append((Settings(**{name: value for name, value in chosen.items() if name in used}), layer))

    if strands or not shells:
        add(samples=[1, 4, 16], raster=["samples", "coverage"], lod=[0, 0.5, 1, 2])
    if shells:
        add(samples=[4] if strands else [1, 4, 16], filtered=[True, False], layers=[8, 15, 30, 60])
    add(shadows=["count", "trilinear", "length"] if "grid" in used else ["length"], grid=[32, 48, 64, 96, 128])
    if strands:
        add(masks=[4], grid=[96, 160, 256])
        add(shadows=["deep"], masks=[0, 4], grid=[96])
        add(scattering=["grid"], shadows=["length", "deep"], masks=[0, 4], grid=[96])
    add(shadows=["off"])
    add(pcf=[0, 1, 3], shadow_map=[512, 2048])
    cheap = {"samples": [1], "raster": ["samples", "coverage"], "lod": [0, 2], "layers": [8]}
    add(**cheap, shadows=["off"])
    add(**cheap, grid=[32], shadow_map=[256], pcf=[0])
    add(samples=[4, 16], grid=[96, 128], shadow_map=[2048], layers=[60])
    found += [(settings, scene.shells.layers if shells else None) for settings in NAMED.values()
              if strands or settings not in PRESETS.values()]   # presets are of strands
    found = list(dict.fromkeys(found))
    return [way for way in found if not refused(scene, way[0])] or found


def frontier(scene: Scene, candidates: Sequence[Settings] | None = None, device: Any = None, repeat: int = 3,
             pan: bool = True, tell: Callable | None = None, fresh: bool = False, own: Settings | None = None
             ) -> Frontier:
    """Draw a `Scene` in many ways and measure each against the truth -> `Frontier`.

    ``candidates``: `Settings`, or pairs of these and the layers of the scene's shells, in a list; what `sweep` in this
    module gives if None.  ``device``: as `Scheduler` takes it.  ``repeat``: warm frames of each, taken in turn, so
    that a busy machine favours none.  ``pan``: whether flicker is measured too.  ``tell``: called with (what is done
    now, done, in all).  What was measured is kept in clfur's cache folder, so that a run that is cut short goes on
    where it was, and one like it needs to draw nothing; ``fresh`` begins anew, but with the truth that is kept.
    ``own``: `Settings` to try beside the candidates, or None; their `Point` is named "own".
    The truth is `clfur.truth.picture` of strands and bodies, of all orders of light where a candidate's scattering is
    on, to which those without are compared too; of shells, which it does not know, the scene drawn 8 times
    as large in 120 unfiltered layers with the finest shadows.
    Raises `clfur.Error` for a device that is not there and other wrong arguments, before anything is drawn, and for a
    scene of which nothing is to be seen.
    """
    if not isinstance(scene, Scene):
        raise Error(f"scene is {scene!r:.60}; allowed: a clfur.Scene")
    repeat = checks.whole(1, 10000)(repeat, "repeat")
    ways, names = _checked(scene, sweep(scene) if candidates is None else candidates), NAMED
    if own is not None:
        ways, names = list(dict.fromkeys([*ways, *_checked(scene, [own])])), {**NAMED, "own": own}
    width, height = scene.camera.size
    if (max(width + 1, height)) * OVER > 16384:
        raise Error(f"Camera.size is {width}x{height}; allowed in a chart: at most {16384 // OVER - 1}x"
                    f"{16384 // OVER}, since the truth is drawn {OVER} times as large")
    gpu = Scheduler(device)
    progress = tell or (lambda *_: None)
    orders = truth.ALL if any(settings.scattering != "off" for settings, _ in ways) else 0
    truths, noise = _truths(scene, gpu, progress, orders)
    if not truths[..., 3].any():
        raise Error("nothing of the scene is to be seen in the picture; allowed: a camera that looks at it")
    flips = measures.flip(truths[0], truths[0]) is not None
    kept = _Kept(digest(scene, OVER, orders, sources(), gpu.name, gpu.device.driver_version, pan, flips), fresh)

    for number, way in enumerate(ways):
        progress("pictures", number, len(ways))
        if not kept.found(way):
            kept.add(way, found=_judge(scene, gpu, way, truths, pan))
    earlier = sum(len(kept.times(way)) for way in ways)
    for turn in range(repeat):
        for number, way in enumerate(ways):
            progress("times", turn * len(ways) + number, repeat * len(ways))
            if len(kept.times(way)) <= turn:
                kept.add(way, seconds=_time(scene, gpu, way))
    progress("times", repeat * len(ways), repeat * len(ways))

    points = [_point(scene, way, ways, names, kept) for way in ways]
    points.sort(key=lambda point: point.seconds.median)
    least = np.inf
    for place, point in enumerate(points):
        if point.error < least:   # never of a picture that holds NaN
            least, points[place] = point.error, attrs.evolve(point, best=True)
    return Frontier(gpu.name, scene.camera.size, noise,
                    f"the scene's own shells in {LAYERS} unfiltered layers" if scene.shells else
                    "brute force" + ", light from hair to hair" * (orders > 0), earlier, points)


def _checked(scene, ways):
    """[(Settings, layers or None)] of candidates, each once."""
    allowed = "Settings, or pairs of Settings and layers of shells (1 to 1000), in a list"
    if not isinstance(ways, (list, tuple)) or not len(ways):
        checks.refuse("candidates", ways, allowed)
    given_layers, found = scene.shells and scene.shells.layers, []
    for way in ways:
        settings, layers = way if isinstance(way, tuple) and len(way) == 2 else (way, given_layers)
        if not isinstance(settings, Settings) or settings.goal or (layers is not None and not scene.shells):
            checks.refuse("candidates", way, allowed if scene.shells else "Settings, since the scene has no shells")
        if scene.shells:
            layers = checks.whole(1, 1000)(layers, "candidates' layers")
        found.append((settings, layers))
    return list(dict.fromkeys(found))


def _layered(scene, layers):
    """The scene with so many layers of shells."""
    if layers is None or scene.shells.layers == layers:
        return scene
    fur = [attrs.evolve(part, layers=layers) if part is scene.shells else part
           for part in (scene.fur if isinstance(scene.fur, tuple) else [scene.fur])]
    return attrs.evolve(scene, fur=fur)


def _moved(scene, pixels, over=1, wider=0):
    """The scene moved so many pixels to the right in its picture, which gets ``wider`` by some, then ``over`` as large.
    """
    (width, height), k = scene.camera.size, scene.camera.intrinsics.copy()
    k[0, 2] += pixels
    k[:2] *= over
    return attrs.evolve(scene, camera=Camera.calibrated(scene.camera.pose, k, ((width + wider) * over, height * over)))


def _truths(scene, gpu, progress, orders=0):
    """(truth at each step of the pan float32 [STEPS + 1, h, w, 4], its noise)."""
    known = digest(scene, OVER, STEPS, *((LAYERS, FINEST, sources()) if scene.shells else (truth.VERSION,)),
                   *([orders] if orders else []))
    file = cache.folder("charts") / f"truth-{known[:32]}.npz"
    try:
        with np.load(file) as there:
            return there["truths"], float(there["noise"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):   # none yet, or damaged
        pass
    cache.write(file, b"")   # before the work: if nothing can be kept, that is said now
    progress("truth", 0, 100)
    # One picture holds every step: large enough that a step is a whole number of its pixels, and one pixel wider.
    large = _moved(scene, 1, OVER, 1)
    if scene.shells:
        fine = draw(_layered(large, LAYERS), gpu, Settings(**FINEST)).images["color"]
    else:
        fine = truth.picture(large, samples=1, progress=lambda share: progress("truth", round(100 * share), 100),
                             orders=orders)
    width, height = scene.camera.size
    progress("truth", 100, 100)
    starts = [OVER - step * OVER // STEPS for step in range(STEPS + 1)]
    parts = [fine[:, start:start + width * OVER].reshape(height, OVER, width, OVER, 4) for start in starts]
    truths = np.array([part.mean((1, 3)) for part in parts], np.float32)
    # Samples as on a chessboard: each half errs by sqrt(2) of the whole, so that they differ by 2 of it.
    odd = np.indices((OVER, OVER)).sum(0) % 2
    halves = [np.einsum("hawbc,ab->hwc", parts[0], odd == side) / (odd == side).sum() for side in (0, 1)]
    noise = measures.measure(*halves)["error"] / 2
    stream = io.BytesIO()
    np.savez_compressed(stream, truths=truths, noise=noise)
    cache.write(file, stream.getvalue())
    return truths, noise


def _judge(scene, gpu, way, truths, pan):
    """{name: number} of one candidate's picture."""
    settings, layers = way
    scene = _layered(scene, layers)
    drawn = draw(scene, gpu, settings)
    found = measures.measure(drawn.images["color"], truths[0])
    found |= {"strands": drawn.strands, "segments": drawn.segments, "flicker": None}
    if pan:
        pictures = [draw(_moved(scene, step / STEPS), gpu, settings).images["color"] for step in range(1, STEPS + 1)]
        found["flicker"] = measures.flicker([drawn.images["color"], *pictures], truths)
    return found


def _time(scene, gpu, way):
    """Seconds of a warm frame, everything done anew."""
    settings, layers = way
    scene = _layered(scene, layers)
    gpu.forget()
    draw(scene, gpu, settings)   # after another candidate's frame the scheduler does not know how long launches are
    gpu.forget()
    return draw(scene, gpu, settings).seconds


def _point(scene, way, ways, names, kept):
    settings, layers = way
    times = kept.times(way)
    name = ", ".join(name for name, named in names.items() if named == settings)
    several = layers is not None and len({layers for _, layers in ways}) > 1
    # A name's settings say nothing of layers: the scene does.
    as_named = layers is None or layers == scene.shells.layers
    return Point(settings, layers, label(settings, layers if several else None), name if as_named else "", times,
                 Spread.of(times), **kept.found(way))


class _Kept:
    """What was measured so far: lines of JSON in the cache, each whole in itself."""

    def __init__(self, key, fresh):
        self.file = cache.folder("charts") / f"{key[:32]}.jsonl"
        if fresh or not self.file.exists():
            cache.write(self.file, b"")
        self.lines = {}
        for line in self.file.read_text(encoding="utf-8").split("\n"):
            try:
                record = json.loads(line)
            except ValueError:   # the last line of a run that was killed while it wrote
                continue
            self._take(record)

    def _take(self, record):
        self.lines.setdefault(self._name(record["settings"], record["layers"]), []).append(record)

    def _name(self, settings, layers):
        return json.dumps([settings, layers], sort_keys=True)

    def _of(self, way, what):
        lines = self.lines.get(self._name(attrs.asdict(way[0]), way[1]), ())
        return [line[what] for line in lines if what in line]

    def found(self, way):
        """What `_judge` gave for a candidate, or None."""
        return next(iter(self._of(way, "found")), None)

    def times(self, way):
        """Seconds of each of its frames."""
        return self._of(way, "seconds")

    def add(self, way, **what):
        record = {"settings": attrs.asdict(way[0]), "layers": way[1], **what}
        try:
            with self.file.open("a", encoding="utf-8") as stream:
                stream.write("\n" + json.dumps(record) + "\n")
        except OSError as error:
            raise Error(f"cannot write to {self.file}: {error.strerror}") from None
        self._take(record)
