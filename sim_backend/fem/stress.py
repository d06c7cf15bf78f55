"""What a solution says at the nodes: von Mises stress, and where the finger touches."""

from functools import cache

import numpy as np

from sim_backend.arrays import Array, Ints
from sim_backend.fem.elements import Shape, gradients, q4, t6
from sim_backend.fem.internal import deformation
from sim_backend.fem.material import thinning, von_mises
from sim_backend.fem.newton import Solution
from sim_backend.fem.revolved import hoop_stretch
from sim_backend.fem.section import Section

_T6_NODES = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
_Q_NODES = np.array(
    [[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], dtype=float
)


def nodal_von_mises(section: Section, u: Array) -> Array:
    """Von Mises stress (n,) [Pa]: at each node the mean over its cells of the cell's mean."""
    nodes, weight = section.cells.nodes, section.cells.weight
    every = np.arange(len(nodes))
    stress = _von_mises(section, every, deformation(section, u), hoop_stretch(section.cells, u))
    mean = (stress * weight).sum(axis=1) / weight.sum(axis=1)
    return _averaged(nodes, np.repeat(mean[:, None], nodes.shape[1], axis=1), len(u))


def under_finger_pa(section: Section, u: Array) -> float:
    """Von Mises stress [Pa] at the surface under the middle of the finger, from F at the nodes."""
    beside, x = _beside(section, u)
    of_cells = section.cells.nodes
    chosen = np.flatnonzero(((of_cells == beside[0]) | (of_cells == beside[1])).any(axis=1))
    nodes = of_cells[chosen]
    slope, _ = gradients(section.mesh.nodes, nodes, _gradient_at_nodes(section.cells.shape))
    moved = np.swapaxes(u[nodes], 1, 2)[:, None]
    f = (moved @ np.swapaxes(slope, 2, 3)).reshape(*nodes.shape, 4) + np.array([1.0, 0, 0, 1.0])
    around = np.ones(f.shape[:2])
    if section.cells.hoop is not None:  # u_r / r at the nodes, on the axis its limit du_r / dr
        r = section.mesh.nodes[nodes, 0]
        on_axis = r < 1e-12
        around = np.where(on_axis, f[..., 0], 1 + u[nodes, 0] / np.where(on_axis, 1.0, r))
    stress = _von_mises(section, chosen, f, around)
    return float(np.interp(section.finger.x, x, [stress[nodes == node].mean() for node in beside]))


@cache
def _gradient_at_nodes(shape: Shape) -> Array:
    points = _T6_NODES if shape is t6 else _Q_NODES[: 4 if shape is q4 else 8]
    return shape(points)[1]


def _beside(section: Section, u: Array) -> tuple[Ints, Array]:
    """The surface's two nodes (2,) to either side of the finger's middle, and where they are now
    (2,) [m] along x; the outermost two where it is beside the surface."""
    surface = section.mesh.surface
    x = section.mesh.nodes[surface, 0] + u[surface, 0]
    order = np.argsort(x)
    right = int(np.clip(np.searchsorted(x[order], section.finger.x), 1, len(x) - 1))
    both = order[right - 1 : right + 1]
    return surface[both], x[both]


def _von_mises(section: Section, chosen: Ints, f: Array, around: Array) -> Array:
    """``around`` (m, q) is F33 where the section does not thin."""
    shear, bulk = section.shear[chosen, None], section.bulk[chosen, None]
    free = section.plane_stress
    thickness = thinning(f, shear, bulk)[0] if free else around
    return von_mises(f, thickness, shear)


def _averaged(nodes: Ints, values: Array, count: int) -> Array:
    cells = np.bincount(nodes.ravel(), minlength=count)
    total = np.bincount(nodes.ravel(), weights=values.ravel(), minlength=count)
    return np.asarray(total / np.maximum(cells, 1))


def contact_m(section: Section, solution: Solution) -> tuple[float, float, float]:
    """Left and right end [m] of what the finger touches, from its middle, 0 where nothing is, and
    what either may be off by.

    An end lies half-way between the last node that is pressed and the next.
    """
    surface = section.mesh.surface
    pressed = np.flatnonzero(solution.multiplier[0] > 0)
    if not len(pressed):
        return 0.0, 0.0, 0.0
    x = section.mesh.nodes[surface, 0] + solution.displacement[surface, 0] - section.finger.x
    first, last = pressed[0], pressed[-1]
    left = (x[first] + x[max(first - 1, 0)]) / 2
    right = (x[last] + x[min(last + 1, len(x) - 1)]) / 2
    if section.cells.hoop is not None:  # half of what is round about the axis
        return -float(right), float(right), float(right - x[last])
    return float(left), float(right), float(max(x[first] - left, right - x[last]))
