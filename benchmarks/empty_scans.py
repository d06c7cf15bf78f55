"""Scans of real tissue in which nothing lies: what is found in them all the same.

    python benchmarks/empty_scans.py HOLDS.csv [SCANS]

HOLDS as for `benchmarks/real_data.py`. A scan is 7 or 15 presses 4 mm apart, each the hold of
another curve drawn at random, brought to one level as in even tissue (they differ by 1 %); recorded
at 10 Hz, or taken as 500 Hz with the noise of a sensor of 0.02 % of the level. Goes on where
docs/results/empty-scans.csv ends.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
from kept import ROOT, Row, exact, fill, read, run
from real_data import holds
from scipy.interpolate import PchipInterpolator

from drivers.core.arrays import Array
from probe.core.recording import Recording, Station
from probe.detection import detect

HOLD_S = 5.0
SCATTER, NOISE = 0.01, 2e-4
LEVEL_PA = 9000.0
OUT = ROOT / "docs" / "results" / "empty-scans.csv"


@lru_cache(maxsize=1)
def curves(file: Path) -> list[tuple[Array, Array]]:
    return holds(file)


def station(index: int, curve: tuple[Array, Array], rate_hz: float,
            rng: np.random.Generator) -> Station:  # fmt: skip
    """One press of a scan."""
    time_s, force = curve
    held = (time_s >= 0) & (time_s <= HOLD_S)
    t, signal = time_s[held], force[held]
    if rate_hz > 100:
        fine = np.arange(t[0], t[-1], 1 / rate_hz)
        t, signal = fine, PchipInterpolator(t, signal)(fine)
        signal = signal + NOISE * signal.mean() * rng.standard_normal(len(signal))
    signal = LEVEL_PA * signal / signal.mean() * (1 + SCATTER * rng.standard_normal())
    return Station(index, 4e-3 * (index + 1), 0.0, t + 10, signal[:, None],
                   np.zeros((len(t), 1), dtype=bool), 9.0, 10.0, 10 + t[-1],
                   np.full(len(t), 2.5e-3))  # fmt: skip


def main(file: Path, scans: int = 100) -> None:
    """Judge, and tell what is kept."""

    def judge(rate_hz: float, stations: int, seed: int) -> Row:
        rng = np.random.default_rng([seed, stations, int(rate_hz)])
        chosen = rng.choice(len(curves(file)), stations, replace=False)
        row = tuple(station(i, curves(file)[c], rate_hz, rng) for i, c in enumerate(chosen))
        found = detect(Recording(row, ("force",), (), 1e-4))
        sure = max((one.confidence for one in found.objects), default=float("nan"))
        return {"found": found.finding, "confidence": f"{sure:.4f}"}

    jobs = [(rate, n, seed) for seed in range(scans) for rate in (10.0, 500.0) for n in (7, 15)]
    fill(OUT, ("rate_hz", "stations", "seed"), ("found", "confidence"), jobs, judge)
    for (rate, n), some in pd.DataFrame(read(OUT)).groupby(["rate_hz", "stations"]):
        vessels = int(some.found.isin(["artery", "stenotic artery"]).sum())
        print(f"{rate} Hz, {n} stations: artery or stenotic {exact(vessels, len(some))} % of "
              f"{len(some)}; {some.found.value_counts().to_dict()}")  # fmt: skip


if __name__ == "__main__":
    run(main)
