"""Is `press` by itself honest and cheap? Random scenes against converged answers and hand-picking.

    python benchmarks/choice.py [SCENES] [TABLE.csv]

For each scene and budget: the true error of force and pulse beside the stated one, and the time
beside that of the cheapest setting (model x element x size) a hand could have picked that meets
the same budget. The hand knows the truth beforehand and solves once; nobody has that in practice,
so a ratio of 2 is what knowing one's own error costs. Times are the processor's, medians of
`TURNS` in which the press and the hand's pick take turns; a setting that takes longer than one
that was good enough is broken off. Each scene is a row of
docs/results/choice.csv, and a run goes on where the last one stopped.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
from kept import ROOT, Row, fill, run
from random_presses import TooLong, within

from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import Grading
from sim_backend.fem.newton import CannotSolve
from sim_backend.fem.small_strain import solve_small
from sim_backend.models.press import press
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

TABLE = ROOT / "docs" / "results" / "choice.csv"
ANSWERS = (
    "kind", "plane", "aside_mm", "depth_mm", "budget_pct", "model", "true_pct", "stated_pct",
    "pulse_share", "dofs", "seconds", "by_hand_s", "by_hand",
)  # fmt: skip
SEED = 0
BUDGETS_PCT = (0.5, 1.0, 2.0, 5.0)
HAND = [
    (model, element, share)
    for model in ("small", "finite")
    for element in ("T6", "Q4R")
    for share in (0.25, 0.12, 0.06)
]
"""What a hand may pick; element sizes are shares of the finger's half width."""
TRUTH_SHARES = (0.25, 0.1, 0.04)
"""Meshes of the converged answer, each the next one's beginning; the contact is ten times finer."""
TURNS = 7
SMALL_PULSE = 1e-3
"""As `press`: pulses below this share of the force are judged against the share."""


Case = tuple[Scene, float, float, tuple[float, ...]]


def random_case(rng: np.random.Generator) -> Case:
    """A scene, x [mm], depth [mm] and pressures [mmHg]."""
    nu = float(rng.choice([0.3, 0.45, 0.49]))
    raw: dict[str, object] = {
        "name": "random",
        "plane": str(rng.choice(["stress", "strain"])),
        "tissue": {"width_mm": 64.0, "height_mm": float(rng.uniform(14, 24)),
                   "modulus_kpa": float(rng.uniform(10, 100)), "poisson": nu},
        "indenter": {"shape": "cylinder", "radius_mm": float(rng.uniform(3, 9)), "length_mm": 10.0},
        "pulse": {"wave": "brachial", "rate_bpm": 72.0},
    }  # fmt: skip
    x = float(rng.uniform(12, 52))
    modulus = 50.0 * float(10 ** rng.uniform(0.5, 1.5))
    kind = rng.choice(["nothing", "tumour", "artery"])
    if kind == "tumour":
        raw["inclusion"] = [{"kind": "tumour", "x_mm": 32.0, "depth_mm": float(rng.uniform(5, 9)),
                             "diameter_mm": float(rng.uniform(2, 6)), "modulus_kpa": modulus,
                             "poisson": nu}]  # fmt: skip
    elif kind == "artery":
        raw["inclusion"] = [{"kind": "artery", "x_mm": 32.0, "depth_mm": float(rng.uniform(6, 9)),
                             "inner_diameter_mm": float(rng.uniform(2, 5)),
                             "wall_mm": float(rng.uniform(0.4, 1.0)), "modulus_kpa": modulus + 150,
                             "poisson": nu}]  # fmt: skip
    pressures = (80.0, 120.0) if kind == "artery" else (0.0,)
    return Scene.model_validate(raw), x, float(rng.uniform(0.1, 3.0)), pressures


def off_pct(forces: Sequence[float], truth: Sequence[float]) -> float:
    """Largest error of force and of the span over the pressures [%]."""
    a, b = np.array(forces), np.array(truth)
    off = float(np.abs(a / b - 1).max())
    if len(b) > 1:
        floor = max(float(np.ptp(b)), SMALL_PULSE * float(b.max()))
        off = max(off, float(abs(np.ptp(a) - np.ptp(b))) / floor)
    return 100 * off


def converged(scene: Scene, x_mm: float, depth_mm: float, levels: list[float]) -> list[float]:
    """Forces [N/mm]."""
    half_m = 0.5e-3 * scene.indenter.width_mm_projected
    solved = None
    for share in TRUTH_SHARES:
        size_m = share * half_m
        grading = Grading(0.1 * size_m, partial(at_wall, size_m), 0.35, 2e-3)
        solved = solve_finite(scene, 1e-3 * x_mm, 1e-3 * depth_mm, levels, size_m, grading=grading,
                              coarser=solved)  # fmt: skip
    assert solved is not None
    return [1e-3 * one.force_n_per_m for one in solved[1]]


