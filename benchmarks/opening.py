"""Runs of 1 GB: the most memory that reading one for detection, and verifying it, takes.

    python benchmarks/opening.py

One force and 64 taxels at 500 Hz, in fifteen presses or in a single one, with the stage's poses at
100 Hz. Each is read by a process of its own, whose peak includes Python and its libraries and
whatever pages of files were in it. The rows are kept in `KEPT`; delete one to measure it again.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from kept import ROOT, Row, fill

from drivers import Block, Channel
from probe.core.events import (
    Finish,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.storage.run import open_run
from probe.storage.verify import verify
from probe.storage.writer import create_store

KEPT = ROOT / "docs" / "results" / "opening.csv"
BYTES = 1_000_000_000
RATE_HZ, POSES_HZ = 500, 100
BLOCK = {
    1: 250,
    64: 25,
}  # samples: a block of 0.5 s is ten times a scan's, and as much sooner written
FLUSH = 200


def make(path: Path, channels: int, presses: int) -> None:
    """Write a run of `BYTES`."""
    feels = tuple(Channel(f"t{n}", "Pa", "pressure") for n in range(channels))
    stage = tuple(Channel(axis, "m", "position") for axis in "xyz")
    block, rng, time_s = BLOCK[channels], np.random.default_rng(0), 0.0
    poses = block * POSES_HZ // RATE_HZ
    low, flags = np.array([0.0, 0.0, -2.5e-3]), np.zeros((block, channels), bool)
    with create_store(path) as store:
        store(RunStarted(0.0, "2026-01-01T00:00:00+00:00", {}, {"taxels": feels, "stage": stage}))
        for press in range(presses):
            store(StationStarted(time_s, press, 1, 4e-3 * press, 0.0))
            for phase in (Phase.APPROACHING, Phase.INDENTING, Phase.HOLDING):
                store(PhaseEntered(time_s, phase, press))
            written = 0
            while path.stat().st_size < BYTES * (press + 1) / presses:
                values = 1e4 + 20 * rng.standard_normal((block, channels))
                at_s = time_s + np.arange(1, block + 1) / RATE_HZ
                store(Samples("taxels", Block(at_s, values, flags), press, 1))
                at_s = time_s + np.arange(1, poses + 1) / POSES_HZ
                nobody = np.zeros((poses, 3), bool)
                store(Samples("stage", Block(at_s, np.tile(low, (poses, 1)), nobody), press, 1))
                time_s += block / RATE_HZ
                written += 1
                if written % FLUSH == 0:
                    store.flush()
            store(PhaseEntered(time_s, Phase.RETRACTING, press))
            store(StationEnded(time_s, press, 1, complete=True))
        store.flush()
        store(RunEnded(time_s, Finish.COMPLETED, "every station is complete"))


def use(what: str, path: str) -> None:
    """Read it in this process; print the peak [MB]."""
    if what == "read":
        open_run(path).recording()
    else:
        verify(path)
    status = Path("/proc/self/status").read_text(encoding="ascii")
    print(int(re.findall(r"VmHWM:\s*([0-9]+)", status)[0]) / 1024)


def judge(channels: int, presses: int) -> Row:
    """One run, read and verified."""
    row: dict[str, object] = {}
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        path = Path(folder) / "large.run"
        make(path, channels, presses)
        row["file_mb"] = path.stat().st_size // 10**6
        for what in ("read", "verify"):
            began_s = time.monotonic()
            command = [sys.executable, __file__, what, path]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            row[f"{what}_mb"] = f"{float(done.stdout):.0f}"
            row[f"{what}_s"] = f"{time.monotonic() - began_s:.0f}"
    row["load"] = round(os.getloadavg()[0], 1)
    print(channels, presses, row, flush=True)
    return row


if __name__ == "__main__":
    if len(sys.argv) > 1:
        use(*sys.argv[1:])
    else:
        answers = ("file_mb", "read_mb", "read_s", "verify_mb", "verify_s", "load")
        jobs = [(channels, presses) for channels in BLOCK for presses in (15, 1)]
        fill(KEPT, ("channels", "presses"), answers, reversed(jobs), judge)
