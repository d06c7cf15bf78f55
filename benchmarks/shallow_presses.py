"""Presses so shallow that few nodes touch: how far the force is off, over what is stated of it.

    python benchmarks/shallow_presses.py

Cylinders in plane strain and balls, 0.5 um to 2 mm deep in a bare block, by `press` at three
accuracies, against a mesh of 32 elements under half of the contact's width, whose change from 16 is
kept as ``finest_pct``. Goes on where docs/results/shallow-presses.csv ends.
"""

import numpy as np
import pandas as pd
from kept import ROOT, Row, fill, read

from sim_backend.fem.axisymmetric import solve_axisymmetric
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import Grading
from sim_backend.models.refine import refine
from sim_backend.scene.scene_file import Scene

OUT = ROOT / "docs" / "results" / "shallow-presses.csv"
WIDTH_MM, HEIGHT_MM = 64.0, 16.83
RADII_MM = {"finite": (2.0, 5.0, 12.0), "axisymmetric": (2.0, 5.0)}
DEPTHS_MM = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.3, 1.0, 2.0)
ACCURACIES_PCT = (5.0, 1.0, 0.3)
FINEST = (16, 32)
"""Elements under half of the contact's width."""
FEW = 10


def scene_of(model: str, radius_mm: float) -> Scene:
    """A bare block under a cylinder, or under a ball in three dimensions."""
    tissue = {"width_mm": WIDTH_MM, "height_mm": HEIGHT_MM, "modulus_kpa": 50.0, "poisson": 0.45}
    plane, finger = "strain", "cylinder"
    if model == "axisymmetric":
        plane, finger, tissue = "solid", "sphere", tissue | {"length_mm": WIDTH_MM}
    finger_of = {"shape": finger, "radius_mm": radius_mm}
    return Scene.model_validate(
        {"name": "shallow", "plane": plane, "tissue": tissue, "indenter": finger_of}
    )


def finest(model: str, radius_mm: float, depth_mm: float) -> list[float]:
    """The force on both of the `FINEST` meshes."""
    half_m = 1e-3 * np.sqrt(radius_mm * depth_mm * (1.0 if model == "axisymmetric" else 0.5))
    place = scene_of(model, radius_mm), 0.5e-3 * WIDTH_MM, 1e-3 * depth_mm
    forces = []
    for elements in FINEST:
        size_m = half_m / elements
        grading = Grading(size_m, lambda radius_m: 0.2 * radius_m, 0.35, 0.1e-3 * HEIGHT_MM)
        solved = (solve_axisymmetric(*place, grading, None) if model == "axisymmetric" else
                  solve_finite(*place, [0.0], 10 * size_m, grading=grading))  # fmt: skip
        forces.append(solved[1][0].force_n_per_m)
    return forces


def judge(model: str, radius: str, depth: str) -> Row:
    """One place's errors at each accuracy."""
    radius_mm, depth_mm = float(radius), float(depth)
    before, truth = finest(model, radius_mm, depth_mm)
    row = {"finest_pct": f"{100 * abs(before / truth - 1):.2g}"}
    for asked in ACCURACIES_PCT:
        found = refine(model, scene_of(model, radius_mm), 0.5e-3 * WIDTH_MM, 1e-3 * depth_mm, [0.0],
                       np.array([asked, np.inf]))  # fmt: skip
        (state,) = found.solved[1]
        row |= {f"nodes_{asked:g}": int((state.multiplier[0] > 0).sum()),
                f"off_{asked:g}_pct": f"{100 * (state.force_n_per_m / truth - 1):.3g}",
                f"states_{asked:g}_pct": f"{found.error_pct[0]:.3g}"}  # fmt: skip
    return row


def main() -> None:
    """Solve what is missing, and tell errors over what is stated, and times the pressed nodes."""
    jobs = [(model, f"{radius:g}", f"{depth:g}") for model, radii in RADII_MM.items()
            for radius in radii for depth in DEPTHS_MM]  # fmt: skip
    parts = ("nodes_{:g}", "off_{:g}_pct", "states_{:g}_pct")
    answers = ("finest_pct", *(part.format(one) for one in ACCURACIES_PCT for part in parts))
    fill(OUT, ("model", "radius_mm", "depth_mm"), answers, jobs, judge)
    table = pd.DataFrame(read(OUT))
    numbers = table[list(answers)].apply(pd.to_numeric)
    for model, some in numbers.groupby(table.model):
        for asked in ACCURACIES_PCT:
            off = some[f"off_{asked:g}_pct"].abs()
            over, nodes = off / some[f"states_{asked:g}_pct"], some[f"nodes_{asked:g}"]
            times = (off * nodes)[nodes <= FEW].max()
            print(f"{model}, {asked:g} %: {len(some)} presses, over what is stated "
                  f"{over.median():.2f} (median), {over.max():.2f} at most; times the nodes "
                  f"pressed, up to {FEW}, {times:.1f} at most")  # fmt: skip


if __name__ == "__main__":
    main()
