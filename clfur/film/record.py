"""The folder of a film's frames: which are there, of which film, and from where its motion can go on."""

import contextlib
import io
import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil

from ..errors import Error
from ..files.output import reason

NAME = "film.json"
STRAY = re.compile(r"\..+\.(\d+)\.tmp")
STATE = re.compile(r"motion-(\d+)\.npz")
STATES = 2   # of the motion that are kept


def frames_in(folder: Path, name_of: Callable[[int], str]) -> list[Path]:
    """Return the files in a folder, in order, that are named as a frame is; name_of: number -> name."""
    return [path for path in sorted(folder.iterdir()) if any(
        path.name == name_of(int(number)) for number in re.findall(r"\d{1,9}", path.name))]


class Record:
    """A folder of frames.

    folder: that is there, or beside which others are. name_of: gives the name of a frame's file. about: {what: text}
    of all that frames of one film share. overwrite: whether frames of another film go. `scenes` is {number: hash of
    what it shows} of the frames that are there, whole. Raises Error for a folder that cannot be written, and for one
    of another film.
    """

    def __init__(self, folder: Path, name_of: Callable[[int], str], about: dict[str, str], overwrite: bool) -> None:
        self.folder, self.name_of, self.about = folder, name_of, about
        self.scenes: dict[int, str] = {}
        self._overwrite = overwrite
        with self._told():
            self._ours = not folder.exists() or (folder / NAME).exists()
            folder.mkdir(exist_ok=True)
            self._sweep()
            self._compare(*self._read())
            self._begin()

    def check(self, number: int, scene: str) -> bool:
        """Whether a frame is there that shows a scene of this hash; one that shows another is an Error, or goes."""
        if number not in self.scenes:
            return False
        if self.scenes[number] != scene:
            if not self._overwrite:
                raise self._another(f"frame {number} shows another scene")
            del self.scenes[number]
            return False
        return True

    def put(self, number: int, data: bytes, scene: str) -> None:
        """Write a frame's file, whole or not at all."""
        with self._told():
            self._write(self.name_of(number), data)
            with open(self.folder / NAME, "a", encoding="utf-8") as file:
                file.write(self._line(number, scene, len(data)))
        self.scenes[number] = scene

    def put_state(self, number: int, state: dict, scenes: str) -> None:
        """Write the state of the motion at a frame; scenes: a hash of those up to it."""
        file = io.BytesIO()
        np.savez(file, scenes=scenes, **state)
        with self._told():
            self._write(f"motion-{number:06}.npz", file.getbuffer())
            for _, old in sorted(self._states())[:-STATES]:
                old.unlink(missing_ok=True)

    def state(self, last: int, scenes_of: Callable[[int], str]) -> tuple[int, dict] | None:
        """(frame, state) of the motion that is kept, the latest up to a frame, after the same scenes; or None."""
        for number, path in sorted(self._states(), reverse=True):
            with contextlib.suppress(Exception):   # what is damaged can fail in any way, and is none
                if number <= last:
                    with np.load(path) as file:
                        state = dict(file)
                    if str(state.pop("scenes")) == scenes_of(number):
                        return number, state
        return None

    def forget_states(self) -> None:
        """Remove the states of the motion: nothing goes on from there."""
        with self._told():
            for _, path in self._states():
                path.unlink(missing_ok=True)

    def remove(self) -> None:
        """Remove all that has been written, and the folder, if it was made for this."""
        self.forget_states()
        with self._told():
            for number in self.scenes:
                (self.folder / self.name_of(number)).unlink(missing_ok=True)
            (self.folder / NAME).unlink(missing_ok=True)
            if self._ours:
                with contextlib.suppress(OSError):   # somebody else has put something there
                    self.folder.rmdir()

    def _compare(self, about, frames):
        """Take the frames that are there, if they are of this film."""
        there = [frame for frame in frames if self._is_there(frame)]
        if about is None:
            if self._overwrite or not (name := self._foreign()):
                return
            raise self._another(f"{name}, and no {NAME} that tells whose it is")
        differ = [what for what in {**about, **self.about} if about.get(what) != self.about.get(what)]
        if differ and not self._overwrite:
            raise self._another(f"they differ in {', '.join(differ)}")
        if differ:
            for frame in there:
                (self.folder / frame["name"]).unlink(missing_ok=True)
            self.forget_states()
        else:
            self.scenes = {frame["frame"]: frame["scene"] for frame in there}

    def _another(self, what):
        return Error(f"{self.folder} holds another film's frames: {what}; allowed: another folder, or overwriting them "
                     "(overwrite=True, --overwrite)")

    def _foreign(self):
        """The name of a file that frames of this film may replace, or None."""
        return next((path.name for path in frames_in(self.folder, self.name_of)), None)

    def _is_there(self, frame):
        path = self.folder / frame["name"]
        return path.is_file() and path.stat().st_size == frame["bytes"]

    def _read(self):
        """({what: text} of the film, [what is told of each frame]) of the record; (None, []) if there is none."""
        about, frames = None, {}
        with contextlib.suppress(FileNotFoundError), open(self.folder / NAME, encoding="utf-8") as file:
            for line in file:
                with contextlib.suppress(ValueError):   # the last may be cut off
                    told = json.loads(line)
                    if "film" in told:
                        about = told["film"]
                    else:
                        frames[told["frame"]] = told
        return about, list(frames.values())

    def _begin(self):
        """Write the record anew, of the frames that count."""
        lines = [json.dumps({"film": self.about}) + "\n"]
        lines += [self._line(number, scene, (self.folder / self.name_of(number)).stat().st_size)
                  for number, scene in sorted(self.scenes.items())]
        self._write(NAME, "".join(lines).encode())

    def _line(self, number, scene, size):
        return json.dumps({"frame": number, "name": self.name_of(number), "scene": scene, "bytes": size}) + "\n"

    def _states(self):
        """(frame, path) of each state of the motion that is kept."""
        for path in list(self.folder.iterdir()):
            if found := STATE.fullmatch(path.name):
                yield int(found[1]), path

    def _sweep(self):
        """Remove what processes that are gone had begun to write."""
        for path in list(self.folder.iterdir()):
            if (found := STRAY.fullmatch(path.name)) and not psutil.pid_exists(int(found[1])):
                path.unlink(missing_ok=True)

    def _write(self, name, data):
        temporary = self.folder / f".{name}.{os.getpid()}.tmp"
        try:
            with open(temporary, "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, self.folder / name)
        finally:
            temporary.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        """Make one readable error of what the system raises."""
        try:
            yield
        except OSError as error:
            raise Error(f"{self.folder}: cannot be written: {reason(error)}") from error
