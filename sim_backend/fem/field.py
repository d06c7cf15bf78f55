"""Values at nodes as a function of place."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from sim_backend.arrays import Array


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
