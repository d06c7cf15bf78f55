"""A solid body: wedges, materials, lumens, support and the finger over it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sim_backend.arrays import Array, Blocks, Ints
from sim_backend.fem.assembly import gather
from sim_backend.fem.body import Body, BondedAt, Rules
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.elastic_foundation import simpson
from sim_backend.fem.contact.lumen_self_contact import Walls, nearest_walls, wall_gaps, walls_along
from sim_backend.fem.contact.pairs import ContactPairs, node_dofs, rigid_pairs
from sim_backend.fem.field import Field
from sim_backend.fem.mesh import TISSUE
from sim_backend.fem.solid.finger import SolidFinger
from sim_backend.fem.solid.forces import (
    Faces,
    forces,
    smallest_volume_ratio,
    tangents,
    unit_pressure,
)
from sim_backend.fem.solid.linear import LinearSolver
from sim_backend.fem.solid.prism import Wedges
from sim_backend.scene.indenter.profile import Profile

SIDE_NODES = 9
"""Of a lumen's face round it: three of a side times three planes."""
ITERATIONS, CAREFUL_ITERATIONS, MIN_STEP = 15, 30, 1 / 64
"""A soft wall filled from 80 mmHg to where it bursts takes up to 22 careful iterations where there
is an equilibrium. The shortest step says a limit pressure to a hundredth of the change asked for:
shorter ones, and more iterations, took minutes and found none."""
FIRST_TOUCH, STEP = 0.07, 0.11
"""First depth on the way down, where single nodes come into contact, and the longest step from
there, over the finger's smaller half width: of 0.14 one in three crushed elements or stayed
indefinite, and was halved after all."""
INDEFINITE = 3
"""Negative pivots, summed over the iterations, above which a step is taken in halves, down to the
shortest that is taken carefully. Of 13 presses (12 random ones) nine steps met two or more at once,
and none of them converged; the one that met a single one did. Factors that serve again count
again."""
PENALTY = 100.0
"""Contact stiffness over modulus times element size: each iteration leaves about 1 / PENALTY of a
gap, and factors of an earlier contact still precondition well."""
CLOSED_SHARE = 1e-5
"""Largest gap left where contact is, over the element size."""
TOLERANCE = 1e-6
"""Residual over the sum of contact forces."""
ON_THE_WAY = 1e4
"""How many times the gap and the residual may be left where a load is only passed, on the way down
or by a step that was halved: a tenth of an element, and 1 % of the contact's force. The three
presses of `linear.RELATIVE` take 70 Newton steps, with 1e2 74 and with 1 80."""


