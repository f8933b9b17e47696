"""A step of one strand that moves, in float64: the same equations as motion.cl, all at once in one matrix."""

import numpy as np


def turned(a, b, p):
    """p [3] turned by the least rotation that takes unit a to unit b (Rodrigues, from a × b and a · b)."""
    axis, d = np.cross(a, b), 1 + a @ b
    return p + np.cross(axis, p) + (np.cross(axis, np.cross(axis, p)) / d if d > 1e-3 else 0)


def stiffnesses(bend, lengths):
    """Of joints 0 (the clamp, half a segment away) to n - 1 -> [n]."""
    beside = np.concatenate([[0], lengths[:-1]]) + lengths
    return 2 * bend * (1 + 1 / len(lengths)**2) / beside


def hang(points, axes, bend, gravity):
    """A groomed strand [n + 1, 3] and the axes of its root [3, 3] -> (groomed [n + 1, 3], rest [n, 3] directions in
    these, whether it is too soft).

    Each joint's moment is the weight beyond it, less what the next joint gives back.
    """
    along = np.diff(points, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    t = along / lengths[:, None]
    n, stiff = len(t), stiffnesses(bend, lengths)
    masses = 0.5 * (lengths + np.append(lengths[1:], 0))
    rest, soft, back = np.zeros((n, 3)), False, np.zeros(3)
    for j in reversed(range(n)):
        need = -lengths[j] * masses[j:].sum() * np.asarray(gravity) - back
        need = (need - need @ t[j] * t[j]) / stiff[j]
        if need @ need > 0.98:
            need, soft = np.zeros(3), True
        rest[j] = need + np.sqrt(1 - need @ need) * t[j]
        back = stiff[j] * np.cross(np.cross(rest[j], t[j]), t[max(j - 1, 0)])
    return np.vstack([t[:1], t]) @ axes.T, (t if soft else rest) @ axes.T, soft


class Strand:
    """What a strand keeps: `groomed`, `rest`, `lengths` as `hang` gives them; `places` [n + 1, 3] relative to its root,
    those before, speeds and tensions."""

    def __init__(self, points, axes, bend, gravity, air=0.0, damping=0.0, carried=0.0, contact=None):
        self.contact = contact   # of `contact.Contact`, or None
        points = np.asarray(points, float) - points[0]
        self.groomed, self.rest, self.soft = hang(points, axes, bend, gravity)
        self.lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        self.bend, self.air, self.damping, self.carried = bend, air, damping, carried
        self.gravity, self.places, self.before = np.asarray(gravity, float), points, points.copy()
        self.speeds, self.speeds_before = np.zeros_like(points), np.zeros_like(points)
        self.tensions = np.zeros(len(self.lengths))

    def advance(self, root, root_before, step, wind, order=2, jumped=False, body=None, of_hair=None):
        """Go on by ``step`` seconds; roots: (place [3], axes [3, 3]); wind: [n + 1, 3] at its points, or [3]; body: for
        `Contact.begin`, (look, carry, swell, whether it deforms); of_hair: of other hair (accelerations of points at
        rest [n + 1, 3], frictions [n + 1])."""
        order = 1 if self.contact and self.contact.touched else order
        carried = 1.0 if jumped else self.carried
        axes, old = root[1], root_before[1]
        shift, spin = root[0] - root_before[0], old.T @ axes
        he = step / (1.5 if order == 2 else 1.0)
        third = (1 if order == 2 else 0) / 3
        rest = self._damped(old, he)
        start = self.places @ spin

        def moved(there, by):
            return (1 - carried) * (there - by) + carried * there @ spin
        now, then = moved(self.places, shift), moved(self.before, shift)
        speed, speed_then = moved(self.speeds, 0), moved(self.speeds_before, 0)
        base = now + third * (now - then)
        free = base + he * (speed + third * (speed - speed_then))
        places, wind = start, np.broadcast_to(np.asarray(wind, float), start.shape)
        of_hair = of_hair or (np.zeros_like(start), np.zeros(len(start)))
        if self.contact:
            self.contact.begin(*body, self.places, now, root, root_before)
        for number in range(2):
            if self.contact:
                self.contact.meet(places, not number)
            places = self._newton(places, base, free, axes, rest, he, wind, of_hair)
        speeds = (places - base) / he
        if self.contact:
            places, speeds = self.contact.turn_out(places, speeds, self.lengths, step)
        self.before, self.speeds_before = now, speed
        self.places, self.speeds = places, speeds
        self.before[0] = self.speeds_before[0] = self.speeds[0] = 0

    def _damped(self, old, he):
        """Rest directions with a share of the present ones."""
        share = self.damping / he / (1 + self.damping / he)
        t = np.diff(self.places, axis=0)
        t /= np.linalg.norm(t, axis=1)[:, None]
        from_ = np.vstack([self.groomed[0] @ old, t])
        now = [old @ turned(from_[j], self.groomed[j] @ old, t[j]) for j in range(len(t))]
        return (1 - share) * self.rest + share * np.array(now)

    def _newton(self, x, base, free, axes, rest, he, wind, of_hair):
        n, by = len(self.lengths), 1 / self.lengths
        stiff = stiffnesses(self.bend, self.lengths) * (1 + self.damping / he)
        along = np.diff(x, axis=0)
        now = np.linalg.norm(along, axis=1)
        ghost, wants = self.groomed @ axes, rest @ axes
        t = np.vstack([ghost[0], along / now[:, None]])
        wants = np.array([t[j] + turned(ghost[j], t[j], wants[j] - ghost[j]) if j else wants[0] for j in range(n)])
        masses = 0.5 * (self.lengths + np.append(self.lengths[1:], 0))
        a, b = np.zeros((n, 3, n, 3)), np.zeros((n, 3))
        one = np.eye(3)
        for j in range(n):   # joints: second differences of places
            row = np.zeros(n + 1)
            row[j + 1] += by[j]
            row[j] -= by[j]
            if j:
                row[j] -= by[j - 1]
                row[j - 1] += by[j - 1]
            a += stiff[j] * np.einsum("i,k,cd->ickd", row[1:], row[1:], one)
        for i in range(n):
            a[i, :, i] += (masses[i] / he**2 + (self.air + of_hair[1][i + 1]) * masses[i] / he) * one
            kink = stiff[i + 1] * (1 - self.groomed[i + 1] @ rest[i + 1])**2 if i + 1 < n else 0   # of a bent joint
            pull = (max(self.tensions[i], 0) + kink * by[i]) * by[i] * (one - np.outer(t[i + 1], t[i + 1]))
            a[i, :, i] += pull
            if i:
                a[i - 1, :, i - 1] += pull
                a[i, :, i - 1] -= pull
                a[i - 1, :, i] -= pull
            moment = stiff[i] * (wants[i] - t[i + 1])
            if i + 1 < n:
                torque = np.cross(wants[i + 1], t[i + 2])
                moment = moment + stiff[i + 1] * np.cross(torque, t[i + 1])
                moment -= stiff[i + 1] * (torque @ t[i + 1]) / max(1 + ghost[i + 1] @ t[i + 1], 0.1) * np.cross(
                    ghost[i + 1], t[i + 1])
            b[i] += moment * by[i]
            if i:
                b[i - 1] -= moment * by[i]
            b[i] += masses[i] * (self.gravity + self.air * wind[i + 1] + of_hair[0][i + 1] - (x[i + 1] - free[i + 1])
                                 / he**2 - (self.air + of_hair[1][i + 1]) * (x[i + 1] - base[i + 1]) / he)
            if self.contact:
                hard, force = self.contact.press(x, i + 1, masses[i] / he**2 + self.air * masses[i] / he)
                a[i, :, i] += hard
                b[i] += force
        rows = of_lengths(t[1:])
        whole = np.block([[a.reshape(3 * n, 3 * n), rows.T], [rows, np.zeros((n, n))]])
        solved = np.linalg.solve(whole, np.concatenate([b.ravel(), self.lengths - now]))
        self.tensions = solved[3 * n:]
        ways = np.vstack([np.zeros(3), solved[:3 * n].reshape(n, 3)])
        if self.contact:
            self.contact.end(ways)
        x = x + ways
        t = np.diff(x, axis=0)
        t *= (self.lengths / np.linalg.norm(t, axis=1))[:, None]
        return np.vstack([np.zeros(3), np.cumsum(t, axis=0)])


def of_lengths(t):
    """Rows [n, 3 n] that tell by how much segments of these unit directions [n, 3] get longer, as their ends move."""
    n = len(t)
    rows = np.zeros((n, n, 3))
    rows[np.arange(n), np.arange(n)] = t
    rows[np.arange(1, n), np.arange(n - 1)] = -t[1:]
    return rows.reshape(n, 3 * n)


def roots_on(face, weights, offsets, corners, normals):
    """Roots that stand on faces -> (places [n, 3], axes [n, 3, 3], a row each).

    face: [n].  weights: [n, 3].  offsets: [n, 3] along the axes.  corners, normals: [faces, 3, 3] of a pose.
    """
    corners, normals = np.asarray(corners, float)[face], np.asarray(normals, float)[face]
    axes = np.zeros((len(face), 3, 3))
    axes[:, 2] = np.einsum("nc,ncx->nx", weights, normals)
    axes[:, 2] /= np.linalg.norm(axes[:, 2], axis=1)[:, None]
    axes[:, 1] = np.cross(axes[:, 2], corners[:, 1] - corners[:, 0])   # the side's part along the skin gives the same
    axes[:, 1] /= np.linalg.norm(axes[:, 1], axis=1)[:, None]
    axes[:, 0] = np.cross(axes[:, 1], axes[:, 2])
    return np.einsum("nc,ncx->nx", weights, corners) + np.einsum("na,nax->nx", offsets, axes), axes


def between(then, now, roots, share, seconds, carried, lengths):
    """Where a strand was within a step -> [n + 1, 3] in the world.

    then, now: (places [n + 1, 3] relative to the root, speeds) at both ends. roots: (place [3], axes [3, 3]) there, and
    at that share of the seconds. A cubic that has these places and speeds (Hermite), of what the root does not carry in
    the world, and of the rest in its axes; then segments are as long as they are.
    """
    basis = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 1, 2, 3]], float)   # place, speed at 0; and at 1
    weights = np.array([1, share, share**2, share**3]) @ np.linalg.inv(basis)

    def curve(*ends):
        """Of (places, speeds) at both ends."""
        return np.einsum("k,kpa->pa", weights, [each * by for end in ends for each, by in zip(end, (1, seconds))])
    free = curve(*[(places + root[0], speeds) for (places, speeds), root in zip((then, now), roots)]) - roots[2][0]
    held = curve(*[(places @ root[1].T, speeds @ root[1].T)
                   for (places, speeds), root in zip((then, now), roots)]) @ roots[2][1]
    places = (1 - carried) * free + carried * held
    places[0] = 0
    along = np.diff(places, axis=0)
    along *= (np.asarray(lengths) / np.linalg.norm(along, axis=1))[:, None]
    return roots[2][0] + np.vstack([np.zeros(3), np.cumsum(along, axis=0)])
