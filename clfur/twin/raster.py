"""What cl/raster.cl means: points are projected and snapped in the device's own order of float operations;
what a snapped line or triangle covers is then asked of every sample of its bounding box, in integers."""

import numpy as np

SUBPIXEL = 256             # fixed-point steps per pixel
DEPTH_ONE = 1 << 30        # fixed-point depth at infinity; 0 is the near plane
GUARD = 32768              # pixels from the origin at which lines and triangles are clipped
FRACTION = 24              # bits of a slope below the sub-pixel
NONE = (1 << 64) - 1       # a sample that nothing covers
BODY = 1 << 31             # id of triangle t is BODY | t

# Sample positions from the pixel's centre in 1/16 pixel, x and y: the standard patterns of Direct3D 11.
PATTERNS = {
    1: [(0, 0)],
    4: [(-2, -6), (6, -2), (-6, 2), (2, 6)],
    16: [(1, 1), (-1, -3), (-3, 2), (4, -1), (-5, -2), (2, 5), (5, 3), (3, -5),
         (-2, 6), (0, -7), (-4, -6), (-6, 4), (-8, 0), (7, -4), (6, 7), (-7, -8)],
}


def raster(view, points=None, spans=None, positions=None, triangles=None):
    """Draw strands and body triangles -> [height, width, samples] uint64: the smallest depth << 32 | id.

    view: a `View` struct. points [P, 4] x, y, z, width; spans [strands, 2] first point, points;
    positions [V, 4]; triangles [T, 4] with three vertices first.
    """
    width, height, samples, _ = (int(n) for n in view["size"])
    visible = np.full(height * width * samples, NONE, np.uint64)
    for samples_of, depth, number in fragments(view, points, spans, positions, triangles):
        key = depth.astype(np.uint64) << np.uint64(32) | np.uint64(number)
        visible[samples_of] = np.minimum(visible[samples_of], key)   # no fragment names a sample twice
    return visible.reshape(height, width, samples)


def fragments(view, points=None, spans=None, positions=None, triangles=None):
    """Yield what each drawn piece covers: (flat sample numbers [n], depths [n] int64, id); see `raster`."""
    size = tuple(int(n) for n in view["size"][:3])
    if positions is not None and len(triangles):
        for number, corners in snapped_triangles(view, positions, triangles):
            yield *cover_triangle(*corners, *size), number
    if points is not None and len(points):
        for number, a, b in snapped_segments(view, points, spans):
            yield *cover_segment(a, b, *size), number


# --- float: projection, snapping, clipping --------------------------------------------------------------


def project(view, points, dtype=np.float32):
    """World points [N, >=3] -> clip space [N, 4]: x, y in pixels and reversed depth, times w; and w."""
    m, p = view["to_screen"].astype(dtype), np.asarray(points)[:, :3].astype(dtype)
    return ((m[0] * p[:, 0:1] + m[1] * p[:, 1:2]) + m[2] * p[:, 2:3]) + m[3]


def snap(q):
    """Pixels, reversed depth, half a width [N, 4], divided by w -> sub-pixels, depth steps: int64 [N, 4]."""
    steps = np.array([SUBPIXEL, SUBPIXEL, DEPTH_ONE, SUBPIXEL], q.dtype)
    s = np.floor(q * steps + q.dtype.type(0.5)).astype(np.int64)
    s[:, 2] = DEPTH_ONE - s[:, 2]
    return s


def snap_ends(clip, half):
    """Clip-space points [N, 4] inside the guard band and half widths at w = 1 [N] -> int64 [N, 4]."""
    x, y, e, w = clip.T
    guard = clip.dtype.type(GUARD)
    e = np.minimum(np.maximum(e, 0), w)
    return snap(np.stack([x, y, e, np.minimum(half, guard * w)], 1) / w[:, None])


def half_widths(view, points, dtype=np.float32):
    """Half of each point's width in pixels at w = 1: [N]."""
    return dtype(0.5) * points[:, 3].astype(dtype) * view["scale"][0].astype(dtype)


def within(clip):
    """Which clip-space points [N, 4] can be snapped as they are: bool [N]."""
    return (clip[:, 3] > 0) & (planes(clip) >= 0).all(1)


def planes(clip):
    """How far points [N, 4] lie inside each clipping plane [N, 6]: near, far, sides of the guard band."""
    x, y, e, w = clip.T
    guard = clip.dtype.type(GUARD) * w
    return np.stack([w - e, e, guard - x, guard + x, guard - y, guard + y], 1)


