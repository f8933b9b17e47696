"""What cl/coverage.cl means, in float64: polygons cut out of ribbons, layers of one pixel hidden behind each other, and
where on its segment each piece is lit."""

import math

import numpy as np

from .vectors import dot, f64

DEPTH_ONE = 1 << 30        # fixed-point depth at infinity; 0 is the near plane
GUARD = 32768              # pixels from the origin at which ribbons are clipped
NONE = (1 << 64) - 1       # a sample that nothing covers
BESIDE = 8                 # strands of a pixel whose pieces are known to lie beside each other
STEPS = 21845              # of a lean in half a width
WIDE = 0.5                 # half a width [pixels] up to which ends are cut along the shorter axis
LEAST = 1 / 256            # share of light at which no more strands are looked at


# --- what a strand covers -------------------------------------------------------------------------------


def fragments(view, points, spans):
    """Yield the ribbons' pieces in pixels: (y, x, depth in steps, id, share of the pixel's area).

    view: a `View` struct. points [P, 4] x, y, z, width; spans [strands, 2] first point, points.
    """
    wide = leans(view, points, spans)
    for number, a, b in segments(view, points, spans):
        steep = abs(b[0] - a[0]) < abs(b[1] - a[1])
        drawn = outline(a, b, steep, view, *wide[number]) if number in wide else ribbon(a, b, steep, view)
        for u, v, e, share in drawn:
            yield *((u, v) if steep else (v, u)), DEPTH_ONE * (1 - min(max(e, 0), 1)), number, share


def segments(view, points, spans):
    """Yield (id, end, end) of what can be seen of every segment; an end: x, y, reversed depth, half width [pixels]."""
    points = f64(points)
    clip = np.c_[points[:, :3], np.ones(len(points))] @ f64(view["to_screen"])
    half = points[:, 3] / 2 * float(view["scale"][0])
    x, y, e, w = clip.T
    planes = np.stack([w - e, e, GUARD * w - x, GUARD * w + x, GUARD * w - y, GUARD * w + y], 1)
    for first, count in np.asarray(spans, np.int64):
        for k in range(first, first + count - 1):
            begin, end = 0.0, 1.0          # shares of the way between which it lies inside all planes
            for p, q in zip(planes[k], planes[k + 1]):
                if p < 0 and q < 0:
                    end = -1.0
                elif p < 0:
                    begin = max(begin, p / (p - q))
                elif q < 0:
                    end = min(end, p / (p - q))
            if begin >= end:
                continue
            ends = []
            for t in (begin, end):
                c, h = clip[k] + t * (clip[k + 1] - clip[k]), half[k] + t * (half[k + 1] - half[k])
                ends.append((*(c[:3] / c[3]), min(h / c[3], GUARD)))
            yield k, *ends


def leans(view, points, spans):
    """{id: (lean, lean)} of the segments that are seen wider than a pixel and are not clipped: how far the upper corner
    at each end, of greater v, lies beyond it along u, in pixels.

    Places on the screen are complex numbers.  An end is cut square to its segment, at a bend by the bisector; of one
    that is 2 pixels wide or more, else by what lies between that and a cut along v.
    """
    points = f64(points)
    clip = np.c_[points[:, :3], np.ones(len(points))] @ f64(view["to_screen"])
    x, y, e, w = clip.T
    inside = (np.abs([x, y]).max(0) <= GUARD * w) & (e >= 0) & (e <= w) & (w > 0)
    safe = np.where(inside, w, 1)
    at, half = (x + 1j * y) / safe, np.minimum(points[:, 3] / 2 * float(view["scale"][0]) / safe, GUARD)
    found = {}
    for first, count in np.asarray(spans, np.int64):
        for k in range(first, first + count - 1):
            way = at[k + 1] - at[k]
            if not inside[k] or not inside[k + 1] or max(half[k], half[k + 1]) <= WIDE or way == 0:
                continue
            length, way = abs(way), way / abs(way)
            axis = 1j * np.sign(way.imag) if abs(way.real) < abs(way.imag) else np.sign(way.real)
            its = []
            for end, other, sign in (k, k - 1, -1), (k + 1, k + 2, 1):
                r, there = half[end], first <= other < first + count
                beyond = way
                if there and at[other] != at[end]:
                    beyond = sign * (at[other] - at[end]) / abs(at[other] - at[end])
                if there and not inside[other]:
                    its.append(0.0)
                    continue
                straight, turned = (_tangent((axis + min(max(r / WIDE - 1, 0), 1) * (middle - axis)) / way)
                                    for middle in (way, (way + beyond) / abs(way + beyond)))
                room = length / 2 / max(r, 1e-30)
                corner = r * way * (1j - np.clip(turned, straight - room, straight + room))
                u, v = (corner.imag, corner.real) if abs(axis.imag) else (corner.real, corner.imag)
                its.append(u if v > 0 else -u)
            most = length * max(abs(way.real), abs(way.imag)) / 2
            mean, apart = sum(its) / 2, np.clip((its[0] - its[1]) / 2, -most, most)
            step = max(half[k], half[k + 1]) / STEPS
            its = [round(lean / step) * step for lean in (mean + apart, mean - apart)]
            if any(its):
                found[int(k)] = its
    return found


