"""An answer on one mesh as the beginning on a finer one (nested iteration; Hackbusch 1985, ch. 5).

Newton's method then needs about six iterations where a ramp of loads needs thirty.
"""

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.body import Body
from sim_backend.fem.contact.bonded import ALONG
from sim_backend.fem.continuation import stable_branch
from sim_backend.fem.newton import NotConverged, Solution, as_solved, equilibrium


def continued(coarse: Body, solution: Solution, fine: Body) -> Solution:
    """``solution`` of ``coarse`` solved on ``fine``: where that is not stable there, the stable one
    that it falls to. Raises `NotConverged`."""
    body = as_solved(fine, solution)
    found = equilibrium(body, _carried(coarse, solution, body), solution.load)
    if found.stable is False:
        found = stable_branch(fine, found)
    if body is fine and fine.walls_cross(found.displacement):
        raise NotConverged("a lumen's walls meet, as they did not on the coarser mesh")
    return found


def _carried(coarse: Body, solution: Solution, fine: Body) -> Solution:
    """The contact force is spread evenly over what touched: Newton's method only needs to know
    where that is."""
    u = coarse.carried(solution.displacement, fine)
    u.ravel()[fine.fixed] = 0.0
    pairs = fine.contact_pairs(u, solution.load.depth_m)
    multiplier = [np.zeros(len(t.gap)) for t in pairs]
    pressed = np.zeros((len(coarse.nodes), 1))
    pressed[coarse.surface[solution.multiplier[0] > 0]] = 1.0
    within = coarse.carried(pressed, fine)[fine.surface, 0] > 0.5
    force = float(solution.multiplier[0].sum())
    if force > 0:
        if not within.any():
            within = pairs[0].gap < 0
        multiplier[0][within] = force / max(int(within.sum()), 1)
    bonded_at_m: tuple[Array | None, ...] = (None, None)
    if any(bond.sticks for bond in fine.bonds((None, None))[:1]):
        level = u[fine.surface][:, list(ALONG[u.shape[1]])]
        bonded_at_m = (np.where(within[:, None], level, np.nan), None)
    return Solution(solution.load, u, tuple(multiplier), 0.0, 0, bonded_at_m)
