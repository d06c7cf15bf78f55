"""Figures of the finite elements: the paper's statements, lone vessels."""

import tempfile
import time
from pathlib import Path
from typing import Any

import pandas as pd

import palpate
from probe.studies.paper import paper as redo

OFF_MIDDLE_MM = (0.0, 0.02, 0.4)


def paper() -> dict[str, Any]:
    """Each statement of the paper beside our number; TISA's pulse by reading."""
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        began_s = time.perf_counter()
        found = redo(out, lambda _: None, workers=1)
        took_s = time.perf_counter() - began_s
        table = pd.read_csv(out / "paper.csv", keep_default_na=False)
        readings = pd.read_csv(out / "sensitivity.csv", keep_default_na=False)
    readings["pulse"] = pd.to_numeric(readings["von_mises_pulse_pa"], errors="coerce")
    wide = readings.pivot(index="reading", columns="model", values="pulse")
    wide = wide.loc[list(dict.fromkeys(readings["reading"]))]
    return {
        "presses": len(table),
        "seconds": took_s,
        "by_reading_pa": {reading: row.to_dict() for reading, row in wide.iterrows()},
        "head": ["the paper", "here", ""],
        "table": [[one.text, one.ours, one.verdict] for one in found],
        "readings_head": ["left open", *(f"{model} strain [Pa]" for model in wide)],
        "readings_table": [
            [reading, *(f"{value:.1f}" for value in row)] for reading, row in wide.iterrows()
        ],
    }


def lone_vessel() -> dict[str, Any]:
    """HAOT pressed 2.5 mm at 80 mmHg over its middle and beside it [N/m]."""
    scene = palpate.load_scene("HAOT")
    middle_mm = scene.inclusion[0].x_mm
    force = [
        1e3 * palpate.press(scene, middle_mm + off, 2.5, (80.0,)).states[0].force_n_per_mm
        for off in OFF_MIDDLE_MM
    ]
    return {"off_mm": list(OFF_MIDDLE_MM), "force_n_per_m": force}
