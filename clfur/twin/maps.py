"""maps in float64 NumPy: numbers on the skin, and what they make of the strands that stand there."""

import numpy as np

from .strands import between, random3, signed, unit_or

USE = 16   # of random3: which strands there are


def traits(
    planes,       # of density, on, length, width, clump, curl, stiffness and three directions, as `scene.maps.planes`
    uv,           # [N, 2] of the roots
    on_face,      # [N, 2] weights there of the first two corners of the mesh's face
    normal,       # [N, 3] there, unit
    corners,      # [N, 3, 3] of the triangles in which the roots are
    corner_uv,    # [N, 3, 2] of those
    face,         # [N] which face that is
    weight,       # of the direction against the normal
    seed,
    number,       # [N] of the strands
):
    """scale, tuft and comb, [N] of four each, as `layout.Traits` has them."""
    middle, on_face = corner_uv.mean(1), np.column_stack([on_face, 1 - on_face.sum(1)])
    found = np.stack([_values(plane, uv, middle, on_face, face, 1.0 if k < 7 else 0.0)
                      for k, plane in enumerate(planes)], 1)
    density, on, length, width, clump, curl, stiffness = found[:, :7].T
    chance = (signed(random3(number, seed, USE))[:, 0] + 1) / 2
    comb = np.zeros((len(found), 4))
    if planes[7] is not None:
        way = _on_uv(corners, corner_uv, found[:, 7:9]) if isinstance(planes[7], dict) else found[:, 7:]
        comb[:, :3] = np.cross(np.cross(normal, way), normal)   # without what is along the normal
        comb[:, 3] = weight
    made = np.zeros(len(found), [(name, float, 4) for name in ("scale", "tuft", "comb")])
    made["scale"] = np.stack([np.where(chance < density * on, length, 0), width, stiffness, curl], 1)
    made["tuft"][:, 0], made["tuft"][:, 1], made["comb"] = clump, 1, comb
    return made


def _values(plane, uv, middle, on_face, face, none):
    if plane is None:
        return np.ones(len(uv))
    if isinstance(plane, dict):
        return between(plane, uv, middle, none)
    return plane[face].astype(float) if plane.ndim == 1 else (plane[face] * on_face).sum(1)


def _on_uv(corners, uv, colors):
    """Vectors [N, 3] on triangles [N, 3, 3], as long as colors [N, 2] but at most 1, whose way in uv these are."""
    sides, steps = np.diff(corners, axis=1), np.diff(uv, axis=1)   # [N, 2, 3], [N, 2, 2]
    flat = np.abs(np.linalg.det(steps)) == 0
    steps[flat] = np.eye(2)
    along = np.linalg.solve(steps, sides)                          # rows: a step of u, and of v, on the triangle
    long = np.minimum(np.linalg.norm(colors, axis=1, keepdims=True), 1)
    return np.where(flat[:, None], 0, long * unit_or((colors[:, :, None] * along).sum(1), 0))
