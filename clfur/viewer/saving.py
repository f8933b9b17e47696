"""What is viewed as files: a scene file that draws the same bytes, strands, pictures."""

import functools
import io
import json
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from .. import save_curves
from ..errors import Error, shown
from ..files.images import encoded
from ..render import Frame, grow
from ..scene import Camera, Curves, Mesh, Scene
from .document import MeshFile, State

FEW = 16        # numbers of an array that stand in the text; more are beside it
WIDE = 120      # characters of a line
ROUNDS = 50     # in which normals are found
PICTURES = ".png", ".exr"
STRANDS = {".npz": "NumPy", ".usdc": "USD", ".usda": "USD as text", ".hair": "cyHair", ".tfx": "TressFX",
           ".data": "USC-HairSalon", ".ply": "PLY", ".txt": "Mitsuba", ".pbrt": "pbrt"}   # of `clfur.save_curves`
HEAD = '''"""A scene as it was viewed: `clfur render {name}.py` draws it.{still}"""

'''
STILL = " A still, at {:.6g} s, of a scene that is a function of seconds."


def scene_file(state: State, camera: Camera, name: str = "scene", seconds: float = 0.0) -> tuple[str, bytes]:
    """Return (a file's name, its bytes) of a scene, its settings and its motion, seen by a camera, as Python text.

    Of a function of seconds it is the scene at so many, and the text says so. `clfur render` draws the bytes that the
    viewer's final picture has. What the text cannot hold, large arrays and a mesh that was dropped, is beside it, all
    in a .zip; else it is a .py. Raises Error for what no file can say: a Comb that is a function, and maps by vertex or
    face of a mesh that is not as its file has it.
    """
    writer = _Writer(state.mesh_file, name)
    text = writer.module(attrs.evolve(state.at(seconds), camera=camera), state, seconds)
    compile(text, f"{name}.py", "exec")
    if not writer.beside and not writer.arrays:
        return f"{name}.py", text.encode()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, data in {f"{name}.py": text.encode(), **writer.files()}.items():
            archive.writestr(file, data)
    return f"{name}.zip", packed.getvalue()


def strand_file(scene: Scene, suffix: str, device: Any = None, stop: Callable[[], bool] | None = None) -> bytes:
    """Return the bytes of a strand file that `clfur.save_curves` writes of a scene's strands; raises Error without.

    stop: as for `clfur.grow`."""
    if scene.strands is None:
        raise Error("the scene has no strands to save; allowed: one with Strands or Curves")
    curves = scene.strands.on_host if isinstance(scene.strands, Curves) else grow(scene, device, stop)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"strands{suffix}"
        try:
            save_curves(path, curves, stop)
        except Error as error:   # the file's name says nothing to anybody
            raise Error(str(error).replace(f"{path}: ", "")) from None
        return path.read_bytes()


def picture_file(frame: Frame, camera: Camera, suffix: str) -> bytes:
    """Return the bytes of a .png or .exr file that `clfur.save` writes of a frame."""
    return encoded(suffix, frame.images["color"], camera, frame.settings)


