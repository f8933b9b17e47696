"""The same frames on many devices: seconds, memory and the pictures' differences, each device in its own process."""

import contextlib
import re
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import attrs
import numpy as np
import psutil

from ..device.caches import in_folder, temporary
from ..device.scheduler import Scheduler
from ..device.selection import choose, describe, handles
from ..errors import Error
from ..measures import flip
from ..render import draw
from ..scene import Scene, checks
from ..scene.display import brief
from ..settings import Settings
from .isolated import isolated, send
from .speed import told

BEYOND = 1e-3   # colours further apart than this, in linear light, count as different ...
SHARE = 1e-3    # ... of which a picture may hold this share and still agree


@attrs.frozen
class Spread:
    """Median, least and most of some numbers."""

    median: float
    min: float
    max: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        return cls(statistics.median(values), min(values), max(values))


@attrs.frozen
class Difference:
    """How a picture differs from the reference's.

    largest: difference of any channel, linear.  share: of pixels that differ by more than 1e-3.  flip: mean FLIP error
    over black, 0 to 1, or None without the package flip_evaluator.  same: {integer stage: whether its bits are equal}.
    """

    largest: float
    share: float
    flip: float | None
    same: dict


@attrs.frozen(eq=False)
class Row:
    """What one device made of the frames.

    device: text that means it.  name: its description.  status: "ok", "differs" (from the reference), "error", "crash"
    or "hang".  message: one line of why it is not ok, or "".  The rest is None where there is no picture:
    frames: seconds of each warm frame, everything done anew.  frame: their spread.  stages: {name: `Spread` of seconds
    on the device}, None also where the driver's times cannot be true.  first: seconds from making the scheduler to the
    first picture, without any cache on disk; build: of these, building programs.  memory: most bytes that arrays took
    on the device.  resident: most bytes that the process held in memory, None where the system does not tell.
    strands_per_second: by the median frame.  difference: `Difference`.  picture: float32 [h, w, 4].
    """

    device: str
    name: str
    status: str
    message: str = ""
    frames: list | None = None
    frame: Spread | None = None
    stages: dict | None = None
    first: float | None = None
    build: float | None = None
    memory: int | None = None
    resident: int | None = None
    strands_per_second: float | None = None
    difference: Difference | None = None
    picture: np.ndarray | None = attrs.field(default=None, repr=False)
    __repr__ = brief


@attrs.frozen(eq=False)
class Comparison:
    """What `compare` found.

    reference: the device whose picture the others are compared to; None where none gave one.  size: of the picture.
    settings: `Settings` of all.  triangles, strands, segments: what the reference drew.  repeat: warm frames a device.
    rows: a `Row` a device.
    """

    reference: str | None
    size: tuple
    settings: Settings
    triangles: int | None
    strands: int | None
    segments: int | None
    repeat: int
    rows: list
    __repr__ = brief

    @property
    def agree(self) -> bool:
        """Whether every device gave the picture, and all the same one."""
        return all(row.status == "ok" for row in self.rows)

    @property
    def fastest(self) -> str:
        """Which device is fastest, and by how much, in a line; of those that give the picture, "" where none does."""
        seconds = {row.device: row.frame.median for row in self.rows if row.frame and row.status == "ok"}
        return told(seconds) if seconds else ""

    def as_dict(self) -> dict:
        """All but the pictures, as what JSON can hold; numbers that are not finite become None."""
        known = attrs.asdict(self, filter=lambda field, _: field.name != "picture")
        return plain(known | {"agree": self.agree, "fastest": self.fastest})


def compare(scene: Scene, devices: str | Sequence[str] = "all", settings: Settings | None = None, repeat: int = 5,
            reference: str | None = None, seconds: float = 300, tell: Callable | None = None) -> Comparison:
    """Draw the same frames of a `Scene` on many devices, one after another -> `Comparison`.

    ``devices``: "all", or texts as `Scheduler` takes them, in a list or with commas between.  ``settings``: a
    `Settings`; None: its defaults.  ``repeat``: warm frames a device.  ``reference``: the device to compare to;
    otherwise the one that "auto" means, if it is among them and works, or else the first that works.  ``seconds`` that
    a frame may take; a driver that takes longer, or crashes, costs its own row alone.  ``tell``: called with (device,
    frames done, frames in all) as they go on.
    Raises `clfur.Error` for a device that is not there, before anything is drawn, and for other wrong arguments.
    """
    for value, kind, where in (scene, Scene, "scene"), (settings, Settings | None, "settings"):
        if not isinstance(value, kind):
            raise Error(f"{where} is {value!r:.60}; allowed: a clfur.{where.capitalize()}")
    settings = settings or Settings()
    if settings.goal:
        raise Error(f"Settings.{settings.goal} is given; allowed in a comparison: none, since each device would choose "
                    f"settings of its own")
    repeat = checks.whole(1, 10000)(repeat, "repeat")
    chosen = _chosen(devices)
    best = [handle for handle, device in chosen if device == choose(reference or "auto")]
    if reference and not best:
        raise Error(f"reference is {reference!r}; allowed: one of the devices compared: {', '.join(dict(chosen))}")

    rows, measured = [], {}
    for handle, device in chosen:
        outcome, message = _in_its_process(handle, scene, settings, repeat, seconds, tell)
        measured[handle] = outcome.value
        rows.append(Row(handle, describe(device), outcome.status, message))
    reference = next((handle for handle in best + list(measured) if measured[handle]), None)
    rows = [_row(row, measured[row.device], measured[reference]) if measured[row.device] else row for row in rows]
    triangles, strands, segments = measured[reference]["drawn"] if reference else (None,) * 3
    return Comparison(reference, scene.camera.size, settings, triangles, strands, segments, repeat, rows)


