"""Holds light from hair to hair, `Settings(scattering="grid")`, against Mitsuba 3's paths, on a tuft on a ball.

    python tools/scattering_mitsuba.py [--mitsuba PYTHON] [--device DEVICE] [--samples N] [--keep FOLDER]
                                       [--sheet PNG] [--only WORDS]

Mitsuba runs in a process of its own, by another Python if that has it (`pip install mitsuba`): the two share files.
White, blond, red, brown and black hair on a black ball, and white on a red one, under a sun, three lights and a sky,
two seeds of each.  Printed, over what hair or ball covers: the root mean square (sRGB) to Mitsuba's above
its noise, which is what the errors to both seeds have in common, with scattering and without; Mitsuba's noise; and mean
red of each.
Exits 1 where it is more than .06 of white hair, or .05 of other.  Black ball, a sun or a sky: what docs/light.md has.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HAIR = {"white": {"absorption": (0, 0, 0)}, "blond": {"eumelanin": .2, "pheomelanin": .4},
        "red": {"eumelanin": .1, "pheomelanin": 1.4}, "brown": {"eumelanin": 1.3, "pheomelanin": .2},
        "black": {"eumelanin": 8}}
SUNS = {"sun": [((1, -1, -.6), (6, 6, 6))], "sky": [],                        # directions, irradiances
        "three lights": [((1, -1, -.6), (4, 3.6, 3)), ((-1, -.4, -.5), (1, 1.4, 2)), ((.2, -.3, -1), (3, 3, 3))]}
BLACK, RED = (0, 0, 0), (.7, .1, .1)
CASES = {f"{hair}, {light}": (hair, BLACK, light) for light in SUNS for hair in HAIR}
CASES |= {f"white on red, {light}": ("white", RED, light) for light in ("sun", "sky")}
STRANDS, WIDTH, EYE, FOV, SIZE, DEPTH = 4000, .015, (0, .6, 4.2), 40, (96, 72), 200


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--mitsuba", default=sys.executable, metavar="PYTHON", help="a Python that has Mitsuba")
    parser.add_argument("--device", help="as for clfur")
    parser.add_argument("--samples", type=int, default=1024, help="Mitsuba's rays a pixel; under a sky a quarter of it")
    parser.add_argument("--keep", metavar="FOLDER", help="where Mitsuba's pictures are kept, and taken from")
    parser.add_argument("--sheet", metavar="PNG", help="all pictures: Mitsuba's, ours, ours without scattering")
    parser.add_argument("--only", default="", help="cases with these words in their names, such as 'white, sky'")
    parser.add_argument("--asked", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.asked:
        return by_mitsuba(Path(options.asked))
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(options.keep or folder)
        kept.mkdir(exist_ok=True)
        pictures, wrong = {}, 0
        for name in [name for name in CASES if options.only in name]:
            try:
                pictures[name] = [theirs_of(name, options, kept), *by_clfur(name, options.device)]
                wrong += not agrees(name, *pictures[name])
            except subprocess.CalledProcessError as error:
                print(f"{name}: Mitsuba has ended with {error.returncode}", flush=True)
                wrong += 1
    if options.sheet:
        sheet(Path(options.sheet), pictures)
    return wrong > 0


def agrees(name, theirs, on, off):
    """Whether a picture [h, w, 4] is near Mitsuba's two, [2, h, w, 4]; prints how near it is, and the one without."""
    from clfur.color import linear_to_srgb

    def shown(picture):
        return linear_to_srgb(np.maximum(picture[..., :3], 0).astype(np.float32)).astype(float)[seen]
    seen = (on[..., 3] > 0) | (theirs[0, ..., 3] > 0)
    a, b = (shown(each) for each in theirs)
    above = [np.sqrt(max(((shown(each) - a) * (shown(each) - b)).mean(), 0)) for each in (on, off)]
    means = [each[..., 0].sum() / each[..., 3].sum() for each in (theirs.mean(0), on, off)]
    print(f"{name:22} above the noise {above[0]:.4f}, off {above[1]:.4f}   noise "
          f"{np.sqrt(((a - b)**2).mean() / 2):.4f}   mean, Mitsuba {means[0]:.4f}, grid {means[1]:.4f}, off "
          f"{means[2]:.4f}", flush=True)
    return above[0] <= (.06 if name.startswith("white") else .05)


def tuft():
    """(Points [STRANDS, 5, 3] of straight strands that lean at random, the ball that they stand on)."""
    import clfur

    rng = np.random.default_rng(0)
    z, turn = 1 - 2 * (np.arange(STRANDS) + .5) / STRANDS, np.pi * (1 + 5**.5) * np.arange(STRANDS)
    out = np.stack([np.sqrt(1 - z * z) * np.cos(turn), z, np.sqrt(1 - z * z) * np.sin(turn)], 1)
    lean = out + .35 * rng.normal(size=(STRANDS, 3))
    lean *= (.5 * (1 - .3 * rng.random(STRANDS)) / np.linalg.norm(lean, axis=1))[:, None]
    ball = clfur.load_mesh("sphere")
    normals = ball.positions / np.linalg.norm(ball.positions, axis=1).max()
    return .985 * out[:, None] + np.linspace(0, 1, 5)[:, None] * lean[:, None], clfur.Mesh(
        .99 * normals, normals, None, ball.faces)


