"""Roots on a surface, and the strands that grow there or that the user brings."""

import bisect
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, array
from .maps import pack_tiles
from .order import order
from .tessellate import Surface, as_float4

LEAST_STEPS, VARIED_STEPS, MOST_STEPS = 8, 32, 64   # in which a strand grows by the law
SORTED_FROM = 4096   # strands of the user's: fewer are near each other in memory anyway
AREA = layout.Declared("triangle", np.uint64)   # running sums of triangles' areas, by which roots are spread


@dataclass(frozen=True)
class DeviceStrands(Arrays):
    """Strands on the device: runs of points, which ``spans`` divides.

    Where the user's have been put in another order, all of this is in that, but ``stored``.
    """

    points: Any = array("point", np.float32, 4)     # x, y, z, width [world]
    spans: Any = array("strand", np.uint32, 2)      # first point, points
    shifts: Any = array("strand", np.uint32)        # what, added to the number of a point here, is that as it came
    numbers: Any = array("strand", np.uint32)       # of the strand as it came
    strand_of: Any = array("run", np.uint32)        # strand of each run of ``run`` points
    stored: Any = array("run", np.uint32)           # where the first point is of each run that came
    colors: Any = array("color", np.float32, 4)     # linear r, g, b, -; see ``color_per``
    normals: Any = array("strand", np.float32, 4)   # unit, of the body at the root; 0 where it is not known
    uv: Any = array("strand", np.float32, 4)        # root's u, v, index of its type, -
    types: Any = array("type", layout.HairType)
    first_strand: int = 0   # number of the first of these strands among all
    first_point: int = 0    # and of the first of these points
    run: int = 1            # points of each strand, 1 where they differ: of what came p is at stored[p / run] + p % run
    color_per: int = 1      # what has a colour of its own: 0 everything together, 1 each strand, 2 each point


STAGES = layout.Declared("strand", np.uint32, 4, 0)   # how far each has come where drivers end long loops
ROOTS = layout.Declared("strand", np.uint32, 4)   # triangle; weights of its corners, float32


@dataclass(frozen=True)
class Packed(Arrays):
    """Strands of the user's, as `Curves` has them; an empty array where there is none."""

    packed: Any = array("point", np.float32, 3)
    widths: Any = array("width", np.float32)               # one, each strand's or each point's
    packed_colors: Any = array("color", np.float32, 3)     # likewise
    root_normals: Any = array("strand", np.float32, 3)
    root_uv: Any = array("strand", np.float32, 2)
    type_of: Any = array("strand", np.uint32)


