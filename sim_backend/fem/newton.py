"""Equilibrium under finger and lumen pressure: Newton with the exact tangent and an active set.

Contact is a semismooth Newton (Hintermueller, Ito and Kunisch 2003): a node is active while its
multiplier outweighs its gap. The contact stiffness only sets how fast gaps close; at the solution
gaps and multipliers are exact. What differs between kinds of bodies is the body's: see
`sim_backend.fem.body`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array, Bools
from sim_backend.fem.assembly import SingularMatrix
from sim_backend.fem.body import AnyBody, Body, BondedAt, Tangent
from sim_backend.fem.contact.bonded import BondedContact
from sim_backend.fem.contact.elastic_foundation import MAX_STRAIN
from sim_backend.fem.contact.pairs import ContactPairs
from sim_backend.fem.descent import share_of_step

PAIRS_WITH_OPEN_LUMENS = 2
"""Groups of contact pairs while all lumens are open: finger and support."""
MIN_VOLUME_RATIO = 0.02
"""Smallest det F accepted."""
SOLVED = 0.1
"""Share of the residual allowed that an iterative linear solver may leave."""


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
    """Displacements (n, d) [m]; ``multiplier``: contact forces, one array per `ContactPairs`;
    ``force`` is what the finger feels: per length across a section [N/m], the whole finger's [N] in
    space. ``bonded_at_m`` are the displacements along themselves at which a bonded finger and a
    bonded support hold what has touched them, None where nothing has. ``stable``: the tangent
    has no negative pivot; None where that was not asked or is not decided."""

    load: Load
    displacement: Array
    multiplier: tuple[Array, ...]
    force: float
    iterations: int
    bonded_at_m: BondedAt = (None, None)
    stable: bool | None = True

    @property
    def force_n_per_m(self) -> float:
        """`force` of a plane section."""
        return self.force

    @property
    def force_n(self) -> float:
        """`force` of a body in space."""
        return self.force


class NotConverged(Exception):
    """This step did not converge; the text says why."""


class Stalled(NotConverged):
    """Newton's steps went to and fro."""


class Unstable(NotConverged):
    """The equilibrium is unstable, and none that is stable was found beside it."""


class SkinPressedFlat(NotConverged):
    """The finger's skin gave way further than its stiffness is known."""


def unloaded(body: Body) -> Solution:
    """The finger just over the surface, the lumens without pressure."""
    still = np.zeros_like(body.nodes)
    pairs = body.contact_pairs(still, 0.0)
    return Solution(Load(0.0, 0.0), still, tuple(np.zeros(len(t.gap)) for t in pairs), 0.0, 0)


def as_solved(body: AnyBody, solution: Solution) -> AnyBody:
    """The body that ``solution`` belongs to: its lumens may have closed."""
    closed = len(solution.multiplier) > PAIRS_WITH_OPEN_LUMENS
    return body.with_self_contact if closed else body


def equilibrium(
    body: Body,
    start: Solution,
    load: Load,
    *,
    slack: float = 1.0,
    careful: bool = False,
    drag: float = 0.0,
) -> Solution:
    """The equilibrium at ``load``, in one step from ``start``, to ``slack`` times the tolerances.

    With ``careful`` iterations energy falls, to where it is least. With ``drag`` every node is
    dragged back to where it started, by so much for each cell that it belongs to. Raises
    `NotConverged`.
    """
    rules = body.rules
    u, multiplier = start.displacement.copy(), list(start.multiplier)
    bonds = body.bonds(start.bonded_at_m)
    before: list[Bools] = []
    linearised: list[ContactPairs] = []
    change: Array | None = None
    fresh, error, indefinite = True, 0.0, 0
    most = rules.careful_iterations if careful else rules.iterations
    for iteration in range(1, most + 1):
        pairs = body.contact_pairs(u, load.depth_m, bonds)
        active = [
            t.active(m, rules.complementarity) for t, m in zip(pairs, multiplier, strict=True)
        ]
        if iteration == 1:
            active[0] = _first_active(pairs[0], multiplier[0], active[0])
        multiplier = [np.where(a, m, 0.0) for m, a in zip(multiplier, active, strict=True)]
        rough = iteration == 1 and start.iterations == 0
        with np.errstate(invalid="ignore", over="ignore"):
            residual, tangents = body.forces(u, load.pressure_pa, change, rough)
        if not np.all(np.isfinite(residual)):
            raise NotConverged("elements were crushed")
        if drag:
            residual += drag * body.valence * (u - start.displacement).ravel()
        for t, m in zip(pairs, multiplier, strict=True):
            t.add_force(-m, residual)
        for bond in bonds:
            bond.add_force(u, residual)
        residual[body.fixed] = 0.0
        scale = (
            np.abs(multiplier[0]).sum() + load.pressure_pa * rules.pressure_area + rules.least_force
        )
        allowed = slack * rules.tolerance * scale
        last_error, error = error, float(np.linalg.norm(residual, rules.norm))
        widest = max(
            float(np.abs(t.open(m)[a]).max(initial=0.0))
            for t, m, a in zip(pairs, multiplier, active, strict=True)
        )
        same = bool(before) and all(map(np.array_equal, active, before))
        if error < allowed and widest < slack * rules.closed_m and same:
            _refuse_flat_skin(body, pairs[0], multiplier[0])
            force = -float(multiplier[0] @ pairs[0].gradient[:, 1]) / body.share
            bonded_at_m = tuple(
                bond.now_holding(m > 0, u) for bond, m in zip(bonds, multiplier, strict=False)
            )
            found = Solution(load, u, tuple(multiplier), force, iteration, bonded_at_m, None)
            if not rules.always_judged:
                return found
            last = not linearised or body.linear.negative == 0
            return replace(found, stable=last or is_stable(body, found))
        # the last step left about half of what its tangent has changed since; with that tangent
        # once more, this one leaves twice the last one's share
        share = error / last_error * (2 if fresh else 1) if last_error else 1.0
        fresh = not (rules.chords and same and error * share**rules.chords < allowed)
        # normals turn under the forces as they are, without the springs: so the iteration is
        # Newton's on forces and gaps together, and closes both at second order
        pushed = multiplier
        try:
            if not linearised or fresh:
                blocks = tangents()
                if drag:
                    blocks[0] = blocks[0] + drag * np.eye(blocks[0].shape[1])
                blocks_of_contact = _contact_blocks(body, pairs, multiplier, active, bonds)
                body.linear.linearise(
                    Tangent(blocks, *blocks_of_contact), careful=careful, rough=rough
                )
                linearised = pairs
            springs = [t.stiffness(rules.penalty) * t.open(m)
                       for t, m in zip(pairs, multiplier, strict=True)]  # fmt: skip
            for t, s, a in zip(linearised, springs, active, strict=True):  # they close what is open
                t.add_force(np.where(a, s, 0.0), residual)
            change = body.linear.step(-residual, SOLVED * allowed).reshape(u.shape)
        except SingularMatrix:
            raise NotConverged("the tangent became singular") from None
        if not np.all(np.isfinite(change)):
            raise NotConverged("the tangent became singular")
        multiplier = [
            np.where(a, m - s, 0.0) for m, s, a in zip(multiplier, springs, active, strict=True)
        ]
        indefinite += body.linear.negative
        if indefinite > rules.indefinite and not careful:
            raise NotConverged("the tangent stayed indefinite")
        if careful:
            change *= share_of_step(body, load.depth_m, load.pressure_pa, u, change, pushed, bonds)
        change = _not_inside_out(body, u, change)
        u += change
        multiplier = [
            np.where(a, m - t.stiffness(rules.penalty) * t.opening(change), 0.0)
            for t, m, a in zip(linearised, multiplier, active, strict=True)
        ]
        before = active
    raise Stalled(f"Newton's method did not converge within {most} steps")


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


