"""Bodies to test elements on: a mesh of six-node triangles of any outline, and Newton's method."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.core.arrays import Array, Ints
from sim_backend.fem.assembly import Assembly, gather
from sim_backend.fem.contact.finger_gaps import Finger
from sim_backend.fem.elements import as_element
from sim_backend.fem.internal import forces_and_tangents
from sim_backend.fem.lumen import lumen_sides, unit_pressure
from sim_backend.fem.material import moduli
from sim_backend.fem.mesh import Mesh
from sim_backend.fem.section import Section
from sim_backend.fem.support import SlidingConstraint
from sim_backend.scene.indenter.profile import Profile

Map = Callable[[Array], Array]


def grid(nx: int, ny: int, shape: Map, *, pressed: str = "", wild: float = 0.0) -> Mesh:
    """The unit square, 2 nx ny triangles, taken through ``shape`` (n, 2) -> (n, 2).

    Mid-side nodes go through ``shape`` too, so outlines may be curved. ``wild`` moves inner nodes
    at random by that share of a cell. The side ``pressed`` (left, right) is a lumen's.
    """
    nx2, ny2 = 2 * nx + 1, 2 * ny + 1
    r, s = np.meshgrid(np.linspace(0, 1, nx2), np.linspace(0, 1, ny2), indexing="ij")
    points = np.column_stack([r.ravel(), s.ravel()])
    number = np.arange(nx2 * ny2).reshape(nx2, ny2)
    cells = []
    for i in range(0, nx2 - 2, 2):
        for j in range(0, ny2 - 2, 2):
            n = number[i : i + 3, j : j + 3]
            if ((i + j) // 2) % 2:
                cells.append([n[0, 0], n[2, 0], n[0, 2], n[1, 0], n[1, 1], n[0, 1]])
                cells.append([n[2, 2], n[0, 2], n[2, 0], n[1, 2], n[1, 1], n[2, 1]])
            else:
                cells.append([n[0, 0], n[2, 0], n[2, 2], n[1, 0], n[2, 1], n[1, 1]])
                cells.append([n[0, 0], n[2, 2], n[0, 2], n[1, 1], n[1, 2], n[0, 1]])
    inner = np.all((points > 1e-9) & (points < 1 - 1e-9), axis=1)
    shift = np.random.default_rng(1).uniform(-1, 1, points.shape) * wild / np.array([nx, ny])
    nodes = shape(points + inner[:, None] * shift)
    cell = np.array(cells)
    lumens = ()
    if pressed:
        edge = number[0] if pressed == "left" else number[-1]
        lumens = (_turned(cell, edge),)
    none = np.empty(0, dtype=np.int64)
    return Mesh(
        nodes, cell, np.zeros(len(cell), np.int64), number[:, -1], number[:, 0], none, lumens
    )


def _turned(cells: Ints, edge: Ints) -> Ints:
    """Cells with a side on ``edge``, renumbered in place so that it is side 0-3-1."""
    found = []
    for turn in range(3):
        a, b = cells[:, turn], cells[:, (turn + 1) % 3]
        hit = np.flatnonzero(np.isin(a, edge) & np.isin(b, edge))
        order = [(k + turn) % 3 for k in range(3)]
        cells[hit] = cells[hit][:, order + [3 + k for k in order]]
        found.append(hit)
    return np.sort(np.concatenate(found))


def outline(mesh: Mesh) -> Ints:
    """Nodes of sides that belong to one cell only."""
    k = mesh.cells.shape[1]
    corners = 3 if k == 6 else 4
    a, b = mesh.cells[:, :corners], np.roll(mesh.cells[:, :corners], -1, axis=1)
    ends = np.sort(np.stack([a, b], axis=2), axis=2).reshape(-1, 2)
    middle = mesh.cells[:, corners:] if k > 4 else a
    _, first, times = np.unique(ends, axis=0, return_index=True, return_counts=True)
    lone = first[times == 1]
    return np.unique(np.concatenate([ends[lone].ravel(), middle.ravel()[lone]]))


@dataclass(frozen=True)
class Body:
    """A section that nothing holds but ``fixed`` displacement numbers."""

    section: Section

    @property
    def nodes(self) -> Array:
        return self.section.mesh.nodes

    def residual(self, u: Array, pressure_pa: float = 0.0) -> Array:
        force, _ = forces_and_tangents(self.section, u)
        total = gather(self.section.size, self.section.cells.dofs, force)
        for sides in self.section.lumens:
            unit, _ = unit_pressure(sides, u)
            total -= pressure_pa * gather(self.section.size, sides.dofs, unit)
        return total

    def stiffness(self, u: Array) -> Array:
        """Dense (2n, 2n) tangent of the cells."""
        _, tangent = forces_and_tangents(self.section, u)
        dofs = self.section.cells.dofs
        k = np.zeros((self.section.size,) * 2)
        for d, t in zip(dofs, tangent, strict=True):
            k[np.ix_(d, d)] += t
        return k

    def solve(
        self, fixed: Ints, start: Array, load: Array, pressure_pa: float = 0.0, iterations: int = 12
    ) -> Array:
        """Displacements (n, 2) in equilibrium with ``load`` (2n,); ``fixed`` stay as at start."""
        groups = [self.section.cells.dofs, *(s.dofs for s in self.section.lumens)]
        assembly = Assembly(self.section.size, groups, fixed, unsymmetric=range(1, len(groups)))
        u = start.copy()
        for _ in range(iterations):
            _, tangent = forces_and_tangents(self.section, u)
            turning = [-pressure_pa * unit_pressure(s, u)[1] for s in self.section.lumens]
            residual = self.residual(u, pressure_pa) - load
            change = assembly.factor([tangent, *turning]).solve(-residual)
            u += change.reshape(-1, 2)
            if np.abs(change).max() < 1e-9 * np.abs(u).max():
                return u
        raise AssertionError("Newton's method did not converge")


def body(
    mesh: Mesh,
    element: str,
    *,
    modulus_pa: float = 50e3,
    poisson: float = 0.45,
    plane: str = "strain",
) -> Body:
    made, cells = as_element(mesh, element)
    g, k = moduli(modulus_pa, poisson)
    shear, bulk = np.full(len(made.cells), g), np.full(len(made.cells), k)
    free = plane == "stress"
    sides = lumen_sides(made, cells, shear, bulk, free)
    none = np.empty(0, dtype=np.int64)
    loose = SlidingConstraint(none[None], np.empty(0), 0.0)
    finger = Finger(Profile(((0.0, 0.0),), 1.0), 0.0, 10.0)
    return Body(Section(made, cells, shear, bulk, free, none, sides, finger, modulus_pa, loose))


def dofs(nodes: Ints) -> Ints:
    return np.stack([2 * nodes, 2 * nodes + 1], axis=1).ravel()
