"""Derivatives of a solution by depth and lumen pressure, from the exact tangent."""

from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.assembly import gather
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.model import Section
from sim_backend.fem.newton import Solution, as_solved, tangent


@dataclass(frozen=True)
class Slope:
    """``displacement`` (n, 2) and force ``force_n_per_m`` by depth [m] or pressure [Pa]."""

    displacement: Array
    force_n_per_m: float


def slopes(section: Section, solution: Solution) -> tuple[Slope, Slope]:
    """By depth and by pressure, the contact staying as it is; cheapest just after ``solution``.

    Raises `SingularMatrix`.
    """
    section = as_solved(section, solution)
    surface = section.mesh.surface
    matrices, contact = tangent(section, solution)
    factors = section.assembly.factor(matrices)
    # by depth: what is touched goes down with the finger, and the rest follows. (The finger's
    # springs, 1e4 times as stiff as the tissue, would leave a hundredth of the force unsolved.)
    down = np.tile([0.0, -1.0], (len(surface), 1))
    carried = np.zeros((section.size // 2, 2))
    carried[surface[contact.any(axis=(1, 2))], 1] = -1.0
    pressed = np.zeros_like(carried)
    pressed[surface] = np.einsum("kij,kj->ki", contact, down)
    loads = [pressed.ravel() - section.assembly.times(matrices, carried.ravel())]
    if section.lumens:
        loads.append(_pressure_load(section, solution))
    following, *rest = (factors.solve(one).reshape(-1, 2) for one in loads)
    by_depth = carried + following
    by_pressure = rest[0] if rest else np.zeros_like(by_depth)
    return (
        Slope(by_depth, _on_finger(contact, by_depth[surface] - down)),
        Slope(by_pressure, _on_finger(contact, by_pressure[surface])),
    )


def _pressure_load(section: Section, solution: Solution) -> Array:
    """Force (2n,) [N/m] of a lumen pressure of 1 Pa."""
    load = np.zeros(section.size)
    for sides in section.lumens:
        load += gather(section.size, sides.dofs, unit_pressure(sides, solution.displacement)[0])
    return load


def _on_finger(contact: Array, moved: Array) -> float:
    """Force [N/m] that the contact's blocks (s, 2, 2) put on the finger as nodes (s, 2) move."""
    return float(np.einsum("kij,kj->ki", contact, moved)[:, 1].sum())
