"""A solid body, ready for Newton: wedges, materials, lumens, support and the finger over it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.solid.dissection import nested_dissection
from sim_backend.fem.solid.finger import SolidFinger
from sim_backend.fem.solid.forces import Faces
from sim_backend.fem.solid.linear import LinearSolver
from sim_backend.fem.solid.prism import Wedges


@dataclass(frozen=True)
class Body:
    """``shear`` and ``bulk`` (m,) [Pa] per wedge; ``held`` displacement numbers are zero.

    ``surface`` (s,) are the nodes that the finger may touch. ``leaning`` are averages of
    displacements that are held, as (stiffness [N/m], weights (3n,)): a block slides on its support,
    but not on average. ``share`` is the part of the whole body that is modelled, by symmetry.
    ``contact_m`` is the element size in the contact, ``tissue_pa`` the modulus there: together they
    scale contact stiffness and tolerances.
    """

    wedges: Wedges
    region: Ints
    shear: Array
    bulk: Array
    held: Ints
    lumens: tuple[Faces, ...]
    surface: Ints
    leaning: tuple[tuple[float, Array], ...]
    finger: SolidFinger
    share: float
    contact_m: float
    tissue_pa: float

    @property
    def size(self) -> int:
        return 3 * len(self.wedges.nodes)

    @cached_property
    def free(self) -> Ints:
        """Displacement numbers that are solved for, in the order of elimination."""
        used = np.zeros(len(self.wedges.nodes), dtype=bool)
        used[self.wedges.cells] = True
        nodes = np.flatnonzero(used)
        number = np.cumsum(used) - 1
        order = nodes[nested_dissection(self.wedges.nodes[nodes], number[self.wedges.cells])]
        dofs = (3 * order[:, None] + np.arange(3)).ravel()
        held = np.zeros(self.size, dtype=bool)
        held[self.held] = True
        return np.asarray(dofs[~held[dofs]])

    @property
    def contact_dofs(self) -> Ints:
        return 3 * self.surface[:, None] + np.arange(3)

    def solver(self) -> LinearSolver:
        """Groups of blocks: wedges, each lumen's faces, the surface."""
        groups = [self.wedges.dofs, *(f.dofs for f in self.lumens), self.contact_dofs]
        return LinearSolver(self.size, groups, self.free, list(self.leaning))