def cut(inner, inner_by, outer, outer_by):
    """Where the way between a point inside a plane and one outside meets it, from the nearer of the two."""
    if inner_by > -outer_by:
        return outer + (inner - outer) * (outer_by / (outer_by - inner_by))
    return inner + (outer - inner) * (inner_by / (inner_by - outer_by))


def clip_segment(a, b, half):
    """The part of a segment a, b [4], with half widths [2], that lies inside all planes: (ends [2, 4], half [2])."""
    half_a, half_b = half
    for i in range(6):
        by_a, by_b = planes(np.stack([a, b]))[:, i]
        if by_a < 0 and by_b < 0:
            return None
        if by_a < 0:
            a, half_a = cut(b, by_b, a, by_a), cut(half_b, by_b, half_a, by_a)
        elif by_b < 0:
            b, half_b = cut(a, by_a, b, by_b), cut(half_a, by_a, half_b, by_b)
    return (np.stack([a, b]), np.stack([half_a, half_b])) if a[3] > 0 and b[3] > 0 else None


def before_near(clip, least):
    """The same for what lies before the near plane, no nearer than ``least``."""
    _, _, e, w = clip.T
    return np.column_stack([e - w, w - least, planes(clip)[:, 2:]])


def clip_polygon(corners, planes=planes):
    """The part of a convex polygon [4]·n that lies inside all planes (Sutherland and Hodgman 1974)."""
    for i in range(6):
        if not corners:
            break
        by = planes(np.stack(corners))[:, i]
        kept = []
        for p, q, by_p, by_q in zip(corners, corners[1:] + corners[:1], by, np.roll(by, -1)):
            if by_p >= 0:
                kept.append(p)
            if by_p >= 0 > by_q:
                kept.append(cut(p, by_p, q, by_q))
            elif by_p < 0 <= by_q:
                kept.append(cut(q, by_q, p, by_p))
        corners = kept
    return corners if all(c[3] > 0 for c in corners) else []


def snapped_segments(view, points, spans, dtype=np.float32):
    """Yield (first point, snapped end [4] ints, snapped end) of every segment, clipped where needed."""
    clip, half = project(view, points, dtype), half_widths(view, points, dtype)
    good = within(clip)
    snapped = np.zeros((len(points), 4), np.int64)
    snapped[good] = snap_ends(clip[good], half[good])
    for first, count in np.asarray(spans, np.int64):
        for k in range(first, first + count - 1):
            if good[k] and good[k + 1]:
                yield k, snapped[k].tolist(), snapped[k + 1].tolist()
            elif (part := clip_segment(clip[k], clip[k + 1], half[k:k + 2])) is not None:
                yield k, *snap_ends(*part).tolist()


def snapped_triangles(view, positions, triangles, dtype=np.float32):
    """Yield (BODY | triangle, three snapped corners) of every triangle, several where one is clipped."""
    clip = project(view, positions, dtype)
    for t, corners in enumerate(np.asarray(triangles, np.int64)[:, :3]):
        whole = within(clip[corners]).all()
        polygons = [list(clip[corners]) if whole else clip_polygon(list(clip[corners]))]
        if view["scale"][2] > 0 and not whole:   # a light's: what lies before its near plane is seen there
            polygons.append(clip_polygon(list(clip[corners]), lambda c: before_near(c, view["scale"][2])))
        for polygon in polygons:
            if len(polygon) < 3:
                continue
            snapped = snap_ends(np.stack(polygon), np.zeros(len(polygon), dtype)).tolist()
            for j in range(1, len(polygon) - 1):
                yield BODY | t, (snapped[0], snapped[j], snapped[j + 1])


# --- integers: what is covered --------------------------------------------------------------------------


def divide(n, d):
    """Quotient of Python ints rounded towards zero, as in C."""
    return abs(n) // abs(d) * (1 if (n < 0) == (d < 0) else -1)


