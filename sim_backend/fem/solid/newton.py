"""Equilibrium of a solid under finger and lumen pressure, as `sim_backend.fem.newton` in a plane.

Contact is the same semismooth Newton at nodes (Hintermueller, Ito and Kunisch 2003): a node is
active while its multiplier outweighs its gap.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.sparse import bsr_matrix

from sim_backend.arrays import Array, Bools
from sim_backend.fem.assembly import gather
from sim_backend.fem.newton import MIN_AREA_RATIO, CannotSolve, Load, NotConverged
from sim_backend.fem.solid.balance import body_forces
from sim_backend.fem.solid.body import Body
from sim_backend.fem.solid.descent import share_of_step
from sim_backend.fem.solid.forces import smallest_volume_ratio, tangents
from sim_backend.fem.solid.fronts import Singular
from sim_backend.fem.solid.linear import LinearSolver
from sim_backend.scene.waves import PA_PER_MMHG

MAX_ITERATIONS, CAREFUL_ITERATIONS = 15, 60
MIN_STEP = 1 / 64
INDEFINITE, CAREFUL_STEP = 3, 1 / 8
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
SOLVED = 0.1
"""Share of the residual allowed, on the way or at its end, that the linear solver may leave."""
ON_THE_WAY = 1e4
"""How many times the gap and the residual may be left where a load is only passed, on the way down
or by a step that was halved: a tenth of an element, and 1 % of the contact's force. The three
presses of `linear.RELATIVE` take 70 Newton steps, with 1e2 74 and with 1 80."""
PUSHES = (0.1, -0.1, 0.3, -0.3)
"""Greatest displacement over the element size, by which an unstable equilibrium is left. TIHA-solid
28 mm along: 0.03 falls back; 0.1 finds 1.0 % less force, -0.3 finds 0.2 % more."""


@dataclass(frozen=True)
class SolidSolution:
    """``displacement`` (n, 3) [m], ``multiplier`` (s,) [N] of the surface's nodes, and
    ``force_n`` [N], the whole finger's."""

    load: Load
    displacement: Array
    multiplier: Array
    force_n: float
    iterations: int
    stable: bool | None = None


def unloaded(body: Body) -> SolidSolution:
    """The finger just over the surface, the lumens without pressure."""
    still = np.zeros_like(body.wedges.nodes)
    return SolidSolution(Load(0.0, 0.0), still, np.zeros(len(body.surface)), 0.0, 0)


def continuation(
    body: Body,
    solver: LinearSolver,
    start: SolidSolution,
    loads: Iterable[Load],
    way: Iterable[Load] = (),
) -> Iterator[SolidSolution]:
    """Solve ``loads`` one after another, each from the one before; the first by ``way`` of others,
    which are only passed. Raises `CannotSolve`."""
    now = start
    for load in way:
        now = _advance(body, solver, now, load, ON_THE_WAY)
    for load in loads:
        now = _advance(body, solver, now, load)
        yield now


def _advance(
    body: Body, solver: LinearSolver, now: SolidSolution, goal: Load, slack: float = 1.0
) -> SolidSolution:
    origin, share, step = now.load, 0.0, 1.0
    while share < 1.0:
        target = origin.between(goal, min(1.0, share + step))
        left = slack if share + step >= 1.0 else ON_THE_WAY
        try:
            now = _balanced(body, solver, now, target, left, careful=step <= CAREFUL_STEP)
        except NotConverged as failure:
            step /= 2
            if step < MIN_STEP:
                raise _physical_limit(body, now, goal, failure) from None
            continue
        share += step
        step *= 1.5
    return now


class _Stalled(NotConverged):
    """Newton's steps went to and fro."""


def _balanced(
    body: Body,
    solver: LinearSolver,
    now: SolidSolution,
    target: Load,
    slack: float,
    *,
    careful: bool,
) -> SolidSolution:
    """The `equilibrium`, carefully where it must be. Raises `NotConverged`."""
    try:
        return equilibrium(body, solver, now, target, slack, careful=careful)
    except _Stalled:
        if careful:
            raise
        return equilibrium(body, solver, now, target, slack, careful=True)


