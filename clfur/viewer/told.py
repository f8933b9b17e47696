"""What a picture took, in words."""

import traceback

from ..budget import LADDER, features, predicted
from ..pipeline.views import Rig
from ..render import Frame
from ..scene import Scene
from ..settings import CHOSEN


def told(frame: Frame, scene: Scene) -> str:
    """Return in a line what the final picture of a scene took, and how much it errs as far as that is known.

    scene: as it was drawn, with the picture's camera.
    """
    parts = [f"drawn in {frame.seconds:.2f} s"]
    if frame.building > 0.05:
        parts[0] += f", of it {frame.building:.2f} s to build kernels"
    try:
        error = frame.error if frame.error is not None else expected(frame, scene)
    except Exception:   # the picture is there all the same
        traceback.print_exc()
        error = None
    if error is not None:
        parts.append(f"RMS error about {error:.2g}")
    return "; ".join([*parts, frame.why] if frame.why else parts)


def expected(frame: Frame, scene: Scene) -> float | None:
    """Return what the picture of strands errs by `clfur.budget`'s fit, root mean square of sRGB, 0 to 1; None where
    that knows nothing of its settings."""
    settings = frame.settings
    if scene.strands is None or settings is None:
        return None
    for rung, each in enumerate(LADDER):
        if all(getattr(each, name) == getattr(settings, name) for name in CHOSEN):
            return float(predicted(*features(Rig.of(scene.local, settings), frame.strands))[1][rung])
    return None
