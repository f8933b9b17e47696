"""OpenCL devices: which one, its drivers, buffers, programs and launches, and several for one frame.  Knows no fur."""

from .selection import choose

__all__ = ["choose"]
