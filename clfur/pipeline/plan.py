"""How a scene is cut to fit a device: how much there is of everything, in which parts and bands.  On the host alone.

One thing is asked of a device: where strands are spread by area and the faces do not fit it at once, the areas of runs
of faces, in its integers (`Plan._areas`).  It costs a tessellation of the mesh, and is kept.
"""

import contextlib
import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import layout
from ..errors import Error
from ..scene import Curves, Strands
from ..scene.maps import planes
from ..scene.remembered import remembered
from ..stages.blur import blur_radius
from ..stages.chiang import lobed
from ..stages.coverage import OF_KEPT, OF_KEPT_MASKED, OF_WALKED, OF_WALKED_MASKED, REACH, TILE, WALKED
from ..stages.shade import IMAGE
from ..stages.shells import Topology, pack, topology_of
from ..stages.strands import SORTED_FROM, area_sums, first_strand_at
from ..stages.tessellate import counts_of, levels_of, tessellate
from . import dividing, sizes
from .mattes import TOLD
from .shadows import DeepPlan, plan_deep
from .sliding import sliding_of
from .views import Rig, columns_of

SLAB = 1 << 9                           # segments in a slab of depth, at least
NUMBERS = 2**32 - 1                     # entries that a band can tell apart
LISTS = 1 << 28                         # of segments in tiles at a time, at most: with more a band is no faster
LOOK, LOOK_AT_ONCE, SLOTS = (layout.CONSTANTS[name] for name in ("LOOK", "LOOK_AT_ONCE", "SLOTS"))
DENSE = 16                              # of these a pixel from which on only segments that are seen get light
BAND = 1 << 29                          # of the picture at a time: to clear it is a job that Ctrl-C must wait for


@dataclass(frozen=True)
class Part:
    """Faces and strands that are on the device together.

    faces, strands: (first, one past the last).  area: (integer area before these faces, of all), where there are more
    faces and roots are spread by area.  body: whether the faces are drawn, not only grown on.
    """

    faces: tuple = (0, 0)
    strands: tuple = (0, 0)
    area: tuple | None = None
    body: bool = False

    @property
    def hairy(self) -> bool:
        """Whether it has strands."""
        return self.strands[1] > self.strands[0]


@dataclass(frozen=True)
class Cut:
    """How a device's memory is divided: [`Part`], and bytes for the rows of the picture that are drawn at a time."""

    parts: list
    rows: int


