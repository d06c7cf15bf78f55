"""Equilibrium under finger and lumen pressure: Newton with the exact tangent and an active set.

Contact is a semismooth Newton (Hintermueller, Ito and Kunisch 2003): a node is active while its
multiplier outweighs its gap. The contact stiffness only sets how fast gaps close; at the solution
gaps and multipliers are exact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array, Bools
from sim_backend.fem.assembly import Factors, SingularMatrix, gather
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.elastic_foundation import MAX_STRAIN
from sim_backend.fem.contact.finger_gaps import Finger
from sim_backend.fem.contact.pairs import ContactPairs
from sim_backend.fem.internal import internal_forces, least_area_ratio
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.model import Section
from sim_backend.fem.section_pairs import contact_pairs

MAX_ITERATIONS = 25
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
PAIRS_WITH_OPEN_LUMENS = 2
"""Groups of contact pairs while all lumens are open: finger and support."""
MIN_AREA_RATIO = 0.02
"""Smallest det F accepted."""


class CannotSolve(RuntimeError):
    """No equilibrium was found; ``limit`` names the physics that ended it.

    Examples
    --------
    >>> import palpate
    >>> lone = palpate.load_scene("HAOT")
    >>> wall = lone.inclusion[0].model_copy(update={"modulus_kpa": 5.0})
    >>> soft = lone.model_copy(update={"inclusion": (wall,)})
    >>> palpate.press(soft, x_mm=32.0, depth_mm=0.5, pressures_mmhg=[1000.0])
    Traceback (most recent call last):
    sim_backend.fem.newton.CannotSolve: found no equilibrium above ...
    """

    def __init__(self, limit: str, message: str) -> None:
        super().__init__(limit, message)
        self.limit, self.message = limit, message

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True)
class Load:
    """How deep the finger is [m] and the pressure in every lumen [Pa]."""

    depth_m: float
    pressure_pa: float

    def between(self, other: "Load", share: float) -> "Load":
        return Load(
            self.depth_m + share * (other.depth_m - self.depth_m),
            self.pressure_pa + share * (other.pressure_pa - self.pressure_pa),
        )

    def change_from(self, other: "Load") -> Array:
        """(2,): by how much depth [m] and pressure [Pa] are above the other's."""
        return np.array([self.depth_m - other.depth_m, self.pressure_pa - other.pressure_pa])


@dataclass(frozen=True)
class Solution:
    """Displacements (n, 2) [m]; ``multiplier`` [N/m]: contact forces, one array per `ContactPairs`;
    ``force_n_per_m`` is what the finger feels, per length across the section. ``bonded_at_m``
    are the displacements along x at which a bonded finger holds the surface (s,), and a bonded
    support what rests on it (r,); NaN elsewhere, None where nothing has touched yet. ``stable``:
    the tangent has no negative pivot."""

    load: Load
    displacement: Array
    multiplier: tuple[Array, ...]
    force_n_per_m: float
    iterations: int
    bonded_at_m: tuple[Array | None, ...] = (None, None)
    stable: bool = True


class NotConverged(Exception):
    """This step did not converge; the text says why."""


class Unstable(NotConverged):
    """The equilibrium is unstable, and none that is stable was found beside it."""


class SkinPressedFlat(NotConverged):
    """The finger's skin gave way further than its stiffness is known."""


def as_solved(section: Section, solution: Solution) -> Section:
    """The section that ``solution`` belongs to: its lumens may have closed."""
    return (
        section.with_self_contact if len(solution.multiplier) > PAIRS_WITH_OPEN_LUMENS else section
    )


