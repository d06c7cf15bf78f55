"""Every calibration against known truths: how far off, and how often its 95 % intervals hold them.

    python benchmarks/calibrations.py [REPEATS]

Each repeat draws a device, its readings with the noise of a real sensor, and fits them by the
functions behind `palpate calibrate`. The modulus' inversion solves the finite elements once (a
homogeneous block's force is proportional to its modulus) and the data come from another mesh, for
finite strain from the phantom's response; each repeat has its own modulus, contact and noise.
Then a rig that is wrong in four ways scans a lump before and after its own calibration. Prints the
table, draws docs/pictures/calibration.png. About six minutes for 500 repeats on one core.
"""

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from calibration_picture import draw, wrong_and_right
from calibration_trials import TRIALS, Trial
from rich.console import Console
from rich.table import Table

from drivers.core.arrays import Array

OUT = Path(__file__).parents[1] / "docs" / "pictures" / "calibration.png"


@dataclass(frozen=True)
class Row:
    """Errors in the target's unit; ``coverage`` of all parameters' intervals with its own 95 %
    bounds, by the scatter between repeats."""

    name: str
    target: str
    rms: float
    worst: float
    coverage: float
    low: float
    high: float
    met: bool
    errors: Array


def measure(trial: Trial, repeats: int) -> Row:
    """``repeats`` draws of one calibration."""
    errors, held = [], []
    for seed in range(repeats):
        error, inside = trial.draw(np.random.default_rng([seed, 8]))
        errors.append(error)
        held.append(np.mean(inside) if len(inside) else np.nan)
    size, share = np.abs(np.array(errors)), np.array(held)
    half = 1.96 * float(share.std(ddof=1)) / np.sqrt(repeats)
    rms = float(np.sqrt(np.mean(size**2)))
    met = trial.limit is None or float(np.quantile(size, 0.95)) <= trial.limit
    return Row(trial.name, trial.target, rms, float(size.max()), float(share.mean()),
               float(share.mean()) - half, float(share.mean()) + half, met, size)  # fmt: skip


def main(repeats: int) -> None:
    """Measure, print, draw."""
    rows = []
    for trial in TRIALS:
        began = time.process_time()
        rows.append(measure(trial, repeats))
        took = time.process_time() - began
        print(f"{trial.name}: {took:.0f} s", file=sys.stderr, flush=True)
    show(rows, repeats)
    keep_rows(rows)
    with tempfile.TemporaryDirectory() as folder:
        draw(rows, [t.limit for t in TRIALS], wrong_and_right(Path(folder)), OUT)


def keep_rows(rows: list[Row]) -> None:
    """All but the single errors, beside the picture."""
    frame = pd.DataFrame([{k: v for k, v in vars(r).items() if k != "errors"} for r in rows])
    frame.to_csv(OUT.with_suffix(".csv"), index=False)


def show(rows: list[Row], repeats: int) -> None:
    """The table."""
    table = Table(title=f"Calibrations against known truths, {repeats} repeats each")
    for head in ("calibration", "target", "rms", "worst", "95 % intervals hold", "target met"):
        table.add_column(head)
    for r in rows:
        cover = (
            "–"
            if np.isnan(r.coverage)
            else f"{100 * r.coverage:.1f} % ({100 * r.low:.1f} to {100 * r.high:.1f})"
        )
        met = "–" if r.target == "–" else "in 95 % or more" if r.met else "NO"
        table.add_row(r.name, r.target, f"{r.rms:.3g}", f"{r.worst:.3g}", cover, met)
    Console(width=150).print(table)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500)
