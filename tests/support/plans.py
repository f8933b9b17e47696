"""How a scene is cut to fit a device, and what a device was made to do."""

from clfur.pipeline.mattes import TOLD
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig
from clfur.render import OUTPUTS

DRAWN_ONCE = tuple(name for name in OUTPUTS if name not in TOLD)   # the others are told of strands that are drawn again


def plan_of(scene, settings, outputs=tuple(OUTPUTS)):
    """The `Plan` of a frame."""
    return Plan(Rig.of(scene, settings), outputs)


def recorded(gpu):
    """Names of the kernels that a device is made to run from here on."""
    names, launch = [], gpu.launch

    def launched(name, size, /, **arguments):
        names.append(name)
        launch(name, size, **arguments)
    gpu.launch = launched
    return names


def bands_of(names):
    """How many bands of transparent strands were drawn by these kernels: in lanes, twice where light waits for what is
    seen, or not."""
    return names.count("coverage.tiles") - names.count("coverage.choose") + names.count("coverage.sort")
