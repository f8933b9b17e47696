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
FIRST = -2        # the way that is tried first: the last but one


def ways(settings: Settings, shells: bool = False) -> list[tuple[Settings, int]]:
    """[(Settings, by what to divide the picture's sides)] for a moving picture, from the nearest to the final one.

    No two are the same.  All share grids and maps of shadows, which are kept while the same part of the scene is seen;
    where lod thins strands, those that are left look into them anew in each picture.  The raster "samples" draws
    strands at least 1/samples of a pixel wide: in smaller pictures so much wider that their bright tips hide all else,
    unless lod makes them as much fewer.  Of shells each sample costs, and there are holes where strands are fewer; with
    scattering hair is lit by other hair, which that raster cannot do: there coverage of smaller pictures takes its
    place.
    """
    still = attrs.evolve(settings, masks=0, blur="off", max_error=None, seconds=None, shadows=settings.method)

    def way(divided, raster, samples, lod):
        return attrs.evolve(still, raster=raster, samples=samples, lod=max(lod, still.lod)), divided
    if settings.raster == "samples":
        n, fewer = min(4, settings.samples), 1 if settings.samples == 1 else 2   # of 1 sample it is bright itself
        all_ways = [way(1, "samples", n, 0), way(2, "samples", n, 1), way(3, "samples", n, fewer)]
    elif shells or settings.scattering != "off":
        all_ways = [way(1, "coverage", 1, 0), way(2, "coverage", 1, 0), way(3, "coverage", 1, 1),
                    way(4, "coverage", 1, 2)]
    else:
        all_ways = [way(1, "coverage", 1, 0), way(2, "coverage", 1, 0), way(2, "samples", 4, 1),
                    way(3, "samples", 4, 2)]
    return list(dict.fromkeys([(still, 1), *all_ways]))   # the final one may have one sample, too


class Pace:
    """Which of some ways to go: `took` tells how long the last picture did, `step` is the number of the way."""

    def __init__(self, steps: int, first: int = FIRST) -> None:
        self.steps, self.step = steps, first % steps
        self._times: deque[float] = deque(maxlen=LAST)
        self._since, self._patience = 0, PATIENCE
        self._tried = False   # whether the way is one that was just tried

    def of(self, ways: list[tuple[Settings, int]]) -> tuple[Settings, int]:
        """The one to go of these ways; where they are more or fewer than before, as far from the last one."""
        self.step, self.steps = max(self.step + len(ways) - self.steps, 0), len(ways)
        return ways[self.step]

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
