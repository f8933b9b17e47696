"""How far shell fur is from what it stands for, in numbers: error, flicker, layers, silhouettes.

    python tools/shells_laws.py [MESH ...] [--only error,flicker,layers,silhouette] [--pattern cells,sine]

The truth is the unfiltered pattern at 8 x 8 samples a pixel: the scene drawn 8 times as large, and averaged.  A sweep
goes from a distance where hairs stand 8 pixels apart to one where ten of them share a pixel's width.  Shadows are off.
Errors are root mean squares of linear colour.  Inside: at least 2 pixels from where the truth lets light through.
"""

import argparse

import attrs
import numpy as np

import clfur
from clfur.pipeline.views import light_of, view_of
from clfur.scene import Camera, Light, frame
from clfur.stages import march, shade
from clfur.stages import shells as stage
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import NONE, raster
from clfur.stages.strands import no_strands
from clfur.stages.tessellate import tessellate

SIZE = 80, 60
OVER = 8                                         # truth's samples a pixel, across and down
APART = 8, 4, 2, 1, 0.5, 0.25, 0.1               # pixels between hairs
SHIFTS = 4                                       # steps of a pan, 1/8 of a pixel each
TOWARDS = np.array([0.45, 0.3, 1.0]) / np.linalg.norm([0.45, 0.3, 1.0])


