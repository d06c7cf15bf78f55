"""Guard latency: from the sample that breaks the force limit to the order to stop on the wire.

The cell's next line says several newtons more (the world sends it at a known time), the board
notes when the first byte that ends a motion arrives. Real command, real drivers, real ports.

    python -m campaign latency --trials 100 --jobs 3 --log latency.csv

The documentation's table is of `docs/results/guard-latency.csv`.
"""

import os
from pathlib import Path

import numpy as np
from kept import Row, fill, read

from campaign.cell import RATE_HZ
from campaign.faults import BY_NAME, Draw, Fault
from campaign.judge import judge, load
from campaign.once import struck_once
from campaign.world import Bed

CONDITIONS = {
    "calm": (),
    "interpreter busy": ("interpreter busy",),
    "C extension holds the interpreter 1 s": ("interpreter held",),
    "connection flood": ("connection flood",),
    "during SIGSTOP of the scan": ("SIGSTOP and SIGCONT",),
}
PRESSED_M = 2.3e-3
WHOLE = (1.0, 1.0, 1.0)


def trial(name: str, seed: int) -> Row:
    """One scan, one broken limit, under one condition."""
    rng = np.random.default_rng([seed, len(name)])
    faults = [Fault(BY_NAME[kind], WHOLE, 0.0, 0, PRESSED_M) for kind in CONDITIONS[name]]
    later_s = float(rng.uniform(0.05, 0.35))
    faults.append(Fault(BY_NAME["cell spikes"], WHOLE, later_s, 0, PRESSED_M))
    drawn = Draw(seed, tuple(faults), Bed(), bool(rng.integers(2)))
    with struck_once(drawn) as (folder, ended):
        verdict = judge(
            drawn, load(folder / "truth.npz"), status=ended.status, answer=ended.answer,
            said=ended.said, run=None,
        )  # fmt: skip
    return {
        "ms": round(1e3 * verdict.latency_s, 3),
        "late_ms": round(1e3 * verdict.late_s, 3),
        "up": verdict.up,
        "load": round(os.getloadavg()[0], 2),
    }


def run(trials: int, jobs: int, log: Path) -> int:
    """All trials that the log does not hold, then the table."""
    every = [(name, seed) for seed in range(trials) for name in CONDITIONS]
    fill(log, ("condition", "seed"), ("ms", "late_ms", "up", "load"), every, trial, jobs)
    print_table(log)
    return 0


def print_table(log: Path) -> None:
    """Latency by condition, in milliseconds and in samples."""
    rows = read(log)
    print("| condition | trials | without a stop | median ms | p99 ms | max ms | max samples | "
          "truth late max ms |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for name in CONDITIONS:
        some = [row for row in rows if row["condition"] == name]
        ms = np.array([float(row["ms"]) for row in some])
        ms = ms[np.isfinite(ms)]
        if len(ms) == 0:
            continue
        middle, rare = np.percentile(ms, [50, 99])
        figures = (middle, rare, ms.max(), RATE_HZ * ms.max() / 1e3,
                   max(float(row["late_ms"]) for row in some))  # fmt: skip
        cells = [name, len(some), len(some) - len(ms), *(f"{value:.1f}" for value in figures)]
        print(f"| {' | '.join(map(str, cells))} |")
