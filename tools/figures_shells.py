"""The second report's illustrations of shell fur on scenes of ours, and fur from far and in few layers."""

import statistics

import attrs
import numpy as np
import trimesh
from sheets import line, sheet, size_of, write
from shells_laws import OVER, Furred, before

import clfur
from clfur.pipeline.views import light_of, view_of
from clfur.scene import frame
from clfur.stages import march, shade
from clfur.stages.lighting import unshadowed
from clfur.stages.raster import raster
from clfur.stages.tessellate import tessellate

FUR = (0.5, 0.28, 0.12)
LIGHT = clfur.Light(direction=(1, -1, -.6))
EVEN = clfur.Light(color=(0, 0, 0), ambient=1)             # no form but that of the layers
# The report's fur function alone.
PLAIN = {"pattern": "sine", "frequency": 40.0, "noise": (0, 1), "length": .25, "root_shade": .35}


def furry(mesh, options, light=LIGHT, body_color=None, **fields):
    """The framed mesh with shells, their length in the mesh's size."""
    size = size_of(mesh)
    fields = {"color": FUR, "length": .12, "frequency": 60 / size} | fields
    fur = clfur.Shells(**fields | {"length": fields["length"] * size})
    body_color = body_color or tuple(fur.root_shade * np.array(FUR))
    return clfur.Scene(mesh=mesh, fur=fur, camera=frame(mesh, fur, options.size), light=light, body_color=body_color)


def near(scene, times, place=(.5, .5)):
    """The scene magnified so many times around a place of its picture."""
    k = np.diag([times, times, 1]) @ scene.camera.intrinsics
    k[:2, 2] += (.5 - times * np.array(place)) * scene.camera.size
    return attrs.evolve(scene, camera=clfur.Camera.calibrated(scene.camera.pose, k, scene.camera.size))


def draw(gpu, scene, **settings):
    return clfur.render(scene, gpu, clfur.Settings(**{"shadows": "off"} | settings))


def layered(scene):
    """The report's shells of a sphere of radius 1, drawn one over the other under even light, a sample a pixel."""
    fur, camera = scene.shells, scene.camera
    x, y = np.meshgrid(np.arange(camera.size[0]) + .5, np.arange(camera.size[1]) + .5)
    rays = np.linalg.solve(camera.intrinsics, np.stack([x, y, np.ones_like(x)], -1)[..., None])[..., 0] * (1, -1, -1)
    rays = rays / np.linalg.norm(rays, axis=2, keepdims=True) @ camera.pose[:3, :3].T
    eye = camera.pose[:3, 3]
    image = np.zeros((*x.shape, 4))
    for h in np.arange(fur.layers) / fur.layers:
        radius = 1 + fur.length * h
        b = rays @ eye
        inside = b**2 - eye @ eye + radius**2
        p = (eye + (-b - np.sqrt(np.maximum(inside, 0)))[..., None] * rays) / radius
        s, t = np.arctan2(p[..., 0], p[..., 2]), 2 * np.arccos(np.clip(p[..., 1], -1, 1))
        value = abs(np.sin(2 * fur.frequency * s) + np.sin(fur.frequency * t)) / 2
        u = np.clip((value - h) / max((fur.sharpness - 1) * h, 1e-9), 0, 1)
        alpha = ((inside > 0) * (u * u * (3 - 2 * u) if h else 1))[..., None]
        color = (fur.root_shade + (1 - fur.root_shade) * h) * fur.color
        image = image * (1 - alpha) + alpha * np.append(color, 1)
    return image


def first(gpu, options, path):
    """A first attempt."""
    scene = near(furry(clfur.load_mesh("sphere"), options, EVEN, **PLAIN, sharpness=1.001, layers=10), 2)
    images = [draw(gpu, scene, filtered=False, samples=1), draw(gpu, scene)]
    sheet(path, "Illustration 1, a first attempt: a hard threshold in 10 layers, even light",
          ["unfiltered, 1 sample", "filtered, 4 samples"], [("", images)])


