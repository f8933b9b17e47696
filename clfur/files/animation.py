"""Files that move -> functions of seconds."""

import os
import warnings
from pathlib import Path

import numpy as np

from ..errors import Error, shown
from ..scene import Mesh, checks
from .gltf import animated, chunks_of, naming
from .meshes import mesh_of
from .output import is_path
from .poses import Poses
from .scenes import SceneAnimation
from .usd import SUFFIXES, is_usd

SAMPLES = 32   # keyframes at which it is seen what of a mesh moves together


def load_animation(path: str | os.PathLike, name: str | int | None = None) -> "MeshAnimation | SceneAnimation":
    """Return a function of seconds that gives what an animated file holds then: a Mesh of a glTF or GLB file, a Scene
    of a USD file.

    path: str or path-like. name: of glTF, which of its animations, a name or a number from 0; None: the first. Its
    `duration` are the seconds from 0 to the last keyframe; before 0 and after it, what moves stays as it is there:
    `walk(t % walk.duration)` goes round. `fps` are the frames a second of a USD file, None of glTF.

    glTF: translation, rotation, scale and weights of nodes, in steps, straight or by cubic splines; skins; morph
    targets of POSITION and NORMAL. All meshes have the same faces, and `numbering` as `load_mesh(path)` gives it; that
    is the pose to root hair in, as `Strands(rest=...)`. Vertices that it welds, but that part as they move, are not.
    USD: as `load_scene(path, time=...)`; times are in seconds from its first time code on.

    Raises Error, one line that names the file, as `load_mesh` and `load_scene` do, and for files that do not move.
    """
    if not is_path(path):
        raise Error(f"load_animation path is {shown(path)}; allowed: a file's name")
    file = Path(path)
    if is_usd(file):
        if name is not None:
            raise Error(f"load_animation name is {shown(name)}, but {file} is USD, which has one; allowed: None")
        return SceneAnimation(file)
    if file.suffix.lower() not in (".glb", ".gltf"):
        raise Error(f"{file}: {file.suffix or 'no suffix'} has no animations; allowed: .glb, .gltf, "
                    f"{', '.join(SUFFIXES)}")
    if not os.path.isfile(file):
        raise Error(f"{file}: {'is a folder; allowed: a file' if os.path.isdir(file) else 'no such file'}")
    return MeshAnimation(file, name)


class MeshAnimation:
    """An animation of a glTF file: called with seconds it gives the Mesh then. duration: seconds. fps: None.
    names: of all animations of the file, None for one without a name."""

    def __init__(self, path: Path, name: str | int | None = None) -> None:
        self._path, self.fps = path, None
        with naming(path):
            fields, self._motions, self.names = animated(*chunks_of(path), name)
            times = self._motions.times
            self.duration = float(times[-1])
            some = times[np.unique(np.linspace(0, len(times) - 1, SAMPLES).round().astype(int))]
            with np.errstate(all="ignore"):   # what is not finite is found by Poses.mesh
                self._poses = Poses(mesh_of(fields), (self._motions.at(float(each))[0] for each in some))
        if self._motions.left:
            listed = "; ".join(f"{what} ({where})" for what, where in self._motions.left.items())
            warnings.warn(f"{path}: left out: {listed}", stacklevel=3)
        self._last: tuple[float, Mesh] | None = None

    def __call__(self, seconds: float) -> Mesh:
        """Return the Mesh at a time; asked again, the very same."""
        seconds = checks.real()(seconds, "seconds")
        at = min(max(float(seconds), 0.0), self.duration)
        if self._last is None or self._last[0] != at:
            with naming(self._path), np.errstate(all="ignore"):
                self._last = at, self._poses.mesh(*self._motions.at(at))
        return self._last[1]
