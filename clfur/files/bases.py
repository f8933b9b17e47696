"""Cubic curves -> polylines, as fine as a tolerance asks: Bezier, B-spline and Catmull-Rom curves of USD.

A segment of any basis becomes one of Bezier's, whose second differences tell how many chords keep within a distance:
a chord of 1/n of a segment is off by at most max |P''| / 8 n^2, and |P''| <= 6 max |second difference|.
"""

from typing import NamedTuple

import numpy as np

TO_BEZIER = {
    "bezier": np.eye(4),
    "bspline": np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6,
    "catmullRom": np.array([[0, 6, 0, 0], [-1, 6, 1, 0], [0, 1, 6, -1], [0, 0, 6, 0]]) / 6,
}
MOST = 256   # chords of a segment


def unrolled(values: np.ndarray, counts: np.ndarray, basis: str, wrap: str) -> tuple[np.ndarray, np.ndarray]:
    """Return control values [total, k] and counts of the same curves as if all were "nonperiodic".

    A periodic curve gets its first values again at its end; a pinned one 2 a - b before its first value a and the next,
    b, and likewise behind its last (USD, UsdGeomBasisCurves). One that has too few points for it gets none.
    """
    again = {"linear": 1, "bezier": 1}.get(basis, 3) if wrap == "periodic" else 0
    pinned = wrap == "pinned" and basis in ("bspline", "catmullRom")
    if not again and not pinned:
        return values, counts
    few = counts < (2 if pinned else again)
    first, more = np.cumsum(counts) - counts, np.where(few, 0, counts + (again or 2))
    of, start = np.repeat(np.arange(len(counts)), more), np.cumsum(more) - more
    step = np.arange(int(more.sum())) - start[of]
    if again:
        return values[first[of] + step % counts[of]], more
    inner = np.clip(step - 1, 0, counts[of] - 1)
    out = values[first[of] + inner]
    first, start, end = first[~few], start[~few], (start + more - 1)[~few]
    last = first + counts[~few] - 1
    out[start] = 2 * values[first] - values[first + 1]
    out[end] = 2 * values[last] - values[last - 1]
    return out, more


def segments_of(counts: np.ndarray, basis: str) -> np.ndarray:
    """Return how many segments each nonperiodic curve of so many control points has, int64 [curves]."""
    if basis == "linear":
        return np.maximum(counts - 1, 0)
    return np.maximum((counts - 1) // 3 if basis == "bezier" else counts - 3, 0)


def misfit(counts: np.ndarray, basis: str, wrap: str) -> str:
    """Return which curve of so many points is the first that USD does not allow, in words; "" where there is none."""
    periodic = wrap == "periodic"
    if basis == "bezier":
        wrong = (counts < 3) | (counts % 3 != 0) if periodic else (counts < 4) | ((counts - 1) % 3 != 0)
        allowed = "3, 6, 9, ..." if periodic else "4, 7, 10, ..."
    else:
        fewest = 1 if basis == "linear" else {"periodic": 3, "pinned": 2}.get(wrap, 4)
        wrong, allowed = counts < fewest, f"{fewest} or more"
    if not wrong.any():
        return ""
    return f"curve {int(wrong.argmax())} has {counts[wrong.argmax()]} points; allowed: {allowed} for {wrap} {basis}"


class Chords(NamedTuple):
    """Points of polylines along nonperiodic curves."""

    counts: np.ndarray    # int64 [curves]
    of: np.ndarray        # int64 [total], the curve of each
    where: np.ndarray     # float64 [total], at which of its curve's segments: 1.25 is a quarter into the second
    rows: np.ndarray      # int64 [total, 1 or 4], control points
    weights: np.ndarray   # float64 [total, 1 or 4], theirs

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Values of control points, [controls, k], at the points."""
        return sum(values[self.rows[:, k]] * self.weights[:, k, None] for k in range(self.rows.shape[1]))


def chords_of(places: np.ndarray, counts: np.ndarray, basis: str, distance: np.ndarray) -> Chords:
    """Return the points of polylines that keep within a distance, float64 [curves], of nonperiodic curves.

    places: float64 [sum of counts, 3], the control points.
    """
    segments, first = segments_of(counts, basis), np.cumsum(counts) - counts
    if basis == "linear":
        of, rows = np.repeat(np.arange(len(counts)), counts), np.arange(len(places))
        return Chords(counts, of, rows - first[of], rows[:, None], np.ones((len(rows), 1)))
    curve = np.repeat(np.arange(len(counts)), segments)
    number = np.arange(len(curve)) - (np.cumsum(segments) - segments)[curve]
    rows = (first[curve] + number * (3 if basis == "bezier" else 1))[:, None] + np.arange(4)
    control = np.einsum("ij,sjk->sik", TO_BEZIER[basis], places[rows])
    bend = np.linalg.norm(np.diff(control, 2, axis=1), axis=2).max(axis=1, initial=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        chords = np.ceil(np.sqrt(0.75 * bend / distance[curve]))
    chords = np.clip(np.nan_to_num(chords, nan=1, posinf=MOST), 1, MOST).astype(np.int64)
    points = chords + (number == segments[curve] - 1)   # the last one's end is a point too
    of = np.repeat(np.arange(len(curve)), points)
    t = (np.arange(len(of)) - (np.cumsum(points) - points)[of]) / chords[of]
    weights = np.stack([(1 - t)**3, 3 * (1 - t)**2 * t, 3 * (1 - t) * t**2, t**3], axis=1) @ TO_BEZIER[basis]
    total = np.bincount(curve, points, len(counts)).astype(np.int64)
    return Chords(total, curve[of], number[of] + t, rows[of], weights)
