"""Times the canonical frames: strands of 8 segments on a sphere, 640x480, everything rebuilt for every frame.

    python tools/bench.py                          a table
    python tools/bench.py --kinds shells           shell fur against layers and pixels, the camera moved for every frame
    python tools/bench.py --json                   one JSON object per frame, a line each
    python tools/bench.py --peer "COMMAND ..."     also time a program that prints one JSON line with median_s, in turn
    python tools/bench.py --save DIR               also save each picture

Shell fur is the report's sines (f = 40) on a sphere of 1,280 faces, without shadows and with one sample a pixel.
A frame is warm: programs are built and the first frames are not counted.  Its seconds run from the scene to the
picture on the host; a stage's seconds are the device's own.  Trust ratios from one run, not seconds from two.
"""

import argparse
import itertools
import json
import math
import shlex
import statistics
import subprocess

import numpy as np
import trimesh

import clfur

SEGMENTS, LENGTH, GRAVITY, WIDTH, SEED = 8, 0.25, 0.15, 0.002, 12345
HAIR, BODY = (0.55, 0.36, 0.20), (0.30, 0.20, 0.12)


def polylines(mesh, n):
    """The canonical strands, [n, 9, 3] float32: one a face, or n spread by area; each falls as it grows."""
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
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = np.empty((n, SEGMENTS + 1, 3), np.float32)
    for k in range(SEGMENTS + 1):
        points[:, k] = place
        place = place + direction * (LENGTH / SEGMENTS)
        direction = direction - [0, GRAVITY, 0]
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return points


def canonical(n, kind, size):
    """The scene of n strands: kind "curves" brings them, "grown" lets the kernels grow them."""
    sphere = trimesh.creation.icosphere(subdivisions=5)
    mesh = clfur.Mesh(sphere.vertices, sphere.vertices, None, sphere.faces)
    if kind == "curves":
        fur = clfur.Curves(polylines(mesh, n), width=WIDTH, color=HAIR)
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


def measure(scene, gpu, settings, repeat, warm=2):
    """[clfur.Frame] of ``repeat`` warm frames: every stage of strands done anew, shells seen from ever new places."""
    frames, eye = [], scene.camera.eye
    for k in range(warm + repeat):
        if scene.shells:
            camera = clfur.Camera(eye + (0.05 * math.sin(k), 0, 0), size=scene.camera.size)
            scene = clfur.Scene(mesh=scene.mesh, fur=scene.fur, camera=camera, body_color=BODY)
        else:
            gpu.forget()
        frames.append(clfur.draw(scene, gpu, settings))
    return frames[warm:]


def spread(values):
    """Median, minimum and maximum in milliseconds."""
    return {name: round(1e3 * of(values), 3) for name, of in
            (("median_ms", statistics.median), ("min_ms", min), ("max_ms", max))}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--strands", type=int, nargs="+", default=[20480, 100_000, 300_000])
    parser.add_argument("--layers", type=int, nargs="+", default=[8, 15, 30, 60], help="of shells")
    parser.add_argument("--kinds", nargs="+", default=["curves", "grown"], choices=["curves", "grown", "shells"])
    parser.add_argument("--size", nargs="+", help="[default: 640x480; of shells also 320x240 and 1280x960]")
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
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--save", metavar="DIR")
    arguments = parser.parse_args()
    gpu = clfur.Scheduler(arguments.device)

    for kind, n, size in rows_of(arguments):
        shells = kind == "shells"
        settings = clfur.Settings(raster=arguments.raster, samples=arguments.samples, grid=arguments.grid,
                                  shadows=arguments.shadows or ("off" if shells else "length"))
        pixels = tuple(map(int, size.split("x")))
        scene = canonical_shells(n, pixels) if shells else canonical(n, kind, pixels)
        frames, peer = [], []
        for _ in range(3 if arguments.peer else 1):
            frames += measure(scene, gpu, settings, arguments.repeat)
            if arguments.peer:
                command = shlex.split(arguments.peer.replace("%N", str(n)).replace("%S", size))
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                peer.append(json.loads(done.stdout.splitlines()[-1])["median_s"])
        if arguments.save:
            clfur.save(f"{arguments.save}/{kind}-{n}-{size}.png", frames[-1].images["color"])
        row = {
            "layers" if shells else "strands": n, "kind": kind, "size": size, "raster": arguments.raster,
            "samples": arguments.samples, "shadows": settings.shadows, "grid": arguments.grid,
            "device": frames[0].device, "segments": frames[0].segments, "frames": len(frames),
            "frame": spread([f.seconds for f in frames]),
            "stages": {name: spread([f.stages[name] for f in frames]) for name in frames[0].stages},
        }
        if peer:
            row["peer"] = spread(peer)
            row["ratio"] = round(row["frame"]["median_ms"] / row["peer"]["median_ms"], 4)
        print(json.dumps(row) if arguments.json else table(row), flush=True)


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
    lines = [f"{row[what]:,} {what}, {row['kind']}, {row['size']}, {row['raster']}, {row['samples']} a pixel, "
             f"{shadows}, {row['device']}"]
    rows = {**row["stages"], "frame": row["frame"], **({"peer": row["peer"]} if "peer" in row else {})}
    lines += [f"  {name:12}{t['median_ms']:9.1f} ms   ({t['min_ms']:.1f} to {t['max_ms']:.1f})"
              for name, t in rows.items()]
    if "ratio" in row:
        lines.append(f"  frame / peer {row['ratio']:.3f}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
