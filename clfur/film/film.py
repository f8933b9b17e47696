"""`clfur.film`: what users call."""

import contextlib
import functools
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..cache import digest
from ..device.scheduler import sources
from ..errors import Error, go_on, shown
from ..files.images import pixels
from ..files.output import check_writable, is_path
from ..files.video import KINDS, Kind, pyav, write_video
from ..render import schedulers
from ..scene import checks
from ..settings import Settings
from .cluster import check_address, on_cluster
from .jobs import Job, alone
from .moments import OF_MOTION, Moments
from .record import Record, frames_in

FRAMES = ".png", ".exr"     # files of single frames
PLACE = re.compile(r"%(0\d)?d")


def film(scene: Any, path: str | os.PathLike, frames: Iterable[int] = range(0, 24), *, fps: float = 24.0,
         motion: dict | None = None, settings: Settings | None = None, device: Any = None, cluster: str | None = None,
         shutter: float = 0.0, subframes: Any = "auto", background: Any = None, overwrite: bool = False,
         progress: Callable[[str, int, int], None] | None = None, stop: Callable[[], bool] | None = None) -> Path:
    """Draw a scene at one moment after the other, to a video file or a folder of pictures -> its path.

    scene: a `Scene`, or a function of seconds that gives one, all of one size. path: .mp4, .webm, .mov, .gif or .png
    (an animated one), or pictures with a place for their number, such as "frames/%04d.png" or .exr; the folder is made
    where it is missing. frames: whole numbers from 0 on, in rising order, of which number n is n / fps seconds after
    the groom, 0. fps: 1 to 1000. motion: None, or a dict of arguments of `Motion`, by which hair moves: {} for its own.
    cluster: None, or whose workers draw: "local", "local:N", "tcp://host:port" or "tls://host:port" (docs/cluster.md).
    shutter: degrees, 0 to 360, of a frame's time in which it takes light, up to its moment; 0: none. subframes: how
    many pictures that is, 1 to 64, or "auto", as `clfur.subframes` tells. background: None or a colour [3], linear
    light, that all is laid over; files that hold no alpha, .mp4, have black if it is None. overwrite: whether frames of
    another film make room for this one. progress: called with ("motion", "frames" or "video", how many are done, of how
    many). stop: as for `clfur.draw`; whole frames stay, and the next call goes on there. Workers elsewhere finish what
    they draw.
    Other arguments as for `clfur.draw`.

    Frames come first, each whole or not at all; those of a video in a folder beside it, path + ".frames", which goes
    when the video is whole. What was interrupted goes on, called again, where it stopped, to the same bits; see
    docs/film.md. Raises Error for wrong arguments, for a folder with frames of another film, for one that cannot be
    written, without PyAV for a video, and, with its number, for a frame that cannot be drawn.
    """
    place = _Place.of(path)
    numbers = _numbers(frames)
    fps = checks.real(low=1, high=1000)(fps, "film fps")
    if motion is not None and not (isinstance(motion, dict) and all(name in OF_MOTION for name in motion)):
        raise Error(f"film motion is {shown(motion)}; allowed: None, or a dict of arguments of clfur.Motion: "
                    f"{', '.join(OF_MOTION)}")
    if progress is not None and not callable(progress):
        raise Error(f"film progress is {shown(progress)}; allowed: None, or a function")
    checks.to_stop(stop, "film stop")
    settings = Settings() if settings is None else checks.instance(Settings)(settings, "film settings")
    behind = checks.optional(checks.color)(background, "film background")
    shutter = checks.real(0, 360)(shutter, "film shutter")
    if not (isinstance(subframes, str) and subframes == "auto"):
        try:
            subframes = checks.whole(1, 64)(subframes, "film subframes")
        except Error:
            checks.refuse("film subframes", subframes, '"auto", or a whole number from 1 to 64')
    if place.kind and not place.kind.alpha and behind is None:
        behind = np.zeros(3)
    if cluster is not None:
        check_address(cluster)
    gpus = schedulers(device)
    about = {
        "version of clfur": sources(), "device": digest([[gpu.name, gpu.device.driver_version] for gpu in gpus]),
        "settings": digest(settings), "motion": digest(motion), "fps": digest(fps), "background": digest(behind),
        "shutter": digest([shutter, subframes if shutter else 0]),
        "names of files": place.name}
    record = Record(place.folder, place.name_of, about, checks.flag(overwrite, "film overwrite"))
    moments, tell = Moments(scene, motion, fps, gpus[0], shutter / 360, subframes), progress or (lambda *_: None)
    try:
        there = [number for number in numbers
                 if number in record.scenes and go_on(stop) and record.check(number, moments.hash(number))]
        missing, done = sorted({*numbers} - {*there}), len(there)
        tell("frames", done, len(numbers))
        jobs = (Job(number, scenes, settings, place.suffix, behind)
                for number, scenes in moments.scenes(missing, record, functools.partial(tell, "motion"), stop))
        with contextlib.closing(_drawn(jobs, gpus, device, cluster, stop)) as drawn:
            for number, data in drawn:
                record.put(number, data, moments.hash(number))
                done += 1
                tell("frames", done, len(numbers))
        record.forget_states()
    finally:
        if not record.scenes:
            record.remove()
    if place.kind:
        _join(place, record, numbers, fps, tell, stop)
    return place.path


