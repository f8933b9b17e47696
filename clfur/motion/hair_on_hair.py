"""Hair that feels the hair around it: which grid, and how strong."""

import numpy as np

from ..stages import hair_grid as stage
from .hair import STANDARD

SPACINGS = 4      # of strands that a cell is wide, at least; a segment at least too
STIFF = 2.0       # push, in weights of the longest hair: it bears this with densities some tenths above the groomed
RUB = 1.5         # friction of what is pressed: 1 makes up for a push that is a step late
PART = 0.25       # of a cell, by which a step pushes at most


class HairOnHair:
    """What strands feel of each other, from the groom on.

    seconds: in which hair takes the speed of the hair around it. state, roots: the groom on the device, as
    `stages.motion` has it. box: [2, 3], lowest and highest corner of the body. reach: of hair beyond it, and the
    longest strand [world]. units: world units a metre.
    """

    def __init__(self, gpu, seconds, state, roots, box, reach, longest, units):
        self._gpu, self._state, self._friction = gpu, state, 1 / seconds
        self._stiff, self._reach = STIFF * STANDARD * units * longest, reach
        lengths = gpu.download(state.lengths)
        points = int(np.count_nonzero(lengths))
        segment = float(lengths.max(initial=0)) or 1.0
        self._unit = stage.mass_unit(points, segment)
        self._cell = _cell(gpu.download(roots)[0, :, :state.n].T, segment, box, reach)
        grid = self._grid(box)
        self._groomed = stage.density(gpu, state, roots, grid, self._cells(roots, grid, 1.0, False))

    def felt(self, roots, box, step, ahead):
        """What points feel in the next step, of so many seconds, for `stages.motion.advance`.

        roots: where they are.  box: of the body there.  ahead: whether the last step was as long.
        """
        grid = self._grid(box)
        most = PART * self._cell / step**2
        # No faster a wave of density than half a cell a step: what is explicit stays stable.
        push = min(self._stiff, (self._cell / (2 * step)) ** 2) / self._cell
        return stage.feel(self._gpu, self._state, roots, self._groomed, grid, self._cells(roots, grid, step, ahead),
                          self._friction, push, RUB * push * step / self._cell, most)

    def _grid(self, box):
        return stage.grid_around(box[0] - self._reach, box[1] + self._reach, self._cell)

    def _cells(self, roots, grid, step, ahead):
        sums = stage.deposit(self._gpu, self._state, roots, grid, self._unit, step, ahead)
        return stage.average(self._gpu, sums, grid, self._unit, step)


def _cell(places, segment, box, reach):
    """The side of a cell [world]: a segment, some strands wide, and as many of them as there may be."""
    # Roots fill so many cells of a segment's side, from which follows how far apart they stand.
    filled = len(np.unique(np.floor((places - box[0]) / segment).astype(np.int64), axis=0)) if len(places) else 0
    cell = max(segment, SPACINGS * segment * (filled / max(len(places), 1)) ** 0.5)
    while np.prod(np.ceil((box[1] - box[0] + 2 * reach) / cell) + 2) > stage.MOST_CELLS:
        cell *= 1.05
    return cell
