"""Triangle meshes, welded so that fur has no seams."""

import functools

import attrs
import numpy as np

from ..errors import Error
from . import checks
from .display import brief
from .origin import ZERO, near_origin, origin
from .winding import Surfaces, groups_of, parity_of


def _uv_array(value, where):
    allowed = "None, an array [vertices, 2] or an array [faces, 3, 2] of numbers"
    if value is None:
        return None
    array = checks.numbers(value, where, allowed)
    if array.shape[1:] not in ((2,), (3, 2)):
        checks.refuse(where, value, allowed)
    return array


def _materials(value, where):
    if value is None:
        return None
    allowed = "None or an array [faces] of whole numbers from 0 to 65535"
    array = checks.numbers(value, where, allowed, "iu")
    if array.ndim != 1 or (array < 0).any() or (array > 65535).any():
        checks.refuse(where, value, allowed)
    return checks.frozen(array.astype(np.uint32))


@attrs.frozen(eq=False)
class Numbering:
    """How the vertices and faces of a `Mesh` were given, in its arrays or in its file, and what they are called there.

    corners: uint32 [G, 3] which vertex is at each corner of the given triangles. vertices: how many there are. face_of:
    int64 [G] which face each triangle is of, as several are of a file's polygon, or None where each is one. faces: how
    many there are.
    labels: pairs, of groups, of objects and of materials: tuples of names, and int64 [faces] which of these are each
    face's. colors: None, or float32 [vertices, 3 or 4], 0 to 1 without a curve.
    """

    corners: np.ndarray
    vertices: int
    face_of: np.ndarray | None
    faces: int
    labels: tuple = ()
    colors: np.ndarray | None = None
    __repr__ = brief

    @property
    def names(self) -> tuple[str, ...]:
        """What `mask` takes: names of faces in the order of the file, and red, green, blue, alpha of vertex colours."""
        of_faces = (name for kind, _ in self.labels for names in kind for name in names)
        return tuple(dict.fromkeys((*of_faces, *CHANNELS[:0 if self.colors is None else self.colors.shape[1]])))

    def mask(self, name: str) -> dict[str, np.ndarray]:
        """As `Mesh.mask`, of one name."""
        found = [np.array([name in names for names in kind])[which] for kind, which in self.labels if len(kind)]
        if any(each.any() for each in found):
            return {"face": np.any(found, axis=0).astype(np.float32)}
        if self.colors is not None and name in CHANNELS[:self.colors.shape[1]]:
            return {"vertex": self.colors[:, CHANNELS.index(name)]}
        listed = ", ".join(self.names[:20]) + (", ..." if len(self.names) > 20 else "")
        raise Error(f"the mesh has no group, object, material or vertex colour {name!r:.60}; allowed: "
                    + (listed or "none, as it names none"))


CHANNELS = "red", "green", "blue", "alpha"


