"""Line search along a step of Newton's method, on the energy.

Where a finger's edge is rounded by less than the elements are long, a node that lies on it carries
the contact force of its whole surroundings. The edge's curvature then takes as much from the
tangent as the tissue adds: as the finger sinks or the pressure rises, the node's place of balance
vanishes, and it slides over the edge. Plain steps leap to and fro where it was. TIHA in 30 mm under
a cylinder of 5 x 10 mm, 12 mm beside the vessel: at 117 mmHg the least imbalance there is 4e-5 of
the force, and beyond the node's slide the force is 0.3 % smaller.
"""

from collections.abc import Sequence

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.body import Body
from sim_backend.fem.contact.bonded import BondedContact

STEEP = 0.5
"""A step ends where the energy's slope along it is within this share of what it was."""
FARTHEST, SHORTEST = 16.0, 1 / 32


def share_of_step(
    body: Body, depth_m: float, pressure_pa: float, u: Array, change: Array,
    pushed: Sequence[Array], bonds: Sequence[BondedContact],
) -> float:  # fmt: skip
    """The share of ``change`` (n, d) [m], doubled or halved, after which energy falls no more.

    ``pushed`` are the contact forces at ``u``, an array per group of pairs: springs of pairs that
    carry one hold either way, the others' keep them apart only.
    """
    way = np.zeros(body.size)
    way[body.free] = change.ravel()[body.free]

    def slope(share: float) -> float:
        there = u + share * change
        residual, _ = body.forces(there, pressure_pa)
        for t, m in zip(body.contact_pairs(there, depth_m, bonds), pushed, strict=True):
            gap = t.open(m)
            closing = np.where((m > 0) | t.bonded, gap, np.minimum(gap, 0.0))
            t.add_force(t.stiffness(body.rules.penalty) * closing - m, residual)
        for bond in bonds:
            bond.add_force(there, residual)
        return float(residual @ way)

    first, share = slope(0.0), 1.0
    now = slope(share)
    while now < STEEP * first < 0 and share < FARTHEST:
        share *= 2
        now = slope(share)
    while now > -STEEP * first > 0 and share > SHORTEST:
        share /= 2
        now = slope(share)
    return share
