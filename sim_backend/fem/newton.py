"""Equilibrium under finger and lumen pressure: Newton with the exact tangent and an active set.

Contact is a semismooth Newton (Hintermueller, Ito and Kunisch 2003): a node is active while its
multiplier outweighs its gap. The contact stiffness only sets how fast gaps close; at the solution
gaps and multipliers are exact. Steps that fail are halved; where halving ends, the
physical limit is named.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_backend.fem.assembly import gather
from sim_backend.fem.contact import Finger
from sim_backend.fem.grip import grip_on
from sim_backend.fem.internal import forces_and_tangents, smallest_area_ratio
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.mesh import TISSUE
from sim_backend.fem.section import Section
from sim_backend.fem.skin import MOST_PRESSED
from sim_backend.fem.touch import Touch, touches, walls_cross

Array = NDArray[np.float64]

MAX_SWEEPS = 25
SMALLEST_STEP = 1 / 256
MOST_FAILURES = 14
"""Steps on the way to one load that may fail: each may take `MAX_SWEEPS`, and where walls fold one
fold after another this is what ends it."""
JUDGE = 1.0
"""Weight of a gap against a multiplier, over the tissue's modulus, where contact is decided."""
FIRM = 1e4
"""Contact stiffness over the tissue's modulus: each sweep leaves about 1 / FIRM of a gap."""
CLOSED_M = 1e-10
"""Largest gap left where contact is: 4e-8 of the usual depth, and of the force."""
TOLERANCE = 1e-7
"""Residual over the sum of contact forces; at 1e-5 the change by a beat was off by 10 %."""
OPEN_TOUCHES = 2
"""Kinds of contact while all lumens are open: finger and support."""
CRUSHED = 0.02
"""Smallest det F accepted."""


class CannotSolve(RuntimeError):
    """No equilibrium was found; ``limit`` names the physics that ended it."""

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


@dataclass(frozen=True)
class Solution:
    """Displacements (n, 2) [m]; ``push`` [N/m], one array per `Touch`, of the pairs that may touch;
    ``force_n_per_m`` is what the finger feels, per length across the section. ``stuck_m`` are the
    sideways displacements (s,) that a bonded finger holds the surface at, NaN where it does not."""

    load: Load
    displacement: Array
    push: tuple[Array, ...]
    force_n_per_m: float
    sweeps: int
    stuck_m: Array | None = None


class NotConverged(Exception):
    """This step did not converge; the text says how it ended."""


class SkinPressedFlat(NotConverged):
    """The finger's skin gave way further than its stiffness is known."""


def untouched(section: Section) -> Solution:
    """The finger just over the surface, the lumens without pressure."""
    still = np.zeros_like(section.mesh.nodes)
    push = tuple(np.zeros(len(t.gap)) for t in touches(section, section.finger, still))
    return Solution(Load(0.0, 0.0), still, push, 0.0, 0)


def march(section: Section, start: Solution, loads: Iterable[Load]) -> Iterator[Solution]:
    """Solve ``loads`` one after another, each from the one before. Raises `CannotSolve`."""
    before, now = start, start
    for load in loads:
        reached = _advance(section, before, now, load)
        before, now = now, reached
        yield now


def as_solved(section: Section, solution: Solution) -> Section:
    """The section that ``solution`` belongs to: its lumens may have been pressed shut."""
    return section.closable if len(solution.push) > OPEN_TOUCHES else section


def _advance(section: Section, before: Solution, now: Solution, goal: Load) -> Solution:
    origin, share, step, failures = now.load, 0.0, 1.0, 0
    while share < 1.0:
        target = origin.between(goal, min(1.0, share + step))
        try:
            reached = equilibrium(
                as_solved(section, now), _guess(section, before, now, target), target
            )
        except NotConverged as failure:
            step /= 2
            failures += 1
            if step < SMALLEST_STEP or failures > MOST_FAILURES:
                raise _physical_limit(section, now, target, failure) from None
            continue
        if as_solved(section, now) is section and walls_cross(section, reached.displacement):
            walls = touches(section.closable, section.finger, now.displacement)[OPEN_TOUCHES:]
            now = replace(now, push=(*now.push, *(np.zeros(len(t.gap)) for t in walls)))
            before = now
            continue
        before, now = now, reached
        share += step
        step *= 1.5
    return now


