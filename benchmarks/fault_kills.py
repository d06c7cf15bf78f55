"""Processes of a scan killed at random instants; the file checked, resumed, and checked again.

Each scan is a process of its own, forked from a server that has imported everything, so that it
begins at once and can be killed without warning.
"""

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import forkserver
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Event as EventClass
from pathlib import Path
from tempfile import mkdtemp
from unittest.mock import patch

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
PROCESSES = multiprocessing.get_context("forkserver")
PROCESSES.set_forkserver_preload(["fault_kills"])


def kill_one(seed: int, kind: str) -> Outcome:
    """One scan in a process of its own, struck from outside; all drawn from the seed."""
    rng = np.random.default_rng(seed)
    folder = Path(mkdtemp(prefix="palpate-kill-"))
    at_s = float(rng.uniform(0.0, LAST_S))
    wrong: list[str] = []
    viewer = begun(_view, folder) if kind == "viewer killed" else None
    scanning = begun(_scan, folder)
    time.sleep(at_s)
    committed, hang_s = _committed(folder), 0.0
    if kind.startswith("kill"):
        _kill(scanning)
    elif viewer is not None:
        _kill(viewer)
    else:
        hang_s = _storm(scanning, rng)
    scanning.join(10.0)
    if scanning.is_alive():
        wrong.append("the scan's process did not end")
    path = next(folder.glob("*.run"), None)
    finish, complete = "not begun", 0
    try:
        if path is not None:
            finish = open_run(path).finish or "broken off"
            complete = verify(path).stations_complete
            wrong += check_file(path, None, committed)
            if kind.endswith("resuming"):
                again = begun(_resume, path)
                time.sleep(float(rng.uniform(0.0, LAST_S)))
                committed = _committed(folder)
                _kill(again)
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


def begun(work: Callable[[Path], None], path: Path) -> BaseProcess:
    """A process that does ``work``, once it has begun to."""
    _serve()
    ready = PROCESSES.Event()
    process = PROCESSES.Process(target=_work, args=(work, path, ready), daemon=True)
    process.start()
    ready.wait(20.0)
    return process


def _serve() -> None:
    """Start the server of processes; it finds what it shall import only by the environment."""
    with patch.dict(os.environ, PYTHONPATH=os.pathsep.join(sys.path)):
        forkserver.ensure_running()


def _work(work: Callable[[Path], None], path: Path, ready: EventClass) -> None:
    ready.set()
    with suppress(RunFileError):  # a resume may find nothing to do
        work(path)


def _kill(process: BaseProcess) -> None:
    process.kill()
    process.join()


def _scan(folder: Path) -> None:
    control = Control()
    with ctrl_c(control):
        scan(RIG, "TIHA", folder, seed=SEED, respond=bed, control=control, observers=[_paced])


def _resume(path: Path) -> None:
    resume(path, respond=bed, observers=[_paced])


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


def _storm(scanning: BaseProcess, rng: np.random.Generator) -> float:
    """Ctrl-C and SIGTERM in quick succession; how long the scan took to end [s]."""
    began_s = time.perf_counter()
    signals = (signal.SIGINT, signal.SIGTERM)
    for _ in range(20):
        scanning.join(float(rng.uniform(0, 0.005)))
        if not scanning.is_alive() or scanning.pid is None:
            break
        with suppress(ProcessLookupError):  # it has ended since it was asked
            os.kill(scanning.pid, int(rng.choice(signals)))
    scanning.join(2 * HANG_S)
    return time.perf_counter() - began_s
