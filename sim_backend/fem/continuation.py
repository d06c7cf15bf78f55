"""Loads followed one after another, along stable equilibria.

Each load starts where the last steps point. Steps that fail are halved; where halving ends, the
physical limit is named. An equilibrium is stable where its tangent has no negative eigenvalue; one
that is not is left along the mode that is unstable, as a body would, or refused.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
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
    is_stable,
    tangent,
)
from sim_backend.fem.section_pairs import contact_pairs, walls_cross

MIN_STEP = 1 / 256
GROWTH = 1.5
"""Of a step after one that did not fail."""
MAX_FAILURES = 14
"""Steps on the way to one load that may fail. Each may take `newton.MAX_ITERATIONS`; where walls
fold one fold after another, this ends it."""
MAX_EXTRAPOLATION = 5.0
"""Length of a step over the one before up to which that one is continued. A station's second step
is up to four times its first."""
KICK_M = 0.02e-3
"""How far an unstable state is moved along its unstable mode, to begin to fall."""
DRAG, MAX_FALL = 3.0, 60
"""Viscous drag of a fall over the stiffness that is unstable: each of its steps takes the mode 1.5
times as far; and how many steps a fall may have."""

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
    origin, share, step, growth, failures = now.load, 0.0, 1.0, GROWTH, 0
    while share < 1.0:
        target = origin.between(goal, min(1.0, share + step))
        try:
            guess = _predicted(section, before, now, target)
            reached = equilibrium(as_solved(section, now), guess, target)
            if not reached.stable:
                reached = stable_branch(section, reached)
        except NotConverged as failure:
            step, growth = step / 2, 1.0  # twice this one has just failed
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
        step, growth = step * growth, GROWTH
    return now


def stable_branch(section: Section, unstable: Solution) -> Solution:
    """The stable equilibrium that a body in an ``unstable`` one falls to. Raises `Unstable`.

    It falls against a viscous drag, implicitly step by step (pseudo-transient continuation, Kelley
    and Keyes 1998), until its tangent is stable again; Newton's method alone falls back.
    """
    here = as_solved(section, unstable)
    mode, stiffness = _unstable_mode(here, unstable)
    drag = DRAG * abs(stiffness)
    falling = replace(unstable, displacement=unstable.displacement + KICK_M * mode)
    for _ in range(MAX_FALL):
        try:
            falling = equilibrium(here, falling, unstable.load, drag)
        except NotConverged:
            drag *= 4
            continue
        if is_stable(here, falling):
            drag /= 2
            with suppress(NotConverged):
                found = equilibrium(here, falling, unstable.load)
                if found.stable:
                    return found
    raise Unstable("the equilibrium is unstable, and no stable one was found beside it")


def _unstable_mode(section: Section, solution: Solution) -> tuple[Array, float]:
    """The eigenvector (n, 2) of the eigenvalue nearest to zero, its largest entry 1: the first to
    turn negative; by inverse iteration (Golub and Van Loan 2013, sec. 7.6.1). And its stiffness
    over the drag's of 1."""
    matrices, _ = tangent(section, solution)
    try:
        factors = section.assembly.factor(matrices)
    except SingularMatrix:
        raise Unstable("the tangent is singular") from None
    mode, free = np.zeros(section.size), section.assembly.free
    mode[free] = np.random.default_rng(0).standard_normal(len(free))
    for _ in range(INVERSE_ITERATIONS):
        mode = factors.solve(mode / np.abs(mode).max())
    mode /= np.abs(mode).max()
    stiffness = float(mode @ section.assembly.times(matrices, mode))
    return mode.reshape(-1, 2), stiffness / float(mode @ (section.valence * mode))


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