def turned(gpu, options, path):
    """Turned normals, close up."""
    scene = near(furry(clfur.load_mesh("sphere"), options, **PLAIN | {"frequency": 20.0}), 3)
    images = [draw(gpu, attrs.evolve(scene, light=EVEN))]
    images += [draw(gpu, attrs.evolve(scene, fur=attrs.evolve(scene.shells, shading=shading)))
               for shading in ("turned", "kajiya-kay")]
    sheet(path, "Illustration 3: layers close up, with the pattern's own normals",
          ["even light", "turned normals", "Kajiya-Kay, by the hair's direction"], [("", images)])


def noise(gpu, options, path):
    """Large and small noise."""
    rows = []
    for pattern, fields in (("sine", PLAIN), ("cells", {"length": .25, "frequency": 25.0, "root_shade": .35})):
        scenes = [furry(clfur.load_mesh("sphere"), options, **fields | {"noise": noise})
                  for noise in ((0, 1), (1, 8), (1, 2))]
        rows.append((pattern, [draw(gpu, scene) for scene in scenes]))
    sheet(path, "Illustrations 4 and 5: Perlin noise moves the hairs by up to their distance",
          ["none", "waves of 8 hairs", "waves of 2 hairs"], rows)


def silhouette(gpu, options, path):
    """Layers at the edge, and marched fur."""
    scenes = [furry(clfur.load_mesh("sphere"), options, EVEN, **PLAIN, layers=layers) for layers in (8, 30)]
    place = .5, .12
    rows = []
    for name, (few, many) in (("whole", scenes), ("4 times", [near(scene, 4, place) for scene in scenes])):
        rows.append((name, [layered(few), layered(many), draw(gpu, few), draw(gpu, many)]))
    sheet(path, "Illustrations 6 and 7: the edge, with layers drawn one over the other, and with the space marched",
          ["8 layers drawn, as the report", "30 layers drawn", "8 layers marched", "30 layers marched"], rows)


def everything(gpu, options, path):
    """30 layers with noise, wind, light and shadows."""
    meshes = {"sphere": clfur.load_mesh("sphere"), "teapot": clfur.load_mesh("teapot")}
    if options.mesh:
        meshes[options.mesh_name] = options.mesh
    rows = []
    for pattern in ("sine", "cells"):
        of_pattern = {"pattern": "sine", "frequency": 40.0} if pattern == "sine" else {}
        scenes = [furry(mesh, options, length=.2 if name == "sphere" else .1, wind=(.9, .2, 0), force=(0, -.4, 0),
                        time=.2, **of_pattern) for name, mesh in meshes.items()]
        rows.append((pattern, [draw(gpu, scene, shadows="length") for scene in scenes]))
    sheet(path, "Illustrations 8 and 9: 30 layers, noise, wind, light and shadows", list(meshes), rows)


def distances(gpu, options, path):
    """From near to far, with and without the filter."""
    mesh = clfur.load_mesh("sphere")
    fur = furry(mesh, options, frequency=100.0, length=.1).shells
    rows, columns = [("unfiltered", []), ("filtered", []), (f"{OVER} × {OVER} samples", [])], []
    times = 4
    size = options.size[0] // times, options.size[1] // times
    for apart in (4, 1, .5, .25, .1):
        camera = before(mesh, fur, apart, size)
        scene = clfur.Scene(mesh=mesh, fur=fur, camera=camera, light=LIGHT, body_color=FUR)
        large = clfur.Camera.calibrated(camera.pose, np.diag([OVER, OVER, 1]) @ camera.intrinsics,
                                        (OVER * size[0], OVER * size[1]))
        truth = draw(gpu, attrs.evolve(scene, camera=large), samples=1, filtered=False)
        images = [draw(gpu, scene, samples=1, filtered=filtered) for filtered in (False, True)]
        images.append(truth.reshape(size[1], OVER, size[0], OVER, 4).mean((1, 3)))
        columns.append(f"hairs {apart:g} pixels apart")
        for (_, row), image in zip(rows, images):
            row.append(image.repeat(times, 0).repeat(times, 1))
    sheet(path, f"Far fur fades to its mean: one sample a pixel, pixels {times} times as large", columns, rows)


