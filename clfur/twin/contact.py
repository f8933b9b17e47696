"""A strand that touches the body, in float64: what it knows of it, and what contact.h makes of that."""

import numpy as np

HARD, GRIP = 10.0, 1.0   # springs of a contact over the inertia of its point, across the skin and along it
OUT = 4                  # times that a segment is turned out, at most


class Contact:
    """What a strand keeps of the body: `away` and `free` [n + 1], forces of its contacts [n + 1, 3], whether it has
    touched it.

    look: gives (distance, unit normal [n, 3]) at places in the world [n, 3], of the body as it is now.  points, widths:
    of the groom.  cell: side of those in which the distance is known.
    """

    def __init__(self, look, points, widths, cell, friction=0.0):
        value, _ = look(np.asarray(points, float))
        self.away, self.free = np.minimum(np.asarray(widths, float) / 2, value - cell / 128), value
        self.forces, self.touched, self.friction = np.zeros((len(points), 3)), False, friction

    def begin(self, look, carry, swell, deforms, places, now, root, root_before):
        """Where the body is at the end of a step: carry [3, 4] takes a place a step ago to where it is then; now: where
        places of a step ago count as being; roots: (place [3], axes [3, 3])."""
        spin, root, root_before = root_before[1].T @ root[1], root[0], root_before[0]
        self.look = lambda x: look(x + root)
        self.swell, turn = swell, carry[:, :3]
        self.taken = (places + root_before) @ turn.T + carry[:, 3] - root
        self.now_at = now
        self.stuck = places @ spin if deforms else self.taken
        self.last = self.forces @ (spin if deforms else turn.T)
        self.held = (self.forces != 0).any(1)
        self.known = self.held.copy()
        self.normal, self.gap, self.now = np.zeros_like(places), np.zeros(len(places)), {}

    def meet(self, x, first):
        """Look from the places where a Newton step begins; in the first only where it was touched a step ago."""
        if not first:
            gone = np.linalg.norm(x - self.taken, axis=1)
            self.known = self.held | (self.free - self.swell - gone <= self.away)
            self.known[0] = False
        if self.known.any():
            value, normal = self.look(x)
            self.gap, self.normal = value - self.away, normal

    def press(self, x, i, inertia):
        """(Matrix [3, 3], force [3]) that the contact of point i adds to its equations."""
        self.now.pop(i, None)
        if not self.known[i]:
            return np.zeros((3, 3)), np.zeros(3)
        n, last = self.normal[i], self.last[i]
        across, along = np.outer(n, n), np.eye(3) - np.outer(n, n)
        before = last @ n
        push, hold = before - HARD * inertia * self.gap[i], GRIP * inertia
        if push <= 0:
            self.now[i] = np.zeros((3, 3)), np.zeros(3)
            return self.now[i]
        grip = along @ (last - hold * (x[i] - self.stuck[i]))
        limit = self.friction * (push if before > 0 else -inertia * self.gap[i])
        size = np.linalg.norm(grip)
        stiff = HARD * inertia * across + hold * along
        if size > limit:   # Coulomb: it slides, and gives way along the force alone
            direction = grip / size
            stiff = HARD * inertia * across + hold * limit / size * (along - np.outer(direction, direction))
            grip = direction * limit
        self.now[i] = stiff, push * n + grip
        return self.now[i]

    def end(self, ways):
        """Keep the forces that a Newton step, in which points go these ways [n + 1, 3], ends with."""
        self.forces = np.zeros_like(self.last)
        for i, (stiff, force) in self.now.items():
            force, n = force - stiff @ ways[i], self.normal[i]
            push = force @ n
            grip = force - push * n
            size = np.linalg.norm(grip)
            if push > 0:
                self.forces[i] = push * n + grip * min(1, self.friction * push / size if size else 1)

    def turn_out(self, x, speeds, lengths, step):
        """Turn segments about their starts till their ends are out -> (places, speeds)."""
        x, speeds, shift = x.copy(), speeds.copy(), np.zeros(3)
        self.touched = bool(self.forces.any())
        for i in range(1, len(x)):
            solved = x[i].copy()
            x[i] = solved + shift
            self.free[i] -= self.swell + np.linalg.norm(x[i] - self.taken[i])
            if self.known[i] or self.free[i] <= self.away[i]:
                shift = self._out(x, speeds, lengths[i - 1], i, step) - solved
        return x, speeds

    def _out(self, x, speeds, length, i, step):
        body = (self.stuck[i] - self.now_at[i]) / step
        for tries in range(OUT):
            value, n = (each[0] for each in self.look(x[i][None]))
            lack = self.away[i] - value
            self.free[i] = max(value, self.away[i]) if tries == OUT - 1 else value
            if lack <= 0:
                break
            way = x[i] - x[i - 1]
            up = min(way @ n + lack * (1 + 0.01 * tries), 0.9999 * length)
            flat = way - way @ n * n
            x[i] = x[i - 1] + up * n + np.sqrt(length**2 - up**2) * flat / np.linalg.norm(flat)
            speeds[i] -= min((speeds[i] - body) @ n, 0) * n   # pushed out is no speed gained
            self.touched = True
        return x[i]
