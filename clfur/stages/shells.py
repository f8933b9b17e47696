"""Shell fur: the space between the skin and the tips, and the hairs that stand in it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..layout import Arrays, Declared, array
from .sky import Held
from .tessellate import as_float4
from .voxelize import CELLS

HEIGHTS, CORNERS, ROWS = (layout.CONSTANTS[name] for name in ("HEIGHTS", "CORNERS", "ROWS"))
AROUND = 96                  # places looked at for each height of the table of means
SLABS = 4                    # straight pieces of a bent hair
MOST_NOISE = 16, 256         # lattices of the noise along a side, in space and on the skin
MOST_ROWS = 4096             # of a face's points in the light's grid,
MOST_POINTS, MOST_HEIGHTS = 48, 32   # and rows of them and heights of a slab in a sky's


POSITIONS = Declared("vertex", np.float32, 4)   # of the mesh, while hairs are bent
LEAN = Declared("vertex", np.float32, 3)        # where vertices lean by themselves
REST = Declared("corner", np.float32, 4)        # of the faces in rest, while the pattern is laid


@dataclass(frozen=True)
class Topology:
    """How the faces of a mesh hang together, on the host; corners in the order of their numbers."""

    corners: np.ndarray       # [F, 3] uint32
    neighbours: np.ndarray    # [F, 4] int32 face << SIDE_BITS | its side, across each side (0: corners 1 2,
                              # 1: 0 2, 2: 0 1), or -1; -
    order: np.ndarray         # [F, 3] which of the face's own corners these are


@dataclass(frozen=True)
class Pattern(Arrays):
    """Where the hairs of shell fur stand."""

    packed: np.void                                  # layout.Shells
    noise: Any = array("place", np.float32, 2)
    means: Any = array("height", np.float32, 2)      # share covered, hairs entered going sideways by 1
    faces: Any = array("face", np.uint32, 4)         # corners in the order of their numbers
    neighbours: Any = array("face", np.int32, 4)     # see Topology
    lattice: Any = array("lattice", np.float32, 4)   # [F * CORNERS, 4], see shells.cl
    uv: Any = array("corner", np.float32, 4)         # [F * 3, 4] of the faces' corners, 0 where the mesh has none


@dataclass(frozen=True)
class Shell(Arrays):
    """Shell fur on the device, ready for rays."""

    pattern: Pattern
    curves: Any = array("curve", np.float32, 4)      # [V * (slabs + 1), 4] world: how hairs are bent at each vertex
    normals: Any = array("vertex", np.float32, 4)    # of the skin
    triangles: Any = array("border", np.uint32, 4)   # where rays come in: corners of curves, seen counter-clockwise
    border: Any = array("border", np.uint32, 4)      # face, place in it: see march.cl
    longest: float = 0.0                             # no side of these triangles is longer [world]

    @property
    def positions(self) -> Any:
        """Corners of the triangles, as `raster` draws a `Surface`."""
        return self.curves

    first_triangle = 0


def topology_of(faces: np.ndarray) -> Topology:
    """`Topology` of faces [F, 3]; a side that is not that of just two faces has no neighbour."""
    order = np.argsort(faces, 1, kind="stable")
    corners = np.take_along_axis(faces, order, 1).astype(np.int64)
    sides = corners[:, [[1, 2], [0, 2], [0, 1]]].reshape(-1, 2)
    key = sides[:, 0] << 32 | sides[:, 1]
    by_key = np.argsort(key, kind="stable")
    ordered = key[by_key]
    first = np.ones(len(key), bool)
    first[1:] = ordered[1:] != ordered[:-1]
    number = np.cumsum(first) - 1
    pair = np.bincount(number)[number] == 2
    one, other = by_key[pair & first], by_key[pair & ~first]
    neighbours = np.full(len(key), -1, np.int64)
    numbers = np.arange(len(key)) // 3 << int(layout.CONSTANTS["SIDE_BITS"]) | np.arange(len(key)) % 3
    neighbours[one], neighbours[other] = numbers[other], numbers[one]
    return Topology(corners.astype(np.uint32), as_float4(neighbours.reshape(-1, 3).astype(np.int32)), order)


def border_of(faces: np.ndarray, topology: Topology, slabs: int, bare: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles by which rays come into the fur -> (corners [B, 4], starts [B, 4]) uint32, see `Shell`.

    ``faces``: [F, 3], those of the topology, counter-clockwise seen from the tips.
    Those at the tips, the sides of the fur where the mesh ends, and with ``bare`` the skin itself, from within.
    """
    faces, n = faces.astype(np.int64), slabs + 1
    number, order = np.arange(len(faces)), np.argsort(faces, 1)
    corners, starts = [faces * n + slabs], [(number, np.full(len(faces), 4 * (3 * slabs - 1)))]
    if bare:
        corners.append(faces[:, ::-1] * n)
        starts.append((number, np.full(len(faces), 3)))
    ends = {0: (1, 2), 1: (0, 2), 2: (0, 1)}
    # Tetrahedron and corner left out, of the lower and the upper triangle.
    places = {0: ((0, 0), (1, 0)), 1: ((0, 1), (2, 2)), 2: ((1, 3), (2, 3))}
    for side in range(3):
        open_ = np.flatnonzero(topology.neighbours[:, side] < 0)
        p, q = (topology.corners[open_, end].astype(np.int64) for end in ends[side])
        # The face's own corners go round counter-clockwise: does this side run from p to q there?
        at_p, at_q = (order[open_, end] for end in ends[side])
        along = ((at_p + 1) % 3 == at_q)[:, None]
        for slab in range(slabs):
            low_p, low_q, high_p, high_q = p * n + slab, q * n + slab, p * n + slab + 1, q * n + slab + 1
            lower, upper = np.stack([low_p, low_q, high_q], 1), np.stack([low_p, high_q, high_p], 1)
            for triangle, (tetrahedron, missing) in zip((lower, upper), places[side]):
                corners.append(np.where(along, triangle, triangle[:, ::-1]))
                starts.append((open_, np.full(len(open_), 4 * (3 * slab + tetrahedron) + missing)))
    rows = np.concatenate([np.stack([face, place, 0 * face, 0 * face], 1) for face, place in starts])
    return as_float4(np.concatenate(corners).astype(np.uint32)), rows.astype(np.uint32)


