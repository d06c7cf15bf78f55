"""What a press does to what lies under it when its program dies, or the robot does not obey.

    python benchmarks/left_alone.py [FAULT...]

`palpate scan` presses with an emulated UR on a spring, 2.4 mm at 1.2 mm/s with a limit of 4 N; the
fault comes at 1.2 mm or 2.4 N on the way down. Force and place are the phantom's. One row for each
fault and spring is kept in `KEPT`; delete one to run it again.
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from kept import ROOT, Row, fill

from drivers import WallClock
from drivers.core.arrays import Array
from probe.guards.guard_threads import come_first
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import Scene

KEPT = ROOT / "docs" / "results" / "left-alone.csv"
KEYS = ("device", "fault", "stiffness_n_mm")
ANSWERS = ("at_mm", "deeper_mm", "most_n", "rest_s", "up_s", "left_mm", "program", "said")
STIFFNESSES_N_MM = (1.0, 3.0, 10.0)
HOST, X_M = "127.78.0.1", 0.032
AT_M, AT_N, UP_M = 1.2e-3, 2.4, 1e-3
LASTS_S = 40.0
WORDS = re.compile("fault: |palpate: |THE PROBE")
RIG = f"""
face_mm2 = 100.0
[stage]
driver = "ur"
host = "{HOST}"
simulated = true
acceleration_mm_s2 = 1000.0
[[sensor]]
driver = "ur"
host = "{HOST}"
simulated = true
[scan]
start_mm = 32.0
stations = 1
indentation_mm = 2.4
ramp_s = 2.0
hold_s = 1.0
settle_s = 0.3
approach_mm_s = 2.0
[safety]
max_force_n = 4.0
max_depth_mm = 3.0
max_speed_mm_s = 25.0
retract_mm = 2.0
workspace_mm = {{ x = [-5.0, 70.0], y = [-5.0, 5.0], z = [-4.0, 50.0] }}
[scene]
name = "TIHA"
"""


class Spring:
    """What lies under the probe."""

    def __init__(self, stiffness_n_mm: float) -> None:
        self.n_m = 1e3 * stiffness_n_mm

    def force_n(self, _x_m: float, depth_m: Array, pressure_pa: Array) -> Array:
        return np.asarray(np.maximum(depth_m + 0.0 * np.asarray(pressure_pa), 0.0) * self.n_m)

    def von_mises_pa(self, x_m: float, depth_m: Array, pressure_pa: Array) -> Array:
        return self.force_n(x_m, depth_m, pressure_pa) / 1e-4

    def __call__(self, _scene: Scene, _x_m: float, _depth_m: float) -> "Spring":
        return self


Scan = subprocess.Popen[str]


def children(of: int) -> list[int]:
    """A process and all that came of it, the eldest first."""
    done = subprocess.run(["pgrep", "-P", str(of)], capture_output=True, text=True, check=False)
    return [
        of,
        *(grandchild for child in done.stdout.split() for grandchild in children(int(child))),
    ]


def die(scan: Scan, which: slice) -> None:
    """Of the scan's process, the one that guards and the one of the robot's client."""
    for process in children(scan.pid)[which]:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def begin(fault: str, lasts_s: float = LASTS_S) -> Callable[[Scan, ur.UrController], None]:
    """A fault of the emulator, mended after ``lasts_s``."""

    def strike(scan: Scan, robot: ur.UrController) -> None:
        robot.fail(fault)
        end_s = time.monotonic() + lasts_s
        while scan.poll() is None and time.monotonic() < end_s:
            time.sleep(0.005)
        if fault == "paused":
            robot.robot.resume()  # by a person, once the program has given up
        elif lasts_s < LASTS_S:
            robot.fail(None)

    return strike


FAULTS: dict[str, Callable[[Scan, ur.UrController], None]] = {
    "guard dies": lambda scan, _robot: die(scan, slice(1, 2)),
    "scan and guard die": lambda scan, _robot: die(scan, slice(0, 2)),
    "all dies": lambda scan, _robot: die(scan, slice(0, 3)),
    "uplink stalls for 0.15 s": begin("uplink stalls", 0.15),
    "uplink stalls for 1 s": begin("uplink stalls", 1.0),
    "stopL not obeyed": begin("ignored stops"),
    "paused, then resumed": begin("paused"),
    "slider to 0": begin("slider at 0"),
}


def judge(_device: str, fault: str, stiffness_n_mm: float) -> Row:
    """One scan."""
    clock, spring = WallClock(), Spring(stiffness_n_mm)
    phantom = Phantom(load_scene("TIHA"), clock, spring, home=(X_M, 0.0, 3e-3))

    def z_m() -> float:
        return phantom.tip.point(clock.now())[2]

    with tempfile.TemporaryDirectory() as folder, ur.emulate(phantom, at=HOST) as robot:
        rig = Path(folder) / "rig.toml"
        rig.write_text(RIG)
        command = [sys.executable, "-c", "from probe.cli import main; raise SystemExit(main())"]
        scan = subprocess.Popen(
            [*command, "scan", str(rig), "--out", folder], stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, cwd=ROOT,
        )  # fmt: skip
        deep_m = min(AT_M, AT_N / spring.n_m)
        while z_m() > -deep_m:
            if scan.poll() is not None:
                raise RuntimeError(scan.communicate()[0])
            time.sleep(0.003)
        struck_s, at_m = clock.now(), z_m()
        FAULTS[fault](scan, robot)
        said, _ = scan.communicate(timeout=LASTS_S)
        while robot.robot.playing and clock.now() < struck_s + 10.0:
            time.sleep(0.01)
        time.sleep(1.0)
        times_s = np.arange(struck_s, clock.now(), 1e-3)
        heights_m = np.array([phantom.tip.point(float(time_s))[2] for time_s in times_s])
        up = times_s[heights_m > UP_M]
        return {
            "at_mm": f"{-1e3 * at_m:.3f}",
            "deeper_mm": f"{1e3 * max(at_m - heights_m.min(), 0.0):.3f}",
            "most_n": f"{spring.n_m * max(-heights_m.min(), 0.0):.2f}",
            "rest_s": f"{times_s[heights_m.argmin()] - struck_s:.3f}",
            "up_s": f"{up[0] - struck_s:.2f}" if len(up) else "",
            "left_mm": f"{-1e3 * heights_m[-1]:.3f}",
            "program": "runs" if robot.robot.playing else "ended",
            "said": " / ".join(line for line in said.splitlines() if WORDS.match(line))[:400],
        }


def main() -> None:
    """Run what is not kept yet."""
    come_first()  # the emulated controller keeps its time
    faults = sys.argv[1:] or list(FAULTS)
    jobs = [("ur", fault, k) for fault in faults for k in STIFFNESSES_N_MM]
    fill(KEPT, KEYS, ANSWERS, jobs, judge)


if __name__ == "__main__":
    main()