def _tangent(turn):
    return np.sign(turn.imag) if turn.real <= abs(turn.imag) else turn.imag / turn.real


def drawn(view):
    """Columns and rows that a view draws: (first, one past the last) of each."""
    (top, bottom, left, _), width = (int(n) for n in view["rows"]), int(view["size"][0])
    return (left, left + width), (top, bottom)


def outline(a, b, steep, view, lean_a, lean_b):
    """As `ribbon`, of a segment whose ends lean: what is within its four corners."""
    if steep:
        a, b = ((y, x, e, h) for x, y, e, h in (a, b))
    ((u0, v0, e0, h0), lean0), ((u1, v1, e1, h1), lean1) = sorted(((a, lean_a), (b, lean_b)), key=lambda end: end[0][0])
    columns, rows = drawn(view)
    us, vs = (rows, columns) if steep else (columns, rows)
    slope = (v1 - v0) / (u1 - u0)
    tilt = math.hypot(1, slope)
    corners = [(u + sign * lean, v + sign * (slope * lean + tilt * h)) for u, v, h, lean, sign in (
        (u0, v0, h0, lean0, 1), (u1, v1, h1, lean1, 1), (u1, v1, h1, lean1, -1), (u0, v0, h0, lean0, -1))]
    left, right = (pick(u for u, _ in corners) for pick in (min, max))
    for u in range(max(math.floor(left), us[0]), min(math.floor(right) + 1, us[1])):
        column = cut(corners, 0, u)
        if not column:
            continue
        t = (sum(min(max(each, u0), u1) for each in (u, u + 1)) / 2 - u0) / (u1 - u0)
        bottom, top = (pick(v for _, v in column) for pick in (min, max))
        for v in range(max(math.floor(bottom), vs[0]), min(math.floor(top) + 1, vs[1])):
            if share := area_within(column, v):
                yield u, v, e0 + t * (e1 - e0), share


def ribbon(a, b, steep, view):
    """Yield (u, v, reversed depth, share) of the pixels that a ribbon covers, u along its longer axis.

    Its ends, and each column's, are cut along the shorter axis.  Within a column it has one width and one depth, those
    of the middle of what it has there.
    """
    if steep:
        a, b = ((y, x, e, h) for x, y, e, h in (a, b))
    (u0, v0, e0, h0), (u1, v1, e1, h1) = sorted((a, b), key=lambda end: end[0])
    columns, rows = drawn(view)
    us, vs = (rows, columns) if steep else (columns, rows)
    if u0 == u1:
        return
    slope = (v1 - v0) / (u1 - u0)
    for u in range(max(math.floor(u0), us[0]), min(math.floor(u1) + 1, us[1])):
        left, right = max(u0, u), min(u1, u + 1)
        t = ((left + right) / 2 - u0) / (u1 - u0)
        half = (h0 + t * (h1 - h0)) * math.sqrt(1 + slope * slope)
        low, high = v0 + slope * (left - u0), v0 + slope * (right - u0)
        corners = [(left, low - half), (right, high - half), (right, high + half), (left, low + half)]
        bottom, top = min(low, high) - half, max(low, high) + half
        for v in range(max(math.floor(bottom), vs[0]), min(math.floor(top) + 1, vs[1])):
            if share := area_within(corners, v):
                yield u, v, e0 + t * (e1 - e0), share


def area_within(corners, v):
    """Area of a polygon between v and v + 1 along its second axis."""
    corners = cut(corners, 1, v)
    x0, y0 = corners[0] if corners else (0, 0)      # from a corner: what is far from the origin cancels
    return abs(sum((p[0] - x0) * (q[1] - y0) - (q[0] - x0) * (p[1] - y0)
                   for p, q in zip(corners, corners[1:] + corners[:1]))) / 2


