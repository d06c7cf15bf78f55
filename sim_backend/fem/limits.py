"""The reason why there is no equilibrium beyond a load, in words."""

from sim_backend.fem.body import Body
from sim_backend.fem.contact.elastic_foundation import MAX_STRAIN
from sim_backend.fem.newton import (
    CannotSolve,
    Load,
    NotConverged,
    SkinPressedFlat,
    Solution,
    Unstable,
)
from sim_backend.scene.waves import PA_PER_MMHG


def physical_limit(body: Body, last: Solution, goal: Load, failure: NotConverged) -> CannotSolve:
    """Why there is no equilibrium between ``last`` and ``goal``."""
    ratio, cell = body.smallest_volume_ratio(last.displacement)
    where, lone = body.where(cell), body.lone
    depth_mm, mmhg = 1e3 * last.load.depth_m, last.load.pressure_pa / PA_PER_MMHG
    there = f"{depth_mm:.4g} mm deep" if depth_mm > 0 else "before the finger touches"
    # A vessel is filled with the finger in the air, so the last depth may be negative.
    deeper = f"deeper than {depth_mm:.4g} mm" if depth_mm > 0 else "once the finger touches"
    instead = "Press less deep" if depth_mm > 0 else "Take a lower pressure or a stiffer body"
    fills = goal.pressure_pa > last.load.pressure_pa
    if fills and (lone or depth_mm <= 0 or not isinstance(failure, Unstable)):
        return CannotSolve(
            "limit pressure",
            f"found no equilibrium above {mmhg:.4g} mmHg, {there}, on this mesh: the wall "
            f"inflates without bound about there ({failure}; smallest det F {ratio:.2g} {where}). "
            "Take a lower pressure, a thicker or a stiffer wall.",
        )
    if lone:
        return CannotSolve(
            "greatest depth",
            f"found no equilibrium {deeper} at {mmhg:.4g} mmHg: the wall "
            "of the lone vessel folds or is crushed "
            f"({failure}; smallest det F {ratio:.2g} {where}). Press over its middle or less deep.",
        )
    if isinstance(failure, Unstable):
        return CannotSolve(
            "stability",
            f"found no stable equilibrium beyond {mmhg:.4g} mmHg, {there}: the body "
            f"snaps or rolls away there (smallest det F {ratio:.2g} {where}). Press less deep or "
            "take a lower pressure.",
        )
    if isinstance(failure, SkinPressedFlat):
        return CannotSolve(
            "skin",
            f"found no equilibrium {deeper}: {failure}, and is modelled up to "
            f"{100 * MAX_STRAIN:.0f} %. Press less deep or take a stiffer skin.",
        )
    what = "the vessel's wall folds" if body.in_vessel(cell) else "the tissue is crushed or buckles"
    return CannotSolve(
        "greatest depth",
        f"found no equilibrium {deeper} at {mmhg:.4g} mmHg: {what} {where} "
        f"(det F = {ratio:.2g}; {failure}). {instead}.",
    )
