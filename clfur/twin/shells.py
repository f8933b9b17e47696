"""What cl/shells.cl and cl/pattern.h mean, in float64: how hairs are bent, what pattern they stand in, and what that
puts into the light's grid."""

import numpy as np

from .vectors import dot, f64, unit

SUBPIXEL = 256
HEIGHTS = 64
CELL_RADIUS = 0.62


# --- the stages -----------------------------------------------------------------------------------------


def bend(shells, positions, normals, lean=0):
    """How hairs are bent at vertices [V, 3] -> places at heights 0, 1/slabs .. 1, [V, slabs + 1, 3]; lean: [V, 3]."""
    slabs, length = int(shells["kind"][2]), float(shells["size"][0])
    positions, normals, gust = f64(positions), f64(normals), f64(shells["gust"])
    turn = np.mod(gust[3] - positions @ gust[:3], 1)
    wave = np.where(turn < 0.5, 16 * turn * (0.5 - turn), -16 * (turn - 0.5) * (1 - turn))
    force = f64(shells["bend"])[:3] + (0.7 + 0.3 * wave)[:, None] * f64(shells["wind"])[:3] + lean
    middles = (np.arange(slabs) + 0.5) / slabs
    steps = unit(normals[:, None] + middles[:, None] * force[:, None]) * length / slabs
    return np.concatenate([positions[:, None], positions[:, None] + np.cumsum(steps, 1)], 1)


def lattice(shells, positions, normals, faces, uv, rest):
    """Places of the corners of faces [F, 3] in the pattern -> [F, 8, 4].

    uv: [F, 3, 2] of these corners.  rest: [F, 3, 4], places in rest, and which corner of the cells each is.
    x0 y0 x1 y1; x2 y2, cells along a side, mean growth of x and y in the world; gradients of x, of y
    and of the height; the most that x and y together can grow; of cells the noise's place where x and y are 0, and
    how it grows with x and with y.
    """
    f = float(shells["size"][2])
    a, b, c = np.moveaxis(f64(positions)[faces], 1, 0)
    if shells["kind"][0]:
        at, sides = f64(uv) * (2 * f, f), np.zeros(len(faces))
    else:
        p, corner = f64(rest)[..., :3], np.asarray(rest)[..., 3].astype(int)
        whole = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1) / 2
        sides = np.clip(np.floor(f * np.sqrt(whole) + 0.50001), 1, 4096)
        at = sides[:, None, None] * np.array([(0, 0), (1, 0), (0.5, np.sqrt(0.75))])[corner]
    # The gradient lies in the face and gives the corners' differences: a least-squares inverse of two sides.
    inverse = np.linalg.pinv(np.stack([b - a, c - a], 1))
    grad = np.swapaxes(inverse @ (at[:, 1:] - at[:, :1]), 1, 2)
    up = np.cross(b - a, c - a)
    up *= np.where(dot(up, f64(normals)[faces[:, 0]]) < 0, -1, 1)[:, None]
    flat = dot(up, up) <= 1e-20 * dot(b - a, b - a) * dot(c - a, c - a)   # no area: nothing changes along it
    grad[flat], up[flat] = 0, f64(normals)[faces[flat, 0]]
    result = np.zeros((len(faces), 8, 4))
    result[:, 0], result[:, 1, :2], result[:, 1, 2] = at[:, :2].reshape(-1, 4), at[:, 2], sides
    result[:, 1, 3] = np.sqrt(np.linalg.norm(grad, axis=2).prod(1))
    result[:, 2:4, :3], result[:, 4, :3] = grad, unit(up) / float(shells["size"][0])
    result[:, 4, 3] = np.sqrt((grad**2).sum((1, 2)))
    if not shells["kind"][0]:
        # Linear on the face: from (1, x, y) of its corners to their places.
        ones = np.concatenate([np.ones((len(faces), 3, 1)), at], 2)
        result[:, 5:, :3] = np.linalg.solve(ones, p @ f64(shells["to_noise"])[:, :3])
    return result


