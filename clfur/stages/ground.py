"""The ground -> where it is seen, the shadows on it, and what else is known of it."""

from typing import Any

import numpy as np

from .. import layout
from .lighting import Lighting
from .sky import SkyLight


def put(gpu: Any, view: np.void, ground: np.void, visible: Any) -> Any:
    """Offer the ground to all samples -> ``visible``, [rows, width, samples] uint64, see `raster`: the id of the ground
    is GROUND, which comes after all triangles."""
    gpu.launch("ground.put", visible.shape[0] * visible.shape[1], view=view, ground=ground, visible=visible)
    return visible


def light(gpu: Any, view: np.void, ground: np.void, lighting: Lighting, visible: Any, sums: Any,
          sample_transmittance: Any = None, sky: SkyLight | None = None) -> None:
    """Add the light of samples that see the ground to ``sums``, [rows, width, 4] int64, see `shade.blend`.

    Of a ground without a colour that is none, and alpha is the share of the light on it that hair and body take away,
    by its luminance.  visible: [rows, width, samples] uint64.  ``sample_transmittance``: [rows, width, samples]
    float32, the share of each sample's light and alpha that comes through what stands before it; all if None.
    ``sky``: its light on the plane, if there is one.
    """
    pixels = visible.shape[0] * visible.shape[1]
    attenuated = sample_transmittance is not None
    gpu.launch("ground.light", -(-pixels // layout.shaded(gpu.lanes)), view=view, ground=ground, visible=visible,
               pixels=pixels, attenuated=attenuated, radiance_sums=sums,
               sample_transmittance=sample_transmittance if attenuated else gpu.empty(0, np.float32),
               plane=sky.plane if sky else np.zeros((), layout.OnGround),
               squares=sky.squares if sky else gpu.empty((0, 4), np.float32),
               **lighting.arrays())


def outputs(gpu: Any, view: np.void, ground: np.void, visible: Any, known: dict) -> None:
    """Tell depth, id and normal of pixels whose nearest sample sees the ground; ``known``: what `shade.outputs`
    gives."""
    gpu.launch("ground.outputs", visible.shape[0] * visible.shape[1], view=view, ground=ground, visible=visible,
               **{f"out_{name}": known[name] for name in ("depth", "id", "normal")})
