"""Loads followed one after another, along stable equilibria.

Each load starts where the last steps point. Steps that fail are halved; where halving ends, the
physical limit is named. An equilibrium is stable where its tangent has no negative eigenvalue; one
that is not is left along the mode that is unstable, as a body would, or refused.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.assembly import SingularMatrix
from sim_backend.fem.limits import physical_limit
from sim_backend.fem.model import Section
from sim_backend.fem.newton import (
    PAIRS_WITH_OPEN_LUMENS,
    Load,
    NotConverged,
    Solution,
    Unstable,
    as_solved,
    equilibrium,
    tangent,
)
from sim_backend.fem.section_contact import contact_pairs, walls_cross

MIN_STEP = 1 / 256
MAX_FAILURES = 14
"""Steps on the way to one load that may fail. Each may take `newton.MAX_ITERATIONS`; where walls
fold one fold after another, this ends it."""
MAX_EXTRAPOLATION = 2.5
"""Length of a step over the one before up to which that one is continued."""
BRANCH_M = np.array([0.02, 0.1, 0.4, 1.0]) * 1e-3
"""How far the unstable mode is followed before Newton's method is tried from there: it falls back
to the unstable state from too near, and finds nothing from too far."""

INVERSE_ITERATIONS = 12
"""The lowest eigenvalues of a lone vessel lie a factor of ten apart: twelve leave nothing else."""


def unloaded(section: Section) -> Solution:
    """The finger just over the surface, the lumens without pressure."""
    still = np.zeros_like(section.mesh.nodes)
    pairs = contact_pairs(section, section.finger, still)
    return Solution(Load(0.0, 0.0), still, tuple(np.zeros(len(t.gap)) for t in pairs), 0.0, 0)


def continuation(section: Section, start: Solution, loads: Iterable[Load]) -> Iterator[Solution]:
    """Solve ``loads`` one after another, each from the one before. Raises `CannotSolve`."""
    before, now = start, start
    for load in loads:
        reached = _advance(section, before, now, load)
        before, now = now, reached
        yield now


def _advance(section: Section, before: Solution, now: Solution, goal: Load) -> Solution:
    origin, share, step, failures = now.load, 0.0, 1.0, 0
    while share < 1.0:
        target = origin.between(goal, min(1.0, share + step))
        try:
            guess = _predicted(section, before, now, target)
            reached = equilibrium(as_solved(section, now), guess, target)
            if not reached.stable:
                reached = stable_branch(section, reached)
        except NotConverged as failure:
            step /= 2
            failures += 1
            if step < MIN_STEP or failures > MAX_FAILURES:
                raise physical_limit(section, now, target, failure) from None
            continue
        if as_solved(section, now) is section and walls_cross(section, reached.displacement):
            walls = contact_pairs(section.with_self_contact, section.finger, now.displacement)[
                PAIRS_WITH_OPEN_LUMENS:
            ]
            now = replace(now, multiplier=(*now.multiplier, *(np.zeros(len(t.gap)) for t in walls)))
            before = now
            continue
        before, now = now, reached
        share += step
        step *= 1.5
    return now


def stable_branch(section: Section, unstable: Solution) -> Solution:
    """The stable equilibrium beside ``unstable`` at the same load. Raises `Unstable`."""
    mode = _unstable_mode(section, unstable)
    here = as_solved(section, unstable)
    for far_m in BRANCH_M:
        for side in (far_m, -far_m):
            start = replace(unstable, displacement=unstable.displacement + side * mode)
            try:
                found = equilibrium(here, start, unstable.load)
            except NotConverged:
                continue
            if found.stable:
                return found
    raise Unstable("the equilibrium is unstable, and no stable one was found beside it")


def _unstable_mode(section: Section, solution: Solution) -> Array:
    """The eigenvector (n, 2) of the eigenvalue nearest to zero, its largest entry 1: the first to
    turn negative. By inverse iteration (Golub and Van Loan 2013, sec. 7.6.1)."""
    here = as_solved(section, solution)
    try:
        factors = here.assembly.factor(tangent(here, solution)[0])
    except SingularMatrix:
        raise Unstable("the tangent is singular") from None
    mode = np.zeros(here.size)
    mode[here.assembly.free] = np.random.default_rng(0).standard_normal(len(here.assembly.free))
    for _ in range(INVERSE_ITERATIONS):
        mode = here.assembly.solve(factors, mode / np.abs(mode).max())
    return np.asarray(mode.reshape(-1, 2) / np.abs(mode).max())


def _predicted(section: Section, before: Solution, now: Solution, target: Load) -> Solution:
    """Displacements continued along the last step, where the load goes on as it did.

    Nearly incompressible plane strain is not continued: the extrapolated change of volume times the
    bulk modulus is worse than no guess (with nu = 0.4999 it took four times as many iterations).
    """
    if section.cells.dilatation and not section.plane_stress:
        return now
    scale = np.array([1e3, 1e-5])  # of a depth [m] and a pressure [Pa] beside each other
    moved = scale * now.load.change_from(before.load)
    ahead = scale * target.change_from(now.load)
    size = float(moved @ moved)
    if size == 0:
        return now
    ratio = float(moved @ ahead) / size
    off = ahead - ratio * moved
    if not 0 < ratio <= MAX_EXTRAPOLATION or float(off @ off) > 1e-6 * float(ahead @ ahead):
        return now
    ahead_u = now.displacement + ratio * (now.displacement - before.displacement)
    return replace(now, displacement=ahead_u)
