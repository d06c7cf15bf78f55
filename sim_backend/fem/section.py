"""A meshed section as a body: a plane one, or one that turns about x = 0."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sim_backend.arrays import Array, Blocks, Ints
from sim_backend.fem.assembly import Assembly, Factors, SingularMatrix, gather
from sim_backend.fem.body import Body, BondedAt, Rules, Tangent
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.elastic_foundation import surface_share
from sim_backend.fem.contact.finger_gaps import Finger, finger_pairs
from sim_backend.fem.contact.lumen_self_contact import Walls, nearest_walls, wall_gaps, walls
from sim_backend.fem.contact.pairs import ContactPairs, node_dofs, rigid_pairs
from sim_backend.fem.elements import Cells, q4
from sim_backend.fem.field import Field
from sim_backend.fem.internal import internal_forces, least_area_ratio, smallest_area_ratio
from sim_backend.fem.lumen import Sides, unit_pressure
from sim_backend.fem.mesh import TISSUE, Mesh
from sim_backend.fem.support import SlidingConstraint
from sim_backend.scene.indenter.profile import Profile

COMPLEMENTARITY = 1.0
"""Complementarity parameter over the tissue's modulus: weight of a gap against a multiplier."""
PENALTY = 1e4
"""Penalty stiffness over the tissue's modulus: each iteration leaves about 1 / PENALTY of a gap."""
CLOSED_M = 1e-10
"""Largest gap left where contact is: 4e-8 of the usual depth, and of the force."""
TOLERANCE = 1e-7
"""Residual over the sum of contact forces; at 1e-5 the change by a beat was off by 10 %."""
CHORDS = 3
"""Steps that may take an earlier tangent where so many will do: each costs a third of one with a
tangent of its own. With 1, 2, 3 and 4 the stations of TIHA, TISA and TIT take 554, 506, 484 and 459
factorisations in 655, 707, 740 and 784 steps."""
STEP, GENTLE_STEP = 0.2, 0.12
"""Steps of the way down over the finger's half width; the second where the section does not thin
and on lone vessels. To the same forces in 41 presses (benchmarks/random_presses.py) in plane
stress, Newton's method takes 945 steps with 0.6 mm for every finger, 724 with 0.12, 683 with 0.17,
674 with 0.21 and 702 with 0.26. TIHA in plane strain takes 35 with 0.12 and 58 with 0.17."""
FIRST_TOUCH = 0.024
"""First depth over the finger's half width where the section does not thin: nearly incompressible,
it must be touched gently, or single nodes are pressed and steps are halved again and again. TIHA
and TISA in plane strain take 89 factorisations with 0.024, 125 with 0.04."""
INVERSE_ITERATIONS = 12
"""The lowest eigenvalues of a lone vessel lie a factor of ten apart: twelve leave nothing else."""


