"""A solid's answer on one mesh as the beginning on a finer one.

As `sim_backend.fem.mesh_transfer` does for a plane.
"""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.mesh_transfer import Field
from sim_backend.fem.solid.body import Body
from sim_backend.fem.solid.newton import SolidSolution


def carried(coarse: Body, solution: SolidSolution, fine: Body) -> SolidSolution:
    """``solution`` of ``coarse`` at the nodes of ``fine``: linear between nodes of the sections and
    between planes. The contact force is spread evenly over what touched: Newton's method only
    needs to know where that is."""
    u = _between(coarse, solution.displacement, fine)
    u.ravel()[fine.fixed] = 0.0
    pressed = np.zeros((len(coarse.wedges.nodes), 1))
    pressed[coarse.surface[solution.multiplier > 0]] = 1.0
    within = _between(coarse, pressed, fine)[fine.surface, 0] > 0.5
    if not within.any():
        finger = fine.finger.lowered_by(solution.load.depth_m)
        within = finger.gap((fine.wedges.nodes + u)[fine.surface])[0] < 0
    share = float(solution.multiplier.sum()) / max(int(within.sum()), 1)
    multiplier = np.where(within, share, 0.0)
    return SolidSolution(solution.load, u, multiplier, solution.force_n, 0)


def _between(coarse: Body, values: Array, fine: Body) -> Array:
    """``values`` (n, k) of the coarse prism's nodes at the fine one's (f, k)."""
    section, planes = coarse.prism
    at_section, at_planes = fine.prism
    count, k = len(section), values.shape[1]
    columns = np.moveaxis(values.reshape(len(planes), count, k), 0, 1).reshape(count, -1)
    along = Field(section, columns)(at_section).reshape(len(at_section), len(planes), k)
    above = np.clip(np.searchsorted(planes, at_planes), 1, len(planes) - 1)
    share = (at_planes - planes[above - 1]) / (planes[above] - planes[above - 1])
    share = np.clip(share, 0.0, 1.0)[:, None]
    placed = (1 - share) * along[:, above - 1] + share * along[:, above]
    return np.asarray(np.moveaxis(placed, 1, 0).reshape(-1, k))
