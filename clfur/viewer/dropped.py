"""Files that are dropped on the page: read as data, never run, each into a change of the scene."""

import tempfile
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from .. import load_curves, load_materials, load_mesh, load_picture
from ..errors import Error
from ..files.curves import READERS as STRANDS
from ..files.curves import USD
from ..files.meshes import READERS as MESHES
from ..files.usd import alone
from ..scene import Environment, HairType, Mesh, Scene, Strands, frame
from ..scene.strands import blends
from .coats import fitted, short_fur
from .document import Document, MeshFile

MOST = 1 << 28          # bytes of a file
PICTURES = ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp"
SKIES = ".hdr", ".exr"
ALLOWED = (*MESHES, *PICTURES, *SKIES, *(each for each in (*STRANDS, *USD) if each not in MESHES))
NEAR = 1.5              # radii of a mesh within which strands' roots are taken to stand on it
TYPES = 16              # of a type map, at most, that are made of its colours
APART = 48              # 8-bit steps that colours of a type map are apart, in one channel at least
FEW, EDGES = 1 / 500, 1 / 20   # shares of a picture that are no type's; that are edges, if their colour is a blend


def suffix_of(name: str, size: int) -> str:
    """Return the suffix of a file that may be dropped, by its name and its size in bytes; raises Error otherwise."""
    suffix = Path(name.replace("\\", "/")).suffix.lower()
    if suffix == ".py":
        raise Error("a scene file is a program, and a page may not run one; allowed: `clfur view` of it in the shell")
    if suffix not in ALLOWED:
        raise Error(f"files {suffix or 'without a suffix'} cannot be dropped; allowed: {', '.join(ALLOWED)}")
    if size > MOST:
        raise Error(f"the file has {size / 2**20:,.1f} MiB; allowed: at most {MOST / 2**20:,.1f}")
    if not size:
        raise Error("the file is empty")
    return suffix


def take(document: Document, name: str, data: bytes) -> str:
    """Bring a file's bytes into a document -> what was done, in a line.

    A mesh takes the place of the scene's, with its coat as large beside it (see `coats.fitted`), and the materials of
    glTF. Strands take the place of strands; where their roots are far from the mesh, of the mesh too. A picture is a
    type map, whose colours become types where the types do not have them as keys; .hdr and .exr are skies.
    The name tells the suffix alone: the file is in a folder of its own, which is gone in the end, and no other file is
    read. Raises Error, one line, for what cannot be read or does not fit; then nothing is changed.
    """
    suffix = suffix_of(name, len(data))
    with tempfile.TemporaryDirectory(prefix="clfur-") as folder:
        path = Path(folder) / f"file{suffix}"
        path.write_bytes(data)
        try:
            if suffix in USD:
                path = alone(path)
            return _take(document, path, data)
        except Error as error:   # the name is ours, and says nothing to anybody
            raise Error(str(error).replace(f"{path}: ", "").replace(str(path), "the file")) from None
        except MemoryError:
            raise Error("the file needs more memory than there is") from None


def _take(document, path, data):
    suffix, scene = path.suffix, document.state.scene
    if suffix in SKIES:
        document.set(("scene", "environment"), Environment(load_picture(path)))
        return "a sky"
    if suffix in PICTURES:
        return _take_map(document, scene, load_picture(path))
    if (suffix == ".ply" and _is_strands(data)) or suffix not in MESHES:
        return _take_strands(document, scene, load_curves(path))
    mesh = load_mesh(path)
    fields: dict[str, Any] = {}
    if suffix in (".glb", ".gltf") and (materials := load_materials(path)):
        fields["body_color"] = materials
    elif isinstance(scene.body_color, tuple):   # which were of the other mesh
        fields["body_color"] = (0.3, 0.2, 0.12)
    after, motion = with_mesh(scene, mesh, **fields), document.state.motion
    if motion is not None and scene.mesh is not None:
        motion = attrs.evolve(motion, units_per_metre=motion.units_per_metre * mesh.bounds[1] / scene.mesh.bounds[1])
    document.change(scene=after, mesh_file=MeshFile(mesh, data=data, suffix=suffix), motion=motion)
    return f"a mesh of {len(mesh.faces):,} faces"


def with_mesh(scene: Scene, mesh: Mesh, **fields: Any) -> Scene:
    """Return the scene with another mesh, its coat and lights as large and far beside it, and framed anew."""
    if scene.mesh is None:
        fur: Any = short_fur(mesh)
    elif scene.fur is None:
        fur = None
    else:
        fur = fitted(scene.fur if isinstance(scene.fur, tuple) else (scene.fur,), scene.mesh, mesh)
    if scene.mesh is not None:
        (here, before), (there, now) = scene.mesh.bounds, mesh.bounds
        lights = [light if light.position is None else attrs.evolve(
            light, position=there + (light.position - here) * (now / before), size=light.size * now / before)
            for light in scene.lights]
        fields["light"] = tuple(lights)
    ground = scene.ground and attrs.evolve(scene.ground, height=None)
    after = attrs.evolve(scene, mesh=mesh, fur=fur, camera=None, ground=ground, **fields)
    return _of_size(after, scene.camera.size)


