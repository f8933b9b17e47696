"""Times the canonical frames: strands of 8 segments on a sphere, 640x480, everything rebuilt for every frame.

    python tools/bench.py                          a table
    python tools/bench.py --presets --film         each preset, in a film: only the camera moves
    python tools/bench.py --order sorted           curves in the order of where they stand, rather than in any
    python tools/bench.py --kinds shells           shell fur against layers and pixels, always a film
    python tools/bench.py --against TREE           also time another checkout of clfur, in turn
    python tools/bench.py --json                   one JSON object per frame, a line each
    python tools/bench.py --peer "COMMAND ..."     also time a program that prints one JSON line with median_s, in turn
    python tools/bench.py --save DIR               also save each picture

Shell fur is the report's sines (f = 40) on a sphere of 1,280 faces, without shadows and with one sample a pixel.
A frame is warm: programs are built and the first frames are not counted.  Its seconds run from the scene to the
picture on the host, `cpu` is what this process's threads used meanwhile (all of it, where the device is the CPU); a
stage's seconds are the device's own.  Trust ratios from one run, not seconds from two; on a busy machine, those of cpu.
"""

import argparse
import itertools
import json
import math
import os
import shlex
import statistics
import subprocess
import sys
import time

import attrs
import numpy as np
import trimesh

import clfur

SEGMENTS, LENGTH, GRAVITY, WIDTH, SEED = 8, 0.25, 0.15, 0.002, 12345
HAIR, BODY = (0.55, 0.36, 0.20), (0.30, 0.20, 0.12)


def polylines(mesh, n, order="shuffled"):
    """The canonical strands, [n, 9, 3] float32: one a face, or n spread by area; each falls as it grows.

    ``order``: "shuffled", as they come, or "sorted", by the cell of 1/16 in which they stand.
    """
    corners = mesh.positions.astype(np.float64)[mesh.faces]
    normals = mesh.normals.astype(np.float64)[mesh.faces]
    if n == len(mesh.faces):
        weights = np.full((n, 3), 1 / 3)
    else:
        rng = np.random.default_rng(SEED)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        sums = np.cumsum(area)
        face = np.minimum(np.searchsorted(sums, rng.random(n) * sums[-1]), len(area) - 1)
        a, b = np.sqrt(rng.random(n)), rng.random(n)
        weights = np.stack([1 - a, a * (1 - b), a * b], 1)
        corners, normals = corners[face], normals[face]
    place = np.einsum("nc,ncd->nd", weights, corners)
    direction = np.einsum("nc,ncd->nd", weights, normals)
    if order == "sorted":
        by_cell = np.lexsort(np.floor(place * 16).T)
        place, direction = place[by_cell], direction[by_cell]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = np.empty((n, SEGMENTS + 1, 3), np.float32)
    for k in range(SEGMENTS + 1):
        points[:, k] = place
        place = place + direction * (LENGTH / SEGMENTS)
        direction = direction - [0, GRAVITY, 0]
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return points


def canonical(n, kind, size, order="shuffled"):
    """The scene of n strands: kind "curves" brings them, "grown" lets the kernels grow them."""
    sphere = trimesh.creation.icosphere(subdivisions=5)
    mesh = clfur.Mesh(sphere.vertices, sphere.vertices, None, sphere.faces)
    if kind == "curves":
        fur = clfur.Curves(polylines(mesh, n, order), width=WIDTH, color=HAIR)
    else:
        hair = clfur.HairType(color=HAIR, segments=SEGMENTS, segment_length=LENGTH / SEGMENTS,
                              force_weight=GRAVITY, width=WIDTH)
        fur = clfur.Strands(inner=1, outer=1, types=hair, roots="faces" if n == len(mesh.faces) else n,
                            surface="flat", seed=SEED)
    return clfur.Scene(mesh=mesh, fur=fur, camera=clfur.Camera(size=size), body_color=BODY)


