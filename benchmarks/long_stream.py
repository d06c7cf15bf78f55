"""An hour of a UR arm and an FT-300 through drivers, guards and store: samples, stamps, memory.

    python benchmarks/long_stream.py [MINUTES]

Both are emulated in a process of their own, and a scan of long holds is made with them as
``palpate scan`` makes it: its guards in another process again, every block committed to a run
file. Each sample carries in its torques, which nothing else needs here, its running number on the
device, and the emulators keep when each was measured. Stored samples are so compared with what was
measured, whatever the drivers say of loss and time. Ctrl-C ends the scan early, which is judged all
the same. The rows are kept in `KEPT`; delete one to measure it again. With its emulators it takes
more than one core, before all other work.
"""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from array import array
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from kept import ROOT, Row, fill, read
from numpy.typing import NDArray

import palpate
from drivers import WallClock
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import RunEnded, Samples
from probe.guards.commands import Control
from probe.guards.guard_process import Order
from probe.guards.guard_threads import come_first
from probe.guards.opening import opened_devices
from probe.guards.prepare import prepare
from probe.scan.session import run_prepared
from probe.storage.writer import create_store
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.emulators.ft300 import PERIOD_S, Ft300
from sim_backend.emulators.serving import served
from sim_backend.phantom.phantom import Phantom

Array = NDArray[np.float64]
KEPT = ROOT / "docs" / "results" / "long-stream.csv"
ADDRESS, ARM, CELL = "127.0.77.1", "ur force", "ft300"
RATES_HZ = {ARM: 500.0, CELL: 1 / PERIOD_S}
DIGITS = 10_000  # of the FT-300's running number in one torque, in counts of 0.001 Nm
SPRING_N_M, PULSE_N_PA = 800.0, 5e-6
STATIONS, HOLD_S, PRESS_S = 15, 20.0, 22.5
LOOK_S = 300.0
ANSWERS = (
    "finish", "seconds", "load",
    *(f"{name}_{what}" for name in ("ur", "ft300") for what in
      ("measured", "stored_pct", "median_ms", "p99_ms", "worst_ms", "within_1ms_pct")),
    "scan_mb", "guard_mb", "file_mb",
)  # fmt: skip


class Beating:
    """A spring under the tip that a pulse moves."""

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        """Force [N], 0 in the air."""
        pressed = depth_m > 0
        return np.asarray(pressed * (SPRING_N_M * depth_m + PULSE_N_PA * pressure_pa))

    von_mises_pa = force_n


class Numbered(Ft300):
    """An FT-300 whose x and y torque are each frame's running number; ``measured_s`` by number."""

    def __init__(self, phantom: Phantom) -> None:
        super().__init__(phantom, noise_n=0.1, seed=0)
        self.measured_s = array("d")

    def _counts(self, time_s: float) -> list[int]:
        more, digits = divmod(len(self.measured_s), DIGITS)
        self.measured_s.append(time_s)
        return [*super()._counts(time_s)[:3], digits, more, 0]


def serve(folder: Path) -> None:
    """Emulate both until the standard input ends."""
    come_first()  # a controller of its own does not wait for what else this machine does
    clock = WallClock()
    phantom = Phantom(
        load_scene("TIHA"), clock, lambda *_: Beating(), home=(4e-3, 0.0, 3e-3)
    )  # fmt: skip
    phantom.prepare([(4e-3 * n, 0.0) for n in range(1, STATIONS + 1)])
    cell = Numbered(phantom)
    with (
        ur.emulate(phantom, at=ADDRESS) as controller,
        served(cell, str(folder / "tty"), "ft300"),
    ):
        robot: Any = controller.robot
        plain = robot.outputs

        def numbered(cycle: int) -> dict[str, Any]:
            found: dict[str, Any] = plain(cycle)
            wrench = (*found["actual_TCP_force"][:3], float(cycle), 0.0, 0.0)
            return found | {"actual_TCP_force": wrench}

        robot.outputs = numbered
        print("ready", flush=True)
        sys.stdin.read()
        first_s = robot._start_s
    cycles = np.array([first_s, robot.period_s])
    np.savez(
        folder / "truth.npz", cycles=cycles, frames=np.array(cell.measured_s), zero=zero_s(clock)
    )


def rig(minutes: float, folder: Path) -> Rig:
    """Presses of twenty seconds along a row, there and back for so long."""
    repeats = max(round(60 * minutes / (STATIONS * PRESS_S)), 1)
    stations = STATIONS if 60 * minutes >= STATIONS * PRESS_S else 2
    busy = {"silence_s": 1.0}  # what a stranger's work on this machine may not end
    return Rig.model_validate({
        "face_mm2": 100.0,
        "stage": {"driver": "ur", "host": ADDRESS, "simulated": True, **busy},
        "sensor": [
            {"driver": "ur", "host": ADDRESS, "simulated": True, **busy},
            {"driver": "ft300", "port": str(folder / "tty"), "simulated": True},
        ],
        "scan": {"stations": stations, "repeats": repeats, "indentation_mm": 1.5, "ramp_s": 1.0,
                 "hold_s": HOLD_S, "settle_s": 0.3},
        "safety": busy | {"late_s": 1.0, "engine_s": 10.0, "max_force_n": 8.0,
                          "max_torque_nm": 1e9},  # of running numbers,
    })  # fmt: skip