def _of_size(scene, size):
    """A scene framed by itself, in a picture of (width, height)."""
    return attrs.evolve(scene, camera=frame(scene.mesh, scene.fur, size, ground=scene.ground, lights=scene.lights))


def _is_strands(data):
    """Whether a .ply file has strands, and no faces."""
    head = data[:data.find(b"end_header") + 1 or 4096]
    return b"element face" not in head and (b"element strand" in head or b"element edge" in head)


def _take_strands(document, scene, curves):
    mesh, said = scene.mesh, f"{len(curves.counts):,} strands"
    first = np.cumsum(curves.counts, dtype=np.int64) - curves.counts
    roots = curves.points[first[curves.counts > 0]] + curves.origin
    if mesh is not None:
        center, radius = mesh.bounds
        if np.median(np.linalg.norm(roots - center, axis=1)) > NEAR * radius:
            mesh, said = None, f"{said}, without the mesh, which is elsewhere"
    fur = [each for each in (scene.shells, curves) if each is not None] if mesh is not None else curves
    after = attrs.evolve(scene, mesh=mesh, fur=fur, camera=None, body="drawn" if mesh is None else scene.body)
    document.change(scene=_of_size(after, scene.camera.size))
    return said


def _take_map(document, scene, pixels):
    strands = scene.strands
    if not isinstance(strands, Strands):
        raise Error("a picture tells where types of hair grow, but the scene has no Strands; allowed: with a coat of "
                    "strands")
    if pixels.dtype != np.uint8:
        raise Error("the picture has more than 8 bits a channel; allowed in a type map: 8, as the keys of types have")
    types = strands.types if _are_known(pixels, strands.types) else types_of(pixels, strands.types)
    after = attrs.evolve(strands, type_map=pixels, types=types)
    document.set(("scene", "strands"), after)
    return f"a type map of {len(types)} types"


def _are_known(pixels, types):
    """Whether types have keys, and nearly all pixels are near one of them."""
    keys = [kind.key for kind in types]
    if None in keys or len(set(keys)) < len(keys):
        return False
    some = pixels.reshape(-1, 3)[::max(pixels.size // 3 // 65536, 1)].astype(float)
    away = np.min([np.abs(some - key).max(1) for key in keys], axis=0)
    return float((away <= APART).mean()) > 0.95


def types_of(pixels: np.ndarray, types: tuple[HairType, ...]) -> list[HairType]:
    """Return a hair type for each colour of a picture uint8 [h, w, 3] that a type map would be of, at most 16.

    The first ones are those given; further ones are as the last is, in the map's colour, so that they are told apart.
    Raises Error where the picture has more colours than that, as a photo.
    """
    packed, counts = np.unique(pixels.reshape(-1, 3).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32),
                               return_counts=True)
    order = np.argsort(-counts, kind="stable")
    colors = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], 1)[order].astype(int)
    keys: list[Any] = []
    for color, share in zip(colors[:4096], counts[order] / counts.sum()):
        new = all(np.abs(color - key).max() > APART for key in keys)
        if not keys or (new and share >= FEW and (share >= EDGES or not _is_blend(color, keys))):
            keys.append(color)
    near = np.min([np.abs(colors - key).max(1) for key in keys], axis=0) <= APART
    clear = counts[order][near].sum() / counts.sum()
    if len(keys) > TYPES or clear < 0.8 or _furthest(colors, keys) > blends(keys):
        raise Error(f"the picture has {len(colors):,} colours, as a photo has; allowed in a type map: up to {TYPES} "
                    "plain ones")
    return [_keyed(types[n], key) if n < len(types) else _painted(types[-1], key) for n, key in enumerate(keys)]


def _is_blend(color, keys):
    """Whether a colour lies between two of these keys, as a soft brush leaves it where they meet."""
    for n, one in enumerate(keys):
        for other in keys[n + 1:]:
            way = other - one
            share = min(max(float((color - one) @ way) / float(way @ way), 0), 1)
            if np.abs(one + share * way - color).max() <= APART / 2:
                return True
    return False


def _furthest(colors, keys):
    """How far the colour that is furthest from all keys is from the nearest of them."""
    nearest = np.full(len(colors), np.inf)
    for key in keys:
        nearest = np.minimum(nearest, np.sqrt(((colors - key) ** 2).sum(1)))
    return float(nearest.max())


def _keyed(kind, key):
    return attrs.evolve(kind, key=tuple(key.tolist()))


def _painted(kind, key):
    """A type like another, in the colour of its key."""
    plain = {} if kind.look.color is not None else {
        "color": np.maximum(key, 8).astype(np.uint8), "root_color": None, "tip_color": None}
    return attrs.evolve(_keyed(kind, key), **plain)
