"""What to draw: meshes, cameras and lights, and with fur.py all that a scene holds, as frozen classes that check
themselves when they are made.

Lengths are in the mesh's own units, angles in degrees, colours linear. The world is right-handed with +Y up.
Arrays are copied on the way in and are read-only, so that a scene never changes under a renderer.
"""

import functools
import math

import attrs
import numpy as np

from . import checks
from .errors import Error
from .fur import Curves, Strands, reach
from .shell_fur import Shells

MOST_PERIODS = 1 << 16, 1 << 12   # of the sines of shell fur: from uv 0, where float32 is exact enough, and on a face


def _uv_array(value, where):
    allowed = "None, an array [vertices, 2] or an array [faces, 3, 2] of numbers"
    if value is None:
        return None
    array = checks.numbers(value, where, allowed)
    if array.shape[1:] not in ((2,), (3, 2)):
        checks.refuse(where, value, allowed)
    return array


def _first_of_equal_rows(rows):
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
    faces: [F, 3] whole numbers 0 to V-1, counter-clockwise seen from outside. Required.

    As stored: `positions` float32 [P, 3] holds each position once (files split vertices where uv or normals
    jump, and fur would part there), in the order given, without those that no face uses. `normals`
    float32 [P, 3] are unit: the mean of the given ones at that position, or of the faces' weighted by area.
    `uv` float32 [F', 3, 2] is kept by corner (zeros where none was given: see `has_uv`), `faces` is
    uint32 [F', 3]. Faces without area and faces at a point where all normals cancel are left out;
    `degenerate_faces` and `zero_normal_faces` count them, and `kept_faces` int64 [F'] says which of the
    given faces the stored ones are. Raises Error for other shapes, NaN or infinity, indices out of range,
    and when no face is left.
    """

    positions: np.ndarray = checks.field(checks.rows(3))
    normals: np.ndarray = checks.field(checks.optional(checks.rows(3)), default=None)
    uv: np.ndarray = checks.field(_uv_array, default=None)
    faces: np.ndarray = checks.field(checks.rows(3, kinds="iu"), default=None)
    has_uv: bool = attrs.field(init=False)
    degenerate_faces: int = attrs.field(init=False)
    zero_normal_faces: int = attrs.field(init=False)
    kept_faces: np.ndarray = attrs.field(init=False, repr=False)

    def __attrs_post_init__(self):
        given = checks.float32(self.positions, "Mesh.positions") + np.float32(0)  # + 0 turns -0.0 into 0.0
        faces = self.faces.astype(np.int64)
        corner_uv = self._check(given, self.faces)

        # Weld: from here on a vertex is called by the index of the first given one at the same position.
        first = _first_of_equal_rows(given)
        welded = first[faces]
        normal, longest = _face_normals(given, welded)
        twice_area = np.sqrt((normal**2).sum(axis=1))
        has_area = twice_area > 2e-12 * longest**2
        degenerate = len(faces) - int(has_area.sum())

        keep = np.flatnonzero(has_area)
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
        uv = np.zeros((len(keep), 3, 2), np.float32) if corner_uv is None else corner_uv[keep]
        self._store(
            positions=checks.frozen(given[used]),
            normals=checks.frozen(normals[used].astype(np.float32)),
            uv=checks.frozen(uv),
            faces=checks.frozen(stored_faces.reshape(-1, 3).astype(np.uint32)),
            has_uv=corner_uv is not None,
            degenerate_faces=degenerate,
            zero_normal_faces=zero_normal,
            kept_faces=checks.frozen(keep),
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
        if self.uv is None:
            return None
        allowed = f"None, [{len(positions)}, 2] per vertex or [{len(faces)}, 3, 2] per corner"
        if self.uv.shape not in ((len(positions), 2), (len(faces), 3, 2)):
            checks.refuse("Mesh.uv", self.uv, allowed)
        uv = checks.float32(self.uv, "Mesh.uv")
        return uv[faces] if uv.ndim == 2 else uv

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
        used = np.unique(faces)
        with np.errstate(invalid="ignore"):
            given = self.normals[used].astype(np.float64)
        size = np.abs(given).max(axis=1, keepdims=True)
        good = (np.isfinite(size) & (size > 0)).ravel()
        given = given[good] / size[good]  # first by the largest part: no square can overflow or vanish
        given /= np.sqrt((given**2).sum(axis=1, keepdims=True))
        corner = first[used][good]
        mean = _unit_unless_cancelled(_sums(given, corner, count), np.bincount(corner, minlength=count))
        return np.where((mean != 0).any(axis=1, keepdims=True), mean, result)

    @functools.cached_property
    def hull(self):
        """Points whose convex hull holds the curved (PN) surface, float64 [n, 3] (Vlachos et al. 2001)."""
        return _hull(self)

    @functools.cached_property
    def area(self):
        """Area of all faces, flat, in world units squared."""
        return float(np.sqrt((_face_normals(self.positions, self.faces)[0] ** 2).sum(axis=1)).sum() / 2)

    @functools.cached_property
    def longest_edge(self):
        """Length of the longest side of a face, flat."""
        return float(_face_normals(self.positions, self.faces)[1].max())

    @functools.cached_property
    def bounds(self):
        """The sphere around the box of the positions: (centre float64 [3], radius float)."""
        return _sphere(*_box(self.positions))


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


def _box(positions):
    """Return the (low, high) corners, float64 [3] each, of positions [n, 3], n >= 1."""
    columns = [positions[:, i] for i in range(3)]   # ten times as fast as a reduction over the first axis
    return np.array([c.min() for c in columns], np.float64), np.array([c.max() for c in columns], np.float64)


def _sphere(low, high):
    return (low + high) / 2, float(np.sqrt(((high - low) ** 2).sum()) / 2)


# --- cameras and lights ---------------------------------------------------------------------------------


def _size(value, where):
    allowed = "(width, height), whole numbers from 1 to 16384"
    try:
        width, height = value
    except (TypeError, ValueError):
        checks.refuse(where, value, allowed)
    return checks.whole(1, 16384)(width, where), checks.whole(1, 16384)(height, where)


def _unit(vector, where):
    """Return the vector float64 [3] at length one, read-only; Error where it is zero."""
    largest = np.abs(vector).max()
    if largest == 0:
        checks.refuse(where, vector, "a vector that is not zero")
    vector = vector / largest  # so that no square overflows or vanishes
    return checks.frozen(vector / np.sqrt((vector**2).sum()))


def _direction(value, where):
    return _unit(checks.vector(3)(value, where), where)


@attrs.frozen(eq=False)
class Camera:
    """A pinhole camera at `eye` that looks at `target`.

    eye, target, up: [3]; up may not be parallel to the view. fov: vertical, degrees, 0 < fov < 180.
    size: (width, height) in pixels, 1..16384 each. Raises Error for anything else.

    Every camera has `pose`, float64 [4, 4] camera to world (the camera looks along its -Z, +Y is up,
    +X right), `intrinsics`, float64 [3, 3] in pixels (see `calibrated`), and `size`; the renderer uses these
    three alone. One made by `calibrated` has None for eye, target, up and fov.
    """

    eye: np.ndarray = checks.field(checks.vector(3), default=(0.0, 0.4, 3.2))
    target: np.ndarray = checks.field(checks.vector(3), default=(0.0, 0.0, 0.0))
    up: np.ndarray = checks.field(checks.vector(3), default=(0.0, 1.0, 0.0))
    fov: float = checks.field(checks.real(above=0, below=180), default=45.0)
    size: tuple = checks.field(_size, default=(640, 480))
    pose: np.ndarray = attrs.field(init=False, repr=False)
    intrinsics: np.ndarray = attrs.field(init=False, repr=False)

    def __attrs_post_init__(self):
        if (self.eye == self.target).all():
            raise Error(f"Camera.target is {checks.shown(self.target.tolist())}, the same as Camera.eye; "
                        "allowed: another point")
        back = _unit(self.eye - self.target, "Camera.eye - Camera.target")
        right = np.cross(_unit(self.up, "Camera.up"), back)
        if np.sqrt((right**2).sum()) < 1e-6:
            raise Error(f"Camera.up is {checks.shown(self.up.tolist())}, along the view; "
                        "allowed: a vector that is not parallel to target - eye")
        right = _unit(right, "Camera.up")
        pose = np.eye(4)
        pose[:3, :] = np.stack([right, np.cross(back, right), back, self.eye], axis=1)
        width, height = self.size
        focal = height / 2 / math.tan(math.radians(self.fov) / 2)
        intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        object.__setattr__(self, "pose", checks.frozen(pose))
        object.__setattr__(self, "intrinsics", checks.frozen(intrinsics))

    @classmethod
    def calibrated(cls, pose, intrinsics, size):
        """Return the camera of a calibration.

        pose: [4, 4] camera to world, right-handed, a rotation and a translation; the camera looks along its
        -Z and +Y is up (the trimesh and OpenGL convention; OpenCV's looks along +Z with +Y down: negate the
        second and third columns of its pose). intrinsics: [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels; a
        point (x, y, -d) before the camera is seen at column (fx x - s y)/d + cx and row cy - fy y/d. The
        origin is the top-left corner of the top-left pixel, whose centre is at (0.5, 0.5); OpenCV puts it
        in that pixel's centre, so its cx and cy are 0.5 less: add 0.5 to both. size: (width, height).
        Raises Error where the pose is no rigid motion (tolerance 1e-4) or the matrix has not this form.
        """

        def matrix(value, n, where):
            allowed = f"an array [{n}, {n}] of finite numbers"
            array = checks.numbers(value, where, allowed)
            if array.shape != (n, n) or not (np.abs(array.astype(np.float64)) <= checks.LARGEST).all():
                checks.refuse(where, value, allowed)
            return array.astype(np.float64)

        pose = matrix(pose, 4, "Camera.calibrated pose")
        if (pose[3] != (0, 0, 0, 1)).any():
            checks.refuse("Camera.calibrated pose[3]", pose[3].tolist(), "[0, 0, 0, 1]")
        rotation = pose[:3, :3]
        error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
        if error > 1e-4 or np.linalg.det(rotation) < 0:
            raise Error("Camera.calibrated pose[:3, :3] is no rotation: its columns are "
                        f"{error:.3g} from orthonormal, its determinant is {np.linalg.det(rotation):.3g}; "
                        "allowed: an error of 1e-4, determinant 1")
        u, _, v = np.linalg.svd(rotation)
        pose[:3, :3] = u @ v  # the nearest rotation, so that its transpose is its inverse
        k = matrix(intrinsics, 3, "Camera.calibrated intrinsics")
        if k[0, 0] <= 0 or k[1, 1] <= 0 or k[1, 0] != 0 or (k[2] != (0, 0, 1)).any():
            checks.refuse("Camera.calibrated intrinsics", k.tolist(),
                    "[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx > 0 and fy > 0")
        camera = object.__new__(cls)  # eye, target, up and fov stay None: the matrices say more than they can
        fields = {"eye": None, "target": None, "up": None, "fov": None, "size": _size(size, "Camera.size"),
                  "pose": checks.frozen(pose), "intrinsics": checks.frozen(k)}
        for name, value in fields.items():
            object.__setattr__(camera, name, value)
        return camera


@attrs.frozen(eq=False)
class Light:
    """A distant light, or a spot light where it has a position: `direction` [3] is the way the light travels.

    direction is stored at unit length. color: linear RGB >= 0. ambient: white light from everywhere, >= 0.
    position: [3] of a spot, or None. angle: a spot's whole cone, degrees; its light does not fall off with distance.
    Raises Error otherwise.
    """

    direction: np.ndarray = checks.field(_direction, default=(-1.0, -1.0, -1.0))
    color: np.ndarray = checks.field(checks.color, default=(1.0, 1.0, 1.0))
    ambient: float = checks.field(checks.real(low=0), default=0.1)
    position: np.ndarray = checks.field(checks.optional(checks.vector(3)), default=None)
    angle: float = checks.field(checks.real(low=0.5, below=180), default=60.0)


def _fur(value, where):
    """Return what `Scene.fur` takes; a list becomes a tuple, which `extent` can remember."""
    fur = tuple(value) if isinstance(value, (tuple, list)) else value
    parts = fur if isinstance(fur, tuple) else () if fur is None else (fur,)
    strands, shells = ([part for part in parts if isinstance(part, kind)] for kind in ((Strands, Curves), Shells))
    if len(strands) > 1 or len(shells) > 1 or len(strands) + len(shells) < len(parts):
        checks.refuse(where, value, "None, Strands, Curves, Shells, or a list of one Shells and one Strands or Curves")
    return fur


def _strands_and_shells(fur):
    """Return (Strands, Curves or None; Shells or None) of what `_fur` gave."""
    parts = fur if isinstance(fur, tuple) else (fur,)
    return (next((part for part in parts if isinstance(part, (Strands, Curves))), None),
            next((part for part in parts if isinstance(part, Shells)), None))


def _points_to_see(mesh, fur):
    """Return arrays [n, 3] of points whose hull, grown by `reach`, holds all that is drawn."""
    strands, _ = _strands_and_shells(fur)   # shells grow on the mesh
    curved = isinstance(strands, Strands) and strands.surface == "pn"
    points = [mesh.hull if curved else mesh.positions] if mesh is not None else []
    return points + ([strands.points] if isinstance(strands, Curves) and len(strands.points) else [])


@functools.lru_cache(maxsize=2)   # a film asks for the same again in every frame
def extent(mesh, fur):
    """Return a sphere (centre float64 [3], radius float) around all that a mesh and its fur can reach."""
    boxes = [_box(points) for points in _points_to_see(mesh, fur)]
    if not boxes:
        return np.zeros(3), 0.0
    center, _ = _sphere(np.min([low for low, _ in boxes], 0), np.max([high for _, high in boxes], 0))
    furthest = max(((points - center) ** 2).sum(1).max() for points in _points_to_see(mesh, fur))
    return center, float(np.sqrt(furthest)) + reach(fur)


def frame(mesh, fur, size=(640, 480), fov=45, direction=(0.45, 0.3, 1.0)):
    """Return a Camera that sees all of a mesh and its fur.

    mesh: Mesh, or None with Curves. fur: what `Scene` takes. size: (width, height) in pixels. fov: vertical, degrees.
    direction: [3] from the centre of what is drawn to the camera, which comes as near as it can. Raises Error as
    Scene does for its fur, and as Camera does.
    """
    fur = _fur(fur, "frame fur")
    size = _size(size, "frame size")
    fov = checks.real(above=0, below=180)(fov, "frame fov")
    direction = _direction(direction, "frame direction")
    center, _ = extent(mesh, fur)
    up = (0, 1, 0) if abs(direction[1]) < 0.999 else (0, 0, -1)
    axes = Camera(eye=center + direction, target=center, up=up, fov=fov, size=size).pose[:3, :3]
    tall = math.tan(math.radians(fov) / 2)
    slopes = np.array([tall * size[0] / size[1], tall])
    # The four planes of the view, each pushed out to its furthest point: where they meet is the nearest eye.
    offsets = np.concatenate([points - center for points in _points_to_see(mesh, fur)] or [np.zeros((1, 3))]) @ axes
    margin = reach(fur) * np.sqrt(1 + slopes**2)
    one = (offsets[:, :2] + slopes * offsets[:, 2:]).max(0) + margin
    other = (-offsets[:, :2] + slopes * offsets[:, 2:]).max(0) + margin
    distance = 1.05 * float(((one + other) / (2 * slopes)).max()) or 1.0
    target = center + axes[:, :2] @ ((one - other) / 2)
    return Camera(eye=target + distance * direction, target=target, up=up, fov=fov, size=size)


@attrs.frozen(eq=False)
class Scene:
    """All that a picture shows.

    mesh: Mesh or None. fur: Strands or Shells (which need a mesh), Curves, a list of Shells (undercoat) and one of
    Strands and Curves (guard hairs), or None; a mesh or fur is required. camera: Camera, or None to frame all of it.
    light: Light. body_color: linear RGB >= 0 of the mesh itself, or None to leave it undrawn. Raises Error where the
    parts don't fit: a type_map, color_texture or pattern "sine" on a mesh without uv, levels for another number of
    faces, or an edge whose two faces give it different levels.

    A list is stored as a tuple. `strands` are the Strands or Curves of `fur`, `shells` its Shells, or None.
    """

    mesh: Mesh = checks.field(checks.instance(Mesh, none=True), default=None)
    fur: Strands | Curves | Shells | tuple = checks.field(_fur, default=None)
    camera: Camera = checks.field(checks.instance(Camera, none=True), default=None)
    light: Light = checks.field(checks.instance(Light), default=Light())
    body_color: np.ndarray = checks.field(checks.optional(checks.color), default=(0.30, 0.20, 0.12))
    strands: Strands | Curves = attrs.field(init=False, repr=False)
    shells: Shells = attrs.field(init=False, repr=False)

    @property
    def lights(self):
        """All lights, in a tuple."""
        return (self.light,)

    def __attrs_post_init__(self):
        strands, shells = _strands_and_shells(self.fur)
        object.__setattr__(self, "strands", strands)
        object.__setattr__(self, "shells", shells)
        if self.mesh is None and strands is None and shells is None:
            raise Error("Scene.mesh and Scene.fur are None; allowed: at least one of them")
        for fur in (strands, shells):
            if isinstance(fur, (Strands, Shells)) and self.mesh is None:
                raise Error(f"Scene.mesh is None but Scene.fur has {type(fur).__name__}; "
                            "allowed: a Mesh for them to grow on")
        if isinstance(strands, Strands):
            _check_uv(self.mesh, strands)
            _check_levels(self.mesh, strands)
        if shells is not None and shells.pattern == "sine":
            _check_sines(self.mesh, shells)
        _, radius = extent(self.mesh, self.fur)
        if radius and not 1e-6 <= radius <= checks.LARGEST:
            raise Error(f"Scene is {2 * radius:.3g} across; allowed: 2e-06 to 2e+09, where float32 is exact enough")
        place = self.light.position
        if place is not None and np.linalg.norm(place - extent(self.mesh, self.fur)[0]) > 1e3 * (radius or 1):
            raise Error(f"Light.position is {checks.shown(place)}; allowed: at most 1000 radii of the scene away, "
                        f"or no position: light that is all but parallel")
        if self.camera is None:
            object.__setattr__(self, "camera", frame(self.mesh, self.fur))


def _check_uv(mesh, strands):
    if mesh.has_uv:
        return
    if strands.type_map is not None:
        raise Error("Strands.type_map is looked up by uv but Scene.mesh has none; allowed: a mesh with uv")
    if any(hair.color_texture is not None for hair in strands.types):
        raise Error("HairType.color_texture is looked up by uv but Scene.mesh has none; "
                    "allowed: a mesh with uv")


def _check_sines(mesh, shells):
    if not mesh.has_uv:
        raise Error("Shells.pattern is 'sine', which is made from uv, but Scene.mesh has none; "
                    "allowed: 'cells', or a mesh with uv")
    periods = np.abs(mesh.uv * (2.0, 1.0)).max(), np.ptp(mesh.uv * (2.0, 1.0), axis=1).max()
    most = min(limit / each for limit, each in zip(MOST_PERIODS, periods) if each) if any(periods) else np.inf
    if shells.frequency > most:
        raise Error(f"Shells.frequency is {shells.frequency:g}, of sines over uv up to {np.abs(mesh.uv).max():g}; "
                    f"allowed with these uv: at most {most:.6g}")


def _check_levels(mesh, strands):
    for name in ("inner", "outer"):
        levels = getattr(strands, name)
        if isinstance(levels, np.ndarray) and len(levels) != len(mesh.faces):
            raise Error(f"Strands.{name} has levels for {len(levels)} faces; "
                        f"allowed: {len(mesh.faces)}, the faces that the mesh has kept")
    if not isinstance(strands.outer, np.ndarray):
        return
    edges = np.sort(mesh.faces[:, [[1, 2], [2, 0], [0, 1]]].astype(np.int64), axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    levels = strands.outer.reshape(-1)[order]
    differ = (edges[order][1:] == edges[order][:-1]).all(axis=1) & (levels[1:] != levels[:-1])
    if differ.any():
        at = int(np.argmax(differ))
        one, other = order[at], order[at + 1]
        raise Error(f"Strands.outer is {levels[at]} at face {one // 3}, edge {one % 3}, but {levels[at + 1]} "
                    f"at face {other // 3}, edge {other % 3}, which is the same edge; allowed: equal levels")
