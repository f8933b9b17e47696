from .budget import PRESETS
from .device.scheduler import Scheduler
from .errors import DeviceError, Error, Stopped
from .files.animation import load_animation
from .files.colmap import load_colmap
from .files.curves import load_curves, save_curves
from .files.gltf import load_materials
from .files.images import load, load_header, load_picture, save, to_uint8
from .files.meshes import load_mesh
from .files.scenes import load_scene
from .film.film import film
from .judge import truth
from .judge.compare import Comparison, compare
from .judge.frontier import Frontier, frontier
from .motion.hair import HairMotion, Wind
from .motion.motion import Motion
from .motion.shutter import blurred, subframes
from .render import Frame, draw, frames, grow, render
from .scene import (
    Camera,
    Chiang,
    Comb,
    Curves,
    Environment,
    Ground,
    HairType,
    Kajiya,
    Light,
    Maps,
    Material,
    Mesh,
    PointForce,
    Scene,
    Shells,
    Strands,
    Tufts,
    over,
)
from .settings import Settings
from .viewer.notebook import view

__version__: str
__all__ = [
    "PRESETS", "Camera", "Chiang", "Comb", "Comparison", "Curves", "DeviceError", "Environment", "Error", "Frame",
    "Frontier", "Ground", "HairMotion", "HairType", "Kajiya", "Light", "Maps", "Material", "Mesh", "Motion",
    "PointForce", "Scene", "Scheduler", "Settings", "Shells", "Stopped", "Strands", "Tufts", "Wind", "blurred",
    "compare", "draw", "film", "frames", "frontier", "grow", "load", "load_animation", "load_colmap", "load_curves",
    "load_header", "load_materials", "load_mesh", "load_picture", "load_scene", "over", "render", "save", "save_curves",
    "subframes", "to_uint8", "truth", "view",
]