@dataclass(frozen=True)
class SolidBody:
    """``shear`` and ``bulk`` (m,) [Pa] per wedge; ``fixed`` displacement numbers are zero.

    ``surface`` (s,) are the nodes that the finger may touch. ``leaning`` are averages of
    displacements that springs fix, as (stiffness [N/m], weights (3n,)): a block slides on its
    support, but not on average. ``share`` is the part of the whole body that is modelled, by
    symmetry.
    ``contact_m`` is the element size in the contact, ``tissue_pa`` the modulus there: together they
    scale contact stiffness and tolerances. ``prism`` are the section's nodes (c, 2) and the planes
    (p,) along z that were extruded, [m], before lumps were bent: n = p c. ``thrust`` (3n,) [m2] are
    forces per lumen pressure. What a ``bonded`` finger touches sticks to it; ``skin_m`` is the
    thickness of its skin, 0 without one.
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
    bonded: bool = False
    skin_m: float = 0.0
    skin_m_per_pa: float = 0.0
    self_contact: bool = False

    @property
    def nodes(self) -> Array:
        return self.wedges.nodes

    @property
    def size(self) -> int:
        return 3 * len(self.wedges.nodes)

    @property
    def outline(self) -> Profile:
        return self.finger.profile

    @property
    def lone(self) -> bool:
        return False

    @cached_property
    def free(self) -> Ints:
        free = np.zeros(self.size, dtype=bool)
        free[self.wedges.dofs] = True
        free[self.fixed] = False
        return np.flatnonzero(free)

    @cached_property
    def rules(self) -> Rules:
        stiffness = self.tissue_pa * self.contact_m
        # displacements that are continued do not keep volumes
        return Rules(
            penalty=PENALTY * stiffness,
            complementarity=stiffness,
            closed_m=CLOSED_SHARE * self.contact_m,
            tolerance=TOLERANCE,
            least_force=1e-6 * stiffness * self.contact_m,
            pressure_area=self.contact_m**2,
            step=STEP,
            first_touch=FIRST_TOUCH,
            norm=2,
            iterations=ITERATIONS,
            careful_iterations=CAREFUL_ITERATIONS,
            push_m=self.contact_m,
            min_step=MIN_STEP,
            indefinite=INDEFINITE,
            on_the_way=ON_THE_WAY,
            extrapolates=False,
            always_judged=False,
        )

    @cached_property
    def valence(self) -> Array:
        return np.bincount(self.wedges.dofs.ravel(), minlength=self.size).astype(float)

    @cached_property
    def with_self_contact(self) -> "SolidBody":
        return replace(self, self_contact=True)

    @cached_property
    def linear(self) -> LinearSolver:
        """Groups of blocks: wedges, each lumen's faces; then what may touch: the surface, what
        rests on the support, the walls of lumens that may close."""
        touching = [self.surface[:, None], np.empty((0, 1), dtype=np.int64)]
        around = [w.nodes[None] for w in self.walls] if self.self_contact else []
        groups = [self.wedges.cells, *(f.nodes for f in self.lumens), *touching]
        return LinearSolver(self.wedges.nodes, groups, self.fixed, list(self.leaning), around)

    @cached_property
    def walls(self) -> tuple[Walls, ...]:
        """The walls of lumens in each plane of nodes across them, which meet when these close."""
        round_it = [f.nodes for f in self.lumens if f.nodes.shape[1] == SIDE_NODES]
        paths = [nodes.reshape(-1, 3) for nodes in round_it]
        return tuple(w for path in paths for w in walls_along(path, self.nodes))

    @cached_property
    def surface_share_m2(self) -> Array:
        """Area (s,) [m2] of the surface whose even pressure is a node's force, at rest: nodes of a
        quadratic side carry a sixth, two thirds and a sixth of what acts on it."""
        section, planes = self.prism
        top = self.surface[self.surface < len(section)]
        across = top[np.argsort(section[top, 0])]
        share = np.zeros((len(planes), len(section)))
        share[:, across] = np.outer(simpson(planes), simpson(section[across, 0]))
        return np.asarray(share.ravel()[self.surface])

    def forces(
        self, u: Array, pressure_pa: float, change: Array | None = None, rough: bool = False
    ) -> tuple[Array, Callable[[], list[Blocks]]]:
        wedges = self.wedges
        residual = gather(self.size, wedges.dofs, forces(wedges, self.shear, self.bulk, u))
        residual -= pressure_pa * self.thrust
        blocks = []
        for faces in self.lumens:
            unit, turning = unit_pressure(faces, wedges.nodes + u)
            residual -= gather(self.size, faces.dofs, pressure_pa * unit)
            blocks.append(-pressure_pa * turning)
        for stiffness, weight in self.leaning:
            residual += stiffness * float(weight @ u.ravel()) * weight
        return residual, lambda: [
            tangents(wedges, self.shear, self.bulk, u, change, rough),
            *blocks,
        ]

    def bonds(self, bonded_at_m: BondedAt) -> tuple[BondedContact, ...]:
        at_finger = bonded_at_m[0]
        return (BondedContact(self.surface, at_finger, self.bonded, self.rules.penalty, 3),)

    def contact_pairs(
        self, u: Array, depth_m: float, bonds: Sequence[BondedContact] = ()
    ) -> list[ContactPairs]:
        place = self.nodes + u
        gap, normal, hessian = self.finger.lowered_by(depth_m).gap(place[self.surface])
        held = bonds[0].bonded if bonds else None
        dofs = node_dofs(self.surface, 3)
        finger = rigid_pairs(gap, normal, dofs, bonded=held, hessian=hessian)
        if self.skin_m:
            finger = replace(finger, compliance=self.skin_m_per_pa / self.surface_share_m2)
        nothing = rigid_pairs(np.empty(0), np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
        pairs = [finger, nothing]
        for both in self.walls if self.self_contact else ():
            gap, gradient = wall_gaps(both, place[both.nodes, :2])
            across = np.moveaxis(gradient.reshape(len(gap), -1, 2), 2, 1)
            along = np.zeros((len(gap), 1, len(both.nodes)))
            by_direction = np.concatenate([across, along], axis=1).reshape(len(gap), -1)
            pairs.append(rigid_pairs(gap, by_direction, both.dofs))
        return pairs

    def walls_cross(self, u: Array) -> bool:
        place = (self.nodes + u)[:, :2]
        return any(nearest_walls(both, place[both.nodes]).gap.min() < 0 for both in self.walls)

    def smallest_volume_ratio(self, u: Array) -> tuple[float, int]:
        return smallest_volume_ratio(self.wedges, u)

    def least_volume_ratio(self, u: Array) -> float:
        return smallest_volume_ratio(self.wedges, u)[0]

    def where(self, cell: int) -> str:
        x, y, z = 1e3 * self.nodes[self.wedges.cells[cell]].mean(axis=0)
        return f"at x = {x:.2f} mm, z = {z:.2f} mm, {y:.2f} mm above the support"

    def in_vessel(self, cell: int) -> bool:
        return bool(self.lumens) and bool(self.region[cell] != TISSUE)

    def carried(self, values: Array, fine: Body) -> Array:
        """Linear between nodes of the sections and between planes."""
        assert isinstance(fine, SolidBody)
        section, planes = self.prism
        at_section, at_planes = fine.prism
        count, k = len(section), values.shape[1]
        columns = np.moveaxis(values.reshape(len(planes), count, k), 0, 1).reshape(count, -1)
        along = Field(section, columns)(at_section).reshape(len(at_section), len(planes), k)
        above = np.clip(np.searchsorted(planes, at_planes), 1, len(planes) - 1)
        share = (at_planes - planes[above - 1]) / (planes[above] - planes[above - 1])
        share = np.clip(share, 0.0, 1.0)[:, None]
        placed = (1 - share) * along[:, above - 1] + share * along[:, above]
        return np.asarray(np.moveaxis(placed, 1, 0).reshape(-1, k))
