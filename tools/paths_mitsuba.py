"""Holds the light that clfur.truth follows from hair to hair against Mitsuba 3's paths, on a tuft over a red floor.

    python tools/paths_mitsuba.py [--mitsuba PYTHON] [--width WIDTH] [--strands N] [--samples N] [--only NAME]

Mitsuba runs in a process of its own, by another Python if that has it (`pip install mitsuba`).  White, blond and brown
hair under a sun and under a sky, two seeds of each.  Printed: the mean of what is seen, ours and theirs; the root mean
square of one picture's noise (sRGB), ours and theirs; and of the difference that both seeds have: what is not noise.
Mitsuba's strands are tubes whose surface scatters at the place that a ray meets; ours are ribbons that face the ray and
scatter on their axis as the mean over their width: the thinner strands are, the less these differ.  Exits 1 where means
differ by more than 2 % and 4 standard errors.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HAIR = {"white": {"absorption": (0, 0, 0)}, "blond": {"eumelanin": .2, "pheomelanin": .4},
        "brown": {"eumelanin": 1.3, "pheomelanin": .2}}
DIRECTION, EYE, TARGET, FOV, SIZE = (1, -1, -.6), (0, 1.2, 3.5), (0, .4, 0), 28, (48, 36)
FLOOR = np.array([(-1.5, 0, -1.5), (1.5, 0, -1.5), (1.5, 0, 1.5), (-1.5, 0, 1.5)])
RED = .7, .25, .2


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--mitsuba", default=sys.executable, metavar="PYTHON", help="a Python that has Mitsuba")
    parser.add_argument("--width", type=float, default=.008, help="of strands; the tuft is 1 wide")
    parser.add_argument("--strands", type=int, default=500)
    parser.add_argument("--samples", type=int, default=12, help="rays a pixel: the square of it")
    parser.add_argument("--theirs", type=int, default=512, help="Mitsuba's rays a pixel")
    parser.add_argument("--orders", type=int, help="times that light is scattered at most")
    parser.add_argument("--only", help="such as 'white sky'")
    parser.add_argument("--asked", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.asked:
        return by_mitsuba(Path(options.asked))
    names = [f"{hair} {light}" for light in ("sun", "sky") for hair in HAIR]
    wrong = 0
    for name in [name for name in names if options.only in (None, name)]:
        ours, asked, seconds = by_clfur(name, options)
        with tempfile.TemporaryDirectory() as folder:
            np.savez(Path(folder) / "asked.npz", **asked)
            start = time.perf_counter()
            subprocess.run([options.mitsuba, __file__, "--asked", Path(folder) / "asked.npz"], check=True)
            theirs = np.load(Path(folder) / "answer.npy")
            wrong += not agrees(name, ours, theirs, seconds, time.perf_counter() - start)
    return wrong > 0


def agrees(name, ours, theirs, seconds, others):
    """Whether two pictures each [2, h, w, 4] show the same; prints how they differ."""
    from clfur.color import linear_to_srgb

    def shown(picture):
        return linear_to_srgb(np.maximum(picture[..., :3], 0).astype(np.float32)).astype(float)[seen]
    seen = (theirs[..., 3] > 0).any(0)
    a, b = ([shown(each) for each in pair] for pair in (ours, theirs))
    noise = [np.sqrt(((pair[0] - pair[1])**2).mean() / 2) for pair in (a, b)]
    beyond = ((a[0] - b[0]) * (a[1] - b[1])).mean()
    means = [pair[..., :3].mean((0, 1, 2)) / pair[..., 3].mean() for pair in (ours, theirs)]
    errors = [np.sqrt(((pair[0] - pair[1])**2)[..., :3].sum((0, 1))) / 2 / pair[0, ..., 3].sum()
              for pair in (ours, theirs)]
    off = np.abs(means[0] - means[1])
    right = bool((off <= .02 * means[1] + 4 * np.hypot(*errors)).all())
    print(f"{name:10} mean {np.round(means[0], 4)} / {np.round(means[1], 4)}, "
          f"off {(off / means[1]).max():.2%} ± {(np.hypot(*errors) / means[1]).max():.2%}; "
          f"noise {noise[0]:.4f} / {noise[1]:.4f}, beyond it {np.sign(beyond) * abs(beyond)**.5:.4f}; "
          f"alpha {ours[..., 3].mean():.4f} / {theirs[..., 3].mean():.4f}; {seconds:.0f} / {others:.0f} s"
          f"{'' if right else '   WRONG'}", flush=True)
    return right


def by_clfur(name, options):
    """(two pictures [2, h, w, 4] of a tuft, what Mitsuba is asked, seconds)."""
    import clfur
    from clfur import truth
    from clfur.twin.chiang import absorption_of

    hair, light = name.split()
    look = clfur.Chiang(**HAIR[hair])
    rng = np.random.default_rng(0)
    root = np.stack([rng.uniform(-.5, .5, options.strands), np.zeros(options.strands),
                     rng.uniform(-.5, .5, options.strands)], 1)
    way = rng.normal(size=root.shape) * .2 + (0, .8, 0)
    points = root[:, None] + way[:, None] * np.linspace(0, 1, 5)[:, None] + (0, .01, 0)
    scene = clfur.Scene(
        fur=clfur.Curves(points, width=options.width, look=look, alpha=0), body_color=RED,
        mesh=clfur.Mesh(FLOOR, faces=np.array([(0, 2, 1), (0, 3, 2)])),
        camera=clfur.Camera(eye=EYE, target=TARGET, fov=FOV, size=SIZE),
        environment=clfur.Environment([(.6, .8, 1), (1, 1, 1), (.2, .2, .2)]) if light == "sky" else None,
        light=clfur.Light(DIRECTION, color=(2, 2, 2) if light == "sun" else (0, 0, 0), ambient=0))
    start, orders = time.perf_counter(), options.orders or truth.ALL
    ours = np.array([truth.picture(scene, options.samples, seed, orders=orders) for seed in (0, 1)])
    sky = scene.environment.picture if scene.environment else np.zeros((2, 2, 3))
    asked = {"points": points, "width": options.width, "sky": sky, "light": light, "samples": options.theirs,
             "depth": -1 if orders == truth.ALL else orders + 1,
             "look": look.lobes, "absorption": absorption_of(look.color, look.azimuthal_roughness)}
    return ours, asked, time.perf_counter() - start


def by_mitsuba(asked):
    """Write answer.npy beside what is asked: [2, h, w, 4]."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    with np.load(asked) as file:
        given = dict(file)
    curves = asked.with_name("hair.txt")
    with curves.open("w", encoding="utf-8") as file:
        hidden = FLOOR[:2].mean(0) / 2 - (0, .1, 0)   # a strand more, unseen: Mitsuba 3.9.1 is safe with it
        for p in [*given["points"], hidden + np.linspace(0, .05, 5)[:, None]]:
            for x, y, z in np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]]):
                file.write(f"{x:.9g} {y:.9g} {z:.9g} {given['width'] / 2:.9g}\n")
            file.write("\n")
    along, around, tilt, index = given["look"].tolist()

    def rgb(values):
        return {"type": "rgb", "value": np.asarray(values).tolist()}
    light = {"type": "directional", "direction": list(DIRECTION), "irradiance": rgb([2 * np.pi] * 3)}
    if given["light"] == "sky":   # the same all around the vertical
        mi.Bitmap(given["sky"].astype(np.float32)).write(str(asked.with_name("sky.exr")))
        light = {"type": "envmap", "filename": str(asked.with_name("sky.exr"))}
    scene = mi.load_dict({
        "type": "scene", "light": light,
        "integrator": {"type": "path", "max_depth": int(given["depth"]), "rr_depth": 20, "hide_emitters": True},
        "sensor": {
            "type": "perspective", "fov": FOV, "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(origin=EYE, target=TARGET, up=(0, 1, 0)),
            "film": {"type": "hdrfilm", "width": SIZE[0], "height": SIZE[1], "rfilter": {"type": "box"},
                     "pixel_format": "rgba", "component_format": "float32"},
            "sampler": {"type": "independent", "sample_count": int(given["samples"])}},
        "floor": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90) @ mi.ScalarTransform4f().scale(1.5),
            "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(RED)}}},
        "hair": {
            "type": "bsplinecurve", "filename": str(curves),
            "bsdf": {"type": "hair", "longitudinal_roughness": along, "azimuthal_roughness": around,
                     "scale_tilt": -float(np.degrees(tilt)), "int_ior": index, "ext_ior": 1.0,
                     "sigma_a": rgb(given["absorption"])}}})
    np.save(asked.with_name("answer.npy"), np.array([
        np.array(mi.render(scene, spp=int(given["samples"]), seed=seed)).astype(float) for seed in (0, 1)]))


if __name__ == "__main__":
    sys.exit(main())
