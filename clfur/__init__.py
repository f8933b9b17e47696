"""Fur and hair on meshes, rendered with OpenCL."""

from .compare import Comparison, compare
from .errors import DeviceError, Error
from .frontier import Frontier, frontier
from .fur import Curves, HairType, PointForce, Strands
from .image import save
from .mesh import load_mesh
from .render import Frame, draw, render
from .scene import Camera, Light, Mesh, Scene
from .scheduler import Scheduler
from .settings import Settings
from .shell_fur import Shells

__all__ = [
    "Camera", "Comparison", "Curves", "DeviceError", "Error", "Frame", "Frontier", "HairType", "Light", "Mesh",
    "PointForce", "Scene", "Scheduler", "Settings", "Shells", "Strands", "compare", "draw", "frontier", "load_mesh",
    "render", "save",
]
