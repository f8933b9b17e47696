"""Whose light a pixel's is: shares of strands, types, body and ground, added up on the host in integers.

A piece of a strand takes a share of a pixel's light: in steps of UNIT, so that sums are the same whatever parts, bands
and devices it was drawn in.
"""

from typing import Any

import numpy as np

from .. import layout
from ..scene import Camera, Curves

RANKS = 6         # of a matte: who covers most of a pixel, and the next ones
UNIT = 2.0**28    # steps of a share, and of the cosine or sine of an angle; sums of both over a pixel are below 2**53,
TURN = 2.0**20    # and so exact in float64
NOTHING, *OTHERS = (int(layout.CONSTANTS[f"ID_{name}"]) for name in ("NOTHING", "BODY", "SHELLS", "GROUND"))

# Outputs that are told of pieces, and how many values of a pixel; 0: of a strand.
TOLD = {"hair_alpha": 1, "body_alpha": 1, "type": 1, "type_alpha": 1, "orientation": 2, "matte_id": RANKS,
        "matte_alpha": RANKS, "strand_area": 0}


class Told:
    """What is told of the pixels of some rows, so far.

    rows: (first, one past the last) that are drawn.
    """

    def __init__(self, plan: Any, rows: tuple) -> None:
        fur = plan.scene.strands
        types = 0 if fur is None else len(fur.hair_types if isinstance(fur, Curves) else fur.types)
        types *= bool({"type", "type_alpha"} & set(plan.tells))
        self.names, self.rows, self.width = plan.tells, rows[1] - rows[0], plan.size[0]
        self.shells, self.types = plan.scene.shells is not None, types
        self.wanted = np.zeros((self.rows, self.width), bool)   # the others are drawn for tiles and blurs
        self.wanted[plan.wanted(rows[0])] = True
        pixels, matte = self.rows * self.width, bool({"matte_id", "matte_alpha"} & set(self.names))
        self.strands = np.zeros(pixels)                   # of a pixel: share of all strands,
        self.of_types = np.zeros((pixels, types))         # of each type's
        # Twice the angle: cosine and sine of all, weighted.
        self.turns = np.zeros((pixels if "orientation" in self.names else 0, 2))
        self.areas = np.zeros(plan.strands)
        self.ids = np.full((pixels, RANKS if matte else 0), NOTHING, np.int32)
        self.ranks = np.zeros(self.ids.shape)             # of those who cover most
        self._held: list[tuple] = []

    def add(self, pixels: np.ndarray, owners: np.ndarray, turns: np.ndarray, weights: np.ndarray) -> None:
        """Pieces: [n] int64 pixel, [n, 2] uint32 strand and type, [n, 2] float32 cosine and sine of twice the angle,
        [n] float32 share of the pixel.  All of a pixel's come before `flush`."""
        self._held.append((pixels, owners.astype(np.int64), turns, weights))

    def flush(self) -> None:
        """Add up what came."""
        if not self._held:
            return
        pixels, owners, turns, weights = (np.concatenate(each) for each in zip(*self._held))
        self._held = []
        if not len(pixels):
            return
        first, end = int(pixels.min()), int(pixels.max()) + 1
        here, n = pixels - first, end - first
        units = np.rint(weights.astype(np.float64) * UNIT)
        strand, kind = owners.T
        self.strands[first:end] += np.bincount(here, units, n)
        if self.types:
            self.of_types[first:end] += np.bincount(here * self.types + kind, units, n * self.types).reshape(n, -1)
        if "orientation" in self.names:
            for k in range(2):
                self.turns[first:end, k] += np.bincount(here, units * np.rint(turns[:, k] * TURN), n)
        if "strand_area" in self.names:
            self.areas += np.bincount(strand, units * self.wanted.ravel()[pixels], len(self.areas))
        if self.ids.size:
            pixels, strand, sums = _ranked(pixels, strand, units)
            rank = np.arange(len(pixels)) - np.searchsorted(pixels, pixels)
            few = rank < RANKS
            self.ids[pixels[few], rank[few]], self.ranks[pixels[few], rank[few]] = strand[few], sums[few]

    def images(self, body: np.ndarray, ground: np.ndarray, shells: np.ndarray | None) -> dict[str, np.ndarray]:
        """{output: array} of these rows, ``strand_area`` in UNIT: with the shares [rows, width] of the body, the ground
        and shells, None where there are none."""
        body, ground = (np.rint(np.asarray(each, np.float64).ravel() * UNIT) for each in (body, ground))
        fur = np.zeros_like(body) if shells is None else np.rint(np.asarray(shells, np.float64).ravel() * UNIT)
        of_types = np.c_[self.of_types, fur] if self.shells else self.of_types   # none where they are not asked for
        hair = self.strands + fur
        made = {"hair_alpha": hair / UNIT, "body_alpha": body / UNIT, "type_alpha": of_types / UNIT,
                "orientation": self.turns / (UNIT * TURN)}
        if "type" in self.names:
            kinds = of_types.argmax(1) if of_types.shape[1] else np.zeros(len(hair), np.int64)
            made["type"] = np.where(hair > 0, kinds, -1).astype(np.int32)
        if self.ids.size:
            others = np.broadcast_to(np.array(OTHERS, np.int32), (len(hair), 3))
            ids, ranks = np.c_[self.ids, others], np.c_[self.ranks, body, fur, ground]
            ids = np.where(ranks > 0, ids, NOTHING)
            order = np.lexsort((ids, -ranks))[:, :RANKS]
            made["matte_id"] = np.take_along_axis(ids, order, 1)
            made["matte_alpha"] = np.take_along_axis(ranks, order, 1) / UNIT
        images = {name: _image(made[name], self.rows, self.width) for name in self.names if name in made}
        return images | ({"strand_area": self.areas} if "strand_area" in self.names else {})


