"""How true calibrations are, and a wrong rig before and after its own.

Each repeat draws a device, its readings with the noise of a real sensor, and fits them by the
functions behind `palpate calibrate`. The modulus' inversion solves the finite elements once (a
homogeneous block's force is proportional to its modulus) and the data come from another mesh, for
finite strain from the phantom's response; each repeat has its own modulus, contact and noise.
Then a rig that is wrong in four ways scans a lump before and after its own calibration.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from drivers.core.arrays import Array
from figures.calibration_picture import TRUE_KPA, TRUE_MM, draw, wrong_and_right
from figures.calibration_trials import TRIALS, Trial
from figures.emulated_rig import DELAY_MS, GAIN, STIFFNESS_N_MM, TILT_MM

OUT = Path(__file__).parents[2] / "docs" / "pictures" / "calibration.png"

REPEATS = 500
LABELS = {"wrong rig": "wrong", "calibrated": "calibrated", "rig without fault": "faultless"}


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


def calibration() -> dict[str, Any]:
    """Errors of each calibration in its unit, and how often its intervals hold the truth; drawn."""
    rows = [measure(trial, REPEATS) for trial in TRIALS]
    keep_rows(rows)
    with tempfile.TemporaryDirectory() as folder:
        draw(rows, [t.limit for t in TRIALS], wrong_and_right(Path(folder)), OUT)
    return summary(rows)


def keep_rows(rows: list[Row]) -> None:
    """All but the single errors, beside the picture."""
    frame = pd.DataFrame([{k: v for k, v in vars(r).items() if k != "errors"} for r in rows])
    frame.to_csv(OUT.with_suffix(".csv"), index=False)


def summary(rows: list[Row]) -> dict[str, Any]:
    """The rows as numbers and as a table of text."""
    return {
        "repeats": REPEATS,
        "rows": {row.name.replace(".", ","): _numbers(row) for row in rows},
        "head": ["calibration", "target", "rms", f"worst of {REPEATS}", "intervals that hold"],
        "table": [_words(row) for row in rows],
    }


def wrong_rig() -> dict[str, Any]:
    """What a rig that is wrong in four ways finds before and after its own calibration."""
    with tempfile.TemporaryDirectory() as folder:
        rigs = wrong_and_right(Path(folder))
    return {
        "gain": GAIN, "delay_ms": DELAY_MS, "stiffness_n_mm": STIFFNESS_N_MM,
        "tilt_mm": 2 * TILT_MM, "truth_mm": TRUE_MM, "truth_kpa": TRUE_KPA,
        **{
            LABELS[rig.label]: {
                "finding": rig.finding,
                "modulus_kpa": rig.modulus_kpa[0],
                "depth_off_mm": float(np.abs(rig.stated_mm - rig.true_mm).max()),
            }
            for rig in rigs
        },
    }  # fmt: skip


def _numbers(row: Row) -> dict[str, Any]:
    found = {"rms": row.rms, "worst": row.worst, "met": row.met}
    return found if np.isnan(row.coverage) else found | {"coverage_pct": 100 * row.coverage}


def _words(row: Row) -> list[str]:
    cover = "–"
    if not np.isnan(row.coverage):
        cover = f"{100 * row.coverage:.1f} % ({100 * row.low:.1f} to {100 * row.high:.1f})"
    unit = "" if row.target == "–" else " " + row.target.split(" ", 1)[1].split(" ")[0]
    return [row.name, row.target, f"{row.rms:.2g}{unit}", f"{row.worst:.2g}{unit}", cover]
