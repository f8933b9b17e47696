"""What readers of strand files share: arrays, checked before memory is taken, and a width where there is none."""

import numpy as np

from ..errors import Error

WIDTH = 0.0012   # of hair whose file says none, in halves of the diagonal of all of it: as `clfur render` has it


def array(data: bytes, at: int, kind: str, shape: tuple, what: str) -> tuple[np.ndarray, int]:
    """Return the array of this dtype and shape that begins at a byte of a file, and the byte behind it.

    Raises Error, which names what it is, where the file has fewer bytes.
    """
    size = np.dtype(kind).itemsize
    for count in shape:
        size *= int(count)   # Python's integers: a header may claim more than 2**64 bytes
    if size > len(data) - at or at < 0:
        raise Error(f"is damaged or cut short: {size} bytes of {what} from byte {at} on, but it has {len(data)}")
    return np.frombuffer(data, kind, int(np.prod(shape, dtype=np.int64)), at).reshape(shape), at + size



def usual_width(points: np.ndarray) -> float:
    """Return how wide hair is drawn whose file says nothing of it. points: [..., 3]."""
    places = points.reshape(-1, 3)
    places = places[np.isfinite(places).all(axis=1)]   # Curves refuses the others
    return WIDTH / 2 * float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) else 0.0
