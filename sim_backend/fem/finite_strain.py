"""A press at finite strain, of any kind of body: filled, lowered, or begun on a coarser mesh."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from math import ceil

from sim_backend.fem.body import AnyBody, Body
from sim_backend.fem.continuation import continuation, judged
from sim_backend.fem.mesh_transfer import continued
from sim_backend.fem.model import Grading, build_section
from sim_backend.fem.newton import CannotSolve, Load, NotConverged, Solution, unloaded
from sim_backend.fem.section import Section
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.scene_file import Scene

Solved = tuple[Section, list[Solution]]

STEPS_PER_ELEMENT = 3
"""Of a bonded finger's way down, per element that its contact's edge passes. On a block of 2.4 mm
three leave 0.4 % of the force, where one step for all missed 10 %."""


def solve_finite(
    scene: Scene,
    x_m: float,
    depth_m: float,
    pressures_pa: Sequence[float],
    size_m: float,
    element: str | None = None,
    *,
    grading: Grading | None = None,
    coarser: Solved | None = None,
    must_carry: bool = False,
) -> Solved:
    """A section's mesh, and the press at ``x_m`` into it as by `pressed`."""
    section = build_section(
        scene, x_m, depth_m=depth_m, size_m=size_m, element=element, grading=grading
    )
    half_m = scene.indenter.profile.scale
    return section, pressed(
        section, half_m, depth_m, pressures_pa, coarser=coarser, must_carry=must_carry
    )


def pressed(
    body: AnyBody,
    half_m: float,
    depth_m: float,
    pressures_pa: Sequence[float],
    *,
    coarser: tuple[AnyBody, list[Solution]] | None = None,
    must_carry: bool = False,
    judge: bool = True,
) -> list[Solution]:
    """One solution per lumen pressure, ``depth_m`` deep, by a finger of half width ``half_m``.

    The lumen is filled before the press, which holds soft vessels open on the way down; the answer
    does not depend on the order, since nothing here slides with friction. Where filling first meets
    a limit, pressing first is tried. With what was solved on a ``coarser`` mesh the way down need
    not be gone again, but by a bonded finger: what it touches keeps its place, so that the answer
    is its path's, and each mesh goes its own. Where that ``must_carry`` over, what does not is not
    solved. With ``judge`` each state knows whether it is stable, where its factors decide. Raises
    `CannotSolve`.
    """
    first = pressures_pa[0] if body.lumens else 0.0
    there = None
    if coarser is not None and not body.bonded:
        with suppress(NotConverged):
            # displacements between a coarser mesh's nodes do not keep volumes: one such start is
            # enough, and pressures are followed from there
            there = continued(coarser[0], coarser[1][0], body)
        if there is None and must_carry:
            raise CannotSolve(
                "mesh", "the coarser mesh's answer does not carry over to a finer one"
            )
    if there is None:
        there = _lowered(body, half_m, Load(depth_m, first))

    def known(state: Solution) -> Solution:  # its factors serve the next state
        return judged(body, state) if judge and state.stable is None else state

    others = [Load(depth_m, p) for p in pressures_pa[1:]]
    return [known(there), *map(known, continuation(body, there, others))]


def _lowered(body: Body, half_m: float, goal: Load) -> Solution:
    """Filled, then pressed; where filling meets a limit, pressed and then filled."""
    start = unloaded(body)
    if goal.pressure_pa:
        try:
            (start,) = continuation(body, start, [Load(-goal.depth_m, goal.pressure_pa)])
        except CannotSolve as error:
            if error.limit != "limit pressure":
                raise
            empty = _lowered(body, half_m, Load(goal.depth_m, 0.0))
            return next(continuation(body, empty, [goal]))
    if body.bonded:  # the answer is its path's, of which nothing is only passed
        return next(down(body, start, [goal]))
    way = [Load(d, goal.pressure_pa) for d in _way_m(body, half_m, goal.depth_m)]
    return next(continuation(body, start, [goal], way))


def filled(body: Body, pressure_pa: float, deepest_m: float) -> tuple[Solution, float]:
    """The body under its lumens' pressure with the finger just over it, ``deepest_m`` before a
    press so deep, and how far the pressure lifts the surface under the finger [m], where it will
    first touch. Raises `CannotSolve`."""
    start = unloaded(body)
    if not body.lumens:
        return start, 0.0
    (start,) = continuation(body, start, [Load(-deepest_m, pressure_pa)])
    rises_m = -float(body.contact_pairs(start.displacement, 0.0)[0].gap.min())
    # the finger in the air is in equilibrium as far down as it just touches, which is where
    # the first step begins that the second one continues
    return replace(start, load=Load(-rises_m, pressure_pa)), rises_m


def down(body: Body, start: Solution, loads: Sequence[Load]) -> Iterator[Solution]:
    """The solutions at ever deeper ``loads``; a bonded finger takes the steps between that its path
    needs. Raises `CannotSolve`."""
    if not body.bonded:
        yield from continuation(body, start, loads)
        return
    deepest, wanted = loads[-1], {load.depth_m for load in loads}
    way = bonded_way_m(body.outline, deepest.depth_m, body.contact_m)
    path = [Load(d, deepest.pressure_pa) for d in sorted({*wanted, *way})]
    for state, load in zip(continuation(body, start, path), path, strict=True):
        if load.depth_m in wanted:
            yield state


def bonded_way_m(profile: Profile, depth_m: float, contact_m: float) -> list[float]:
    """Depths on the way down of a bonded finger over elements of ``contact_m``: the contact's edge,
    which goes with the root of the depth, moves evenly."""
    edge_m = profile.arc(depth_m) - profile.chord(0.0)
    steps = max(STEPS_PER_ELEMENT, ceil(STEPS_PER_ELEMENT * edge_m / contact_m))
    return [depth_m * ((k + 1) / steps) ** 2 for k in range(steps)]


def _way_m(body: Body, half_m: float, depth_m: float) -> list[float]:
    """Depths on the way down to one, as the body's rules say."""
    first_m = body.rules.first_touch * half_m
    if depth_m <= 1.5 * first_m:
        return []
    steps = max(1, ceil((depth_m - first_m) / (body.rules.step * half_m) - 1e-9))
    depths = [first_m + (depth_m - first_m) * k / steps for k in range(steps)]
    return depths if first_m else depths[1:]