def noise(shells):
    """Perlin's improved noise (2002), two values at places 1/4 apart -> [4 nz (1 if nz is 1), 4 ny, 4 nx, 2]."""
    n = [int(k) for k in shells["noise"][:3]]
    places = [np.arange(4 * k) for k in n[:2]] + [np.arange(1 if n[2] == 1 else 4 * n[2])]
    z, y, x = np.meshgrid(*places[::-1], indexing="ij")
    place = np.stack([x, y, z], -1)
    cell, t = place // 4, place % 4 / 4
    fade = t**3 * (t * (t * 6 - 15) + 10)
    result = np.zeros((*x.shape, 2))
    for d in np.ndindex(2, 2, 2):
        at = ((cell + d) % n).astype(np.uint32)
        key = at[..., 0] * u32(0x9E3779B1) ^ at[..., 1] * u32(0x85EBCA77) ^ at[..., 2] * u32(0xC2B2AE3D) ^ seed(shells)
        weight = np.where(d, fade, 1 - fade).prod(-1)
        fx, fy, fz = np.moveaxis(t - d, -1, 0)
        edges = np.stack([i * a + j * b for a, b in ((fy, fz), (fx, fz), (fx, fy)) for j in (1, -1) for i in (1, -1)])
        for k, salt in enumerate((0, 0x68E31DA4)):
            edge = (mixed(key + u32(salt)) % u32(12)).astype(int)
            result[..., k] += weight * np.take_along_axis(edges, edge[None], 0)[0]
    return result


def means(shells, around):
    """What many hairs are on average at HEIGHTS heights -> [HEIGHTS, 2]: share covered, entries going sideways by 1."""
    sine = shells["kind"][0]
    step = 1 / around if sine else 0.125
    u, v = np.meshgrid((np.arange(-1, around) + 0.5) * step, (np.arange(around) + 0.5) * step)
    away = 0 if sine else 1e3
    h = np.arange(HEIGHTS)[:, None, None] / (HEIGHTS - 1)
    ways = []
    for x, y in ((u, v), (v, u)):
        at = np.stack([x.ravel(), y.ravel()], 1) + away
        high = waves(shells, at)[0] if sine else cells(shells, 0, 1 << 30, at)[0]
        ways.append(cover(shells, high.reshape(u.shape), h))
    entered = sum(np.maximum(np.diff(way, axis=2), 0).sum((1, 2)) for way in ways)
    return np.stack([ways[0][:, :, 1:].mean((1, 2)), entered / (2 * around * around * step)], 1)


# --- the pattern ----------------------------------------------------------------------------------------


def noise_at(shells, table, p):
    """The noise [..., 2] at places [n, 3] in units of its lattice -> [n, 2]."""
    low = np.floor(4 * p).astype(np.int64)
    f = 4 * p - low
    nz, ny, nx = table.shape[:3]
    result = np.zeros((len(p), 2))
    for i, j, k in np.ndindex(2, 2, 2):
        weight = np.where((i, j, k), f, 1 - f).prod(1)
        result += weight[:, None] * table[(low[:, 2] + k) % nz, (low[:, 1] + j) % ny, (low[:, 0] + i) % nx]
    return result


def waves(shells, at):
    """Half of the report's |sin(2 pi x) + sin(2 pi y)| at places [n, 2], thinned -> (v [n], gradient, tip, fold)."""
    total, density = np.sin(2 * np.pi * at).sum(1), float(shells["shape"][1])
    grad = np.pi * np.cos(2 * np.pi * at) * np.where(total < 0, -1, 1)[:, None] / density
    return 1 - (1 - np.abs(total) / 2) / density, grad, np.ones(len(at)), np.full(len(at), 1 - 1 / density)


def cells(shells, face, sides, at, lean=0.0):
    """The highest cone at places [n, 2] among that of the triangle there and of its neighbours.

    -> (v [n], gradient [n, 2], height of that cone, of the fold between it and the next [n]).  lean: [n, 2] how far all
    cones are moved.
    """
    at = at - lean
    v = at[:, 1] / np.sqrt(0.75)
    u = at[:, 0] - v / 2
    i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    down = (u - i) + (v - j) > 1
    grad, tip = np.zeros((len(at), 2)), np.ones(len(at))
    best = second = np.full(len(at), -1.0)
    for di, dj, other in ((0, 0, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)):
        turned = down ^ bool(other)
        ci, cj = i + np.where(down, di, -di), j + np.where(down, dj, -dj)
        random = mixed(u32(ci) * u32(0x9E3779B1) ^ u32(cj) * u32(0x85EBCA77)
                       ^ (u32(2 * np.asarray(face)) + u32(turned)) * u32(0xC2B2AE3D) ^ seed(shells))
        one, two, three = ((random >> u32(10 * k) & u32(1023)) / 1024 for k in range(3))
        centre_u, centre_v = ci + (1 + turned) / 3, cj + (1 + turned) / 3
        off = at - np.stack([centre_u + centre_v / 2 + 0.3 * (one - 0.5),
                             np.sqrt(0.75) * centre_v + 0.3 * (two - 0.5)], 1)
        away = np.sqrt((off**2).sum(1) + 1e-12)
        tall = 1 - float(shells["size"][3]) * three
        thin = 1 / (CELL_RADIUS * float(shells["shape"][1]))
        high = tall * (1 - away * thin)
        inside = (ci >= 0) & (cj >= 0) & (ci + cj + turned < sides)
        better = inside & (high > best)
        second = np.where(better, best, np.where(inside, np.maximum(second, high), second))
        best = np.where(better, high, best)
        grad = np.where(better[:, None], -(tall * thin / away)[:, None] * off, grad)
        tip = np.where(better, tall, tip)
    return best, grad, tip, (best + second) / 2


