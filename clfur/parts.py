"""What of a scene is made and drawn at a time, so that it fits the device."""

from dataclasses import dataclass

import numpy as np

from .errors import Error
from .scene import Curves, Strands
from .stages.blur import reach_of
from .stages.coverage import COUNTED, RADIANCE_SUMS, REACHED, Fragments, Resolved
from .stages.lod import THINNED, thin
from .stages.march import Rays
from .stages.raster import VISIBLE
from .stages.shade import IMAGE, About, Shadows
from .stages.shells import bend, border, lay, pack, size_of, topology_of
from .stages.strands import AREA, Grown, Packed, Roots, area_of, bring, first_strand_at, grow, no_strands
from .stages.tessellate import Source, Surface, counts_of, levels_of, no_surface, tessellate
from .stages.voxelize import CELLS
from .views import view_of

# Bytes on the device, of all arrays that stages make, as they declare them.
VERTEX, TRIANGLE = Surface.bytes(vertex=1), Surface.bytes(triangle=1) + AREA.bytes
POINT, STRAND = Grown.bytes(point=1), Grown.bytes(strand=1, color=1) + Roots.bytes(strand=1)
PACKED = Packed.bytes(point=1, width=1, color=1) + Grown.bytes(color=1)   # more a point, of strands of the user's
THIN_POINT, THIN_STRAND = Grown.bytes(*THINNED, point=1), Grown.bytes(*THINNED, strand=1)
THIN_COLOR = Grown.bytes("colors", color=1)                               # where points have colours
MESH_VERTEX, MESH_FACE = Source.bytes(mesh_vertex=1), Source.bytes(face=1, corner=3, end=2)
PIXEL = COUNTED.bytes + Fragments.bytes(pixel=1) + Resolved.bytes(pixel=1) + RADIANCE_SUMS.bytes
FRAGMENT = Fragments.bytes(fragment=1)
KNOWN = About.bytes(pixel=1)            # of a pixel but its colour
PIECES = 32                             # of strands that there is room for in each pixel, at least
NUMBERS = 2**32 - 1                     # pieces that a band can tell apart
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


