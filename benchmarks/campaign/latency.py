"""Guard latency: from the sample that breaks the force limit to the order to stop on the wire.

The cell's next line says several newtons more (the world sends it at a known time), the board
notes when the first byte that ends a motion arrives. Real command, real drivers, real ports.

    python -m campaign latency --trials 100 --jobs 3 --log latency.csv

The documentation's table is of `docs/results/guard-latency.csv`.
"""

import csv
import os
from concurrent.futures import as_completed
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from kept import commit, read

from campaign.cell import RATE_HZ
from campaign.faults import BY_NAME, Draw, Fault
from campaign.judge import judge, load
from campaign.once import beside, struck_once
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
COLUMNS = ("condition", "seed", "ms", "late_ms", "up", "load", "commit", "date")


def trial(task: tuple[str, int]) -> dict[str, Any]:
    """One scan, one broken limit, under one condition."""
    name, seed = task
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
        "condition": name,
        "seed": seed,
        "ms": round(1e3 * verdict.latency_s, 3),
        "late_ms": round(1e3 * verdict.late_s, 3),
        "up": verdict.up,
        "load": round(os.getloadavg()[0], 2),
        "commit": commit(),
        "date": datetime.now(UTC).date().isoformat(),
    }


def run(trials: int, jobs: int, log: Path) -> int:
    """All trials that the log does not hold, then the table."""
    rows = read(log)
    have = {(row["condition"], int(row["seed"])) for row in rows}
    left = [(name, seed) for seed in range(trials) for name in CONDITIONS]
    left = [task for task in left if task not in have]
    with beside(jobs) as pool, log.open("a", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, COLUMNS)
        if not rows:
            writer.writeheader()
        for future in as_completed([pool.submit(trial, task) for task in left]):
            writer.writerow(future.result())
            out.flush()
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
