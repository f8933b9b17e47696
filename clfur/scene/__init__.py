"""What to draw: meshes, cameras, lights and fur, as frozen classes that check themselves when they are made.

Lengths are in the mesh's own units, angles in degrees, colours linear. The world is right-handed with +Y up.
Arrays are copied on the way in and are read-only, so that a scene never changes under a renderer; but those
that `Curves` take on a device are not.
"""

from .background import backdrop, over
from .bounds import bounds_of, extent, fur_extent, hair_bounds
from .camera import Camera
from .curves import Bounds, Curves
from .environment import Environment
from .ground import Ground
from .light import Light
from .look import Chiang, Kajiya, highlighted
from .maps import Comb, Maps
from .material import Material
from .mesh import Mesh
from .origin import seen_from, upright
from .scene import Scene, frame, on_host
from .shells import Shells
from .strands import HairType, PointForce, Strands
from .tufts import Tufts

__all__ = [
    "Bounds", "Camera", "Chiang", "Comb", "Curves", "Environment", "Ground", "HairType", "Kajiya", "Light", "Maps",
    "Material", "Mesh", "PointForce", "Scene", "Shells", "Strands", "Tufts", "backdrop", "bounds_of", "extent", "frame",
    "fur_extent", "hair_bounds", "highlighted", "on_host", "over", "seen_from", "upright",
]
