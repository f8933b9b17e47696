"""Windows that look at a document: the camera of each, and what it has been shown."""

import math
import time
from collections.abc import Callable
from typing import Any

from ..errors import Error
from ..scene import Camera, Scene
from .orbit import Orbit

AHEAD = 2              # pictures under way to a page at most: one that it has not told to be drawn, and the next
REST = 0.1             # seconds without a change after which the final picture is drawn
PIXELS = 8_000_000     # of a picture at most: a larger window's are scaled up by the page
MOST = 64              # windows whose cameras are remembered


class Link:
    """A page that is there: send(header, bytes) brings it a picture, tell(header) a line."""

    def __init__(self, send: Callable[[dict, bytes], None], tell: Callable[[dict], None]) -> None:
        self.send, self.tell = send, tell
        self.under_way, self.hidden = 0, False


class Window:
    """One page's camera, which stays while the page is loaded anew; `Windows` guards it by its lock.

    key: its name. gesture: number of the last message of the page that is in its camera. changed: when its camera
    was. shown: (what the last picture is of, whether it is the final one). told: what its last final picture took.
    """

    def __init__(self, key: str, scene: Scene) -> None:
        self.key, self.home = key, scene.camera
        self.orbit = Orbit.of(scene)
        self.link: Link | None = None
        self.gesture = self.pictures = 0
        self.changed, self.shown, self.sized = time.monotonic(), (None, False), False
        self.told = ""

    @property
    def camera(self) -> Camera:
        """The camera that it looks with."""
        return self.orbit.camera()

    def look_like(self, other: "Window") -> None:
        """Take over another's camera."""
        self.home, self.orbit, self.sized = other.home, other.orbit, other.sized

    def go_home(self, scene: Scene) -> None:
        """Look as the scene's own camera does."""
        self.home, self.orbit = scene.camera, Orbit.of(scene, self.orbit.size)

    def takes(self, message: dict[str, Any], scene: Scene) -> None:
        """Go where a page's message says: {"n": its number, "size", "turn", "pan", "zoom", "home"}, of which all but n
        may be missing. Raises Error where it is no such message."""
        before = self.orbit
        try:
            if "size" in message:
                self.orbit = self.orbit.resized(_size(*message["size"]))
                if not self.sized:
                    self.go_home(scene)
                self.sized = True
            if message.get("home"):
                self.go_home(scene)
            if "turn" in message:
                self.orbit = self.orbit.turned(*_numbers(2, message["turn"]))
            if "pan" in message:
                self.orbit = self.orbit.panned(*_numbers(2, message["pan"]))
            if "zoom" in message:
                self.orbit = self.orbit.zoomed(*_numbers(1, [message["zoom"]]))
            self.gesture = int(message.get("n", self.gesture))
        except (TypeError, ValueError, OverflowError) as error:
            raise Error(f"a page's message {str(message)[:60]} is none: {error}") from None
        if self.orbit != before:
            self.changed = time.monotonic()


def _numbers(count, values):
    """So many floats, each no more than a hundred pictures away."""
    values = [float(each) for each in values]
    if len(values) != count or not all(math.isfinite(each) and abs(each) <= 100 for each in values):
        raise ValueError("numbers from -100 to 100 are allowed")
    return values


def _size(width, height):
    """(width, height) of a picture in a window of so many pixels."""
    width, height = max(float(width), 1.0), max(float(height), 1.0)
    smaller = min(1.0, math.sqrt(PIXELS / (width * height)), 16384 / width, 16384 / height)
    return max(int(width * smaller), 1), max(int(height * smaller), 1)
