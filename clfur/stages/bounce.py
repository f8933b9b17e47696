"""A body in cells of the world -> its part in light that goes from hair to hair, and what light of cells it shows."""

from typing import Any

import numpy as np

from ..layout import Declared, OnGround
from . import sky as sky_stage
from .lighting import Lighting

FACES = Declared("face", np.float32, 4)   # three of each cell: which way the body faces, its share; what it sends


def faces(gpu: Any, sky: np.void, contents: Any, body_color: tuple, lighting: Lighting) -> Any:
    """Where a body's surface lies in cells, and what it sends on of lights' direct light -> [3 n³, 4] float32, see
    bounce.cl.

    contents: of cells, see `sky.contents`.  body_color: linear r, g, b, one for all of it.
    """
    cells = int(sky["size"][0]) ** 3
    made = FACES.empty(gpu, 3 * cells)
    gpu.launch("bounce.faces", cells, sky=sky, held=contents, body_color=(*body_color, 0), faces=made,
               **lighting.arrays())
    return made


def glow(gpu: Any, body_color: tuple, directions: Any, light: Any, made: Any) -> None:
    """Tell anew what a body sends on, into what `faces` gave.  directions: [3, D] float32 on the device; light: see
    `transport.Transport`."""
    gpu.launch("bounce.glow", len(light), body_color=(*body_color, 0), directions=directions, light=light, faces=made)


def light_around(gpu: Any, sky: np.void, axes: np.ndarray, light: Any) -> sky_stage.SkyLight:
    """Light of cells in directions ``axes`` [D, 3] -> the same as harmonics, so that a body shows it as it shows a
    sky's."""
    table = np.linalg.pinv(sky_stage.harmonics(axes))   # exact for light that harmonics can tell
    result = sky_stage.SkyLight.empty(gpu, {"harmonic": sky_stage.HARMONICS * len(light), "square": 0}, sky=sky,
                                      plane=np.zeros((), OnGround))
    gpu.launch("bounce.harmonics", len(light), light=light, table=gpu.upload(np.float32(table)),
               sky_cells=result.cells)
    return result


def bytes_of(n: int) -> int:
    """Bytes on the device of all that is made of n³ cells."""
    return n**3 * (3 * FACES.bytes + sky_stage.SkyLight.bytes(harmonic=sky_stage.HARMONICS))
