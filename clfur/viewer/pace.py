"""How large and how fine pictures are while something moves, by how long the last ones took."""

import statistics
from collections import deque

import attrs

from ..settings import Settings

GOAL = 1 / 20     # seconds that a moving picture may take to be drawn: coding and the page need a share
SLACK = 1.25      # times that it may take more, so that one that is all but right stays
LAST = 3          # pictures whose median counts
PATIENCE = 12     # pictures before a dearer way is tried; each trial that fails makes it as many times as
IMPATIENCE = 4    # this longer
FASTER = 2.5      # times, about, that a way costs less than the one before
FIRST = 2         # the way that is tried first: samples, of half the size


def ways(settings: Settings) -> list[tuple[Settings, int]]:
    """[(Settings, by what to divide the picture's sides)] for a moving picture, from the nearest to the final one.

    Of none do shadows depend on the camera, so that they are kept from one picture to the next.  With scattering hair
    is lit by other hair, which the raster "samples" cannot do.
    """
    still = attrs.evolve(settings, lod=0, masks=0, blur="off", max_error=None, seconds=None,
                         shadows=settings.method)
    raster = "samples" if settings.scattering == "off" else settings.raster
    fine, fast = (attrs.evolve(still, raster=raster, samples=min(n, settings.samples)) for n in (4, 1))
    return [(still, 1), (fine, 1), (fine, 2), (fast, 2)]


class Pace:
    """Which of some ways to go: `took` tells how long the last picture did, `step` is the number of the way."""

    def __init__(self, steps: int, first: int = FIRST) -> None:
        self.steps, self.step = steps, min(first, steps - 1)
        self._times: deque[float] = deque(maxlen=LAST)
        self._since, self._patience = 0, PATIENCE
        self._tried = False   # whether the way is one that was just tried

    def took(self, seconds: float) -> None:
        """A picture took so many seconds."""
        self._times.append(seconds)
        self._since += 1
        if len(self._times) < LAST:
            return
        median = statistics.median(self._times)
        if median > SLACK * GOAL and self.step + 1 < self.steps:
            if self._tried:
                self._patience *= IMPATIENCE
            self._go(self.step + 1, False)
        elif self.step and median * FASTER < GOAL and self._since >= self._patience:
            self._go(self.step - 1, True)
        elif self._tried and self._since > LAST:   # it was right
            self._tried, self._patience = False, PATIENCE

    def _go(self, step, tried):
        self.step, self._tried, self._since = step, tried, 0
        self._times.clear()
