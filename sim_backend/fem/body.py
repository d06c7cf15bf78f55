"""What Newton's method asks of a body, whatever its kind: section, body of revolution, solid.

A new kind of body brings this and no Newton of its own. Its dimension d is that of its nodes'
displacements; forces are per length across a plane section [N/m], and [N] elsewhere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np

from sim_backend.arrays import Array, Blocks, Ints
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.pairs import ContactPairs
from sim_backend.scene.indenter.profile import Profile

BondedAt = tuple[Array | None, ...]
"""Displacements at which finger and support hold what sticks to them, as `BondedContact.at_m`."""


class Tangent(NamedTuple):
    """Blocks (m, d, d) of each group of the matrix, in the assembly's order: of the ``body``,
    then of what may touch its ``springs`` and its normals' ``turning``."""

    body: list[Blocks]
    springs: list[Array]
    turning: list[Array]

    @property
    def blocks(self) -> list[Blocks]:
        """One array per group."""
        return [*self.body, *(s + t for s, t in zip(self.springs, self.turning, strict=True))]


class LinearSolver(Protocol):
    """Solves with a tangent. Raises `sim_backend.fem.assembly.SingularMatrix`."""

    @property
    def exact(self) -> bool:
        """Whether it solves to rounding, in double precision."""
        ...

    @property
    def negative(self) -> int:
        """Negative pivots of the factors of the last `solve`."""
        ...

    def linearise(self, tangent: Tangent, *, careful: bool, rough: bool) -> None:
        """The tangent of the next solves: where ``careful``, one without negative pivots if
        leaving out the turning makes it so; a ``rough`` one's factors serve no other."""
        ...

    def step(self, force: Array, enough: float) -> Array:
        """Displacements (size,) under a ``force`` (size,), of which ``enough`` may be left."""
        ...

    def is_stable(self, tangent: Tangent) -> bool | None:
        """Whether no eigenvalue is negative; None where the factors do not decide."""
        ...

    def releasing(self, tangent: Tangent) -> Array | None:
        """A displacement (size,) along which an unstable body moves; None where none is found."""
        ...

    def times(self, tangent: Tangent, u: Array) -> Array:
        """The tangent times displacements (size,)."""
        ...


@dataclass(frozen=True)
class Rules:
    """How Newton's method solves a kind of body. `sim_backend.fem.section` and
    `sim_backend.fem.solid.body` say where the numbers are from.

    ``penalty`` is the contact springs' stiffness; ``complementarity`` weighs a gap against a
    multiplier; ``closed_m`` is the largest gap left. A residual may be ``tolerance`` times the
    contact forces and ``least_force`` and the pressure over ``pressure_area``. ``indefinite``
    negative pivots in all are borne; ``chords`` steps may take an earlier tangent; loads that
    are only passed may miss ``on_the_way`` times as much. ``min_step`` is the shortest share of
    the way from one load to the next. ``careful_iterations`` is 0 where no step is ever taken
    with a line search; ``push_m`` is the displacement by which an unstable state is then left,
    over `continuation.PUSHES`. On the way down single nodes come into contact at ``first_touch``,
    and no ``step`` from there is longer, both over the finger's half width.
    """

    penalty: float
    complementarity: float
    closed_m: float
    tolerance: float
    least_force: float
    pressure_area: float
    step: float
    first_touch: float = 0.0
    norm: float = np.inf
    iterations: int = 25
    careful_iterations: int = 0
    push_m: float = 0.0
    chords: int = 0
    indefinite: float = np.inf
    min_step: float = 1 / 256
    on_the_way: float = 1.0
    extrapolates: bool = True
    always_judged: bool = True


class Body(Protocol):
    """A meshed elastic body with its support and the finger over it."""

    @property
    def nodes(self) -> Array:
        """(n, d) [m], undeformed."""
        ...

    @property
    def size(self) -> int:
        """Number of displacements, n d."""
        ...

    @property
    def fixed(self) -> Ints:
        """Displacement numbers that are zero."""
        ...

    @property
    def free(self) -> Ints:
        """Displacement numbers that are solved for."""
        ...

    @property
    def rules(self) -> Rules: ...

    @property
    def share(self) -> float:
        """The part of the body that is modelled, by symmetry."""
        ...

    @property
    def lumens(self) -> Sequence[object]:
        """What pressure acts on."""
        ...

    @property
    def surface(self) -> Ints:
        """Nodes (s,) that the finger may touch."""
        ...

    @property
    def skin_m(self) -> float:
        """Thickness of the finger's skin; 0 without one."""
        ...

    @property
    def bonded(self) -> bool:
        """Whether what the finger touches sticks to it."""
        ...

    @property
    def outline(self) -> Profile:
        """The finger's, across the vessels."""
        ...

    @property
    def contact_m(self) -> float:
        """Element size in the contact [m]."""
        ...

    @property
    def valence(self) -> Array:
        """How many cells each displacement (size,) belongs to."""
        ...

    @property
    def self_contact(self) -> bool:
        """Whether walls of lumens are among the pairs that may touch."""
        ...

    @property
    def with_self_contact(self) -> Self: ...

    @property
    def linear(self) -> LinearSolver: ...

    def forces(
        self, u: Array, pressure_pa: float, change: Array | None = None, rough: bool = False
    ) -> tuple[Array, Callable[[], list[Blocks]]]:
        """Residual (size,) without contact at displacements ``u`` (n, d), and what forms its
        tangent blocks.

        ``change`` is the Newton step that led to ``u``; a ``rough`` guess has no true changes of
        volume.
        """
        ...

    def bonds(self, bonded_at_m: BondedAt) -> tuple[BondedContact, ...]:
        """What finger and support hold along themselves."""
        ...

    def contact_pairs(
        self, u: Array, depth_m: float, bonds: Sequence[BondedContact] = ()
    ) -> list[ContactPairs]:
        """Finger, support, then walls of lumens that may close, as in the assembly's groups."""
        ...

    def walls_cross(self, u: Array) -> bool:
        """Whether walls of a lumen have passed through each other."""
        ...

    @property
    def lone(self) -> bool:
        """Whether there is a vessel and no tissue."""
        ...

    def least_volume_ratio(self, u: Array) -> float:
        """The smallest det F."""
        ...

    def smallest_volume_ratio(self, u: Array) -> tuple[float, int]:
        """The smallest det F and the cell where it is."""
        ...

    def where(self, cell: int) -> str:
        """Where a cell is, for a person."""
        ...

    def in_vessel(self, cell: int) -> bool:
        """Whether a cell is of the wall of a vessel, or of what narrows it."""
        ...

    def carried(self, values: Array, fine: "Body") -> Array:
        """Nodal ``values`` (n, k) at the nodes of a body of the same kind and scene."""
        ...


AnyBody = TypeVar("AnyBody", bound=Body)
