"""What cl/transport.cl and cl/transport.h mean, in float64: sums over strands, exact values of `chiang` in place of
tables, and each direction's way through the cells as one loop over them, slice by slice."""

import numpy as np

from . import chiang
from .vectors import dot, unit

STEPS = 2
LARGEST = 0.9


def amounts(low, scale, n, points, spans, opaque, shades):
    """What strands leave in cells -> [n, n, n, 12] float64: (1 - alpha) · width · length over a cell's face, times
    their directions x, y, z, their shades r, g, b, 0..1, and the second moment of directions xx, yy, zz, xy, xz, yz.

    points [P, 4]; spans [strands, 2]; opaque, shades: [strands], [strands, 3].  Places are found in float32, as there.
    """
    cells = np.zeros((n, n, n, 12))
    points, low, scale = np.asarray(points, np.float32), np.asarray(low, np.float32), np.float32(scale)
    for (first, count), share, shade in zip(np.asarray(spans, int), opaque, shades):
        for a, b in zip(points[first:first + count - 1], points[first + 1:first + count]):
            d = b - a
            length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) * scale
            if not length > 0:
                continue
            steps = int(length * STEPS) + 1
            p = a + ((np.arange(steps, dtype=np.float32) + np.float32(0.5)) / np.float32(steps))[:, None] * d
            at = (p[:, :3] - low) * scale
            inside = ((at >= 0) & (at < n)).all(1)
            x, y, z = np.floor(at[inside]).astype(int).T
            amount = share * float(length) * float(scale) / steps * p[inside, 3].astype(float)
            t = d[:3].astype(float) / np.linalg.norm(d[:3].astype(float))
            second = [*(t * t), t[0] * t[1], t[0] * t[2], t[1] * t[2]]
            np.add.at(cells, (z, y, x), amount[:, None] * np.concatenate([t, shade, second]))
    return cells


def softened(cells):
    """Each cell [n, n, n, ...] as the mean of itself and its neighbours along each axis in turn, weights 1, 2, 1; the
    outermost cells are their own neighbours out of the grid."""
    for axis in range(3):
        n = cells.shape[axis]
        wide = np.take(cells, np.clip(np.arange(-1, n + 1), 0, n - 1), axis)
        before, here, after = (np.take(wide, np.arange(k, k + n), axis) for k in range(3))
        cells = (before + 2 * here + after) / 4
    return cells


