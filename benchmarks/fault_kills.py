"""Processes of a scan killed at random instants; the file checked, resumed, and checked again.

Each scan is a process of its own, forked, so that it can be killed without warning.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from fault_runs import HANG_S, RIG, SEED, Outcome, bed, check_file, check_resumed

from probe.control import Control, ctrl_c
from probe.events import Event
from probe.resume import resume
from probe.run import NotBegun, RunFileError, follow, open_run
from probe.session import scan
from probe.verify import verify

KILLS = ("kill -9", "kill -9, and again while resuming", "signal storm", "viewer killed")
PACE_S = 2e-3  # per event: a scan then takes one and a half seconds or so
LAST_S = 1.4


def kill_one(seed: int, kind: str) -> Outcome:
    """One scan in a process of its own, struck from outside; all drawn from the seed."""
    rng = np.random.default_rng(seed)
    folder = Path(mkdtemp(prefix="palpate-kill-"))
    at_s = float(rng.uniform(0.0, LAST_S))
    wrong: list[str] = []
    scanning = forked(lambda: _scan(folder))
    viewer = forked(lambda: _view(folder)) if kind == "viewer killed" else None
    time.sleep(at_s)
    committed = _committed(folder)
    hang_s = 0.0
    if kind.startswith("kill"):
        os.kill(scanning, signal.SIGKILL)
    elif viewer is not None:
        os.kill(viewer, signal.SIGKILL)
        os.waitpid(viewer, 0)
    else:
        hang_s = _storm(scanning, rng)
    if not _ended(scanning, 10.0):
        wrong.append("the scan's process did not end")
    path = next(folder.glob("*.run"), None)
    finish, complete = "not begun", 0
    try:
        if path is not None:
            finish = open_run(path).finish or "broken off"
            complete = verify(path).stations_complete
            wrong += check_file(path, None, committed)
            if kind.endswith("resuming"):
                again = forked(lambda: resume(path, respond=bed, observers=[_paced]))
                time.sleep(float(rng.uniform(0.0, LAST_S)))
                committed = _committed(folder)
                os.kill(again, signal.SIGKILL)
                os.waitpid(again, 0)
                wrong += check_file(path, None, committed)
            if open_run(path).finish != "completed":
                wrong += check_resumed(path, unchanged_s=np.inf if kind == "kill -9" else 0.0)
    except NotBegun:
        if committed:
            wrong.append("what was committed is gone")
    for file in folder.iterdir():
        file.unlink()
    folder.rmdir()
    if hang_s > HANG_S:
        wrong.append(f"hung for {hang_s:.1f} s")
    nan = float("nan")
    return Outcome(kind, at_s, finish, complete, nan, nan, hang_s, nan, tuple(wrong))


def forked(work: Callable[[], object]) -> int:
    """Run ``work`` in a process of its own; its number."""
    sys.stdout.flush()
    number = os.fork()
    if number:
        return number
    try:
        work()
    finally:
        os._exit(0)


def _scan(folder: Path) -> None:
    control = Control()
    with ctrl_c(control):
        scan(RIG, "TIHA", folder, seed=SEED, respond=bed, control=control, observers=[_paced])


def _paced(_event: Event) -> None:
    time.sleep(PACE_S)


def _view(folder: Path) -> None:
    while not (found := list(folder.glob("*.run"))):
        time.sleep(0.002)
    for _ in follow(found[0]):
        time.sleep(1e-4)


def _committed(folder: Path) -> int:
    with suppress(RunFileError):
        for path in folder.glob("*.run"):
            return sum(1 for _ in open_run(path).events())
    return 0


def _storm(scanning: int, rng: np.random.Generator) -> float:
    """Ctrl-C and SIGTERM in quick succession; how long the scan took to end [s]."""
    began_s = time.perf_counter()
    signals: Sequence[int] = (signal.SIGINT, signal.SIGTERM)
    for _ in range(20):
        if _ended(scanning, float(rng.uniform(0, 0.005))):
            break
        os.kill(scanning, int(rng.choice(signals)))
    _ended(scanning, 2 * HANG_S)
    return time.perf_counter() - began_s


def _ended(process: int, timeout_s: float) -> bool:
    """Wait for a child; True once it has ended."""
    until_s = time.perf_counter() + timeout_s
    while True:
        try:
            if os.waitpid(process, os.WNOHANG)[0]:
                return True
        except ChildProcessError:  # it was waited for before
            return True
        if time.perf_counter() > until_s:
            return False
        time.sleep(0.001)
