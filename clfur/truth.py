"""What the methods approximate, by brute force and independent of the kernels."""

import math

import numpy as np


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

    first, owner = _segments(spans)
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


def _segments(spans):
    """Every segment's (first point, strand)."""
    counts = np.maximum(spans[:, 1] - 1, 0)
    owner = np.repeat(np.arange(len(spans)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return spans[owner, 0] + within, owner


def _key(bins):
    return bins[:, 0] * (1 << 32) + bins[:, 1]