def canonical_shells(layers, size):
    """The scene of shell fur in so many layers."""
    fur = clfur.Shells(length=LENGTH, layers=layers, pattern="sine", frequency=40.0, noise=(0, 1), color=HAIR)
    return clfur.Scene(mesh=clfur.load_mesh("sphere"), fur=fur, camera=clfur.Camera(size=size), body_color=BODY)


def measure(scene, gpu, settings, repeat, film=False, warm=2):
    """[(clfur.Frame, seconds of the processor)] of ``repeat`` warm frames: all of them done anew, or, in a ``film``, of
    a still scene seen from ever new places."""
    frames, eye = [], scene.camera.eye
    for k in range(warm + repeat):
        if film:
            camera = clfur.Camera(eye + (0.05 * math.sin(k), 0, 0), size=scene.camera.size)
            scene = clfur.Scene(mesh=scene.mesh, fur=scene.fur, camera=camera, body_color=BODY)
        else:
            gpu.forget()
        began = time.process_time()
        frame = clfur.draw(scene, gpu, settings)
        frames.append((frame, time.process_time() - began))
    return frames[warm:]


def spread(values):
    """Median, minimum and maximum in milliseconds."""
    return {name: round(1e3 * of(values), 3) for name, of in
            (("median_ms", statistics.median), ("min_ms", min), ("max_ms", max))}


