"""OpenCL devices: which one, its drivers, buffers, programs and launches, and several for one frame.  Knows no fur."""

from .selection import choose, find

__all__ = ["choose", "find"]
