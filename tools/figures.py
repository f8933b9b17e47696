"""Figures 8 to 13 of the first report on scenes of ours, charts of each shadow method's error, and shell fur.

    pip install ".[figures]"
    python tools/figures.py                            all of them into docs/figures
    python tools/figures.py --only 8,11,chart          some of them
    python tools/figures.py --only chart --mesh FILE   the chart with one more mesh

`chart` holds the light that each method lets through, at random places on strands, against clfur.truth.  The sums are
those of the device; they are read back, and looked up in NumPy as cl/light.h's through_hair does, what each place adds
itself included.  The report's methods know no width of a hair, so that each is also shown with the alpha that fits it
best to the truth.
"""

import argparse
import dataclasses
import functools
import math
import statistics
from pathlib import Path

import attrs
import numpy as np
from figures_shells import SHELLS
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, ScalarFormatter
from sheets import line, save, sheet, size_of, write

import clfur
from clfur import truth
from clfur.color import srgb_to_linear
from clfur.files.teapot import teapot
from clfur.pipeline.shadows import cast_shadows
from clfur.pipeline.views import view_of
from clfur.scene import frame
from clfur.settings import SHADOWS
from clfur.stages import shade
from clfur.stages.raster import raster
from clfur.stages.strands import grow
from clfur.stages.tessellate import tessellate

Settings = functools.partial(clfur.Settings, raster="samples", grid=48)   # as the report: opaque lines, coarse cells
METHODS = SHADOWS[1:-1]
INK = {"binary": "#7f7f7f", "count": "#d95f02", "trilinear": "#7570b3", "length": "#1b9e77"}
FUR = (0.5, 0.28, 0.12)
STEPS = 24                                                 # of a cell's angle, in the light's sweep
SWEPT = (-.9, -.6, -.3)                                    # where it begins


# --- scenes and pictures --------------------------------------------------------------------------------


def furry(mesh, options, strands=None, length=None, light=(-1, -1, -1), **hair):
    """The mesh with `strands` hairs (or one on each tessellated triangle), sized by the mesh."""
    size = size_of(mesh)
    hair = {"color": FUR, "segments": 8, "segment_length": (length or options.length) * size / 8, "width": 0.002 * size,
            "force_weight": 0.15} | hair
    levels = (5, 5) if strands is None else (1, 1)
    fur = clfur.Strands(*levels, types=clfur.HairType(**hair), roots="faces" if strands is None else strands)
    return clfur.Scene(mesh=mesh, fur=fur, camera=frame(mesh, fur, options.size), light=clfur.Light(direction=light))


def on_device(gpu, scene):
    """The scene's strands and body."""
    fur = scene.strands
    body = tessellate(gpu, scene.mesh, fur.inner, fur.outer, fur.surface)
    return grow(gpu, body, fur), body


def unsummed(gpu, scene, settings):
    """The picture without the sum along the light: a place sees its own cells; the mean one halves the light."""
    strands, body = on_device(gpu, scene)
    lighting = cast_shadows(gpu, scene, settings, strands, body)
    cells = np.diff(lighting.crossings.get(), axis=0)
    packed = lighting.shadows.get()
    packed["hair"] = math.log(2) * np.count_nonzero(cells) / cells.sum(dtype=float), 0, 0, 0
    lighting = dataclasses.replace(lighting, shadows=gpu.upload(packed),
                                   crossings=gpu.upload(np.concatenate([cells, 0 * cells[:1]])))
    view = view_of(scene, settings.samples)
    return shade.color(gpu, view, lighting, raster(gpu, view, strands, body), strands, body, scene.body_color).get()


def with_hair(scene, **fields):
    """The scene with other fields of its only hair type."""
    return attrs.evolve(scene, fur=attrs.evolve(scene.strands, types=attrs.evolve(scene.strands.types[0], **fields)))


# --- the report's figures -------------------------------------------------------------------------------