def pack(shells: Any, mesh: Any, bare: bool, filtered: bool) -> np.void:
    """`clfur.Shells` -> `layout.Shells`."""
    packed: Any = np.zeros((), layout.Shells)
    _, axes, radius = (shells.rest or mesh).own_frame
    f, (strength, waves) = shells.frequency_on(mesh), shells.noise
    packed["size"] = shells.length, shells.layers, f, shells.length_variation
    packed["shape"] = shells.sharpness, shells.density, strength, waves
    packed["color"] = *shells.color, shells.root_shade
    packed["shine"] = layout.shine(shells.look, shells.alpha, "turned" if shells.shading == "turned" else None)
    sine = shells.pattern == "sine"
    # The noise is as large as the pattern needs it: the report's finding.
    most = MOST_NOISE[sine]
    if sine:
        lattice = np.ceil(np.divide((2 * f, f, 0), waves))
    else:
        # A little less: turned and rounded in another way, a mesh that just fits still does.
        lattice = np.full(3, 2 ** np.ceil(np.log2(1.99999 * radius * f / waves)))
        packed["to_noise"][:, :3] = axes.T * (f / waves)
    packed["noise"] = *np.clip(lattice, 1 if sine else 4, most), bare
    bend = np.subtract(shells.force, shells.acceleration)
    slabs = SLABS if bend.any() or np.any(shells.wind) or shells.lean is not None else 1
    packed["kind"] = sine, np.uint32(shells.seed).view(np.int32), slabs, filtered
    packed["bend"][:3], packed["wind"][:3] = bend, shells.wind
    if np.any(shells.wind):
        packed["gust"][:3] = np.asarray(shells.wind) / np.linalg.norm(shells.wind) / radius
        packed["gust"][3] = shells.time % 1.0
    return packed


def _rows_of(packed, vertices, faces):
    """How much of what there is in a `Pattern` and a `Shell`: {"place": 64, ...}, but for the border."""
    nx, ny, nz, _ = (4 * int(n) for n in packed["noise"])
    return {"place": nx * ny * (1 if packed["kind"][0] else nz), "height": HEIGHTS, "face": faces, "corner": 3 * faces,
            "lattice": CORNERS * faces, "vertex": vertices, "curve": vertices * (int(packed["kind"][2]) + 1)}


