"""The window beside a running scan: how soon its stop button halts the arm, and what freezing or
killing it costs.

    python benchmarks/live_scan.py [STOPS]

``palpate scan`` runs as a person runs it, on an emulated UR arm with the real ur-rtde client. The
stop is a click on the window's button at random instants of a scan; its time ends when the tip
stands still in the phantom. Then a scan of the phantom in real time has its own window frozen for
five seconds and killed: lost samples are those that the run file does not have. (The UR client
polls: on a machine as busy as its emulator makes it, it loses some, window or not.) Both are kept
in `docs/results` (`window-stops.csv`, `window-killed.csv`; delete them to measure anew).
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

import numpy as np
from kept import ROOT, fill
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

import palpate
from drivers import WallClock
from probe.core.events import RunEnded, Samples
from probe.gui.state import ViewState
from probe.gui.style import application
from probe.gui.window import RunWindow
from probe.scan.remote import ask, control_path
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.models.station_response import respond
from sim_backend.phantom.phantom import Phantom

RESULTS = ROOT / "docs" / "results"
RIG = ROOT / "rigs" / "ur5e.toml"
X_M = [4e-3 * n for n in range(1, 16)]
FROZEN_S, RATE_HZ = 5.0, 500.0
ADDRESS = "127.0.0.1"  # of the shipped rig


@contextmanager
def scanning(folder: Path, *what: str) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """A scan that has begun to move: its process and its run file."""
    command = [sys.executable, "-m", "probe.cli", "scan", "--out", str(folder), *what]
    scan = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while not (runs := list(folder.glob("*.run"))) or not control_path(runs[0]).exists():
            if scan.poll() is not None:
                raise RuntimeError(f"the scan ended with status {scan.returncode}")
            time.sleep(0.02)
        yield scan, runs[0]
        scan.wait(120)
    finally:
        scan.kill()


def stopped_after_s(phantom: Phantom, clock: WallClock, wait_s: float) -> tuple[float, str]:
    """From the click to rest, and how the scan ended."""
    application()
    with tempfile.TemporaryDirectory() as name, scanning(Path(name), str(RIG)) as (scan, run):
        window = RunWindow(run, ViewState, ask=lambda word: ask(run, word))
        window.timer.stop()
        time.sleep(wait_s)
        while not phantom.tip.moving(clock.now()):  # a tip that rests already shows nothing
            if scan.poll() is not None:
                raise RuntimeError("the scan ended before the click: is the machine busy?")
            time.sleep(0.001)
        began_s = clock.now()
        QTest.mouseClick(window.side.buttons["stop"], Qt.MouseButton.LeftButton)
        while phantom.tip.moving(clock.now()):
            time.sleep(0.001)
        rest_s = phantom.tip.all_legs()[-1].end_s
        scan.wait(30)
        (*_, ended) = palpate.open_run(run).events()
        assert isinstance(ended, RunEnded)
        return rest_s - began_s, f"{ended.finish}: {ended.reason}"


def window_lost_samples() -> tuple[int, int, str]:
    """Samples lost, samples there, and the finish, of a scan whose window froze and was killed."""
    with tempfile.TemporaryDirectory() as name:
        with scanning(Path(name), "--scene", "TIHA", "--live") as (scan, run):
            time.sleep(3.0)
            (view,) = children(scan.pid, " live ")
            os.kill(view, signal.SIGSTOP)
            time.sleep(FROZEN_S)
            os.kill(view, signal.SIGCONT)
            time.sleep(1.0)
            os.kill(view, signal.SIGKILL)
            scan.wait(120)
        opened = palpate.open_run(run)
        blocks = [e for e in opened.events() if isinstance(e, Samples)]
        lost = sum(e.block.lost for e in blocks)
        time_s = np.concatenate([e.block.time_s for e in blocks if e.device != "stage"])
        lost += round(float(np.ptp(time_s)) * RATE_HZ) + 1 - len(time_s)
        return lost, len(time_s), str(opened.finish)


def children(parent: int, marked: str) -> list[int]:
    """Processes below ``parent`` whose command line has ``marked``."""
    found = subprocess.run(["pgrep", "-P", str(parent), "-f", marked], capture_output=True,
                           text=True, check=False)  # fmt: skip
    return [int(line) for line in found.stdout.split()]


def main() -> None:
    """Print both."""
    stops = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    rng = np.random.default_rng(7)
    clock = WallClock()
    phantom = Phantom(load_scene("TIHA"), clock, respond, home=(0.032, 0.0, 0.002))
    phantom.prepare([(x, 0.0) for x in X_M])
    took = []
    with ur.emulate(phantom, at=ADDRESS):
        for n in range(stops):
            seconds, finish = stopped_after_s(phantom, clock, float(rng.uniform(0.5, 8.0)))
            took.append(1e3 * seconds)
            print(f"stop {n + 1}: tip at rest after {took[-1]:.0f} ms; {finish}", flush=True)
        print(f"click to rest: median {np.median(took):.0f} ms, largest {max(took):.0f} ms "
              f"of {stops}")  # fmt: skip
        fill(RESULTS / "window-stops.csv", ("stop",), ("ms", "load"),
             [(n,) for n in range(stops)],
             lambda n: {"ms": f"{took[n]:.1f}", "load": f"{os.getloadavg()[0]:.1f}"})  # fmt: skip
        lost, there, finish = window_lost_samples()
    fill(RESULTS / "window-killed.csv", ("frozen_s",), ("lost", "stored", "finish"), [(FROZEN_S,)],
         lambda _: {"lost": lost, "stored": there, "finish": finish})  # fmt: skip
    print(
        f"window frozen {FROZEN_S:g} s, then killed: {lost} samples lost, {there} there; {finish}"
    )
    if max(took) > 100 or lost:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