@dataclass(frozen=True)
class Section:
    """``shear`` and ``bulk`` (m,) [Pa] per cell; ``fixed`` displacement numbers are zero.

    ``tissue_pa`` is the modulus that scales tolerances. Walls inside lumens touch only with
    ``self_contact``: looking for that costs time, and most presses leave lumens open.
    """

    mesh: Mesh
    cells: Cells
    shear: Array
    bulk: Array
    plane_stress: bool
    fixed: Ints
    lumens: tuple[Sides, ...]
    finger: Finger
    tissue_pa: float
    sliding: SlidingConstraint
    self_contact: bool = False
    bonded_support: bool = False

    @property
    def nodes(self) -> Array:
        return self.mesh.nodes

    @property
    def surface(self) -> Ints:
        return self.mesh.surface

    @property
    def size(self) -> int:
        return 2 * len(self.mesh.nodes)

    @property
    def free(self) -> Ints:
        return self.assembly.free

    @property
    def share(self) -> float:
        return 1.0

    @property
    def skin_m(self) -> float:
        return self.finger.skin_m

    @property
    def bonded(self) -> bool:
        return self.finger.bonded

    @property
    def outline(self) -> Profile:
        return self.finger.profile

    @property
    def contact_m(self) -> float:
        between_m = np.diff(np.sort(self.nodes[self.surface, 0])).min()
        return float(between_m) * (1 if self.cells.shape is q4 else 2)

    @property
    def lone(self) -> bool:
        """Whether there is a vessel and no tissue."""
        return not (self.mesh.region == TISSUE).any()

    @cached_property
    def rules(self) -> Rules:
        # nearly incompressible plane strain is not continued: the extrapolated change of volume
        # times the bulk modulus is worse than no guess (with nu = 0.4999 it took four times as
        # many iterations)
        return Rules(
            penalty=PENALTY * self.tissue_pa,
            complementarity=COMPLEMENTARITY * self.tissue_pa,
            closed_m=CLOSED_M,
            tolerance=TOLERANCE,
            least_force=1e-8 * self.tissue_pa,
            pressure_area=1e-3,
            # what a lone vessel rests on sticks: its answer is a little its path's
            step=STEP if self.plane_stress and not self.lone else GENTLE_STEP,
            first_touch=0.0 if self.plane_stress else FIRST_TOUCH,
            chords=CHORDS,
            extrapolates=self.plane_stress or not self.cells.dilatation,
        )

    @cached_property
    def walls(self) -> tuple[Walls, ...]:
        """The walls of each lumen, which meet when it closes."""
        return tuple(walls(self.mesh, sides) for sides in self.lumens)

    @cached_property
    def surface_share_m(self) -> Array:
        """Length (s,) [m] of the surface whose pressure is a node's force, at rest."""
        return surface_share(self.mesh, self.cells)

    @cached_property
    def surface_dofs(self) -> Ints:
        """Displacement numbers (s, 2) of the nodes that a finger can touch."""
        return node_dofs(self.mesh.surface)

    @cached_property
    def resting_dofs(self) -> Ints:
        """Displacement numbers (r, 2) of the nodes that may come to rest on the support."""
        return node_dofs(self.mesh.resting)

    @cached_property
    def upwards(self) -> Array:
        """The support's normal (r, 2) at each of them."""
        return np.tile([0.0, 1.0], (len(self.mesh.resting), 1))

    @cached_property
    def valence(self) -> Array:
        return np.bincount(self.cells.dofs.ravel(), minlength=self.size).astype(float)

    @cached_property
    def with_self_contact(self) -> "Section":
        return replace(self, self_contact=True)

    @cached_property
    def assembly(self) -> Assembly:
        """Groups of blocks: cells, each lumen's sides, the sliding constraint; then what may touch:
        the surface, what rests on the support, the walls of lumens that may close."""
        sides = [s.dofs for s in self.lumens]
        around = [w.dofs for w in self.walls] if self.self_contact else []
        touching = [self.surface_dofs, self.resting_dofs, *around]
        groups = [self.cells.dofs, *sides, self.sliding.dofs, *touching]
        lumens = range(1, 1 + len(sides))
        return Assembly(self.size, groups, self.fixed, unsymmetric=lumens)

    @cached_property
    def linear(self) -> "Direct":
        return Direct(self.assembly)

    def forces(
        self,
        u: Array,
        pressure_pa: float,
        change: Array | None = None,
        rough: bool = False,  # noqa: ARG002
    ) -> tuple[Array, Callable[[], list[Blocks]]]:
        force, cells = internal_forces(self, u, change)
        residual = gather(self.size, self.cells.dofs, force)
        turnings = []
        for sides in self.lumens:
            unit, turning = unit_pressure(sides, u)
            residual -= gather(self.size, sides.dofs, pressure_pa * unit)
            turnings.append(-pressure_pa * turning)
        residual[self.sliding.dofs] += self.sliding.force(u)
        return residual, lambda: [cells(), *turnings, self.sliding.block]

    def bonds(self, bonded_at_m: BondedAt) -> tuple[BondedContact, ...]:
        penalty = self.rules.penalty
        return (
            BondedContact(self.surface, bonded_at_m[0], self.finger.bonded, penalty),
            BondedContact(self.mesh.resting, bonded_at_m[1], self.bonded_support, penalty),
        )

    def contact_pairs(
        self, u: Array, depth_m: float, bonds: Sequence[BondedContact] = ()
    ) -> list[ContactPairs]:
        mesh = self.mesh
        finger = self.finger.lowered_to(self.finger.y - depth_m)
        at_surface = mesh.nodes[mesh.surface] + u[mesh.surface]
        height = mesh.nodes[mesh.resting, 1] + u[mesh.resting, 1]
        held, rests = (bond.bonded for bond in bonds) if bonds else (None, None)
        pairs = [
            finger_pairs(finger, at_surface, self.surface_dofs, self.surface_share_m, held),
            rigid_pairs(height, self.upwards, self.resting_dofs, bonded=rests),
        ]
        for both in self.walls if self.self_contact else ():
            gap, gradient = wall_gaps(both, mesh.nodes[both.nodes] + u[both.nodes])
            pairs.append(rigid_pairs(gap, gradient, both.dofs))
        return pairs

    def walls_cross(self, u: Array) -> bool:
        place = self.nodes + u
        return any(nearest_walls(both, place[both.nodes]).gap.min() < 0 for both in self.walls)

    def smallest_volume_ratio(self, u: Array) -> tuple[float, int]:
        return smallest_area_ratio(self, u)

    def least_volume_ratio(self, u: Array) -> float:
        return least_area_ratio(self, u)

    def where(self, cell: int) -> str:
        x_mm, y_mm = 1e3 * self.nodes[self.cells.nodes[cell]].mean(axis=0)
        across = "x" if self.cells.hoop is None else "r"  # from the axis that a section turns about
        return f"at {across} = {x_mm:.2f} mm, {y_mm:.2f} mm above the support"

    def in_vessel(self, cell: int) -> bool:
        return bool(self.lumens) and bool(self.mesh.region[cell] != TISSUE)

    def carried(self, values: Array, fine: Body) -> Array:
        return Field(self.nodes, values)(fine.nodes)


