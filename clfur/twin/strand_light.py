"""What cl/strand_light.cl and cl/places.h mean, in float64: what gets through to places of strands, and what these
send to the eye, exactly or between places where it is known.

``strands`` are any objects with the arrays of `DeviceStrands` as members, in NumPy.
"""

import numpy as np

from .lighting import light_at
from .scatter import fibre
from .strands import tangents_at
from .vectors import dot, f64, mix, unit

DEPTH_ONE = 1 << 30        # fixed-point depth at infinity; 0 is the near plane
STEEPEST = 5               # texels by which the body may rise in depth from one texel to the next
FEW = 5                    # places of a segment
POINTS, SEARCHED = 64, 24  # of a disc, and where what hides it is looked for


def transmittance(lights, strands, shadows, grids, light_views, crossings, shadow_maps):
    """Share of each light's direct light that gets through to points of strands -> [lights, points] float64.

    lights, shadows, grids, light_views: [lights] structs.  crossings: [lights] of [nz + 1, ny, nx] before each layer,
    or None.  shadow_maps: [lights] of [height, width] uint64, depth << 32 | id, or None.
    """
    points = f64(strands.points)
    strand = np.asarray(strands.strand_of)[np.arange(len(points)) // strands.run].astype(int)
    alpha = f64(strands.types["shine"])[f64(strands.uv)[strand, 2].astype(int), 2]
    result = np.ones((len(lights), len(points)))
    for n, shadow in enumerate(shadows):
        if shadow["body"][0]:
            result[n] = past_body(light_views[n], shadow_maps[n], int(shadow["body"][1]), points[:, :3],
                                  f64(strands.normals)[strand, :3], float(shadow["disc"][0]))
        once, by_width, by_fragment, by_count = f64(shadow["hair"])
        if once > 0:
            depth = 1 - alpha if by_count > 0 else -np.log(np.maximum(alpha, 1e-6))
            result[n] *= through_hair(grids[n], f64(crossings[n]), once, points[:, :3],
                                      by_width * points[:, 3] * depth / once, by_fragment * depth / once)
    return result


def through_hair(grid, crossings, once, p, by_width, by_fragment):
    """Share of light that gets through the hair before places p [n, 3]: linear between the middles of columns and the
    sides of layers, less what a strand has added there itself (Lokovic and Veach 2000, sums in place of functions)."""
    q = np.c_[p, np.ones(len(p))] @ f64(grid["to_grid"])
    w, (nx, ny, nz) = q[:, 3], np.asarray(grid["size"][:3], int)
    x, y, z = q[:, 0] / w - .5, q[:, 1] / w - .5, np.clip(q[:, 2], 0, nz)
    inside = (w > 0) & (x > -1) & (y > -1) & (x < nx) & (y < ny)
    around = np.pad(crossings, ((0, 0), (1, 1), (1, 1)))
    x, y, z = (np.where(inside, each, 0) for each in (x, y, z))
    total = 0
    for dz in 0, 1:
        layer = np.minimum(np.floor(z), nz - 1).astype(int)
        for dy in 0, 1:
            for dx in 0, 1:
                fx, fy, fz = x - np.floor(x), y - np.floor(y), z - layer
                weight = np.abs(1 - dx - fx) * np.abs(1 - dy - fy) * np.abs(1 - dz - fz)
                total = total + weight * around[layer + dz, np.floor(y).astype(int) + dy + 1,
                                                np.floor(x).astype(int) + dx + 1]
    return np.where(inside, np.exp(-once * np.maximum(total - by_width / w - by_fragment, 0)), 1)


def past_body(view, shadow_map, radius, p, n, disc=0.0):
    """What `hidden_share` leaves of a light that is a ``disc``; where that tells nothing, the share of the texels
    around places p [n, 3] in which the body is not nearer to the light than the plane through p across n, brought
    nearer by 2 radius + 1 texels (Reeves, Salesin and Cook 1987; planes: Schüler 2005)."""
    q = np.c_[p, np.ones(len(p))] @ f64(view["to_screen"])
    height, width = shadow_map.shape
    x, y, e = (q[:, :3] / q[:, 3:]).T
    plane = np.c_[n, -dot(n, p)] @ f64(view["to_world"]).T       # (x, y, e, 1) of places on it are across this
    texel = e / float(view["scale"][0]) if view["eye"][3] > 0 else np.full(len(p), 1 / width)
    limit = STEEPEST * texel
    with np.errstate(divide="ignore", invalid="ignore"):
        dx, dy = (np.where(plane[:, 2] != 0, np.clip(-plane[:, k] / plane[:, 2], -limit, limit), 0) for k in (0, 1))
    dark = np.zeros(len(p))
    depths = (shadow_map >> np.uint64(32)).astype(float)
    for j in range(-radius, radius + 1):
        for i in range(-radius, radius + 1):
            column, row = np.floor(x).astype(int) + i, np.floor(y).astype(int) + j
            inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
            seen = depths[np.where(inside, row, 0), np.where(inside, column, 0)] / DEPTH_ONE
            mine = 1 - (e + (1 + 2 * radius) * texel + dx * (column + .5 - x) + dy * (row + .5 - y))
            dark += inside & (seen <= 1) & (seen < mine)
    light = 1 - dark / (2 * radius + 1)**2
    if disc:
        plane = e + (1 + 2 * radius) * texel - dx * x - dy * y
        hidden = [hidden_share(depths, disc, radius, *place) for place in zip(x, y, e, plane, dx, dy)]
        light = np.where(np.array(hidden) >= 0, 1 - np.array(hidden), light)
    return np.where(q[:, 3] > 0, light, 1)


def hidden_share(depths, disc, radius, x, y, e, plane, dx, dy):
    """Share of a disc that a map hides from a place (x, y, e) of it, -1 where its blur is narrower than the filter's
    ``radius`` (Fernando 2005); disc: how many texels it is wide to a difference of depth of 1."""
    (points, at), (around, away) = spiral(POINTS), spiral(SEARCHED)

    def nearer_by(places):
        column, row = np.floor(places).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < depths.shape[1]) & (row < depths.shape[0])
        seen = np.where(inside, depths[np.where(inside, row, 0), np.where(inside, column, 0)], np.inf)
        there = 1 - seen / DEPTH_ONE
        return np.where((seen <= DEPTH_ONE) & (there > plane + dx * (column + .5) + dy * (row + .5)), there - e, 0)
    reach = min(disc * (1 - e), depths.shape[1] / 2)
    by = nearer_by((x, y) + reach * away[:, None]**2 * around)
    hides = (by > 0) & (disc * by >= reach * away**3)
    area = away[hides]**4 / by[hides]**2
    wide = disc * (area * by[hides]).sum() / area.sum() if hides.any() else 0
    if wide < .5 + radius:
        return -1
    if (by > 0).all():
        return 1
    by = nearer_by((x, y) + wide * points)
    return ((by > 0) & (2 * disc * by >= wide * at)).mean()


