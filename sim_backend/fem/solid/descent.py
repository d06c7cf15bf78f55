"""Line search along a step of Newton's method, on the energy.

Where a finger's edge is rounded by less than the elements are long, a node that lies on it carries
the contact force of its whole surroundings. The edge's curvature then takes as much from the
tangent as the tissue adds: as the finger sinks or the pressure rises, the node's place of balance
vanishes, and it slides over the edge. Plain steps leap to and fro where it was. TIHA in 30 mm under
a cylinder of 5 x 10 mm, 12 mm beside the vessel: at 117 mmHg the least imbalance there is 4e-5 of
the force, and beyond the node's slide the force is 0.3 % smaller.
"""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.assembly import gather
from sim_backend.fem.newton import Load
from sim_backend.fem.solid.balance import body_forces
from sim_backend.fem.solid.body import Body

STEEP = 0.5
"""A step ends where the energy's slope along it is within this share of what it was."""
FARTHEST, SHORTEST = 16.0, 1 / 32


def share_of_step(
    body: Body, load: Load, u: Array, change: Array, pushed: Array, penalty: float
) -> float:
    """The share of ``change`` (n, 3) [m], doubled or halved, after which energy falls no more.

    ``pushed`` (s,) are the contact forces [N] at ``u`` of nodes whose springs hold either way, and
    zero of others, which ``penalty`` [N/m] keeps out of the finger only.
    """
    finger = body.finger.lowered_by(load.depth_m)
    way = np.zeros(body.size)
    way[body.free] = change.ravel()[body.free]

    def slope(share: float) -> float:
        there = u + share * change
        gap, normal, _ = finger.gap((body.wedges.nodes + there)[body.surface])
        force = pushed - penalty * np.where(pushed > 0, gap, np.minimum(gap, 0.0))
        residual, _ = body_forces(body, there, load.pressure_pa)
        residual -= gather(body.size, body.contact_dofs, force[:, None] * normal)
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
