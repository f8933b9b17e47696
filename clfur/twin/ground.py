"""What cl/ground.cl means, in float64: where a ray meets the plane, and the light there.

A ray's direction is that between two of its points, one of which is the eye.
"""

import numpy as np

from .lighting import light_at
from .raster import DEPTH_ONE, PATTERNS
from .vectors import f64

GROUND, ID_GROUND = 0xFFFFFFFE, -4
LUMINANCE = np.array([.2126, .7152, .0722])


def distances(view, height):
    """How far along the view's axis each sample's ray meets the plane -> [rows, width, samples]: not where <= 0."""
    return _met(view, height)[1]


def put(view, height, visible):
    """The nearest of ``visible`` [rows, width, samples] uint64 and the plane at this height."""
    w, near = distances(view, height), f64(view["to_screen"])[3, 2]
    with np.errstate(divide="ignore"):
        depth = np.where(w <= near, 0, np.ceil(DEPTH_ONE * (1 - near / w)))
    key = (depth.clip(0).astype(np.uint64) << np.uint64(32)) | np.uint64(GROUND)
    return np.where(w > 0, np.minimum(visible, key), visible)


def of_sky(plane, squares, p):
    """Light [n, 3] of a sky on places p [n, 3] of the ground: on squares [side², 4] of `OnGround`, by B-splines."""
    side, middle, scale = int(plane["size"][0]), f64(plane["place"])[:2], f64(plane["place"])[2:]
    outside, squares = f64(plane["whole"])[:3], f64(squares).reshape(side, side, -1)[..., :3]
    far = (p[:, [0, 2]] - middle) * scale
    u, v = ((far / (1 + np.linalg.norm(far, axis=1, keepdims=True)) + 1) * side / 2).T
    weights = [np.select([d <= .5, d < 1.5], [.75 - d * d, (1.5 - d)**2 / 2], 0)
               for d in (np.abs(each[:, None] - np.arange(-1, side + 1) - .5) for each in (u, v))]
    around = np.pad(squares - outside, [(1, 1), (1, 1), (0, 0)])
    end = ((u < 1) | (v < 1) | (u >= side - 1) | (v >= side - 1))[:, None]
    return outside + np.where(end, 0, np.einsum("ni,nj,jic->nc", *weights, around))


def light(view, height, color, lights, through, visible, plane=None, squares=None):
    """The light of samples that see the plane, averaged -> [rows, width, 4] float64 premultiplied.

    color: linear r, g, b, or None: it shows what is missing alone.  lights: [n] structs.  through: [n] share of each
    that reaches the plane, or [n, rows, width, samples].  plane, squares: see `of_sky`, if there is one.
    """
    rows, width, samples = visible.shape
    p, _ = _met(view, height)
    p = p.reshape(-1, 3)
    rgb, left, whole = np.zeros((len(p), 3)), np.zeros(len(p)), np.zeros(len(p))
    for each, share in zip(lights, through):
        to_light, direct, ambient = light_at(each, p)
        direct = direct * np.maximum(to_light[:, 1:2], 0)
        reached = direct * np.broadcast_to(share, visible.shape).reshape(-1, 1)
        whole += direct @ LUMINANCE + ambient
        left += reached @ LUMINANCE + ambient
        rgb += reached + ambient
    if plane is not None:
        falls = of_sky(plane, squares, np.where(np.isfinite(p), p, 0))
        whole, left, rgb = whole + f64(plane["whole"])[:3] @ LUMINANCE, left + falls @ LUMINANCE, rgb + falls
    if color is None:
        rgb, alpha = 0 * rgb, 1 - left / np.where(whole > 0, whole, 1) * (whole > 0) - (whole == 0)
    else:
        rgb, alpha = rgb * f64(color), np.ones(len(p))
    sees = (visible & np.uint64(0xFFFFFFFF)) == GROUND
    image = np.concatenate([rgb, alpha[:, None]], 1).reshape(rows, width, samples, 4)
    return np.where(sees[..., None], image, 0).mean(2)


def outputs(view, height, visible):
    """{depth, id, normal} of pixels whose nearest sample sees the plane: inf, -1 and 0 elsewhere."""
    nearest = visible.argmin(2)[..., None]
    w = np.take_along_axis(distances(view, height), nearest, 2)[..., 0]
    on = (visible.min(2) & np.uint64(0xFFFFFFFF)) == GROUND
    return {"depth": np.where(on, w, np.inf), "id": np.where(on, ID_GROUND, -1),
            "normal": np.where(on[..., None], (0, 1, 0, 0), 0)}


def _met(view, height):
    """(Places [rows, width, samples, 3], distances along the view's axis) at which rays meet the plane."""
    (first, end, left, _), (width, _, samples, _) = ([int(n) for n in view[name]] for name in ("rows", "size"))
    y, x, s = np.meshgrid(np.arange(first, end), left + np.arange(width), np.arange(samples), indexing="ij")
    offset = f64(PATTERNS[samples])[s] / 16
    half = np.full(x.shape, .5)
    place = np.stack([x + .5 + offset[..., 0], y + .5 + offset[..., 1], half, np.ones(x.shape)], -1)
    q = np.linalg.solve(f64(view["to_screen"]).T, place.reshape(-1, 4).T).T
    eye, row = f64(view["eye"])[:3], f64(view["to_screen"])[:, 3]
    d = (q[:, :3] / q[:, 3:] - eye).reshape(*x.shape, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = eye + (height - eye[1]) / d[..., 1:2] * d
    return p, p @ row[:3] + row[3]
