"""Draws furry scenes with Mitsuba 3, an independent renderer, and compares what is visible and lit with clfur.truth.

    pip install mitsuba && python tools/truth_mitsuba.py

What each ray sees (hair, body or nothing), as shares of every pixel; and the body's light behind opaque hair and body,
from a distant light and from a spot.  Mitsuba's linear curves are tubes that end in balls, so here the truth's are,
too; what ribbons, as the truth has them, give stands beside it.  Noise comes from a second seed of each.  Exits 1
where a mean differs by more than 4 of its standard errors and 0.05 %, or pixels by more than 1.15 of their noise.
"""

import argparse
import os
import tempfile

import mitsuba
import numpy as np

import clfur
from clfur import truth
from clfur.judge import geometry, lights, rays

ALLOWED = 5e-4           # Mitsuba's float32, and its shadows' small step away from a surface


class Tubes(rays.Fibres):
    """Fibres that are round, end in balls and are met on their surface, as Mitsuba's; of one width each."""

    def meet(self, places, ray, fibre, joined):
        x, y = places[ray].T
        data = self.data.take(fibre, 1)
        a, u, r = data[:3], data[3:6], data[6]
        one, none = np.ones_like(x), np.zeros_like(x)
        o, d = ((x, y, none), (none, none, one)) if self.eye.parallel else ((none, none, none), (x, y, one))
        o, d = np.array(o) - a, np.array(d)

        def entry(o, d):
            """Where rays come within r of the origin."""
            square, half = (d * d).sum(0), (o * d).sum(0)
            with np.errstate(invalid="ignore", divide="ignore"):
                return (-half - np.sqrt(half * half - square * ((o * o).sum(0) - r * r))) / square
        uu, ou, du = (u * u).sum(0), (o * u).sum(0), (d * u).sum(0)
        side = entry(o - ou / uu * u, d - du / uu * u)
        share = (ou + side * du) / uu
        side = np.where((share >= 0) & (share <= 1), side, np.inf)
        t = np.fmin(np.fmin(entry(o, d), entry(o - u, d)), side)
        return np.isfinite(t), t, none


class FallingOff(lights.Light):
    """Light of which a spot's falls off with the square of the distance, as Mitsuba's."""

    def _unshadowed(self, p):
        to_light, direct = super()._unshadowed(p)
        place = self.light.position
        return to_light, direct if place is None else direct / ((p - place)**2).sum(1, keepdims=True)


def scenes(size, roots):
    """Yield (name, scene)."""
    sphere = clfur.load_mesh("sphere")
    teapot = clfur.load_mesh("teapot")
    bare = {"specular": 0, "alpha": 0}
    for name, mesh, width, more in [("sphere, thin", sphere, .004, {}), ("sphere, thick", sphere, .03, {}),
                                    ("teapot, curls", teapot, .012, {"curl": (.02, 2), "segments": 12})]:
        see, shade = (clfur.Strands(inner=2, outer=2, roots=roots, force=(0, -.2, 0), types=clfur.HairType(
            color=color, width=width, **more, **bare)) for color in ((1, 0, 0), (0, 0, 0)))
        camera = clfur.scene.frame(mesh, see, size)
        yield f"{name}: hair, body", clfur.Scene(
            mesh=mesh, fur=see, camera=camera, body_color=(0, 1, 0), light=clfur.Light(color=(0, 0, 0), ambient=1))
        center, radius = clfur.scene.extent(mesh, see)
        place = center + radius * np.array([1, 1.6, 1.2])
        for kind, light in [("distant light", clfur.Light(direction=(-1, -1, -.6), ambient=0)),
                            ("spot", clfur.Light(direction=center - place, position=place, angle=120, ambient=0))]:
            yield f"{name}: {kind}", clfur.Scene(mesh=mesh, fur=shade, camera=camera, body_color=(1, 1, 1), light=light)