def _chosen(devices):
    """[(text, device)] of what `compare` takes, each device once; raises `clfur.Error` where there is none such."""
    if not isinstance(devices, (str, list, tuple)):
        raise Error(f"devices is {devices!r:.60}; allowed: 'all', or names of devices")
    there = handles()
    if devices == "all":
        choose("auto")   # raises where there is none at all
        return there
    names = devices.split(",") if isinstance(devices, str) else devices
    wanted = [choose(name) for name in names]
    if not wanted:
        raise Error("devices is empty; allowed: 'all', or names of devices")
    texts = {device: text for text, device in there}
    return [(texts[device], device) for device in dict.fromkeys(wanted)]


def _in_its_process(handle, scene, settings, repeat, seconds, progress):
    """(Outcome of `_measure`, one line of why it failed or "")."""
    done, frames = 0, repeat + 2

    def count(_=None):
        nonlocal done
        done += 1
        if progress:
            progress(handle, done, frames)
    if progress:
        progress(handle, 0, frames)
    with temporary() as caches:   # empty, so that the first frame is a first frame
        outcome = isolated(f"{__name__}:_measure", handle, scene, settings, repeat, seconds=seconds, receive=count,
                           environment=in_folder(caches))
    return outcome, "" if outcome.status == "ok" else f"{outcome.message} (after {done} of {frames} frames)"


def _measure(device, scene, settings, repeat):
    """In a process of its own: draw the frames on one device -> what `_row` reads."""
    began = time.perf_counter()
    gpu = Scheduler(device)
    draw(scene, gpu, settings)
    first, build = time.perf_counter() - began, gpu.build_seconds
    send("the first frame")
    gpu.forget()
    known = draw(scene, gpu, settings, hashes=True)   # also warms up; hashing takes time, so it is none of the frames
    send("the frame with hashes")
    frames = []
    for _ in range(repeat):
        gpu.forget()
        frames.append(draw(scene, gpu, settings))
        send("a frame")
    return {"drawn": (known.triangles, known.strands, known.segments), "hashes": known.hashes,
            "picture": frames[-1].images["color"], "first": first, "build": build, "resident": peak_memory(),
            "frames": [f.seconds for f in frames], "stages": [f.stages for f in frames],
            "memory": max(f.memory for f in frames)}


def peak_memory():
    """Most bytes that this process has held in memory so far, or None where nobody tells."""
    with contextlib.suppress(OSError, TypeError):   # no /proc, or one without this line
        told = Path("/proc/self/status").read_bytes()
        return 1024 * int(re.search(rb"VmHWM:\s+(\d+) kB", told)[1])
    try:
        import resource
    except ImportError:   # Windows
        return getattr(psutil.Process().memory_info(), "peak_wset", None)
    # Not on Linux: there it starts with what the parent held when it made this process.
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most


def _row(row, measured, reference):
    """The row of a device that gave its picture, compared to the reference's."""
    apart = np.abs(measured["picture"].astype(np.float64) - reference["picture"]).max(axis=2)
    apart[np.isnan(apart)] = np.inf
    difference = Difference(float(apart.max()), float((apart > BEYOND).mean()),
                            flip(reference["picture"], measured["picture"]),
                            {name: measured["hashes"].get(name) == bits for name, bits in reference["hashes"].items()})
    wrong = [f"other bits in {name}" for name, same in difference.same.items() if not same]
    if difference.share > SHARE:
        wrong.append(f"{difference.share:.2%} of the pixels are beyond {BEYOND:g}")
    frame = Spread.of(measured["frames"])
    return attrs.evolve(
        row, status="differs" if wrong else "ok", message=", ".join(wrong), frames=measured["frames"], frame=frame,
        stages=_stages(measured["stages"], measured["frames"]), first=measured["first"],
        build=measured["build"], memory=measured["memory"], resident=measured["resident"],
        strands_per_second=measured["drawn"][1] / frame.median, difference=difference, picture=measured["picture"])


def _stages(stages, frames):
    """{stage: Spread of seconds}, or None where their sums cannot be true: some drivers' clocks stand still."""
    if not all(1e-3 * seconds < sum(times.values()) < 1.1 * seconds for times, seconds in zip(stages, frames)):
        return None
    return {name: Spread.of([times[name] for times in stages]) for name in stages[0]}


def plain(value):
    """What JSON can hold of dicts, lists and numbers: what is not finite becomes None."""
    if isinstance(value, dict):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
