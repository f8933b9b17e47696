"""OpenCL devices: which one, its drivers, buffers, programs and launches, and several for one frame.  Knows no fur."""

from .selection import choose, describe, find, handles, pick, probe, reason, survey

__all__ = ["choose", "describe", "find", "handles", "pick", "probe", "reason", "survey"]