def by_clfur(name, device):
    """(A case's picture with scattering, and without), float32 [h, w, 4]."""
    import clfur

    hair, body, light = CASES[name]
    points, ball = tuft()
    lights = [clfur.Light(towards, color=tuple(np.array(given) / np.pi), ambient=0) for towards, given in SUNS[light]]
    scene = clfur.Scene(ball, clfur.Curves(points, width=WIDTH, look=clfur.Chiang(**HAIR[hair]), alpha=0), clfur.Camera(
        eye=EYE, target=(0, 0, 0), fov=FOV, size=SIZE), lights or clfur.Light(color=(0, 0, 0), ambient=0), body,
        environment=None if lights else clfur.Environment((1, 1, 1)))
    return [clfur.render(scene, device, clfur.Settings(grid=192, scattering=each)) for each in ("grid", "off")]


def theirs_of(name, options, kept):
    """Mitsuba's two pictures of a case, [2, h, w, 4]."""
    import clfur
    from clfur.twin import chiang

    answer = kept / f"{name}.npy"
    if not answer.exists():
        hair, body, light = CASES[name]
        look, (points, ball) = clfur.Chiang(**HAIR[hair]), tuft()
        asked = answer.with_suffix(".npz")
        np.savez(asked, points=points, positions=ball.positions, faces=ball.faces, body=body,
                 absorption=np.maximum(chiang.absorption_of(look.color, look.azimuthal_roughness), 0),
                 suns=np.array(SUNS[light]).reshape(-1, 2, 3), samples=options.samples // (1 if SUNS[light] else 4))
        subprocess.run([options.mitsuba, __file__, "--asked", asked], check=True)
        asked.unlink()
    return np.load(answer)


def by_mitsuba(asked):
    """Write pictures of two seeds, [2, h, w, 4], beside what is asked, as .npy."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    with np.load(asked) as file, tempfile.TemporaryDirectory() as folder:
        strands, ball = Path(folder) / "strands.txt", Path(folder) / "ball.obj"
        strands.write_text("\n\n".join("\n".join(f"{x:.7g} {y:.7g} {z:.7g} {WIDTH / 2:.7g}" for x, y, z in (
            2 * p[0] - p[1], *p, 2 * p[-1] - p[-2])) for p in file["points"]) + "\n", encoding="utf-8")
        ball.write_text("".join(f"v {x:.7g} {y:.7g} {z:.7g}\n" for x, y, z in file["positions"])
                        + "".join(f"f {a} {b} {c}\n" for a, b, c in file["faces"] + 1), encoding="utf-8")
        suns = {f"sun{k}": {"type": "directional", "direction": direction.tolist(),
                            "irradiance": {"type": "rgb", "value": irradiance.tolist()}}
                for k, (direction, irradiance) in enumerate(file["suns"])}
        look = {"longitudinal_roughness": .3, "azimuthal_roughness": .3, "scale_tilt": -2.0, "int_ior": 1.55,
                "ext_ior": 1.0, "sigma_a": {"type": "rgb", "value": file["absorption"].tolist()}}
        scene = mi.load_dict({
            "type": "scene", "integrator": {"type": "path", "max_depth": DEPTH, "rr_depth": 20, "hide_emitters": True},
            **(suns or {"sky": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}}}),
            "sensor": {"type": "perspective", "fov": FOV, "fov_axis": "y",
                       "to_world": mi.ScalarTransform4f().look_at(origin=EYE, target=[0, 0, 0], up=[0, 1, 0]),
                       "film": {"type": "hdrfilm", "width": SIZE[0], "height": SIZE[1], "rfilter": {"type": "box"},
                                "pixel_format": "rgba"}},
            "ball": {"type": "obj", "filename": str(ball), "face_normals": True, "bsdf": {
                "type": "diffuse", "reflectance": {"type": "rgb", "value": file["body"].tolist()}}},
            "hair": {"type": "bsplinecurve", "filename": str(strands), "bsdf": {"type": "hair", **look}}})
        parts = range(0, int(file["samples"]), 32)
        pictures = [np.mean([np.array(mi.render(scene, spp=32, seed=1000 * seed + k)) for k in parts], 0)
                    for seed in (0, 1)]
    np.save(asked.with_suffix(".npy"), pictures)


def sheet(path, pictures):
    """Save a row of pictures of each case, over grey, twice as large: Mitsuba's, ours, ours without scattering."""
    from PIL import Image

    from clfur.color import linear_to_srgb

    rows = [np.concatenate([np.maximum(each[..., :3], 0) + .18 * (1 - each[..., 3:].clip(0, 1)) for each in (
        theirs.mean(0), on, off)], 1) for theirs, on, off in pictures.values()]
    half = (len(rows) + 1) // 2
    rows += [np.zeros_like(rows[0])] * (2 * half - len(rows))
    whole = np.concatenate([np.concatenate(rows[:half]), np.concatenate(rows[half:])], 1)
    shown = (255 * linear_to_srgb(whole.astype(np.float32)) + .5).clip(0, 255).astype(np.uint8)
    Image.fromarray(shown.repeat(2, 0).repeat(2, 1)).save(path)


if __name__ == "__main__":
    sys.exit(main())