def equilibrium(
    body: Body,
    solver: LinearSolver,
    start: SolidSolution,
    load: Load,
    slack: float = 1.0,
    *,
    careful: bool = False,
) -> SolidSolution:
    """The equilibrium at ``load``, in one step from ``start``, to ``slack`` times the tolerances;
    with ``careful`` iterations energy falls, to where it is least. Raises `NotConverged`."""
    finger = body.finger.lowered_by(load.depth_m)
    complementarity = body.tissue_pa * body.contact_m
    penalty = PENALTY * complementarity
    u, multiplier = start.displacement.copy(), start.multiplier.copy()
    before: Bools | None = None
    change: Array | None = None
    indefinite = 0
    most = CAREFUL_ITERATIONS if careful else MAX_ITERATIONS
    for iteration in range(1, most + 1):
        place = body.wedges.nodes + u
        gap, normal, hessian = finger.gap(place[body.surface])
        if before is None:
            active = _first_active(gap, multiplier)
        else:
            active = multiplier > complementarity * gap
        multiplier = np.where(active, multiplier, 0.0)
        rough = iteration == 1 and start.iterations == 0  # a guess, not an equilibrium
        residual, turning = body_forces(body, u, load.pressure_pa)
        if not np.all(np.isfinite(residual)):
            raise NotConverged("elements were crushed")
        residual -= gather(body.size, body.contact_dofs, multiplier[:, None] * normal)
        scale = (
            multiplier.sum()
            + load.pressure_pa * body.contact_m**2
            + 1e-6 * complementarity * body.contact_m
        )
        error = float(np.linalg.norm(residual[body.free]))
        open_m = float(np.abs(gap[active]).max(initial=0.0))
        same = before is not None and np.array_equal(active, before)
        there_n, there_m = slack * TOLERANCE * scale, slack * CLOSED_SHARE * body.contact_m
        if error < there_n and open_m < there_m and same:
            force = -float((multiplier * normal[:, 1]).sum()) / body.share
            return SolidSolution(load, u, multiplier, force, iteration)
        spring = np.where(active, penalty * gap, 0.0)
        residual += gather(body.size, body.contact_dofs, spring[:, None] * normal)
        # the normal turns with the multiplier alone: what springs of a wide gap would add to that
        # is far more than any contact, and makes the tangent indefinite
        springs, turned = _contact_blocks(body, active, multiplier, normal, hessian)
        pushed, multiplier = multiplier, multiplier - spring
        joined = solver.joined(tangents(body.wedges, body.shear, body.bulk, u, change, rough))
        even = _even(turning)
        matrix = solver.matrix(joined, *turning, springs + turned)
        if careful and not solver.is_definite(solver.matrix(joined, *even, springs + turned)):
            matrix = solver.matrix(joined, *turning, springs)
        # factors do without the normals' turning, with which a node on an edge may have no pivot
        simpler = partial(solver.matrix, joined, *even, springs)
        try:
            change = solver.solve(matrix, -residual, simpler, SOLVED * there_n).reshape(-1, 3)
        except Singular:
            raise NotConverged("the tangent became singular") from None
        if rough:  # without the pressure its factors serve no other tangent
            solver.forget()
        indefinite += solver.negative
        if indefinite > INDEFINITE and not careful:
            raise NotConverged("the tangent stayed indefinite")
        if careful:
            change *= share_of_step(body, load, u, change, pushed, penalty)
        change = _not_inside_out(body, u, change)
        u += change
        closing = (normal * change[body.surface]).sum(axis=1)
        multiplier = np.where(active, multiplier - penalty * closing, 0.0)
        before = active
    raise _Stalled(f"Newton's method did not converge within {most} steps")


def is_stable(body: Body, solver: LinearSolver, solution: SolidSolution) -> bool | None:
    """Whether the tangent has no negative eigenvalue, contact unchanged: True where all pivots
    are positive, False where a displacement is found that releases energy, None where neither."""
    try:
        lowest = solver.lowest_curvature(_tangent(body, solver, solution))
    except Singular:
        return None
    return None if lowest is None else lowest > 0