def _contact_blocks(
    body: Body,
    pairs: list[ContactPairs],
    multiplier: Sequence[Array],
    active: list[Bools],
    bonds: Sequence[BondedContact],
) -> tuple[list[Array], list[Array]]:
    """Springs, and turning of the normals, of all contact pairs in the assembly's order."""
    springs = [t.springs(a, body.rules.penalty) for t, a in zip(pairs, active, strict=True)]
    for n, bond in enumerate(bonds):
        springs[n] = springs[n] + bond.blocks
    return springs, [t.turned(m) for t, m in zip(pairs, multiplier, strict=True)]


def _refuse_flat_skin(body: Body, pair: ContactPairs, multiplier: Array) -> None:
    """A skin is known only while it is not pressed flat. Raises `SkinPressedFlat`."""
    shortened = float((pair.compliance * multiplier).max(initial=0.0))
    if shortened > MAX_STRAIN * body.skin_m:
        flat_pct = 100 * shortened / body.skin_m
        raise SkinPressedFlat(f"the finger's skin is pressed by {flat_pct:.0f} % of its thickness")


def _not_inside_out(body: Body, u: Array, change: Array) -> Array:
    """The change (n, d), shortened until it turns no element inside out."""
    for _ in range(6):
        if body.least_volume_ratio(u + change) > MIN_VOLUME_RATIO:
            return change
        change = change / 2
    raise NotConverged("elements were crushed")


def pairs_of(body: Body, load: Load, solution: Solution) -> list[ContactPairs]:
    """The pairs that the displacements of ``solution`` make in a body under a ``load``."""
    bonds = body.bonds(solution.bonded_at_m)
    return body.contact_pairs(solution.displacement, load.depth_m, bonds)


def tangent(body: Body, solution: Solution) -> Tangent:
    """At a solution, the contact staying as it is."""
    bonds = body.bonds(solution.bonded_at_m)
    pairs = pairs_of(body, solution.load, solution)
    active = [(m > 0) | t.bonded for t, m in zip(pairs, solution.multiplier, strict=True)]
    _, tangents = body.forces(solution.displacement, solution.load.pressure_pa)
    return Tangent(tangents(), *_contact_blocks(body, pairs, solution.multiplier, active, bonds))


def forces_and_gaps(body: Body, load: Load, solution: Solution) -> tuple[Array, list[Array]]:
    """What is out of balance (size,), and the gaps [m] of each group of pairs to their skins, where
    ``solution`` meets another body or load."""
    residual, _ = body.forces(solution.displacement, load.pressure_pa)
    gaps = []
    for pairs, m in zip(pairs_of(body, load, solution), solution.multiplier, strict=True):
        pairs.add_force(-m, residual)
        gaps.append(pairs.open(m))
    for bond in body.bonds(solution.bonded_at_m):
        bond.add_force(solution.displacement, residual)
    return residual, gaps


def is_stable(body: Body, solution: Solution) -> bool | None:
    """Whether the tangent has no negative eigenvalue, contact unchanged; None where the factors do
    not decide."""
    return body.linear.is_stable(tangent(body, solution))