def at_wall(size_m: float, radius_m: float) -> float:
    """Element size at an inclusion [m]."""
    return min(0.5 * size_m, 0.25 * radius_m)


def spent(solve: Callable[[], list[float]]) -> tuple[float, list[float]]:
    """Seconds of the processor and forces [N/mm]."""
    began = process_time()
    forces = solve()
    return process_time() - began, forces


def judge(number: int) -> Row | None:
    """Scene ``number``'s answers; None where nothing can be compared."""
    rng = np.random.default_rng(SEED)
    for _ in range(number):
        random_case(rng)
    try:
        return compared(random_case(rng), BUDGETS_PCT[number % len(BUDGETS_PCT)])
    except CannotSolve as error:
        print(f"scene {number} is refused: {error}")
        return None


def compared(case: Case, budget_pct: float) -> Row:
    """The press beside the converged answer and the settings of a hand. Raises `CannotSolve`."""
    scene, x, depth, pressures = case
    half_m = 0.5e-3 * scene.indenter.width_mm_projected
    levels = [p * PA_PER_MMHG for p in pressures]

    def by_hand(model: str, element: str | None, share: float) -> list[float]:
        solve = solve_small if model == "small" else solve_finite
        _, found = solve(scene, 1e-3 * x, 1e-3 * depth, levels, share * half_m, element)
        return [1e-3 * one.force_n_per_m for one in found]

    truth = converged(scene, x, depth, levels)

    def by_itself() -> list[float]:
        pressed = press(scene, x, depth, pressures, accuracy_pct=budget_pct)
        return [state.force_n_per_mm for state in pressed.states]

    pressed = press(scene, x, depth, pressures, accuracy_pct=budget_pct)
    forces = [state.force_n_per_mm for state in pressed.states]
    cheapest_s, picked = np.inf, None
    for model, element, share in HAND:
        try:
            with within(cheapest_s if np.isfinite(cheapest_s) else 0.0):
                took_s, found = spent(partial(by_hand, model, element, share))
        except (CannotSolve, TooLong):
            continue
        if off_pct(found, truth) <= budget_pct and took_s < cheapest_s:
            cheapest_s, picked = took_s, (model, element, share)
    in_turns = [
        (spent(by_itself)[0], spent(partial(by_hand, *picked))[0] if picked else np.nan)
        for _ in range(TURNS)
    ]
    seconds, by_hand_s = (float(one) for one in np.median(in_turns, axis=0))
    row = {
        "kind": scene.inclusion[0].kind if scene.inclusion else "nothing",
        "plane": scene.plane,
        "aside_mm": abs(x - 32.0),
        "depth_mm": depth,
        "budget_pct": budget_pct,
        "model": pressed.model,
        "true_pct": off_pct(forces, truth),
        "stated_pct": pressed.error_estimate_pct,
        "pulse_share": np.ptp(truth) / max(truth),
        "dofs": pressed.dofs,
        "seconds": seconds,
        "by_hand_s": by_hand_s,
        "by_hand": "{}, {}, {:g}".format(*picked) if picked else "none",
    }
    return {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()}


def main(count: int = 80, path: Path = TABLE) -> None:
    """Go on with the table, and print how often the statement and the budget hold."""
    fill(path, ("scene",), ANSWERS, ((n,) for n in range(count)), judge)
    every = pd.read_csv(path)
    table = every.dropna(subset=["true_pct"])
    ratio = (table.seconds / table.by_hand_s)[table.by_hand != "none"]
    honest, kept = table.true_pct <= 2 * table.stated_pct, table.true_pct <= table.budget_pct
    print(f"true error within 2 x stated: {honest.sum()} of {len(table)} scenes "
          f"({len(every) - len(table)} refused)")  # fmt: skip
    print(f"true error within the budget: {kept.sum()}")
    print(f"time over the cheapest by hand: median {ratio.median():.2f}, 95 % "
          f"{ratio.quantile(0.95):.2f}, largest {ratio.max():.2f}; within 3: "
          f"{(ratio <= 3).sum()} of {len(ratio)}")  # fmt: skip
    print(table[table.index.isin(ratio.index[ratio > 3])].to_string())


if __name__ == "__main__":
    run(main)