@dataclass
class Looks:
    """What was seen every five minutes: resident megabytes of scan and guards, the load."""

    scan_mb: list[float]
    guard_mb: list[float]
    load: list[float]
    end: threading.Event

    def look(self) -> None:
        """Once."""
        pids = [os.getpid(), *children(os.getpid(), "guard_process")]
        here, *guards = [resident_mb(pid) for pid in pids]
        self.scan_mb.append(here)
        self.guard_mb.append(max(guards, default=float("nan")))
        self.load.append(os.getloadavg()[1])

    def go_on(self) -> None:
        """Until the end."""
        self.end.wait(10.0)  # both have imported what they need
        while True:
            self.look()
            print(f"{self.scan_mb[-1]:.1f} MB here, {self.guard_mb[-1]:.1f} MB in the guards, "
                  f"load {self.load[-1]:.2f}", flush=True)  # fmt: skip
            if self.end.wait(LOOK_S):
                return


def resident_mb(pid: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def children(parent: int, marked: str) -> list[int]:
    """Processes below ``parent`` whose command line has ``marked``."""
    found = subprocess.run(["pgrep", "-P", str(parent), "-f", marked], capture_output=True,
                           text=True, check=False)  # fmt: skip
    return [int(line) for line in found.stdout.split()]


def numbers(time_s: Array, sent: Array, rate_hz: float) -> NDArray[np.int64]:
    """Running number of each sample. A tare takes a constant from what was ``sent``: it is put
    back so that stamps go on over it, which a tare does not change."""
    found = np.round(sent).astype(np.int64)
    starts = np.flatnonzero(np.diff(sent) < 0) + 1
    for start, end in zip(starts, [*starts[1:], len(sent)], strict=True):
        passed = round((time_s[start] - time_s[start - 1]) * rate_hz)
        found[start:end] = np.round(sent[start:end] - sent[start]) + found[start - 1] + passed
    return found


def judged(path: Path, device: str, measured_s: Any, later_s: float) -> dict[str, Any]:
    """Samples there and not there, and how far stamps are from when they were measured."""
    blocks = [e.block for e in palpate.open_run(path).events()
              if isinstance(e, Samples) and e.device == device]  # fmt: skip
    time_s = np.concatenate([block.time_s for block in blocks])
    values = np.concatenate([block.values for block in blocks])
    sent = values[:, 4] if device == ARM else 1e3 * (values[:, 4] + DIGITS * values[:, 5])
    number = numbers(time_s, sent, RATES_HZ[device])
    off_ms = 1e3 * (time_s + later_s - measured_s(number))
    short = device.split()[0]
    measured = int(number[-1] - number[0]) + 1
    said = sum(block.lost for block in blocks)
    print(f"{device}: {len(number)} of {measured} stored, {said} said to be lost; "
          f"median off {np.median(off_ms):+.3f} ms")  # fmt: skip
    return {
        f"{short}_measured": measured,
        f"{short}_stored_pct": f"{100 * len(number) / measured:.3f}",
        f"{short}_median_ms": f"{np.median(off_ms):.3f}",
        f"{short}_p99_ms": f"{np.percentile(np.abs(off_ms), 99):.3f}",
        f"{short}_worst_ms": f"{np.abs(off_ms).max():.3f}",
        f"{short}_within_1ms_pct": f"{100 * np.mean(np.abs(off_ms) < 1.0):.3f}",
    }


def stream(minutes: float) -> Row:
    """One scan and its judgement."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        emulators = stack.enter_context(subprocess.Popen(
            [sys.executable, __file__, "--serve", name],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
        ))  # fmt: skip
        assert emulators.stdin and emulators.stdout
        emulators.stdout.readline()
        looks = Looks([], [], [], threading.Event())
        ended, began_s = scan(rig(minutes, folder), folder / "stream.run", looks)
        emulators.stdin.close()
        emulators.wait(30)
        truth = np.load(folder / "truth.npz")
        first_s, period_s = truth["cycles"]
        later_s = began_s - float(truth["zero"])
        path = folder / "stream.run"
        print(f"{ended.finish} after {ended.time_s:.0f} s: {ended.reason}")
        return {
            "finish": str(ended.finish),
            "seconds": f"{ended.time_s:.0f}",
            "load": f"{np.mean(looks.load):.1f}",
            **judged(path, ARM, lambda n: first_s + period_s * n, later_s),
            **judged(path, CELL, lambda n: truth["frames"][n], later_s),
            "scan_mb": " ".join(f"{mb:.1f}" for mb in looks.scan_mb),
            "guard_mb": " ".join(f"{mb:.1f}" for mb in looks.guard_mb),
            "file_mb": f"{path.stat().st_size / 1e6:.0f}",
        }


def zero_s(clock: WallClock) -> float:
    """The machine's monotonic time when ``clock`` showed 0; the work of others may come between."""
    return float(np.median([time.monotonic() - clock.now() for _ in range(101)]))


def scan(rig: Rig, path: Path, looks: Looks) -> tuple[RunEnded, float]:
    """As `palpate.scan`, with a clock whose zero is known: that on the monotonic clock [s]."""
    clock, control = WallClock(), Control()
    signal.signal(signal.SIGINT, lambda _number, _frame: control.abort())
    plan = plan_for(rig)
    looking = threading.Thread(target=looks.go_on)
    with opened_devices(Order(rig, clock, None, 0, None), None, control) as ready:
        prepared = prepare(rig, plan, limits_for(rig, plan), None, ready.devices, 0)
        looking.start()
        with create_store(path) as sink:
            done = run_prepared(ready, prepared, clock, sink, control, (), {})
        looks.look()
    looks.end.set()
    looking.join()
    return done.ended, zero_s(clock)


def main() -> None:
    """Measure what is not kept yet, and tell."""
    if sys.argv[1:2] == ["--serve"]:
        serve(Path(sys.argv[2]))
        return
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    fill(KEPT, ("minutes",), ANSWERS, [(minutes,)], stream)
    print(pd.DataFrame(read(KEPT)).T.to_string())


if __name__ == "__main__":
    main()