def ball(rows=24):
    """A sphere of radius 1 with uv that is not torn."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, 2 * rows + 1), indexing="ij")
    up, around = np.pi * (v - 0.5), 2 * np.pi * u
    positions = np.stack([np.cos(up) * np.sin(around), np.sin(up), np.cos(up) * np.cos(around)], -1).round(12)
    a = (np.arange(rows)[:, None] * (2 * rows + 1) + np.arange(2 * rows)).ravel()
    b, c, d = a + 1, a + 2 * rows + 2, a + 2 * rows + 1
    faces = np.concatenate([np.stack([a, b, c], 1)[2 * rows:], np.stack([a, c, d], 1)[:-2 * rows]])
    uv = np.stack([u, v], -1).reshape(-1, 2)
    positions = positions.reshape(-1, 3)
    return clfur.Mesh(positions=positions, normals=positions, uv=uv[faces], faces=faces)


class Furred:
    """A mesh with shell fur on a device, to be drawn many times."""

    def __init__(self, gpu, mesh, fur):
        self.gpu, self.mesh, self.fur = gpu, mesh, fur
        self.body = tessellate(gpu, mesh, 1, 1, "flat")
        self.packed = stage.pack(fur, mesh, False, True)
        topology = stage.topology_of(mesh.faces)
        pattern = stage.lay(gpu, mesh, self.packed, topology)
        self.shell = stage.bend(gpu, mesh, self.packed, pattern, topology)
        self.no_hair = no_strands(gpu)

    def draw(self, camera, filtered, samples=1, layers=30):
        """Linear premultiplied picture [height, width, 4] float64."""
        packed = self.packed.copy()
        packed["kind"][3], packed["size"][1] = filtered, layers
        scene = clfur.Scene(mesh=self.mesh, fur=self.fur, camera=camera, light=Light(direction=(1, -1, -0.6)))
        view, lighting = view_of(scene, samples), unshadowed(self.gpu, light_of(scene.light))
        visible = raster(self.gpu, view, None, self.body)
        image, transmittance, _ = march.march(self.gpu, view, self.shell, packed, lighting, visible)
        image, transmittance, keys = image.get().astype(float), transmittance.get().astype(float), visible.get()
        for s in range(samples):
            alone = np.full_like(keys, NONE)
            alone[..., s] = keys[..., s]
            behind = shade.color(self.gpu, view, lighting, self.gpu.upload(alone), self.no_hair, self.body,
                                 scene.body_color)
            image += transmittance[..., s:s + 1] * behind.get()
        return image

    def truth(self, camera, shift=0, layers=30):
        """The picture by 8 x 8 samples a pixel, moved to the right by `shift` / 8 pixels."""
        (w, h), k = camera.size, camera.intrinsics.copy()
        k[:2] *= OVER
        k[0, 2] += shift
        large = self.draw(Camera.calibrated(camera.pose, k, (w * OVER, h * OVER)), False, layers=layers)
        return large.reshape(h, OVER, w, OVER, 4).mean((1, 3))


def spacing(mesh, fur):
    """Distance between hairs: the root of the area that one has."""
    if fur.pattern == "cells":
        return 1 / fur.frequency
    a, b, c = (mesh.uv[:, i].astype(float) for i in range(3))
    flat = np.abs(np.linalg.det(np.stack([b - a, c - a], 1))).sum() / 2
    return np.sqrt(mesh.area / (flat * 4 * fur.frequency**2))     # two in each period of 1/2f by 1/f


def before(mesh, fur, apart, size=SIZE):
    """The camera before the nearest tips, so far that hairs there stand `apart` pixels from each other."""
    center = mesh.bounds[0]
    a, b, c = (mesh.positions[mesh.faces[:, i]].astype(float) for i in range(3))
    n = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((a - center) * n).sum(1) / (n @ TOWARDS)
    p = center + np.where(np.isfinite(t), t, 0)[:, None] * TOWARDS
    inside = np.isfinite(t) & (t > 0)
    for i, j in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(j - i, p - i) * n).sum(1) >= 0
    surface = t[inside].max()
    focal = size[1] / 2 / np.tan(np.radians(45) / 2)
    away = surface + fur.length + spacing(mesh, fur) * focal / apart
    return Camera(eye=center + away * TOWARDS, target=center, fov=45, size=size)


def grown(mask, n):
    """Pixels within n pixels of those of the mask."""
    h, w = mask.shape
    wide = np.pad(mask, n)
    return np.any([wide[i:i + h, j:j + w] for i in range(2 * n + 1) for j in range(2 * n + 1)], 0)


def rms(difference, mask):
    return float(np.sqrt((difference[mask][:, :3]**2).mean())) if mask.any() else np.nan


def moved(camera, shift):
    k = camera.intrinsics.copy()
    k[0, 2] += shift
    return Camera.calibrated(camera.pose, k, camera.size)


def errors(furred, apart):
    """(apart, error filtered, unfiltered, ratio, the same everywhere, brightness filtered / truth)."""
    camera = before(furred.mesh, furred.fur, apart)
    truth = furred.truth(camera)
    inside = ~grown(truth[..., 3] < 0.999, 2)
    pair = [furred.draw(camera, filtered) for filtered in (True, False)]
    here = [rms(picture - truth, inside) for picture in pair]
    all_ = [rms(picture - truth, truth[..., 3] > 0) for picture in pair]
    bright = pair[0][inside, :3].mean() / truth[inside, :3].mean()
    return apart, *here, here[0] / here[1], *all_, all_[0] / all_[1], bright


def flicker(furred, apart):
    """(apart, flicker filtered, unfiltered, ratio): change of the picture less that of the truth, as it pans."""
    camera = before(furred.mesh, furred.fur, apart)
    truths = [furred.truth(camera, shift) for shift in range(SHIFTS + 1)]
    inside = ~grown(np.min(truths, 0)[..., 3] < 0.999, 2)
    result = []
    for filtered in (True, False):
        drawn = [furred.draw(moved(camera, shift / OVER), filtered) for shift in range(SHIFTS + 1)]
        changes = [(b - a) - (d - c) for a, b, c, d in zip(drawn, drawn[1:], truths, truths[1:])]
        result.append(np.sqrt(np.mean([rms(change, inside)**2 for change in changes])))
    return apart, *result, result[0] / result[1]


def layers(furred, apart):
    """(apart, % that the mean brightness of 15, 60, 120 layers differs from that of 30; and of the truth)."""
    camera = before(furred.mesh, furred.fur, apart)
    mean = {n: furred.draw(camera, True, layers=n)[..., :3].mean() for n in (30, 15, 60, 120)}
    true = {n: furred.truth(camera, layers=n)[..., :3].mean() for n in (30, 15, 60)}
    return apart, *(100 * (mean[n] / mean[30] - 1) for n in (15, 60, 120)), \
        *(100 * (true[n] / true[30] - 1) for n in (15, 60)), 100 * (mean[30] / true[30] - 1)


def silhouette(furred, samples):
    """(samples, error in the band along the edge, inside, ratio), of the whole mesh framed."""
    camera = frame(furred.mesh, furred.fur, (160, 120))
    truth = furred.truth(camera)
    edge = (truth[..., 3] > 0.001) & grown(truth[..., 3] < 0.999, 2)
    inside = (truth[..., 3] > 0.001) & ~edge
    error = furred.draw(camera, True, samples) - truth
    return samples, rms(error, edge), rms(error, inside), rms(error, edge) / rms(error, inside)


LAWS = {
    "error": (errors, APART, "px/hair | inside: filtered unfiltered ratio (<= 1/3) | all: the same | brightness"),
    "flicker": (flicker, APART, "px/hair | filtered unfiltered ratio (< 1/3)"),
    "layers": (layers, (4, 1, 0.25), "px/hair | % of 15, 60, 120 to 30 (< 2) | truth's of 15, 60 | filtered to truth"),
    "silhouette": (silhouette, (1, 4), "samples | edge inside ratio (<= 2)"),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", default=["sphere", "teapot"], help="sphere, or what clfur.load_mesh takes")
    parser.add_argument("--only", default=",".join(LAWS))
    parser.add_argument("--pattern", default="cells,sine")
    parser.add_argument("--device")
    options = parser.parse_args()
    gpu = clfur.Scheduler(clfur.device.choose(options.device))
    for name in options.meshes:
        mesh = ball() if name == "sphere" else clfur.load_mesh(name)
        radius = mesh.bounds[1]
        for pattern in options.pattern.split(","):
            fur = clfur.Shells(length=0.1 * radius, pattern=pattern, frequency=100 / radius)
            if pattern == "sine":
                fur = attrs.evolve(fur, frequency=100.0)
                fur = attrs.evolve(fur, frequency=100.0 * spacing(mesh, fur) * 100 / radius)
            furred = Furred(gpu, mesh, fur)
            print(f"\n== {name}, {pattern}, hairs {spacing(mesh, fur) / radius:.4f} of the radius apart", flush=True)
            for law in options.only.split(","):
                measure, values, heading = LAWS[law]
                print(f"{law}: {heading}", flush=True)
                for value in values:
                    print("  " + " ".join(f"{number:9.4f}" for number in measure(furred, value)), flush=True)


if __name__ == "__main__":
    main()
