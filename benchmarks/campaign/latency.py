"""Guard latency: from the sample that breaks the force limit to the order to stop on the wire.

The cell's next line says several newtons more (the world sends it at a known time), the board
notes when the first byte that ends a motion arrives. Real command, real drivers, real ports.

    python -m campaign latency --trials 100 --jobs 3 --log latency.jsonl
"""

import json
import math
import os
from concurrent.futures import as_completed
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

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
        "latency_s": verdict.latency_s,
        "late_s": verdict.late_s,
        "up": verdict.up,
        "load": round(os.getloadavg()[0], 2),
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def run(trials: int, jobs: int, log: Path) -> int:
    """All trials that the log does not hold, then the table."""
    rows = _rows(log)
    held = {(row["condition"], row["seed"]) for row in rows}
    left = [(name, seed) for seed in range(trials) for name in CONDITIONS]
    left = [task for task in left if task not in held]
    with beside(jobs) as pool, log.open("a", encoding="utf-8") as out:
        for future in as_completed([pool.submit(trial, task) for task in left]):
            out.write(json.dumps(future.result()) + "\n")
            out.flush()
    print_table(log)
    return 0


def print_table(log: Path) -> None:
    """Latency by condition, in milliseconds and in samples."""
    rows = _rows(log)
    print("| condition | trials | without a stop | median ms | p99 ms | max ms | max samples | "
          "truth late max ms |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for name in CONDITIONS:
        some = [row for row in rows if row["condition"] == name]
        late = np.array([r["latency_s"] for r in some if not math.isnan(r["latency_s"])])
        if len(late) == 0:
            continue
        middle, rare = 1e3 * np.percentile(late, [50, 99])
        figures = (middle, rare, 1e3 * late.max(), RATE_HZ * late.max(),
                   1e3 * max(row["late_s"] for row in some))  # fmt: skip
        cells = [name, len(some), len(some) - len(late), *(f"{value:.1f}" for value in figures)]
        print(f"| {' | '.join(map(str, cells))} |")


def _rows(log: Path) -> list[dict[str, Any]]:
    if not log.exists():
        return []
    return [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
