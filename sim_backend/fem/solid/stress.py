"""What a solid's solution says under the finger."""

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.material_3d import von_mises
from sim_backend.fem.newton import Solution
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.prism import wedge_gradient

_TRIANGLE_NODES = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
"""Of each of a wedge's three planes."""


def von_mises_at_nodes(body: SolidBody, u: Array, wedges: Ints) -> Array:
    """Von Mises stress (m, 18) [Pa] of F at the nodes of some ``wedges`` (m,)."""
    cells = body.wedges.cells[wedges]
    slope = wedge_gradient(np.tile(_TRIANGLE_NODES, (3, 1)), np.repeat([-1.0, 0.0, 1.0], 6))
    jacobian = np.einsum("qka,mki->mqia", slope, body.wedges.nodes[cells])
    moved = np.swapaxes(u[cells], 1, 2)[:, None]
    f = moved @ (slope @ np.linalg.inv(jacobian)) + np.eye(3)
    return von_mises(f, body.shear[wedges, None])


def under_finger_pa(body: SolidBody, u: Array) -> float:
    """Von Mises stress [Pa] at the surface's node nearest to the finger's lowest point: the mean
    over its wedges of F there."""
    moved = body.wedges.nodes + u
    under = body.finger.under_m[[0, 2]]
    node = body.surface[np.argmin(np.hypot(*(moved[body.surface][:, [0, 2]] - under).T))]
    around = np.flatnonzero(np.any(body.wedges.cells == node, axis=1))
    stress = von_mises_at_nodes(body, u, around)
    return float(stress[body.wedges.cells[around] == node].mean())


def contact_m(body: SolidBody, solution: Solution) -> tuple[float, float, float]:
    """Left and right end [m] of the nodes that the finger presses, from its middle, 0 where none,
    and what either may be off by: an element."""
    pressed = body.surface[solution.multiplier[0] > 0]
    if not len(pressed):
        return 0.0, 0.0, 0.0
    x = body.wedges.nodes[pressed, 0] + solution.displacement[pressed, 0] - body.finger.under_m[0]
    return float(x.min()), float(x.max()), body.contact_m
