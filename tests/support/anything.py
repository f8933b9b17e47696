"""Scenes drawn by lot, and what holds for each picture."""

import warnings

import numpy as np

import clfur

from .scenes import icosphere

OUTPUTS = "color", "depth", "id", "tangent", "normal", "uv", "coverage"
BALL = clfur.Mesh(*[icosphere(1)[0]] * 2, icosphere(1)[0][:, :2], icosphere(1)[1])
RASTERS = "coverage", "samples"


def any_curves(rng, n=120):
    """Strands of all lengths and widths, some of them bald."""
    counts = rng.integers(0, 9, n)
    roots = rng.normal(size=(n, 3))
    roots /= np.linalg.norm(roots, axis=1, keepdims=True)
    along = np.concatenate([np.arange(count) for count in counts])
    of = np.repeat(np.arange(n), counts)
    points = roots[of] * (1 + .06 * along[:, None]) + rng.normal(0, .01, (len(of), 3))
    return clfur.Curves(points, counts=counts, width=10 ** rng.uniform(-4, -1, (n, 1)),
                        color=rng.uniform(0, 1, (n, 1, 3)), alpha=rng.uniform(0, 1))


def any_hair(rng):
    return clfur.HairType(
        segments=int(rng.integers(0, 9)), segment_length=rng.uniform(0, .08), width=10 ** rng.uniform(-4, -1),
        curl=(rng.uniform(0, .02), rng.uniform(0, 3)), alpha=rng.uniform(0, 1), length_variation=rng.uniform(0, 1),
        direction_variation=rng.uniform(0, 1), color_variation=rng.uniform(0, 1), exponent=10 ** rng.uniform(0, 4))


def any_shells(rng):
    return clfur.Shells(
        length=rng.uniform(.01, .4), layers=int(rng.integers(1, 40)), frequency=10 ** rng.uniform(0, 2),
        pattern=str(rng.choice(["cells", "sine"])), density=rng.uniform(.1, 1), alpha=rng.uniform(0, 1),
        wind=rng.normal(0, .3, 3) * rng.integers(0, 2))


def any_light(rng):
    spot = {"position": 3 * rng.normal(size=3), "angle": rng.uniform(5, 170)} if rng.integers(0, 2) else {}
    return clfur.Light(direction=rng.normal(size=3), color=rng.uniform(0, 2, 3), ambient=rng.uniform(0, .3), **spot)


def any_camera(rng, size=(37, 29)):
    """Outside, within the fur, or turned away."""
    eye = rng.normal(size=3)
    eye *= rng.uniform(.9, 4) / np.linalg.norm(eye)
    return clfur.Camera(eye=eye, target=rng.normal(0, .5, 3), up=rng.normal(size=3), fov=10 ** rng.uniform(0, 2.2),
                        size=size)


def any_scene(seed):
    rng = np.random.default_rng(seed)
    strands = [any_curves(rng), clfur.Strands(types=any_hair(rng), roots=int(rng.integers(0, 400)), seed=seed),
               clfur.Strands(types=any_hair(rng), inner=2, outer=2), None][rng.integers(0, 4)]
    fur = [part for part in (strands, any_shells(rng) if rng.integers(0, 2) else None) if part is not None]
    return clfur.Scene(BALL, fur or None, any_camera(rng), [any_light(rng) for _ in range(rng.integers(1, 4))],
                       body_color=None if rng.integers(0, 3) == 0 and fur else rng.uniform(0, 1, 3))


def any_settings(seed, **fixed):
    rng = np.random.default_rng(seed + 10**6)
    return clfur.Settings(**{
        "samples": int(rng.choice([1, 4, 16])), "raster": str(rng.choice(RASTERS)), "grid": 32, "shadow_map": 64,
        "shadows": str(rng.choice(["off", "binary", "count", "trilinear", "length"])),
        "lod": float(rng.choice([0, .5, 2])), **fixed})


def drawn(scene, gpu, settings):
    """All outputs of a scene; none may be NaN, and all but depth are finite."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* ends long loops", RuntimeWarning)
        images = clfur.render(scene, gpu, settings, OUTPUTS)
    for name, image in images.items():
        assert (~np.isnan(image) if name in ("depth", "position") else np.isfinite(image)).all(), name
    assert images["color"].min() >= 0 and images["depth"].min() >= 0
    return images