def equilibrium(section: Section, start: Solution, load: Load, drag_pa: float = 0.0) -> Solution:
    """The equilibrium at ``load``, in one step from ``start``. Raises `NotConverged`.

    With ``drag_pa`` every node is dragged back to where it started, by so much for each cell that
    it belongs to.
    """
    finger = _lowered(section, load)
    u, multiplier = start.displacement.copy(), list(start.multiplier)
    bonds = _bonds(section, start)
    before: list[Bools] = []
    change: Array | None = None
    factors: Factors | None = None
    fresh = True
    error = 0.0
    for iteration in range(1, MAX_ITERATIONS + 1):
        pairs = contact_pairs(section, finger, u, bonds)
        active = [
            t.active(m, COMPLEMENTARITY * section.tissue_pa)
            for t, m in zip(pairs, multiplier, strict=True)
        ]
        if iteration == 1:
            active[0] = _first_active(pairs[0], multiplier[0], active[0])
        multiplier = [np.where(a, m, 0.0) for m, a in zip(multiplier, active, strict=True)]
        with np.errstate(invalid="ignore", over="ignore"):
            residual, tangents = _body(section, u, load.pressure_pa, change)
        if not np.all(np.isfinite(residual)):
            raise NotConverged("elements were crushed")
        if drag_pa:
            residual += drag_pa * section.valence * (u - start.displacement).ravel()
        for t, m in zip(pairs, multiplier, strict=True):
            t.add_force(-m, residual)
        for bond in bonds:
            bond.add_force(u, residual)
        scale = np.abs(multiplier[0]).sum() + load.pressure_pa * 1e-3 + 1e-8 * section.tissue_pa
        residual[section.fixed] = 0.0
        last_error, error = error, float(np.abs(residual).max())
        widest = max(
            float(np.abs(t.open(m)[a]).max(initial=0.0))
            for t, m, a in zip(pairs, multiplier, active, strict=True)
        )
        same = bool(before) and all(map(np.array_equal, active, before))
        if error < TOLERANCE * scale and widest < CLOSED_M and same:
            _refuse_flat_skin(finger, pairs[0], multiplier[0])
            force = -multiplier[0] @ pairs[0].gradient[:, 1]
            bonded_at_m = tuple(
                bond.now_holding(m > 0, u) for bond, m in zip(bonds, multiplier, strict=False)
            )
            found = Solution(load, u, tuple(multiplier), float(force), iteration, bonded_at_m)
            last = factors is None or factors.negative == 0
            return replace(found, stable=last or is_stable(section, found))
        # the last step left about half of what its tangent has changed since; with that tangent
        # once more, this one leaves twice the last one's share
        share = error / last_error * (2 if fresh else 1) if last_error else 1.0
        fresh = not (same and error * share**CHORDS < TOLERANCE * scale)
        if factors is None or fresh:
            matrices = tangents()
            if drag_pa:
                matrices[0] = matrices[0] + drag_pa * np.eye(matrices[0].shape[1])
            # normals turn under the forces as they are, without the springs: so the iteration is
            # Newton's on forces and gaps together, and closes both at second order
            matrices += _contact_blocks(section, pairs, multiplier, active, bonds)
            factors, linearised = _factors(section, matrices), pairs
        springs = [t.stiffness(PENALTY * section.tissue_pa) * t.open(m)
                   for t, m in zip(pairs, multiplier, strict=True)]  # fmt: skip
        for t, s, a in zip(linearised, springs, active, strict=True):  # they close what is open
            t.add_force(np.where(a, s, 0.0), residual)
        multiplier = [
            np.where(a, m - s, 0.0) for m, s, a in zip(multiplier, springs, active, strict=True)
        ]
        change = _step(section, factors, residual, u)
        u += change
        multiplier = [
            np.where(a, m - t.stiffness(PENALTY * section.tissue_pa) * t.opening(change), 0.0)
            for t, m, a in zip(linearised, multiplier, active, strict=True)
        ]
        before = active
    raise NotConverged(f"Newton's method did not converge within {MAX_ITERATIONS} steps")


def _first_active(finger: ContactPairs, multiplier: Array, active: Bools) -> Bools:
    """Nodes (s,) under the finger in a step's first iteration: of those that it newly overlaps,
    the ones that it overlaps by more than half of the most. What overlaps before anything has
    given way is more than what will touch (Johnson 1985, eq. 3.42: a^2 = R d, not 2 R d). And all
    that touched: where the start only guesses how far a surface moved, a third of it is open, and
    let go at once the tissue below would turn inside out."""
    active = active | (multiplier > 0)
    new = active & (multiplier <= 0)
    if not new.any():
        return active
    gap = finger.open(multiplier)
    return np.asarray(active & (~new | finger.bonded | (gap <= 0.5 * float(gap[new].min()))))


def _bonds(section: Section, solution: Solution) -> tuple[BondedContact, BondedContact]:
    """What the finger and what the support hold along x."""
    bonded_at_m = solution.bonded_at_m
    penalty = PENALTY * section.tissue_pa
    return (
        BondedContact(section.mesh.surface, bonded_at_m[0], section.finger.bonded, penalty),
        BondedContact(section.mesh.resting, bonded_at_m[1], section.bonded_support, penalty),
    )


