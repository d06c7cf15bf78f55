"""How often a pulse of a given size is found on real tissue, and how often one that is not there.

    python benchmarks/power.py HOLDS.csv PULSES.csv.gz [CASES]

HOLDS: indent-and-hold recordings of tissue without a pulse (columns curve, t_s, force_n); PULSES:
arterial pressure (record, t_s, pressure_mbar). A stretch of a pulse, its slow wander removed, is
scaled to a share of the hold's force, trough to crest, and added at random phase. Found: a pulse
at a chance of 1 %. Prints the table, draws docs/pictures/power.png.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table
from scipy.ndimage import uniform_filter1d
from scipy.signal import periodogram

from drivers.core.arrays import Array
from probe.core.recording import Station
from probe.detection.pulse.estimate import find_pulse
from probe.detection.pulse.hold_samples import hold_of
from probe.detection.pulse.search import FASTEST_HZ, SLOWEST_HZ
from probe.report.look import BLUE, GREEN, ORANGE

FALSE_ALARM = 0.01
HOLDS_S = (0.825, 2.5, 5.0, 10.0)
SHARES = (0.0025, 0.005, 0.01, 0.02, 0.03, 0.05)
OUT = Path(__file__).parents[1] / "docs" / "pictures" / "power.png"


def holds(path: Path) -> list[tuple[Array, Array]]:
    """Time from the highest force on [s], negative on the ramp, and force [N], of each curve."""
    curves = pd.read_csv(path).groupby("curve", sort=False)
    return [
        (curve.t_s.to_numpy() - curve.t_s.iloc[int(curve.force_n.argmax())],
         curve.force_n.to_numpy())
        for _, curve in curves
    ]  # fmt: skip


def pulses(path: Path) -> list[tuple[Array, Array]]:
    """Time [s] and pulse of each record, 1 from trough to crest in the median beat.

    The wander is the mean over two beats around each sample.
    """
    found = []
    for _, record in pd.read_csv(path).groupby("record", sort=False):
        time_s, mbar = record.t_s.to_numpy(), record.pressure_mbar.to_numpy()
        rate = 1 / float(np.median(np.diff(time_s)))
        hz, power = periodogram(mbar - uniform_filter1d(mbar, int(2 * rate)), rate, "hann")
        hearts = (hz >= SLOWEST_HZ) & (hz <= FASTEST_HZ)
        beat = int(rate / hz[hearts][np.argmax(power[hearts])])
        steady = mbar - uniform_filter1d(mbar, 2 * beat, mode="nearest")
        swing = [np.ptp(steady[i : i + beat]) for i in range(beat, len(steady) - 2 * beat, beat)]
        found.append((time_s - time_s[0], steady / float(np.median(swing))))
    return found


def chance(case: tuple[int, float, float], tissue: list[tuple[Array, Array]],
           hearts: list[tuple[Array, Array]]) -> float:  # fmt: skip
    """The p-value of one hold with one pulse: (seed, hold time, share)."""
    seed, hold_s, share = case
    rng = np.random.default_rng(seed)
    time_s, force = tissue[seed % len(tissue)]
    beat_s, wave = hearts[rng.integers(len(hearts))]
    kept = time_s <= hold_s
    start_s = rng.uniform(0.0, max(beat_s[-1] - time_s[kept][-1], 0.0))
    carried = np.where(time_s < 0, force, force.max())
    signal = (force + share * carried * np.interp(time_s + start_s, beat_s, wave))[kept]
    n = int(kept.sum())
    station = Station(
        0, 0.0, 0.0, time_s[kept], signal[:, None], np.zeros((n, 1), dtype=bool),
        np.nan, np.nan, np.nan, np.full(n, np.nan),
    )  # fmt: skip
    try:
        return find_pulse(hold_of(station)).p_value
    except ValueError:  # too few samples in so short a hold at 10 Hz
        return 1.0


def main(tissue_file: Path, hearts_file: Path, cases: int) -> None:
    """Judge, tell, draw."""
    tissue, hearts = holds(tissue_file), pulses(hearts_file)
    jobs = [(seed, hold_s, share) for hold_s in HOLDS_S for share in (0.0, *SHARES)
            for seed in range(len(tissue) if share == 0 else cases)]  # fmt: skip
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        p_values = list(pool.map(partial(chance, tissue=tissue, hearts=hearts), jobs, chunksize=16))
    rows = pd.DataFrame(jobs, columns=["seed", "hold_s", "share"])
    rows["found"] = np.array(p_values) <= FALSE_ALARM
    table = Table(title=f"Found at {100 * FALSE_ALARM:g} %, of {cases} (false: of {len(tissue)})")
    for name in ("hold s", "false", *(f"{100 * s:g} %" for s in SHARES)):
        table.add_column(name, justify="right")
    for hold_s, some in rows.groupby("hold_s"):
        false = int(some.found[some.share == 0].sum())
        power = [100 * some.found[some.share == s].mean() for s in SHARES]
        table.add_row(f"{hold_s:g}", str(false), *(f"{p:.1f}" for p in power))
    Console().print(table)
    draw(rows).savefig(OUT, dpi=150, facecolor="white")


def draw(rows: pd.DataFrame) -> Figure:
    """Power against the pulse's size, a line for each hold."""
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    for hold_s, colour, mark in zip(HOLDS_S, ("0.5", ORANGE, BLUE, GREEN), "s^od", strict=True):
        some = rows[(rows.hold_s == hold_s) & (rows.share > 0)]
        power = some.groupby("share").found.mean()
        axes.plot(100 * power.index, 100 * power, f"{mark}-", ms=5, color=colour,
                  label=f"{hold_s:g} s")  # fmt: skip
    axes.set(xscale="log", xlabel="pulse, trough to crest, over the force [%]", ylim=(0, 103),
             ylabel="found at 1 % false alarms [%]")  # fmt: skip
    axes.set_xticks([100 * s for s in SHARES], [f"{100 * s:g}" for s in SHARES])
    axes.minorticks_off()
    axes.legend(title="hold", frameon=False)
    return figure


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 300)