def offsets(samples):
    """Sample positions from a pixel's centre in sub-pixels: two int64 arrays [samples]."""
    return np.array(PATTERNS[samples], np.int64).T * (SUBPIXEL // 16)


def pixels(low, high, count):
    """Numbers of the pixels, of `count`, that could have a sample between two places in sub-pixels."""
    return np.arange(min(max(low // SUBPIXEL - 1, 0), count), max(min(high // SUBPIXEL + 2, count), 0))


def half_across(half, a, b, samples):
    """Half a width along the shorter axis, which is more on a slant, in sub-pixels / 2^FRACTION.

    In float32: width / cos(angle) = width * sqrt(1 + slope²).
    """
    du, dv = sorted((abs(b[0] - a[0]), abs(b[1] - a[1])), reverse=True)
    slope = np.float32(dv) / np.float32(du)
    return int(np.float32(half) * np.sqrt(np.float32(1) + slope * slope) * np.float32(256)) << (FRACTION - 8)


def cover_segment(a, b, width, height, samples):
    """Samples within half a width of a snapped line, half-open both ways -> (flat numbers [n], depths [n]).

    Along the longer axis (x if equal) a sample must lie in [u0, u1), across it in [v - half, v + half).
    Half is at least that of a sample's share of a pixel.
    Place, half a width and depth along the line are those at u0 plus a slope, cut to FRACTION bits, times the
    distance from u0.
    """
    steep = abs(b[0] - a[0]) < abs(b[1] - a[1])
    along = 1 if steep else 0
    if a[along] > b[along]:
        a, b = b, a
    u0, v0, u1, v1 = a[along], a[1 - along], b[along], b[1 - along]
    if u0 == u1:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    half_a, half_b = half_across(a[3], a, b, samples), half_across(b[3], a, b, samples)
    half_slope = divide(half_b - half_a, u1 - u0)
    v_slope = divide((v1 - v0) << FRACTION, u1 - u0)
    d_slope = divide((b[2] - a[2]) << FRACTION, u1 - u0)

    offset = offsets(samples)
    u = pixels(u0, u1, (width, height)[along])
    most = max(half_a >> FRACTION, half_b >> FRACTION, SUBPIXEL // 2)
    v = pixels(min(v0, v1) - most, max(v0, v1) + most, (width, height)[1 - along])
    su = u[:, None] * SUBPIXEL + SUBPIXEL // 2 + offset[along]           # [U, samples]
    sv = v[:, None] * SUBPIXEL + SUBPIXEL // 2 + offset[1 - along]       # [V, samples]
    on = (u0 <= su) & (su < u1)
    way = np.where(on, su - u0, 0)         # all below fits 63 bits: a slope times its way is at most the rise
    center = (v0 << FRACTION) + v_slope * way
    half = np.maximum(half_a + half_slope * way, SUBPIXEL // 2 // samples << FRACTION)
    above = (sv[None] << FRACTION) >= (center - half)[:, None]
    below = (sv[None] << FRACTION) < (center + half)[:, None]
    i, j, s = np.nonzero(on[:, None] & above & below)
    x, y = (v[j], u[i]) if steep else (u[i], v[j])
    depth = ((a[2] << FRACTION) + d_slope * way[i, s]) >> FRACTION
    return (y * width + x) * samples + s, depth


def cover_triangle(a, b, c, width, height, samples):
    """Samples inside a snapped triangle -> (flat numbers [n], depths [n]); both sides are drawn.

    A sample on an edge counts as if it lay a little to the right and, much less, further down: so it is in
    one of the two triangles there.  Depth is that of corner a plus slopes, cut to 14 bits, times the distance
    from it.
    """
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    corners = (a, b, c) if area > 0 else (a, c, b)
    xs, ys, ds = zip(a[:3], b[:3], c[:3])
    offset = offsets(samples)
    x, y = pixels(min(xs), max(xs), width), pixels(min(ys), max(ys), height)
    sx = x[:, None] * SUBPIXEL + SUBPIXEL // 2 + offset[0]               # [X, samples]
    sy = y[:, None] * SUBPIXEL + SUBPIXEL // 2 + offset[1]               # [Y, samples]
    inside = np.ones((len(y), len(x), samples), bool)
    for p, q in zip(corners, corners[1:] + corners[:1]):
        dx, dy = q[0] - p[0], q[1] - p[1]
        e = dx * (sy - p[1])[:, None] - dy * (sx - p[0])[None]
        inside &= (e > 0) | ((e == 0) & (dy < 0 or (dy == 0 and dx > 0)))
    j, i, s = np.nonzero(inside)
    db, dc = b[2] - a[2], c[2] - a[2]
    slope_x = divide((db * (c[1] - a[1]) - dc * (b[1] - a[1])) << 14, area)
    slope_y = divide((dc * (b[0] - a[0]) - db * (c[0] - a[0])) << 14, area)
    # Slopes of a sliver are beyond 64 bits, so these are Python's integers.
    right, down = (sx[i, s] - a[0]).astype(object), (sy[j, s] - a[1]).astype(object)
    depth = a[2] + (right * slope_x + down * slope_y >> 14) if len(i) else np.zeros(0)
    depth = np.clip(depth, min(ds), max(ds)).astype(np.int64)
    return (y[j] * width + x[i]) * samples + s, depth
