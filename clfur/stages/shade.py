"""Visible samples -> the lit picture, and what else is known of its pixels."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .chiang import Scattering, no_scattering
from .lighting import Lighting
from .sky import SkyLight, arguments
from .strands import DeviceStrands, arrays
from .tessellate import Surface

IMAGE = Declared("pixel", np.float32, 4, 0)         # linear, premultiplied r, g, b, alpha
RADIANCE_SUMS = Declared("pixel", np.int64, 4, 0)   # r, g, b, alpha in 2^-32


@dataclass(frozen=True)
class Outputs(Arrays):
    """What is known of pixels, see `outputs`."""

    depth: Any = array("pixel", np.float32, None, np.inf)
    id: Any = array("pixel", np.int32, None, layout.CONSTANTS["ID_NOTHING"])
    tangent: Any = array("pixel", np.float32, 4, 0)
    normal: Any = array("pixel", np.float32, 4, 0)
    uv: Any = array("pixel", np.float32, 4, 0)
    coverage: Any = array("pixel", np.float32, None, 0)


@dataclass(frozen=True)
class Paint(Arrays):
    """What the body is painted with, where that is not one colour."""

    materials: Any = array("material", layout.Material)
    texels: Any = array("texel", np.uint32, 2)       # of their pictures, at all sizes: 16 bits each of r, g, b, -


def paint_of(gpu: Any, materials: tuple) -> Paint:
    """`Paint` of `clfur.Material`s."""
    packed, first = np.zeros(len(materials), layout.Material), 0
    for row, material in zip(packed, materials):
        size, levels, texels, scale = material.texels
        row["color"] = *(material.color * (scale if levels else 1)), 0
        row["size"] = *size, first, levels
        row["wrap"][:2] = [layout.WRAPS.index(each) for each in material.wrap]
        first += len(texels)
    joined = np.concatenate([material.texels[2] for material in materials])
    return Paint(gpu.upload(packed), gpu.upload(joined.view(np.uint32)))


def color(gpu: Any, view: np.void, lighting: Lighting, visible: Any, strands: DeviceStrands, body: Surface,
          body_color: tuple, image: Any = None, sample_transmittance: Any = None, sums: Any = None,
          scattering: Scattering | None = None, sky: SkyLight | None = None, paint: Paint | None = None,
          material_of: Any = None, coverage: Any = None) -> Any:
    """Light every sample and average -> [rows, width, 4] float32, linear, premultiplied, alpha = coverage.

    Strands by their types' looks, the body by Lambert.
    visible: [rows, width, samples] uint64, see `raster`.  body_color: linear r, g, b.
    ``image``: what it is added to.  ``sample_transmittance``: [rows, width, samples] float32, the share of each
    sample's light and coverage that comes through what stands before it and is in ``image`` already; all if None.
    ``strands`` and ``body`` may be a part of what is visible: it is then added to ``sums``, [rows, width, 4] int64, see
    `blend`.  ``scattering``: of the strands' types; None where none has lobes.  ``sky``: its light, if there is one.
    ``paint``: what the body has in place of ``body_color``; ``material_of``: [faces of ``body``] uint32, which of
    several materials each has.  ``coverage``: [rows, width] float32, the result's alpha; None: what samples add up to.
    """
    rows, width, _ = visible.shape
    if sums is None and image is None:
        image = IMAGE.empty(gpu, (rows, width))
    gpu.launch("shade.color", -(-rows * width // layout.shaded(gpu.lanes)), view=view, part=_part(strands, body),
               visible=visible, pixels=rows * width, positions=body.positions, normals=body.normals,
               triangles=body.triangles, uv=body.uv, body_color=(1, 1, 1, 0) if paint else (*body_color, 0),
               attenuated=sample_transmittance is not None, **_painted(gpu, paint, material_of),
               sample_transmittance=_or_none(gpu, sample_transmittance), more=sums is not None,
               radiance_sums=gpu.empty((0, 4), np.int64) if sums is None else sums,
               image=gpu.empty((0, 4), np.float32) if image is None else image, covered=coverage is not None,
               coverage=_or_none(gpu, coverage), **lighting.arrays(),
               **arguments(gpu, sky), **(scattering or no_scattering(gpu)).arrays(),
               **arrays(strands, "points", "spans", "strand_of", "stored", "run", "strand_normal", "strand_uv",
                        "types", "colors", "color_per"))
    return image if sums is None else sums


def no_light(gpu: Any, rows: int, width: int) -> Any:
    """Sums of no light yet -> [rows, width, 4] int64, r, g, b, alpha in 2^-32."""
    return RADIANCE_SUMS.empty(gpu, (rows, width))


def blend(gpu: Any, sums: Any, image: Any = None, coverage: Any = None) -> Any:
    """Put sums of light over an ``image``, of shells -> [rows, width, 4] float32, linear, premultiplied.

    sums: [rows, width, 4] int64, see `no_light`.  image: as the result, nothing if None.
    ``coverage``: [rows, width] float32, the result's alpha; None: what all of them add up to.
    """
    rows, width, _ = sums.shape
    image = IMAGE.empty(gpu, (rows, width)) if image is None else image
    gpu.launch("shade.blend", rows * width, radiance_sums=sums, covered=coverage is not None,
               coverage=_or_none(gpu, coverage), image=image)
    return image


def cover(gpu: Any, visible: Any, transmittance: Any, image: Any) -> None:
    """Put the coverage that `shells.outputs` tells into the alpha of an ``image``, [rows, width, 4] float32.

    ``visible``, ``transmittance``: [rows, width, samples] uint64 and float32, as for `shells.outputs`.
    """
    rows, width, samples = visible.shape
    gpu.launch("shade.cover", rows * width, samples=samples, visible=visible, transmittance=transmittance, image=image)


def uncover(gpu: Any, visible: Any, transmittance: Any, image: Any) -> None:
    """Take out of the alpha of an ``image``, [rows, width, 4] float32, what samples that see anything add to it.

    ``visible``: [rows, width, samples] uint64.  ``transmittance``: [rows, width, samples] float32, the share of each
    sample that comes through what stands before it.  The light of these samples adds what they do cover.
    """
    rows, width, samples = visible.shape
    gpu.launch("shade.uncover", rows * width, samples=samples, visible=visible, transmittance=transmittance,
               image=image)


def outputs(gpu: Any, view: np.void, visible: Any, strands: DeviceStrands, body: Surface,
            result: dict | None = None) -> dict:
    """What the nearest covered sample of each pixel sees -> {name: [rows, width(, 4)]}.

    visible: [rows, width, samples] uint64, see `raster`.
    depth: float32 distance along the view axis, infinite where nothing is.  id: int32 strand, -1 nothing, -2 body.
    tangent, normal: float32 unit or 0.  uv: float32, of the body or the strand's root.  coverage: float32 0..1.
    ``strands`` and ``body`` may be a part of what is visible: what it knows is added to ``result``.
    """
    rows, width, _ = visible.shape
    result = result or vars(Outputs.empty(gpu, {"pixel": (rows, width)}))
    gpu.launch("shade.outputs", rows * width, view=view, part=_part(strands, body), visible=visible,
               positions=body.positions, normals=body.normals, uv=body.uv, triangles=body.triangles,
               **{f"out_{name}": each for name, each in result.items()},
               **arrays(strands, "first_strand", "points", "spans", "strand_of", "numbers", "stored", "run",
                        "strand_uv"))
    return result


def _painted(gpu, paint, material_of):
    """`Paint` as arguments of a launch; arrays of none where the body has one colour."""
    paint = paint or Paint.empty(gpu, {"material": 0, "texel": 0})
    return {"n_materials": len(paint.materials), "material_of": gpu.empty(0, np.uint32) if material_of is None
            else material_of, **vars(paint)}


def _or_none(gpu, transmittance):
    """A transmittance, or an array of none that stands for it."""
    return gpu.empty(0, np.float32) if transmittance is None else transmittance


def _part(strands, body):
    """Which ids are theirs: first point and points, first triangle and triangles."""
    return strands.first_point, len(strands.points), body.first_triangle, len(body.triangles)
