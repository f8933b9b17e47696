"""Strand files .data of USC-HairSalon: int32, how many strands; then of each int32, how many points, and float32
[points, 3]; little-endian.  The root comes first; a strand of one point is a root without hair.  No widths or colours;
metres, +Y up, as its authors' model of a head."""

from pathlib import Path

import numpy as np

from ..errors import Error
from .fields import array


def read_usc(data: bytes, path: Path) -> dict:
    """Return the strands of a USC-HairSalon file: points and counts."""
    head, _ = array(data, 0, "<i4", (1,), "count of strands")
    strands = int(head[0])
    if not 0 <= strands <= len(data) // 4 - 1:   # each takes four bytes at least
        raise Error(f"is damaged or cut short: it states {strands} strands, but has {len(data)} bytes")
    counts, words, word = np.empty(strands, np.int64), np.frombuffer(data, "<i4", len(data) // 4), 1
    for strand in range(strands):
        count = int(words[word]) if word < len(words) else -1
        if not 0 <= count <= (len(words) - word - 1) // 3:
            raise Error(f"is damaged or cut short: strand {strand} of {strands} states {count} points")
        counts[strand], word = count, word + 1 + 3 * count
    if 4 * word != len(data):
        raise Error(f"has {len(data) - 4 * word} bytes more than its strands take")
    numbers = np.frombuffer(data, "<f4", word)
    stated = 1 + np.cumsum(1 + 3 * counts) - (1 + 3 * counts)   # where each strand states its count
    keep = np.ones(word, bool)
    keep[0] = False
    keep[stated] = False
    return {"points": numbers[keep].reshape(-1, 3), "counts": counts}


def write_usc(strands: dict) -> bytes:
    """Return the bytes of a USC-HairSalon file of strands, as `curves.stored` gives them; without width and colour."""
    counts = strands["counts"]
    at = np.cumsum(1 + 3 * counts) - (1 + 3 * counts)
    words = np.empty(int(len(counts) + 3 * counts.sum()), "<i4")
    rest = np.ones(len(words), bool)
    rest[at] = False
    words[at] = counts
    words[rest] = strands["points"].astype("<f4").ravel().view("<i4")
    return np.array([len(counts)], "<i4").tobytes() + words.tobytes()