def layers(gpu, options, path):
    """How many layers there are."""
    rows, columns = [], []
    counts = 8, 15, 30, 60
    for name in ("sphere", "teapot"):
        images = [draw(gpu, furry(clfur.load_mesh(name), options, layers=n)) for n in counts]
        mean = [image[..., :3].mean() for image in images]
        rows.append((name, images))
        columns.append([f"{round(100 * (value / mean[2] - 1), 1) + 0:+.1f} %" for value in mean])
    columns = [f"{n} layers, mean " + ", ".join(each) for n, each in zip(counts, zip(*columns))]
    sheet(path, "The picture hardly depends on the number of layers (mean against 30)", columns, rows)


def marched(gpu, options, path):
    """What finding the layers takes: every layer's triangles drawn, or rays marched."""
    lines = ["# Layers drawn or marched", "",
             f"`python tools/figures.py --only march` on {gpu.device.name.strip()}: milliseconds on the device for 30 "
             "layers of a sphere, cells, without noise and shadows, one sample, median of 9 runs in turn.  *drawn*: "
             "`raster` alone, of the triangles of 30 layers that face the eye.  *drawn and lit*: also "
             "`shade.color` of each layer, which finds a pixel's place and lights it; neither reads the fur's "
             "pattern nor adds layers up.  *marched*: `entries` and `march`, the fur with all that belongs to it.", "",
             line("faces", "size", "drawn", "drawn and lit", "marched", "of it entries"),
             line("--:", "---", ("--:",) * 4)]
    for subdivisions in (3, 5):
        ball = trimesh.creation.icosphere(subdivisions=subdivisions)
        mesh = clfur.Mesh(ball.vertices, ball.vertices, None, ball.faces)
        fur = clfur.Shells(length=.25, frequency=60.0, noise=(0, 1))
        shells, heights = Furred(gpu, mesh, fur), 1 + fur.length * np.arange(30) / 30
        grown = [tessellate(gpu, clfur.Mesh(h * mesh.positions, mesh.normals, None, mesh.faces), 1, 1, "flat")
                 for h in heights]
        for size in ((320, 240), (640, 480), (1280, 960)):
            scene = clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(size=size), light=LIGHT)
            view, lighting = view_of(scene, 1), unshadowed(gpu, light_of(LIGHT))
            visible, times = raster(gpu, view, None, shells.body), []
            facing = gpu.full(visible.shape, np.uint32, 0)   # behind nothing, and towards the eye
            for _ in range(11):
                gpu.start()
                for layer in grown:
                    visible_layer = raster(gpu, view, None, layer, after=facing)
                    shade.color(gpu, view, lighting, visible_layer, shells.no_hair, layer, FUR)
                drawn = gpu.seconds()
                gpu.start()
                march.march(gpu, view, shells.shell, shells.packed, lighting, visible)
                spent = gpu.seconds()
                times.append((drawn["raster"], drawn["raster"] + drawn["shade"], spent["entries"] + spent["march"],
                              spent["entries"]))
            medians = [f"{1e3 * statistics.median(column):.1f}" for column in zip(*times[2:])]
            lines.append(line(f"{len(mesh.faces):,}", f"{size[0]}×{size[1]}", medians))
    write(path.with_suffix(".md"), "\n".join(lines))


SHELLS = {"first": first, "turned": turned, "noise": noise, "silhouette": silhouette, "everything": everything,
          "distances": distances, "layers": layers, "march": marched}