class _Writer:
    """Objects as Python text. arrays: {name: array} of what is in the file of arrays; beside: {name: bytes}."""

    def __init__(self, mesh_file: MeshFile | None, name: str) -> None:
        self.mesh_file, self.name = mesh_file, name
        self.arrays: dict[str, np.ndarray] = {}
        self.beside: dict[str, bytes] = {}

    def files(self) -> dict[str, bytes]:
        """{name: bytes} of all that belongs beside the text."""
        if not self.arrays:
            return self.beside
        file = io.BytesIO()
        arrays: dict[str, Any] = self.arrays
        np.savez_compressed(file, **arrays)
        return {**self.beside, f"{self.name}.npz": file.getvalue()}

    def module(self, scene: Scene, state: State, seconds: float) -> str:
        """The text of a scene file."""
        parts = [f"scene = {self.of(scene, 0)}", f"settings = {self.of(state.settings, 0)}"]
        if state.motion is not None:
            said = self._fields(state.motion, 0, lambda name, value: f'"{name}": {value}')
            parts.append(f"motion = {{{said}}}")
        head = HEAD.format(name=self.name, still=STILL.format(seconds) if state.given is not None else "")
        if self.arrays or self.beside:
            head += "from pathlib import Path\n\n"
        head += ("import numpy as np\n\n" if self.arrays else "") + "import clfur\n\n"
        if self.arrays:
            head += f'ARRAYS = np.load(Path(__file__).with_name("{self.name}.npz"))\n'
        return head + "\n".join(parts) + "\n"

    def of(self, value: Any, deep: int) -> str:
        """The text of a value, whose further lines are so deep."""
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, Mesh):
            return self._mesh(value, deep)
        if isinstance(value, Camera) and value.eye is None:
            inner = ", ".join(self.of(each, deep) for each in (value.pose, value.intrinsics, value.size))
            return f"clfur.Camera.calibrated({inner})"
        if type(value).__name__ == "Skin":
            return self._skin(value, deep)
        if type(value).__name__ == "Bounds":
            return f"clfur.scene.Bounds({self._fields(value, deep)})"
        if attrs.has(type(value)):
            return f"clfur.{type(value).__name__}({self._fields(value, deep)})"
        if isinstance(value, np.ndarray):
            few = value.size <= FEW and value.dtype.kind != "u"   # of bytes the dtype says that they are sRGB
            return self.of(_plain(value.tolist()), deep) if few else self._array(value)
        if isinstance(value, (tuple, list)):
            inner = _joined([self.of(each, deep + 1) for each in value], deep)
            return f"({inner},)" if len(value) == 1 else f"({inner})"
        if isinstance(value, dict):
            return f"{{{_joined([f'{key!r}: {self.of(each, deep + 1)}' for key, each in value.items()], deep)}}}"
        if isinstance(value, str):
            return _quoted(value)
        if value is None or isinstance(value, (bool, int, float)):
            return repr(value)
        raise Error(f"a scene file cannot say {shown(value)}; allowed: what is no function")

    def _fields(self, thing, deep, word="{}={}".format):
        """name=value of the fields that are not as they are by themselves."""
        usual, said = _usual(type(thing)), []
        for field in attrs.fields(type(thing)):
            value = getattr(thing, field.name)
            if field.init and not (_same(value, field.default) or (usual and _same(value, getattr(usual, field.name)))):
                said.append(word(field.alias, self.of(value, deep + 1)))
        return _joined(said, deep)

    def _array(self, array):
        """Text that reads an array from the file of arrays."""
        name = next((name for name, known in self.arrays.items() if known is array), f"array{len(self.arrays)}")
        self.arrays[name] = array
        return f'ARRAYS["{name}"]'

    def _mesh(self, mesh, deep):
        """Text that gives a mesh: of its file, where it is as that has it, else of its arrays."""
        file = self.mesh_file
        if file is None or file.mesh is not mesh:
            given = {"positions": mesh.positions, "normals": normals_for(mesh), "faces": mesh.faces,
                     "uv": mesh.uv if mesh.has_uv else None, "material_of": mesh.material_of}
            said = [f"{name}={self._array(array)}" for name, array in given.items() if array is not None]
            if mesh.origin.any():
                said.append(f"origin={self.of(mesh.origin, deep)}")
            return f"clfur.Mesh({_joined(said, deep)})"
        if file.path is None:
            self.beside[f"{self.name}-mesh{file.suffix}"] = file.data
            where = f'Path(__file__).with_name("{self.name}-mesh{file.suffix}")'
        else:
            where = _quoted(_absolute(file.path))
        text = f"clfur.load_mesh({where})"
        return f"clfur.scene.upright({text})" if file.up == "z" else text

    def _skin(self, skin, deep):
        """Text of what `Maps` and `Comb` take for what they hold."""
        if skin.per == "function":
            raise Error("a scene file cannot say a Comb that is a function; allowed: one of vectors or pictures")
        if skin.per in ("vertex", "face", "array") and self.mesh_file is None:
            raise Error(f"a scene file cannot say values by {skin.per} of a mesh that is no file's; allowed: pictures")
        if skin.per in ("vertex", "face"):
            return f'{{"{skin.per}": {self.of(skin.data, deep)}}}'
        data = skin.data.get(0, skin.data) if isinstance(skin.data, dict) else skin.data   # 0: no tile
        return self.of(data, deep)


def normals_for(mesh: Mesh) -> np.ndarray:
    """Return normals float64 [P, 3] of which, given with its stored arrays, `Mesh` makes the very normals of a mesh.

    Unit vectors within half a step of float32 of those: found by going between the sphere and that box in turn.
    """
    stored = mesh.normals
    low, high = ((stored.astype(np.float64) + 0.999 * np.nextafter(stored, end).astype(np.float64)) / 1.999
                 for end in (np.float32(-2), np.float32(2)))   # all that is rounded to it
    normals = stored.astype(np.float64)
    for _ in range(ROUNDS):
        normals = np.clip(normals / np.linalg.norm(normals, axis=1, keepdims=True), low, high)
    return normals


@functools.cache
def _usual(kind):
    """An object of a class as it is if nothing is given, or None where something must be."""
    try:
        return kind()
    except (TypeError, Error):
        return None


def _same(value, other):
    """Whether two fields hold the same."""
    if isinstance(value, np.ndarray) or isinstance(other, np.ndarray):
        return isinstance(other, (np.ndarray, tuple)) and np.array_equal(value, other)
    if type(value) is not type(other):
        return False
    if attrs.has(type(value)):
        return all(_same(getattr(value, field.name), getattr(other, field.name))
                   for field in attrs.fields(type(value)) if field.init)
    if isinstance(value, tuple):
        return len(value) == len(other) and all(map(_same, value, other))
    return value == other


def _plain(value):
    """A list of lists as tuples."""
    return tuple(map(_plain, value)) if isinstance(value, list) else value


def _quoted(text):
    """A text as Python has it, escaped where it is no Unicode, as names of files may be."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return ascii(text)
    return json.dumps(text, ensure_ascii=False)


def _joined(texts, deep):
    """Texts with commas, on one line where they fit, else each on its own."""
    line = ", ".join(texts)
    if "\n" not in line and len(line) + 4 * deep + 20 <= WIDE - 20:
        return line
    indent = "\n" + "    " * (deep + 1)
    return indent + f",{indent}".join(texts)


def _absolute(path):
    """A path from any folder; built-in names as they are."""
    from ..files.meshes import BUILT_IN

    return str(path) if str(path) in BUILT_IN else str(Path(path).resolve())
