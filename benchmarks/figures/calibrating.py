"""How true calibrations are, and a wrong rig before and after its own."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from calibration_picture import TRUE_KPA, TRUE_MM, wrong_and_right
from calibration_trials import TRIALS
from calibrations import Row, keep_rows, measure
from emulated_rig import DELAY_MS, GAIN, STIFFNESS_N_MM, TILT_MM

REPEATS = 500
LABELS = {"wrong rig": "wrong", "calibrated": "calibrated", "rig without fault": "faultless"}


def calibration() -> dict[str, Any]:
    """Errors of each calibration in its unit, and how often its intervals hold the truth."""
    rows = [measure(trial, REPEATS) for trial in TRIALS]
    keep_rows(rows)
    return summary(rows)


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