def _guess(section: Section, before: Solution, now: Solution, target: Load) -> Solution:
    """Go on along the last step where the load does.

    Not with elements for nearly incompressible strain: the extrapolated change of volume times the
    bulk modulus is worse than no guess (with nu = 0.4999 it took four times as many sweeps).
    """
    if section.cells.dilatation and not section.plane_stress:
        return now
    moved = np.array([1e3, 1e-5]) * [
        now.load.depth_m - before.load.depth_m,
        now.load.pressure_pa - before.load.pressure_pa,
    ]
    ahead = np.array([1e3, 1e-5]) * [
        target.depth_m - now.load.depth_m,
        target.pressure_pa - now.load.pressure_pa,
    ]
    size = float(moved @ moved)
    if size == 0:
        return now
    ratio = float(moved @ ahead) / size
    off = ahead - ratio * moved
    if ratio <= 0 or ratio > 2.5 or float(off @ off) > 1e-6 * float(ahead @ ahead):
        return now
    ahead_u = now.displacement + ratio * (now.displacement - before.displacement)
    return replace(now, displacement=ahead_u)


def equilibrium(section: Section, start: Solution, load: Load) -> Solution:
    """The equilibrium at ``load``, in one step from ``start``. Raises `NotConverged`."""
    finger = _lowered(section, load)
    firm, judge = FIRM * section.tissue_pa, JUDGE * section.tissue_pa
    u, push = start.displacement.copy(), list(start.push)
    grip = grip_on(section.mesh.surface, start.stuck_m, firm)
    before: list[NDArray[np.bool_]] = []
    change: Array | None = None
    for sweep in range(1, MAX_SWEEPS + 1):
        pairs = touches(section, finger, u, grip.stuck)
        active = [t.active(m, judge) for t, m in zip(pairs, push, strict=True)]
        push = [np.where(a, m, 0.0) for m, a in zip(push, active, strict=True)]
        with np.errstate(invalid="ignore", over="ignore"):
            residual, matrices = _body(section, u, load.pressure_pa, change)
        if not np.all(np.isfinite(residual)):
            raise NotConverged("elements were crushed")
        for t, m in zip(pairs, push, strict=True):
            residual -= t.force(m, section.size)
        residual += grip.force(u, section.size)
        scale = np.abs(push[0]).sum() + load.pressure_pa * 1e-3 + 1e-8 * section.tissue_pa
        error = float(np.abs(residual[section.assembly.free]).max())
        apart = max(
            float(np.abs(t.open(m)[a]).max(initial=0.0))
            for t, m, a in zip(pairs, push, active, strict=True)
        )
        same = bool(before) and all(map(np.array_equal, active, before))
        if error < TOLERANCE * scale and apart < CLOSED_M and same:
            _refuse_flat_skin(finger, pairs[0], push[0])
            force = -pairs[0].force(push[0], section.size)[1::2].sum()
            stuck_m = grip.now_holding(push[0] > 0, u) if finger.bonded else None
            return Solution(load, u, tuple(push), float(force), sweep, stuck_m)
        springs = [t.firmness(firm) * t.open(m) for t, m in zip(pairs, push, strict=True)]
        for t, s, a in zip(pairs, springs, active, strict=True):  # they close what gaps are left
            residual += t.force(np.where(a, s, 0.0), section.size)
        push = [np.where(a, m - s, 0.0) for m, s, a in zip(push, springs, active, strict=True)]
        blocks = [t.blocks(m, a, firm) for t, m, a in zip(pairs, push, active, strict=True)]
        blocks[0] = blocks[0] + grip.blocks
        matrices += blocks
        change = _newton_step(section, matrices, residual, u)
        u += change
        push = [
            np.where(a, m - t.firmness(firm) * t.closing(change), 0.0)
            for t, m, a in zip(pairs, push, active, strict=True)
        ]
        before = active
    raise NotConverged(f"Newton's method did not converge within {MAX_SWEEPS} steps")


def _refuse_flat_skin(finger: Finger, pair: Touch, push: Array) -> None:
    """A skin is known only while it is not pressed flat. Raises `SkinPressedFlat`."""
    given = float((pair.give * push).max(initial=0.0))
    if given > MOST_PRESSED * finger.skin_m:
        flat_pct = 100 * given / finger.skin_m
        raise SkinPressedFlat(f"the finger's skin is pressed by {flat_pct:.0f} % of its thickness")


def _lowered(section: Section, load: Load) -> Finger:
    return section.finger.lowered_to(section.finger.y - load.depth_m)


