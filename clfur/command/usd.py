"""The scene of a USD file, over which the options that are given count more."""

import math

import attrs

from .. import Camera, Error
from ..files.scenes import parts_of
from .described import scene_of
from .options import check_grown

FRAMING = "eye", "target", "view"   # options that place the camera anew
OF_FILE = {"light": ("lights",), "environment": ("sky",), "body_color": ("body_color", "body_texture")}


def scene_of_usd(given, flags, options):
    """The `Scene` of a USD file and of options, {name: value}, of which ``flags`` {name: flag} are those given.

    Its strands stay, or else hair grows on its meshes; of its camera, lights, sky and colours stays what no option
    given sets.
    """
    said = {name: options[name] for name in ("width", "color", "alpha", "look", "seed") if options[name] is not None}
    said |= {name: options[name] for name in ("inner", "outer", "surface") if name in flags}
    parts = parts_of(given, said, options["camera"], options["time"],
                     options["size"] if "size" in flags else None)
    grows = options["hair"] is not None or options["guides"] is not None or options["fur"] == "shells"
    own = None if grows else parts["fur"]
    if parts["mesh"] is None and own is None:
        raise Error(f"{given}: has no Meshes that are seen; allowed: with strands that it has itself")
    if own is not None:
        check_grown(flags, options, given)
    if "size" not in flags and "camera" in parts:
        options = options | {"size": parts["camera"].size}
    scene = scene_of(parts["mesh"], options | {"given": given, "curves": own})
    kept = {name: parts[name] for name, names in OF_FILE.items() if name in parts and not any(
        each in flags for each in names)}
    if "camera" in parts and not any(name in flags for name in FRAMING):
        kept["camera"] = _nearer(parts["camera"], options["fov"] if "fov" in flags else None, options["zoom"])
    return attrs.evolve(scene, **kept)


def _nearer(camera, fov, zoom):
    """A camera of a file with another vertical field of view, or None, and times larger in the picture's middle."""
    width, height = camera.size
    k = camera.intrinsics
    times = zoom * (1 if fov is None else height / 2 / math.tan(math.radians(fov) / 2) / k[1, 1])
    if times == 1:
        return camera
    middle = [[0, 0, width / 2], [0, 0, height / 2], [0, 0, 1]]
    return Camera.calibrated(camera.pose, middle + (k - middle) * [[times], [times], [1]], camera.size)
