"""How often the 95 % interval of a pulse's size holds it, and how much it jumps along a scan.

    python benchmarks/pulse_intervals.py [CASES]

Single holds at 500 Hz of 0.9 % of the force, 50 to 100 beats a minute (one beat: 73), in tissue
that does not relax, relaxes a tenth as much as real tissue, or as much, each beginning anywhere in
the beat. And scans of the paper's healthy artery (TIHA) by the simulated sensor: holds of one beat,
whose noise is drawn by seed. Goes on where docs/results/pulse-intervals.csv ends. Draws
docs/pictures/pulse-intervals.png.
"""

from functools import lru_cache

import numpy as np
import pandas as pd
from artefacts import RELAXATION
from kept import ROOT, Row, exact, fill, interval, run
from matplotlib.figure import Figure
from pulses import press
from six_scenes import noisy, silent

from drivers.core.arrays import Array
from probe.core.recording import Recording
from probe.detection.pulse.presses import Press, presses_of
from probe.report.look import BLUE, GREEN, VERMILLION
from sim_backend.scene.waves import BRACHIAL_AMPLITUDES, BRACHIAL_PHASES

RATE_HZ, LEVEL_PA, PULSE_PA, NOISE_PA = 500.0, 9000.0, 80.0, 5.0
BEAT_S = 0.825
HOLDS_S = (BEAT_S, 1.65, 2.5, 5.0)
RELAXING = (0.0, 0.1, 1.0)
SCAN = "TIHA"
ORDER = np.arange(1, len(BRACHIAL_AMPLITUDES) + 1)
OUT = ROOT / "docs" / "results" / "pulse-intervals.csv"
PICTURE = ROOT / "docs" / "pictures" / "pulse-intervals.png"


def wave(phase: Array) -> Array:
    """The brachial wave at phases (n,) in beats, 1 from trough to crest."""

    def raw(at: Array) -> Array:
        turns = 2 * np.pi * at[:, None] * ORDER
        return np.asarray(np.cos(turns + BRACHIAL_PHASES) @ np.array(BRACHIAL_AMPLITUDES))

    return raw(phase) / np.ptp(raw(np.linspace(0, 1, 2001)))


def of_hold(hold_s: float, relaxing: float, seed: int) -> tuple[Press, float]:
    """A press with a pulse, and its size."""
    rng = np.random.default_rng([seed, round(1e3 * hold_s), round(10 * relaxing)])
    t = np.arange(int(hold_s * RATE_HZ)) / RATE_HZ
    rate_hz = 1 / BEAT_S if hold_s == BEAT_S else rng.uniform(50, 100) / 60
    level = 1 - relaxing * sum(g * (1 - np.exp(-t / tau)) for g, tau in RELAXATION)
    signal = LEVEL_PA * level + PULSE_PA * wave(rate_hz * t + rng.uniform())
    signal = signal + NOISE_PA * rng.standard_normal(len(t))
    (one,) = presses_of(Recording((press(t, signal),), ("force",), (), 1e-4), 0.01)
    return one, PULSE_PA


@lru_cache(maxsize=1)
def of_scan(seed: int) -> tuple[tuple[Press, ...], Array]:
    """The presses of a scan, and the sizes (n,) of their pulses without noise."""
    truth = [np.ptp(one.signal_pa[(one.time_s >= one.hold_s) & (one.time_s <= one.retract_s)])
             for one in silent(SCAN).stations]  # fmt: skip
    return presses_of(noisy(SCAN, "0.5 mN 500 Hz", seed), 0.005), np.array(truth)


def judge(hold_s: float, relaxing: float, station: int, seed: int) -> Row:
    """What is said of a size, and the size."""
    if station:
        presses, truth = of_scan(seed)
        one, size_pa = presses[station - 1], float(truth[station - 1])
    else:
        one, size_pa = of_hold(hold_s, relaxing, seed)
    assert one.pulse is not None
    return {"true_pa": f"{size_pa:.2f}", "size_pa": f"{one.size_pa:.2f}",
            "sd_pa": f"{one.pulse.size_sd_pa:.3f}"}  # fmt: skip


def main(cases: int = 200) -> None:
    """Judge, tell, draw."""
    jobs = [(hold_s, relaxing, 0, seed) for seed in range(cases) for hold_s in HOLDS_S
            for relaxing in RELAXING]  # fmt: skip
    jobs += [(BEAT_S, 0.0, k, seed) for seed in range(cases // 4) for k in range(1, 16)]
    keys, answers = ("hold_s", "relaxing", "station", "seed"), ("true_pa", "size_pa", "sd_pa")
    fill(OUT, keys, answers, jobs, judge)
    table = pd.read_csv(OUT)
    table["holds"] = (table.size_pa - table.true_pa).abs() <= 1.96 * table.sd_pa
    for (hold_s, relaxing), cell in table[table.station == 0].groupby(["hold_s", "relaxing"]):
        half = 1.96 * cell.sd_pa
        print(f"{hold_s} s, relaxing {relaxing}: {exact(int(cell.holds.sum()), len(cell))} % of "
              f"{len(cell)}, half {half.median():.1f} Pa, rms error "
              f"{((cell.size_pa - cell.true_pa) ** 2).mean() ** 0.5:.1f} Pa")  # fmt: skip
    scans = table[table.station > 0]
    print(
        f"{SCAN}: {exact(int(scans.holds.sum()), len(scans))} % of {len(scans)}; half an "
        f"interval over the median of its station: at most "
        f"{(scans.sd_pa / scans.groupby('station').sd_pa.transform('median')).max():.1f} times"
    )
    draw(table).savefig(PICTURE, dpi=150, facecolor="white")


def draw(table: pd.DataFrame) -> Figure:
    """Intervals that hold, against the hold; intervals along scans."""
    figure = Figure(figsize=(8, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    singles = table[table.station == 0]
    looks = zip(
        RELAXING, (BLUE, GREEN, VERMILLION), ("none", "a tenth", "as real tissue"), strict=True
    )
    for shift, (relaxing, colour, name) in enumerate(looks):
        for hold_s, cell in singles[singles.relaxing == relaxing].groupby("hold_s"):
            count, of = int(cell.holds.sum()), len(cell)
            low, high = interval(count, of)
            at = float(hold_s) * 1.04 ** (shift - 1)
            left.plot([at, at], [100 * low, 100 * high], color=colour)
            left.plot(at, 100 * count / of, "o", color=colour, ms=4,
                      label=name if hold_s == BEAT_S else None)  # fmt: skip
    left.axhline(95, color="0.6", lw=1, ls="--")
    left.set(xscale="log", xlabel="hold [s]", ylabel="intervals that hold [%]", ylim=(40, 101))
    left.set_xticks(HOLDS_S, [f"{h:g}" for h in HOLDS_S])
    left.minorticks_off()
    left.legend(title="relaxation", frameon=False, loc="lower right")
    scans = table[table.station > 0]
    for _, scan in scans.groupby("seed"):
        right.plot(4 * scan.station, 1.96 * scan.sd_pa, color=BLUE, lw=0.8, alpha=0.5)
    right.set(xlabel=f"x [mm], {scans.seed.nunique()} scans of {SCAN}",
              ylabel="half an interval of the pulse [Pa]", ylim=(0, None))  # fmt: skip
    return figure


if __name__ == "__main__":
    run(main)