def size_of(mesh: Any, packed: np.void, topology: Topology, leaning: bool = False) -> int:
    """Bytes on the device of a `Shell`, and what it takes to make it; ``leaning``: with a `Shells.lean`."""
    slabs, bare = int(packed["kind"][2]), int(packed["noise"][3])
    rows = _rows_of(packed, len(mesh.positions), len(mesh.faces))
    sides = len(mesh.faces) * (1 + bare) + 2 * slabs * int((topology.neighbours[:, :3] < 0).sum())
    making = (POSITIONS.bytes + LEAN.bytes * leaning) * rows["vertex"] + REST.bytes * rows["corner"]
    return Pattern.bytes(**rows) + Shell.bytes(border=sides, **rows) + making


def lay(gpu: Any, mesh: Any, packed: np.void, topology: Topology, rest: Any = None) -> Pattern:
    """Lay the pattern of `layout.Shells` on a mesh -> `Pattern`; ``rest``: that mesh in rest, None: it is so itself."""
    uv = np.take_along_axis(mesh.uv, topology.order[..., None], 1).reshape(-1, 2)
    n = len(topology.corners)
    rows = _rows_of(packed, len(mesh.positions), n)
    result = Pattern.empty(gpu, rows, packed=packed, faces=gpu.upload(as_float4(topology.corners)),
                           neighbours=gpu.upload(topology.neighbours), uv=gpu.upload(as_float4(uv)))
    gpu.launch("shells.noise", rows["place"], shells=packed, out=result.noise)
    gpu.launch("shells.means", HEIGHTS, shells=packed, around=AROUND, out=result.means)
    positions, normals = gpu.upload(as_float4(mesh.positions)), gpu.upload(as_float4(mesh.normals))
    gpu.launch("shells.lattice", n, shells=packed, positions=positions, normals=normals, faces=result.faces,
               uv=result.uv, rest=gpu.upload(resting(rest or mesh, topology)), out=result.lattice)
    return result


def resting(rest: Any, topology: Topology) -> np.ndarray:
    """Corners of faces in rest, from its middle, in the order of the posed mesh -> float32 [F * 3, 4].

    The last column tells which corner each is in the order of rest's own numbers: 0, 1, 2.
    """
    own = np.argsort(np.argsort(rest.faces, 1, kind="stable"), 1)
    places = (rest.positions - rest.own_frame[0]).astype(np.float32)[rest.faces]
    corners = np.concatenate([places, own[..., None].astype(np.float32)], 2)
    return np.take_along_axis(corners, topology.order[..., None], 1).reshape(-1, 4)


def border(gpu: Any, mesh: Any, packed: np.void, topology: Topology) -> tuple[Any, Any]:
    """What `border_of` gives, on the device -> (corners [B, 4], starts [B, 4]) uint32."""
    slabs, bare = int(packed["kind"][2]), int(packed["noise"][3])
    return tuple(gpu.upload(each) for each in border_of(_outward(mesh), topology, slabs, bare))


def _outward(mesh):
    """Faces [F, 3], counter-clockwise seen from where their normals point: not all files wind them so."""
    a, b, c = (mesh.positions[mesh.faces[:, k]].astype(float) for k in range(3))
    against = (np.cross(b - a, c - a) * mesh.normals[mesh.faces].sum(1)).sum(1) < 0
    return np.where(against[:, None], mesh.faces[:, ::-1], mesh.faces)


def bend(gpu: Any, mesh: Any, packed: np.void, pattern: Pattern, topology: Topology,
         sides: tuple[Any, Any] | None = None, lean: Any = None) -> Shell:
    """Bend the hairs of a pattern -> `Shell`; ``sides``: what `border` gave, if it is there already; ``lean``: as
    `Shells.lean`."""
    triangles, starts = sides or border(gpu, mesh, packed, topology)
    shell = Shell.empty(gpu, _rows_of(packed, len(mesh.positions), len(mesh.faces)), pattern=pattern,
                        normals=gpu.upload(as_float4(mesh.normals)), triangles=triangles, border=starts,
                        longest=mesh.longest_edge + 2 * float(packed["size"][0]))
    there = shell.normals if lean is None else gpu.rows(lean, 0, len(lean))
    gpu.launch("shells.bend", len(mesh.positions), shells=packed, positions=gpu.upload(as_float4(mesh.positions)),
               normals=shell.normals, leaning=int(lean is not None), lean=there, curves=shell.curves)
    return shell


