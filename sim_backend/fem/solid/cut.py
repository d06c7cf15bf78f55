"""A solid cut across its vessels under the finger, at z = 0, as pictures show it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.newton import Solution
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.courses import QUARTERS
from sim_backend.fem.solid.stress import von_mises_at_nodes


@dataclass(frozen=True)
class Cut:
    """The mesh's nodes at z = 0, of which `numbers` (n,) are the body's."""

    body: SolidBody

    @cached_property
    def _above(self) -> Ints:
        """The wedges that stand on the cut (m,)."""
        section, planes = self.body.prism
        lowest = self.body.wedges.cells[:, :6].min(axis=1) // len(section)
        return np.flatnonzero(lowest == np.argmin(np.abs(planes)))

    @cached_property
    def numbers(self) -> Ints:
        return np.unique(self.body.wedges.cells[self._above, :6])

    @cached_property
    def _faces(self) -> Ints:
        """Six nodes of each triangle (m, 6), counted in `numbers`."""
        return np.searchsorted(self.numbers, self.body.wedges.cells[self._above, :6])

    @property
    def nodes_m(self) -> Array:
        """Where they are at rest (n, 2) [m]."""
        return self.body.wedges.nodes[self.numbers, :2]

    @property
    def triangles(self) -> Ints:
        """Each six-node triangle as four (4 m, 3)."""
        return np.vstack([self._faces[:, list(quarter)] for quarter in QUARTERS])

    def displacement_m(self, solution: Solution) -> Array:
        """Within the cut (n, 2) [m]."""
        return solution.displacement[self.numbers, :2]

    def von_mises_pa(self, solution: Solution) -> Array:
        """Von Mises stress (n,) [Pa]: the mean over each node's wedges of F there."""
        stress = von_mises_at_nodes(self.body, solution.displacement, self._above)[:, :6]
        times = np.bincount(self._faces.ravel())
        return np.asarray(np.bincount(self._faces.ravel(), stress.ravel()) / times)
