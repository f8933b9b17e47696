"""Holds how strands of the look `clfur.Chiang` scatter light against Mitsuba 3's hair, averaged over a strand's width.

    python tools/chiang_mitsuba.py [--mitsuba PYTHON] [--device DEVICE]

Mitsuba runs in a process of its own, by another Python if that has it (`pip install mitsuba`): the two share a file.
For each set of numbers 200 strands in random directions send light to an eye by the device's own kernels and tables;
Mitsuba's `hair`, asked for the same angles at 4,000 places across the strand, is to give the same: to 1 % where that is
above .1, to .005 elsewhere.  Exits 1 where it does not.  Mitsuba's tilt is the other way round along the strand.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

PAIRS, PLACES, LIGHTS = 200, 4000, 20
SETS = {
    "brown": {"eumelanin": 1.3, "pheomelanin": .2},
    "blond": {"eumelanin": .2, "pheomelanin": .4},
    "white, smooth": {"longitudinal_roughness": .2, "azimuthal_roughness": .2, "absorption": (0, 0, 0)},
    "white, rough": {"longitudinal_roughness": .6, "azimuthal_roughness": .7, "tilt": 3, "absorption": (0, 0, 0)},
    "black": {"eumelanin": 8},
    "sharp": {"longitudinal_roughness": .15, "azimuthal_roughness": .1, "absorption": (.06, .1, .2)},
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--mitsuba", default=sys.executable, metavar="PYTHON", help="a Python that has Mitsuba")
    parser.add_argument("--device", help="as for clfur")
    parser.add_argument("--asked", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.asked:
        return by_mitsuba(Path(options.asked))
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "asked.npz"
        ours = {name: by_clfur(options.device, given, seed) for seed, (name, given) in enumerate(SETS.items())}
        np.savez(asked, **{f"{name}/{key}": value for name, each in ours.items() for key, value in each.items()})
        subprocess.run([options.mitsuba, __file__, "--asked", asked], check=True)
        with np.load(asked.with_name("answer.npz")) as answer:
            return any([not agrees(name, each["sent"], each["twin"], answer[name]) for name, each in ours.items()])


def agrees(name, sent, twin, meant):
    """Whether values are those of Mitsuba; prints how near they are."""
    bright = meant > .1
    error, off = np.abs(sent - meant), np.abs(twin - meant)
    relative, absolute = (error / meant)[bright].max(), error[~bright].max(initial=0)
    print(f"{name:14} above .1 ({bright.sum():3} of {bright.size}): {relative:7.3%}   elsewhere: {absolute:.5f}   "
          f"mean: {error.sum() / meant.sum():.3%}   twin: {(off / meant)[bright].max():.4%}, {off[~bright].max():.5f}")
    return relative <= .01 and absolute <= .005


def by_clfur(device, given, seed):
    """{sent, twin: [PAIRS, 3] S of strands; theta_v, theta_l, phi: [PAIRS]; look: its numbers; absorption: [3]}."""
    import clfur
    from clfur.pipeline.build import upload_curves
    from clfur.pipeline.views import light_of, view_of
    from clfur.render import schedulers
    from clfur.stages import chiang, strand_light
    from clfur.stages.lighting import unshadowed
    from clfur.twin import chiang as twin
    from clfur.twin.strand_light import between

    look = clfur.Chiang(**given)
    rng = np.random.default_rng(seed)
    a, t = rng.normal(size=(PAIRS, 3)), rng.normal(size=(PAIRS, 3))
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    lights = [clfur.Light(direction, color=(1, 1, 1), ambient=0) for direction in rng.normal(size=(LIGHTS, 3))]
    scene = clfur.Scene(fur=clfur.Curves(np.stack([a, a + 1e-3 * t], 1), width=1e-4, look=look), light=lights,
                        camera=clfur.Camera(eye=(0, 0, 6), target=(0, 0, 0)))
    gpu, = schedulers(device)
    with gpu.frame():
        strands, sent = upload_curves(gpu, scene.strands, None), np.zeros((PAIRS, 3))
        tables = chiang.scattering(gpu, scene.strands.hair_types)
        for number, light in enumerate(lights):
            these = np.arange(number, PAIRS, LIGHTS)
            lit = strand_light.radiance(gpu, view_of(scene, 1), unshadowed(gpu, light_of(light)), strands,
                                        scattering=tables)
            sent[these] = between(lit.places.get(), 2 * these, np.zeros(len(these))) / np.pi
    points = scene.strands.points.astype(float).reshape(PAIRS, 2, 3)
    t = points[:, 1] - points[:, 0]
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    v = np.array([0, 0, 6]) - points[:, 0]
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    towards = np.array([-lights[number % LIGHTS].direction for number in range(PAIRS)])
    sines = [(t * each).sum(1) for each in (v, towards)]
    u, w = (each - sine[:, None] * t for each, sine in zip((v, towards), sines))
    angles = {"theta_v": np.arcsin(sines[0]), "theta_l": np.arcsin(sines[1]),
              "phi": np.arctan2(np.linalg.norm(np.cross(u, w), axis=1), (u * w).sum(1))}
    colors = np.broadcast_to(look.color, (PAIRS, 3))
    return {"sent": sent, "twin": twin.scattering(*angles.values(), colors, look.lobes), **angles,
            "look": np.array(look.lobes), "absorption": twin.absorption_of(look.color, look.azimuthal_roughness)}


def by_mitsuba(asked):
    """Write answer.npz beside what is asked: {set: [PAIRS, 3]}."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    answer = {}
    with np.load(asked) as file:
        for name in SETS:
            each = {key: file[f"{name}/{key}"] for key in ("theta_v", "theta_l", "phi", "look", "absorption")}
            along, around, tilt, index = each["look"].tolist()
            hair = mi.load_dict({
                "type": "hair", "longitudinal_roughness": along, "azimuthal_roughness": around,
                "scale_tilt": float(np.degrees(tilt)), "int_ior": index, "ext_ior": 1.0,
                "sigma_a": {"type": "rgb", "value": each["absorption"].tolist()}})
            answer[name] = np.array([mean_of(mi, hair, *angles) for angles in zip(
                each["theta_v"], each["theta_l"], each["phi"])])
    np.savez(asked.with_name("answer.npz"), **answer)


def mean_of(mi, hair, theta_v, theta_l, phi):
    """Mean of what Mitsuba's hair scatters over its width: y is along the strand, z its normal where a ray meets it."""
    total, context, si = np.zeros(3), mi.BSDFContext(), mi.SurfaceInteraction3f()
    for gamma in np.arcsin((np.arange(PLACES) + .5) / PLACES * 2 - 1):
        si.wi = [np.cos(theta_v) * np.sin(gamma), -np.sin(theta_v), np.cos(theta_v) * np.cos(gamma)]
        to = [np.cos(theta_l) * np.sin(gamma + phi), -np.sin(theta_l), np.cos(theta_l) * np.cos(gamma + phi)]
        total += np.array(hair.eval(context, si, to))
    return total / PLACES


if __name__ == "__main__":
    sys.exit(main())
