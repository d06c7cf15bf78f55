"""What an error costs in three dimensions: `palpate press` and CalculiX, each on meshes of its own.

    python benchmarks/equal_error.py

A ball over a straight vessel in a small block, at two pressures. CalculiX presses it on hexahedra
that get finer (`calculix_solids`, one thread, each load held for one more increment), `press` at
three accuracies, in one run. Errors are against what CalculiX' meshes go to (Richardson 1911: by
the three finest, whose sizes have a rate) and against the finest press; both are told. Goes on
where docs/results/equal-error.csv ends.
"""

from time import process_time

import numpy as np
from calculix_solids import ARTERY, BALL, CASES, DEPTH_MM, SMALL, Case, calculix, deck, mesh_of
from calculix_solids import scene_of as scene_of_case
from kept import ROOT, Row, fill, read

from sim_backend.models.press import press

OUT = ROOT / "docs" / "results" / "equal-error.csv"
PRESSURES_MMHG = (80.0, 120.0)
CELLS = (2, 3, 4, 5)
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


def limit(sizes: np.ndarray, values: np.ndarray) -> float:
    """Where ``values`` (3,) at element ``sizes`` (3,), coarse first, go as v + c h^p; the finest
    where they do not go anywhere."""
    for rate in np.linspace(0.5, 6.0, 551):
        powers = sizes**rate
        slope = (values[0] - values[1]) / (powers[0] - powers[1])
        if (values[1] - values[2] - slope * (powers[1] - powers[2])) * np.sign(slope) >= 0:
            return float(values[2] - slope * powers[2])
    return float(values[2])


def main() -> None:
    """Solve what is missing, and tell errors and seconds."""
    jobs = [(code, setting) for cells, accuracy in zip(CELLS, (*ACCURACIES_PCT, None), strict=True)
            for code, setting in (("CalculiX", str(cells)), ("palpate", accuracy))
            if setting is not None]  # fmt: skip
    fill(OUT, ("code", "setting"), ANSWERS, jobs, judge)
    rows = read(OUT)
    theirs = [r for r in rows if r["code"] == "CalculiX"]
    answers = {id(r): (float(r["high_n"]), float(r["high_n"]) - float(r["low_n"])) for r in rows}
    sizes = 1 / np.array([float(r["setting"]) for r in theirs])
    told = np.array([answers[id(r)] for r in theirs])
    limits = [limit(sizes[-3:], told[-3:, k]) for k in (0, 1)]
    finest = [answers[id(r)] for r in rows if r["code"] == "palpate"][-1]
    print(f"CalculiX goes to {limits[0]:.4f} N and a pulse of {1e3 * limits[1]:.2f} mN; the finest "
          f"press says {finest[0]:.4f} N and {1e3 * finest[1]:.2f} mN")  # fmt: skip
    print("| code | setting | unknowns | force off by [%] | pulse off by [%] | stated [%] | "
          "seconds of processor |")  # fmt: skip
    print("|---" * 7 + "|")
    for row in rows:
        off = [100 * (a / b - 1) for a, b in zip(answers[id(row)], limits, strict=True)]
        print(f"| {row['code']} | {row['setting']} | {row['unknowns']} | {off[0]:+.2f} | "
              f"{off[1]:+.2f} | {row['stated_pct']} | {row['seconds']} |")  # fmt: skip


if __name__ == "__main__":
    main()
