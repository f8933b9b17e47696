"""What cl/shells.cl means, in float64: a ray meets all tetrahedra of the fur, whose pieces of it are then put in order.

That is the walk of the kernel where the fur does not fold back or run through itself.
"""

import numpy as np

SUBPIXEL = 256
DEPTH_ONE = 1 << 30
NONE = (1 << 64) - 1
BODY = 1 << 31
PATTERNS = {   # in 1/16 pixel from the pixel's centre: the standard patterns of Direct3D 11
    1: [(0, 0)],
    4: [(-2, -6), (6, -2), (-6, 2), (2, 6)],
    16: [(1, 1), (-1, -3), (-3, 2), (4, -1), (-5, -2), (2, 5), (5, 3), (3, -5),
         (-2, 6), (0, -7), (-4, -6), (-6, 4), (-8, 0), (7, -4), (6, 7), (-7, -8)],
}
HEIGHTS = 64
CELL_RADIUS = 0.62
SIDEWAYS = 8.0
SHARP = 0.85
FAR_FROM, FAR_TO = 0.3, 0.9
TETRAHEDRA = np.array([(0, 1, 2, 5), (0, 1, 4, 5), (0, 3, 4, 5)])   # of a prism: 0 1 2 below, 3 4 5 above them


# --- the stages -----------------------------------------------------------------------------------------


def bend(shells, positions, normals):
    """How hairs are bent at vertices [V, 3] -> places at heights 0, 1/slabs .. 1, [V, slabs + 1, 3]."""
    slabs, length = int(shells["kind"][2]), float(shells["size"][0])
    positions, normals, gust = f64(positions), f64(normals), f64(shells["gust"])
    turn = np.mod(gust[3] - positions @ gust[:3], 1)
    wave = np.where(turn < 0.5, 16 * turn * (0.5 - turn), -16 * (turn - 0.5) * (1 - turn))
    force = f64(shells["bend"])[:3] + (0.7 + 0.3 * wave)[:, None] * f64(shells["wind"])[:3]
    middles = (np.arange(slabs) + 0.5) / slabs
    steps = unit(normals[:, None] + middles[:, None] * force[:, None]) * length / slabs
    return np.concatenate([positions[:, None], positions[:, None] + np.cumsum(steps, 1)], 1)


