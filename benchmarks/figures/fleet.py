"""Random scans by stations, and some of their rows by the full one.

Scans like the paper's TIHA, 15 stations each, with the artery's depth, place, diameter, wall and
modulus, the tissue's modulus and both pressures drawn by Latin hypercube, go through the sweep
by stations on two workers. Random rows are solved again by the full model (finite strain,
elements of half the usual size); the difference stands beside the error that the row states.
Writes docs/pictures/fleet.csv and draws docs/pictures/fleet.png.
"""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from probe.report.look import BLUE, VERMILLION
from probe.studies.sweep import solve_points
from probe.studies.vary import Point, applied, parse, places, points
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.models.bodies import element_size_m
from sim_backend.models.station_response import respond
from sim_backend.scene.scene_file import Scene, load_scene
from sim_backend.scene.waves import PA_PER_MMHG

VARIED = (
    "inclusion.0.depth_mm=6..13", "inclusion.0.x_mm=20..44", "inner_diameter_mm=2.5..5",
    "wall_mm=0.3..0.9", "inclusion.0.modulus_kpa=200..1000:log", "tissue.modulus_kpa=20..100:log",
    "diastolic_mmhg=60..95", "systolic_mmhg=110..160",
)  # fmt: skip
STATIONS_MM = places("4..60:15")
INDENTATION_MM = 2.5
SEED = 9
SCANS, CHECKED, TIMED_SCANS = 200, 20, 30
PICTURES = Path(__file__).parents[2] / "docs" / "pictures"


def drawn(scene: Scene, count: int) -> list[Point]:
    """The random scans."""
    return points([parse(text, scene) for text in VARIED], "lhs", count, SEED)


def swept(scene: Scene, some: list[Point], out: Path) -> pd.DataFrame:
    """The sweep's table."""
    return solve_points(scene, some, out, x_mm=STATIONS_MM, indentation_mm=INDENTATION_MM,
                        model="quick", seed=SEED, workers=2, progress=lambda *_: None)  # fmt: skip


def checked(scene: Scene, some: list[Point], table: pd.DataFrame, count: int) -> pd.DataFrame:
    """Random rows beside the full model [mN]."""
    solved = table[table["reason"] == ""]
    rows = []
    for index in np.random.default_rng(SEED).choice(solved.index, count, replace=False):
        row = solved.loc[index]
        one = applied(scene, some[int(row["point"])])
        beat = [p * PA_PER_MMHG for p in (one.pulse.diastolic_mmhg, one.pulse.systolic_mmhg)]
        began_s = time.process_time()
        _, full = solve_finite(one, 1e-3 * row["x_mm"], 1e-3 * INDENTATION_MM, beat,
                               element_size_m(one) / 2)  # fmt: skip
        low, high = (one.indenter.length_mm * s.force_n_per_m for s in full)
        rows.append({
            "point": int(row["point"]), "x_mm": row["x_mm"],
            "force_mn": low, "force_off_mn": abs(1e3 * row["force_n"] - low),
            "force_stated_mn": 1e3 * row["force_error_n"],
            "pulse_mn": high - low, "pulse_off_mn": abs(1e3 * row["pulse_n"] - (high - low)),
            "pulse_stated_mn": 1e3 * row["pulse_error_n"], "full_s": time.process_time() - began_s,
        })  # fmt: skip
    return pd.DataFrame(rows)


def timed(scene: Scene, some: list[Point]) -> list[float]:
    """Seconds of a processor that each scan takes, after a first one."""
    seconds = []
    for point in some:
        one = applied(scene, point)
        began_s = time.process_time()
        for x_mm in STATIONS_MM:
            respond(one, 1e-3 * x_mm, 1e-3 * INDENTATION_MM)
        seconds.append(time.process_time() - began_s)
    return seconds[1:]


def draw(off: pd.DataFrame, seconds: list[float]) -> Figure:
    """True error against the stated one, and the time of a scan."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    errors, times = figure.subplots(1, 2)
    for name, colour in (("force", BLUE), ("pulse", VERMILLION)):
        errors.loglog(off[f"{name}_stated_mn"], off[f"{name}_off_mn"], "o", ms=4, color=colour,
                      label=name)  # fmt: skip
    ends = np.array([off.filter(like="stated").min().min(), off.filter(like="stated").max().max()])
    errors.loglog(ends, ends, "-", lw=1, color="0.5")
    errors.annotate("as large as stated", ends[[1, 1]], (-6, 0), textcoords="offset points",
                    ha="right", va="top", color="0.4", fontsize=8)  # fmt: skip
    errors.set(xlabel="stated error [mN]", ylabel="difference from the full model [mN]")
    errors.set_title(f"{len(off)} random rows", loc="left")
    errors.legend(frameon=False)
    times.hist(seconds, bins=np.arange(0, max(seconds) + 0.1, 0.1).tolist(), color=BLUE)
    times.set(xlabel="time of a processor per scan [s]", ylabel="scans")
    times.set_title(f"{len(seconds)} scans", loc="left")
    return figure


def fleet() -> dict[str, Any]:
    """Random scans by stations; some rows solved again by the full one."""
    scene = load_scene("TIHA")
    some = drawn(scene, SCANS)
    with tempfile.TemporaryDirectory() as name:
        began_s = time.perf_counter()
        table = swept(scene, some, Path(name) / "fleet.parquet")
        wall_s = time.perf_counter() - began_s
    solved = table[table["reason"] == ""]
    off = checked(scene, some, table, CHECKED)
    seconds = timed(scene, some[: 1 + TIMED_SCANS])
    off.round(4).to_csv(PICTURES / "fleet.csv", index=False)
    draw(off, seconds).savefig(PICTURES / "fleet.png", dpi=150, facecolor="white")
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