class Work:
    """What a scene consists of, counted on the host: faces, triangles, strands."""

    def __init__(self, gpu, scene):
        self.scene, mesh, fur = scene, scene.mesh, scene.strands
        self.grown = isinstance(fur, Strands)
        self.body = mesh is not None and scene.body_color is not None
        self.levels = (1, 1, "flat") if fur is None else (fur.inner, fur.outer, fur.surface)
        self.faces = len(mesh.faces) if mesh is not None and (self.body or self.grown) else 0
        # Running sums over the faces: vertices and triangles before each, and of all.
        self.vertices, self.triangles = gpu.keep("sums", (mesh, *self.levels, self.faces), self._sums)
        if self.grown:
            self.strands = int(self.triangles[-1]) if fur.roots == "faces" else fur.roots
            self.stride = max(t.segments for t in fur.types) + 1
        else:
            self.strands = len(fur.counts) if isinstance(fur, Curves) else 0
            self.before = gpu.keep("points", (fur,), lambda: _before(fur.counts)) if self.strands else np.zeros(1, int)
        self.points = self._points(0, self.strands)
        # What cannot be divided: bytes of the largest face, points of the longest strand.
        face = VERTEX * self.vertices + TRIANGLE * self.triangles
        self.face = int(np.diff(face).max(initial=0))
        self.longest = self.stride if self.grown else int(np.diff(self.before).max(initial=0))
        if self.points >= 2**31 or self.triangles[-1] >= 2**31:
            raise Error(f"the scene has {self.points:,} points of strands and {self.triangles[-1]:,} triangles; "
                        f"allowed: fewer than {2**31:,} of each")

    def _sums(self):
        vertices, triangles = counts_of(levels_of(*self.levels[:2], self.faces)) if self.faces else ([], [])
        return _before(vertices), _before(triangles)

    def _points(self, first, end):
        """Points set aside for a run of strands."""
        return (end - first) * self.stride if self.grown else int(self.before[end] - self.before[first])

    def covering(self, settings):
        """Whether strands are drawn by the area that they cover."""
        return settings.raster == "coverage" and self.strands > 0

    def plan(self, gpu, settings, others, strands=None, body=True, pieces=0):
        """How this fits a device -> ([`Part`], rows of the picture to draw at a time).

        ``others``: whether outputs but color are drawn.  ``strands``: which, (first, one past the last), if not all;
        ``body``: whether the body is drawn, if there is one.  ``pieces``: of strands that a row is known to hold.
        Raises `clfur.Error` if the least there is does not fit.
        """
        first, end = strands or (0, self.strands)
        scene, width, height = self.scene, *self.scene.camera.size
        piece = gpu.largest * 7 // 8                      # the pool rounds arrays up, by up to a sixteenth
        fixed = Shadows.bytes(sample=settings.shadow_map**2) + self.faces * MESH_FACE
        if scene.mesh is not None:
            fixed += len(scene.mesh.positions) * MESH_VERTEX
        if settings.shadows != "off" and (self.strands or scene.shells):
            fixed += CELLS.bytes * settings.grid**3 + Shadows.bytes(layer=(settings.grid + 1) * settings.grid**2)
        row = width * (VISIBLE.bytes * settings.samples + IMAGE.bytes + KNOWN * bool(others))
        if self.covering(settings):
            row += width * (PIXEL + Resolved.bytes(sample=settings.samples)) + self._row_pieces(pieces) * FRAGMENT
        shells = 0
        if scene.shells:
            shells = size_of(scene.mesh, self._pack(settings)[0], self.topology(gpu))
            fixed += shells
            row += width * settings.samples * (VISIBLE.bytes + Rays.bytes(sample=1))   # where they enter
        fewest = 1                                        # rows of the picture that are blurred at a time
        if settings.blur != "off":
            row, fewest = max(row, width * 3 * IMAGE.bytes), min(2 * reach_of(settings.blur_sigma) + 1, height)
        strand, point = self._bytes(settings)
        need = {
            "body": VERTEX * int(self.vertices[-1]) + TRIANGLE * int(self.triangles[-1]),
            "strands": (end - first) * strand + self._points(first, end) * point,
            "rows": height * row,
        }
        least = {   # of each; a face or a strand is never divided
            "body": min(need["body"], max(self.face, 1 << 16)),
            "strands": min(need["strands"], max(strand + self.longest * point, 1 << 16)),
            "rows": max(row, fewest * width * 3 * IMAGE.bytes),
        }
        spare = gpu.memory * 15 // 16 - fixed - sum(least.values())
        room = _share(spare, {name: need[name] - least[name] for name in need})
        room = {name: least[name] + room[name] for name in need}

        largest = width * max(VISIBLE.bytes * settings.samples, IMAGE.bytes)
        rows = min(min(room["rows"], BAND) // row, piece // largest, height)
        if rows < 1 or spare < 0:
            furry = f"shells of {shells / 2**20:,.1f} MiB, " * bool(shells)
            lines = "a row" if fewest == 1 else f"{fewest} rows"
            dense = f" with {pieces:,} pieces of strands" * bool(pieces)
            smaller = "smaller ones" + ", or Settings.raster 'samples'" * bool(pieces)
            raise Error(f"{gpu.name} with {gpu.memory / 2**20:,.1f} MiB has no room for Settings.grid {settings.grid}, "
                        f"Settings.shadow_map {settings.shadow_map}, {self.faces:,} faces of up to "
                        f"{self.face / 2**20:,.1f} MiB, strands of up to {self.longest:,} points, {furry}"
                        f"and {lines} of {width} pixels{dense}; allowed: {smaller}")
        face_runs = [run for run in _runs(
            (VERTEX * self.vertices + TRIANGLE * self.triangles, room["body"]),
            (16 * self.vertices, piece), (16 * self.triangles, piece)) if run[1] > run[0]]
        parts = self._parts(gpu, face_runs, room["strands"], strand, point, piece, first, end, body and self.body)
        return parts, int(rows)

    def _bytes(self, settings):
        """Bytes on the device of a strand and of each of its points."""
        strand, point = (STRAND, POINT) if self.grown else (STRAND, POINT + PACKED)
        if settings.lod:
            fur = self.scene.strands
            per_point = isinstance(fur, Curves) and len(fur.color) == len(fur.points)
            strand, point = strand + THIN_STRAND, point + THIN_POINT + THIN_COLOR * per_point
        if self.covering(settings):                         # how much light reaches it
            point += REACHED.bytes
        return strand, point

    def _row_pieces(self, known):
        """Pieces of strands that there is room for in a row."""
        return max(self.scene.camera.size[0] * PIECES, known)

    def too_many(self, gpu, settings, counted, plan, known, after):
        """Whether a band of the picture has more pieces of strands than fit, and must be cut or planned anew.

        ``counted``: [rows of the band, width, 2] what `coverage.count` counted.  ``plan``: what `plan` gave for the
        pieces ``known``.  ``after``: bytes that will be needed beside what is known of pixels.
        Raises `clfur.Error` for a row that no plan makes room for.
        """
        (parts, rows), (height, width) = plan, counted.shape[:2]
        most, pieces = rows * self._row_pieces(known), int(counted[..., 1].sum(dtype=np.int64))
        if len(parts) == 1:   # nothing else will come
            after += height * width * (PIXEL + IMAGE.bytes + KNOWN + Resolved.bytes(sample=settings.samples))
            most = max(most, (gpu.room - after) * 7 // 8 // FRAGMENT)
        limit = min(gpu.largest * 7 // 8 // FRAGMENT, NUMBERS)
        if height == 1 and pieces > limit:
            raise Error(f"{gpu.name} has no room for {pieces:,} pieces of strands in a row of {width} pixels; allowed: "
                        f"a smaller picture, fewer strands, or Settings.raster 'samples'")
        return pieces > min(most, limit)

    def _parts(self, gpu, face_runs, room, strand, point, piece, first, end, body):
        if not self.grown:
            before = self.before[first:end + 1]
            hair = [Part(strands=(first + a, first + b)) for a, b in _runs(
                (strand * np.arange(len(before)) + point * before, room), (16 * before, piece))]
            skin = [Part(faces=run, body=True) for run in face_runs] if body else []
            if len(hair) == len(skin) == 1:
                return [Part(faces=skin[0].faces, strands=hair[0].strands, body=True)]
            return skin + hair or [Part()]
        parts, areas = [], [None] * len(face_runs)
        most = max(min(room // (strand + point * self.stride), piece // (16 * self.stride)), 1)
        if self.scene.strands.roots == "faces":
            runs = [(int(self.triangles[b]), int(self.triangles[e])) for b, e in face_runs]
        elif len(face_runs) == 1:
            runs = [(0, self.strands)]
        else:
            before, total = self._areas(gpu, face_runs)
            areas = [(a, total) for a in before]
            fur = self.scene.strands
            edges = [first_strand_at(a, fur, total) if self.strands else 0 for a in before] + [self.strands]
            runs = list(zip(edges, edges[1:]))
        for faces, area, (begin, until) in zip(face_runs, areas, runs):
            pieces = _pieces(max(begin, first), min(until, end), most) or ([(first, first)] if body else [])
            parts += [Part(faces, piece, area, body and n == 0) for n, piece in enumerate(pieces)]
        return parts or [Part()]

    def _areas(self, gpu, face_runs):
        """(area before each run of faces, area of all), in the integers of strands.cl."""
        mesh = self.scene.mesh

        def build():
            return [int(gpu.download(area_of(gpu, tessellate(gpu, mesh, *self.levels, run)))[0]) for run in face_runs]
        sums = np.cumsum([0] + gpu.keep("areas", (mesh, *self.levels, str(face_runs)), build), dtype=object)
        return [int(a) for a in sums[:-1]], int(sums[-1])

    def make(self, gpu, part, lod=0.0):
        """Bring a part onto the device -> (`Grown`, `Surface` to draw).

        ``lod``: as in `Settings`, of what the camera sees; 0 for all strands there are.
        """
        mesh, fur = self.scene.mesh, self.scene.strands
        surface = gpu.keep("body", (mesh, *self.levels, *part.faces), lambda: (
            tessellate(gpu, mesh, *self.levels, part.faces) if part.faces[1] > part.faces[0] else no_surface(gpu)))
        if part.strands[1] == part.strands[0]:
            strands = gpu.keep("strands", (), lambda: no_strands(gpu))
        else:
            what = (mesh, fur, *part.strands, *part.faces) if self.grown else (fur, *part.strands)

            def whole():
                return gpu.keep("strands", what, lambda: grow(gpu, surface, fur, part.strands, part.area)
                                if self.grown else bring(gpu, fur, part.strands))

            def thinned():   # within the outermost, so that those of another part go before anything new is made
                return lod and thin(gpu, whole(), view_of(self.scene, 1), lod, fur.seed)
            strands = gpu.keep("thinned", (*what, self.scene.camera, str(lod)) if lod else (), thinned) or whole()
        drawn = part.body or part.faces[1] == part.faces[0]
        return strands, surface if drawn else gpu.keep("no body", (), lambda: no_surface(gpu))

    def topology(self, gpu):
        """`Topology` of the mesh, on the host."""
        mesh = self.scene.mesh
        return gpu.keep("topology", (mesh,), lambda: topology_of(mesh.faces))

    def _pack(self, settings):
        return pack(self.scene.shells, self.scene.mesh, self.scene.body_color is None, settings.filtered)

    def make_shell(self, gpu, settings):
        """Bring shell fur onto the device -> (`Shell`, `layout.Shells`); what hasn't changed is kept there."""
        mesh, topology = self.scene.mesh, self.topology(gpu)
        packed, box = self._pack(settings)
        laid = str([box.tolist(), packed["size"].tolist(), packed["shape"].tolist(), packed["kind"][:2].tolist(),
                    packed["noise"][:3].tolist()])
        walls = int(packed["kind"][2]), int(packed["noise"][3])
        bent = str([packed[name].tolist() for name in ("bend", "wind", "gust")])

        def build():   # within the outermost, so that what has changed goes before anything new is made
            pattern = gpu.keep("pattern", (mesh, laid), lambda: lay(gpu, mesh, packed, box, topology))
            sides = gpu.keep("border", (mesh, *walls), lambda: border(gpu, mesh, packed, topology))
            return bend(gpu, mesh, packed, pattern, topology, sides)
        return gpu.keep("shell", (mesh, laid, *walls, bent), build), packed


def _share(room, need):
    """Divide bytes among what needs them: all get the same, those that need less leave theirs to the others."""
    given = {}
    for left, name in zip(range(len(need), 0, -1), sorted(need, key=need.get)):
        given[name] = max(min(need[name], room // left), 0)
        room -= given[name]
    return given


def _before(counts):
    """Running sums: what lies before each, and all."""
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])


def _pieces(begin, end, most):
    """[(first, one past the last)] of at most so many each."""
    return [(at, min(at + most, end)) for at in range(begin, end, most)]


def _runs(*limits):
    """[(first, one past the last)], each of at least one, in which no running sum grows by more than its limit."""
    runs, at, n = [], 0, len(limits[0][0]) - 1
    while at < n:
        end = min(int(np.searchsorted(sums, sums[at] + limit, "right")) - 1 for sums, limit in limits)
        runs.append((at, max(end, at + 1)))
        at = runs[-1][1]
    return runs
