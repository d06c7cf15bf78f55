"""The reason why there is no equilibrium beyond a load, in words."""

from sim_backend.fem.contact.elastic_foundation import MAX_STRAIN
from sim_backend.fem.internal import smallest_area_ratio
from sim_backend.fem.mesh import TISSUE
from sim_backend.fem.model import Section
from sim_backend.fem.newton import (
    CannotSolve,
    Load,
    NotConverged,
    SkinPressedFlat,
    Solution,
    Unstable,
)
from sim_backend.scene.waves import PA_PER_MMHG


def physical_limit(
    section: Section, last: Solution, goal: Load, failure: NotConverged
) -> CannotSolve:
    """Why there is no equilibrium between ``last`` and ``goal``."""
    ratio, cell = smallest_area_ratio(section, last.displacement)
    x_mm, y_mm = 1e3 * section.mesh.nodes[section.cells.nodes[cell]].mean(axis=0)
    depth_mm, mmhg = 1e3 * last.load.depth_m, last.load.pressure_pa / PA_PER_MMHG
    there = f"{depth_mm:.4g} mm deep" if depth_mm > 0 else "before the finger touches"
    # A vessel is filled with the finger in the air, so the last depth may be negative.
    deeper = f"deeper than {depth_mm:.4g} mm" if depth_mm > 0 else "once the finger touches"
    instead = "Press less deep" if depth_mm > 0 else "Take a lower pressure or a stiffer body"
    across = "x" if section.cells.hoop is None else "r"  # from the axis that a section turns about
    where = f"at {across} = {x_mm:.2f} mm, {y_mm:.2f} mm above the support"
    lone = not (section.mesh.region == TISSUE).any()
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
    folds = bool(section.lumens) and section.mesh.region[cell] != TISSUE
    what = "the vessel's wall folds" if folds else "the tissue is crushed or buckles"
    return CannotSolve(
        "greatest depth",
        f"found no equilibrium {deeper} at {mmhg:.4g} mmHg: {what} {where} "
        f"(det F = {ratio:.2g}; {failure}). {instead}.",
    )