def stretches_of(gpu: Any, strands: DeviceStrands, steps: int) -> list[tuple[int, int]]:
    """[(first segment of each strand, one past the last)] of launches, in which a segment takes so many ``steps`` of
    loops at most: all at once but where a driver ends long loops."""
    if not gpu.steps or not len(strands.spans):
        return [(0, 2**32 - 1)]
    most = max(gpu.steps // steps, 1)
    longest = int(gpu.download(strands.spans)[:, 1].max())
    return [(0, 2**32 - 1)] if longest <= most else [(first, first + most) for first in range(0, longest, most)]


def go_through(gpu: Any, kernel: str, strands: DeviceStrands, least: int, each: int = 1, **known: Any) -> None:
    """Launch a kernel over strands, so many for ``each`` work-item; where a driver ends long loops again and again,
    each time for so many steps of them, ``least`` at least, till all strands have come to their end."""
    n, going = len(strands.spans), 1
    stages, steps = STAGES.empty(gpu, n if gpu.steps else 0), max(gpu.own_steps // 2, least) if gpu.steps else 2**32 - 1
    while going:
        n_open = gpu.full(1, np.uint32, 0) if gpu.steps else gpu.empty(0, np.uint32)
        gpu.launch(kernel, -(-n // each), steps=steps, stages=stages, n_open=n_open, **known)
        going = int(gpu.download(n_open)[0]) if gpu.steps else 0


def arrays(strands: DeviceStrands, *names: str) -> dict[str, Any]:
    """What of `DeviceStrands` has these names in kernels, as arguments of a launch: normals and uv are strand_normal
    and strand_uv there."""
    renamed = {"strand_normal": "normals", "strand_uv": "uv"}
    return {name: getattr(strands, renamed.get(name, name)) for name in names}


def roots_of(gpu: Any, surface: Surface, fur: Any, strands: tuple[int, int] | None = None,
             area: tuple[int, int] | None = None, sums: tuple[Any, Any] | None = None) -> tuple[int, Any]:
    """Where strands of a `clfur.Strands` stand -> (number of the first, `ROOTS`); the rest as `grow` has it."""
    on_faces = fur.roots == "faces"
    first = surface.first_triangle if on_faces else 0
    begin, end = strands or (first, first + len(surface.triangles) if on_faces else fur.roots)
    return begin, (_roots_on_faces if on_faces else _roots_by_area)(gpu, surface, fur, begin, end - begin, area, sums)


def grow(gpu: Any, surface: Surface, fur: Any, strands: tuple[int, int] | None = None,
         area: tuple[int, int] | None = None, sums: tuple[Any, Any] | None = None,
         traits_of: Any = None, roots: Any = None) -> DeviceStrands:
    """Grow `clfur.Strands` on a tessellated `Surface` -> `DeviceStrands`.

    A root stands in the middle of every triangle, or ``fur.roots`` of them uniformly by area (in strata: strand
    i in the i-th part of the area).  The growth loop is the report's (section 2.1.3), each strand alone.
    ``strands``: which, (first, one past the last), if not all.  ``area``: (of the triangles before those of the
    surface, of all triangles), if the surface is a part of the whole; see `area_sums`.  ``sums``: what that gives of
    the same triangles of a mesh in rest, if they are spread by its areas.  ``traits_of``: a function of the roots,
    `ROOTS`, that gives what maps on the skin make of each strand, [strands] `layout.Traits`.  ``roots``: of
    ``strands``, where they are known, as something else will shape them: they stand straight.
    """
    is_shaped, begin = roots is not None, strands[0] if strands else 0
    if not is_shaped:
        begin, roots = roots_of(gpu, surface, fur, strands, area, sums)
    n, traits = len(roots), gpu.empty(0, layout.Traits) if traits_of is None else traits_of(roots)
    tiles, type_map = pack_tiles({} if fur.type_map is None else fur.type_indices)
    pull = float(np.linalg.norm(fur.force)) + sum(abs(each.strength) for each in fur.point_forces)
    types, of_textures, texels = pack_types(fur.types, pull, traits_of is not None or len(fur.point_forces) > 0,
                                            len(tiles))
    stride = max(t.segments for t in fur.types) + 1
    color_per = 2 if fur.colored_points else 1
    point_forces = np.array([[*f.position, f.strength] for f in fur.point_forces], np.float32).reshape(-1, 4)
    grown = DeviceStrands.empty(
        gpu, {"point": n * stride, "strand": n, "color": n * stride if fur.colored_points else n, "run": n},
        types=gpu.upload(types), run=stride, first_strand=begin, first_point=begin * stride, color_per=color_per)
    if is_shaped:   # by the report's rule, which takes less, without forces or curl
        for name, column in ("shape", 2), ("curl", 0), ("wave", 0), ("taper", 3):
            types[name][:, column] = 0
    gpu.launch("strands.grow", -(-n // gpu.lanes), n=n, positions=surface.positions,
               normals=surface.normals, uv=surface.uv, triangles=surface.triangles, roots=roots,
               type_map=gpu.upload(type_map.astype(np.uint32)), map_tiles=len(tiles),
               tiles=gpu.upload(np.concatenate([tiles, of_textures])), texels=gpu.upload(texels),
               has_traits=traits_of is not None, traits=traits, force=(*fur.force, 0),
               point_forces=gpu.upload(point_forces), n_point_forces=0 if is_shaped else len(point_forces),
               seed=fur.seed, stride=stride, types=gpu.upload(types) if is_shaped else grown.types,
               **arrays(grown, "first_strand", "points", "spans", "strand_of", "stored", "shifts",
                        "numbers", "color_per", "colors", "strand_normal", "strand_uv"))
    return grown


def upload_curves(gpu: Any, curves: Any, strands: tuple[int, int] | None = None) -> DeviceStrands:
    """Put `clfur.Curves` on the device -> `DeviceStrands`.

    ``strands``: which, (first, one past the last), if not all.
    """
    begin, end = strands or (0, len(curves.counts))
    counts = curves.counts[begin:end].astype(np.uint32)
    before = int(curves.counts[:begin].sum(dtype=np.int64))
    n, total = len(counts), int(counts.sum(dtype=np.int64))
    first: Any = np.concatenate([[0], np.cumsum(counts)[:-1]]) if n else []
    width_per, color_per = (_per(len(values), len(curves.counts), len(curves.points))
                            for values in (curves.width, curves.color))
    here = (0, 1), (begin, end), (before, before + total)
    types, *_ = pack_types(curves.hair_types)
    has = {"has_normals": curves.root_normal is not None, "has_uv": curves.root_uv is not None,
           "has_types": curves.type_of is not None}
    packed = Packed(
        packed=gpu.rows(curves.points, *here[2]),
        widths=gpu.rows(curves.width, *here[width_per]),
        packed_colors=gpu.rows(curves.color, *here[color_per]),
        root_normals=gpu.rows(curves.root_normal, begin, end) if has["has_normals"] else gpu.empty((0, 3), np.float32),
        root_uv=gpu.rows(curves.root_uv, begin, end) if has["has_uv"] else gpu.empty((0, 2), np.float32),
        type_of=gpu.upload((curves.type_of[begin:end] if has["has_types"] else np.zeros(0)).astype(np.uint32)),
    )
    brought = np.stack([first, counts], 1).astype(np.uint32)
    brought.flags.writeable = False   # so that it can be lent
    spans = gpu.lend(brought)
    placed = order(gpu, packed.packed, spans).placed if n >= SORTED_FROM else gpu.upload(
        np.stack([np.arange(n), first], 1).astype(np.uint32))
    run = curves.uniform or 1
    grown = DeviceStrands.empty(
        gpu, {"point": total, "strand": n, "color": len(packed.packed_colors), "run": -(-total // run)},
        types=gpu.upload(types), first_strand=begin, first_point=before, color_per=color_per, run=run)
    gpu.launch("strands.unpack_curves", n, brought=spans, placed=placed, width_per=width_per, **has, **vars(packed),
               **arrays(grown, "spans", "shifts", "numbers", "stored", "run", "color_per", "points",
                        "strand_of", "colors", "strand_normal", "strand_uv"))
    return grown


def no_strands(gpu: Any) -> DeviceStrands:
    """`DeviceStrands` without a strand."""
    return DeviceStrands.empty(gpu, {"point": 0, "strand": 0, "color": 0, "type": 0, "run": 0})


def _per(length, strands, points):
    """What an array of this length has a value for: 0 everything, 1 each strand, 2 each point."""
    return 0 if length == 1 else 1 if length == strands else 2


def substeps_of(kind: Any, pull: float, is_varied: bool) -> int:
    """Steps a segment in which a type's strands grow by the law: two for each radian by which forces of size ``pull``
    could turn them, within limits; as many in all however many segments these are.  ``is_varied``: forces or softness
    are not the same everywhere."""
    least = VARIED_STEPS if is_varied else LEAST_STEPS
    return -(-int(min(max(2 * pull / kind.stiffness, least), MOST_STEPS)) // max(kind.segments, 1))


def pack_types(types: Any, pull: float = 0.0, is_varied: bool = False, before: int = 0) -> tuple[
        np.ndarray, np.ndarray, np.ndarray]:
    """`clfur.HairType`s -> ([types] layout.HairType, tiles of their textures [n] layout.SkinTile, their texels [N, 4]
    float32); ``before``: tiles that come before these; the rest as `substeps_of` has it."""
    packed = np.zeros(len(types), layout.HairType)
    tiles, texels = [np.zeros(0, layout.SkinTile)], [np.zeros((0, 4), np.float32)]
    for row, t in zip(packed, types):
        row["color"] = *t.color, t.color_variation
        substeps = 0 if t.stiffness is None else substeps_of(t, pull, is_varied)
        softness = 0.5 / (t.stiffness * max(t.segments, 1) * substeps) if substeps else 0.0
        row["shape"] = t.step, t.width, t.force_weight or 0, t.direction_variation
        row["curl"] = t.curl[0], *_turn(t.curl[1], t.segments), t.length_variation
        row["wave"] = t.wave[0], *_turn(t.wave[1], t.segments), softness
        row["taper"] = t.root_width, t.tip_width - t.root_width, 1 / t.taper - 2, substeps
        row["frizz"] = *t.frizz, t.tufts is not None, 0
        row["root"][:3], row["tip"][:3] = t.ends
        row["shine"], row["lobes"] = layout.shine(t.look, t.alpha), t.look.lobes
        row["counts"] = t.segments, before + sum(map(len, tiles)), 0, 0
        if t.color_texture is not None:
            of_one, colors = pack_tiles(t.color_texture, sum(map(len, texels)))
            row["counts"][2] = len(of_one)
            tiles.append(of_one)
            texels.append(as_float4(colors))
    return packed, np.concatenate(tiles), np.concatenate(texels)


def _turn(turns, segments):
    angle = 2 * np.pi * turns / max(segments, 1)
    return np.cos(angle), np.sin(angle)


def _roots_on_faces(gpu, surface, _fur, begin, n, _area, _sums):
    roots = ROOTS.empty(gpu, n)
    gpu.launch("strands.roots_on_faces", n, first=begin - surface.first_triangle, roots=roots)
    return roots


def _roots_by_area(gpu, surface, fur, begin, n, area, sums):
    roots = ROOTS.empty(gpu, n)
    areas, total = sums or area_sums(gpu, surface)
    before, whole = (0, total) if area is None else (area[0], gpu.upload(np.array([area[1]], np.uint64)))
    gpu.launch("strands.roots_by_area", -(-n // gpu.lanes), areas=areas, n_triangles=len(surface.triangles),
               before=before, whole=whole, seed=fur.seed, first=begin, n=fur.roots, n_here=n, roots=roots)
    return roots


def area_sums(gpu: Any, surface: Surface) -> tuple[Any, Any]:
    """The integer areas by which roots are spread -> (of the triangles up to each, [T] uint64; of all, [1] uint64)."""
    triangles = len(surface.triangles)
    blocks = -(-triangles // layout.CONSTANTS["SCAN"])
    sums, total, areas = gpu.empty(blocks, np.uint64), gpu.empty(1, np.uint64), AREA.empty(gpu, triangles)
    mesh = {"positions": surface.positions, "triangles": surface.triangles, "n": triangles,
            "area_scale": surface.area_scale}
    gpu.launch("strands.sum_areas", blocks, sums=sums, **mesh)
    gpu.launch("strands.scan_sums", 1, n=blocks, sums=sums, total=total)
    gpu.launch("strands.scan_areas", blocks, sums=sums, areas=areas, **mesh)
    return areas, total


def first_strand_at(place: int, fur: Any, total: int) -> int:
    """The first of ``fur.roots`` strands that stands at or behind a place in the area, as strands.cl has it: strand i
    stands at a random place of the i-th part of ``total``, so that these places never fall."""
    share, rest = divmod(total, fur.roots)

    def place_of(i):
        return share * i + rest * i // fur.roots + (share * _random(i, fur.seed) >> 32)
    return bisect.bisect_left(range(fur.roots), place, key=place_of)


def _random(strand, seed):
    """The first word of random3(strand, seed, 0) in strands.cl."""
    x, y, z = ((v * 1664525 + 1013904223) % 2**32 for v in (strand, seed, 0))
    x = (x + y * z) % 2**32
    y = (y + z * x) % 2**32
    z = (z + x * y) % 2**32
    x, y, z = (v ^ v >> 16 for v in (x, y, z))
    return (x + y * z) % 2**32
