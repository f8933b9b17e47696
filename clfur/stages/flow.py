"""What is seen now, and where it was: motion vectors on the screen, and how far anything goes."""

from typing import Any

import numpy as np

from ..layout import Declared
from .strands import DeviceStrands, arrays
from .tessellate import Surface

VECTORS = Declared("pixel", np.float32, 2, 0)   # pixels, x to the right and y down


def still(gpu: Any, view: np.void, view_before: np.void, visible: Any) -> Any:
    """Motion vectors of what stays where it is, the background and the ground -> `VECTORS` [rows, width]; 0 elsewhere.

    view, view_before: `layout.View` of the camera now and before.  visible: [rows, width, samples] uint64, see
    `raster`.  Infinite where the place was not before the camera, here and below.
    """
    rows, width, _ = visible.shape
    vectors = VECTORS.empty(gpu, (rows, width))
    gpu.launch("flow.still", rows * width, view=view, view_before=view_before, visible=visible, vectors=vectors)
    return vectors


def moving(gpu: Any, view: np.void, view_before: np.void, visible: Any, now: tuple[DeviceStrands, Surface],
           before: tuple[DeviceStrands, Surface], vectors: Any, thinned: bool = False) -> None:
    """Motion vectors of strands, at the same place along them, and of the body, on the same triangle, into ``vectors``.

    now, before: a part of the scene, of the same numbers.  ``thinned``: `visible` shows fewer points of strands than
    ``now`` has, see `lod`.
    """
    (strands, body), (strands_before, body_before) = now, before
    gpu.launch("flow.moving", visible.shape[0] * visible.shape[1], view=view, view_before=view_before,
               part=(strands.first_point, len(strands.points), body.first_triangle, len(body.triangles)),
               visible=visible, thinned=int(thinned), positions=body.positions, triangles=body.triangles,
               positions_before=body_before.positions, vectors=vectors, **_of(strands_before),
               **arrays(strands, "points", "spans", "shifts", "strand_of", "stored", "run"))


def of_shells(gpu: Any, view: np.void, view_before: np.void, visible: Any, shell_front: Any, ids: Any, corners: Any,
              corners_before: Any, vectors: Any) -> None:
    """Motion vectors of shell fur where ``ids``, [rows, width] int32, tell it, into ``vectors``: it goes with its face.

    shell_front: [rows, width, samples] uint64, see `march`.  corners, corners_before: [faces, 3, 4] float32.
    """
    gpu.launch("flow.of_shells", ids.size, view=view, view_before=view_before, samples=visible.shape[2],
               shell_front=shell_front, ids=ids, corners=corners, corners_before=corners_before, vectors=vectors)


def farthest(gpu: Any, view: np.void, view_before: np.void, now: tuple[DeviceStrands, Surface],
             before: tuple[DeviceStrands, Surface], most: Any = None) -> Any:
    """How far any point of strands or corner of the body goes on the screen [pixels] -> [1] uint32 on the device: the
    bits of a float32, which grows with what was in ``most``.

    Points count whose way lies before the camera, and by one size of the picture around it at most; a way that begins
    or ends behind the camera from where it comes before it.
    """
    (strands, body), (strands_before, body_before) = now, before
    most = gpu.full(1, np.uint32, 0) if most is None else most
    gpu.launch("flow.of_strands", len(strands.spans), view=view, view_before=view_before, most=most,
               **_of(strands_before), **arrays(strands, "points", "spans", "shifts"))
    gpu.launch("flow.of_body", len(body.positions), view=view, view_before=view_before, positions=body.positions,
               positions_before=body_before.positions, most=most)
    return most


def _of(before):
    """What is asked of strands as they were, which may lie in another order."""
    return {"points_before": before.points, "stored_before": before.stored, "run_before": before.run}