def figure_8(gpu, options, path):
    """Tessellation."""
    mesh = options.mesh or clfur.Mesh(*teapot(3)[:2], None, teapot(3)[3])
    off, rows, columns = Settings(shadows="off"), [], []
    pictures = {}
    for level in (1, 5):
        scene = furry(mesh, options, length=0.12, light=(-1, -1, -.5))
        scene = attrs.evolve(scene, fur=attrs.evolve(scene.strands, inner=level, outer=level))
        _, body = on_device(gpu, scene)
        positions, triangles = body.positions.get()[:, :3], body.triangles.get()[:, :3]
        edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
        wires = clfur.Curves(positions[edges], width=0.002 * size_of(mesh), color=(0, 0, 0), specular=0)
        bare = clfur.Mesh(positions, body.normals.get()[:, :3], None, triangles)
        bare = clfur.Scene(mesh=bare, fur=wires, camera=scene.camera, light=scene.light, body_color=(.7, .6, .5))
        fur = clfur.draw(scene, gpu, off)
        pictures[level] = clfur.render(bare, gpu, off), fur.images["color"]
        columns.append(f"inner {level}, outer {level}: {fur.triangles:,} triangles, {fur.strands:,} strands")
    times = len(triangles) / len(mesh.faces)
    rows = [("body", [pictures[1][0], pictures[5][0]]), ("strands", [pictures[1][1], pictures[5][1]])]
    sheet(path, f"Figure 8: tessellation gives {times:g} times the triangles and strands", columns, rows)


def figure_9(gpu, options, path):
    """Hair types."""
    mesh = clfur.load_mesh("sphere")
    kinds = {                                              # the report's segments, lengths, weights and colours
        "head": (5, .03, 1, (1, 1, 1), (255, 0, 255)), "mane": (10, .06, .4, (.8, .8, .2), (255, 160, 0)),
        "body": (5, .03, 1, (.6, .6, .4), (0, 160, 0)), "tail": (10, .04, .2, (.5, .25, .1), (0, 0, 255)),
        "eyes": (1, 0, 1, (0, 0, 0), (0, 0, 0))}
    types = [clfur.HairType(segments=segments, segment_length=length, force_weight=weight, color=color, key=key,
                            width=.004, specular=.1) for segments, length, weight, color, key in kinds.values()]
    v, u = np.mgrid[0:1:128j, 0:1:256j]                    # from the top; once round
    kind = np.where(v < .22, 0, np.where(v < .34, 1, np.where(v < .72, 2, 3)))
    kind[4 * np.minimum((u - .45) ** 2, (u - .55) ** 2) + (v - .46) ** 2 < .004] = 4
    keys = np.array([t.key for t in types], np.uint8)[kind]
    camera, off = clfur.Camera((0, .9, 3.8), (0, -.05, 0), fov=42, size=options.size), Settings(shadows="off")
    columns, images = ["the map: " + ", ".join(kinds)], []
    for level in (1, 5):
        fur = clfur.Strands(level, level, types=types, type_map=keys, force=(0, -.3, 0),
                            point_forces=clfur.PointForce((2, 0, 2), 1))
        scene = clfur.Scene(mesh=mesh, fur=fur, camera=camera, light=clfur.Light((-.5, -1, -1)))
        drawn = clfur.draw(scene, gpu, off)
        columns.append(f"{level}/{level}: {drawn.strands:,} strands")
        images.append(drawn.images["color"])
    # The map as the camera sees it on the bare sphere, from the uv of each pixel.
    outputs = clfur.render(clfur.Scene(mesh=mesh, camera=camera), gpu, off, ("uv", "coverage"))
    across, down = np.moveaxis((outputs["uv"] * (256, -128)).astype(int) % (256, 128), 2, 0)
    there = outputs["coverage"][..., None] > 0
    images.insert(0, np.concatenate([there * srgb_to_linear(keys[down, across]), there], 2))
    sheet(path, "Figure 9: hair types by a map, on the given and on the tessellated faces", columns, [("", images)])


def figure_10(gpu, options, path):
    """Diffuse, specular and both."""
    scene = furry(options.mesh or clfur.load_mesh("teapot"), options, length=0.12, light=(-.6, -1, -.8), specular=.5,
                  exponent=40)
    parts = {"diffuse": with_hair(scene, specular=0), "both": scene,
             "specular": attrs.evolve(with_hair(scene, color=(0, 0, 0)), body_color=(0, 0, 0))}
    images = [clfur.render(parts[name], gpu, Settings(shadows="off")) for name in ("diffuse", "specular", "both")]
    sheet(path, "Figure 10: the parts of Kajiya and Kay's model", ["diffuse", "specular", "both"], [("", images)])


def figure_11(gpu, options, path):
    """The parts of the shadows."""
    scene = furry(options.mesh or clfur.load_mesh("teapot"), options, length=0.1, light=(1, -.7, -.5))
    alphas = tuned(gpu, scene, options, Settings().grid)
    rows = [("voxels only", []), ("map only", []), ("both", []), ("map, no z-sum", [])]
    for method in METHODS:
        ours = with_hair(scene, alpha=alphas[method])
        voxels, both = Settings(shadows=method, shadow_map=0), Settings(shadows=method)
        rows[0][1].append(clfur.render(ours, gpu, voxels))
        rows[1][1].append(clfur.render(with_hair(scene, alpha=1), gpu, both))
        rows[2][1].append(clfur.render(ours, gpu, both))
        rows[3][1].append(unsummed(gpu, ours, both))
    sheet(path, "Figure 11: voxels, shadow map, both; and as the report drew its map, with each cell's own hair",
          [f"{m}, alpha {alphas[m]:.4g}" for m in METHODS], rows)