def positions(camera: Camera, depth: np.ndarray, left: int, top: int) -> np.ndarray:
    """Places of the world that are seen, on the rays through the pixels' middles: float32 [rows, width, 3].

    depth: [rows, width] along the view axis, of columns ``left`` on and rows ``top`` on; infinite where nothing is: so
    is the place.
    """
    (fx, skew, cx), (_, fy, cy), _ = camera.intrinsics
    rows, columns = np.mgrid[top:top + depth.shape[0], left:left + depth.shape[1]] + 0.5
    seen = np.isfinite(depth)
    far = np.where(seen, depth, 1).astype(np.float64)
    y = (cy - rows) / fy * far
    x = ((columns - cx) * far + skew * y) / fx
    found = np.stack([x, y, -far], 2) @ camera.pose[:3, :3].T + camera.pose[:3, 3]
    return np.where(seen[:, :, None], found, np.inf).astype(np.float32)


def _ranked(pixels, strands, units):
    """(pixel, strand, sum), a row of each pair that has pieces, by pixel and the largest first."""
    order = np.argsort(pixels << 32 | strands)   # pixels are fewer than 2**31
    pixels, strands, units = pixels[order], strands[order], units[order]
    begins = np.flatnonzero(np.r_[True, (pixels[1:] != pixels[:-1]) | (strands[1:] != strands[:-1])])
    pixels, strands, sums = pixels[begins], strands[begins], np.add.reduceat(units, begins)
    # Sums are about UNIT at most: in 30 bits below the pixel; of equal ones the lower strand is first as it is.
    order = np.argsort(pixels << 30 | (2**30 - 1 - sums.astype(np.int64)), kind="stable")
    return pixels[order], strands[order], sums[order]


def _image(array, rows, width):
    array = array if array.dtype.kind == "i" else array.astype(np.float32)
    return np.ascontiguousarray(array.reshape(rows, width, *array.shape[1:]))
