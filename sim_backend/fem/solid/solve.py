"""A press into a solid at finite strain, from the scene to its solutions."""

from collections.abc import Sequence

from sim_backend.fem.newton import Load
from sim_backend.fem.solid.body import Body
from sim_backend.fem.solid.build import build_body
from sim_backend.fem.solid.newton import SolidSolution, continuation, unloaded
from sim_backend.scene.scene_file import Scene

SolvedSolid = tuple[Body, list[SolidSolution]]

FIRST_M, STEP_M = 0.35e-3, 0.7e-3
"""First depth on the way down, where single nodes come into contact, and the steps from there."""


def solve_solid(
    scene: Scene,
    x_m: float,
    depth_m: float,
    pressures_pa: Sequence[float],
    size_m: float,
    *,
    z_m: float = 0.0,
    tilt_deg: float = 0.0,
) -> SolvedSolid:
    """One solution per lumen pressure, ``depth_m`` deep at (``x_m``, ``z_m``).

    The press comes first and the pressures in turn: the answer does not depend on the order, since
    nothing slides with friction. Raises `CannotSolve`.
    """
    body = build_body(scene, x_m, depth_m=depth_m, size_m=size_m, z_m=z_m, tilt_deg=tilt_deg)
    first = pressures_pa[0] if body.lumens else 0.0
    steps = max(1, round((depth_m - FIRST_M) / STEP_M))
    later = [FIRST_M + (depth_m - FIRST_M) * (k + 1) / steps for k in range(steps)]
    depths = [FIRST_M, *later] if depth_m > 1.5 * FIRST_M else [depth_m]
    ramp = [Load(d, first) for d in depths]
    rest = [Load(depth_m, p) for p in pressures_pa[1:]]
    solutions = list(continuation(body, unloaded(body), [*ramp, *rest]))
    return body, solutions[-len(pressures_pa) :]