def _newton_step(section: Section, matrices: list[Array], residual: Array, u: Array) -> Array:
    """The change (n, 2), shortened until it turns no element inside out."""
    try:
        factors = section.assembly.factor(matrices)
    except RuntimeError:
        raise NotConverged("the tangent became singular") from None
    change = section.assembly.solve(factors, -residual).reshape(-1, 2)
    if not np.all(np.isfinite(change)):
        raise NotConverged("the tangent became singular")
    for _ in range(6):
        if smallest_area_ratio(section, u + change)[0] > CRUSHED:
            return change
        change = change / 2
    raise NotConverged("elements were crushed")


def pressure_slope(section: Section, solution: Solution) -> tuple[Array, float]:
    """du/dp (n, 2) [m/Pa] and dF/dp [N/m/Pa] at a solution, the contact staying as it is."""
    section = as_solved(section, solution)
    firm = FIRM * section.tissue_pa
    grip = grip_on(section.mesh.surface, solution.stuck_m, firm)
    finger = _lowered(section, solution.load)
    pairs = touches(section, finger, solution.displacement, grip.stuck)
    active = [(m > 0) | t.stuck for t, m in zip(pairs, solution.push, strict=True)]
    _, matrices = _body(section, solution.displacement, solution.load.pressure_pa)
    blocks = [t.blocks(m, a, firm) for t, m, a in zip(pairs, solution.push, active, strict=True)]
    blocks[0] = blocks[0] + grip.blocks
    matrices += blocks
    load = np.zeros(section.size)
    for sides in section.lumens:
        load += gather(section.size, sides.dofs, unit_pressure(sides, solution.displacement)[0])
    factors = section.assembly.factor(matrices)
    slope = section.assembly.solve(factors, load).reshape(-1, 2)
    stiffness = pairs[0].blocks(solution.push[0], active[0], firm)
    on_finger = np.einsum("kij,kj->ki", stiffness, slope[section.mesh.surface])
    return slope, float(on_finger[:, 1].sum())


def _body(
    section: Section, u: Array, pressure_pa: float, change: Array | None = None
) -> tuple[Array, list[Array]]:
    """Residual (2n,) of cells and lumens, and their tangent blocks."""
    force, tangent = forces_and_tangents(section, u, change)
    residual = gather(section.size, section.cells.dofs, force)
    matrices = [tangent]
    for sides in section.lumens:
        unit, turning = unit_pressure(sides, u)
        residual -= gather(section.size, sides.dofs, pressure_pa * unit)
        matrices.append(-pressure_pa * turning)
    residual += gather(section.size, section.sideways.dofs, section.sideways.force(u))
    return residual, [*matrices, section.sideways.block]


def _physical_limit(
    section: Section, last: Solution, goal: Load, failure: NotConverged
) -> CannotSolve:
    ratio, cell = smallest_area_ratio(section, last.displacement)
    x_mm, y_mm = 1e3 * section.mesh.nodes[section.cells.nodes[cell]].mean(axis=0)
    depth_mm, mmhg = 1e3 * last.load.depth_m, last.load.pressure_pa / 133.322
    where = f"at x = {x_mm:.2f} mm, {y_mm:.2f} mm above the support"
    if not (section.mesh.region == TISSUE).any():
        return CannotSolve(
            "greatest depth",
            f"found no equilibrium beyond {depth_mm:.4g} mm at {mmhg:.4g} mmHg: the wall "
            "of the lone vessel folds, or it rolls from under a finger that is not over its middle "
            f"({failure}; smallest det F {ratio:.2g} {where}). Press over its middle or less deep.",
        )
    if goal.pressure_pa > last.load.pressure_pa:
        return CannotSolve(
            "limit pressure",
            f"found no equilibrium above {mmhg:.4g} mmHg ({depth_mm:.3g} mm deep): the wall "
            f"inflates without bound there ({failure}; smallest det F {ratio:.2g} {where}). "
            "Take a lower pressure, a thicker or a stiffer wall.",
        )
    if isinstance(failure, SkinPressedFlat):
        return CannotSolve(
            "skin",
            f"found no equilibrium deeper than {depth_mm:.4g} mm: {failure}, and is modelled up to "
            f"{100 * MOST_PRESSED:.0f} %. Press less deep or take a stiffer skin.",
        )
    folds = bool(section.lumens) and section.mesh.region[cell] != TISSUE
    what = "the vessel's wall folds" if folds else "the tissue under the finger is crushed"
    return CannotSolve(
        "greatest depth",
        f"found no equilibrium deeper than {depth_mm:.4g} mm at {mmhg:.4g} mmHg: {what} {where} "
        f"(det F = {ratio:.2g}; {failure}). Press less deep.",
    )
