"""Strands -> as few and as simple ones as a view needs."""

from dataclasses import replace
from typing import Any

import numpy as np

from .strands import DeviceStrands, arrays, go_through

THINNED = "points", "spans"   # arrays that are made anew, and colors where each point has one


def thin(gpu: Any, strands: DeviceStrands, view: np.void, lod: float, seed: int = 0,
         by_place: bool = False) -> DeviceStrands:
    """`DeviceStrands` without detail finer than ``lod`` > 0 pixels of a `layout.View` -> `DeviceStrands`.

    A strand that would be p < lod pixels wide, at its root's width and where the nearer of its ends is, belongs to
    those of which the share k = max(p / lod, 1/8) is kept.  It goes if its place in a fixed random order, which
    ``seed`` and its number give, is above 1.5 k.  With ``by_place`` where its ends are stands for its number and the
    width of its wider end counts: neither its number nor which end is its root changes what stays.  What stays is up
    to 0.8 / k times as wide, but narrower from place k on, so that nothing pops up; on average all widths together
    remain.  Strands without width, and those that do not have both ends before the eye, stay as they are.
    Then points are left out that are within lod / 4 pixels of the line that replaces them, as large as a world unit
    is at its nearer end, by place and by half the width; colours there may be wrong by 1/32.  A line stands for 16
    segments at most, and for no more than a quarter of its strand's: light changes also along straight strands.
    Arrays that do not change are shared.
    """
    per_point = strands.color_per == 2
    thinned = replace(strands, **{name: DeviceStrands.declared[name].empty(gpu, len(getattr(strands, name)))
                                  for name in (*THINNED, *["colors"] * per_point)})
    go_through(gpu, "lod.thin", strands, 1, view=view, lod=lod, seed=seed, by_place=by_place,
               out_points=thinned.points, out_spans=thinned.spans,
               out_colors=thinned.colors if per_point else gpu.empty((0, 4), np.float32),
               **arrays(strands, "first_strand", "points", "spans", "numbers", "colors", "color_per"))
    return thinned
