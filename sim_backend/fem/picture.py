"""A plane section, or half of one that is turned, as pictures show it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.newton import Solution
from sim_backend.fem.section import Section
from sim_backend.fem.stress import nodal_von_mises

QUARTERS = ([0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5])
HALVES = ([0, 1, 2], [0, 2, 3])


class Picture(Protocol):
    """A cut through a body under the finger: what is drawn of it and of its states."""

    @property
    def nodes_m(self) -> Array:
        """Where its nodes are at rest (n, 2) [m]."""
        ...

    @property
    def triangles(self) -> Ints:
        """Between them (m, 3)."""
        ...

    def displacement_m(self, state: Solution) -> Array:
        """Of the nodes within the cut (n, 2) [m]."""
        ...

    def von_mises_pa(self, state: Solution) -> Array:
        """Von Mises stress (n,) [Pa] at the nodes."""
        ...


@dataclass(frozen=True)
class SectionPicture:
    """The `Picture` of a section."""

    section: Section

    @property
    def nodes_m(self) -> Array:
        return self.section.mesh.nodes

    @property
    def triangles(self) -> Ints:
        """Each six-node cell as four triangles, each quadrilateral as two."""
        cells = self.section.mesh.cells
        return np.vstack([cells[:, c] for c in (QUARTERS if cells.shape[1] == 6 else HALVES)])

    def displacement_m(self, state: Solution) -> Array:
        return state.displacement

    def von_mises_pa(self, state: Solution) -> Array:
        return nodal_von_mises(self.section, state.displacement)