def height_at(shells, table, face, lattice, at, h):
    """Height of the fur at places [n, 2] of faces [n], its gradient by x and y, its hair's tip, the fold.

    lattice: [n, 8, 4] of these faces.
    """
    sine, amount = shells["kind"][0], float(shells["shape"][2])
    if sine:
        place = np.concatenate([at / float(shells["shape"][3]), np.zeros((len(at), 1))], 1)
    else:
        place = lattice[:, 5, :3] + at[:, :1] * lattice[:, 6, :3] + at[:, 1:] * lattice[:, 7, :3]
    moved = amount * noise_at(shells, table, place)
    return waves(shells, at + moved) if sine else cells(shells, face, lattice[:, 1, 2], at, moved * h[:, None])


def cover(shells, v, h, g=0.0, top=1.0, fold=-1.0):
    """Share covered at height h where the fur is v high: smoothstep from h to sharpness · h, its mean over a footprint.

    Across it v goes from v - g/2 to v + g/2; where it would pass the hair's tip, or the fold before the next hair, it
    turns.
    """
    width = np.maximum((float(shells["shape"][0]) - 1) * h, 1e-3)

    def smooth(t):
        u = np.clip((t - h) / width, 0, 1)
        return u * u * (3 - 2 * u)

    def integral(t):
        u = np.clip((t - h) / width, 0, 1)
        return width * (u**3 - u**4 / 2) + np.maximum(t - h - width, 0)
    low, high = v - g / 2, v + g / 2
    middle = integral(np.minimum(high, top)) - integral(np.maximum(low, fold))
    beyond_tip = np.where(high > top, integral(top) - integral(2 * top - high), 0)
    beyond_fold = np.where(low < fold, integral(2 * fold - low) - integral(fold), 0)
    soft = g > 1e-2 * width
    return np.where(soft, np.clip((middle + beyond_tip + beyond_fold) / np.where(soft, g, 1), 0, 1), smooth(v))


# --- numbers --------------------------------------------------------------------------------------------


def u32(value):
    """Whole numbers modulo 2^32."""
    return (np.asarray(value).astype(np.int64) & 0xFFFFFFFF).astype(np.uint32)


def seed(shells):
    return u32(int(shells["kind"][1]))


def mixed(x):
    """A hash of numbers below 2^32."""
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39)):
        x = x ^ x >> u32(shift)
        x = x * u32(factor)
    return x ^ x >> u32(15)


# --- the light's grid: in the device's own order of float operations, so that whole numbers are equal ----------------

ROWS, STEPS, FAR = 16, 16, 4    # of a face's points a work-item; through the table; grids beyond which none is snapped


def deposit(shells, grid, faces, curves, lattice, means, parts, deep, binary, weight):
    """Shell fur -> cells [nz, ny, nx] int64.

    faces [F, 3], curves [V, slabs + 1, 4], lattice [F, 4, 4], means [64, 2]: as the kernel has them.
    parts: work-items a face; deep: a cell's depth; weight: what one crossing adds.
    """
    one, slabs = np.float32, int(shells["kind"][2])
    cells = np.zeros([int(n) for n in grid["size"][2::-1]], np.int64)
    # [F, slabs + 1, 3]
    corners = [np.asarray(curves, one)[np.asarray(faces, np.int64)[:, i], :, :3] for i in range(3)]
    m = grid["to_grid"]

    def distance(p):
        return ((m[0, 3] * p[..., 0] + m[1, 3] * p[..., 1]) + m[2, 3] * p[..., 2]) + m[3, 3]
    square = np.max([_dot(q - p, q - p).max(1) for p, q in zip(corners, corners[1:] + corners[:1])], 0)
    near, far = np.min([distance(p).min(1) for p in corners], 0), np.max([distance(p).max(1) for p in corners], 0)
    step = one(.75) * np.minimum(grid["face"][1] * np.maximum(near, grid["face"][2]), one(deep))
    most = one(parts * ROWS - 1)
    rows = np.minimum(np.sqrt(square) / step, most).astype(int) + 1
    heights = np.minimum(shells["size"][0] / (one(slabs) * step), most).astype(int) + 1
    for n, high in {*zip(rows.tolist(), heights.tolist())}:
        chosen = np.flatnonzero((rows == n) & (heights == high) & (far >= grid["face"][3]))
        if len(chosen):
            a, b, c = (p[chosen] for p in corners)
            _deposit(cells, grid, a, b, c, np.asarray(lattice, one)[chosen], np.asarray(means, one), slabs, n, high,
                     binary, weight)
    return cells


