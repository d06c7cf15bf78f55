"""A press into a solid at finite strain, from the scene to its solutions."""

from collections.abc import Sequence
from contextlib import suppress
from math import ceil

from sim_backend.fem.continuation import continuation, judged
from sim_backend.fem.finite_strain import bonded_way_m
from sim_backend.fem.mesh_transfer import continued
from sim_backend.fem.newton import Load, NotConverged, Solution, unloaded
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.build import MOST_UNKNOWNS, build_body, half_width_m
from sim_backend.scene.scene_file import Scene

SolvedSolid = tuple[SolidBody, list[Solution]]

FIRST, STEP = 0.07, 0.11
"""First depth on the way down, where single nodes come into contact, and the longest step from
there, over the finger's smaller half width: of 0.14 one in three crushed elements or stayed
indefinite, and was halved after all."""


def solve_solid(
    scene: Scene,
    x_m: float,
    depth_m: float,
    pressures_pa: Sequence[float],
    size_m: float,
    *,
    coarser: SolvedSolid | None = None,
    most_unknowns: float = MOST_UNKNOWNS,
    judge: bool = True,
) -> SolvedSolid:
    """One solution per lumen pressure, ``depth_m`` deep at (``x_m``, z = 0).

    The press comes first and the pressures in turn: the answer does not depend on the order, since
    nothing slides with friction. With what was solved on a ``coarser`` mesh the way down need not
    be gone again, but by a bonded finger. Without ``judge`` no state is asked whether it is stable.
    Raises `CannotSolve`, also for a mesh of more than ``most_unknowns``.
    """
    body = build_body(scene, x_m, depth_m=depth_m, size_m=size_m, most_unknowns=most_unknowns)
    first = pressures_pa[0] if body.lumens else 0.0
    now: Solution | None = None
    if coarser is not None and not body.bonded:
        with suppress(NotConverged):
            # displacements between a coarser mesh's nodes do not keep volumes: one such start is
            # enough, and pressures are followed from there
            now = continued(coarser[0], coarser[1][0], body)
    if now is None:
        if body.bonded:  # the answer is its path's, of which nothing is only passed
            depths = bonded_way_m(body.finger.profile, depth_m, body.contact_m)
            *_, now = continuation(body, unloaded(body), [Load(d, first) for d in depths])
        else:
            *way, there = [Load(d, first) for d in _depths(depth_m, half_width_m(scene))]
            (now,) = continuation(body, unloaded(body), [there], way)
    solutions = [now]
    for pressure in pressures_pa[1:]:
        if judge:  # its factors serve the next state
            solutions[-1] = judged(body, now)
        (now,) = continuation(body, now, [Load(depth_m, pressure)])
        solutions.append(now)
    if judge:
        solutions[-1] = judged(body, now)
    return body, solutions


def _depths(depth_m: float, half_m: float) -> list[float]:
    """The way down."""
    first_m = FIRST * half_m
    if depth_m <= 1.5 * first_m:
        return [depth_m]
    steps = ceil((depth_m - first_m) / (STEP * half_m) - 1e-9)
    return [first_m + (depth_m - first_m) * k / steps for k in range(steps + 1)]
