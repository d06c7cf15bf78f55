"""A press at finite strain, from the scene to its solutions."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from math import ceil

from sim_backend.fem.body import Body
from sim_backend.fem.continuation import continuation
from sim_backend.fem.mesh_transfer import continued
from sim_backend.fem.model import CONTACT_SHARE, Grading, build_section
from sim_backend.fem.newton import CannotSolve, Load, NotConverged, Solution, unloaded
from sim_backend.fem.section import Section
from sim_backend.scene.indenter.profile import Profile
from sim_backend.scene.scene_file import Scene

Solved = tuple[Section, list[Solution]]

RAMP_STEP, GENTLE_STEP = 0.2, 0.12
"""Steps of the way down over the finger's half width; the second in plane strain and on lone
vessels. To the same forces in 41 presses (benchmarks/random_presses.py) in plane stress, Newton's
method takes 945 steps with 0.6 mm for every finger, 724 with 0.12, 683 with 0.17, 674 with 0.21 and
702 with 0.26. TIHA in plane strain takes 35 with 0.12 and 58 with 0.17."""
FIRST_TOUCH = (0.2, 0.55)
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
    """One solution per lumen pressure, ``depth_m`` deep at ``x_m``. Raises `CannotSolve`.

    The lumen is filled before the press, which holds soft vessels open on the way down; the
    answer does not depend on the order, since nothing here slides with friction. Where filling
    first meets a limit, pressing first is tried. With what was solved on a ``coarser`` mesh the way
    down need not be gone again, but by a bonded finger: what it touches keeps its place, so that
    the answer is its path's, and each mesh goes its own. Where that ``must_carry`` over, what does
    not is not solved.
    """
    section = build_section(
        scene, x_m, depth_m=depth_m, size_m=size_m, element=element, grading=grading
    )
    if coarser is not None and not scene.indenter.bonded:
        with suppress(NotConverged):
            first_there = continued(coarser[0], coarser[1][0], section)
            others = [Load(depth_m, p) for p in pressures_pa[1:]]
            return section, [first_there, *continuation(section, first_there, others)]
        if must_carry:
            raise CannotSolve(
                "mesh", "the coarser mesh's answer does not carry over to a finer one"
            )
    if scene.indenter.bonded:
        contact_m = grading.contact_m if grading else CONTACT_SHARE * size_m
        depths = bonded_way_m(section.finger.profile, depth_m, contact_m)
    else:
        depths = _ramp(scene, depth_m)
    first = pressures_pa[0] if section.lumens else 0.0
    ramp = [Load(d, first) for d in depths]
    if first:
        ramp.insert(0, Load(-depth_m, first))
    rest = [Load(depth_m, p) for p in pressures_pa[1:]]
    try:
        solutions = list(continuation(section, unloaded(section), [*ramp, *rest]))
    except CannotSolve as error:
        if not first or error.limit != "limit pressure":
            raise
        ramp = [Load(d, 0.0) for d in depths]
        rest = [Load(depth_m, p) for p in pressures_pa]
        solutions = list(continuation(section, unloaded(section), [*ramp, *rest]))
    return section, solutions[-len(pressures_pa) :]


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


def _ramp(scene: Scene, depth_m: float) -> list[float]:
    """Depths on the way down; nearly incompressible plane strain must be touched gently, or the
    first contact presses single nodes and steps are halved again and again. A lone vessel is glued
    where it comes to rest, so that its answer is a little the path's."""
    half_m = scene.indenter.profile.scale
    gently = scene.plane == "strain" or scene.tissue is None
    steps = max(1, ceil(depth_m / ((GENTLE_STEP if gently else RAMP_STEP) * half_m) - 1e-9))
    depths = [depth_m * (k + 1) / steps for k in range(steps)]
    gentle = [s * depths[0] for s in FIRST_TOUCH] if scene.plane == "strain" else []
    return [*gentle, *depths]
