"""Values on the skin -> traits of the strands that stand there."""

from typing import Any

import numpy as np

from .. import layout

TRAITS = layout.Declared("strand", layout.Traits)
PER = {name: number for number, name in enumerate(layout.PER)}


def pack_tiles(pictures: Any, before: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A picture [h, w] or [h, w, n], or {number: picture} of UDIM tiles -> ([n] layout.SkinTile in the order of their
    numbers, their texels [N] or [N, n]); ``before``: texels that come before these."""
    of_number = pictures if isinstance(pictures, dict) else {0: pictures}
    rows = np.zeros(len(of_number), layout.SkinTile)
    texels = [] if of_number else [np.zeros(0, np.float32)]
    for row, number in zip(rows, sorted(of_number)):
        picture = of_number[number]
        row["place"] = before, picture.shape[1], picture.shape[0], number
        before += picture.shape[0] * picture.shape[1]
        texels.append(picture.reshape(-1, *picture.shape[2:]))
    return rows, np.concatenate(texels)


def pack(planes: Any, faces: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What `scene.maps.planes` gives, of a run of faces -> (maps [SKIN_MAPS] layout.SkinMap, tiles [n] layout.SkinTile,
    texels [N] float32, values by face and by corner [M] float32)."""
    maps = np.zeros(len(planes), layout.SkinMap)
    tiles, texels, values = [np.zeros(0, layout.SkinTile)], [np.zeros(0, np.float32)], [np.zeros(0, np.float32)]
    for row, plane in zip(maps, planes):
        if isinstance(plane, dict):
            of_one, numbers = pack_tiles(plane, sum(map(len, texels)))
            row["kind"] = PER["picture"], sum(map(len, tiles)), len(of_one), 0
            tiles.append(of_one)
            texels.append(numbers)
        elif plane is not None:
            row["kind"] = PER["corner" if plane.ndim == 2 else "face"], sum(map(len, values)), 0, 0
            values.append(plane[slice(*faces)].reshape(-1))
    return maps, np.concatenate(tiles), np.concatenate(texels), np.concatenate(values)


def traits(gpu: Any, surface: Any, roots: Any, planes: Any, faces: tuple[int, int], weight: float, seed: int,
           first_strand: int) -> Any:
    """[strands] `layout.Traits` of strands with these ``roots`` on a tessellated `Surface` of a run of ``faces``.

    ``planes``: as `scene.maps.planes` gives them of the whole mesh.  ``weight``: of their direction against the normal.
    ``first_strand``: number of the first of these strands among all.
    """
    maps, tiles, texels, values = pack(planes, faces)
    made = TRAITS.empty(gpu, len(roots))
    gpu.launch("maps.traits", len(roots), positions=surface.positions, normals=surface.normals, uv=surface.uv,
               triangles=surface.triangles, area_scale=surface.area_scale, roots=roots, maps=gpu.upload(maps),
               tiles=gpu.upload(tiles), texels=gpu.upload(texels), values=gpu.upload(values), weight=weight, seed=seed,
               first_strand=first_strand, traits=made)
    return made


def bytes_of(planes: Any) -> int:
    """Bytes on the device of these planes."""
    arrays = [each for plane in planes if plane is not None
              for each in (plane.values() if isinstance(plane, dict) else [plane])]
    return sum(each.nbytes for each in arrays)