def fallen(body: Body, solver: LinearSolver, unstable: SolidSolution) -> SolidSolution | None:
    """A stable equilibrium beside an ``unstable`` one, at the same load; None where none is found.

    It is pushed along a displacement that releases energy, either way. Where a finger's edge is
    finer than the elements, that is one node which slides over the edge.
    """
    push = solver.released_by(_tangent(body, solver, unstable))
    if push is None:
        return None
    push = push.reshape(-1, 3)
    push *= body.contact_m / float(np.linalg.norm(push, axis=1).max())
    for share in PUSHES:
        pushed = replace(unstable, displacement=unstable.displacement + share * push)
        try:
            found = equilibrium(body, solver, pushed, unstable.load, careful=True)
        except NotConverged:
            continue
        if is_stable(body, solver, found):
            return found
    return None


def _tangent(body: Body, solver: LinearSolver, solution: SolidSolution) -> bsr_matrix:
    """With contact unchanged."""
    finger = body.finger.lowered_by(solution.load.depth_m)
    place = body.wedges.nodes + solution.displacement
    _, normal, hessian = finger.gap(place[body.surface])
    _, turning = body_forces(body, solution.displacement, solution.load.pressure_pa)
    active = solution.multiplier > 0
    springs, turned = _contact_blocks(body, active, solution.multiplier, normal, hessian)
    joined = solver.joined(tangents(body.wedges, body.shear, body.bulk, solution.displacement))
    return solver.matrix(joined, *_even(turning), springs + turned)


def _even(turning: list[Array]) -> list[Array]:
    """The symmetric part of lumens' tangent blocks: at a lumen's open ends there is another, which
    in factors, of which half is made, would weigh as much as the softest displacements."""
    return [(block + np.swapaxes(block, 1, 2)) / 2 for block in turning]


def _contact_blocks(
    body: Body, active: Bools, multiplier: Array, normal: Array, hessian: Array
) -> tuple[Array, Array]:
    """Springs (s, 3, 3) of the ``active`` nodes (s,), and their normals' turning."""
    penalty = PENALTY * body.tissue_pa * body.contact_m
    springs = np.where(active, penalty, 0.0)[:, None, None]
    rigid = springs * normal[:, :, None] * normal[:, None, :]
    return rigid, -multiplier[:, None, None] * hessian


def _first_active(gap: Array, multiplier: Array) -> Bools:
    """Nodes (s,) in contact in a step's first iteration: those that were.

    That makes the iteration the exact slope by depth and pressure. What penetrates the finger
    before anything has given way is far more than what will touch; of a first touch take the
    deeper half, as in the contact of a ball (Johnson 1985, eq. 3.42: a^2 = R d, not 2 R d).
    """
    return multiplier > 0 if multiplier.any() else gap < min(0.5 * float(gap.min()), 0.0)


def _not_inside_out(body: Body, u: Array, change: Array) -> Array:
    for _ in range(6):
        if smallest_volume_ratio(body.wedges, u + change)[0] > MIN_AREA_RATIO:
            return change
        change = change / 2
    raise NotConverged("elements were crushed")


def _physical_limit(
    body: Body, last: SolidSolution, goal: Load, failure: NotConverged
) -> CannotSolve:
    ratio, cell = smallest_volume_ratio(body.wedges, last.displacement)
    x, y, z = 1e3 * body.wedges.nodes[body.wedges.cells[cell]].mean(axis=0)
    depth_mm, mmhg = 1e3 * last.load.depth_m, last.load.pressure_pa / PA_PER_MMHG
    where = (
        f"({failure}; smallest det F {ratio:.2g} at x = {x:.2f} mm, z = {z:.2f} mm, "
        f"{y:.2f} mm above the support)"
    )
    deeper = f"deeper than {depth_mm:.4g} mm" if depth_mm > 0 else "once the finger touches"
    if goal.pressure_pa > last.load.pressure_pa:
        return CannotSolve(
            "limit pressure",
            f"found no equilibrium above {mmhg:.4g} mmHg, {depth_mm:.3g} mm deep {where}. Take a "
            "lower pressure, a thicker or a stiffer wall.",
        )
    return CannotSolve(
        "greatest depth",
        f"found no equilibrium {deeper} at {mmhg:.4g} mmHg {where}. Press less deep.",
    )