def lattice(shells, positions, normals, faces, uv):
    """Places of the corners of faces [F, 3] in the pattern -> [F, 5, 4]; uv [F, 3, 2] of these corners.

    x0 y0 x1 y1; x2 y2, cells along a side, mean growth of x and y in the world; gradients of x, of y
    and of the height; the most that x and y together can grow.
    """
    f = float(shells["size"][2])
    a, b, c = np.moveaxis(f64(positions)[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    if shells["kind"][0]:
        at, sides = f64(uv) * (2 * f, f), np.zeros(len(faces))
    else:
        sides = np.clip(np.floor(f * np.sqrt(area) + 0.5), 1, 4096)
        at = sides[:, None, None] * np.array([(0, 0), (1, 0), (0.5, np.sqrt(0.75))])
    # The gradient lies in the face and gives the corners' differences: a least-squares inverse of two sides.
    inverse = np.linalg.pinv(np.stack([b - a, c - a], 1))
    grad = np.swapaxes(inverse @ (at[:, 1:] - at[:, :1]), 1, 2)
    up = np.cross(b - a, c - a)
    up *= np.where(dot(up, f64(normals)[faces[:, 0]]) < 0, -1, 1)[:, None]
    result = np.zeros((len(faces), 5, 4))
    result[:, 0], result[:, 1, :2], result[:, 1, 2] = at[:, :2].reshape(-1, 4), at[:, 2], sides
    result[:, 1, 3] = np.sqrt(np.linalg.norm(grad, axis=2).prod(1))
    result[:, 2:4, :3], result[:, 4, :3] = grad, unit(up) / float(shells["size"][0])
    result[:, 4, 3] = np.sqrt((grad**2).sum((1, 2)))
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


def height_at(shells, table, face, sides, at, place, h):
    """Height of the fur at places [n, 2] of faces [n], its gradient by x and y, its hair's tip, the fold.

    place: [n, 3] in the noise's lattice.
    """
    sine, amount = shells["kind"][0], float(shells["shape"][2])
    if sine:
        place = np.concatenate([at / float(shells["shape"][3]), np.zeros((len(at), 1))], 1)
    moved = amount * noise_at(shells, table, place)
    return waves(shells, at + moved) if sine else cells(shells, face, sides, at, moved * h[:, None])


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


def kept_by_many(means, h0, h, aside):
    """Share of light that many hairs let through, from height h0 to h and `aside` sideways."""
    at = np.arange(HEIGHTS) / (HEIGHTS - 1)
    before, now = (np.minimum(np.interp(x, at, f64(means)[:, 0]), 0.999) for x in (h0, h))
    down = np.where(now > before, np.log((1 - before) / (1 - np.maximum(now, before))), 0)
    side = np.pi * np.interp(h, at, f64(means)[:, 1]) * aside / (1 - (before + now) / 2)
    share = np.where(side > 0, down / np.where(side > 0, side, 1), 2)
    return np.exp(-np.where(share < 1, side * (1 / np.pi + share * (0.5 + share * (0.5 - 1 / np.pi))), down))


# --- rays -----------------------------------------------------------------------------------------------


def march(view, shells, light, half_vector, visible, rounds, border, faces, curves, normals, lattice, noise, means, box,
          direct=1.0):
    """Take all rays through the fur -> (image [rows, width, 4], through, place, face).

    rounds: [rows, width, samples] uint64 each, the border triangles where rays come in, by order.  border: [B, 2].
    faces: [F, 3].  curves: [V, slabs + 1, 3].  lattice: [F, 4, 4].  noise: [z, y, x, 2].  box: origin of the noise and
    its lattices a unit of length.  direct: share of the light that shadows leave.  place: [rows, width, samples, 3]
    where half of the light is gone, and face the face there, -1 if it is not gone.
    """
    rows, width, samples = visible.shape
    slabs, bare = int(shells["kind"][2]), bool(shells["noise"][3])
    curves, normals, lattice, eye = f64(curves), f64(normals), f64(lattice), f64(view["eye"])[:3]
    tetrahedra, corners = _tetrahedra(faces, curves, slabs)
    widening = f64(view["to_screen"])[:3, 3] / float(view["scale"][0]) / np.sqrt(samples)   # of a pixel, along the view

    rest, done = np.ones(visible.size), np.zeros(visible.size, bool)
    half, half_face = np.zeros((visible.size, 3)), np.full(visible.size, -1)
    image = np.zeros((visible.size, 4))
    for entries in rounds:
        entries, pieces, rays, directions = entries.ravel(), [], [], []
        for sample in np.flatnonzero((entries != NONE) & ~done):
            depth, stop_depth = (int(keys.ravel()[sample] >> np.uint64(32)) for keys in (entries, visible))
            if depth >= stop_depth:
                done[sample] = True
                continue
            p = _seen(view, sample, samples, width, depth)
            p = _put_in(p, border[int(entries[sample]) & ~BODY & 0xFFFFFFFF], faces, curves)
            d = unit(p - eye)
            stop = np.inf if stop_depth == 0xFFFFFFFF else (_seen(view, sample, samples, width, stop_depth) - eye) @ d
            chain, end = _chain(tetrahedra, eye, d, np.linalg.norm(p - eye), stop, slabs)
            done[sample] = not (end == "out" or end == "skin" and bare)
            if len(chain[0]):
                pieces.append(_looks(shells, lattice, corners, chain, end, d @ widening, stop, slabs, len(rays)))
                rays.append(sample)
                directions.append(d)
        if not rays:
            continue
        rays, directions = np.array(rays), np.array(directions)
        looks = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
        _see(shells, lattice, noise, means, f64(box), eye, directions, looks)
        part = _hide(looks, rays, rest, half, half_face, slabs)
        done |= rest == 0
        image[rays] += _light(shells, light, half_vector, faces, curves, normals, lattice, eye, directions, looks, part,
                              slabs, direct)
    return (image.reshape(rows, width, samples, 4).mean(2), rest.reshape(visible.shape),
            half.reshape(*visible.shape, 3), half_face.reshape(visible.shape))


def depth_of(view, p):
    """Depth of places [n, 3], not yet rounded."""
    q = np.concatenate([p, np.ones((len(p), 1))], 1) @ f64(view["to_screen"])
    return DEPTH_ONE * (1 - np.clip(q[:, 2] / q[:, 3], 0, 1))


def _tetrahedra(faces, curves, slabs):
    """(matrices [T, 4, 4] from places (p, 1) to the corners' weights, corners [T, 4] 0..5).

    Their number is 3 · (slabs · face + slab) + row of TETRAHEDRA.
    """
    faces = np.asarray(faces)[:, :3].astype(np.int64)
    corners = np.tile(TETRAHEDRA, (len(faces) * slabs, 1))
    face, slab = np.arange(len(corners)) // (3 * slabs), np.arange(len(corners)) // 3 % slabs
    q = curves[faces[face[:, None], corners % 3], slab[:, None] + corners // 3]
    places = np.concatenate([np.swapaxes(q, 1, 2), np.ones((len(q), 1, 4))], 1)
    return np.linalg.inv(places), corners


def _seen(view, sample, samples, width, depth):
    """The world point that a sample sees at a depth."""
    x, y, s = sample // samples % width, sample // samples // width + int(view["rows"][0]), sample % samples
    dx, dy = PATTERNS[samples][s]
    q = np.array([x + 0.5 + dx / 16, y + 0.5 + dy / 16, 1 - depth / DEPTH_ONE, 1]) @ f64(view["to_world"])
    return q[:3] / q[3]


def _put_in(p, start, faces, curves):
    """The point moved into the border triangle that it belongs to, and a thousandth away from its sides."""
    face, place = int(start[0]), int(start[1])
    corners = np.delete(TETRAHEDRA[place // 4 % 3], place % 4)
    a, b, c = curves[np.asarray(faces)[face, corners % 3].astype(np.int64), place // 12 + corners // 3]
    n = np.cross(b - a, c - a)
    w = np.array([np.cross(b - p, c - p) @ n, np.cross(c - p, a - p) @ n, np.cross(a - p, b - p) @ n]) / (n @ n)
    w = np.maximum(w, 1e-3)
    return w @ np.array([a, b, c]) / w.sum()


def _chain(tetrahedra, eye, d, entry, stop, slabs):
    """Pieces of a ray from its entry on -> ((tetrahedra, z in, z out, weights in, weights out), how they end)."""
    at_eye, by_z = tetrahedra[:, :, :3] @ eye + tetrahedra[:, :, 3], tetrahedra[:, :, :3] @ d
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -at_eye / by_z
    starts = np.where(by_z > 0, crossing, -np.inf)
    ends = np.where(by_z < 0, crossing, np.inf)
    z_in, z_out, left = starts.max(1), ends.min(1), ends.argmin(1)
    tiny = 1e-7 * entry
    which = np.flatnonzero((z_out - z_in > 1e-9 * entry) & (z_out > entry + tiny))
    which = which[np.argsort(z_in[which])]
    end, count, at = "out", 0, entry
    for t in which:
        if z_in[t] > at + 10 * tiny:
            break
        count, at = count + 1, max(at, z_out[t])
        if z_out[t] >= stop:
            end = "stop"
            break
        if t % (3 * slabs) == 0 and left[t] == 3:
            end = "skin"
            break
    which = which[:count]
    weights = [at_eye[which] + z[which, None] * by_z[which] for z in (z_in, z_out)]
    return (which, z_in[which], z_out[which], *weights), end


def _looks(shells, lattice, corners, chain, end, wide, stop, slabs, ray):
    """Where a ray looks at the fur: {name: [looks]}.  wide: of a pixel at distance 1."""
    t, z_in, z_out, *weights = chain
    face, slab, corner = t // (3 * slabs), t // 3 % slabs, corners[t]
    h_in, h_out = ((slab + (w * (corner >= 3)).sum(1)) / slabs for w in weights)
    at = np.concatenate([lattice[face, 0].reshape(-1, 2, 2), lattice[face, 1, None, :2]], 1)
    at = np.take_along_axis(at, corner[:, :, None] % 3, 1)
    at_in, at_out = ((w[:, :, None] * at).sum(1) for w in weights)
    rise, across = h_out - h_in, at_out - at_in
    move = np.linalg.norm(across, axis=1)
    footprint = wide * (z_in + z_out) / 2 * bool(shells["kind"][3])
    blur = footprint * lattice[face, 1, 3]
    fade = np.clip((blur - FAR_FROM) / (FAR_TO - FAR_FROM), 0, 1)
    far = fade * fade * (3 - 2 * fade)
    measure = np.maximum(float(shells["size"][1]) * np.abs(rise), move * (SIDEWAYS - (SIDEWAYS - 1) * far))
    measure = np.maximum(measure, 1e-6)
    high = np.clip((stop - z_in) / (z_out - z_in), 0, 1)
    passed = np.concatenate([[0], np.cumsum(high * measure)])
    gone = np.concatenate([[0], np.cumsum(high * move)])
    when = np.arange(0.5, passed[-1], 1.0)
    piece = np.searchsorted(passed, when, side="left") - 1
    along = (when - passed[piece]) / measure[piece]
    if end != "out":
        piece, along = np.append(piece, len(t) - 1), np.append(along, high[-1])
    sideways = gone[piece] + along * move[piece]
    return {"ray": np.full(len(piece), ray), "tetrahedron": t[piece], "face": face[piece],
            "h": np.clip(h_in[piece] + along * rise[piece], 0, 1), "z": z_in[piece] + along * (z_out - z_in)[piece],
            "at": at_in[piece] + along[:, None] * across[piece],
            "z step": ((z_out - z_in) / measure)[piece], "h step": (rise / measure)[piece],
            "at step": (across / measure[:, None])[piece], "aside": np.diff(sideways, prepend=0),
            "far": far[piece], "footprint": footprint[piece]}


def _see(shells, lattice, noise, means, box, eye, directions, looks):
    """Add to the looks what they see: the share covered, that which many hairs keep, and how far back it was met."""
    face, h, d, far = looks["face"], looks["h"], directions[looks["ray"]], looks["far"]
    looks["where"] = where = eye + looks["z"][:, None] * d
    v, grad, top, fold = height_at(shells, noise, face, lattice[face, 1, 2], looks["at"], (where - box[:3]) * box[3], h)
    slope = grad[:, :1] * lattice[face, 2, :3] + grad[:, 1:] * lattice[face, 3, :3]
    falls = slope - lattice[face, 4, :3]                     # gradient of v - h
    across = falls - dot(falls, d)[:, None] * d
    steep = np.sqrt(np.maximum(dot(across, across), 1e-20))
    g = SHARP * looks["footprint"] * steep
    looks["covered"] = cover(shells, v, h, g, top, fold)
    looks["many"] = np.where(far > 0, kept_by_many(means, h - looks["h step"], h, looks["aside"]), 1)
    looks["slope"] = (1 - far)[:, None] * slope

    # Met where the ramp from nothing to all was half gone through since the look before.
    ramp = np.maximum((float(shells["shape"][0]) - 1) * h, 1e-3) + g
    now, change = (v - h + g / 2) / ramp, (dot(grad, looks["at step"]) - looks["h step"]) / ramp
    middle = (np.clip(now - change, 0, 1) + np.clip(now, 0, 1)) / 2
    back = np.clip((now - middle) / np.where(change > 1e-6, change, 1), 0, 1)
    back = np.where((change > 1e-6) & (far == 0), back, 0.5)
    looks["met h"] = h - back * looks["h step"]
    looks["met z"] = looks["z"] - back * looks["z step"]
    looks["met at"] = looks["at"] - back[:, None] * looks["at step"]


def _hide(looks, rays, rest, half, half_face, slabs):
    """What each look hides of the light from behind; writes what is left, and where half of it is gone, of samples."""
    counts = np.bincount(looks["ray"], minlength=len(rays))
    first = np.cumsum(counts) - counts
    part, before, left, over = np.zeros(len(looks["ray"])), np.zeros(len(rays)), rest[rays], np.zeros(len(rays), bool)
    for n in range(counts.max(initial=0)):
        on = np.flatnonzero((counts > n) & ~over)
        look = first[on] + n
        covered = looks["covered"][look]
        kept = np.where(covered > before[on], (1 - covered) / (1 - before[on]), 1)
        kept += looks["far"][look] * (looks["many"][look] - kept)
        before[on] = np.minimum(covered, 0.999)
        now = left[on] * kept
        now[now < 1 / 256] = 0
        part[look] = left[on] - now
        halved = (left[on] >= 0.5) & (now < 0.5)
        half[rays[on[halved]]] = looks["where"][look[halved]]
        half_face[rays[on[halved]]] = looks["face"][look[halved]]
        left[on] = now
        over[on] = now == 0
    rest[rays] = left
    return part


def _light(shells, light, half_vector, faces, curves, normals, lattice, eye, directions, looks, part, slabs, direct):
    """Light [rays, 4] of the fur, once a tetrahedron: at the mean place of what it hides."""
    key = looks["ray"].astype(np.int64) << 40 | looks["tetrahedron"]
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    hidden = np.bincount(group, part)
    seen = hidden > 1e-4
    hidden = hidden[seen]

    def mean(values):
        sums = np.stack([np.bincount(group, part * column) for column in values.reshape(len(part), -1).T], 1)
        return (sums[seen] / hidden[:, None]).reshape(-1, *values.shape[1:])
    ray, tetrahedron = looks["ray"][first][seen], looks["tetrahedron"][first][seen]
    face, slab = tetrahedron // (3 * slabs), tetrahedron // 3 % slabs
    d, h = directions[ray], np.clip(mean(looks["met h"]), 0, 1)
    p = eye + mean(looks["met z"])[:, None] * d
    a, b, c = lattice[face, 0, :2], lattice[face, 0, 2:], lattice[face, 1, :2]
    sides = np.stack([b - a, c - a], 2)
    flat = np.linalg.det(sides) == 0
    sides[flat] = np.eye(2)
    other = np.linalg.solve(sides, (mean(looks["met at"]) - a)[..., None])[..., 0]
    other[flat] = 0
    weights = np.concatenate([1 - other.sum(1, keepdims=True), other], 1)[..., None]
    corners = np.asarray(faces)[face, :3].astype(np.int64)
    n = unit((weights * normals[corners]).sum(1))
    t = unit((weights * (curves[corners, slab[:, None] + 1] - curves[corners, slab[:, None]])).sum(1))

    to_light = np.broadcast_to(-f64(light["direction"])[:3], p.shape)
    strength = np.broadcast_to(f64(light["color"])[:3] * direct, p.shape)
    if light["position"][3] > 0:
        to_light = unit(f64(light["position"])[:3] - p)
        strength = strength * (to_light @ -f64(light["direction"])[:3] >= float(light["cone"][0]))[:, None]
    color, ambient = f64(shells["color"])[:3], float(light["color"][3])
    specular, exponent, _, turned = f64(shells["shine"])
    if turned:
        n = unit(n - float(shells["size"][0]) * mean(looks["slope"]))
        towards = dot(n, to_light)
        shine = specular * np.clip(dot(n, unit(to_light - d)), 0, 1)**exponent * (towards > 0)
        rgb = strength * (np.maximum(towards, 0)[:, None] * color + shine[:, None]) + ambient * color
    else:
        if half_vector:
            shine = sine(t, unit(to_light - d))
        else:
            shine = np.maximum(sine(t, to_light) * sine(t, -d) + dot(t, to_light) * dot(t, d), 0)
        rgb = strength * (sine(t, to_light)[:, None] * color + (specular * shine**exponent)[:, None]) + ambient * color
    root = float(shells["color"][3])
    rgb = rgb * (root + (1 - root) * h)[:, None]
    values = hidden[:, None] * np.concatenate([rgb, np.ones((len(rgb), 1))], 1)
    return np.stack([np.bincount(ray, column, len(directions)) for column in values.T], 1)


# --- numbers --------------------------------------------------------------------------------------------


def f64(array):
    """Float64 copy of an array, so that nothing below is rounded to its type."""
    return np.asarray(array).astype(np.float64)


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


def dot(a, b):
    return (a * b).sum(-1)


def unit(a):
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def sine(a, b):
    """Sine between unit vectors."""
    return np.linalg.norm(np.cross(a, b), axis=-1)


# --- the light's grid: in the device's own order of float operations, so that whole numbers are equal ----------------

ROWS, LOOKS, FAR = 16, 16, 4    # of a face's points a work-item; at the table; grids beyond which nothing is snapped


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
        chosen = np.flatnonzero((rows == n) & (heights == high) & (far >= grid["face"][2]))
        if len(chosen):
            a, b, c = (p[chosen] for p in corners)
            _deposit(cells, grid, a, b, c, np.asarray(lattice, one)[chosen], np.asarray(means, one), slabs, n, high,
                     binary, weight)
    return cells


def _deposit(cells, grid, a, b, c, lattice, means, slabs, rows, heights, binary, weight):
    """Put faces into the cells that have as many rows and heights: all at once, point after point."""
    one = np.float32
    to_b, to_c = lattice[:, 0, 2:] - lattice[:, 0, :2], lattice[:, 1, :2] - lattice[:, 0, :2]
    looks = (LOOKS - 1) // (slabs * heights) + 1
    each = one(weight) * one(.25) / (one(rows) * one(rows) * grid["face"][0])
    for first in range(0, rows, ROWS):
        left = np.full(len(a), .5, one)
        for level in range(slabs * heights):
            k, inside = level // heights, one(level % heights + .5) / one(heights)
            low, top = one(level) / one(slabs * heights), one(level + 1) / one(slabs * heights)
            newly = _mean(means, low)[0] - _mean(means, top)[0]
            entered = one(0)
            for look in range(looks):
                entered += _mean(means, low + one(look + .5) / one(slabs * heights * looks))[1]
            sideways = entered / one(heights * looks)
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
                    good &= at[:, 2] >= 0
                    w = np.maximum(w, grid["face"][2])
                    ray, up = grid["light"][:3] - grid["light"][3] * p, up_a + wb * up_b + wc * up_c
                    move = _dot(ray, _cross(ac, up))[:, None] * to_b + _dot(ray, _cross(up, ab))[:, None] * to_c
                    side = sideways * sideways * (move[:, 0] * move[:, 0] + move[:, 1] * move[:, 1])
                    n = _cross(ab, ac)
                    down = newly * _dot(ray, n) * np.where(_dot(up, n) < 0, one(-1), one(1))
                    both = down + np.maximum(np.abs(down), np.sqrt(one(4) * side + one(.5947153) * (down * down)))
                    exact = both * each / (w * w * w) + left
                    amount = np.minimum(exact, one(2**31)).astype(np.int64)
                    left = np.where(good, np.minimum(exact - amount.astype(one), one(1)), left)
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
        q = np.stack([c[:, 0] / w, c[:, 1] / w, c[:, 2]], 1)
        good = (w > 0) & (np.abs(q) <= FAR * grid["size"][:3].max()).all(1)
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