class Direct:
    """A `sim_backend.fem.body.LinearSolver` by factors of the tangent itself."""

    exact = True

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self._factors: Factors | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Without the factors, which are the solver's own and cannot be kept."""
        return {**self.__dict__, "_factors": None}

    @property
    def negative(self) -> int:
        return self._factors.negative if self._factors else 0

    def linearise(
        self, tangent: Tangent, *, careful: bool = False, rough: bool = False  # noqa: ARG002
    ) -> None:  # fmt: skip
        self._factors = self._assembly.factor(tangent.blocks)

    def step(self, force: Array, enough: float = 0.0) -> Array:  # noqa: ARG002
        assert self._factors is not None
        return self._factors.solve(force)

    def is_stable(self, tangent: Tangent) -> bool | None:
        try:
            self.linearise(tangent)
        except SingularMatrix:
            return False
        return self.negative == 0

    def releasing(self, tangent: Tangent) -> Array | None:
        """The eigenvector (size,) of the eigenvalue nearest to zero, the first to turn negative; by
        inverse iteration (Golub and Van Loan 2013, sec. 7.6.1)."""
        self.linearise(tangent)
        mode, free = np.zeros(self._assembly.size), self._assembly.free
        mode[free] = np.random.default_rng(0).standard_normal(len(free))
        for _ in range(INVERSE_ITERATIONS):
            mode = self.step(mode / np.abs(mode).max())
        return mode

    def times(self, tangent: Tangent, u: Array) -> Array:
        """The tangent times displacements (size,)."""
        return self._assembly.times(tangent.blocks, u)
