from .selection import choose, describe, find, handles, pick, probe, reason, survey

__all__ = ["choose", "describe", "find", "handles", "pick", "probe", "reason", "survey"]
