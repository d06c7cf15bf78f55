"""Figures of the finite elements: the paper's statements, fleets, fast model, lone vessels."""

import tempfile
import time
from pathlib import Path
from typing import Any

import fast_model as fast
import fleet as many
import numpy as np
import pandas as pd

import palpate
from probe.studies.paper import paper as redo
from sim_backend.models.surrogate import surrogate

HELD_OUT = 60
SCANS, CHECKED = 200, 20
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


def fast_model() -> dict[str, Any]:
    """Training, speed and held-out errors of TIHA's table."""
    scene = palpate.load_scene("TIHA")
    longer = scene.indenter.length_mm + float(np.random.default_rng().uniform(0, 1e-3))
    fresh = scene.indenter.model_copy(update={"length_mm": longer})  # never in the cache
    rng = np.random.default_rng(20)
    spent_s = time.process_time()
    model = surrogate(scene.model_copy(update={"indenter": fresh}), 2.5)
    trained_s = time.process_time() - spent_s
    per_second, median_s, p99_s = fast.speed(model, rng)
    off = fast.errors_pct(model, rng, HELD_OUT)
    return {
        "trained_s": trained_s, "states_per_s": per_second, "one_ms": 1e3 * median_s,
        "one_p99_ms": 1e3 * p99_s, "held_out": HELD_OUT,
        "force_pct": float(off[:, 0].max()), "pulse_pct": float(off[:, 1].max()),
    }  # fmt: skip


def fleet() -> dict[str, Any]:
    """Random scans by the quick model; some rows solved again by the full one."""
    scene = palpate.load_scene("TIHA")
    some = many.drawn(scene, SCANS)
    with tempfile.TemporaryDirectory() as name:
        began_s = time.perf_counter()
        table, _ = many.run(scene, some, 2, Path(name) / "fleet.parquet")
        wall_s = time.perf_counter() - began_s
    solved = table[table["reason"] == ""]
    off = many.checked(scene, some, table, CHECKED)
    seconds = many.timed(scene, some[: 1 + many.TIMED_SCANS])
    off.round(4).to_csv(many.PICTURES / "fleet.csv", index=False)
    many.draw(off, seconds).savefig(many.PICTURES / "fleet.png", dpi=150, facecolor="white")
    stated = 100 * solved["force_error_n"] / solved["force_n"]
    peak = solved.groupby("point")["pulse_n"].transform("max")
    stated_pulse = 100 * solved["pulse_error_n"] / peak
    return {
        "scans": SCANS, "wall_s": wall_s, "unsolved": len(table) - len(solved),
        "scan_s": float(np.mean(seconds)), "checked": CHECKED,
        **{
            f"{name}_{key}": value
            for name in ("force", "pulse")
            for key, value in {
                "within": int((off[f"{name}_off_mn"] <= off[f"{name}_stated_mn"]).sum()),
                "share": float((off[f"{name}_off_mn"] / off[f"{name}_stated_mn"]).max()),
            }.items()
        },
        "stated_pct": float(stated.median()), "stated_max_pct": float(stated.max()),
        "stated_pulse_pct": float(stated_pulse.median()),
        "stated_pulse_max_pct": float(stated_pulse.max()),
    }  # fmt: skip