class Plan:
    """What a frame takes, and how it fits a device.

    before: `Plan` of the scene from which motion vectors lead here, or None.  view: `layout.View` of what is drawn for
    a region.  size: columns and rows of that, from `left` and `top` on.
    wants_color, others: whether color is an output, and whether others are.  tells: outputs of `mattes.TOLD`.
    faces, triangles, strands, points: how many there are.  body: whether there is one.  rest: the mesh by whose areas
    strands are spread, if it is another.  guides: Curves on the host between which strands stand, or None.
    sliding: `Sliding` of strands along the body, or None.  lobed: the types of strands, where looks of some need
    tables.  ground: `layout.Ground`, or None.  held: whether the body is a holdout.  painted: its Materials, where it
    has more than one colour.
    """

    def __init__(self, rig: Rig, outputs: Sequence[str], region: tuple | None = None,
                 before: "Plan | None" = None, aside: int = 0) -> None:
        """``region``: (column, row, columns, rows) that are wanted of the picture, all if None.  ``before``: of the
        scene from which motion vectors lead here.  ``aside``: bytes on the device that are something else's."""
        self.rig, self.scene, self.settings = rig, rig.scene, rig.settings
        self.before, self.aside = before, aside
        self.region = region or (0, 0, *self.scene.camera.size)
        around = 0 if self.settings.blur == "off" else blur_radius(self.settings.blur_sigma)
        (self.left, right), (self.top, self.bottom) = (   # whole tiles, and what blurs need
            (max(at - around, 0) // TILE * TILE, min(-(-(at + n + around) // TILE) * TILE, most))
            for at, n, most in zip(self.region[:2], self.region[2:], self.scene.camera.size))
        self.view, self.size = columns_of(rig.view, self.left, right), (right - self.left, self.bottom - self.top)
        self.wants_color, self.others = "color" in outputs, bool(set(outputs) - {"color", *TOLD})
        self.tells = tuple(name for name in TOLD if name in outputs)
        mesh, fur = self.scene.mesh, self.scene.strands
        self.ground, self.held = rig.ground, self.scene.body == "holdout"
        if self.seen_through and "coverage" in outputs:   # only light tells it
            self.wants_color = True
        self.grown = isinstance(fur, Strands)
        self.rest, self.sliding = None, None
        self.guides = None if not isinstance(fur, Strands) or fur.guides is None else fur.guides.on_host
        if isinstance(fur, Strands) and fur.roots != "faces" and fur.rest is not mesh:
            self.rest = fur.rest
        self.body = mesh is not None and self.scene.body_color is not None
        self.lobed = lobed(fur.hair_types, fur.hairy) if self.wants_color and fur is not None else ()
        color = self.scene.body_color
        self.painted = color if isinstance(color, tuple) and self.wants_color and not self.held else ()
        if self.settings.scattering != "off":
            self._check_scattering()
        self.levels = (1, 1, "flat") if fur is None else (fur.inner, fur.outer, fur.surface)
        self.faces = len(mesh.faces) if mesh is not None and (self.body or self.grown) else 0
        # Running sums: vertices and triangles before each face, points before each of the user's strands, and of all.
        self._vertices, self._triangles = _sums(fur, self.faces)
        self._before = _points_of(fur) if isinstance(fur, Curves) else np.zeros(1, np.int64)
        self.triangles = int(self._triangles[-1])
        if isinstance(fur, Strands):
            self.strands = self.triangles if fur.roots == "faces" else int(fur.roots)
            self.stride = max(t.segments for t in fur.types) + 1
            if fur.collision and self.strands:
                self.sliding = sliding_of(mesh, fur)
        else:
            self.strands = len(self._before) - 1
        self.points = self._points(0, self.strands)
        # What cannot be divided: bytes of the largest face, points of the longest strand.
        surfaces = 1 + bool(self.rest) + bool(before)   # they are there at once
        self._bytes_of_faces = surfaces * (sizes.VERTEX * self._vertices + sizes.TRIANGLE * self._triangles)
        self._face = int(np.diff(self._bytes_of_faces).max(initial=0))
        self.longest = self.stride if self.grown else int(np.diff(self._before).max(initial=0))
        self._cuts: dict[tuple, Cut] = {}
        if self.settings.shadows == "deep":
            self._check_deep()
        if self.points >= 2**31 or self.triangles >= 2**31:
            raise Error(f"the scene has {self.points:,} points of strands and {self.triangles:,} triangles; "
                        f"allowed: fewer than {2**31:,} of each")

    def wanted(self, top: int) -> tuple[slice, slice]:
        """What is wanted of an array of rows that are drawn, from row ``top`` of the picture on."""
        column, row, columns, rows = self.region
        left = column - self.left
        return slice(max(row - top, 0), max(row + rows - top, 0)), slice(left, left + columns)

    @property
    def kernel_files(self) -> list[str]:
        """Files of the kernels that the frame runs, about in the order in which it does; last those that take longest
        to build, with which another process begins."""
        settings, shells = self.settings, self.scene.shells is not None
        casting = self.wants_color and any(grid is not None for grid in self.rig.grids) and bool(self.strands or shells)
        needed = {
            "tessellate": self.faces, "raster": True, "strands": self.strands,
            "maps": self.planes and self.strands, "distance": self.sliding,
            "order": not self.grown and self.strands >= SORTED_FROM,
            "guides": self.guides is not None, "tufts": self.strands and self.tufted,
            "lod": self.strands and settings.lod, "voxelize": casting, "shells": shells,
            "ground": self.ground is not None,
            "zscan": casting, "discs": casting and any(light.size for light in self.scene.lights),
            "march": shells, "chiang": self.lobed, "transport": self.scatters, "bounce": self.scatters,
            "deep": self.is_deep,
            "strand_light": self.uses_coverage and self.wants_color,
            "shade": True, "sky": self.scatters or (self.wants_color and self.scene.environment is not None),
            "mattes": self.tells and self.strands, "flow": self.before,
            "blur": self.wants_color and settings.blur != "off",
            "masks": self.uses_coverage and settings.masks, "coverage": self.uses_coverage}
        return [name for name, is_needed in needed.items() if is_needed]

    @property
    def tufted(self) -> bool:
        """Whether strands gather in tufts or are frizzy."""
        return isinstance(self.scene.strands, Strands) and self.scene.strands.tufted

    @property
    def of_kept(self) -> int:
        """Of `coverage.KEPT` in a tile."""
        return OF_KEPT_MASKED if self.settings.masks else OF_KEPT

    @property
    def scatters(self) -> bool:
        """Whether light is followed from hair to hair."""
        return bool(self.settings.scattering != "off" and self.lobed)

    @property
    def uses_coverage(self) -> bool:
        """Whether strands are drawn by the area that they cover."""
        return self.settings.raster == "coverage" and self.strands > 0

    @property
    def seen_through(self) -> bool:
        """Whether samples of body or ground hide what is behind them, but do not cover the picture by themselves."""
        return self.held or self.ground is not None

    def _check_scattering(self) -> None:
        """Raise `clfur.Error` for what does not go with light that goes from hair to hair."""
        types = () if self.scene.strands is None else self.scene.strands.hairy_types
        other = next((f"the look of hair is {kind.look.model}" for kind in types if kind.look.model != "chiang"), "")
        if self.scene.shells is not None or self.scene.strands is None:
            other = "the scene has shells" if self.scene.shells is not None else "there are no strands"
        if other:
            raise Error(f"Settings.scattering is {self.settings.scattering!r}, but {other}; allowed: 'off', or "
                        f"clfur.Chiang for all strands (--look chiang), without shells")

    def _check_deep(self) -> None:
        """Raise `clfur.Error` for what does not go with "deep"."""
        others = {"the scene has shells": self.scene.shells,
                  "a light has a size": any(light.size and light.casts for light in self.scene.lights)}
        for what, there in others.items():
            if there:
                raise Error(f"Settings.shadows is 'deep', but {what}; allowed: 'length', or 'deep' without")

    @property
    def is_deep(self) -> bool:
        """Whether pieces of strands that are seen look at single hairs before lights."""
        return self.wants_color and self.uses_coverage and self.settings.shadows == "deep"

    @property
    def warnings(self) -> list[str]:
        """What is known to be wrong in the picture."""
        return self.rig.warnings

    @functools.cached_property
    def deep(self) -> DeepPlan:
        """`DeepPlan` of it."""
        return plan_deep(self.rig, self.strands)

    def light_key(self, lod: float = 0.0) -> tuple:
        """What light depends on that falls on anything, or on strands thinned so, as a key of `Scheduler.keep`."""
        scene, settings = self.scene, self.settings
        fit = b"".join(each.tobytes() for each in (*self.rig.grids, *self.rig.light_views) if each is not None).hex()
        return (scene.mesh, scene.strands, scene.shells, scene.environment, *scene.lights, int(self.body),
                settings.shadows, settings.grid, settings.shadow_map, settings.pcf, settings.scattering, str(lod),
                scene.camera if lod else None, fit)

    def _points(self, first, end):
        """Points set aside for a run of strands."""
        return (end - first) * self.stride if self.grown else int(self._before[end] - self._before[first])

    # --- rows ---------------------------------------------------------------------------------------------------

    def rows(self, gpu: Any) -> int:
        """How many rows of the picture fit a device at a time: all that is told of their pixels, or, where strands are
        drawn by what they cover, what it takes to count them."""
        width, height = self.size
        room = min(self.cut(gpu).rows, BAND) // (width * sizes.of_pixel(self, False))
        rows = min(room, sizes.largest(gpu) // sizes.of_largest_row(self))
        return int(height if rows >= height else max(rows // self._fewest, 1) * self._fewest)

    def rows_to_blur(self, gpu: Any) -> int:
        """How many rows of the picture can be blurred at a time, with those around them."""
        width, height = self.size
        return int(min(min(self.cut(gpu).rows, BAND) // (3 * IMAGE.bytes * width), height))

    def parts(self, gpu: Any, strands: tuple[int, int] | None = None, body: bool = True) -> list[Part]:
        """[`Part`] of the scene or a share: some ``strands``, (first, one past the last), with ``body`` or without."""
        return self.cut(gpu, strands, body).parts

    def cut(self, gpu: Any, strands: tuple[int, int] | None = None, body: bool = True) -> Cut:
        """`Cut` of the scene or a share of it, see `parts`, before the pieces of strands in pixels are counted."""
        known = gpu, strands, body
        if known not in self._cuts:
            width, height = self.size
            row = width * sizes.of_pixel(self, False)
            self._cuts[known] = self._cut(gpu, height * row, min(self._fewest, height) * row, strands, body)
        return self._cuts[known]

    def cut_counted(self, gpu: Any, counts: np.ndarray, survivors: int) -> Cut:
        """`Cut` for rows of tiles of which is known how many segments of strands each tile lists, ``counts`` [rows of
        tiles, across], and how many ``survivors`` there are in all."""
        width, fullest = self.size[0], int(counts.max())
        if fullest > min(sizes.largest(gpu) // REACH.bytes, NUMBERS):
            raise Error(f"{gpu.name} has no room for {fullest:,} segments of strands in {TILE} x {TILE} pixels; "
                        f"allowed: fewer strands, or Settings.raster 'samples'")
        row, listed = TILE * width * sizes.of_pixel(self, True), int(counts.sum(dtype=np.int64))
        some, least = min(fullest, max(SLAB, fullest // 32)), REACH.bytes * fullest
        rows = len(counts) * row + max(min(sizes.of_lists(self, listed, survivors), LISTS), least)
        with contextlib.suppress(Error):
            return self._cut(gpu, rows, row + max(min(sizes.of_lists(self, fullest, survivors), LISTS), least))
        row += max(sizes.of_lists(self, some, survivors), least)   # slabs of depth
        return self._cut(gpu, rows, row, pieces=fullest)

    def rows_counted(self, gpu: Any, cut: Cut, counts: np.ndarray, survivors: int, top: int) -> int:
        """How many of these rows, counted as for `cut_counted`, fit at a time from row ``top`` of them on, a tile's
        first, with all that their tiles list; the least if none do."""
        listed = np.cumsum(counts[top // TILE:].sum(1, dtype=np.int64))
        rows = TILE * np.arange(1, len(listed) + 1)
        row = self.size[0] * sizes.of_pixel(self, True)
        reaches = REACH.bytes * np.maximum.accumulate(counts[top // TILE:].max(1).astype(np.int64))
        lists = np.maximum(np.minimum(sizes.of_lists(self, listed, survivors), LISTS), reaches)
        fits = (row * rows + lists <= cut.rows) & (row * rows <= BAND)
        fits &= sizes.of_largest_row(self) * rows <= sizes.largest(gpu)
        return TILE * max(int(fits.sum()), 1)

    def windows(self, gpu: Any, cut: Cut, counts: np.ndarray, survivors: int) -> list[tuple[int, int]]:
        """[(first tile, one past the last)] of these rows of tiles, of which so many list segments at a time as fit."""
        return dividing.runs((dividing.before(counts.ravel()), self.most_listed(gpu, cut, counts, survivors)))

    def waits(self, gpu: Any, cut: Cut, counts: np.ndarray) -> bool:
        """Whether light of segments, so many listed in a band's tiles, waits till it is known which are seen."""
        if sum(part.hairy for part in cut.parts) != 1:
            return False
        dense = counts.sum(dtype=np.int64) > DENSE * TILE**2 * np.count_nonzero(counts)
        return bool(dense and self.wants_color and max(gpu.lanes, gpu.hinted) > 1)

    def most_listed(self, gpu: Any, cut: Cut, counts: np.ndarray, survivors: int) -> int:
        """How many segments may be listed at a time where so many in these rows of tiles are; a tile that has more is
        drawn in slabs of depth."""
        room = cut.rows - TILE * self.size[0] * sizes.of_pixel(self, True) * len(counts)
        each = sizes.of_survivor(self)
        if room >= LISTS and self.waits(gpu, cut, counts):   # there is room, and about a third are lit at a time
            each = sizes.SURVIVOR + sizes.SEEN + (each - sizes.SURVIVOR) // 3
        most = min(sizes.fitting(min(room, LISTS), each, survivors), sizes.largest(gpu) // 8, NUMBERS)
        largest = sizes.largest(gpu) // max(sizes.SURVIVOR, sizes.LIT, sizes.PLACES * self.sources)
        return int(min(most, largest) if survivors > largest else most)

    def too_many(self, gpu: Any, pieces: int) -> Error:
        """What to raise where so many segments of strands in one tile cannot be divided."""
        return Error(self._too_much(gpu, pieces))

    @property
    def _fewest(self):
        """Rows of the picture that are drawn at a time, at least."""
        return TILE if self.uses_coverage else 1

    @property
    def around(self) -> int:
        """Sources of strands' light beside lights: what comes from hair to hair, with a sky's; a sky, and `even`."""
        sky = self.scene.environment is not None and not self.scatters
        return int(self.scatters) + int(sky or self.even > 0)

    @functools.cached_property
    def even(self) -> float:
        """Ambient light on strands that does not go with that of a light, as it does where hair hides both at once."""
        return float(sum(light["color"][3] for light in self.rig.lights)) if self.is_deep else 0.0

    @property
    def sources(self) -> int:
        """Of strands' light: lights, and what there is beside."""
        return len(self.scene.lights) + self.around

    # --- memory -------------------------------------------------------------------------------------------------

    def _cut(self, gpu, rows, row, strands=None, body=True, pieces=0):
        """`Cut` for a picture that takes ``rows`` bytes in all and ``row`` at least, in a row of so many ``pieces``.

        Raises `clfur.Error` if the least there is does not fit.
        """
        first, end = strands or (0, self.strands)
        strand, point = sizes.of_strand_and_point(self, gpu)
        width, height = self.size
        if self.settings.blur != "off":
            blurred = min(2 * blur_radius(self.settings.blur_sigma) + 1, height) * 3 * IMAGE.bytes * width
            rows, row = max(rows, 3 * IMAGE.bytes * width * height), max(row, blurred)
        need = {"body": int(self._bytes_of_faces[-1]), "rows": rows,
                "strands": (end - first) * strand + self._points(first, end) * point}
        least = {   # of each; a face or a strand is never divided
            "body": min(need["body"], max(self._face, 1 << 16)),
            "strands": min(need["strands"], max(strand + self.longest * point, 1 << 16)),
            "rows": row,
        }
        kept = sizes.of_transmittance(self) * self.points * self.keeps_transmittances(gpu)
        of_walked = OF_WALKED_MASKED if self.settings.masks else OF_WALKED
        walked = of_walked * WALKED.bytes * bool(gpu.steps and self.uses_coverage)
        spare = sizes.memory(self, gpu)[0] * 15 // 16 - self._fixed - sum(least.values()) - kept - walked
        room = dividing.share(spare, {name: need[name] - least[name] for name in need})
        room = {name: least[name] + room[name] for name in need}
        if spare < 0 or sizes.of_largest_row(self) > sizes.largest(gpu):
            raise Error(self._too_much(gpu, pieces))
        return Cut(self._parts(gpu, room, first, end, body and self.body), room["rows"])

    def _too_much(self, gpu, pieces):
        settings, (width, height) = self.settings, self.size
        fewest = 1 if settings.blur == "off" else min(2 * blur_radius(settings.blur_sigma) + 1, height)
        shells = sizes.of_shells(self)
        furry = f"shells of {shells / 2**20:,.1f} MiB, " * bool(shells)
        fewest = min(max(fewest, self._fewest), height)
        lines = "a row" if fewest == 1 else f"{fewest} rows"
        dense = f" with {pieces:,} segments of strands in {TILE} x {TILE} of them" * bool(pieces)
        smaller = "smaller ones" + ", or Settings.raster 'samples'" * bool(pieces)
        memory, limit = sizes.memory(self, gpu)
        furry += f"{self.deep.entries:,} segments of hair in lists of what lights see, " if self.is_deep else ""
        return (f"{gpu.name} with {memory / 2**20:,.1f} MiB{f' ({limit})' * bool(limit)} has no room for "
                f"Settings.grid {settings.grid}, Settings.shadow_map {settings.shadow_map}, {self.faces:,} faces of up "
                f"to {self._face / 2**20:,.1f} MiB, strands of up to {self.longest:,} points, {furry}"
                f"and {lines} of {width} pixels{dense}; allowed: {smaller}")

    @property
    def planes(self) -> tuple | None:
        """What the skin says of the strands that grow on it, `scene.maps.planes`; None where nothing."""
        fur = self.scene.strands
        if not isinstance(fur, Strands) or not (fur.maps or fur.comb):
            return None
        return planes(self.scene.mesh, fur.maps, fur.comb)

    @functools.cached_property
    def _fixed(self):
        """Bytes on the device of what is never divided."""
        return sizes.of_fixed(self)

    def check(self, gpu: Any) -> None:
        """Raise `clfur.Error` where a device that ends long loops, silently, could end those over lights."""
        settings, lights = self.settings, self.scene.lights
        if not gpu.steps or not self.wants_color or len(lights) == 1:   # one is never too many
            return
        maps = sum(light.casts for light in lights) * (settings.shadows != "off" and bool(settings.shadow_map))
        side = 2 * settings.pcf + 1
        look = side * (side // LOOK_AT_ONCE + 2) + LOOK
        sample, piece = len(lights) * 4 + maps * look, len(lights) * 12 + maps * 2 * look
        slots = SLOTS * self.uses_coverage
        if sample * settings.samples > gpu.steps * 3 // 4 or piece * slots > gpu.steps // 2:
            raise Error(f"Scene.light has {len(lights)} lights and Settings.pcf is {settings.pcf}, which take longer "
                        f"loops than {gpu.name} ends; allowed: fewer lights, or with shadows=False, or a smaller pcf")

    def keeps_transmittances(self, gpu: Any) -> bool:
        """Whether there is room for the transmittances to all points of strands: then they are asked once for all bands
        of the picture, and for frames in which only the camera moves."""
        shadowed = self.uses_coverage and self.settings.shadows != "off"
        return shadowed and sizes.of_transmittance(self) * self.points <= sizes.memory(self, gpu)[0] // 8

    # --- parts --------------------------------------------------------------------------------------------------

    def _parts(self, gpu, room, first, end, body):
        """[`Part`] of some strands, ``first`` to ``end``, and of the ``body``, each within its ``room``."""
        piece = sizes.largest(gpu)
        face_runs = [run for run in dividing.runs(
            (self._bytes_of_faces, room["body"]),
            (self._vertices, piece // 16), (self._triangles, piece // 16)) if run[1] > run[0]]
        if self.grown:
            return self._parts_that_grow(gpu, face_runs, room["strands"], first, end, body)
        strand, point = sizes.of_strand_and_point(self, gpu)
        before = self._before[first:end + 1]
        hair = [Part(strands=(first + a, first + b)) for a, b in dividing.runs(
            (strand * np.arange(len(before)) + point * before, room["strands"]), (before, piece // 16))]
        bodies = [Part(faces=run, body=True) for run in face_runs] if body else []
        if len(hair) == len(bodies) == 1:
            return [Part(faces=bodies[0].faces, strands=hair[0].strands, body=True)]
        return bodies + hair or [Part()]

    def _parts_that_grow(self, gpu, face_runs, room, first, end, body):
        strand, point = sizes.of_strand_and_point(self, gpu)
        parts, areas = [], [None] * len(face_runs)
        most = max(min(room // (strand + point * self.stride), sizes.largest(gpu) // (16 * self.stride)), 1)
        if self.scene.strands.roots == "faces":
            runs = [(int(self._triangles[b]), int(self._triangles[e])) for b, e in face_runs]
        elif len(face_runs) == 1:
            runs = [(0, self.strands)]
        else:
            sums, fur = self._areas(gpu, face_runs), self.scene.strands
            before, total = [int(sums[b]) for b, _ in face_runs], int(sums[-1])
            areas = [(a, total) for a in before]
            edges = [first_strand_at(a, fur, total) if self.strands else 0 for a in before] + [self.strands]
            runs = list(itertools.pairwise(edges))
        for faces, area, (begin, until) in zip(face_runs, areas, runs):
            pieces = dividing.pieces(max(begin, first), min(until, end), most) or ([(first, first)] if body else [])
            parts += [Part(faces, piece, area, body and n == 0) for n, piece in enumerate(pieces)]
        return parts or [Part()]

    def _areas(self, gpu, face_runs):
        """Area before each face, and of all, in the integers of strands.cl; asked for some runs of them at a time."""
        mesh = self.rest or self.scene.mesh
        return gpu.keep("areas", (mesh, *self.levels), functools.partial(
            _areas_of, gpu, mesh, self.levels, face_runs, self._triangles))

    # --- shells -------------------------------------------------------------------------------------------------

    @functools.cached_property
    def topology(self) -> Topology:
        """`Topology` of the mesh, on the host."""
        return _topology(self.scene.mesh)

    @functools.cached_property
    def packed_shells(self) -> np.void:
        """What `stages.shells.pack` gives of the scene's shells."""
        scene = self.scene
        return pack(scene.shells, scene.mesh, scene.body_color is None, self.settings.filtered)


@remembered(2)   # a film asks for the same again in every frame
def _topology(mesh):
    return topology_of(mesh.faces)


@remembered(2)
def _sums(fur, faces):
    """Vertices and triangles before each of so many faces, and of all, as these strands have them divided."""
    levels = (1, 1) if fur is None else (fur.inner, fur.outer)
    vertices, triangles = counts_of(levels_of(*levels, faces)) if faces else ([], [])
    return dividing.before(vertices), dividing.before(triangles)


@remembered(2)
def _points_of(curves):
    return dividing.before(curves.counts)


def _areas_of(gpu, mesh, levels, face_runs, triangles):
    for name in "body", "resting", "strands", "thinned":   # of another scene: these areas take as much as a body
        gpu.keep(name, (), dict)
    sums = np.zeros(len(triangles), np.uint64)
    for begin, end in face_runs:
        within = gpu.download(area_sums(gpu, tessellate(gpu, mesh, *levels, (begin, end)))[0])
        last = (triangles[begin + 1:end + 1] - triangles[begin]).astype(np.int64) - 1   # triangle of each face
        sums[begin + 1:end + 1] = sums[begin] + within[last]
    return sums
