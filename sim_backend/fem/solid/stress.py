"""What a solid's solution says under the finger."""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.material_3d import von_mises
from sim_backend.fem.newton import Solution
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.prism import wedge_gradient

TRIANGLE_NODES = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])


def under_finger_pa(body: SolidBody, u: Array) -> float:
    """Von Mises stress [Pa] at the surface's node nearest to the finger's lowest point: the mean
    over its wedges of F there."""
    moved = body.wedges.nodes + u
    under = body.finger.under_m[[0, 2]]
    node = body.surface[np.argmin(np.hypot(*(moved[body.surface][:, [0, 2]] - under).T))]
    around = np.any(body.wedges.cells == node, axis=1)
    cells = body.wedges.cells[around]
    slope = wedge_gradient(np.tile(TRIANGLE_NODES, (3, 1)), np.repeat([-1.0, 0.0, 1.0], 6))
    rows, at = np.nonzero(cells == node)
    jacobian = np.einsum("mka,mki->mia", slope[at], body.wedges.nodes[cells[rows]])
    gradient = slope[at] @ np.linalg.inv(jacobian)
    f = np.swapaxes(u[cells[rows]], 1, 2) @ gradient + np.eye(3)
    return float(von_mises(f, body.shear[around][rows]).mean())


def contact_m(body: SolidBody, solution: Solution) -> tuple[float, float, float]:
    """Left and right end [m] of the nodes that the finger presses, from its middle, 0 where none,
    and what either may be off by: an element."""
    pressed = body.surface[solution.multiplier[0] > 0]
    if not len(pressed):
        return 0.0, 0.0, 0.0
    x = body.wedges.nodes[pressed, 0] + solution.displacement[pressed, 0] - body.finger.under_m[0]
    return float(x.min()), float(x.max()), body.contact_m
