"""A picture of the way that the tip of a planned scan takes."""

from pathlib import Path

import numpy as np

from drivers.core.extras import needs
from drivers.core.files import naming
from probe.config.rig import Rig
from probe.config.scan_plan import plan_for


def draw_path(rig: Rig, file: Path) -> None:
    """A picture of the tip's way: from the side and, for grids, from above."""
    with needs("report", "the picture of the probe's way"):
        from matplotlib.figure import Figure

    plan, box = plan_for(rig), rig.safety.workspace_mm
    points = [
        (1e3 * pose.x, 1e3 * pose.y, 1e3 * (pose.z - depth))
        for place in plan.places
        for pose, depth in (
            (plan.above(place), 0.0),
            (plan.at_surface(place), plan.indentation_m),
            (plan.above(place), 0.0),
        )
    ]
    x, y, z = np.array(points).T
    figure = Figure(figsize=(8, 6), layout="constrained")
    side, top = figure.subplots(2, 1)
    side.plot(x, z, lw=1, label="tip")
    surface = [1e3 * plan.at_surface(place).z for place in plan.places]
    side.plot([1e3 * p.x_m for p in plan.places], surface, "k.-", lw=0.5, label="surface")
    side.set(xlabel="x [mm]", ylabel="z [mm]", title="from the side")
    side.legend(loc="upper right")
    top.plot(x, y, "o-", ms=3, lw=1)
    top.set(xlabel="x [mm]", ylabel="y [mm]", title="from above, with the workspace")
    top.plot(
        [box.x[0], box.x[1], box.x[1], box.x[0], box.x[0]],
        [box.y[0], box.y[0], box.y[1], box.y[1], box.y[0]],
        "r--", lw=1,
    )  # fmt: skip
    with naming(file):
        figure.savefig(file, dpi=120)
