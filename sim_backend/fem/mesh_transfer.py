"""An answer on one mesh as the beginning on a finer one (nested iteration; Hackbusch 1985, ch. 5).

Newton's method then needs about six iterations where a ramp of loads needs thirty.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from sim_backend.arrays import Array
from sim_backend.fem.continuation import stable_branch
from sim_backend.fem.model import Section
from sim_backend.fem.newton import PAIRS_WITH_OPEN_LUMENS, NotConverged, Solution, equilibrium
from sim_backend.fem.section_pairs import contact_pairs, walls_cross


def continued(coarse: Section, solution: Solution, fine: Section) -> Solution:
    """``solution`` of ``coarse`` solved on ``fine``: where that is not stable there, the stable one
    that it falls to. Raises `NotConverged`."""
    closed = len(solution.multiplier) > PAIRS_WITH_OPEN_LUMENS
    section = fine.with_self_contact if closed else fine
    found = equilibrium(section, _carried(coarse, solution, section), solution.load)
    if not found.stable:
        found = stable_branch(fine, found)
    if not closed and walls_cross(fine, found.displacement):
        raise NotConverged("a lumen's walls meet, as they did not on the coarser mesh")
    return found


def _carried(coarse: Section, solution: Solution, fine: Section) -> Solution:
    u = Field(coarse.mesh.nodes, solution.displacement)(fine.mesh.nodes)
    u.ravel()[fine.fixed] = 0.0
    surface = fine.mesh.surface
    bonded_at_m: tuple[Array | None, ...] = (None, None)
    multiplier = [np.zeros(len(t.gap)) for t in contact_pairs(fine, fine.finger, u)]
    touched = coarse.mesh.nodes[coarse.mesh.surface[solution.multiplier[0] > 0], 0]
    if len(touched):  # the force spread evenly: Newton's method only needs to know where it is
        x = fine.mesh.nodes[surface, 0]
        within = (x >= touched.min()) & (x <= touched.max())
        multiplier[0][within] = solution.multiplier[0].sum() / max(int(within.sum()), 1)
        if fine.finger.bonded:
            bonded_at_m = (np.where(within, u[surface, 0], np.nan), None)
    return Solution(solution.load, u, tuple(multiplier), 0.0, 0, bonded_at_m)


@dataclass(frozen=True)
class Field:
    """Displacements ``values`` (n, 2) of ``nodes`` (n, 2) [m], at any points between them.

    Linear between the nodes, also across lumens, and the nearest one's beyond them. (Not scipy's
    LinearNDInterpolator: importing scipy.interpolate takes as long as a press.)
    """

    nodes: Array
    values: Array

    @cached_property
    def _triangles(self) -> Delaunay:
        return Delaunay(self.nodes)

    def __call__(self, points: Array) -> Array:
        """Displacements (p, 2) at ``points`` (p, 2)."""
        where = self._triangles.find_simplex(points)
        transform = self._triangles.transform[where]
        share = np.einsum("pij,pj->pi", transform[:, :2], points - transform[:, 2])
        share = np.column_stack([share, 1 - share.sum(axis=1)])
        found = np.einsum("pk,pki->pi", share, self.values[self._triangles.simplices[where]])
        beyond = (where < 0) | ~np.isfinite(found).all(axis=1)
        if beyond.any():
            found[beyond] = self.values[cKDTree(self.nodes).query(points[beyond])[1]]
        return np.asarray(found)
