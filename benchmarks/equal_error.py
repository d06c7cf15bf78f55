"""What an error costs in three dimensions: `palpate press` and CalculiX, each on meshes of its own.

    python benchmarks/equal_error.py

A ball over a straight vessel in a small block, at two pressures. CalculiX presses it on hexahedra
that get finer (`calculix_solids`, one thread, each load held for one more increment), `press` at
three accuracies, in one run. Differences are from the mean of both codes' finest, which differ by
0.3 % of force and 0.7 % of pulse: CalculiX' meshes go up and down by as much. Goes on where
docs/results/equal-error.csv ends.
"""

from time import process_time

import numpy as np
from calculix_solids import ARTERY, BALL, CASES, DEPTH_MM, SMALL, Case, calculix, deck, mesh_of
from calculix_solids import scene_of as scene_of_case
from kept import ROOT, Row, fill, read

from sim_backend.models.press import press

OUT = ROOT / "docs" / "results" / "equal-error.csv"
PRESSURES_MMHG = (80.0, 120.0)
CELLS = (1, 2, 3, 4)
"""Hexahedra to 45 degrees around the vessel; layers under the ball are as fine."""
ACCURACIES_PCT = (5.0, 2.0, 1.5)
FINE_TO_MM, LENGTH_MM, FINE_AT_4_MM = 6.0, 10.0, 0.75
ANSWERS = ("unknowns", "low_n", "high_n", "stated_pct", "seconds")


def case(cells: int) -> str:
    """A case of `calculix_solids` on a mesh of so many cells, by its name."""
    fine = round(FINE_TO_MM / (FINE_AT_4_MM * 4 / cells))
    coarse = max(2, round(cells / 2))
    edges = np.append(np.linspace(0, FINE_TO_MM, fine + 1),
                      np.linspace(FINE_TO_MM, LENGTH_MM, coarse + 1)[1:])  # fmt: skip
    CASES[name := f"ball over a vessel, {cells}"] = Case(
        SMALL, {**ARTERY, "depth_mm": 9.0}, BALL, PRESSURES_MMHG, cells, tuple(edges.tolist())
    )
    return name


def judge(code: str, setting: str) -> Row:
    """One code's answer on one of its settings, and seconds of processor."""
    if code == "CalculiX":
        name = case(int(setting))
        forces, spent = calculix(list(deck(name)))
        low, high = forces[:, 1]
        return {"unknowns": int((mesh_of(name).nodes > 1e-6).sum()), "low_n": f"{low:.6g}",
                "high_n": f"{high:.6g}", "seconds": f"{spent:.1f}"}  # fmt: skip
    scene = scene_of_case(case(4))
    began = process_time()
    found = press(scene, 12.0, DEPTH_MM, PRESSURES_MMHG, accuracy_pct=float(setting))
    spent = process_time() - began
    low, high = (state.force_n for state in found.states)
    return {"unknowns": found.dofs, "low_n": f"{low:.6g}", "high_n": f"{high:.6g}",
            "stated_pct": f"{found.error_estimate_pct:.2g}", "seconds": f"{spent:.1f}"}  # fmt: skip


def main() -> None:
    """Solve what is missing, and tell differences and seconds."""
    jobs = [("CalculiX", str(cells)) for cells in CELLS]
    jobs += [("palpate", f"{one:g}") for one in ACCURACIES_PCT]
    fill(OUT, ("code", "setting"), ANSWERS, jobs, judge)
    rows = sorted(read(OUT), key=lambda row: (row["code"], float(row["unknowns"])))
    answers = [
        (float(r["high_n"]), float(r["high_n"]) - float(r["low_n"])) for r in rows
    ]  # force, pulse
    finest = [n for n in range(len(rows)) if rows[n : n + 2][-1]["code"] != rows[n]["code"]]
    middle = np.mean([answers[n] for n in (*finest, len(rows) - 1)], axis=0)
    print(f"{middle[0]:.4f} N at {PRESSURES_MMHG[1]:g} mmHg, a pulse of {1e3 * middle[1]:.2f} mN")
    print("| code | setting | unknowns | force off by [%] | pulse off by [%] | stated [%] | "
          "seconds of processor |")  # fmt: skip
    print("|---" * 7 + "|")
    for row, answer in zip(rows, answers, strict=True):
        off = [100 * (a / b - 1) for a, b in zip(answer, middle, strict=True)]
        print(f"| {row['code']} | {row['setting']} | {row['unknowns']} | {off[0]:+.2f} | "
              f"{off[1]:+.2f} | {row['stated_pct']} | {row['seconds']} |")  # fmt: skip


if __name__ == "__main__":
    main()