def deposit(gpu: Any, grid: np.void, shell: Shell, packed: np.void, method: str, weight: int,
            cells: Any = None) -> Any:
    """Put shell fur into a `layout.Grid` -> [nz, ny, nx] uint32: how often a ray of light is expected to enter hair.

    ``method``: "binary", where a cell that holds hair is crossed once, or another.  ``weight``: what one crossing adds;
    see `bounds_of`.  ``cells``: [nz, ny, nx] uint32 to add to.
    """
    nx, ny, nz, _ = (int(n) for n in grid["size"])
    cells = CELLS.empty(gpu, (nz, ny, nx)) if cells is None else cells
    pattern, deep = shell.pattern, 1 / float(np.linalg.norm(grid["to_grid"][:3, 2]))
    step = layout.CONSTANTS["POINT_STEP"] * min(float(grid["face"][1] * grid["face"][2]), deep)
    # Beside a spot cells are tiny: hair there may be coarser than they are, else long fur would take hours.
    parts = -(-min(int(shell.longest / step) + 2, MOST_ROWS, 4 * max(nx, ny, nz)) // ROWS)
    gpu.launch("shells.deposit", len(pattern.faces) * parts, shells=packed, grid=grid, faces=pattern.faces,
               curves=shell.curves, lattice=pattern.lattice, means=pattern.means, parts=parts, deep=deep,
               binary=method == "binary", weight=weight, cells=cells)
    return cells


def leave(gpu: Any, sky: np.void, shell: Shell, packed: np.void, opaque: float, there: Held) -> None:
    """Add shell fur to what a sky's grid holds; ``opaque``: optical depth of one crossing."""
    pattern, cell = shell.pattern, layout.CONSTANTS["POINT_STEP"] / float(sky["place"][3])
    slabs = int(packed["kind"][2])
    heights = min(int(float(packed["size"][0]) / (slabs * cell)) + 1, MOST_HEIGHTS)
    gpu.launch("shells.leave", len(pattern.faces) * slabs * heights, shells=packed, sky=sky, faces=pattern.faces,
               curves=shell.curves, lattice=pattern.lattice, means=pattern.means, heights=heights, most=MOST_POINTS,
               opaque=opaque, unit=there.unit, moments=there.moments)


def bounds_of(gpu: Any, shell: Shell) -> tuple[int, float]:
    """(pieces, area [world²]) that shell fur cannot exceed across any light, as `scene.hair_bounds` of strands."""
    pattern = shell.pattern
    lattice, means = gpu.download(pattern.lattice).reshape(-1, 4 * CORNERS).astype(float), gpu.download(pattern.means)
    corners = gpu.download(pattern.faces)[:, :3]
    places = gpu.download(shell.curves)[:, :3].astype(float).reshape(len(shell.normals), -1, 3)
    to_b, to_c = lattice[:, 2:4] - lattice[:, :2], lattice[:, 4:6] - lattice[:, :2]
    a, b, c = (places[corners[:, k]] for k in range(3))
    ab, ac = np.linalg.norm(b - a, axis=2).max(1), np.linalg.norm(c - a, axis=2).max(1)
    high = np.linalg.norm(np.diff(places[0], axis=0), axis=1).sum()
    # Hair seen from the side, and what it covers of the skin seen from above: no more than `deposit` makes of them.
    side = means[:, 1].max() * high * (np.linalg.norm(to_b, axis=1) * ac + np.linalg.norm(to_c, axis=1) * ab)
    return len(corners), float((0.5 * (side + ab * ac)).sum())


def outputs(gpu: Any, view: np.void, shell: Shell, visible: Any, transmittance: Any, shell_front: Any,
            known: dict[str, Any]) -> dict[str, Any]:
    """Put the outputs (AOVs) of the fur over those of ``visible``, [rows, width, samples] uint64.

    Where half of the nearest fur's light is gone before all else: depth, id -3, tangent, the hair's direction, normal,
    across it, and uv of its root.  coverage: what alpha is.  ``transmittance``: [rows, width, samples] float32, the
    share of light that comes from what ``visible`` holds.  ``shell_front``: [rows, width, samples] uint64, what
    `march.march` gave, or `coverage.resolve` where strands are transparent.
    ``known``: {name: [rows, width(, n)]}, what `shade` gave.
    """
    rows, width, _ = visible.shape
    n = len(shell.normals)
    gpu.launch("shells.outputs", rows * width, view=view, slabs=len(shell.curves) // n - 1, visible=visible,
               shell_front=shell_front, transmittance=transmittance, faces=shell.pattern.faces, curves=shell.curves,
               uv=shell.pattern.uv, **{f"out_{name}": array for name, array in known.items()})
    return known
