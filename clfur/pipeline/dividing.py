"""How what does not fit is divided: bytes among what needs them, and a row of things into runs."""

from typing import Any

import numpy as np


def share(room: int, need: dict[str, int]) -> dict[str, int]:
    """Divide bytes among what needs them: all get the same, those that need less leave theirs to the others."""
    given = {}
    for left, name in zip(range(len(need), 0, -1), sorted(need, key=need.__getitem__)):
        given[name] = max(min(need[name], room // left), 0)
        room -= given[name]
    return given


def before(counts: Any) -> np.ndarray:
    """Running sums: what lies before each, and all."""
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])


def pieces(begin: int, end: int, most: int) -> list[tuple[int, int]]:
    """[(first, one past the last)] of at most so many each."""
    return [(at, min(at + most, end)) for at in range(begin, end, most)]


def runs(*limits: tuple[Any, Any]) -> list[tuple[int, int]]:
    """[(first, one past the last)], each of at least one, in which no running sum grows by more than its limit."""
    found, at, n = [], 0, len(limits[0][0]) - 1
    while at < n:
        end = min(int(np.searchsorted(sums, sums[at] + limit, "right")) - 1 for sums, limit in limits)
        found.append((at, max(end, at + 1)))
        at = found[-1][1]
    return found
