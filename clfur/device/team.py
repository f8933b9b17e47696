"""Several devices that draw one frame together: each some of the strands, merged to the same bits."""

import itertools
import time
import warnings
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait

from ..errors import DeviceError, Error

PROBE = 64   # a device whose speed is not known is timed with one of so many strands


class Team:
    """Schedulers of one frame, the one that shades first; those that fail leave it."""

    def __init__(self, gpus):
        self.gpus = list(gpus)

    def gather(self, name, draw, merges, strands, to=None):
        """What ``draw(gpu, (first, one past the last), body)`` gives for all strands and the body -> list of arrays.

        One device's arrays stay on it.  Those of several are brought to the host and merged, each by its ufunc of
        ``merges``, which must not depend on the order; None where there is none.  Devices share the strands
        in proportion to the speed at which they did ``name`` last.  What a device that fails had to do is done by the
        others; raises its `DeviceError` if there are none.  ``to``: the device that goes on with the arrays; raises
        `DeviceError` if it has been dropped and they would stay on another.
        """
        merged, todo = None, [(0, strands, True)]
        while todo:
            begin, end, body = todo.pop()
            if len(self.gpus) == 1 and merged is None and not todo:
                if to not in (None, *self.gpus):
                    raise DeviceError(f"{to.name} was lost")
                return draw(self.gpus[0], (begin, end), body)
            gpus = self.gpus[:]
            paces = self._paces(name, draw, begin, end)
            shares = [(a, b, body and not n) for n, (a, b) in enumerate(shares_of(begin, end, paces))]
            for gpu, share, result in self._together([
                    (gpu, share, draw) for gpu, share in zip(gpus, shares) if share[0] < share[1] or share[2]]):
                if isinstance(result, DeviceError):
                    self.drop(gpu, result)
                    todo.append(share)
                    continue
                arrays, seconds = result
                if share[1] > share[0]:
                    gpu.pace[name] = (share[1] - share[0]) / seconds
                merged = arrays if merged is None else [
                    one if other is None else other if one is None else merge(one, other)
                    for merge, one, other in zip(merges, merged, arrays)]
        return merged

    def first(self, do):
        """``do(gpu)`` on the first device, or on the next if that one fails."""
        while True:
            gpu = self.gpus[0]
            try:
                return do(gpu)
            except DeviceError as error:
                self.drop(gpu, error)

    def each(self, do):
        """[``do(gpu)``] of the devices that do not fail."""
        done = []
        for gpu in self.gpus[:]:
            try:
                done.append(do(gpu))
            except DeviceError as error:
                self.drop(gpu, error)
        return done

    def drop(self, gpu, error):
        """Go on without a device; raises the error if it was the last."""
        if gpu in self.gpus:
            if len(self.gpus) == 1:
                raise error
            self.gpus.remove(gpu)
            warnings.warn(f"goes on without a device: {error}", RuntimeWarning, stacklevel=2)

    def _paces(self, name, draw, begin, end):
        """Strands a second of each device; a first try builds its kernels, a second one is timed."""
        unknown = [gpu for gpu in self.gpus if name not in gpu.pace]
        probe = (begin, begin + max((end - begin) // PROBE, 1), False)
        if len(self.gpus) > 1 and end - begin >= len(self.gpus) and unknown:
            for _ in range(2):
                for gpu, _, result in self._together([(gpu, probe, draw) for gpu in unknown]):
                    if not isinstance(result, DeviceError):   # one that fails now will fail with its share
                        gpu.pace[name] = (probe[1] - probe[0]) / result[1]
        known = [gpu.pace[name] for gpu in self.gpus if name in gpu.pace]
        return [gpu.pace.get(name, min(known, default=1.0)) for gpu in self.gpus]

    def _together(self, jobs):
        """[(gpu, share, (host arrays, seconds) or DeviceError)] of (gpu, share, draw), each in a thread of its own."""
        def run(gpu, share, draw):
            began = time.perf_counter()
            try:
                arrays = [None if array is None else gpu.download(array) for array in draw(gpu, share[:2], share[2])]
            except DeviceError as error:
                return error
            return arrays, time.perf_counter() - began

        with ThreadPoolExecutor(max(len(jobs), 1)) as threads:
            futures = [threads.submit(run, *job) for job in jobs]
            try:
                done, _ = wait(futures, return_when=FIRST_EXCEPTION)
                for future in done:   # the first that was stopped stops the others
                    future.result()
            except BaseException:   # Ctrl-C too: the threads can't be interrupted, but asked
                for gpu, _, _ in jobs:
                    gpu.stop()
                raise
            return [(gpu, share, future.result()) for (gpu, share, _), future in zip(jobs, futures)]


def shares_of(begin, end, paces):
    """[(first, one past the last)] for each pace, in proportion to it, that cover begin to end once."""
    if not all(pace > 0 for pace in paces):
        raise Error(f"paces are {paces}; allowed: numbers > 0")
    edges = [begin]
    for n in range(len(paces)):
        edges.append(begin + round((end - begin) * (sum(paces[:n + 1]) / sum(paces))))
    return list(itertools.pairwise(edges))