def options():
    """The command's."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--strands", type=int, nargs="+", default=[20480, 100_000, 300_000])
    parser.add_argument("--layers", type=int, nargs="+", default=[8, 15, 30, 60], help="of shells")
    parser.add_argument("--kinds", nargs="+", default=["curves", "grown"], choices=["curves", "grown", "shells"])
    parser.add_argument("--order", default="shuffled", choices=["shuffled", "sorted"], help="of curves")
    parser.add_argument("--film", action="store_true", help="move only the camera, rather than do everything anew")
    parser.add_argument("--size", nargs="+", help="[default: 640x480; of shells also 320x240 and 1280x960]")
    parser.add_argument("--presets", action="store_true", help="one after the other")
    parser.add_argument("--settings", metavar="JSON", help="clfur.Settings, instead of the four that follow")
    parser.add_argument("--raster", default="samples", choices=["samples", "coverage"],
                        help="[default: samples, opaque as the lines of OpenGL]")
    parser.add_argument("--samples", type=int, default=1)
    parser.add_argument("--shadows", choices=["off", "binary", "count", "trilinear", "length"],
                        help="[default: length, off with shells]")
    parser.add_argument("--grid", type=int, default=48)
    parser.add_argument("--repeat", type=int, default=9)
    parser.add_argument("--device")
    parser.add_argument("--peer", help="command to time in turn, three times; %%N in it becomes the number of strands "
                                       "or layers, %%S the size")
    parser.add_argument("--against", metavar="TREE", help="checkout of clfur to time in turn, three times")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--save", metavar="DIR")
    return parser


def main():
    arguments = options().parse_args()
    gpu = clfur.Scheduler(arguments.device)
    for kind, n, size in rows_of(arguments):
        shells = kind == "shells"
        pixels = tuple(map(int, size.split("x")))
        scene = canonical_shells(n, pixels) if shells else canonical(n, kind, pixels, arguments.order)
        given = clfur.Settings(**json.loads(arguments.settings)) if arguments.settings else clfur.Settings(
            raster=arguments.raster, samples=arguments.samples, grid=arguments.grid,
            shadows=arguments.shadows or ("off" if shells else "length"))
        others = {"peer": peer(arguments.peer, n, size)} if arguments.peer else {}
        for preset, settings in (clfur.PRESETS if arguments.presets else {"": given}).items():
            if arguments.against:
                others["against"] = other_tree(arguments, kind, n, size, settings)
            row = {"layers" if shells else "strands": n, "kind": kind, "order": arguments.order, "size": size,
                   "film": arguments.film or shells, "preset": preset, "raster": settings.raster,
                   "samples": settings.samples, "shadows": settings.shadows, "grid": settings.grid, "lod": settings.lod}
            frames = timed(row, scene, gpu, settings, arguments.repeat, others)
            if arguments.save:
                name = "-".join(filter(None, [kind, str(n), size, preset]))
                clfur.save(f"{arguments.save}/{name}.png", frames[-1].images["color"])
            print(json.dumps(row) if arguments.json else table(row), flush=True)


def timed(row, scene, gpu, settings, repeat, others):
    """Frames of a row, which gets what they take, and what ``others``, {name: function -> (median seconds, those of
    the processor or None)}, take in turn; -> [clfur.Frame]."""
    found, of_others = [], {name: [] for name in others}
    for _ in range(3 if others else 1):
        found += measure(scene, gpu, settings, repeat, row["film"])
        for name, other in others.items():
            of_others[name].append(other())
    frames, cpu = zip(*found)
    row |= {"device": frames[0].device, "segments": frames[0].segments, "frames": len(frames),
            "frame": spread([frame.seconds for frame in frames]), "cpu": spread(cpu),
            "stages": {name: spread([frame.stages.get(name, 0) for frame in frames]) for name in frames[0].stages}}
    for name, times in of_others.items():
        wall, processor = zip(*times)
        row[name] = spread(wall)
        row[f"frame / {name}"] = round(row["frame"]["median_ms"] / row[name]["median_ms"], 4)
        if None not in processor:
            row[f"{name} cpu"] = spread(processor)
            row[f"cpu / {name} cpu"] = round(row["cpu"]["median_ms"] / row[f"{name} cpu"]["median_ms"], 4)
    return frames


def peer(command, n, size):
    """A program that prints one line of JSON with median_s, as `timed` takes it."""
    def run():
        done = subprocess.run(shlex.split(command.replace("%N", str(n)).replace("%S", size)), capture_output=True,
                              text=True, check=True)
        return json.loads(done.stdout.splitlines()[-1])["median_s"], None
    return run


def other_tree(arguments, kind, n, size, settings):
    """The same row by another checkout in a process of its own, as `timed` takes it; a preset is what it is here."""
    def run():
        command = [sys.executable, __file__, "--json", "--kinds", kind, "--strands", str(n), "--layers", str(n),
                   "--size", size, "--order", arguments.order, "--repeat", str(arguments.repeat),
                   "--settings", json.dumps(attrs.asdict(settings)), *["--film"] * arguments.film,
                   *(["--device", arguments.device] if arguments.device else [])]
        done = subprocess.run(command, capture_output=True, text=True, check=True,
                              env={**os.environ, "PYTHONPATH": arguments.against})
        row = json.loads(done.stdout.splitlines()[-1])
        return row["frame"]["median_ms"] / 1e3, row["cpu"]["median_ms"] / 1e3
    return run


def rows_of(arguments):
    """(kind, strands or layers, size) of each row."""
    strands = [kind for kind in arguments.kinds if kind != "shells"]
    for n, kind, size in itertools.product(arguments.strands, strands, arguments.size or ["640x480"]):
        yield kind, n, size
    if "shells" in arguments.kinds:
        for n, size in itertools.product(arguments.layers, arguments.size or ["320x240", "640x480", "1280x960"]):
            yield "shells", n, size


def table(row):
    """The same for people."""
    what = "layers" if "layers" in row else "strands"
    shadows = "no shadows" if row["shadows"] == "off" else f"{row['shadows']} shadows in {row['grid']} cells"
    head = [f"{row[what]:,} {what}", row["kind"] + f" {row['order']}" * (row["kind"] == "curves"), row["size"],
            "a film" * row["film"], row["preset"], row["raster"], f"{row['samples']} a pixel",
            f"lod {row['lod']:g}" * (row["lod"] > 0), shadows, row["device"]]
    lines = [", ".join(filter(None, head))]
    rows = {**row["stages"], **{name: t for name, t in row.items() if isinstance(t, dict) and name != "stages"}}
    lines += [f"  {name:12}{t['median_ms']:9.1f} ms   ({t['min_ms']:.1f} to {t['max_ms']:.1f})"
              for name, t in rows.items()]
    lines += [f"  {name} {value:.3f}" for name, value in row.items() if " / " in name]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
