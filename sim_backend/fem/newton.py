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
from sim_backend.fem.internal import forces_and_tangents, smallest_area_ratio
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.section import Section

Array = NDArray[np.float64]

MAX_SWEEPS = 25
SMALLEST_STEP = 1 / 256
JUDGE = 1.0
"""Weight of a gap against a multiplier, over the tissue's modulus, where contact is decided."""
FIRM = 1e4
"""Contact stiffness over the tissue's modulus: each sweep leaves about 1 / FIRM of a gap."""
TOLERANCE = 1e-5
"""Residual over the sum of contact forces."""
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
    """Displacements (n, 2) [m]; contact forces (t, 2) [N/m] on the nodes that may be touched, the
    ``surface`` first of which can only be touched by the finger."""

    load: Load
    displacement: Array
    contact: Array
    surface: int
    sweeps: int

    @property
    def force_n_per_m(self) -> float:
        """What the finger feels, per length across the section."""
        return float(-self.contact[: self.surface, 1].sum())


class _Failed(Exception):
    """This step did not converge; the text says how it ended."""


def untouched(section: Section) -> Solution:
    """The finger just over the surface, the lumens without pressure."""
    still = np.zeros_like(section.mesh.nodes)
    contact = np.zeros((len(section.touching), 2))
    return Solution(Load(0.0, 0.0), still, contact, len(section.mesh.surface), 0)


def march(section: Section, start: Solution, loads: Iterable[Load]) -> Iterator[Solution]:
    """Solve ``loads`` one after another, each from the one before. Raises `CannotSolve`."""
    before, now = start, start
    for load in loads:
        reached = _advance(section, before, now, load)
        before, now = now, reached
        yield now


def _advance(section: Section, before: Solution, now: Solution, goal: Load) -> Solution:
    origin, share, step = now.load, 0.0, 1.0
    while share < 1.0:
        target = origin.between(goal, min(1.0, share + step))
        try:
            reached = _equilibrium(section, _guess(before, now, target), target)
        except _Failed as failure:
            step /= 2
            if step < SMALLEST_STEP:
                raise _physical_limit(section, now, target, failure) from None
            continue
        before, now = now, reached
        share += step
        step *= 1.5
    return now


def _guess(before: Solution, now: Solution, target: Load) -> Solution:
    """Go on along the last step where the load does."""
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


def _equilibrium(section: Section, start: Solution, load: Load) -> Solution:
    touching = section.touching
    finger = section.finger.lowered_to(section.finger.y - load.depth_m)
    firm = FIRM * section.tissue_pa
    u = start.displacement.copy()
    push = np.hypot(*start.contact.T)  # multipliers (s,)
    was_active = push > 0
    for sweep in range(1, MAX_SWEEPS + 1):
        gap, normal, curvature = section.gaps(finger, u)
        active = push > JUDGE * section.tissue_pa * gap
        trial = np.where(active, push - firm * gap, 0.0)
        residual, matrices = _body(section, u, load.pressure_pa)
        residual -= gather(section.size, section.touching_dofs, trial[:, None] * normal)
        matrices.insert(1, _contact_blocks(normal, curvature, trial, active, firm))
        free = section.assembly.free
        scale = np.abs(trial).sum() + load.pressure_pa * 1e-3 + 1e-8 * section.tissue_pa
        error = float(np.abs(residual[free]).max())
        closed = np.abs(gap[active]).max(initial=0.0) < 1e-8
        if error < TOLERANCE * scale and closed and np.array_equal(active, was_active):
            return Solution(load, u, trial[:, None] * normal, start.surface, sweep)
        try:
            factors = section.assembly.factor(matrices)
        except RuntimeError:
            raise _Failed("the tangent became singular") from None
        change = section.assembly.solve(factors, -residual).reshape(-1, 2)
        if not np.all(np.isfinite(change)):
            raise _Failed("the tangent became singular")
        share = _uncrushed_share(section, u, change)
        u += share * change
        slide = np.einsum("si,si->s", normal, share * change[touching])
        push = np.where(active, trial - firm * slide, 0.0)
        was_active = active
    raise _Failed("Newton's method did not converge")


def pressure_slope(section: Section, solution: Solution) -> tuple[Array, float]:
    """du/dp (n, 2) [m/Pa] and dF/dp [N/m/Pa] at a solution, the contact staying as it is."""
    finger = section.finger.lowered_to(section.finger.y - solution.load.depth_m)
    firm = FIRM * section.tissue_pa
    push = np.hypot(*solution.contact.T)
    _, normal, curvature = section.gaps(finger, solution.displacement)
    _, matrices = _body(section, solution.displacement, solution.load.pressure_pa)
    matrices.insert(1, _contact_blocks(normal, curvature, push, push > 0, firm))
    load = np.zeros(section.size)
    for sides in section.lumens:
        load += gather(section.size, sides.dofs, unit_pressure(sides, solution.displacement)[0])
    factors = section.assembly.factor(matrices)
    slope = section.assembly.solve(factors, load).reshape(-1, 2)
    moved = slope[section.touching]
    along = np.einsum("ti,ti->t", normal, moved)[:, None] * normal
    change = (-firm * along + (push * curvature)[:, None] * (moved - along))[push > 0]
    top = np.flatnonzero(push > 0) < solution.surface
    return slope, float(-change[top, 1].sum())


def _body(section: Section, u: Array, pressure_pa: float) -> tuple[Array, list[Array]]:
    """Residual (2n,) of cells and lumens, and their tangent blocks."""
    force, tangent = forces_and_tangents(section, u)
    residual = gather(section.size, section.cells.dofs, force)
    matrices = [tangent]
    for sides in section.lumens:
        unit, turning = unit_pressure(sides, u)
        residual -= gather(section.size, sides.dofs, pressure_pa * unit)
        matrices.append(-pressure_pa * turning)
    return residual, matrices


def _contact_blocks(
    normal: Array, curvature: Array, trial: Array, active: Array, firm: float
) -> Array:
    along = normal[:, :, None] * normal[:, None, :]
    across = np.eye(2) - along
    blocks = firm * along - (trial * curvature)[:, None, None] * across
    return np.asarray(np.where(active[:, None, None], blocks, 0.0))


def _uncrushed_share(section: Section, u: Array, change: Array) -> float:
    """The largest halving of a step that turns no element inside out."""
    share = 1.0
    for _ in range(6):
        if smallest_area_ratio(section, u + share * change)[0] > CRUSHED:
            return share
        share /= 2
    raise _Failed("elements were crushed")


def _physical_limit(section: Section, last: Solution, goal: Load, failure: _Failed) -> CannotSolve:
    ratio, place = smallest_area_ratio(section, last.displacement)
    x_mm, y_mm = 1e3 * place
    depth_mm, mmhg = 1e3 * last.load.depth_m, last.load.pressure_pa / 133.322
    where = f"at x = {x_mm:.2f} mm, {y_mm:.2f} mm above the support"
    if goal.pressure_pa > last.load.pressure_pa:
        return CannotSolve(
            "limit pressure",
            f"no equilibrium above {mmhg:.4g} mmHg ({depth_mm:.3g} mm deep): the wall inflates "
            f"without bound there ({failure}; smallest det F {ratio:.2g} {where}). "
            "Take a lower pressure, a thicker or a stiffer wall.",
        )
    return CannotSolve(
        "greatest depth",
        f"no equilibrium deeper than {depth_mm:.4g} mm at {mmhg:.4g} mmHg: {failure}; the most "
        f"compressed tissue (det F = {ratio:.2g}) is {where}. Press less deep.",
    )
