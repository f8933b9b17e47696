"""How wrong the light of a sky is: mean absolute errors of irradiance to rays in float64, for docs/light.md."""

import argparse

import attrs
import numpy as np
import trimesh
from budget_scenes import furry

import clfur
from clfur.device.scheduler import Scheduler
from clfur.judge.geometry import geometry_of
from clfur.judge.sky import Sky, spread
from clfur.pipeline import build
from clfur.pipeline.plan import Plan
from clfur.pipeline.views import Rig
from clfur.stages import sky
from clfur.twin import shade
from clfur.twin.vectors import unit

SINE, COSINE = (1, 0, -1 / 8), (1, 2 / 3, 1 / 4)   # what of orders 0, 1 and 2 fibres and surfaces keep


def shape_of(name):
    """A mesh by its name: of trimesh's, or as `clfur.load_mesh` takes it."""
    made = {"torus": lambda: trimesh.creation.torus(1, 0.35, 48, 24),
            "capsule": lambda: trimesh.creation.capsule(1.2, 0.5, (24, 24))}.get(name)
    return clfur.Mesh(made().vertices, None, None, made().faces) if made else clfur.load_mesh(name)


def skies():
    """{name: Environment}, each of the mean 1 or so."""
    height, width = 64, 128
    up, aside = np.meshgrid((np.arange(height) + .5) / height, (np.arange(width) + .5) / width, indexing="ij")
    around, down = 2 * np.pi * (aside - .5), np.pi * up
    towards = np.stack([np.sin(down) * np.sin(around), np.cos(down), -np.sin(down) * np.cos(around)], 2)
    window = towards @ unit(np.array([.6, .64, .48])) > np.cos(np.radians(20))
    light = .3 + window * .7 * 4 * np.pi / (2 * np.pi * (1 - np.cos(np.radians(20))))
    return {"uniform": clfur.Environment((1, 1, 1)), "gradient": clfur.Environment([(2,) * 3, (1,) * 3, (0,) * 3]),
            "window": clfur.Environment(np.repeat(light[:, :, None], 3, 2))}


def places(scene, hairs, bodies, seed):
    """(p, axis, surface, strand, triangle) of places on hair by its length, and on the body by its area."""
    hair, body = geometry_of(scene)
    random = np.random.default_rng(seed)
    a, d = hair.points[hair.first, :3], hair.points[hair.first + 1, :3] - hair.points[hair.first, :3]
    length = np.linalg.norm(d, axis=1)
    k, share = random.choice(len(a), hairs, p=length / length.sum()), random.random(hairs)
    corners = body.positions[body.triangles[:, :3]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    t, (u, v) = random.choice(len(area), bodies, p=area / area.sum()), random.random((2, bodies))
    weights = np.stack([1 - np.sqrt(u), np.sqrt(u) * (1 - v), np.sqrt(u) * v], 1)
    at = (weights[:, :, None] * corners[t]).sum(1)
    out = np.cross(corners[t, 1] - corners[t, 0], corners[t, 2] - corners[t, 0])
    n, _ = shade.on_body(body, t, at, unit(out))
    return (hair, body), (np.concatenate([a[k] + share[:, None] * d[k], at]), np.concatenate([unit(d[k]), n]),
                          np.arange(hairs + bodies) >= hairs, np.append(hair.owner[k], np.full(bodies, -1)),
                          np.append(np.full(hairs, -1), t))


def exact(scene, geometry, where, rays, seed=0):
    """Irradiance at places [n, 3] by so many rays each."""
    judge, total = Sky(scene, *geometry), 0
    start = np.random.default_rng(seed).random((len(where[0]), 1, 2))
    for number in np.moveaxis(spread(rays, start), 1, 0):
        total = total + judge.light(*where, number)
    return total / rays


def looked_up(lit, cells, p, axis, surface):
    """Irradiance at places [n, 3] from cells [n, n, n, 9, 3], as sky.h has it."""
    n = len(cells)
    at = np.clip((p - lit.sky["place"][:3]) * lit.sky["place"][3] - .5, 0, n - 1)
    base = np.minimum(at.astype(int), n - 2)
    part, there = at - base, 0
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (base + corner).T
        there = there + np.prod(np.where(corner, part, 1 - part), 1)[:, None, None] * cells[z, y, x]
    kept = np.where(surface[:, None], COSINE, SINE)[:, [0, 1, 1, 1, 2, 2, 2, 2, 2]]
    return np.maximum(np.einsum("nj,njc->nc", kept * sky.harmonics(axis), there), 0)


def errors(scene, gpu, options, grids, seed=1):
    """{grid: (mean absolute error on hair, on the body)}, and (of the best constant), (the truth's own noise)."""
    scene = scene.local
    geometry, where = places(scene, options.hairs, options.bodies, seed)
    one, two = (exact(scene, geometry, where, options.rays, k)[:, 0] for k in (0, 1))
    true, surface, found = (one + two) / 2, where[2], {}
    plan = Plan(Rig.of(scene, clfur.Settings()), ("color",))
    for n in grids:
        with gpu.frame():
            lit = build.sky_in(gpu, plan, n)
            cells = gpu.download(lit.cells).reshape(n, n, n, 9, 4)[..., :3].astype(float)
        given = looked_up(lit, cells, *where[:3])[:, 0]
        found[n] = [(np.abs(given - true)[on].mean(), (given - true)[on].mean()) for on in (~surface, surface)]
    flat = [np.abs(true[on] - np.median(true[on])).mean() for on in (~surface, surface)]
    noise = [np.abs(one - two)[on].mean() / 2 for on in (~surface, surface)]
    return found, flat, noise, [true[on].mean() for on in (~surface, surface)]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", nargs="*", default=["sphere", "teapot"])
    parser.add_argument("--grids", type=int, nargs="*", default=[32, 48])
    parser.add_argument("--hairs", type=int, default=400)
    parser.add_argument("--bodies", type=int, default=400)
    parser.add_argument("--rays", type=int, default=512)
    options, gpu = parser.parse_args(), Scheduler()
    print("| mesh | sky | mean | noise | flat |" + "".join(f" {n}³ |" for n in options.grids) + " of it too bright |")
    print("|---|---|--:|--:|--:|" + "--:|" * (len(options.grids) + 1))
    for name in options.meshes:
        for sort, environment in skies().items():
            scene = attrs.evolve(furry(shape_of(name), 18000, .25, .25), environment=environment)
            found, *others = errors(scene, gpu, options, options.grids)
            flat, noise, mean = ("{:.3f} / {:.3f}".format(*each) for each in others)
            print(f"| {name.rpartition('/')[2]} | {sort} | {mean} | {noise} | {flat} |" + "".join(
                f" {h[0]:.3f} / {b[0]:.3f} |" for h, b in found.values()) + " ".join(
                f" {h[1]:+.3f} / {b[1]:+.3f}" for h, b in list(found.values())[-1:]) + " |", flush=True)


if __name__ == "__main__":
    main()
