"""USD stages -> Scene."""

import contextlib
import math
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..color import linear_of
from ..errors import Error, shown
from ..scene import Camera, Environment, Light, Material, Mesh, Scene, checks, extent, frame
from .curves import curves_from
from .images import picture_of
from .meshes import finite
from .output import is_path
from .poses import Poses
from .usd import SUFFIXES, Stage, called
from .usd_curves import strands_of
from .usd_lights import camera_of, lights_of, resolution_of
from .usd_mesh import WHITE, meshes_of

ROWS = 64              # of a sky's picture, at least
AHEAD = 8              # times that are read at once
TOLERANCE = 0.25       # of chords, as `load_curves` has it
WIDTH = 640            # of a picture whose file says nothing of it
NEAR, FAR = 1.06, 900  # radii of a scene from its middle where a light may stand that shines everywhere, or any


def load_scene(path: str | os.PathLike, *, camera: str | None = None, time: float | None = None,
               size: Sequence[int] | None = None, width: float | None = None, color: Any = None,
               tolerance: float = TOLERANCE) -> Scene:
    """Return the Scene of a USD file (.usd, .usda, .usdc, .usdz; needs usd-core): its meshes as one, BasisCurves, a
    camera, distant, sphere, disk, rect and dome lights, colours and pictures of UsdPreviewSurface.

    path: str or path-like. camera: name or path of one of its cameras; None: the first. time: of time samples, in time
    codes; None: the first sample. size: (width, height) in pixels; None: that of its render settings, else 640 wide.
    width, color, tolerance: of strands, as for `load_curves`. Lengths stay in the stage's units, and +Y is up. Lights
    are as strong as in the middle of its strands, else of its meshes (they do not fall off here), without ambient;
    without lights there is a `Light`, without a camera all is framed. What of it is not understood is left out, with
    one warning that lists it: docs/formats.md. Raises Error, one line that names the file, as `load_curves` does.
    """
    given = {"width": None if width is None else checks.real(low=0)(width, "load_scene width"), "color": color}
    parts = parts_of(path, {name: value for name, value in given.items() if value is not None}, camera, time, size,
                     tolerance)
    return _whole(parts, size)