def by_mitsuba(scene, samples, seed):
    """The picture of a scene, float64 [h, w, 4], by Mitsuba."""
    hair, body = geometry.geometry_of(scene)
    width, height = scene.camera.size
    shares = scene.light.ambient > 0                      # what each ray sees; else the light on it
    with tempfile.TemporaryDirectory() as folder:
        curves, surface = os.path.join(folder, "hair.txt"), os.path.join(folder, "body.ply")
        with open(curves, "w", encoding="utf-8") as file:
            for first, count in hair.spans:
                for x, y, z, w in hair.points[first:first + count].tolist():
                    file.write(f"{x:.9g} {y:.9g} {z:.9g} {w / 2:.9g}\n")
                file.write("\n")
        mesh = mitsuba.Mesh("body", len(body.positions), len(body.triangles), has_vertex_normals=True)
        parts = mitsuba.traverse(mesh)
        parts["vertex_positions"] = body.positions.astype(np.float32).ravel()
        parts["vertex_normals"] = body.normals.astype(np.float32).ravel()
        parts["faces"] = body.triangles[:, :3].astype(np.uint32).ravel()
        parts.update()
        mesh.write_ply(surface)

        def matte(color):
            return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}}
        camera = scene.camera
        light = {"type": "constant"}
        integrator = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True}
        if shares:
            integrator = {"type": "aov", "aovs": "albedo:albedo", "direct": integrator}
        elif scene.light.position is None:
            light = {"type": "directional", "direction": scene.light.direction.tolist(),
                     "irradiance": {"type": "rgb", "value": np.pi}}
        else:
            light = {"type": "spot", "cutoff_angle": scene.light.angle / 2, "beam_width": scene.light.angle / 2 - 1,
                     "intensity": {"type": "rgb", "value": np.pi},
                     "to_world": mitsuba.ScalarTransform4f().look_at(
                         origin=scene.light.position.tolist(), up=[0, 0, 1],
                         target=(scene.light.position + scene.light.direction).tolist())}
        drawn = mitsuba.load_dict({
            "type": "scene", "integrator": integrator, "light": light,
            "sensor": {
                "type": "perspective", "fov": camera.fov, "fov_axis": "y", "near_clip": 1e-2, "far_clip": 1e3,
                "to_world": mitsuba.ScalarTransform4f().look_at(
                    origin=camera.eye.tolist(), target=camera.target.tolist(), up=camera.up.tolist()),
                "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"},
                         "pixel_format": "rgba", "component_format": "float32"},
                "sampler": {"type": "stratified", "sample_count": samples**2}},
            "body": {"type": "ply", "filename": surface, "bsdf": matte(scene.body_color.tolist())},
            "hair": {"type": "linearcurve", "filename": curves,
                     "bsdf": matte(scene.fur.types[0].color.tolist())}})
        picture = np.array(mitsuba.render(drawn, spp=samples**2, seed=seed)).astype(np.float64)
    return np.concatenate([picture[..., 4:7], picture[..., 3:4]], 2) if shares else picture[..., :4]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", type=int, default=96, help="pixels a side")
    parser.add_argument("--samples", type=int, default=8, help="rays a pixel: the square of it")
    parser.add_argument("--roots", type=int, default=1500)
    parser.add_argument("--variant", default="scalar_rgb", help="of Mitsuba")
    options = parser.parse_args()
    mitsuba.set_variant(options.variant)
    flat, wrong, truth.Light = geometry.Fibres, 0, FallingOff
    for name, scene in scenes((options.size, options.size), options.roots):
        geometry.Fibres = flat
        ribbons = truth.picture(scene, options.samples)
        geometry.Fibres = Tubes
        mine = [truth.picture(scene, options.samples, seed) for seed in (0, 1)]
        theirs = [by_mitsuba(scene, options.samples, seed) for seed in (0, 1)]
        channels = {"hair": 0, "body": 1, "alpha": 3} if scene.light.ambient else {"light": 0}
        for channel, k in channels.items():
            a, b = (np.stack(pair)[..., k] for pair in (mine, theirs))
            noise = np.sqrt(((a[0] - a[1])**2 + (b[0] - b[1])**2) / 4)            # of the difference of their means
            difference = a.mean(0) - b.mean(0)
            total = b.mean()
            off, error = difference.mean() / total, np.sqrt((noise**2).sum()) / noise.size / total
            spread = np.sqrt((difference**2).mean() / (noise**2).mean())
            bad = abs(off) > 4 * error + ALLOWED or spread > 1.15
            wrong += bad
            rough, thin = np.sqrt((noise**2).mean()), ribbons[..., k].mean() / mine[0][..., k].mean() - 1
            print(f"{name:29} {channel:6} mean {total:.4f}: truth {off:+.3%} ± {error:.3%}, pixels {spread:.2f} of "
                  f"their noise {rough:.4f}; ribbons {thin:+.2%}{'   WRONG' if bad else ''}", flush=True)
    raise SystemExit(int(wrong > 0))


if __name__ == "__main__":
    main()
