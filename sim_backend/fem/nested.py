"""An answer on one mesh as the beginning on a finer one (nested iteration; Hackbusch 1985, ch. 5).

Newton's method then needs about six sweeps where a ramp of loads needs thirty.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from sim_backend.fem.newton import OPEN_TOUCHES, NotConverged, Solution, equilibrium
from sim_backend.fem.section import Section
from sim_backend.fem.touch import touches, walls_cross

Array = NDArray[np.float64]


def continued(coarse: Section, solution: Solution, fine: Section) -> Solution:
    """``solution`` of ``coarse`` solved on ``fine``. Raises `NotConverged`."""
    shut = len(solution.push) > OPEN_TOUCHES
    section = fine.closable if shut else fine
    found = equilibrium(section, _carried(coarse, solution, section), solution.load)
    if not shut and walls_cross(fine, found.displacement):
        raise NotConverged("a lumen's walls meet, as they did not on the coarser mesh")
    return found


def _carried(coarse: Section, solution: Solution, fine: Section) -> Solution:
    u = _interpolated(coarse.mesh.nodes, solution.displacement, fine.mesh.nodes)
    u.ravel()[fine.held] = 0.0
    surface = fine.mesh.surface
    stuck_m = None
    push = [np.zeros(len(t.gap)) for t in touches(fine, fine.finger, u)]
    touched = coarse.mesh.nodes[coarse.mesh.surface[solution.push[0] > 0], 0]
    if len(touched):  # the force spread evenly: Newton's method only needs to know where it is
        x = fine.mesh.nodes[surface, 0]
        within = (x >= touched.min()) & (x <= touched.max())
        push[0][within] = solution.push[0].sum() / max(int(within.sum()), 1)
        if solution.stuck_m is not None:
            stuck_m = np.where(within, u[surface, 0], np.nan)
    return Solution(solution.load, u, tuple(push), 0.0, 0, stuck_m)


def _interpolated(nodes: Array, values: Array, points: Array) -> Array:
    """Linear between the nodes, also across lumens, and the nearest one's beyond them."""
    found = np.asarray(LinearNDInterpolator(nodes, values)(points))
    beyond = ~np.isfinite(found).all(axis=1)
    found[beyond] = values[cKDTree(nodes).query(points[beyond])[1]]
    return found
