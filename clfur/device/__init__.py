"""OpenCL devices: which one, its drivers, buffers, programs and launches, and several for one frame.  Knows no fur."""

import lazy_loader

# Imported when they are first used, from where __init__.pyi says: what looks for drivers does without OpenCL.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