def first_of_equal_rows(rows):
    """Return, for each row of rows [n, 3], the index of the first row with the same numbers: int64 [n]."""
    order = np.lexsort(rows.T)  # stable: among equal rows the first stays first
    ordered = rows[order]
    new = np.ones(len(rows), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    first = np.empty(len(rows), np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    return first


def _sums(values, index, count):
    """Return the sums of values [n, 3] by index [n]: float64 [count, 3]."""
    return np.stack([np.bincount(index, values[:, k], count) for k in range(3)], axis=1)


@attrs.frozen(eq=False)
class Mesh:
    """A triangle mesh with smooth normals, welded so that it has no seams.

    positions: [V, 3] finite numbers.
    normals: None or [V, 3]; need not be unit length; where zero, not finite or None, they are computed.
    uv: None, [V, 2] per vertex or [F, 3, 2] per corner; (0, 0) is the lower left corner of a picture (as in
    OBJ files), and pictures repeat outside 0..1.
    faces: [F, 3] whole numbers 0 to V-1, counter-clockwise seen from outside (see below). Required.
    origin: [3] what positions are relative to, 0 if not given.
    material_of: None, or [F] whole numbers from 0: which of several materials, of `Scene.body_color`, each face has.

    As stored: `positions` float32 [P, 3] holds each position once (files split vertices where uv or normals
    jump, and fur would part there), in the order given, without those that no face uses. They are relative to
    `origin` float64 [3], which is as given where positions are near it (64 sizes of the mesh), else a place among
    them: a mesh far away keeps its shape. positions + origin are in the world, and so is all else but `hull`. `normals`
    float32 [P, 3] are unit: the mean of the given ones at that position, or of the faces' weighted by area.
    `uv` float32 [F', 3, 2] is kept by corner (zeros where none was given: see `has_uv`), `faces` is
    uint32 [F', 3]. Faces without area and faces at a point where all normals cancel are left out;
    `degenerate_faces` and `zero_normal_faces` count them, and `kept_faces` int64 [F'] says which of the
    given faces the stored ones are; `dropped` are all others, for `Strands.rest` and `Shells.rest`. `numbering`, a
    `Numbering`, tells how vertices and faces were numbered as they were given, here or in a file.

    Of faces with the same three places one is kept: two-sided meshes have each of them twice. What is outside is told
    by the normals given; where a surface (faces joined by edges of two) has none, by its faces: those at odds with most
    of its area are turned, and so is a closed surface around a negative volume, with what is within it. What is within
    one that is not turned may be the wall of a hollow, and a surface that is open has no inside: these stay as they
    are. To turn a face is to turn its normal; its corners keep their order. `doubled_faces` and `turned_faces` count
    them, `one_sided_faces` those of surfaces such as the Moebius strip, which cannot be right.

    Raises Error for other shapes, NaN or infinity, indices out of range, and when no face is left.
    """

    positions: checks.Given = checks.field(checks.rows(3))
    normals: checks.Given = checks.field(checks.optional(checks.rows(3)), default=None)
    uv: checks.Given = checks.field(_uv_array, default=None)
    faces: checks.Given = checks.field(checks.rows(3, kinds="iu"), default=None)
    origin: checks.Given = checks.field(origin, default=ZERO, kw_only=True)
    material_of: checks.Given = checks.field(_materials, default=None, kw_only=True)
    numbering: Numbering = attrs.field(init=False, repr=False)
    has_uv: bool = attrs.field(init=False)
    degenerate_faces: int = attrs.field(init=False)
    zero_normal_faces: int = attrs.field(init=False)
    doubled_faces: int = attrs.field(init=False)
    turned_faces: int = attrs.field(init=False)
    one_sided_faces: int = attrs.field(init=False)
    kept_faces: np.ndarray = attrs.field(init=False, repr=False)
    # (which [D], places [D, 3, 3] as positions, uv [D, 3, 2], materials [D])
    dropped: tuple = attrs.field(init=False, repr=False)
    __repr__ = brief

    def __attrs_post_init__(self):
        given, origin = near_origin(self.positions, self.origin, "Mesh.positions")
        given = given + np.float32(0)  # turns -0.0 into 0.0
        faces = self.faces.astype(np.int64)
        corner_uv, material_of = self._check(given, self.faces), self.material_of

        # Weld: from here on a vertex has the index of the first given one at the same position.
        first = first_of_equal_rows(given)
        welded = first[faces]
        normal, longest = _face_normals(given, welded)
        twice_area = np.sqrt((normal**2).sum(axis=1))
        has_area = twice_area > 2e-12 * longest**2
        degenerate = len(faces) - int(has_area.sum())

        keep = np.flatnonzero(has_area)
        keep, counts = self._orient(given, faces, welded, normal, keep)
        normals = self._vertex_normals(first, faces[keep], normal[keep])
        has_normals = (normals[welded[keep]] != 0).any(axis=2).all(axis=1)
        zero_normal = len(keep) - int(has_normals.sum())
        keep = keep[has_normals]
        if not len(keep):
            raise Error(
                f"Mesh.faces has no face that can be drawn: of {len(faces)}, {degenerate} are degenerate and "
                f"{zero_normal} have a zero normal; allowed: at least one face with an area and normals"
            )

        used, stored_faces = np.unique(welded[keep], return_inverse=True)
        uv = np.zeros((len(faces), 3, 2), np.float32) if corner_uv is None else corner_uv
        dropped = np.setdiff1d(np.arange(len(faces)), keep, assume_unique=True)
        self._store(
            positions=checks.frozen(given[used]),
            origin=origin,
            normals=checks.frozen(normals[used].astype(np.float32)),
            uv=checks.frozen(uv[keep]),
            faces=checks.frozen(stored_faces.reshape(-1, 3).astype(np.uint32)),
            has_uv=corner_uv is not None,
            degenerate_faces=degenerate,
            zero_normal_faces=zero_normal,
            **counts,
            kept_faces=checks.frozen(keep),
            numbering=Numbering(checks.frozen(faces.astype(np.uint32)), len(given), None, len(faces)),
            material_of=None if material_of is None else checks.frozen(material_of[keep]),
            dropped=tuple(checks.frozen(each) for each in (
                dropped, given[faces[dropped]], uv[dropped],
                np.zeros(len(dropped), np.uint32) if material_of is None else material_of[dropped])),
        )

    def _store(self, **fields):
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _check(self, positions, faces):
        """Check how the given arrays fit together; return uv by corner, float32 [F, 3, 2], or None."""
        if not len(faces):
            raise Error("Mesh.faces is empty; allowed: at least one face")
        if int(faces.min()) < 0 or int(faces.max()) >= len(positions):
            worst = int(faces.min()) if int(faces.min()) < 0 else int(faces.max())
            raise Error(
                f"Mesh.faces has the index {worst}; allowed: 0 to {len(positions) - 1}, "
                f"since there are {len(positions)} positions"
            )
        if self.normals is not None and len(self.normals) != len(positions):
            checks.refuse("Mesh.normals", self.normals, f"None or [{len(positions)}, 3], one for each position")
        if self.material_of is not None and len(self.material_of) != len(faces):
            checks.refuse("Mesh.material_of", self.material_of, f"None or [{len(faces)}], one for each face")
        if self.uv is None:
            return None
        allowed = f"None, [{len(positions)}, 2] per vertex or [{len(faces)}, 3, 2] per corner"
        if self.uv.shape not in ((len(positions), 2), (len(faces), 3, 2)):
            checks.refuse("Mesh.uv", self.uv, allowed)
        uv = checks.float32(self.uv, "Mesh.uv")
        return uv[faces] if uv.ndim == 2 else uv

    def _orient(self, positions, faces, welded, normal, keep):
        """Return which of the faces ``keep`` are kept, one of each, and {name: how many} were faulty.

        faces, welded: [F, 3] as given, and by the first vertex at each place. normal: [F, 3] is turned outwards.
        """
        known = self._given_normals(faces, normal) if self.normals is not None else None
        agreement = np.zeros(len(faces)) if known is None else known[0]
        group = groups_of(welded[keep], len(positions))
        order = np.lexsort((keep, agreement[keep] <= 0, group))   # what agrees with its own normals goes first
        chosen = np.sort(order[np.append(True, np.diff(group[order]) != 0)]) if len(keep) else keep
        doubled, turned, one_sided = len(keep) - len(chosen), 0, 0
        if len(chosen) and (known is None or not known[1][keep[chosen]].all()):
            kept = keep[chosen]
            surfaces = Surfaces(positions, welded[kept], normal[kept], agreement[kept])
            twins = self._twins(welded[keep], group, chosen) if doubled else np.full(len(chosen), -1)
            swapped = surfaces.turned & (twins >= 0)
            normal[kept[~swapped]] *= surfaces.sign[~swapped, None]
            chosen = np.where(swapped, twins, chosen)
            turned, one_sided = int((surfaces.turned & ~swapped).sum()), int(surfaces.one_sided.sum())
        return np.sort(keep[chosen]), {"doubled_faces": doubled, "turned_faces": turned, "one_sided_faces": one_sided}

    @staticmethod
    def _twins(faces, group, chosen):
        """Return, for each of the chosen of faces [n, 3], one of its group that is wound the other way, -1 without."""
        parity, twins = parity_of(faces), np.full((2, len(faces)), -1)
        for way in (0, 1):
            of_way = np.flatnonzero(parity == way)[::-1]   # of several the first is written last
            twins[way, group[of_way]] = of_way
        return np.where(parity[chosen], twins[0, group[chosen]], twins[1, group[chosen]])

    def _given_normals(self, faces, normal):
        """Return how much faces agree with the normals given at their corners, float64 [F], and which have all."""
        with np.errstate(invalid="ignore", over="ignore"):
            given = self.normals.astype(np.float64)
            size = np.abs(given).max(axis=1, keepdims=True)
            good = (np.isfinite(size) & (size > 0)).ravel()
            given = np.where(good[:, None], given / np.where(good[:, None], size, 1), 0)
        return (normal * given[faces].sum(axis=1)).sum(axis=1), good[faces].all(axis=1)

    def _vertex_normals(self, first, faces, face_normals):
        """Return unit normals float64 [V, 3], at the first given vertex of each position, else zero.

        first: [V] the first vertex at the same position. faces: [K, 3] as given. face_normals: [K, 3] of
        length proportional to the area. Where normals cancel to rounding error the result is zero.
        """
        count = len(first)
        corner = first[faces].ravel()
        by_area = np.repeat(face_normals, 3, axis=0)
        areas = np.bincount(corner, np.sqrt((by_area**2).sum(axis=1)), count)
        result = _unit_unless_cancelled(_sums(by_area, corner, count), areas)
        if self.normals is None:
            return result
        used = np.flatnonzero(np.bincount(faces.ravel()))
        with np.errstate(invalid="ignore"):
            given = self.normals[used].astype(np.float64)
        size = np.abs(given).max(axis=1, keepdims=True)
        good = (np.isfinite(size) & (size > 0)).ravel()
        given = given[good] / size[good]  # first by the largest part: no square can overflow or vanish
        given /= np.sqrt((given**2).sum(axis=1, keepdims=True))
        corner = first[used][good]
        mean = _unit_unless_cancelled(_sums(given, corner, count), np.bincount(corner, minlength=count))
        return np.where((mean != 0).any(axis=1, keepdims=True), mean, result)

    def mask(self, *names: str) -> dict[str, np.ndarray]:
        """Where the skin is called so, as `Maps` take it: {"face": float32 [faces]}, 1 where any of the names is of its
        group, object or material; or {"vertex": float32 [vertices]}, of one name, a channel of vertex colours.
        `numbering.names` are all there are. Raises Error for others."""
        found = [self.numbering.mask(name) for name in names]
        if len(found) == 1:
            return found[0]
        if not found or any("vertex" in each for each in found):
            raise Error(f"Mesh.mask names are {checks.shown(names)}; allowed: one vertex colour, or others")
        return {"face": np.maximum.reduce([each["face"] for each in found])}

    @functools.cached_property
    def hull(self) -> np.ndarray:
        """Points whose convex hull holds the curved (PN) surface, relative to `origin`: float64 [n, 3] (Vlachos et al.
        2001)."""
        return _hull(self)

    @functools.cached_property
    def area(self) -> float:
        """Area of all faces, flat, in world units squared."""
        return float(np.sqrt((_face_normals(self.positions, self.faces)[0] ** 2).sum(axis=1)).sum() / 2)

    @functools.cached_property
    def largest_face(self) -> float:
        """Area of the largest face, flat, in world units squared."""
        return float(np.sqrt((_face_normals(self.positions, self.faces)[0] ** 2).sum(axis=1)).max(initial=0) / 2)

    @functools.cached_property
    def inward(self) -> bool:
        """Whether the mesh is closed and its normals, as they were given, point into it: so does fur.

        By Gauss' theorem: the flux of places through a closed surface is three times the volume within.
        """
        corners = self.positions.astype(np.float64)[self.faces]
        area = np.linalg.norm(_face_normals(self.positions, self.faces)[0], axis=1) / 2
        along = ((corners.mean(1) - self.positions.mean(0)) * self.normals[self.faces].mean(1)).sum(1)
        if (area * along).sum() > -1e-3 * area.sum() ** 1.5:
            return False
        edges = np.sort(np.stack([self.faces, np.roll(self.faces, -1, 1)], 2).reshape(-1, 2), 1)
        return bool((np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all())

    @functools.cached_property
    def longest_edge(self) -> float:
        """Length of the longest side of a face, flat."""
        return float(_face_normals(self.positions, self.faces)[1].max())

    @functools.cached_property
    def bounds(self) -> tuple[np.ndarray, float]:
        """The sphere around the box of the positions: (centre float64 [3], radius float)."""
        center, radius = sphere(*box(self.positions))
        return center + self.origin, radius

    @functools.cached_property
    def own_frame(self) -> tuple[np.ndarray, np.ndarray, float]:
        """A frame that moves and turns as the vertices do: (their mean float64 [3], relative to
        `origin`; axes float64 [3, 3], a row each; how far the furthest vertex is from the mean)."""
        p = self.positions.astype(np.float64)
        center = p.mean(0)
        p -= center
        # Two sums with weights that follow no shape, so that none makes both of them vanish, or point the same way.
        one, other = np.sin(np.arange(len(p))**2 * [[1.0], [2**.5]]) @ p
        x, z = _unit(one), _unit(np.cross(one, other))
        return center, np.array([x, np.cross(z, x), z]), float(np.sqrt((p**2).sum(1).max()))


def _unit(vector):
    """A vector of length 1, or 0 where it has none."""
    return vector / max(np.linalg.norm(vector), 1e-300)


def _hull(mesh):
    """Control points of the mesh's PN triangles, float64 [10 F, 3]: their convex hull holds the surface."""
    p = mesh.positions.astype(np.float64)[mesh.faces]   # [F, 3, 3]
    n = mesh.normals.astype(np.float64)[mesh.faces]
    sides = []
    for shift in (1, 2):
        d = np.roll(p, -shift, axis=1) - p
        sides.append(p + (d - (d * n).sum(2, keepdims=True) * n) / 3)
    middle = np.concatenate(sides, 1).mean(1, keepdims=True) * 1.5 - p.mean(1, keepdims=True) / 2
    return np.concatenate([p, *sides, middle], 1).reshape(-1, 3)


def _face_normals(positions, faces):
    """Return (cross products of two edges float64 [F, 3], longest edges float64 [F])."""
    corners = positions.astype(np.float64)[faces]
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    return normal, np.sqrt((edges**2).sum(axis=2)).max(axis=1)


def _unit_unless_cancelled(sums, weights):
    """Return the sums [n, 3] as unit vectors, zero where they are rounding errors against weights [n]."""
    length = np.sqrt((sums**2).sum(axis=1))
    good = length > 1e-6 * weights
    return np.where(good, 1, 0)[:, None] * sums / np.where(good, length, 1)[:, None]


def box(positions):
    """Return the (low, high) corners, float64 [3] each, of positions [n, 3], n >= 1."""
    columns = [positions[:, i] for i in range(3)]   # ten times as fast as a reduction over the first axis
    return np.array([c.min() for c in columns], np.float64), np.array([c.max() for c in columns], np.float64)


def sphere(low, high):
    return (low + high) / 2, float(np.sqrt(((high - low) ** 2).sum()) / 2)