def frames_there(path: str | os.PathLike) -> list[Path]:
    """Return the files that a film to a path may replace or remove as frames of another; raises Error for the path."""
    place = _Place.of(path)
    try:
        return frames_in(place.folder, place.name_of)
    except OSError:   # there is no such folder, or who writes to it will tell
        return []


def _drawn(jobs, gpus, device, cluster, stop):
    """(number, bytes of its file) of the frames that jobs tell."""
    return alone(jobs, gpus, stop) if cluster is None else on_cluster(jobs, cluster, device, stop)


@dataclass(frozen=True)
class _Place:
    """Where a film goes: its path, and the folder, names and suffix of its frames; kind: of the video file, or None."""

    path: Path
    folder: Path
    name: str
    suffix: str
    kind: Kind | None

    def name_of(self, number):
        return self.name % number

    @classmethod
    def of(cls, path):
        """Of what a user gives, checked."""
        if not is_path(path):
            raise Error(f"film path is {shown(path)}; allowed: a file's name")
        path = Path(path)
        suffix = path.suffix.lower()
        if "%" in path.name:
            rest = PLACE.sub("", path.name, count=1)
            if rest == path.name or "%" in rest or suffix not in FRAMES:
                raise Error(f"{path}: is no name for frames; allowed: one place for a number, such as %04d, and "
                            f"{' or '.join(FRAMES)}")
            if not os.path.isdir(path.parent.parent):
                raise Error(f"{path}: there is no folder {path.parent.parent}")
            return cls(path, path.parent, path.name, suffix, None)
        if suffix in FRAMES and suffix not in KINDS:
            raise Error(f"{path}: has no place for the number of a frame; allowed: one, such as "
                        f"{path.with_name(path.stem + '-%04d' + suffix)}")
        if suffix not in KINDS:
            raise Error(f"{path}: {suffix or 'no suffix'} is not supported; allowed: {', '.join(KINDS)}, or pictures "
                        "with a place for their number, such as frames/%04d.png")
        check_writable(path, [*KINDS])
        pyav()
        return cls(path, path.with_name(path.name + ".frames"), "%06d.png", ".png", KINDS[suffix])


def _numbers(frames):
    """Numbers of frames as they are given, checked."""
    allowed = "whole numbers from 0 on, in rising order"
    try:
        numbers = [checks.whole(0, 10**6)(each, "film frames") for each in frames]
    except TypeError:   # it holds none
        checks.refuse("film frames", frames, allowed)
    if not numbers or any(one >= other for one, other in pairwise(numbers)):
        checks.refuse("film frames", frames, allowed + ", one at least")
    return numbers


def _join(place, record, numbers, fps, tell, stop):
    """Make the video of the frames, and remove these."""

    def pictures():
        for done, number in enumerate(numbers):
            tell("video", done, len(numbers))
            go_on(stop)
            yield pixels((place.folder / place.name_of(number)).read_bytes())

    steps = {other - one for one, other in pairwise(numbers)}
    write_video(place.path, pictures, fps / min(steps) if len(steps) == 1 else fps)   # it takes as long as its time
    record.remove()
