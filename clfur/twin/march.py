"""What cl/march.cl means, in float64: a ray meets all tetrahedra of the fur, whose pieces of it are then put in order.

That is the walk of the kernel where the fur does not fold back or run through itself.
"""

import numpy as np

from .lighting import light_at
from .raster import BODY, DEPTH_ONE, NONE, PATTERNS
from .scatter import TURNED, fibre, surface
from .shells import HEIGHTS, cover, height_at
from .vectors import dot, f64, unit

SIDEWAYS, PIXEL = 8.0, 8.0
FIRST = 0.5                # place of a ray's first step, in steps from where it comes in
SHARP = 0.85
FAR_FROM, FAR_TO = 0.3, 0.9
TETRAHEDRA = np.array([(0, 1, 2, 5), (0, 1, 4, 5), (0, 3, 4, 5)])   # of a prism: 0 1 2 below, 3 4 5 above them


def march(view, shells, lights, visible, rounds, border, faces, curves, normals, lattice, noise, means, direct=1.0,
          sky=None):
    """Take all rays through the fur -> (image [rows, width, 4], shell_transmittance, place, face).

    rounds: [rows, width, samples] uint64 each, the border triangles where rays come in, by order.  border: [B, 2].
    faces: [F, 3].  curves: [V, slabs + 1, 3].  lattice: [F, 8, 4].  noise: [z, y, x, 2].  lights: [n]
    structs.  direct: share of their light that shadows leave.  sky: gives light [n, 3] of one around hairs at places
    [n, 3], of heights [n], along axes [n, 3], if there is one.
    place: [rows, width, samples, 3] where half of the light is gone, and face the face there, -1 if it is not gone.
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
            done[sample] = not (end == "out" or (end == "skin" and bare))
            if len(chain[0]):
                pieces.append(_steps(shells, lattice, corners, chain, end, d @ widening, stop, slabs, len(rays)))
                rays.append(sample)
                directions.append(d)
        if not rays:
            continue
        rays, directions = np.array(rays), np.array(directions)
        steps = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
        _meet(shells, lattice, noise, means, eye, directions, steps)
        part = _hide(steps, rays, rest, half, half_face, slabs)
        done |= rest == 0
        image[rays] += _light(shells, lights, faces, curves, normals, lattice, eye, directions, steps, part,
                              slabs, direct, sky)
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
    top, _, left, _ = (int(n) for n in view["rows"])
    x, y, s = sample // samples % width + left, sample // samples // width + top, sample % samples
    dx, dy = PATTERNS[samples][s]
    e = max(1 - depth / DEPTH_ONE, 0.5 / DEPTH_ONE)
    q = np.array([x + 0.5 + dx / 16, y + 0.5 + dy / 16, e, 1]) @ f64(view["to_world"])
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


def _steps(shells, lattice, corners, chain, end, wide, stop, slabs, ray):
    """Where a ray takes a step through the fur: {name: [steps]}.  wide: of a pixel at distance 1."""
    t, z_in, z_out, *weights = chain
    face, slab, corner = t // (3 * slabs), t // 3 % slabs, corners[t]
    h_in, h_out = ((slab + (w * (corner >= 3)).sum(1)) / slabs for w in weights)
    at = np.concatenate([lattice[face, 0].reshape(-1, 2, 2), lattice[face, 1, None, :2]], 1)
    at = np.take_along_axis(at, corner[:, :, None] % 3, 1)
    at_in, at_out = ((w[:, :, None] * at).sum(1) for w in weights)
    rise, across = h_out - h_in, at_out - at_in
    move = np.linalg.norm(across, axis=1)
    filtered, seen = bool(shells["kind"][3]), wide * (z_in + z_out) / 2
    footprint = seen * filtered
    blur = footprint * lattice[face, 1, 3]
    fade = np.clip((blur - FAR_FROM) / (FAR_TO - FAR_FROM), 0, 1)
    far = fade * fade * (3 - 2 * fade)
    slower = np.linalg.norm(lattice[face, 2:4, :3], axis=2).min(1)
    pixels = 1 / np.where(far == 1, blur, np.where(far > 0, slower * footprint, 1 / SIDEWAYS))
    sideways = np.where(far == 1, pixels, np.minimum(SIDEWAYS - (SIDEWAYS - 1) * far, pixels))
    if not filtered:
        sideways = np.minimum(SIDEWAYS, PIXEL / np.maximum(seen * lattice[face, 1, 3], 1e-6))
    measure = np.maximum(np.maximum(float(shells["size"][1]) * np.abs(rise), move * sideways), 1e-6)
    high = np.clip((stop - z_in) / (z_out - z_in), 0, 1)
    passed = np.concatenate([[0], np.cumsum(high * measure)])
    gone = np.concatenate([[0], np.cumsum(high * move)])
    when = np.arange(FIRST, passed[-1], 1.0)
    piece = np.searchsorted(passed, when, side="left") - 1
    along = (when - passed[piece]) / measure[piece]
    if end != "out":
        piece, along = np.append(piece, len(t) - 1), np.append(along, high[-1])
    sideways = gone[piece] + along * move[piece]
    h = np.clip(h_in[piece] + along * rise[piece], 0, 1)
    return {"ray": np.full(len(piece), ray), "tetrahedron": t[piece], "face": face[piece],
            "h": h, "h before": np.concatenate([h_in[:1], h[:-1]])[:len(h)], "since": along * measure[piece],
            "z": z_in[piece] + along * (z_out - z_in)[piece], "at": at_in[piece] + along[:, None] * across[piece],
            "z step": ((z_out - z_in) / measure)[piece], "h step": (rise / measure)[piece],
            "at step": (across / measure[:, None])[piece], "aside": np.diff(sideways, prepend=0),
            "far": far[piece], "footprint": footprint[piece]}


def _meet(shells, lattice, noise, means, eye, directions, steps):
    """Add to the steps what they meet: the share covered, that which many hairs keep, and how far back it was met."""
    face, h, d, far = steps["face"], steps["h"], directions[steps["ray"]], steps["far"]
    crowd = far == 1
    v, grad, top, fold = height_at(shells, noise, face, lattice[face], steps["at"], h)
    slope = grad[:, :1] * lattice[face, 2, :3] + grad[:, 1:] * lattice[face, 3, :3]
    falls = slope - lattice[face, 4, :3]                     # gradient of v - h
    across = falls - dot(falls, d)[:, None] * d
    steep = np.sqrt(np.maximum(dot(across, across), 1e-20))
    g = SHARP * steps["footprint"] * steep
    steps["covered"] = np.where(crowd, at_height(means, h)[0], cover(shells, v, h, g, top, fold))
    depth = depth_of_many(means, np.where(crowd, steps["h before"], h - steps["h step"]), h, steps["aside"], crowd)
    steps["many"] = np.where(far > 0, np.exp(-depth), 1)
    steps["slope"] = (1 - far)[:, None] * slope

    # Met where the ramp from nothing to all was half gone through since the step before.
    ramp = np.maximum((float(shells["shape"][0]) - 1) * h, 1e-3) + g
    now, change = (v - h + g / 2) / ramp, (dot(grad, steps["at step"]) - steps["h step"]) / ramp
    middle = (np.clip(now - change, 0, 1) + np.clip(now, 0, 1)) / 2
    back = np.clip((now - middle) / np.where(change > 1e-6, change, 1), 0, 1)
    back = np.where((change > 1e-6) & (far == 0), back, 0.5)
    # Of a crowd: at the mean place of what is lost on the way, if that is not before the tetrahedron.
    way = steps["aside"] / np.maximum(np.linalg.norm(steps["at step"], axis=1), 1e-30)
    some = np.clip(depth, 1e-2, 69)
    mean = np.where(depth > 1e-2, 1 / some - 1 / np.expm1(some), 0.5)
    back = np.where(crowd, np.minimum(way, steps["since"]) * (1 - mean), back)
    steps["where"] = eye + (steps["z"] - crowd * back * steps["z step"])[:, None] * d
    steps["met h"] = h - back * steps["h step"]
    steps["met z"] = steps["z"] - back * steps["z step"]
    steps["met at"] = steps["at"] - back[:, None] * steps["at step"]


def _hide(steps, rays, rest, half, half_face, slabs):
    """What each step hides of the light from behind; writes what is left, and where half of it is gone, of samples."""
    counts = np.bincount(steps["ray"], minlength=len(rays))
    first = np.cumsum(counts) - counts
    part, before, left, over = np.zeros(len(steps["ray"])), np.zeros(len(rays)), rest[rays], np.zeros(len(rays), bool)
    for n in range(counts.max(initial=0)):
        on = np.flatnonzero((counts > n) & ~over)
        step = first[on] + n
        covered = steps["covered"][step]
        kept = np.where(covered > before[on], (1 - covered) / (1 - before[on]), 1)
        kept += steps["far"][step] * (steps["many"][step] - kept)
        before[on] = np.minimum(covered, 0.999)
        now = left[on] * kept
        now[now < 1 / 256] = 0
        part[step] = left[on] - now
        halved = (left[on] >= 0.5) & (now < 0.5)
        half[rays[on[halved]]] = steps["where"][step[halved]]
        half_face[rays[on[halved]]] = steps["face"][step[halved]]
        left[on] = now
        over[on] = now == 0
    rest[rays] = left
    return part


def _light(shells, lights, faces, curves, normals, lattice, eye, directions, steps, part, slabs, direct, sky):
    """Light [rays, 4] of the fur, once a tetrahedron: at the mean place of what it hides."""
    key = steps["ray"].astype(np.int64) << 40 | steps["tetrahedron"]
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    hidden = np.bincount(group, part)
    shown = hidden > 1e-4
    hidden = hidden[shown]

    def mean(values):
        sums = np.stack([np.bincount(group, part * column) for column in values.reshape(len(part), -1).T], 1)
        return (sums[shown] / hidden[:, None]).reshape(-1, *values.shape[1:])
    ray, tetrahedron = steps["ray"][first][shown], steps["tetrahedron"][first][shown]
    face, slab = tetrahedron // (3 * slabs), tetrahedron // 3 % slabs
    d, h = directions[ray], np.clip(mean(steps["met h"]), 0, 1)
    p = eye + mean(steps["met z"])[:, None] * d
    a, b, c = lattice[face, 0, :2], lattice[face, 0, 2:], lattice[face, 1, :2]
    sides = np.stack([b - a, c - a], 2)
    flat = np.linalg.det(sides) == 0
    sides[flat] = np.eye(2)
    other = np.linalg.solve(sides, (mean(steps["met at"]) - a)[..., None])[..., 0]
    other[flat] = 0
    weights = np.concatenate([1 - other.sum(1, keepdims=True), other], 1)[..., None]
    corners = np.asarray(faces)[face, :3].astype(np.int64)
    n = unit((weights * normals[corners]).sum(1))
    t = unit((weights * (curves[corners, slab[:, None] + 1] - curves[corners, slab[:, None]])).sum(1))

    color, shine = f64(shells["color"])[:3], np.broadcast_to(f64(shells["shine"]), (len(p), 4))
    rgb, turned = np.zeros(p.shape), unit(n - float(shells["size"][0]) * mean(steps["slope"]))
    for light in lights:
        to_light, strength, ambient = light_at(light, p)
        if shine[0, 3] == TURNED:
            rgb += surface(color, shine, turned, to_light, -d, direct * strength, ambient)
        else:
            rgb += fibre(color, shine, t, to_light, -d, direct * strength, ambient)
    if sky is not None:
        rgb += color * sky(p, h, t)
    root = float(shells["color"][3])
    rgb = rgb * (root + (1 - root) * h)[:, None]
    values = hidden[:, None] * np.concatenate([rgb, np.ones((len(rgb), 1))], 1)
    return np.stack([np.bincount(ray, column, len(directions)) for column in values.T], 1)


def at_height(means, h):
    """The table at heights h: (share covered, how often one who goes sideways by 1 enters hair)."""
    at = np.arange(HEIGHTS) / (HEIGHTS - 1)
    return [np.interp(h, at, column) for column in f64(means).T]


def depth_of_many(means, h0, h, aside, crowd):
    """Optical depth of many hairs from height h0 to h and `aside` sideways.

    ``crowd``: they are entered as often as at h0 and h on average, else as at h.
    """
    (before, first), (now, last) = at_height(means, h0), at_height(means, h)
    before, now = np.minimum(before, 0.999), np.minimum(now, 0.999)
    down = np.where(now > before, np.log((1 - before) / (1 - np.maximum(now, before))), 0)
    side = np.pi * np.where(crowd, (first + last) / 2, last) * aside / (1 - (before + now) / 2)
    share = np.where(side > 0, down / np.where(side > 0, side, 1), 2)
    return np.where(share < 1, side * (1 / np.pi + share * (0.5 + share * (0.5 - 1 / np.pi))), down)
