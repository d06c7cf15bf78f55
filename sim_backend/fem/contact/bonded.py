"""Bonded contact: what has touched the finger, or the support, keeps its place on it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Bools, Ints

ALONG = {2: (0,), 3: (0, 2)}
"""Axes along finger and support, by the number of dimensions."""


@dataclass(frozen=True)
class BondedContact:
    """Springs of stiffness ``penalty`` that hold ``nodes`` (s,) level at ``at_m`` (s, d - 1) of d
    ``dimensions``, NaN where free, None where all are. What does not ``stick`` holds nothing.

    Finger and support do not move level, so bonded nodes keep their place.
    """

    nodes: Ints
    at_m: Array | None
    sticks: bool
    penalty: float
    dimensions: int = 2

    @property
    def _axes(self) -> list[int]:
        return list(ALONG[self.dimensions])

    @cached_property
    def held_at_m(self) -> Array:
        shape = len(self.nodes), len(self._axes)
        return np.full(shape, np.nan) if self.at_m is None else self.at_m

    @cached_property
    def bonded(self) -> Bools:
        """Which nodes (s,) are bonded."""
        return np.isfinite(self.held_at_m[:, 0])

    @property
    def blocks(self) -> Array:
        """Tangent (s, d, d)."""
        level = np.diag(np.isin(np.arange(self.dimensions), self._axes).astype(float))
        return np.asarray(np.where(self.bonded, self.penalty, 0.0)[:, None, None] * level)

    def add_force(self, u: Array, total: Array) -> None:
        """Add to ``total`` (size,) the springs' force at displacements ``u`` (n, d) [m]."""
        slip = np.where(self.bonded[:, None], self._level(u) - self.held_at_m, 0.0)
        dofs = self.dimensions * self.nodes[:, None] + np.array(self._axes)
        total[dofs] += self.penalty * slip

    def now_holding(self, touched: Bools, u: Array) -> Array | None:
        """``at_m`` with what has been ``touched`` (s,) since."""
        if not self.sticks:
            return None
        new = (touched & ~self.bonded)[:, None]
        return np.where(new, self._level(u), self.held_at_m)

    def _level(self, u: Array) -> Array:
        return np.asarray(u[self.nodes][:, self._axes])
