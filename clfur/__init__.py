"""Fur and hair on meshes, rendered with OpenCL."""

from importlib import import_module

_HOME = {
    "Error": "errors",
    "Scene": "scene", "Mesh": "scene", "Strands": "scene", "Curves": "scene", "HairType": "scene",
    "PointForce": "scene", "Camera": "scene", "Light": "scene",
    "Settings": "settings", "Scheduler": "scheduler",
    "load_mesh": "mesh", "save": "image", "render": "render", "draw": "render",
}
__all__ = list(_HOME)


def __getattr__(name):   # imported on first use: `clfur --help` needs neither NumPy nor OpenCL
    if name not in _HOME:
        raise AttributeError(f"module 'clfur' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{_HOME[name]}", __name__), name)
    return value


def __dir__():
    return sorted(__all__)
