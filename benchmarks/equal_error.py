"""What an error costs in three dimensions: `palpate press` and CalculiX, each on meshes of its own.

    python benchmarks/equal_error.py

A ball over a straight vessel in a small block, at two pressures, and a ball over a ball-shaped lump
in a large one, which `press` solves by the axisymmetric model. CalculiX presses both on hexahedra
that get finer (`calculix_solids`, one thread, each load held for one more increment), `press` at
some accuracies, in one run. Differences are from the mean of both codes' finest, which over the
vessel differ by 0.3 % of force and 0.7 % of pulse: CalculiX' meshes go up and down by as much. Goes
on where docs/results/equal-error.csv ends.
"""

from time import process_time

import numpy as np
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
VESSEL, LUMP_8 = "vessel 9 mm deep", "ball 8 mm deep"
LIES = {
    VESSEL: (SMALL, {**ARTERY, "depth_mm": 9.0}, (80.0, 120.0)),
    LUMP_8: (TISSUE, LUMP, (0.0,)),
}
ACCURACIES_PCT = {VESSEL: (5.0, 2.0, 1.5), LUMP_8: (5.0, 2.0, 1.0)}
ANSWERS = ("unknowns", "low_n", "high_n", "stated_pct", "seconds")


def case(scene: str, cells: int) -> str:
    """A case of `calculix_solids` on a mesh of so many cells, by its name."""
    tissue, inclusion, pressures_mmhg = LIES[scene]
    fine = round(FINE_TO_MM / (FINE_AT_4_MM * 4 / cells))
    end_mm = tissue["length_mm"] / 2
    coarse = max(2, round((end_mm - FINE_TO_MM) / 8 * cells))
    edges = np.append(np.linspace(0, FINE_TO_MM, fine + 1),
                      np.linspace(FINE_TO_MM, end_mm, coarse + 1)[1:])  # fmt: skip
    CASES[name := f"{scene}, {cells}"] = Case(
        tissue, inclusion, BALL, pressures_mmhg, cells, tuple(edges.tolist())
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
    tissue, _, pressures_mmhg = LIES[scene]
    pressed, began = scene_of_case(name), process_time()
    found = press(pressed, tissue["width_mm"] / 2, DEPTH_MM, pressures_mmhg,
                  accuracy_pct=float(setting))  # fmt: skip
    spent = process_time() - began
    low, high = (found.states[n].force_n for n in (0, -1))
    return {"unknowns": found.dofs, "low_n": f"{low:.6g}", "high_n": f"{high:.6g}",
            "stated_pct": f"{found.error_estimate_pct:.2g}", "seconds": f"{spent:.1f}"}  # fmt: skip


def main() -> None:
    """Solve what is missing, and tell differences and seconds."""
    jobs = [(scene, "CalculiX", str(cells)) for scene in LIES for cells in CELLS]
    jobs += [(s, "palpate", f"{one:g}") for s in LIES for one in ACCURACIES_PCT[s]]
    fill(OUT, ("scene", "code", "setting"), ANSWERS, jobs, judge)
    for scene in LIES:
        tell(scene, [row for row in read(OUT) if row["scene"] == scene])


def tell(scene: str, rows: list[Row]) -> None:
    """How far each answer is off, and what it cost."""
    rows.sort(key=lambda row: (row["code"], float(row["unknowns"])))
    answers = [(float(r["high_n"]), float(r["high_n"]) - float(r["low_n"])) for r in rows]
    finest = [n for n in range(len(rows)) if rows[n : n + 2][-1]["code"] != rows[n]["code"]]
    middle = np.mean([answers[n] for n in (*finest, len(rows) - 1)], axis=0)
    print(f"{scene}: {middle[0]:.4f} N, a pulse of {1e3 * middle[1]:.2f} mN")
    print("| code | setting | unknowns | force off by [%] | pulse off by [%] | stated [%] | "
          "seconds of processor |")  # fmt: skip
    print("|---" * 7 + "|")
    for row, answer in zip(rows, answers, strict=True):
        pairs = zip(answer, middle, strict=True)
        off = [f"{100 * (a / b - 1):+.2f}" if b else "" for a, b in pairs]
        print(f"| {row['code']} | {row['setting']} | {row['unknowns']} | {off[0]} | "
              f"{off[1]} | {row['stated_pct']} | {row['seconds']} |")  # fmt: skip


if __name__ == "__main__":
    main()
