"""What tools/fit_budget.py and tools/prove_budget.py share: scenes, their truth, and what settings take and give."""

import io
import time
from pathlib import Path

import numpy as np

import clfur
from clfur import cache, measures, truth
from clfur.device.source import kernel_dir
from clfur.judge.frontier import digest
from clfur.scene import frame

SAMPLES = 6   # of each of two truths, squared, a pixel


def furry(mesh, strands, pixels, length, away=1.0, size=(160, 120), light=(1, -1, -0.6), segments=8, environment=None,
          **hair):
    """A mesh with so many strands, so many pixels wide, so long (in its radii), as much further than fits.

    ``light``: a direction, or what `clfur.Scene` takes.
    """
    mesh = clfur.load_mesh(mesh) if isinstance(mesh, str) else mesh
    center, radius = mesh.bounds

    def fur(width):
        kind = clfur.HairType(**{
            "color": (0.5, 0.28, 0.12), "segments": segments, "segment_length": length * radius / segments,
            "width": width, "force_weight": 0.2, "length_variation": 0.3, "direction_variation": 0.3,
            "color_variation": 0.3, **hair})
        return clfur.Strands(inner=1, outer=1, roots=strands, types=[kind])
    near = frame(mesh, fur(0.001 * radius), size)
    eye = near.target + away * (near.eye - near.target)
    camera = clfur.Camera(eye=eye, target=near.target, size=size)
    width = pixels * np.linalg.norm(eye - center) / camera.intrinsics[1, 1]
    light = clfur.Light(direction=light) if isinstance(light[0], (int, float)) else light
    return clfur.Scene(mesh=mesh, fur=fur(width), camera=camera, light=light, environment=environment)


def truths_of(scene):
    """Two true pictures with noise of their own, [2, h, w, 4], kept in the cache."""
    file = cache.folder("budget") / f"{digest(scene, SAMPLES, truth.VERSION)[:32]}.npy"
    if not file.exists():
        found, stream = np.array([truth.picture(scene, SAMPLES, seed) for seed in (0, 1)], np.float32), io.BytesIO()
        np.save(stream, found)
        cache.write(file, stream.getvalue())
    return np.load(file)


def sources():
    """Hash of all that pictures and their times hang on."""
    here = Path(clfur.__file__).parent
    files = [file for name in ("scene", "device", "stages", "pipeline") for file in here.joinpath(name).rglob("*.py")]
    files += [file for file in kernel_dir().iterdir() if file.suffix in (".cl", ".h")]
    return digest([[file.name, file.read_bytes()] for file in sorted(files, key=str)])


def error_of(picture, truths):
    """The error (see `measures.measure`) of a picture, without what the truths' noise adds to it."""
    one, other = (measures.shown(picture) - measures.shown(true) for true in truths)
    here = (picture[..., 3] > 0) | (truths[..., 3] > 0).any(0)
    return float(np.sqrt(max((one * other)[here].mean(), 0)))   # noise of one is not that of the other


def costs_of(scene, ways, gpu, repeat=3):
    """CPU seconds of a warm frame with each of some settings, everything done anew: the least of some, in turn."""
    least = np.full(len(ways), np.inf)
    for _ in range(repeat):
        for place, settings in enumerate(ways):
            for _ in range(2 if np.isinf(least[place]) else 1):
                gpu.forget()
                began = time.process_time()   # of all threads: the machine may be busy with other things
                clfur.draw(scene, gpu, settings)
                spent = time.process_time() - began
            least[place] = min(least[place], spent)
    return least
