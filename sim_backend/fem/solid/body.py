"""A solid body, ready for Newton: wedges, materials, lumens, support and the finger over it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.solid.finger import SolidFinger
from sim_backend.fem.solid.forces import Faces
from sim_backend.fem.solid.linear import LinearSolver
from sim_backend.fem.solid.prism import Wedges


@dataclass(frozen=True)
class Body:
    """``shear`` and ``bulk`` (m,) [Pa] per wedge; ``fixed`` displacement numbers are zero.

    ``surface`` (s,) are the nodes that the finger may touch. ``leaning`` are averages of
    displacements that springs fix, as (stiffness [N/m], weights (3n,)): a block slides on its
    support, but not on average. ``share`` is the part of the whole body that is modelled, by
    symmetry.
    ``contact_m`` is the element size in the contact, ``tissue_pa`` the modulus there: together they
    scale contact stiffness and tolerances. ``prism`` are the section's nodes (c, 2) and the planes
    (p,) along z that were extruded, [m], before lumps were bent: n = p c. ``thrust`` (3n,) [m2] are
    forces per lumen pressure.
    """

    wedges: Wedges
    region: Ints
    shear: Array
    bulk: Array
    fixed: Ints
    lumens: tuple[Faces, ...]
    surface: Ints
    leaning: tuple[tuple[float, Array], ...]
    finger: SolidFinger
    share: float
    contact_m: float
    tissue_pa: float
    prism: tuple[Array, Array]
    thrust: Array

    @property
    def size(self) -> int:
        return 3 * len(self.wedges.nodes)

    @cached_property
    def free(self) -> Ints:
        """Displacement numbers that are solved for."""
        free = np.zeros(self.size, dtype=bool)
        free[self.wedges.dofs] = True
        free[self.fixed] = False
        return np.flatnonzero(free)

    @property
    def contact_dofs(self) -> Ints:
        return 3 * self.surface[:, None] + np.arange(3)

    def solver(self) -> LinearSolver:
        """Groups of blocks: wedges, each lumen's faces, the surface."""
        groups = [self.wedges.cells, *(f.nodes for f in self.lumens), self.surface[:, None]]
        return LinearSolver(self.wedges.nodes, groups, self.fixed, list(self.leaning))