def tensors(moments):
    """[..., 6] xx, yy, zz, xy, xz, yz -> [..., 3, 3]."""
    return moments[..., [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def kept(cells, directions):
    """Share of what hair in cells sends that stays there, mean of directions; cells: [n, n, n, 3, 3] moments."""
    density, shares = np.trace(cells, axis1=3, axis2=4), 0
    for w in np.asarray(directions, float):
        across = np.maximum(density**2 - density * np.einsum("zyxij,i,j->zyx", cells, w, w), 0)
        depth = np.sqrt(across) / np.abs(w).max()
        shares = shares + np.where(depth > 0, 1 + np.expm1(-depth) / np.where(depth > 0, depth, 1), 0)
    return shares / len(directions)


def settled(light, before, share):
    """Light [D, n, n, n] after an order, with what of it comes back to its own cell again and again, evenly from all
    directions.  before: the light that it comes of; share: [n, n, n] of light that hair in a cell sends and gets."""
    more = (light - before).sum(0) * np.minimum(share, LARGEST) / (1 - np.minimum(share, LARGEST))
    return np.maximum(light + more / len(light), 0)


def continued(lights):
    """Light [D, n, n, n] of three orders that follow each other -> that of the last, with what further ones would add:
    evenly to all directions, the rest of a geometric series."""
    sums = [each.sum(0) for each in lights]
    first, last = sums[1] - sums[0], sums[2] - sums[1]
    ratio = np.where((first > 0) & (last > 0), np.minimum(last / np.where(first > 0, first, 1), LARGEST), 0)
    return lights[2] + last * ratio / (1 - ratio) / len(lights[2])


def evened(light, amount):
    """Light [D, n, n, n] that hair shows: evened out over the hair around, the more the denser a cell is."""
    share, weights = amount**2 / (amount**2 + 1), softened(amount)
    around = np.stack([softened(each * amount) for each in light]) / np.where(weights > 0, weights, 1)
    return np.where(weights > 0, light + share * (around - light), light)


def scattering(t, v, to_light, sigma, lobes):
    """S of hair of one look along t that sends light from to_light towards v, all [n, 3] unit; sigma: what a radius
    absorbs."""
    roughness, around, tilt, index = lobes
    sine_v, sine_l = np.clip(dot(t, v), -1, 1), np.clip(dot(t, to_light), -1, 1)
    one, other = unit(v - sine_v[:, None] * t), unit(to_light - sine_l[:, None] * t)
    phi = np.arctan2(np.linalg.norm(np.cross(one, other), axis=-1), dot(one, other))
    m = chiang.longitudinal(np.arcsin(sine_v), np.arcsin(sine_l), roughness, tilt)
    return (m * chiang.across(np.arcsin(sine_v), phi, np.full(len(t), float(sigma)), around, index)).sum(1)


def albedo(theta, sigma, lobes):
    """Share of all light around that hair sends towards an eye at angles theta [n] to the plane across it -> [n]."""
    h, weights = chiang.fejer(200)
    shares = chiang.attenuations(np.asarray(theta, float)[:, None], h, float(sigma), lobes[3]).sum(-1)
    return (shares * weights).sum(1) / 2


def phase(t, directions, parts, sigma, lobes):
    """What hair along t [3] sends on in each direction of light from each -> [from, to]: means over parts [D, k, 3]
    of where it comes from, so that sums are the albedo."""
    count, each = parts.shape[:2]
    result = np.zeros((count, count))
    for to, w in enumerate(directions):
        come = parts.reshape(-1, 3)
        values = scattering(np.broadcast_to(t, come.shape), np.broadcast_to(-w, come.shape), come, sigma, lobes)
        sums = values.reshape(count, each).sum(1)
        result[:, to] = sums / sums.sum() * albedo([np.arcsin(np.clip(-w @ t, -1, 1))], sigma, lobes)
    return result


def swept(cells, body, facing, directions, outside, sent, glow):
    """Mean light of cells -> [D, n, n, n]: that of `outside` [D], what cells send, [D, n, n, n], and a body, [n, n, n].

    cells: [n, n, n, 3, 3] moments of hair; body: [n, n, n] shares; facing: [n, n, n, 3] the way that its surface looks,
    or 0; directions: towards where light comes from.  Where a share of a cell is open, light that came through less is
    spread, through more is stopped; where it leaves the body, what the body hides is made up by what it sends.
    """
    n, result, open_ = len(body), np.zeros(sent.shape), 1 - body
    density = np.trace(cells, axis1=3, axis2=4)
    for number, w in enumerate(np.asarray(directions, float)):
        axis = int(np.argmax(np.abs(w)))
        step = w / abs(w[axis])
        depth = np.sqrt(np.maximum(density**2 - density * np.einsum("zyxij,i,j->zyx", cells, w, w), 0)) / abs(w[axis])
        through, leaves = np.exp(-depth), facing @ w < 0
        mean = np.where(depth > 0, -np.expm1(-depth) / np.where(depth > 0, depth, 1), 1)
        flux = np.full((n + 4, n + 4, n + 4, 2), [outside[number], 1.0])   # through what is open, and how much is
        for k in range(n)[::-1] if w[axis] > 0 else range(n):
            at = np.stack(np.meshgrid(*[np.arange(n) if a != axis else [k] for a in range(3)], indexing="ij"), -1)
            part = np.where(np.arange(3) == axis, 0, step - np.floor(step))
            base = at + np.where(np.arange(3) == axis, np.sign(w[axis]), np.floor(step)).astype(int)
            came = 0
            for corner in np.ndindex(2, 2, 2):
                x, y, z = np.moveaxis(base + corner + 2, -1, 0)
                came = came + np.prod(np.where(corner, part, 1 - part)) * flux[z, y, x]
            x, y, z = np.moveaxis(at, -1, 0)
            own = np.where(leaves[z, y, x], glow[z, y, x], 0)
            hidden = np.maximum(open_[z, y, x] - came[..., 1], 0)
            widest = came[..., 1] + hidden
            value = np.where(widest > 0, (came[..., 0] + hidden * own) / np.where(widest > 0, widest, 1), 0)
            source = sent[number, z, y, x]
            result[number, z, y, x] = mean[z, y, x] * value + (1 - mean[z, y, x]) * source
            share = np.where(leaves[z, y, x], 1, open_[z, y, x])
            value = np.where(leaves[z, y, x], open_[z, y, x] * value + body[z, y, x] * own, value)
            behind = through[z, y, x] * value + (1 - through[z, y, x]) * source
            flux[z + 2, y + 2, x + 2] = np.stack([behind * share, share], -1)
    return result


def leaving(low, scale, light, directions, p, t, v, sigma, lobes):
    """What hair at places p [n, 3] sends towards v of one channel's light in cells [D, n, n, n] -> [n]."""
    n = light.shape[1]
    at = np.clip((np.asarray(p, float) - low) * scale - 0.5, 0, n - 1)
    base = np.minimum(at.astype(int), n - 2)
    part, come = at - base, 0
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (base + corner).T
        come = come + np.prod(np.where(corner, part, 1 - part), 1) * light[:, z, y, x]
    values = np.array([scattering(t, v, np.broadcast_to(w, t.shape), sigma, lobes) for w in directions])
    return (values * come).sum(0) / values.sum(0) * albedo(np.arcsin(np.clip(dot(t, v), -1, 1)), sigma, lobes)
