"""Hair between clfur and Blender, by Blender's own exporter and importer; by hand, not in CI: `bpy` is 350 MB.

    python -m venv blender && blender/bin/pip install "bpy==5.0.1" "numpy<2"
    python tools/blender.py blender/bin/python

Makes a scene in Blender (a mesh, hair curves, particle hair, a camera with shifts, one light of each kind, a sky),
exports it to USD, and reads it here; then writes hair here and reads it there.  Prints what each side found as a table,
for docs/blender.md.
"""

import json
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

LIGHTS = {"SUN": 2.0, "POINT": 400.0, "SPOT": 400.0, "AREA": 100.0}   # kind: strength or watts
PLACE = (0.0, 0.0, 6.0)   # of each light, above a white square of 1
SEEN = (0, 0, 1), (0, 0, 2), (1, 0, 1), (0, 1, 1)


# --- in Blender -----------------------------------------------------------------------------------------------


def make(folder):
    """Make and export a scene in Blender; returns what of it Blender itself tells."""
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_uv_sphere_add(segments=32, ring_count=16, radius=1, location=(0, 0, 1))
    body = bpy.context.object
    body.data.materials.append(_material(bpy, "Skin", (0.4, 0.1, 0.05, 1)))
    points, radii = _hair(bpy, scene, body)
    bpy.ops.mesh.primitive_plane_add(size=1, location=(3, 0, 0))
    bpy.context.object.modifiers.new("Old", "PARTICLE_SYSTEM")
    old = bpy.context.object.particle_systems[0].settings
    old.type, old.count, old.hair_length = "HAIR", 50, 0.3
    camera = bpy.data.objects.new("Cam", bpy.data.cameras.new("Cam"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location, camera.rotation_euler = (4, -6, 4), (1.08, 0, 0.59)
    camera.data.shift_x, camera.data.shift_y = 0.1, -0.05
    scene.render.resolution_x, scene.render.resolution_y = 960, 540
    bpy.context.view_layer.update()
    bpy.ops.wm.usd_export(filepath=f"{folder}/all.usdc", export_hair=True)
    bpy.ops.wm.usd_export(filepath=f"{folder}/all.usda", export_hair=True)
    return {"version": bpy.app.version_string, "points": points, "radii": radii,
            "seen": [list(world_to_camera_view(scene, camera, Vector(place)))[:2] for place in SEEN],
            "lights": {kind: _lit(bpy, kind, folder) for kind in (*LIGHTS, "WORLD")}}


def _material(bpy, name, color):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
    return material


def _hair(bpy, scene, body):
    rng = np.random.default_rng(1)
    ways = rng.normal(size=(200, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    t = np.linspace(0, 1, 6)
    points = ways[:, None] * (1 + 0.5 * t[:, None]) + np.array([0, 0, 1]) + np.array([0.2, 0, 0]) * (t**2)[:, None]
    radii = np.tile(0.01 * (1 - 0.8 * t), 200)
    curves = bpy.data.hair_curves.new("Hair")
    curves.add_curves([6] * 200)
    curves.points.foreach_set("position", points.astype(np.float32).ravel())
    curves.attributes.new("radius", "FLOAT", "POINT")
    curves.attributes["radius"].data.foreach_set("value", radii.astype(np.float32))
    curves.surface = body
    curves.materials.append(_material(bpy, "Straw", (0.3, 0.2, 0.02, 1)))
    scene.collection.objects.link(bpy.data.objects.new("Hair", curves))
    return points.reshape(-1, 3).tolist(), radii.tolist()


def _lit(bpy, kind, folder):
    """What the middle of a white square shows under one light, by Cycles; and the same scene's file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=1)
    material = bpy.data.materials.new("White")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    bsdf = nodes["Principled BSDF"]
    bsdf.inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1)
    bsdf.inputs["Specular IOR Level"].default_value = 0
    bsdf.inputs["Roughness"].default_value = 1
    bpy.context.object.data.materials.append(material)
    camera = bpy.data.objects.new("Cam", bpy.data.cameras.new("Cam"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location, camera.rotation_euler = (0, -3, 3), (0.7853982, 0, 0)
    if kind == "WORLD":
        scene.world = bpy.data.worlds.new("World")
        scene.world.use_nodes = True
        scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.5, 0.5, 0.5, 1)
    else:
        light = bpy.data.lights.new("Light", kind)
        light.energy = LIGHTS[kind]
        if kind == "SUN":
            light.angle = 0.1
        one = bpy.data.objects.new("Light", light)
        one.location = PLACE
        scene.collection.objects.link(one)
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 64, "CPU"
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.render.film_transparent = True
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = f"{folder}/{kind}.exr"
    bpy.ops.render.render(write_still=True)
    bpy.ops.wm.usd_export(filepath=f"{folder}/{kind}.usda")
    return f"{folder}/{kind}"


def read(folder):
    """What Blender reads of files that clfur wrote: {name: points, radii, how many curves, material's colour}."""
    import bpy

    found = {}
    for path in sorted(Path(folder).glob("*.usd*")):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.wm.usd_import(filepath=str(path))
        one = next((each for each in bpy.data.objects if each.type == "CURVES"), None)
        if one is None:
            found[path.name] = {"kinds": [each.type for each in bpy.data.objects]}
            continue
        data = one.data
        points = np.empty(3 * len(data.points), np.float32)
        data.points.foreach_get("position", points)
        matrix = np.array(one.matrix_world)
        points = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
        radii = np.empty(len(data.points), np.float32)
        data.attributes["radius"].data.foreach_get("value", radii)
        found[path.name] = {"points": points.tolist(), "radii": radii.tolist(), "curves": len(data.curves),
                            "names": sorted(each.name for each in data.attributes)}
    return found


# --- here -----------------------------------------------------------------------------------------------------


def main(python):
    import clfur

    with tempfile.TemporaryDirectory() as folder:
        told = _in_blender(python, "make", folder)
        warnings.simplefilter("ignore")
        print(f"Blender {told['version']}\n\n| what | in Blender | read by clfur |\n|---|---|---|")
        for name in "all.usda", "all.usdc":
            _of_blender(clfur, Path(folder, name), told)
        for kind, path in told["lights"].items():
            there = clfur.load_picture(f"{path}.exr")[16, 16, 1]
            scene = clfur.load_scene(f"{path}.usda", size=(32, 32))
            ours = clfur.render(scene)[16, 16, 1]
            print(f"| white square under {kind.lower()}, grey 0.5 | {there:.4f} | {ours:.4f} |")
    with tempfile.TemporaryDirectory() as folder:
        _to_blender(clfur, python, folder)


def _of_blender(clfur, path, told):
    scene = clfur.load_scene(path)
    to_y_up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    points, radii = np.array(told["points"]) @ to_y_up, np.array(told["radii"])
    curves = scene.fur
    roots = curves.points[np.cumsum(curves.counts) - curves.counts]
    mine = np.flatnonzero(np.linalg.norm(roots - [0, 1, 0], axis=1) < 1.01)   # hair curves, not particles'
    apart = np.abs(roots[mine] - points[::6]).max()
    first = np.cumsum(curves.counts) - curves.counts
    width = curves.width[first[mine]] if len(curves.width) == len(curves.points) else curves.width[mine]
    print(f"| {path.name}: hair curves; roots apart | 200 | {len(mine)}; {apart:.1g} |")
    print(f"| {path.name}: radius at roots, width | {radii[0]:.4f} | {float(np.ravel(width)[0]):.4f} |")
    print(f"| {path.name}: particle hairs | 50 | {len(curves.counts) - len(mine)} |")
    worst = 0.0
    for place, there in zip(SEEN, told["seen"]):
        x, y, z = (np.linalg.inv(scene.camera.pose) @ [*(np.array(place) @ to_y_up), 1])[:3]
        column, row = (scene.camera.intrinsics @ [x, -y, -z])[:2] / -z / scene.camera.size
        worst = max(worst, abs(column - there[0]), abs(1 - row - there[1]))
    print(f"| {path.name}: camera with shifts, shares of the picture apart | | {worst:.1g} |")


def _to_blender(clfur, python, folder):
    rng = np.random.default_rng(2)
    points = np.cumsum(rng.normal(size=(20, 5, 3)), axis=1)
    given = clfur.Curves(points, width=np.linspace(.1, .02, 5)[None].repeat(20, 0), color=(.1, .2, .3),
                         root_uv=rng.uniform(size=(20, 2)))
    for name in "hair.usda", "hair.usdc":
        clfur.save_curves(Path(folder, name), given)
    clfur.save_curves(Path(folder, "one.usdc"), clfur.Curves(points, width=.05))
    print("\n| written by clfur | curves | points apart | radius, of width 0.1 | names |\n|---|---|---|---|---|")
    turned = points.reshape(-1, 3) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])   # +Y up to +Z up
    for name, found in _in_blender(python, "read", folder).items():
        if "points" not in found:
            print(f"| {name} | none: {found['kinds']} | | | |")
            continue
        there = np.array(found["points"])
        apart = np.abs(there - turned).max() if there.shape == turned.shape else np.nan
        print(f"| {name} | {found['curves']} | {apart:.1g} | {found['radii'][0]:.4f} | {', '.join(found['names'])} |")


def _in_blender(python, what, folder):
    done = subprocess.run([python, __file__, "--in-blender", what, folder], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr[-2000:])
    return json.loads(Path(folder, "told.json").read_text(encoding="utf-8"))


if __name__ == "__main__":
    if sys.argv[1] == "--in-blender":
        told = json.dumps({"make": make, "read": read}[sys.argv[2]](sys.argv[3]))
        Path(sys.argv[3], "told.json").write_text(told, encoding="utf-8")
    else:
        main(sys.argv[1])