def _whole(parts, size=None):
    """The Scene of what a file has of one."""
    parts = {"light": [Light()], "body_color": WHITE["color"]} | parts
    if "camera" not in parts:
        parts["camera"] = frame(parts["mesh"], parts["fur"], size or (WIDTH, WIDTH * 3 // 4), lights=parts["light"])
    return Scene(**parts)


class SceneAnimation:
    """What moves in a USD file: called with seconds it gives the Scene then, whose mesh has the same faces where the
    file says the same of them. duration: seconds from its first time code to its last. fps: time codes a second."""

    def __init__(self, path: Path) -> None:
        _check_file(path)
        self._path = path
        with _naming(path), np.errstate(all="ignore"):
            (self._first, last, self.fps), stages = called(_read_some, path)
            self.duration = (last - self._first) / self.fps
            self._begin, self._mesh = _parts(stages[0], None, {}), stages[0]["mesh"]
            same = [each["mesh"] for each in stages if self._fits(each["mesh"])]
            self._poses = Poses(self._begin["mesh"], (each["positions"] for each in same)) if same else None
        self._last: tuple[float, Scene] | None = None
        self._known: dict[float, dict] = {}   # what is read, by time code
        self._code = self._first
        _tell_left(path, stages[0]["left"], 4)

    def __call__(self, seconds: float) -> Scene:
        """Return the Scene at a time; asked again, the very same."""
        at = min(max(checks.real()(seconds, "seconds"), 0.0), self.duration)
        if self._last is None or self._last[0] != at:
            with _naming(self._path), np.errstate(all="ignore"):
                self._last = at, self._scene(round(self._first + at * self.fps, 6))
        return self._last[1]

    def _scene(self, code):
        if code not in self._known:   # and those that are likely to come next, as a file may be slow to open
            step = code - self._code
            codes = [round(code + k * step, 6) for k in range(AHEAD if step > 0 else 1)]
            self._known = dict(zip(codes, called(_read_at, self._path, codes)))
        self._code, stage, mesh = code, self._known[code], None
        if self._poses is not None and self._fits(stage["mesh"]):
            mesh = self._poses.mesh(stage["mesh"]["positions"], stage["mesh"].get("normals"))
        parts = _parts(stage, None, {}, mesh)
        if "camera" not in parts:   # one that stays
            parts["camera"] = _whole(self._begin).camera
        return _whole(parts)

    def _fits(self, mesh):
        """Whether a mesh has the faces that there are at first."""
        return mesh is not None and self._mesh is not None and len(mesh["positions"]) == len(
            self._mesh["positions"]) and np.array_equal(mesh["faces"], self._mesh["faces"])


def _read_some(path):
    """When a file begins and ends, and what `_read` gives at some times: at first, and at others."""
    first, last, codes = Stage(path, None).times()
    if not last > first:
        raise Error("has no time samples; allowed: files that move (`load_scene` reads others)")
    return (first, last, codes), _read_at(path, np.linspace(first, last, 5).tolist())


def _read_at(path, codes):
    """What `_read` gives at some time codes."""
    return [_read(path, code, None, TOLERANCE) for code in codes]


def parts_of(path: str | os.PathLike, given: dict[str, Any], camera: str | None = None, time: float | None = None,
             size: Sequence[int] | None = None, tolerance: float = TOLERANCE) -> dict[str, Any]:
    """Return the fields of a Scene that a USD file has, mesh and fur always; ``given`` as `curves_from` takes it."""
    if not is_path(path):
        raise Error(f"load_scene path is {shown(path)}; allowed: a file's name")
    file = Path(path)
    _check_file(file)
    time = None if time is None else checks.real()(time, "load_scene time")
    tolerance = checks.real(low=1e-3, high=1e3)(tolerance, "load_scene tolerance")
    if not (camera is None or isinstance(camera, str)):
        raise Error(f"load_scene camera is {shown(camera)}; allowed: a name, or None")
    with _naming(file), np.errstate(all="ignore"):   # what is not finite is an Error of Mesh, Curves and so on
        stage = called(_read, file, time, camera, tolerance)
        parts = _parts(stage, size, given)
    _tell_left(file, stage["left"], 4)
    return parts


def _check_file(file):
    if file.suffix.lower() not in SUFFIXES:
        raise Error(f"{file}: {file.suffix or 'no suffix'} is no scene file; allowed: {', '.join(SUFFIXES)}")
    if os.path.isdir(file) or not os.path.exists(file):
        raise Error(f"{file}: {'is a folder; allowed: a file' if os.path.isdir(file) else 'no such file'}")


@contextlib.contextmanager
def _naming(file):
    """What is raised of a file within becomes an Error of one line that names it."""
    try:
        yield
    except Error as error:
        raise Error(str(error) if str(error).startswith(f"{file}: ") else f"{file}: {error}") from None
    except Exception as error:   # a reader may fail in any way on a damaged file; the user gets one line
        first_line = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise Error(f"{file}: cannot be read as USD: {first_line}") from error


def _tell_left(file, left, level):
    """Warn of what is left out of a file, if anything."""
    if left:
        warnings.warn(f"{file}: left out: {_listed(left)}", stacklevel=level)


def _read(path, time, camera, tolerance):
    """What `_scene` takes of a file."""
    stage = Stage(path, time)
    found = {"mesh": meshes_of(stage), "strands": strands_of(stage, tolerance), "camera": camera_of(stage, camera),
             "lights": lights_of(stage), "resolution": resolution_of(stage)}
    UsdGeom = stage.pxr.UsdGeom
    for prim, _ in stage.seen():
        known = prim.IsA(UsdGeom.Mesh) or prim.IsA(UsdGeom.BasisCurves) or prim.HasAPI(stage.pxr.UsdLux.LightAPI)
        if prim.IsA(UsdGeom.Boundable) and not known and prim.GetTypeName() not in ("SkelRoot", "Skeleton"):
            stage.leave(f"a {prim.GetTypeName()}", prim)
    if found["mesh"] is None and found["strands"] is None:
        raise Error("has neither Meshes nor BasisCurves that are seen")
    return found | {"left": stage.left}


def _listed(left):
    """What is left out, in words; of each kind where it is first."""
    kinds = []
    for what, paths in left.items():
        there = sorted(set(paths))
        more = f" and {len(there) - 1} more" if len(there) > 1 else ""
        kinds.append(f"{what} ({there[0]}{more})")
    return "; ".join(kinds)


def _parts(stage, size, given, mesh=None):
    """The fields of a Scene that the answer of `_read` tells; mesh: the Mesh of it, if that is known already."""
    parts: dict[str, Any] = {"mesh": None, "fur": None}
    if stage["mesh"] is not None:
        parts["mesh"], materials = _mesh(stage["mesh"], mesh)
        if any(each != WHITE for each in stage["mesh"]["materials"]):
            parts["body_color"] = materials
    if stage["strands"] is not None:
        parts["fur"] = curves_from(stage["strands"], given)
    exposure = 1.0
    if stage["camera"] is not None:
        parts["camera"], exposure = _camera(stage["camera"], size, *stage["resolution"]), stage["camera"]["exposure"]
    lights, sky = _lights(stage, parts["mesh"], parts["fur"], exposure)
    return parts | ({"light": lights} if lights else {}) | ({"environment": sky} if sky is not None else {})


def _mesh(found, mesh=None):
    """(Mesh, tuple of Material) of what `meshes_of` gives; mesh: if that is known already."""
    mesh = mesh or Mesh(**finite({name: found[name] for name in found if name != "materials"}))
    materials = []
    for each in found["materials"]:
        texture = None
        if "texture" in each and mesh.has_uv:
            texture = picture_of(each["texture"])
            texture = (texture / np.float32(255)).astype(np.float32) if each["raw"] and texture.dtype == np.uint8 \
                else texture
        materials.append(Material(each["color"], texture, each.get("wrap", "repeat")))
    return mesh, tuple(materials)


def _camera(found, size, resolution, policy):
    """The Camera of what `camera_of` gives, for a picture of this size, or of the stage's, or as wide as `WIDTH`."""
    left, right, bottom, top = found["window"]
    shape = (right - left) / (top - bottom)
    size = size or resolution or (WIDTH, min(max(round(WIDTH / shape), 1), 16384))
    wanted = size[0] / size[1]
    # Factors of the window's sides, about its middle, that give it the picture's shape.
    wide = {"expandAperture": max(wanted / shape, 1), "cropAperture": min(wanted / shape, 1),
            "adjustApertureWidth": wanted / shape}.get(policy, 1)
    tall = 1 if policy == "adjustPixelAspectRatio" else wide * shape / wanted
    middle, half = ((left + right) / 2, (bottom + top) / 2), (wide * (right - left) / 2, tall * (top - bottom) / 2)
    focal = size[0] / 2 / half[0], size[1] / 2 / half[1]
    intrinsics = [[focal[0], 0, size[0] / 2 - focal[0] * middle[0]], [0, focal[1], size[1] / 2 + focal[1] * middle[1]],
                  [0, 0, 1]]
    return Camera.calibrated(found["pose"], intrinsics, size)


# --- light ----------------------------------------------------------------------------------------------------


def _lights(stage, mesh, strands, exposure):
    """(Lights, an Environment or None) of a stage for a Mesh and Curves, or None; their light times an exposure."""
    center, radius = extent(mesh, strands)
    middle, near = (center, NEAR * 1.5) if strands is None else (extent(None, strands)[0], NEAR)   # hair may grow yet
    lights, sky = [], None
    for found in stage["lights"]:
        try:
            if found["kind"] != "dome":
                within = "position" in found and np.linalg.norm(found["position"] - center) < near * radius
                lights += _light(found, middle, radius or 1.0, within, exposure, stage["left"])
            elif sky is None:
                sky = _sky(found, exposure)
            else:
                stage["left"].setdefault("a second sky", []).append(found["name"])
        except Error as error:
            raise Error(f"{found['name']}: {error}") from None
    if sky is not None and not lights:   # else a Light that nobody asked for would shine beside it
        lights = [Light(intensity=0.0, ambient=0.0)]
    return lights, sky


def _light(found, middle, radius, within, exposure, left):
    """[the Light] of a distant or near one, as strong as in the middle; none where it sends nothing there.

    radius: of all that is drawn. within: whether the light stands there.
    """
    strength, fields = found["strength"] * exposure, {"ambient": 0.0, "shadows": found["shadows"]}
    if found["kind"] == "distant":
        return [Light(direction=found["direction"], color=strength, size=min(found["angle"], 90.0), **fields)]
    way = middle - found["position"]
    far = float(np.linalg.norm(way))
    strength = strength / max(far, 1e-3 * radius) ** 2
    if found["flat"]:
        strength = strength * max(float(way @ found["direction"]) / max(
            far * float(np.linalg.norm(found["direction"])), 1e-30), 0.0)
    if not strength.any():
        return []
    if far > FAR * radius:
        angle = math.degrees(2 * math.atan2(found["size"], far))
        return [Light(direction=way, color=strength, size=min(angle, 90.0), **fields)]
    if found["cone"] == 360 and within and fields["shadows"]:
        left.setdefault("shadows of a light within the scene", []).append(found["name"])
        fields["shadows"] = False
    return [Light(direction=found["direction"], position=found["position"], size=found["size"], color=strength,
                  angle=max(found["cone"], 0.5), **fields)]


def _sky(found, exposure):
    """The Environment of a dome."""
    strength, turn = found["strength"] * exposure, found["turn"]
    if "texture" not in found:
        return Environment(strength)
    picture = linear_of(picture_of(found["texture"])) * strength.astype(np.float32)
    if (picture == picture[0, 0]).all():
        return Environment(picture[0, 0])
    more = -(-ROWS // len(picture))   # light of a small picture comes from all of its pixels, not from their middles
    picture = picture.repeat(more, axis=0).repeat(more, axis=1)
    if np.linalg.det(turn) > 0 and abs(turn[1, 1] - 1) < 1e-9:   # turned about +Y alone
        return Environment(picture, rotation=math.degrees(math.atan2(turn[2, 0], -turn[2, 2])))
    return Environment(turned(picture, turn))


def turned(picture: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """An equirectangular picture [h, w, 3] of OpenEXR's convention (its middle looks along +Z), whose directions rows
    times turn [3, 3] are the world's, as the picture that an `Environment` takes."""
    high, wide = picture.shape[:2]
    up = np.pi * (0.5 - (np.arange(high) + 0.5) / high)[:, None]
    around = np.pi * (2 * (np.arange(wide) + 0.5) / wide - 1)[None]
    towards = np.stack(np.broadcast_arrays(np.cos(up) * np.sin(around), np.sin(up), -np.cos(up) * np.cos(around)), 2)
    x, y, z = np.moveaxis(towards @ turn.T, 2, 0)
    column = (0.5 - np.arctan2(x, z) / (2 * np.pi)) * wide - 0.5
    row = (0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi) * high - 0.5
    left, above = np.floor(column).astype(int), np.floor(row).astype(int)
    right, below = (column - left)[..., None], (row - above)[..., None]
    rows = [np.clip(above + k, 0, high - 1) for k in (0, 1)]
    lines = [picture[each, left % wide] * (1 - right) + picture[each, (left + 1) % wide] * right for each in rows]
    return (lines[0] * (1 - below) + lines[1] * below).astype(np.float32)