def _contact_blocks(
    section: Section,
    pairs: list[ContactPairs],
    multiplier: Sequence[Array],
    active: list[Bools],
    bonds: tuple[BondedContact, BondedContact],
) -> list[Array]:
    """Tangent blocks of all contact pairs, in the assembly's order."""
    penalty = PENALTY * section.tissue_pa
    blocks = [t.blocks(m, a, penalty) for t, m, a in zip(pairs, multiplier, active, strict=True)]
    return [*(block + bond.blocks for block, bond in zip(blocks, bonds, strict=False)),
            *blocks[len(bonds) :]]  # fmt: skip


def is_stable(section: Section, solution: Solution) -> bool:
    """Whether the tangent at ``solution`` itself has no negative eigenvalue."""
    try:
        return section.assembly.factor(tangent(section, solution)[0]).negative == 0
    except SingularMatrix:
        return False


def _refuse_flat_skin(finger: Finger, pair: ContactPairs, multiplier: Array) -> None:
    """A skin is known only while it is not pressed flat. Raises `SkinPressedFlat`."""
    shortened = float((pair.compliance * multiplier).max(initial=0.0))
    if shortened > MAX_STRAIN * finger.skin_m:
        flat_pct = 100 * shortened / finger.skin_m
        raise SkinPressedFlat(f"the finger's skin is pressed by {flat_pct:.0f} % of its thickness")


def _lowered(section: Section, load: Load) -> Finger:
    return section.finger.lowered_to(section.finger.y - load.depth_m)


def _factors(section: Section, matrices: list[Array]) -> Factors:
    try:
        return section.assembly.factor(matrices)
    except SingularMatrix:
        raise NotConverged("the tangent became singular") from None


def _step(section: Section, factors: Factors, residual: Array, u: Array) -> Array:
    """The change (n, 2), shortened until it turns no element inside out."""
    change = factors.solve(-residual).reshape(-1, 2)
    if not np.all(np.isfinite(change)):
        raise NotConverged("the tangent became singular")
    for _ in range(6):
        if least_area_ratio(section, u + change) > MIN_AREA_RATIO:
            return change
        change = change / 2
    raise NotConverged("elements were crushed")


def tangent(section: Section, solution: Solution) -> tuple[list[Array], Array]:
    """The tangent's blocks at a solution, the contact staying as it is; and those (s, 2, 2) of the
    finger's contact alone."""
    bonds = _bonds(section, solution)
    finger = _lowered(section, solution.load)
    pairs = contact_pairs(section, finger, solution.displacement, bonds)
    active = [(m > 0) | t.bonded for t, m in zip(pairs, solution.multiplier, strict=True)]
    _, tangents = _body(section, solution.displacement, solution.load.pressure_pa)
    contact = _contact_blocks(section, pairs, solution.multiplier, active, bonds)
    finger_only = pairs[0].blocks(solution.multiplier[0], active[0], PENALTY * section.tissue_pa)
    return [*tangents(), *contact], finger_only


def pairs_of(section: Section, load: Load, solution: Solution) -> list[ContactPairs]:
    """The pairs that the displacements of ``solution`` make in another section or load."""
    bonds = _bonds(section, solution)
    return contact_pairs(section, _lowered(section, load), solution.displacement, bonds)


def forces_and_gaps(section: Section, load: Load, solution: Solution) -> tuple[Array, list[Array]]:
    """What is out of balance (2n,) [N/m], and the gaps [m] of each group of pairs to their skins,
    where ``solution`` meets another section or load."""
    residual = body_force(section, solution.displacement, load.pressure_pa)
    gaps = []
    for pairs, m in zip(pairs_of(section, load, solution), solution.multiplier, strict=True):
        pairs.add_force(-m, residual)
        gaps.append(pairs.open(m))
    for bond in _bonds(section, solution):
        bond.add_force(solution.displacement, residual)
    return residual, gaps


def body_force(section: Section, u: Array, pressure_pa: float) -> Array:
    """Residual (2n,) [N/m] of cells, lumens and the sliding constraint, without contact."""
    return _body(section, u, pressure_pa)[0]


def _body(
    section: Section, u: Array, pressure_pa: float, change: Array | None = None
) -> tuple[Array, Callable[[], list[Array]]]:
    """Residual (2n,) of cells and lumens, and what forms their tangent blocks."""
    force, cells = internal_forces(section, u, change)
    residual = gather(section.size, section.cells.dofs, force)
    turnings = []
    for sides in section.lumens:
        unit, turning = unit_pressure(sides, u)
        residual -= gather(section.size, sides.dofs, pressure_pa * unit)
        turnings.append(-pressure_pa * turning)
    residual[section.sliding.dofs] += section.sliding.force(u)
    return residual, lambda: [cells(), *turnings, section.sliding.block]
