"""Strands -> what is seen of them, where their pieces hide each other patch by patch of a pixel."""

from typing import Any

from . import coverage


def cover(gpu: Any, view: Any, visible: Any, segments: Any, covered: Any, **known: Any) -> Any:
    """`coverage.cover` with its arguments, but pieces of one pixel hide each other in each of 4x4 patches of it by the
    area that they have there; only within a patch are they taken to lie at random.  Each is lit at two places of what
    is seen of it."""
    return coverage.cover(gpu, view, visible, segments, covered, kernels="masks", **known)
