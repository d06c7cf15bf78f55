"""A fleet of random scans: how fast, how far off, and whether a second worker helps.

    python benchmarks/fleet.py [SCANS] [CHECKED]

Scans like the paper's TIHA, 15 stations each, with the artery's depth, place, diameter, wall and
modulus, the tissue's modulus and both pressures drawn by Latin hypercube, go through the sweep
with the quick model on two workers. Random rows are solved again by the full model (finite strain,
elements of half the usual size); the difference stands beside the error that the row states.
Throughput is counted from the first finished scan to the last, so that starting Python is left
out. The load of the machine by others is printed, since it stretches every time.

Prints the tables, writes docs/pictures/fleet.csv and draws docs/pictures/fleet.png.
"""

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from probe.report.look import BLUE, VERMILLION
from probe.studies.sweep import solve_points
from probe.studies.vary import Point, applied, parse, places, points
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.models.plane_response import element_size_m
from sim_backend.models.scan_estimate import estimate_scan
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
THROUGHPUT_SCANS, TIMED_SCANS = 24, 30
PICTURES = Path(__file__).parents[1] / "docs" / "pictures"


def drawn(scene: Scene, count: int) -> list[Point]:
    """The random scans."""
    return points([parse(text, scene) for text in VARIED], "lhs", count, SEED)


def run(scene: Scene, some: list[Point], workers: int, out: Path) -> tuple[pd.DataFrame, float]:
    """The sweep's table, and scans per second from the first that was finished to the last."""
    at: list[tuple[float, int]] = []

    def progress(done: int, every: int) -> None:
        at.append((time.perf_counter(), done))
        if done and done % 50 == 0:
            print(f"  {done} of {every} after {at[-1][0] - at[0][0]:.0f} s", flush=True)

    table = solve_points(scene, some, out, x_mm=STATIONS_MM, indentation_mm=INDENTATION_MM,
                         model="quick", seed=SEED, workers=workers, progress=progress)  # fmt: skip
    (first_s, first), (last_s, last) = at[1], at[-1]
    return table, (last - first) / (last_s - first_s)


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
    """Seconds of a processor that each scan takes, after the block that all share is known."""
    seconds = []
    for point in some:
        one = applied(scene, point)
        began_s = time.process_time()
        estimate_scan(one, [1e-3 * x for x in STATIONS_MM], 1e-3 * INDENTATION_MM)
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


def main() -> None:
    """Sweep, check, compare workers, print, draw."""
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    checks = int(sys.argv[2]) if len(sys.argv) > 2 else 20
    scene = load_scene("TIHA")
    some = drawn(scene, count)
    with tempfile.TemporaryDirectory() as folder:
        print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors")
        began_s = time.perf_counter()
        table, _ = run(scene, some, 2, Path(folder) / "fleet.parquet")
        wall_s = time.perf_counter() - began_s
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = used.ru_utime + used.ru_stime
        failed = table[table["reason"] != ""]
        print(f"{count} scans, {len(table)} rows, {len(failed)} without an answer: {wall_s:.0f} s "
              f"on 2 workers, {cpu_s / count:.2f} s of a processor per scan; load "
              f"{os.getloadavg()[0]:.1f} (2 of it ours)")  # fmt: skip
        for reason, number in failed["reason"].str[:90].value_counts().head(5).items():
            print(f"  {number} x {reason}")
        rates: dict[int, list[float]] = {1: [], 2: []}
        few = some[:THROUGHPUT_SCANS]
        for turn, workers in enumerate((1, 2, 2, 1)):
            _, rate = run(scene, few, workers, Path(folder) / f"{turn}.parquet")
            rates[workers].append(rate)
    one, two = (float(np.mean(rates[w])) for w in (1, 2))
    print(f"throughput each turn: {rates}")
    print(f"throughput: {one:.2f} scans/s with one worker, {two:.2f} with two: {two / one:.2f} "
          f"times; load {os.getloadavg()[0]:.1f}")  # fmt: skip
    off = checked(scene, some, table, checks)
    print(off.round(2).to_string(index=False))
    for name in ("force", "pulse"):
        within = int((off[f"{name}_off_mn"] <= off[f"{name}_stated_mn"]).sum())
        share = (off[f"{name}_off_mn"] / off[f"{name}_stated_mn"]).max()
        print(f"{name}: {within} of {len(off)} rows within the stated error; largest is "
              f"{share:.2f} of it")  # fmt: skip
    solved = table[table["reason"] == ""]
    stated = 100 * solved["force_error_n"] / solved["force_n"]
    peak = solved.groupby("point")["pulse_n"].transform("max")
    stated_pulse = 100 * solved["pulse_error_n"] / peak
    print(
        f"stated: force {stated.median():.2f} % (largest {stated.max():.2f}), pulse "
        f"{stated_pulse.median():.1f} % of the scan's largest (at most {stated_pulse.max():.1f})"
    )
    off.round(4).to_csv(PICTURES / "fleet.csv", index=False)
    seconds = timed(scene, some[: 1 + TIMED_SCANS])
    print(
        f"{len(seconds)} scans one by one: {np.mean(seconds):.2f} s of a processor each (median "
        f"{np.median(seconds):.2f}, longest {max(seconds):.2f}); load {os.getloadavg()[0]:.1f}"
    )
    draw(off, seconds).savefig(PICTURES / "fleet.png", dpi=150, facecolor="white")


if __name__ == "__main__":
    main()
