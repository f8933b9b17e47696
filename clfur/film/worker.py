"""What a cluster's workers do: all that runs there is in this file, and drawing."""

import os
import pickle
import threading
import time
import warnings
from typing import Any

from ..device.scheduler import Scheduler, sources
from ..errors import Error
from ..judge import selftest
from .parcels import unpack

SHARE = "CLFUR_SHARE"   # variable: how many workers have the device of this one
KEPT = 4                # films, or pictures, whose parts are kept

_busy = threading.Lock()   # a worker that has more threads draws one job at a time all the same
_device: list[Scheduler] = []
_parts: dict[str, dict[str, Any]] = {}


def greet(expected: str, name: str, parts: dict[str, bytes]) -> tuple[str, float]:
    """Make this worker ready for the jobs of a name -> (why it cannot do them, or "", seconds that it took).

    expected: what `sources` gives where the jobs come from: another clfur might draw other bits. parts: of `Parcels`.
    """
    began = time.perf_counter()
    with _busy:
        try:
            if expected != sources():
                return "it has another version of clfur, or another state of its files", 0.0
            if not _device:
                gpu = _scheduler()
                wrong, _ = selftest.check(gpu)
                if wrong:
                    return f"its device, {gpu.name}, fails the self-test: {wrong}", 0.0
                _device.append(gpu)
            for old in [*_parts][:len(_parts) - KEPT + 1]:
                del _parts[old]
            _parts[name] = {token: pickle.loads(part) for token, part in parts.items()}
        except Error as error:
            return str(error), 0.0
    return "", time.perf_counter() - began


def work(name: str, data: bytes) -> tuple[str, Any, list[str]]:
    """Draw a job -> ("done", what its ``draw`` gives, warnings), ("error", why it cannot be drawn, warnings), or
    ("unknown", None, []) if this process was not greeted for jobs of that name, as one that was started anew."""
    with _busy, warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", RuntimeWarning)
        if not _device or name not in _parts:
            return "unknown", None, []
        try:
            kind, value = "done", unpack(data, _parts[name]).draw(_device[0])
        except Error as error:
            kind, value = "error", str(error)
        except MemoryError:
            kind, value = "error", "out of memory"
        return kind, value, [str(each.message) for each in said if each.category is RuntimeWarning]


def _scheduler():
    """The device of this worker, with its share of the memory."""
    gpu, share = Scheduler(), int(os.environ.get(SHARE, "1"))
    return gpu if share == 1 else Scheduler(gpu.device, max(gpu.memory // share, 1))
