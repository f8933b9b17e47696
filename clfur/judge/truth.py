"""What the methods approximate, by brute force and independent of the kernels."""

import io
import math
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .. import cache
from ..errors import Error
from ..scene import Scene, checks
from ..scene.seen import seen
from ..twin.vectors import unit
from .geometry import before, geometry_of, segments
from .lights import Disc, Ground, Light, Straight
from .paths import Paths
from .rays import Eye
from .sky import Sky, spread

VERSION = 3              # of what `picture` gives, strands and bodies included: another makes the cache anew
RAYS = 1 << 18           # of the picture at a time
ALL = 1 << 12            # times that light is scattered at most: a path ends long before


def picture(scene: Scene, samples: int = 8, seed: int = 0, progress: Callable | None = None, orders: int = 0
            ) -> np.ndarray:
    """The picture that `clfur.render` approximates -> float64 [height, width, 4], as `render` has it.

    ``samples`` squared rays a pixel, one at random (by ``seed``) in each of as many squares, are averaged: a box filter
    over the pixel.  Each sees what is nearest: strands of their real width (ribbons that face the eye), or the body.
    The light there is as hair's look has it, or Lambert's on the body.  Of direct light a ray towards the light leaves
    the product of the alphas of all strands that it crosses (round, of their real width, all but the one it starts on),
    and nothing where it meets the body.  Light of a sky is what comes through along one ray for each of these, whose
    direction is chosen at random; it counts by its sine with a strand, its cosine on the body, over the sum of these.
    A light that is a disc shines from one of its points to each place.
    A ground is seen as `Ground` has it, a holdout hides.
    ``orders``: 0, or how many times light is scattered on its way at most (`ALL`: until nothing is left), where all
    strands have the look `clfur.Chiang`: what ``Settings(scattering="grid")`` stands for.  Then each ray goes on as a
    path does, by chance in a direction from which hair, or the body, sends light to where it came from; through strands
    as often as their alpha lets light through.  Lights and what is bright of a sky shine on each place where it turns,
    and where it leaves the scene it sees the sky, whose light hair then sends on as any other.  Lights leave out the
    flat ambient that they have by default; a ground gives hair no light.
    ``progress`` is called with the share that is done.  Raises `clfur.Error`
    for shells: these are judged by their own picture at many samples (tools/shells_laws.py); and for ``orders`` with
    strands of another look.
    """
    if not isinstance(scene, Scene):
        raise Error(f"scene is {scene!r:.60}; allowed: a clfur.Scene")
    if scene.shells is not None:
        raise Error("Scene.fur has Shells; allowed: Strands or Curves, since the truth knows strands and bodies only")
    samples, orders = checks.whole(1, 64)(samples, "samples"), checks.whole(0, ALL)(orders, "orders")
    if orders:
        _check_looks(scene)
    scene = scene.local
    hair, body = geometry_of(scene)
    eye, to_place, near = _camera(scene)
    width, height = scene.camera.size
    corners = np.array([(x, y, 1) for x in (0, width) for y in (0, height)]) @ to_place.T
    window = corners[:, :2].min(0), corners[:, :2].max(0)
    fibres, triangles = before(eye, hair, body, near, window)
    lights = [(Disc if light.size else Light)(scene, light, hair, body, orders > 0) for light in scene.lights]
    sky = None if scene.environment is None else Sky(scene, hair, body)
    under = Ground(scene) if scene.ground else None
    shining = Paths(scene, hair, body, lights, sky, orders) if orders else Straight(scene, hair, body, lights, sky)

    result = np.zeros((height, width, 4))
    rows = max(RAYS // (width * samples**2), 1)
    for top in range(0, height, rows):
        end = min(top + rows, height)
        pixels = np.concatenate([_in_row(row, width, samples, seed) for row in range(top, end)])
        places = (np.column_stack([pixels, np.ones(len(pixels))]) @ to_place.T)[:, :2]
        color = np.zeros((len(places), 4))
        depth, fibre = fibres.nearest(places)
        body_depth, triangle = triangles.nearest(places)
        ground_depth = under.distances(pixels) if under else np.full(len(depth), np.inf)
        nearer = np.flatnonzero(depth < np.minimum(body_depth, ground_depth))
        bare = np.flatnonzero((body_depth <= np.minimum(depth, ground_depth)) & (triangle >= 0))
        below = np.flatnonzero(ground_depth < np.minimum(depth, body_depth))
        if scene.body != "drawn":
            bare = bare[:0]
        on = np.concatenate([nearer, bare])
        color[on, 3] = 1
        p = np.concatenate([eye.points(places[nearer], depth[nearer]), eye.points(places[bare], body_depth[bare])])
        fibre[bare], triangle[nearer] = -1, -1
        share = np.concatenate([fibres.share(places[nearer], fibre[nearer]), np.zeros(len(bare))])
        random = sky and np.concatenate([_of_sky(row, width, samples, seed) for row in range(top, end)])
        own = np.random.default_rng((seed, top, 2)) if orders else sky and random[on]
        color[on, :3] = shining.light(p, _towards(eye, p), fibre[on], triangle[on], share, own)
        if under:
            at = eye.points(places[below], ground_depth[below])
            color[below] = under.light(at, lights, sky, random[below] if sky else None)
        result[top:end] = color.reshape(end - top, width, samples**2, 4).mean(2)
        if progress:
            progress(end / height)
    return result


def noise_of(scene, samples=8, seed=0, progress=None, orders=0):
    """One estimate of the standard error of each number of `picture`, from it and another seed -> [height, width, 4].

    Its root mean square over many pixels is that of the picture's error.  Arguments are as for `picture`.
    """
    one, other = (picture(scene, samples, seed + k, progress, orders) for k in (0, 1))
    return np.abs(one - other) / math.sqrt(2)


def cached_picture(scene, samples=8, folder=None, progress=None, orders=0):
    """`picture` with seed 0, kept in ``folder`` (clfur's in the user's cache if None) under what the scene is.

    Other arguments are as for `picture`.  A damaged file is made anew.  Raises `clfur.Error` as `picture` does, and
    where there is no folder to write to.
    """
    known = cache.digest(VERSION, samples, scene, *([orders] if orders else []))
    file = (cache.folder("truth") if folder is None else Path(folder)) / f"{known}.npz"
    width, height = scene.camera.size
    try:
        with np.load(file) as saved:
            kept = saved["picture"]
        if kept.shape == (height, width, 4) and kept.dtype == np.float64:
            return kept
    except (OSError, ValueError, LookupError, EOFError, zipfile.BadZipFile, zipfile.zlib.error):   # none, or damaged
        pass
    result, stream = picture(scene, samples, 0, progress, orders), io.BytesIO()
    np.savez_compressed(stream, picture=result)
    cache.write(file, stream.getvalue())
    return result


def _check_looks(scene):
    """Raise `clfur.Error` where light cannot be followed from hair to hair."""
    fur = scene.strands
    types = () if fur is None else fur.hairy_types
    other = next((kind.look.model for kind in types if kind.look.model != "chiang"), None)
    if other is not None:
        raise Error(f"light is to go from hair to hair, but the look of hair is {other}; allowed: clfur.Chiang for all "
                    "strands (--look chiang), or orders=0")


def _camera(scene):
    """(eye, the matrix from pixels to places, least distance ahead that is seen)."""
    camera = scene.camera
    eye = Eye(camera.pose[:3, 3], camera.pose[:3, :3].T * np.array([[1], [-1], [-1]]), False)
    return eye, np.linalg.inv(camera.intrinsics), seen(scene).near


def _in_row(row, width, samples, seed):
    """Where the rays of a row pass, in pixels: [width * samples², 2], the same whatever is drawn with it."""
    down, across = np.divmod(np.arange(samples**2), samples)
    within = np.random.default_rng((seed, row)).random((width, samples**2, 2)) + np.stack([across, down], 1)
    return (within / samples + np.stack([np.arange(width), np.full(width, row)], 1)[:, None]).reshape(-1, 2)


def _of_sky(row, width, samples, seed):
    """Random numbers of the rays of a row, for what they get from the sky: [width * samples², 3]."""
    return spread(samples**2, np.random.default_rng((seed, row, 1)).random((width, 1, 2))).reshape(-1, 3)


def _towards(eye, p):
    return unit(eye.origin - p)


# --- light in hair alone --------------------------------------------------------------------------------


def transmittance(points, spans, alphas, towards_light, queries, own, footprint, rays=64, seed=0):
    """How much light reaches places in hair: the mean of alpha^crossings over rays of light in a footprint.

    ``points``: [P, 4] x, y, z, width; ``spans``: [strands, 2] first point, points; ``alphas``: what one hair lets
    through, a number or [strands].  ``towards_light``: unit [3].  ``queries``: [Q, 3] with ``own`` [Q] the strand
    that each lies on (not counted), or -1.  Each of ``rays`` rays starts in the query's plane across the light,
    uniformly within ``footprint`` [world] of it; a single ray would see only the gaps between hairs.  Hairs are
    round fibres of their real width.  -> [Q] float64.
    """
    points, spans = np.asarray(points, float), np.asarray(spans, np.int64)
    alphas = np.broadcast_to(np.asarray(alphas, float), len(spans))
    z = -np.asarray(towards_light, float)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(z, x), z], 1)              # across, across, the way the light travels

    first, owner = segments(spans)
    a, b = points[first, :3] @ frame, points[first + 1, :3] @ frame
    radius = (points[first, 3] + points[first + 1, 3]) / 4
    places = np.asarray(queries, float) @ frame

    # Segments by square bins of the plane across the light, so that a query looks only at its neighbours.
    bin_size = max(footprint, np.abs(b - a)[:, :2].max(initial=0), 1e-9)
    low = np.floor((np.minimum(a, b)[:, :2] - radius[:, None] - footprint) / bin_size).astype(np.int64)
    high = np.floor((np.maximum(a, b)[:, :2] + radius[:, None] + footprint) / bin_size).astype(np.int64)
    entries, keys = [], []
    for dx in range(int((high - low)[:, 0].max(initial=0)) + 1):
        for dy in range(int((high - low)[:, 1].max(initial=0)) + 1):
            here = np.flatnonzero((low[:, 0] + dx <= high[:, 0]) & (low[:, 1] + dy <= high[:, 1]))
            entries.append(here)
            keys.append(_key(low[here] + (dx, dy)))
    entries, keys = np.concatenate(entries), np.concatenate(keys)
    order = np.argsort(keys, kind="stable")
    entries, keys = entries[order], keys[order]

    random = np.random.default_rng(seed)
    result = np.ones(len(places))
    query_keys = _key(np.floor(places[:, :2] / bin_size).astype(np.int64))
    starts, ends = np.searchsorted(keys, query_keys), np.searchsorted(keys, query_keys, "right")
    for q, (place, start, end) in enumerate(zip(places, starts, ends)):
        near = entries[start:end]
        near = near[(owner[near] != own[q]) & (np.minimum(a[near, 2], b[near, 2]) < place[2])]
        r, angle = footprint * np.sqrt(random.random(rays)), 2 * math.pi * random.random(rays)
        ray = place[:2] + np.stack([r * np.cos(angle), r * np.sin(angle)], 1)
        d = b[near] - a[near]
        e = ray[:, None] - a[near, :2]                       # [rays, near, 2]
        square = (d[:, :2] ** 2).sum(1)
        square[square == 0] = np.inf                         # along the light: no ray crosses it
        t = (e * d[:, :2]).sum(2) / square
        aside = np.abs(e[..., 0] * d[:, 1] - e[..., 1] * d[:, 0]) / np.sqrt(square)
        hit = (t >= 0) & (t < 1) & np.isfinite(square) & (aside < radius[near]) & (a[near, 2] + t * d[:, 2] < place[2])
        result[q] = np.exp(hit @ np.log(np.maximum(alphas[owner[near]], 1e-300))).mean()
    return result


def _key(bins):
    return bins[:, 0] * (1 << 32) + bins[:, 1]
