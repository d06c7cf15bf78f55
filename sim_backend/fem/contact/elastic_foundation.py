"""A soft skin on the finger: each node sinks in by its force over its length of surface."""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.elements import Cells, q4
from sim_backend.fem.mesh import Mesh

MAX_STRAIN = 0.5
"""Share of a skin's thickness up to which its stiffness is taken as constant."""


def surface_share(mesh: Mesh, cells: Cells) -> Array:
    """Length (s,) [m] of surface whose even pressure is the force of each of ``mesh.surface``.

    The nodes of a quadratic side carry a sixth, two thirds and a sixth of its force (Simpson's
    rule), those of a linear one halves.
    """
    length = np.hypot(*np.diff(mesh.nodes[mesh.surface], axis=0).T)
    share = np.zeros(len(mesh.surface))
    if cells.shape is q4:
        share[:-1] += length / 2
        share[1:] += length / 2
        return share
    corners = 3 if cells.nodes.shape[1] == 6 else 4
    middle = np.flatnonzero(np.isin(mesh.surface, cells.nodes[:, corners:]))
    middle = middle[(middle > 0) & (middle < len(share) - 1)]
    whole = length[middle - 1] + length[middle]
    share[middle] = 2 * whole / 3
    np.add.at(share, middle - 1, whole / 6)
    np.add.at(share, middle + 1, whole / 6)
    share[share == 0] = np.median(share)  # the ends of a ring's arc, far from any finger
    return share


def simpson(at: Array) -> Array:
    """Share (2n + 1,) of the length of n quadratic lines whose nodes lie ``at`` (2n + 1,)."""
    length = at[2::2] - at[:-2:2]
    share = np.zeros(len(at))
    share[1::2] = 2 * length / 3
    share[:-2:2] += length / 6
    share[2::2] += length / 6
    return share