def figure_12(gpu, options, path):
    """The camera against the light."""
    scene = furry(options.mesh or clfur.load_mesh("teapot"), options, options.figure_strands, length=0.08,
                  color=(.3, .17, .07))
    camera = scene.camera
    scene = attrs.evolve(scene, light=clfur.Light(direction=camera.eye - camera.target))
    parts = {"no shadows": (0.5, "off", 0), "voxels only": (0.5, "length", 0), "map only": (1, "length", 1024),
             "both": (0.5, "length", 1024)}
    rows = [(form, [clfur.render(with_hair(scene, alpha=alpha, look=clfur.Kajiya(.5, 40, form)), gpu,
                                 Settings(shadows=shadows, shadow_map=texels))
                    for alpha, shadows, texels in parts.values()]) for form in ("half-vector", "kajiya-kay")]
    sheet(path, "Figure 12: the camera looks against the light", list(parts), rows)


def figure_13(gpu, options, path):
    """The voxelizations: the shadow alone, as a picture's part of the same picture without it."""
    options = changed(options, size=(options.size[0] * 4 // 5, options.size[1] * 4 // 5))
    scene = furry(options.mesh or clfur.load_mesh("teapot"), options, length=0.1, light=(.6, -.7, -1), specular=0,
                  color=(1, 1, 1))
    k = scene.camera.intrinsics * np.array([[2, 2, 1], [2, 2, 1], [1, 1, 1]])
    k[0, 2] += options.size[0] / 4
    near = attrs.evolve(scene, camera=clfur.Camera.calibrated(scene.camera.pose, k, options.size), body_color=(1, 1, 1),
                        light=clfur.Light(scene.light.direction, ambient=0))
    unshaded = clfur.render(near, gpu, Settings(shadows="off"))
    dark = unshaded[..., :3] < 1e-3 * unshaded[..., 3:]

    def share(image):
        """How much of the unshaded picture's light is left."""
        left = np.where(dark, 0, image[..., :3] / np.maximum(unshaded[..., :3], 1e-6))
        return np.concatenate([left * unshaded[..., 3:], unshaded[..., 3:]], 2)

    methods, grid = ("count", "trilinear", "binary", "length"), options.figure_grid
    rows = [("summed", []), ("each cell alone", []), ("cells, half way", [])]
    alphas = tuned(gpu, scene, options, grid)
    for method in methods:
        settings, ours = Settings(shadows=method, shadow_map=0, grid=grid), with_hair(near, alpha=alphas[method])
        rows[0][1].append(share(clfur.render(ours, gpu, settings)))
        rows[1][1].append(share(unsummed(gpu, ours, settings)))
        half = cast_shadows(gpu, ours, settings, *on_device(gpu, ours)).crossings.get()[grid // 2]
        rows[2][1].append(blocks(np.exp(-math.log(2) * half / half[half > 0].mean()), options.size))
    sheet(path, f"Figure 13: the light that each voxelization lets through, {grid} cells a side, magnified",
          [f"{m}, alpha {alphas[m]:.4g}" for m in methods], rows)


def blocks(values, size):
    """The middle of [n, n] numbers as a picture of this size, as large blocks of gray."""
    width, height = size
    times = -(-width // len(values))
    large = values.repeat(times, 0).repeat(times, 1)
    top, left = (len(large) - height) // 2, (len(large) - width) // 2
    gray = large[top:top + height, left:left + width, None]
    return np.concatenate([gray, gray, gray, np.ones_like(gray)], 2)


# --- how wrong -------------------------------------------------------------------------------------------


def places(points, spans, count, seed=0):
    """Random places on strands -> ([count, 3], their strand, its width there)."""
    random = np.random.default_rng(seed)
    strand = random.choice(np.flatnonzero(spans[:, 1] > 1), count)
    along = random.random(count) * (spans[strand, 1] - 1)
    first = spans[strand, 0] + along.astype(int)
    at = (along % 1)[:, None]
    place = points[first] * (1 - at) + points[first + 1] * at
    return place[:, :3].astype(float), strand, place[:, 3].astype(float)


def crossings(lighting, place, width):
    """Fragments or crossings before each place, [Q] float64, as through_hair in cl/light.h finds them of one light."""
    sums, grid = lighting.crossings.get().astype(float), lighting.grids.get()[0]
    to_grid = grid["to_grid"].astype(float).T
    c = place @ to_grid[:, :3].T + to_grid[:, 3]
    size = np.array(sums.shape[::-1]) - (0, 0, 1)
    x, y, z = c[:, 0] / c[:, 3] - .5, c[:, 1] / c[:, 3] - .5, np.clip(c[:, 2], 0, size[2])
    x0, y0, z0 = np.floor(x).astype(int), np.floor(y).astype(int), np.minimum(z.astype(int), size[2] - 1)
    total = np.zeros(len(place))
    for i in (0, 1):
        for j in (0, 1):
            inside = (x0 + i >= 0) & (y0 + j >= 0) & (x0 + i < size[0]) & (y0 + j < size[1])
            cx, cy = np.clip(x0 + i, 0, size[0] - 1), np.clip(y0 + j, 0, size[1] - 1)
            column = sums[z0, cy, cx] * (1 - (z - z0)) + sums[z0 + 1, cy, cx] * (z - z0)
            total += inside * column * abs(1 - i - (x - x0)) * abs(1 - j - (y - y0))
    _, per_width, per_fragment, _ = lighting.shadows.get()[0]["hair"]
    return np.maximum(total - per_width * width / c[:, 3] - per_fragment, 0)


def hidden(body, place, towards_light):
    """Whether the body stands between each place and the light, by every triangle."""
    positions, triangles = body.positions.get()[:, :3].astype(float), body.triangles.get()[:, :3]
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    across = np.cross(towards_light, c - a)
    scale = 1 / (across * (b - a)).sum(1)
    result = np.zeros(len(place), bool)
    for k, p in enumerate(place):
        from_a = p - a
        u = (from_a * across).sum(1) * scale
        other = np.cross(from_a, b - a)
        v, t = other @ towards_light * scale, (other * (c - a)).sum(1) * scale
        result[k] = ((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-4)).any()
    return result


@dataclasses.dataclass
class Judged:
    """A scene on the device, and the true light at random places on its strands."""

    strands: object
    body: object
    place: np.ndarray    # [Q, 3]
    strand: np.ndarray   # [Q] that each place is on
    width: np.ndarray    # [Q]
    light: np.ndarray    # [Q] by brute force, mean of two seeds
    noise: float         # mean error of light from chance

    def crossings(self, gpu, scene, settings):
        """Fragments or crossings before each place, from the device's sums."""
        return crossings(cast_shadows(gpu, scene, settings, self.strands, self.body), self.place, self.width)


def judge(gpu, scene, options, lit=False):
    """`Judged` of a scene; with lit, only at places that the body does not hide."""
    strands, body = on_device(gpu, scene)
    place, strand, width = places(strands.points.get(), strands.spans.get(), options.queries)
    if lit:
        keep = ~hidden(body, place, -scene.light.direction)
        place, strand, width = place[keep], strand[keep], width[keep]
    light, noise = true_light(scene, strands, body, place, strand, options.footprint, options.rays)
    return Judged(strands, body, place, strand, width, light, noise)


def true_light(scene, strands, body, place, strand, spacings, rays):
    """(light at each place by brute force, mean of two seeds; its mean error from chance)."""
    triangles = body.triangles.get()[:, :3]
    a, b, c = (body.positions.get()[triangles[:, k], :3].astype(float) for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    one, other = (truth.transmittance(strands.points.get(), strands.spans.get(), scene.strands.types[0].alpha,
                                      -scene.light.direction, place, strand,
                                      spacings * math.sqrt(area / len(strands.spans)), rays, seed) for seed in (0, 1))
    return (one + other) / 2, float(np.abs(one - other).mean() / 2)


def fitted(amount, light):
    """The power of `amount` that comes nearest to the true light: (power, mean absolute error)."""
    powers = np.geomspace(1e-5, 10, 400)
    errors = [np.abs(np.exp(-k * amount) - light).mean() for k in powers]
    return powers[np.argmin(errors)], float(np.min(errors))


def changed(options, **values):
    """The options with other values."""
    return argparse.Namespace(**vars(options) | values)


def tuned(gpu, scene, options, grid):
    """The alpha with which each method's light comes nearest to the truth; "length" needs none and keeps its own."""
    judged = judge(gpu, scene, changed(options, queries=min(options.queries, 100), rays=100))
    alphas = {}
    for method in METHODS:
        amount = judged.crossings(gpu, scene, Settings(shadows=method, grid=grid, shadow_map=0))
        alphas[method] = math.exp(-fitted(amount, judged.light)[0])
    return alphas | {"length": scene.strands.types[0].alpha}


def measure(gpu, name, mesh, count, options):
    """Error and milliseconds of every method and grid on one mesh -> a dictionary."""
    scene = furry(mesh, options, strands=count)
    judged = judge(gpu, scene, options)
    light = judged.light
    lit = ~hidden(judged.body, judged.place, -scene.light.direction)
    rows, times = {}, {}
    every = [(m, n) for m in METHODS for n in options.grids]
    for turn in range(options.repeat + 1):
        for method, grid in every:
            gpu.start()
            lighting = cast_shadows(gpu, scene, Settings(shadows=method, grid=grid, shadow_map=0),
                                    judged.strands, judged.body)
            times.setdefault((method, grid), []).append(1e3 * sum(gpu.seconds().values()))
            if turn == 0:
                amount = crossings(lighting, judged.place, judged.width)
                wrong = np.exp(-float(lighting.shadows.get()[0]["hair"][0]) * amount) - light
                power, best = fitted(amount, light)
                rows[method, grid] = {
                    "error": np.abs(wrong).mean(), "bias": wrong.mean(), "lit": np.abs(wrong[lit]).mean(),
                    "alpha": math.exp(-power), "fitted": best,
                    "fitted_lit": np.abs(np.exp(-power * amount) - light)[lit].mean()}
    for key, row in rows.items():
        row["ms"] = statistics.median(times[key][1:])
    print(f"{name}, {count:,} strands: measured", flush=True)
    return {"mesh": name, "strands": count, "rows": rows, "noise": judged.noise, "light": light.mean(),
            "lit": lit.mean(), "light_lit": light[lit].mean()}


def frontier(points):
    """Of [(ms, error, ...)], those that no other beats in both, by ms."""
    best, result = math.inf, []
    for point in sorted(points):
        if point[1] < best:
            best = point[1]
            result.append(point)
    return result


def chart(gpu, options, path):
    """Error against milliseconds: a picture, and a table in Markdown."""
    meshes = {"sphere": clfur.load_mesh("sphere"), "teapot": clfur.load_mesh("teapot")}
    if options.mesh:
        meshes[options.mesh_name] = options.mesh
    results = [measure(gpu, name, mesh, count, options) for count in options.strands for name, mesh in meshes.items()]
    figure = Figure((3.6 * len(meshes) + .6, 3.3 * len(options.strands) + .9), dpi=100, layout="constrained")
    axes = figure.subplots(len(options.strands), len(meshes), squeeze=False, sharey=True)
    for axis, result in zip(axes.flat, results):
        rows = result["rows"]
        for method in METHODS:
            line = [(rows[method, n]["ms"], rows[method, n]["error"], rows[method, n]["fitted"], n)
                    for n in options.grids]
            ms, error, best, grids = zip(*line)
            axis.plot(ms, error, "o-", color=INK[method], ms=4, label=method, zorder=3)
            if method != "length":
                axis.plot(ms, best, "o:", color=INK[method], ms=3, lw=1, mfc="white", label=f"{method}, alpha fitted")
            for x, y, n in zip(ms, error, grids):
                if method == "length" or n in (grids[0], grids[-1]):
                    axis.annotate(str(n), (x, y), (0, 5), textcoords="offset points", fontsize=6, ha="center",
                                  color=INK[method])
        edge = frontier([(rows[key]["ms"], rows[key]["error"]) for key in rows])
        axis.plot(*zip(*edge), "s", ms=10, mfc="none", mec="black", mew=.8, label="frontier (nothing fitted)", zorder=4)
        axis.axhline(result["noise"], color="black", lw=.8, ls="--", label="noise of the truth")
        axis.axhline(options.bound, color="red", lw=.6, label=f"{options.bound:g}")
        axis.set(xscale="log", yscale="log", xlabel="ms, voxelize + zscan",
                 title=f"{result['mesh']}, {result['strands']:,} strands")
        axis.title.set_fontsize(9)
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter(ScalarFormatter())
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_ylim(0.002, 1)
        axis.grid(alpha=.3, which="both", lw=.5)
    for row in axes:
        row[0].set_ylabel("mean absolute error of the light")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=7)
    save(figure, path)
    write(path.with_suffix(".md"), chart_table(results, gpu, options))


def how(name, options):
    """The command that makes a table."""
    mesh = " --mesh FILE" if options.mesh else ""
    return f"python tools/figures.py --only {name} --queries {options.queries} --rays {options.rays}{mesh}"


def chart_table(results, gpu, options):
    """All numbers of the chart in Markdown."""
    grids = options.grids
    lines = [
        "# Error and cost of each shadow method", "",
        f"`{how('chart', options)}` on {gpu.device.name.strip()}: {options.queries} places, 2 × {options.rays} rays a "
        f"place within {options.footprint:g} strand spacings, hairs {options.length:g} of the mesh long, alpha 0.5, "
        f"median of {options.repeat} interleaved runs.", "",
        "Mean absolute error of the light (0 to 1) that reaches places on strands, its bias in brackets, and "
        "milliseconds of voxelize + zscan.  *lit*: the error at places that the body does not hide from the light.  "
        "*fitted*: the error with the alpha, in brackets, that suits the method best on this scene and grid."]
    for r in results:
        lines += ["", f"## {r['mesh']}, {r['strands']:,} strands", "",
                  f"Mean true light {r['light']:.3f}, {r['light_lit']:.3f} at the {100 * r['lit']:.0f} % lit places; "
                  f"noise of the truth {r['noise']:.4f}.", "",
                  "| method | | " + " | ".join(f"{n}³" for n in grids) + " |", "|---|---|" + "--:|" * len(grids)]
        for method in METHODS:
            rows = [r["rows"][method, n] for n in grids]
            lines += [line(method, "error", (f"{w['error']:.3f} ({w['bias']:+.3f})" for w in rows)),
                      line("", "lit", (f"{w['lit']:.3f}" for w in rows)),
                      line("", "ms", (f"{w['ms']:.1f}" for w in rows))]
            if method != "length":
                lines += [line("", "fitted", (f"{w['fitted']:.3f} ({w['alpha']:.4g})" for w in rows)),
                          line("", "fitted, lit", (f"{w['fitted_lit']:.3f}" for w in rows))]
        edge = frontier([(w["ms"], w["error"], *key) for key, w in r["rows"].items()])
        lines += ["", "Frontier: " + ", ".join(f"{m} {n}³ ({ms:.1f} ms, {e:.3f})" for ms, e, m, n in edge) + "."]
    return "\n".join(lines)


# --- how steady ------------------------------------------------------------------------------------------


def turned(direction, angle):
    """The direction turned about an axis across it [radians]."""
    across = np.cross(direction, (0, 1, 0))
    across /= np.linalg.norm(across)
    return math.cos(angle) * direction + math.sin(angle) * np.cross(across, direction)


def light_sweep(gpu, scene, grid, options):
    """Turn the light by a cell in STEPS -> (truth at both ends [2, Q], its noise, {method: light [STEPS + 1, Q]})."""
    start, finer = scene.light.direction, changed(options, rays=4 * options.rays)
    scenes = [attrs.evolve(scene, light=clfur.Light(turned(start, 2 / grid * k / STEPS))) for k in range(STEPS + 1)]
    judged = judge(gpu, scene, finer, lit=True)
    last, _ = true_light(scenes[-1], judged.strands, judged.body, judged.place, judged.strand, finer.footprint,
                         finer.rays)
    lights = {}
    for method in METHODS:
        settings = Settings(shadows=method, grid=grid, shadow_map=0)
        amounts = np.array([judged.crossings(gpu, each, settings) for each in scenes])
        power = .5 if method == "length" else fitted(amounts[0], judged.light)[0]
        lights[method] = np.exp(-power * amounts)
        if method != "length":
            lights[f"{method}, alpha 0.5"] = 0.5 ** amounts
    return np.stack([judged.light, last]), judged.noise, lights


def jump(gpu, scene, grid, options):
    """Change of the light when its direction passes (-1, -1, -1) in one step of `light_sweep` -> {method: change}."""
    towards = np.full(3, -1 / math.sqrt(3))
    two = [attrs.evolve(scene, light=clfur.Light(turned(towards, 2 / grid / STEPS * k))) for k in (-.5, .5)]
    judged = judge(gpu, two[0], options, lit=True)
    changes = {}
    for method in METHODS:
        settings = Settings(shadows=method, grid=grid, shadow_map=0)
        amounts = [judged.crossings(gpu, each, settings) for each in two]
        power = .5 if method == "length" else fitted(amounts[0], judged.light)[0]
        changes[method] = np.abs(np.exp(-power * amounts[0]) - np.exp(-power * amounts[1])).mean()
    return changes


def pan(gpu, scene, settings):
    """Change a frame of the picture while the camera pans by 1/8 pixel: (as drawn, as it should be), of its mean.

    It should change like a picture eight times as large, averaged over each pixel where the pan has come.
    """
    width, height = scene.camera.size

    def shifted(times, by):
        k = np.diag([times, times, 1]) @ scene.camera.intrinsics
        k[0, 2] += by
        camera = clfur.Camera.calibrated(scene.camera.pose, k, (times * width, times * height))
        return clfur.render(attrs.evolve(scene, camera=camera), gpu, settings)[..., :3]

    drawn = np.array([shifted(1, k / 8) for k in range(9)])
    large = shifted(8, 0)
    true = np.array([np.roll(large, k, 1).reshape(height, 8, width, 8, 3).mean((1, 3)) for k in range(9)])
    return tuple(float(np.abs(np.diff(p, axis=0)).mean() / p.mean()) for p in (drawn, true))


def flicker(gpu, options, path):
    """Light turned and camera panned by fractions of a cell and a pixel: a picture and a table."""
    count = options.strands[0]
    scene = furry(clfur.load_mesh("sphere"), options, strands=count, light=SWEPT)
    sweeps = {n: light_sweep(gpu, scene, n, options) for n in options.flicker_grids}
    jumps = {n: jump(gpu, scene, n, options) for n in options.flicker_grids}
    small = attrs.evolve(scene, camera=frame(scene.mesh, scene.fur, (options.size[0] // 2, options.size[1] // 2)))
    middle = options.flicker_grids[len(options.flicker_grids) // 2]
    alphas = {"off": 0.5} | tuned(gpu, scene, options, middle)
    pans = {method: pan(gpu, with_hair(small, alpha=alpha), Settings(shadows=method, grid=middle))
            for method, alpha in alphas.items()}

    figure = Figure((11, 3.6), dpi=100, layout="constrained")
    left, center, right = figure.subplots(1, 3)
    ends, _, lights = sweeps[middle]
    one = int(np.argmin(np.abs(ends.mean(0) - .5)))        # the place that is most nearly half lit
    for method in METHODS:
        left.plot(lights[method][:, one], color=INK[method], label=method)
        center.plot(options.flicker_grids, [1e3 * unrest(sweeps[n], method)[1] for n in options.flicker_grids], "o-",
                    color=INK[method], label=method)
        center.plot(options.flicker_grids, [1e3 * jumps[n][method] for n in options.flicker_grids], "x:",
                    color=INK[method], lw=.8)
    left.plot([0, STEPS], ends[:, one], "k--", lw=1, label="truth")
    left.set(xlabel=f"light turned [1/{STEPS} cell], {middle}³", ylabel="light at one place")
    center.plot([], [], "kx:", lw=.8, label="step past (-1, -1, -1)")
    center.set(xlabel="cells a side", ylabel="change a step beyond the truth's [1/1000]", xscale="log", yscale="log")
    center.set_xticks(options.flicker_grids, [str(n) for n in options.flicker_grids])
    center.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    center.yaxis.set_major_formatter(ScalarFormatter())
    center.yaxis.set_minor_formatter(NullFormatter())
    center.xaxis.set_minor_locator(NullLocator())
    center.set_ylim(top=4 * center.get_ylim()[1])          # room for the legend
    bars = np.arange(len(pans))
    right.bar(bars - .2, [drawn for drawn, _ in pans.values()], .4, color="#4c78a8", label="4 samples a pixel")
    right.bar(bars + .2, [true for _, true in pans.values()], .4, color="#bbbbbb", label="8 × 8 pixels averaged")
    right.set_xticks(bars, list(pans), fontsize=8)
    right.set(ylabel="change a frame / mean", xlabel="camera panned by 1/8 pixel")
    right.set_ylim(top=1.3 * max(drawn for drawn, _ in pans.values()))
    for axis in (left, center, right):
        axis.legend(fontsize=7, ncols=2 if axis is center else 1, loc="upper left")
        axis.grid(alpha=.3)
    save(figure, path)
    write(path.with_suffix(".md"), flicker_table(sweeps, jumps, pans, count, middle, options))


def unrest(sweep, method):
    """(mean change a step, its difference from the truth's, second difference) of a method's light."""
    ends, _, lights = sweep
    step = np.diff(lights[method], axis=0)
    true_step = (ends[1] - ends[0]) / STEPS
    return np.abs(step).mean(), np.abs(step - true_step).mean(), np.abs(np.diff(step, axis=0)).mean()


def flicker_table(sweeps, jumps, pans, count, middle, options):
    """All numbers of the flicker chart in Markdown."""
    size = f"{options.size[0] // 2}×{options.size[1] // 2}"
    lines = [
        "# Flicker of each shadow method", "",
        f"`{how('flicker', options)}`: sphere, {count:,} strands, the lit ones of {options.queries} places, 2 × "
        f"{4 * options.rays} rays a place.", "",
        f"The light turns from {SWEPT} by the angle of one cell (2 / cells a side) in {STEPS} steps.  *change*: mean "
        "absolute change of the light a step; *beyond*: mean absolute difference of that change from the truth's "
        "(linear between both ends); *second*: mean absolute second difference; *jump*: change of the one step past "
        "(-1, -1, -1).  All × 10⁻³.  The report's methods with the alpha that fits them best, and with alpha 0.5 as it "
        "is: black is steady."]
    for grid, sweep in sweeps.items():
        ends, noise, lights = sweep
        lines += ["", f"## {grid}³", "", "| method | mean light | change | beyond | second | jump |",
                  "|---|--:|--:|--:|--:|--:|",
                  line("truth", f"{ends.mean():.3f}", f"{1e3 * np.abs(ends[1] - ends[0]).mean() / STEPS:.2f}",
                       f"{1e3 * math.sqrt(2) * noise / STEPS:.2f} (noise)", "", "")]
        for method in lights:
            jumped = f"{1e3 * jumps[grid][method]:.1f}" if method in METHODS else ""
            lines.append(line(method, f"{lights[method].mean():.3f}",
                              (f"{1e3 * value:.2f}" for value in unrest(sweep, method)), jumped))
    lines += ["", "## Camera panned by 1/8 pixel", "",
              f"{size} pixels, {middle}³: mean absolute change of the picture a frame over its mean, with 4 samples a "
              "pixel, and as it should be.", "",
              "| | " + " | ".join(pans) + " |", "|---|" + "--:|" * len(pans),
              line("drawn", (f"{drawn:.4f}" for drawn, _ in pans.values())),
              line("true", (f"{true:.4f}" for _, true in pans.values())),
              line("beyond", (f"{drawn - true:.4f}" for drawn, true in pans.values()))]
    return "\n".join(lines)


FIGURES = {"8": figure_8, "9": figure_9, "10": figure_10, "11": figure_11, "12": figure_12, "13": figure_13,
           "chart": chart, "flicker": flicker} | SHELLS


def whole_numbers(text):
    """[int] of numbers with commas between them."""
    return [int(part) for part in text.split(",")]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--only", default=",".join(FIGURES), help="which, with commas between them")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/figures"), metavar="DIR")
    parser.add_argument("--mesh", metavar="FILE", help="draw this instead of the teapot, and chart it too")
    parser.add_argument("--device")
    parser.add_argument("--size", default="320x240", help="of a panel")
    parser.add_argument("--length", type=float, default=0.25, help="of a hair in the charts, in the mesh's size")
    parser.add_argument("--strands", type=whole_numbers, default=[20480, 100_000], help="in the charts")
    parser.add_argument("--grids", type=whole_numbers, default=[16, 32, 48, 64, 96, 128, 192])
    parser.add_argument("--flicker-grids", type=whole_numbers, default=[32, 48, 96])
    parser.add_argument("--footprint", type=float, default=3, help="radius of the truth's rays in strand spacings")
    parser.add_argument("--figure-strands", type=int, default=40_000, help="in figure 12")
    parser.add_argument("--figure-grid", type=int, default=Settings().grid, help="cells a side in figure 13")
    parser.add_argument("--queries", type=int, default=400, help="places on strands")
    parser.add_argument("--rays", type=int, default=400, help="of the truth at each place, for each of two seeds")
    parser.add_argument("--repeat", type=int, default=5, help="timed runs")
    parser.add_argument("--bound", type=float, default=0.03, help="error to draw a line at")
    options = parser.parse_args()
    options.size = tuple(map(int, options.size.split("x")))
    options.mesh_name = Path(options.mesh).stem if options.mesh else None
    options.mesh = clfur.load_mesh(options.mesh) if options.mesh else None
    options.output.mkdir(parents=True, exist_ok=True)
    gpu = clfur.Scheduler(options.device)
    for name in options.only.split(","):
        if name not in FIGURES:
            parser.error(f"there is no figure {name!r}; allowed: {', '.join(FIGURES)}")
        FIGURES[name](gpu, options, options.output / (f"figure{name}.png" if name.isdecimal() else f"{name}.png"))


if __name__ == "__main__":
    main()
