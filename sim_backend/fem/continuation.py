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
from sim_backend.fem.body import Body
from sim_backend.fem.limits import physical_limit
from sim_backend.fem.newton import (
    PAIRS_WITH_OPEN_LUMENS,
    Load,
    NotConverged,
    Solution,
    Stalled,
    Unstable,
    as_solved,
    equilibrium,
    is_stable,
    tangent,
)

CAREFUL_STEP = 1 / 8
"""The longest step that is taken carefully, where a body's rules are so."""
GROWTH = 1.5
"""Of a step after one that did not fail."""
MAX_FAILURES = 14
"""Steps on the way to one load that may fail. Each may take as many iterations as its rules allow;
where walls fold one fold after another, this ends it."""
MAX_EXTRAPOLATION = 5.0
"""Length of a step over the one before up to which that one is continued. A station's second step
is up to four times its first."""
KICK_M = 0.02e-3
"""How far an unstable state is moved along its unstable mode, to begin to fall."""
DRAG, MAX_FALL = 3.0, 60
"""Viscous drag of a fall over the stiffness that is unstable: each of its steps takes the mode 1.5
times as far; and how many steps a fall may have."""
PUSHES = (0.1, -0.1, 0.3, -0.3)
"""Greatest displacement over the element size, by which a solid's unstable equilibrium is left.
TIHA-solid 28 mm along: 0.03 falls back; 0.1 finds 1.0 % less force, -0.3 finds 0.2 % more."""


def continuation(
    body: Body, start: Solution, loads: Iterable[Load], way: Iterable[Load] = ()
) -> Iterator[Solution]:
    """Solve ``loads`` one after another, each from the one before; the first by ``way`` of others,
    which are only passed. Raises `CannotSolve`."""
    before, now = start, start
    for load in way:
        before, now = now, _advance(body, before, now, load, body.rules.on_the_way)
    for load in loads:
        before, now = now, _advance(body, before, now, load)
        yield now


def _advance(
    body: Body, before: Solution, now: Solution, goal: Load, slack: float = 1.0
) -> Solution:
    origin, share, step, growth, failures = now.load, 0.0, 1.0, GROWTH, 0
    while share < 1.0:
        target = origin.between(goal, min(1.0, share + step))
        left = slack if share + step >= 1.0 else body.rules.on_the_way
        try:
            reached = _stepped(body, before, now, target, left, careful=step <= CAREFUL_STEP)
        except NotConverged as failure:
            step, growth = step / 2, 1.0  # twice this one has just failed
            failures += 1
            if step < body.rules.min_step or failures > MAX_FAILURES:
                raise physical_limit(body, now, target, failure) from None
            continue
        if as_solved(body, now) is body and body.walls_cross(reached.displacement):
            walls = body.with_self_contact.contact_pairs(now.displacement, now.load.depth_m)
            closed = (np.zeros(len(t.gap)) for t in walls[PAIRS_WITH_OPEN_LUMENS:])
            now = replace(now, multiplier=(*now.multiplier, *closed))
            before = now
            continue
        before, now = now, reached
        share += step
        step, growth = step * growth, GROWTH
    return now


def _stepped(
    body: Body, before: Solution, now: Solution, target: Load, slack: float, *, careful: bool
) -> Solution:
    """A stable equilibrium; carefully where it must be. Raises `NotConverged`."""
    here, guess = as_solved(body, now), _predicted(body, before, now, target)
    careful = careful and body.rules.careful_iterations > 0
    try:
        reached = equilibrium(here, guess, target, slack=slack, careful=careful)
    except Stalled:
        if careful or not body.rules.careful_iterations:
            raise
        reached = equilibrium(here, guess, target, slack=slack, careful=True)
    return stable_branch(body, reached) if reached.stable is False else reached


def judged(body: Body, solution: Solution) -> Solution:
    """With ``stable`` known, where the factors decide."""
    return replace(solution, stable=is_stable(as_solved(body, solution), solution))


def stable_branch(body: Body, unstable: Solution) -> Solution:
    """The stable equilibrium that a body in an ``unstable`` one falls to. Raises `Unstable`."""
    here = as_solved(body, unstable)
    try:
        mode = here.linear.releasing(tangent(here, unstable))
    except SingularMatrix:
        raise Unstable("the tangent is singular") from None
    if mode is not None:
        mode = mode.reshape(unstable.displacement.shape)
        mode = mode / float(np.linalg.norm(mode, axis=1).max())
        found = (_pushed if here.rules.careful_iterations else _fallen)(here, unstable, mode)
        if found is not None:
            return found
    raise Unstable("the equilibrium is unstable, and no stable one was found beside it")


def _pushed(body: Body, unstable: Solution, mode: Array) -> Solution | None:
    """Pushed along the mode, either way, and down to where energy is least. Where a finger's edge
    is finer than the elements, the mode is one node which slides over the edge."""
    for share in PUSHES:
        start = replace(
            unstable, displacement=unstable.displacement + share * body.rules.push_m * mode
        )
        with suppress(NotConverged):
            found = judged(body, equilibrium(body, start, unstable.load, careful=True))
            if found.stable:
                return found
    return None


def _fallen(body: Body, unstable: Solution, mode: Array) -> Solution | None:
    """It falls against a viscous drag, implicitly step by step (pseudo-transient continuation,
    Kelley and Keyes 1998), until its tangent is stable again; Newton's method alone falls back."""
    matrix, flat = tangent(body, unstable), mode.ravel()
    stiffness = float(flat @ body.linear.times(matrix, flat))
    drag = DRAG * abs(stiffness / float(flat @ (body.valence * flat)))
    falling = replace(unstable, displacement=unstable.displacement + KICK_M * mode)
    for _ in range(MAX_FALL):
        try:
            falling = equilibrium(body, falling, unstable.load, drag=drag)
        except NotConverged:
            drag *= 4
            continue
        if is_stable(body, falling):
            drag /= 2
            with suppress(NotConverged):
                found = equilibrium(body, falling, unstable.load)
                if found.stable:
                    return found
    return None


def _predicted(body: Body, before: Solution, now: Solution, target: Load) -> Solution:
    """Displacements continued along the last step, where the load goes on as it did."""
    if not body.rules.extrapolates:
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