def cut(corners, axis, first):
    """A polygon between `first` and first + 1 along an axis (Sutherland and Hodgman 1974)."""
    for sign, edge in (1, first), (-1, first + 1):
        kept = []
        for p, q in zip(corners, corners[1:] + corners[:1]):
            by_p, by_q = sign * (p[axis] - edge), sign * (q[axis] - edge)
            if by_p >= 0:
                kept.append(p)
            if (by_p < 0) != (by_q < 0):
                other = p[1 - axis] + (q[1 - axis] - p[1 - axis]) * by_p / (by_p - by_q)
                kept.append((edge, other) if axis == 0 else (other, edge))
        corners = kept
    return corners


# --- one behind the other -------------------------------------------------------------------------------


def resolve(pieces, visible, shell_front=None, shell_transmittance=None):
    """Hide what is in one pixel behind each other -> {name: value}.

    pieces: {depth << 32 | id: share of area} of strands.  visible: [samples] the body's keys.  shell_front,
    shell_transmittance: [samples] keys of shells, and the share of light that these let through.  Strands hide all
    samples alike, since nobody knows where in the pixel they are; body and shells hide their own alone.

    weights: {key: share of the pixel's light} of strands.  body_transmittance: [samples] share of the body's light that
    strands and shells let through.  strand_transmittance: share of the shells' light that strands do.  alpha.  body,
    shells: shares of the pixel's light.
    """
    samples = len(visible)
    layers = [(key >> 32, 2, key, area) for key, area in pieces.items()]
    for s in range(samples):
        body, shell = (int(keys[s]) >> 32 for keys in (visible, visible if shell_front is None else shell_front))
        if shell_front is not None and shell_transmittance[s] < 1:
            layers.append((min(body, shell), 0, s, float(shell_transmittance[s])))
        if int(visible[s]) != NONE:
            layers.append((body, 1, s, 0.0))

    kept, shares = 1.0, np.full(samples, 1 / samples)      # what strands and what body and shells have left
    passed = np.ones(samples) if shell_front is None else f64(shell_transmittance)
    body_transmittance = passed.copy()
    weights, beside, oldest, of = {}, [], 0, [0.0, 0.0]
    for _, kind, what, value in sorted(layers):
        room = shares.sum()
        if kind < 2:
            of[kind] += shares[what] * (1 - value) * kept
            if kind == 1:
                body_transmittance[what] = samples * shares[what] * kept
            shares[what] *= value
        elif kept * room > LEAST:
            # Pieces of one strand lie beside each other, and follow each other in number.
            number = what & 0xFFFFFFFF
            strand = next((each for each in beside if each[0] - 1 <= number <= each[1] + 1), None)
            if strand is None:
                strand = [number, number, 0.0]
                if len(beside) < BESIDE:
                    beside.append(strand)
                else:
                    beside[oldest], oldest = strand, (oldest + 1) % BESIDE
            before, after = strand[2], min(strand[2] + value, 1)
            strand[:] = min(strand[0], number), max(strand[1], number), after
            left = kept * (1 - after) / (1 - before) if before < 1 else kept
            if left * room <= LEAST:
                left = 0.0
            weights[what] = (kept - left) * room
            kept = left
    all_shells = (1 - passed).sum() / samples
    return {"weights": weights, "body_transmittance": body_transmittance,
            "strand_transmittance": of[0] / all_shells if all_shells > 0 else 1.0,
            "alpha": 1 - shares.sum() * kept, "shells": of[0], "body": of[1]}


def places(view, pieces, points, width):
    """Where on their segments the places are that are nearest to the pixels' middles at pieces' depths -> [n] 0..1.

    pieces: arrays "pixel", in rows of so many, "id" and "depth" in steps.  points: [P, 4].
    """
    points, k = f64(points)[:, :3], pieces["id"]
    y, x = np.divmod(pieces["pixel"], width)
    e = np.maximum(1 - pieces["depth"] / DEPTH_ONE, 0.5 / DEPTH_ONE)
    q = np.linalg.solve(f64(view["to_screen"]).T, [x + 0.5, y + 0.5, e, np.ones(len(e))])
    way = points[k + 1] - points[k]
    square, along = dot(way, way), dot(way, (q[:3] / q[3]).T - points[k])
    return np.clip(np.where(square > 0, along / np.where(square > 0, square, 1), 0), 0, 1)
