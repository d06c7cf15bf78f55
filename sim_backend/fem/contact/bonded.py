"""Bonded contact: what has touched the finger, or the support, keeps its place on it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Bools, Ints


@dataclass(frozen=True)
class BondedContact:
    """Springs of stiffness ``penalty`` [N/m²] that hold ``nodes`` (s,) along x at ``at_m`` (s,),
    NaN where free, None where all are. What does not ``stick`` holds nothing.

    Finger and support do not move along x, so bonded nodes keep their x.
    """

    nodes: Ints
    at_m: Array | None
    sticks: bool
    penalty: float

    @cached_property
    def held_at_m(self) -> Array:
        return np.full(len(self.nodes), np.nan) if self.at_m is None else self.at_m

    @cached_property
    def bonded(self) -> Bools:
        """Which nodes (s,) are bonded."""
        return np.isfinite(self.held_at_m)

    @property
    def blocks(self) -> Array:
        """Tangent (s, 2, 2)."""
        along = np.array([[1.0, 0.0], [0.0, 0.0]])
        return np.asarray(np.where(self.bonded, self.penalty, 0.0)[:, None, None] * along)

    def add_force(self, u: Array, total: Array) -> None:
        """Add to ``total`` (size,) the springs' force at displacements ``u`` (n, 2) [m]."""
        slip = np.where(self.bonded, u[self.nodes, 0] - self.held_at_m, 0.0)
        total[2 * self.nodes] += self.penalty * slip

    def now_holding(self, touched: Bools, u: Array) -> Array | None:
        """``at_m`` with what has been ``touched`` (s,) since."""
        if not self.sticks:
            return None
        return np.where(touched & ~self.bonded, u[self.nodes, 0], self.held_at_m)