def _deposit(cells, grid, a, b, c, lattice, means, slabs, rows, heights, binary, weight):
    """Put faces into the cells that have as many rows and heights: all at once, point after point."""
    one = np.float32
    to_b, to_c = lattice[:, 0, 2:] - lattice[:, 0, :2], lattice[:, 1, :2] - lattice[:, 0, :2]
    steps = (STEPS - 1) // (slabs * heights) + 1
    each = one(weight) * one(.25) / (one(rows) * one(rows) * grid["face"][0])
    for first in range(0, rows, ROWS):
        left = np.full(len(a), .5, one)
        for level in range(slabs * heights):
            k, inside = level // heights, one(level % heights + .5) / one(heights)
            low, top = one(level) / one(slabs * heights), one(level + 1) / one(slabs * heights)
            newly = _mean(means, low)[0] - _mean(means, top)[0]
            entered = one(0)
            for i in range(steps):
                entered += _mean(means, low + one(i + .5) / one(slabs * heights * steps))[1]
            sideways = entered / one(heights * steps)
            up_a = a[:, k + 1] - a[:, k]
            up_b, up_c = (p[:, k + 1] - p[:, k] - up_a for p in (b, c))
            origin, ab = a[:, k] + inside * up_a, b[:, k] - a[:, k] + inside * up_b
            ac = c[:, k] - a[:, k] + inside * up_c
            for row in range(first, min(first + ROWS, rows)):
                for point in range(2 * row + 1):
                    third = one(1 + point % 2) / one(3)
                    wb = (one(point // 2) + third) / one(rows)
                    wc = (one(row - point // 2 - point % 2) + third) / one(rows)
                    p = origin + wb * ab + wc * ac
                    at, w, good = _snap(grid, p)
                    good &= (at[:, 2] >= 0) | (grid["size"][3] > 0)
                    w = np.maximum(w, grid["face"][3])
                    ray, up = grid["light"][:3] - grid["light"][3] * p, up_a + wb * up_b + wc * up_c
                    move = _dot(ray, _cross(ac, up))[:, None] * to_b + _dot(ray, _cross(up, ab))[:, None] * to_c
                    side = sideways * sideways * (move[:, 0] * move[:, 0] + move[:, 1] * move[:, 1])
                    n = _cross(ab, ac)
                    down = newly * _dot(ray, n) * np.where(_dot(up, n) < 0, one(-1), one(1))
                    both = down + np.maximum(np.abs(down), np.sqrt(one(4) * side + one(.5947153) * (down * down)))
                    exact = both * each / (w * w * w) + left
                    amount = np.minimum(exact, one(2**31)).astype(np.int64)
                    left = np.where(good, np.minimum(exact - amount.astype(one), one(1)), left)
                    if grid["size"][3]:   # what lies before the grid counts in its first layer
                        at[:, 2] = np.maximum(at[:, 2], 0)
                    _add(cells, at[good], amount[good], weight if binary else None)


def _add(cells, at, amount, marked):
    """Add amounts at sub-cells between the four columns around, or mark the cells that get anything."""
    x, y, z = at[:, 0], at[:, 1], at[:, 2] // SUBPIXEL
    if marked is not None:
        parts = [(x // SUBPIXEL, y // SUBPIXEL, np.where(amount > 0, marked, 0))]
    else:
        x, y = x - SUBPIXEL // 2, y - SUBPIXEL // 2
        right, behind = amount * (x % SUBPIXEL) // SUBPIXEL, amount * (y % SUBPIXEL) // SUBPIXEL
        both = right * (y % SUBPIXEL) // SUBPIXEL
        x, y = x // SUBPIXEL, y // SUBPIXEL
        parts = [(x, y, amount - right - behind + both), (x + 1, y, right - both), (x, y + 1, behind - both),
                 (x + 1, y + 1, both)]
    for x, y, part in parts:
        inside = (x >= 0) & (y >= 0) & (z >= 0) & (x < cells.shape[2]) & (y < cells.shape[1]) & (z < cells.shape[0])
        place = z[inside], y[inside], x[inside]
        (np.add if marked is None else np.maximum).at(cells, place, part[inside])


def _snap(grid, p):
    """Places [N, 3] float32 -> (sub-cells int64 [N, 3], distances w [N], which could be snapped [N])."""
    m = grid["to_grid"]
    with np.errstate(all="ignore"):
        c = ((m[0] * p[:, 0:1] + m[1] * p[:, 1:2]) + m[2] * p[:, 2:3]) + m[3]
        w = c[:, 3]
        far = np.float32(FAR * grid["size"][:3].max())
        q = np.stack([c[:, 0] / w, c[:, 1] / w, np.maximum(c[:, 2], -far) if grid["size"][3] else c[:, 2]], 1)
        good = (w > 0) & (np.abs(q) <= far).all(1)
        if grid["size"][3]:
            good &= w >= grid["face"][3]
    return np.floor(np.where(good[:, None], q, 0) * np.float32(SUBPIXEL) + np.float32(.5)).astype(np.int64), w, good


def _mean(means, h):
    """The table at height h, float32 [2]."""
    at = h * np.float32(HEIGHTS - 1)
    k = int(at) if at < HEIGHTS - 2 else HEIGHTS - 2
    return means[k] + (at - np.float32(k)) * (means[k + 1] - means[k])


def _dot(a, b):
    """Scalar products of float32 [..., 3], summed from the left."""
    return (a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]) + a[..., 2] * b[..., 2]


def _cross(a, b):
    return np.stack([a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1], a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
                     a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]], -1)


def leave(shells, low, scale, n, faces, curves, lattice, means, heights, most, opaque):
    """What hair leaves in n³ cells of a sky's grid -> [n, n, n, 3, 3] float64, see `sky.moments`.

    low [3], scale: of the grid, cells a unit.  heights: of a slab; most: rows of points on a face; opaque: optical
    depth of one crossing.
    """
    slabs, cells = int(shells["kind"][2]), np.zeros((n, n, n, 3, 3))
    levels, middle = slabs * heights, (np.arange(16) + .5) / 16
    for face, (i, j, k) in enumerate(np.asarray(faces)[:, :3].astype(int)):
        corners = np.asarray(lattice, float)[face].reshape(-1, 4)[:2].ravel()[:6].reshape(3, 2)
        pattern = abs(np.linalg.det(corners[1:] - corners[0]))
        for level in range(levels):
            slab, inside = level // heights, (level % heights + .5) / heights
            a, b, c = ((1 - inside) * curves[v, slab] + inside * curves[v, slab + 1] for v in (i, j, k))
            ups = np.array([curves[v, slab + 1] - curves[v, slab] for v in (i, j, k)], float)
            across = np.cross(b - a, c - a)
            area = np.linalg.norm(across)
            if not area > 0:
                continue
            table = np.linspace(0, 1, HEIGHTS)
            aside = np.interp((level + middle) / levels, table, means[:, 1]).mean() * np.sqrt(pattern / area)
            ends = np.interp(np.array([level, level + 1]) / levels, table, means[:, 0])
            down = max(ends[0] - ends[1], 0) * levels / float(shells["size"][0])
            density = np.hypot(aside, down / np.sqrt(2))
            flat = min(down**2 / density, density) if density else 0.0
            rows = int(min(max(np.linalg.norm(each) for each in (b - a, c - a, c - b)) * scale / .75, most - 1)) + 1
            thirds = [(row, t, turned) for row in range(rows) for t in range(2 * row + 1) for turned in [t % 2]]
            for row, t, turned in thirds:
                wb = (t // 2 + (1 + turned) / 3) / rows
                wc = (row - t // 2 - turned + (1 + turned) / 3) / rows
                p, up = a + wb * (b - a) + wc * (c - a), ups[0] + wb * (ups[1] - ups[0]) + wc * (ups[2] - ups[0])
                at = np.floor((p - low) * scale).astype(int)
                if (at < 0).any() or (at >= n).any():
                    continue
                along = up / np.linalg.norm(up)
                volume = abs(across @ up) / 2 / heights / rows**2
                tensor = (density - flat) * np.outer(along, along) + flat / 2 * (np.eye(3) - np.outer(along, along))
                cells[at[2], at[1], at[0]] += opaque * volume * scale**2 * tensor
    return cells
