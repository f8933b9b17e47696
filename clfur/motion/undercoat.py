"""Shell fur in motion: each vertex of the mesh leans by itself."""

from typing import Any

import attrs
import numpy as np

from ..scene import Mesh, Shells
from ..scene.rest import posed
from ..stages import motion as stage
from ..stages import wind as air
from .hair import HairMotion


class Undercoat:
    """Shells that lean with the wind and as the skin moves, vertex by vertex.

    shells: as they were groomed, at rest.  at: gives roots, as `stages.motion.place_roots`, of `feet`, where each
    vertex stands in a corner of a face.
    """

    def __init__(self, gpu: Any, shells: Shells, mesh: Mesh, motion: HairMotion, gravity: np.ndarray,
                 units_per_metre: float, at: Any) -> None:
        self._gpu = gpu
        bend, slowed, damping, carried = motion.row(shells.length, units_per_metre)
        self._hair = bend, slowed, damping, 1 - carried, shells.length
        self._mesh = mesh
        n, rows = len(mesh.positions), stage.padded(gpu, len(mesh.positions))
        self.feet = gpu.upload(_corners_of(mesh)), gpu.full((n, 4), np.float32, 0)   # and offsets
        self.roots = at(*self.feet)   # not kept: it would hold who holds this
        axes = gpu.download(self.roots)[1:]

        def known(vectors):   # [n, 3] in the world -> in the axes of roots
            there = np.zeros((3, rows), np.float32)
            there[:, :n] = np.einsum("axn,nx->an", axes[:, :, :n], vectors)
            return gpu.upload(there.ravel())
        force = np.broadcast_to(np.subtract(shells.force, shells.acceleration), (n, 3))
        force = force if shells.lean is None else force + shells.on_host.lean
        self.state = air.Leans.empty(gpu, {"vector": 3 * rows}, n=n, padded=rows, rest=known(force),
                                     weight=known(np.broadcast_to(gravity, (n, 3))))
        self.lean: Any = gpu.upload(np.ascontiguousarray(force, np.float32))
        self._lean_before = self.lean

    def sheltered(self, wind: np.void, upwind: tuple) -> Any:
        """Shares of the wind that strands, `wind.upwind`'s, leave to middles of hair."""
        return air.shelter(self._gpu, wind, upwind, self.roots, self._middles(), 2, self.state.padded)

    def _middles(self):
        """Where hair has its middles, as places of strands of two points."""
        return air.stand(self._gpu, self.roots, self._hair[4], self.state.padded)

    def go(self, roots: Any, step: float, wind: np.void, gravity: np.ndarray, shares: Any, jumped: bool) -> None:
        """Go on by ``step`` seconds to where `feet` have their roots then.  shares: `sheltered`'s, or None."""
        gpu, rows = self._gpu, self.state.padded
        before, self.roots = self.roots, roots
        winds = air.blow(gpu, wind, self.roots, self._middles(), 2, rows, shares)
        self.lean = air.sway(gpu, self.state, self.roots, before, step, gravity, winds, self._hair, jumped)

    def begin(self) -> None:
        """A step, that of a frame, begins."""
        self._lean_before = self.lean

    def drawn(self, shells: Shells, mesh: Mesh, share: float = 1.0) -> Shells:
        """Shells that lean as these do at a share of the last step, for a pose of the mesh: where its vertices touch
        they may be one."""
        rest = shells.rest or self._mesh
        now, lean = posed(mesh, rest, "Shells.rest"), self.lean
        if share < 1:
            lean = air.lean_between(self._gpu, self._lean_before, lean, share)
        if now.faces is not self._mesh.faces and not np.array_equal(now.faces, self._mesh.faces):
            known = self._gpu.download(lean)
            lean = np.zeros((len(now.positions), 3), np.float32)
            lean[now.faces] = known[self._mesh.faces]
        none = (0, 0, 0)
        return attrs.evolve(shells, rest=rest, lean=lean, wind=none, force=none, acceleration=none)


def _corners_of(mesh):
    """A corner of a face for each vertex [V, 4] float32, as `guides.feet_on` tells of places; of none the first."""
    feet = np.zeros((len(mesh.positions), 4), np.float32)
    for corner in range(3):
        vertices = mesh.faces[:, corner]
        feet[vertices, 1] = np.arange(len(mesh.faces), dtype=np.uint32).view(np.float32)
        feet[vertices, 2:] = np.eye(3)[corner, 1:]
    return feet