def spiral(points):
    """(Points [n, 2] of a disc of radius 1, their distances [n] from its middle) (Vogel 1979)."""
    number = np.arange(points)
    at, angle = np.sqrt((number + .5) / points), number * (np.pi * (3 - np.sqrt(5)))
    return np.stack([at * np.cos(angle), at * np.sin(angle)], 1), at


def sent(view, lights, k, at, strands, transmittances=None):
    """Light that places send to the eye, shares ``at`` [n] of the way along the segments that begin at points k [n] ->
    [n, 3] float64, linear r, g, b.

    lights: structs.  transmittances: [lights, points] share of their direct light, all if None; in between they change
    evenly.
    """
    k, at = np.asarray(k), f64(at)
    points, colors, eye = f64(strands.points)[:, :3], f64(strands.colors)[:, :3], f64(view["eye"])
    strand = np.asarray(strands.strand_of)[k // strands.run].astype(int)
    p, t = mix(*points[[k, k + 1]], at), unit(mix(*tangents_at(points, np.asarray(strands.spans)[strand], k), at))
    color = (np.broadcast_to(colors[0], p.shape) if strands.color_per == 0 else colors[strand] if strands.color_per == 1
             else mix(colors[k], colors[k + 1], at))
    kind = f64(strands.uv)[strand, 2].astype(int)
    shine, lobes = f64(strands.types["shine"])[kind], f64(strands.types["lobes"])[kind]
    rgb = np.zeros(p.shape)
    for n, light in enumerate(lights):
        to_light, direct, ambient = light_at(light, p)
        there = 1 if transmittances is None else mix(*f64(transmittances[n])[[k, k + 1], None], at)
        rgb += fibre(color, shine, t, to_light, unit(eye[:3] - eye[3] * p), there * direct, ambient, lobes)
    return rgb


def between(places, k, at):
    """Light between the places of segments k [n], shares ``at`` [n] of the way along them -> [n, 3] float64.

    places: [segments, 5] uint64, as `strand_light.Places` has them.  Through the three places around ``at`` goes a
    parabola (Lagrange), below 0 it is 0.
    """
    few, at, pieces = np.asarray(places)[k], f64(at), (FEW - 1) // 2
    piece = np.minimum((at * pieces).astype(int), pieces - 1)
    share, result = (at * pieces - piece)[:, None], 0
    for n, node in enumerate((0, .5, 1)):
        light = unpacked(few[np.arange(len(few)), 2 * piece + n])
        others = [other for other in (0, .5, 1) if other != node]
        result = result + light * np.prod([(share - other) / (node - other) for other in others], 0)
    return np.maximum(result, 0)


def unpacked(packed):
    """[...] uint64 -> [..., 3] float64: three floats without their sign and last 10 bits."""
    parts = np.stack([packed >> np.uint64(shift) & np.uint64(0x1FFFFF) for shift in (42, 21, 0)], -1)
    return f64((parts.astype(np.uint32) << np.uint32(10)).view(np.float32))
