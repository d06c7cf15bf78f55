"""A press into a solid at finite strain, from the scene to its solutions."""

from collections.abc import Sequence

from sim_backend.fem.finite_strain import pressed
from sim_backend.fem.newton import Solution
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.build import MOST_UNKNOWNS, build_body, half_width_m
from sim_backend.scene.scene_file import Scene

SolvedSolid = tuple[SolidBody, list[Solution]]


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
    """A solid's mesh, and the press at (``x_m``, z = 0) into it as by
    `sim_backend.fem.finite_strain.pressed`. Raises `CannotSolve` for a mesh of more than
    ``most_unknowns``, too."""
    body = build_body(scene, x_m, depth_m=depth_m, size_m=size_m, most_unknowns=most_unknowns)
    half_m = half_width_m(scene)
    return body, pressed(body, half_m, depth_m, pressures_pa, coarser=coarser, judge=judge)
