"""strands in float64 NumPy: roots, growth (the report's section 2.1.3), tangents of strands brought along."""

import math

import numpy as np


def random3(strand, seed, use):
    """Three random words for each strand number [N]: uint32 [N, 3]; pcg3d of Jarzynski and Olano (2020)."""
    x, y, z = (np.broadcast_to(np.asarray(v, np.uint32), np.shape(strand)) * np.uint32(1664525)
               + np.uint32(1013904223) for v in (strand, seed, use))
    for last in (False, True):
        x = x + y * z
        y = y + z * x
        z = z + x * y
        if not last:
            x, y, z = (v ^ (v >> np.uint32(16)) for v in (x, y, z))
    return np.stack([x, y, z], -1)


def signed(words):
    """Random words -> numbers in [-1, 1) from their top 24 bits."""
    return (words >> np.uint32(8)) / 2.0**23 - 1


def unit_or(v, otherwise):
    """Vectors [..., 3] at length one; `otherwise` where they are below 1e-15 and so have no direction."""
    square = (v * v).sum(-1, keepdims=True)
    return np.where(square > 1e-30, v / np.sqrt(np.where(square > 1e-30, square, 1)), otherwise)


# --- roots ----------------------------------------------------------------------------------------------


def twice_areas(positions, triangles):
    """Cross product [T, 3] of two sides of each triangle [T, 3]: its length is twice the area."""
    a, b, c = (np.asarray(positions, float)[triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def roots_at(positions, normals, uv, triangles, weights):
    """Root [N, 3], frame of the skin [N, 3, 3], uv [N, 2] at barycentric weights [N, 3] of triangles [N, 3].

    The rows of a frame are unit: a side of the triangle as seen along the normal, what is across both, the normal.
    """
    root, normal, at = (np.einsum("nc,ncx->nx", weights, np.asarray(a, float)[triangles])
                        for a in (positions, normals, uv))
    up = unit_or(normal, unit_or(twice_areas(positions, triangles), (0, 1, 0)))
    return root, frames(np.asarray(positions, float)[triangles], up), at


def frames(corners, up):
    """Frames of the skin [N, 3, 3] on triangles [N, 3, 3] with unit normals [N, 3].

    The first side counts, or the second where it is ten times as long, both without their part along the normal;
    where neither has a length, the world's x or, for normals near that, y.
    """
    axis = np.where(np.abs(up[:, :1]) < 0.6, (1, 0, 0), (0, 1, 0))
    sides = np.diff(corners, axis=1)
    across = np.cross(np.cross(up[:, None], sides), up[:, None])   # [N, first and second, 3]
    square = (across**2).sum(2)
    chosen = np.where((square[:, 0] > 0.01 * square[:, 1])[:, None], across[:, 0], across[:, 1])
    edge = unit_or(chosen, unit_or(np.cross(up, axis), axis))
    return np.stack([edge, np.cross(up, edge), up], 1)


def roots_on_faces(positions, normals, uv, triangles):
    """One root in the middle of every triangle, with the mean of its normals; the report's section 2.1.3."""
    return roots_at(positions, normals, uv, triangles, np.full((len(triangles), 3), 1 / 3))


def roots_by_area(
    positions,   # [V, 3]
    normals,     # [V, 3]
    uv,          # [V, 2]
    triangles,   # [T, 3]
    running,     # [T] area of triangles 0..t, whole numbers
    count,       # strands
    seed,
):
    """Root i at a random place of the i-th of `count` equal parts of the area: `roots_at`, its triangle."""
    total = int(running[-1])
    words = random3(np.arange(count), seed, 0)
    # In whole numbers without bounds: the part's start, and a random way into it.
    place = [total * i // count + total // count * int(word) // 2**32 for i, word in enumerate(words[:, 0])]
    chosen = np.searchsorted(running, np.array(place, np.uint64), side="right").clip(0, len(triangles) - 1)
    # A point of the unit square; the half beyond the diagonal is turned by half a turn onto the triangle.
    square = (words[:, 1:] >> np.uint32(8)) / 2.0**24
    beyond = square.sum(1) > 1
    square[beyond] = 1 - square[beyond]
    weights = np.column_stack([1 - square.sum(1), square])
    return *roots_at(positions, normals, uv, triangles[chosen], weights), chosen


# --- growth ---------------------------------------------------------------------------------------------


def grow(
    root,                  # [N, 3]
    frame,                 # [N, 3, 3] of the skin, see `frames`
    uv,                    # [N, 2]
    types,                 # objects with the fields of HairType
    type_indices=None,     # [h, w] index into types, {number: that} of tiles, or None: all are types[0]
    force=(0, 0, 0),
    point_forces=(),       # objects with position and strength
    seed=0,
    traits=None,           # [N] what maps make of the strands, as layout.Traits has it
    substeps=None,         # a segment where they grow by the law, or as many as the device takes
    middle=None,           # [N, 2] uv of the middle of each root's triangle, which chooses tiles of pictures; None: uv
):
    """Grow every strand: (points [N, S, 3], tangents [N, S, 3], counts [N], colors [N, 3], kind [N]).

    S is the largest number of points; where a strand has fewer, the rest is NaN.  Where a type has a colour of its own
    at root or tip, colors are of points, [N, S, 3].
    """
    middle = uv if middle is None else middle
    kind = nearest(np.zeros((1, 1)) if type_indices is None else type_indices, uv, middle, 0).astype(int)
    segments = np.array([t.segments for t in types])
    points = np.full((len(root), segments.max() + 1, 3), math.nan)
    shaded = any(t.root_color is not None or t.tip_color is not None for t in types)
    tangents, colors = points.copy(), points.copy() if shaded else points[:, 0].copy()
    for k, t in enumerate(types):
        mine = np.flatnonzero(kind == k)
        vary = signed(random3(mine, seed, 1))
        tint = 1 if t.color_texture is None else between(t.color_texture, uv[mine], middle[mine], 1.0)
        varied = tint * (1 + t.color_variation * vary[:, :1])
        if shaded:
            colors[mine, :t.segments + 1] = colors_along(t) * np.broadcast_to(varied, (len(mine), 3))[:, None]
        else:
            colors[mine] = t.color * varied
        if t.segments and len(mine):
            line, ahead = lines(root[mine], frame[mine], mine, t, force, point_forces, seed,
                                None if traits is None else traits[mine], substeps)
            points[mine, :t.segments + 1] = line
            tangents[mine, :t.segments + 1] = tangents_of(line, ahead)
    there = segments[kind] > 0 if traits is None else (segments[kind] > 0) & (traits["scale"][:, 0] > 0)
    points[~there] = tangents[~there] = math.nan
    return points, tangents, np.where(there, segments[kind] + 1, 0), colors, kind


def along(t):
    """Of the points of a type's strands: how far each is on the way to the tip, [segments + 1]."""
    return np.arange(t.segments + 1) / max(t.segments, 1)


def widths_along(t):
    """Widths [segments + 1] along a type's strands; between root and tip as Schlick's bias (1994) has it."""
    u = along(t)
    return t.width * (t.root_width + (t.tip_width - t.root_width) * u / ((1 / t.taper - 2) * (1 - u) + 1))


def colors_along(t):
    """Colours [segments + 1, 3] along a type's strands, before what varies and textures."""
    root, tip = (np.asarray(t.color if each is None else each, float) for each in (t.root_color, t.tip_color))
    return root + (tip - root) * along(t)[:, None]


def lines(root, frame, number, t, force, point_forces, seed, traits, substeps):
    """Strands of a type by their numbers [N]: (points [N, segments + 1, 3], the direction at their roots [N, 3])."""
    lean, turn = (np.einsum("na,nax->nx", signed(random3(number, seed, use)), frame) for use in (3, 2))
    up = first = frame[:, 2]
    longer = 1 + t.length_variation * signed(random3(number, seed, 1))[:, 1]
    softer = bent = np.ones(len(root))
    if traits is not None:
        comb, scale = traits["comb"].astype(float), traits["scale"].astype(float)
        first = up + comb[:, 3:] * (comb[:, :3] - up)
        longer, softer, bent = longer * scale[:, 0], 1 / np.maximum(scale[:, 2], 2.0**-10), scale[:, 3]
    first = unit_or(first + t.direction_variation * lean, up)
    side = unit_or(np.cross(first, turn), unit_or(np.cross(first, frame[:, 0]), frame[:, 2]))
    if t.stiffness is None:
        axis, ahead = axes(root, first, t.segments, t.segment_length * longer, t.force_weight * softer, force,
                           point_forces)
        across = sides_of(ahead, side)
    else:
        each = substeps or substeps_of(t, force, point_forces, traits is not None)
        step = longer / (t.segments * each)
        axis, ahead = bent_axes(root, first, t.segments * each, t.length * step, step * softer / t.stiffness, force,
                                point_forces)
        across = turned_sides(ahead, side)[:, each::each]   # of points, behind the root
        axis, ahead = axis[:, ::each], ahead[:, each::each]
    if t.tufts is not None:   # which curl as a whole
        return axis, first
    return axis + bent[:, None, None] * offsets(ahead, across, t.curl, t.wave), first


def pushes(points, force, point_forces):
    """What draws strands at points [N, 3]: the uniform force and, for each point force, strength · exp(-distance) away
    from it (none at the point itself)."""
    push = np.broadcast_to(np.asarray(force, float), points.shape)
    for f in point_forces:
        away = points - f.position
        distance = np.linalg.norm(away, axis=1, keepdims=True)
        push = push + f.strength * np.exp(-distance) * away / np.where(distance > 0, distance, 1)
    return push


def axes(root, direction, segments, length, weight, force, point_forces):
    """The report's loop: points [N, segments + 1, 3] and the direction of every segment [N, segments, 3].

    Each step goes `length` [N] ahead, then turns by `weight` [N] times the force there.
    """
    points, ahead = [root], [direction]
    for _ in range(segments):
        points.append(points[-1] + length[:, None] * ahead[-1])
        ahead.append(unit_or(ahead[-1] + weight[:, None] * pushes(points[-1], force, point_forces), ahead[-1]))
    return np.stack(points, 1), np.stack(ahead[:-1], 1)


def substeps_of(t, force, point_forces, is_varied):
    """Steps a segment by which the device follows the law: 8 (32) to 64 a strand, two for each radian of turn."""
    pull = np.linalg.norm(force) + sum(abs(f.strength) for f in point_forces)
    wanted = np.clip(2 * pull / t.stiffness, 32 if is_varied or len(point_forces) else 8, 64)
    return math.ceil(int(wanted) / t.segments)


def bent_axes(root, direction, steps, length, softness, force, point_forces):
    """The law: d direction / ds = part of the force across it / stiffness; points, directions [N, steps + 1, 3].

    In each step of `length` [N] the force in its middle holds: the angle to it, a, then obeys da/ds = -size · sin(a),
    so that tan(a / 2) falls exponentially: by `softness` [N] times the size, 4 at most each half.  Simpson's rule.
    """
    points, ahead = [root], [direction]
    for _ in range(steps):
        push = pushes(points[-1] + length[:, None] / 2 * ahead[-1], force, point_forces)
        size = np.linalg.norm(push, axis=1, keepdims=True)
        towards = push / np.where(size > 0, size, 1)
        cosine = (ahead[-1] * towards).sum(1, keepdims=True)
        across = ahead[-1] - cosine * towards
        sine = np.linalg.norm(across, axis=1, keepdims=True)
        across = across / np.where(sine > 0, sine, 1)
        half = np.arctan2(sine, cosine) / 2
        later = []
        for falls in 1, 2:
            shrink = np.exp(-falls * np.minimum(softness[:, None] * size / 2, 4))
            angle = 2 * np.arctan2(np.sin(half) * shrink, np.cos(half))
            later.append(np.where(size > 0, np.cos(angle) * towards + np.sin(angle) * across, ahead[-1]))
        points.append(points[-1] + length[:, None] / 6 * (ahead[-1] + 4 * later[0] + later[1]))
        ahead.append(later[1])
    return np.stack(points, 1), np.stack(ahead, 1)


def sides_of(ahead, side):
    """Vectors across the directions [N, segments, 3] of segments, each taken over from the one before: without its part
    along the segment."""
    sides = [side]
    for k in range(1, ahead.shape[1]):
        sides.append(unit_or(sides[-1] - (sides[-1] * ahead[:, k]).sum(1, keepdims=True) * ahead[:, k], sides[-1]))
    return np.stack(sides, 1)


def turned_sides(ahead, side):
    """The same of directions [N, points, 3] by the least rotation from each to the next, about what is across both."""
    sides = [side]
    for before, after in zip(ahead[:, :-1].swapaxes(0, 1), ahead[:, 1:].swapaxes(0, 1)):
        axis = np.cross(before, after)
        sine, cosine = np.linalg.norm(axis, axis=1, keepdims=True), (before * after).sum(1, keepdims=True)
        axis = axis / np.where(sine > 0, sine, 1)
        v = sides[-1]
        sides.append(v * cosine + np.cross(axis, v) * sine + axis * (axis * v).sum(1, keepdims=True) * (1 - cosine))
    return np.stack(sides, 1)


def offsets(ahead, sides, curl, wave):
    """How curl and wave move the points off their axis: [N, segments + 1, 3]; the root stays.

    A circle of the curl's radius about a line beside the axis, plus a sine across it, in a frame of directions and what
    is across them [N, segments, 3] at each point behind the root.
    """
    n, segments, _ = ahead.shape
    result = np.zeros((n, segments + 1, 3))
    for k in range(segments):
        phi, psi = (2 * math.pi * number * (k + 1) / segments for _, number in (curl, wave))
        result[:, k + 1] = ((curl[0] * (math.cos(phi) - 1) + wave[0] * math.sin(psi)) * sides[:, k]
                            + curl[0] * math.sin(phi) * np.cross(ahead[:, k], sides[:, k]))
    return result


def tangents_of(points, start):
    """Unit tangents of polylines [N, P, 3]: the chord between a point's neighbours, one-sided at the ends.

    Where the chord has no length the tangent before it holds on; `start` [N, 3] comes before the first.
    """
    n = points.shape[1]
    result = np.empty_like(points)
    last = start
    for k in range(n):
        last = unit_or(points[:, min(k + 1, n - 1)] - points[:, max(k - 1, 0)], last)
        result[:, k] = last
    return result


def tangents_at(points, spans, k):
    """Unit tangents [N, 3] at the start and at the end of segments k [N] of polylines: as `tangents_of` has them, but
    where a chord has no length it is the segment's own direction.

    points: [P, 3].  spans: [N, 2] first point, points of the strand of each.
    """
    points, (first, count) = np.asarray(points, float), np.asarray(spans, np.int64).T
    along = points[k + 1] - points[k]
    chords = (points[k + 1] - points[np.maximum(k - 1, first)],
              points[np.minimum(k + 2, first + count - 1)] - points[k])
    return tuple(unit_or(chord, unit_or(along, (0, 1, 0))) for chord in chords)


# --- pictures -------------------------------------------------------------------------------------------


def between(pictures, uv, middle, none):
    """What pictures have at uv [N, 2] between the four nearest texel centres: [N] or [N, n].

    pictures: {number of a UDIM tile: [h, w] or [h, w, n]}, of which that counts in which middle [N, 2] lies, `none`
    where there is none; or one picture, or {0: it}, which repeats.
    """
    return _looked_up(pictures, uv, middle, none, _bilinear)


def nearest(pictures, uv, middle, none):
    """As `between`, but what the nearest texel has."""
    return _looked_up(pictures, uv, middle, none, _nearest)


def _looked_up(pictures, uv, middle, none, look):
    pictures = pictures if isinstance(pictures, dict) else {0: pictures}
    found = np.full((len(uv), *next(iter(pictures.values())).shape[2:]), none)
    column, row = np.floor(middle).T
    tile = np.where((column >= 0) & (column < 10) & (row >= 0), 1001 + column + 10 * row, -1)
    for number, picture in pictures.items():
        mine = np.flatnonzero(tile == number) if number else np.arange(len(uv))
        inside = uv[mine] - np.floor(middle[mine]) if number else uv[mine] % 1
        found[mine] = look(picture, np.clip(inside, 0, 1), (lambda i, n: i.clip(0, n - 1)) if number else np.mod)
    return found


def _bilinear(picture, uv, wrapped):
    height, width = picture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (each.reshape(-1, *[1] * (picture.ndim - 2)) for each in (x - column, y - row))
    left, right = wrapped(column, width), wrapped(column + 1, width)
    upper, lower = ((1 - fx) * picture[wrapped(r, height), left] + fx * picture[wrapped(r, height), right]
                    for r in (row, row + 1))
    return (1 - fy) * upper + fy * lower


def _nearest(picture, uv, _):
    height, width = picture.shape[:2]
    row = np.floor((1 - uv[:, 1]) * height).astype(int)
    return picture[row.clip(0, height - 1), np.floor(uv[:, 0] * width).astype(int).clip(0, width - 1)]


# --- strands that the user brings -----------------------------------------------------------------------


def unpack_curves(
    points,   # [P, 3]
    counts,   # [strands] points of each
    width,    # [1], [strands] or [P]
):
    """Tangents [P, 3], width of every point [P] and its strand [P]; a tangent without a direction is +Y."""
    counts, width = np.asarray(counts), np.asarray(width)
    strand_of = np.repeat(np.arange(len(counts)), counts)
    tangents = np.empty((len(points), 3))
    for count in set(counts[counts > 0].tolist()):
        rows = (np.cumsum(counts) - counts)[counts == count, None] + np.arange(count)
        tangents[rows] = tangents_of(np.asarray(points, float)[rows], np.array([(0.0, 1.0, 0.0)]))
    if len(width) == len(points):
        return tangents, width, strand_of
    return tangents, width[strand_of] if len(width) > 1 else np.full(len(points), width[0]), strand_of
