"""What an error costs in three dimensions: `palpate press` and CalculiX, each on meshes of its own.

    python benchmarks/equal_error.py

Balls over straight vessels in a small block, at two pressures, and a ball over a ball-shaped lump
in a large one, which `press` solves by the axisymmetric model. CalculiX presses all on hexahedra
that get finer (`calculix_solids`, one thread, each load held for one more increment), `press` at
some accuracies, in one run. Differences are from the mean of both codes' finest; the vessels' are
also squared and averaged, since on one of them a coarse mesh may be right by chance. Goes on where
docs/results/equal-error.csv ends.
"""

from time import process_time

import numpy as np
import pandas as pd
from calculix_solids import (
    ARTERY,
    BALL,
    CASES,
    DEPTH_MM,
    LUMP,
    SMALL,
    TISSUE,
    Case,
    calculix,
    deck,
    mesh_of,
)
from calculix_solids import scene_of as scene_of_case
from kept import ROOT, Row, fill, read

from sim_backend.models.press import press

OUT = ROOT / "docs" / "results" / "equal-error.csv"
CELLS = (1, 2, 3, 4)
"""Hexahedra to 45 degrees around the inclusion; layers under the ball are as fine."""
FINE_TO_MM, FINE_AT_4_MM = 6.0, 0.75
VESSELS = {
    "vessel 9 mm deep": (9.0, 5.0),
    "vessel 7 mm deep": (7.0, 5.0),
    "vessel 11 mm deep": (11.0, 5.0),
    "vessel 9 mm deep, ball of 4 mm": (9.0, 4.0),
    "vessel 9 mm deep, ball of 6.5 mm": (9.0, 6.5),
}
"""Depth and the ball's radius [mm]: on one scene a coarse mesh may be right by chance."""
LUMP_8 = "ball 8 mm deep"
LIES = {
    name: (SMALL, {**ARTERY, "depth_mm": depth_mm}, {**BALL, "radius_mm": radius_mm}, (80.0, 120.0))
    for name, (depth_mm, radius_mm) in VESSELS.items()
} | {LUMP_8: (TISSUE, LUMP, BALL, (0.0,))}
ACCURACIES_PCT = dict.fromkeys(VESSELS, (5.0, 1.5)) | {LUMP_8: (5.0, 2.0, 1.0)}
ANSWERS = ("unknowns", "low_n", "high_n", "stated_pct", "seconds")


def case(scene: str, cells: int) -> str:
    """A case of `calculix_solids` on a mesh of so many cells, by its name."""
    tissue, inclusion, finger, pressures_mmhg = LIES[scene]
    fine = round(FINE_TO_MM / (FINE_AT_4_MM * 4 / cells))
    end_mm = tissue["length_mm"] / 2
    coarse = max(2, round((end_mm - FINE_TO_MM) / 8 * cells))
    edges = np.append(np.linspace(0, FINE_TO_MM, fine + 1),
                      np.linspace(FINE_TO_MM, end_mm, coarse + 1)[1:])  # fmt: skip
    CASES[name := f"{scene}, {cells}"] = Case(
        tissue, inclusion, finger, pressures_mmhg, cells, tuple(edges.tolist())
    )
    return name


def judge(scene: str, code: str, setting: str) -> Row:
    """One code's answer on one of its settings, and seconds of processor."""
    name = case(scene, int(setting) if code == "CalculiX" else CELLS[-1])
    if code == "CalculiX":
        forces, spent = calculix(list(deck(name)))
        low, high = forces[0, 1], forces[-1, 1]
        return {"unknowns": int((mesh_of(name).nodes > 1e-6).sum()), "low_n": f"{low:.6g}",
                "high_n": f"{high:.6g}", "seconds": f"{spent:.1f}"}  # fmt: skip
    tissue, _, _, pressures_mmhg = LIES[scene]
    pressed, began = scene_of_case(name), process_time()
    found = press(pressed, tissue["width_mm"] / 2, DEPTH_MM, pressures_mmhg,
                  accuracy_pct=float(setting))  # fmt: skip
    spent = process_time() - began
    low, high = (found.states[n].force_n for n in (0, -1))
    return {"unknowns": found.dofs, "low_n": f"{low:.6g}", "high_n": f"{high:.6g}",
            "stated_pct": f"{found.error_estimate_pct:.2g}", "seconds": f"{spent:.1f}"}  # fmt: skip


def main() -> None:
    """Solve what is missing, and tell differences and seconds."""
    jobs = [
        (scene, code, setting)
        for scene in LIES
        for code, settings in (("CalculiX", CELLS), ("palpate", ACCURACIES_PCT[scene]))
        for setting in (f"{one:g}" for one in settings)
    ]
    fill(OUT, ("scene", "code", "setting"), ANSWERS, jobs, judge)
    every = pd.concat(off_by(scene, read(OUT)) for scene in LIES)
    print(every.round(2).to_string(index=False))
    vessels = every[every.scene.isin(list(VESSELS))]
    print("all vessels: root mean squares [%] and mean seconds")
    print(vessels.groupby(["code", "setting"])[["force_pct", "pulse_pct", "seconds"]].agg(
        {"force_pct": _rms, "pulse_pct": _rms, "seconds": "mean"}
    ).round(2).to_string())  # fmt: skip


def off_by(scene: str, rows: list[dict[str, str]]) -> pd.DataFrame:
    """How far each answer of a scene is off [%], and what it cost."""
    found = pd.DataFrame([row for row in rows if row["scene"] == scene])
    answers = ["unknowns", "low_n", "high_n", "seconds"]
    found[answers] = found[answers].astype(float)
    found = found.sort_values(["code", "unknowns"])
    found["pulse_n"] = found["high_n"] - found["low_n"]
    finest = found.groupby("code").tail(1)[["high_n", "pulse_n"]].mean()
    found["force_pct"] = 100 * (found["high_n"] / finest["high_n"] - 1)
    found["pulse_pct"] = 100 * (found["pulse_n"] / finest["pulse_n"] - 1)
    return found[["scene", "code", "setting", "unknowns", "force_pct", "pulse_pct", "stated_pct",
                  "seconds"]]  # fmt: skip


def _rms(values: "pd.Series[float]") -> float:
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    main()
