"""Jobs for clusters: they do what a test needs, in the place of drawing a frame, and are found by workers."""

import os
import time
from pathlib import Path

import attrs
import numpy as np

from clfur.errors import Error


@attrs.frozen(eq=False)
class Counted:
    """Gives its number as bytes, and leaves a file that says which process did it."""

    number: int
    folder: str
    points: np.ndarray = attrs.field(factory=lambda: np.zeros(3))

    def draw(self, device):
        Path(self.folder, f"{self.number}-{os.getpid()}").touch()
        return f"{self.number} {self.points.sum()}".encode()


class Killer(Counted):
    """Ends its process each time that it is drawn."""

    def draw(self, device):
        super().draw(device)
        os._exit(1)


class Once(Counted):
    """Ends its process the first time."""

    def draw(self, device):
        first = not list(Path(self.folder).glob(f"{self.number}-*"))
        value = super().draw(device)
        if first:
            os._exit(1)
        return value


class Wrong(Counted):
    """Cannot be drawn."""

    def draw(self, device):
        raise Error("it is too large")


class Slow(Counted):
    """Is under way for a minute."""

    def draw(self, device):
        super().draw(device)
        time.sleep(60)
        return b""
