"""What a press does to what lies under it when everything else dies, on stages on a line.

    python benchmarks/left_alone_lines.py [DEVICE...]

As `left_alone`, which has the UR: `palpate scan` presses with an emulated stage and load cell on a
spring, 2.4 mm at 1.2 mm/s with a limit of 4 N; the fault comes at 1.2 mm or 2.4 N on the way down.
Force and place are the phantom's. One row for each fault and spring is kept in the same table.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from kept import ROOT, Row, fill

from drivers import WallClock
from drivers.core.arrays import Array
from sim_backend import load_scene
from sim_backend.emulators import grbl, lines, pi, tmcl, zaber
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import Scene

KEPT = ROOT / "docs" / "results" / "left-alone.csv"
KEYS = ("device", "fault", "stiffness_n_mm")
ANSWERS = ("at_mm", "deeper_mm", "most_n", "rest_s", "up_s", "left_mm", "program", "said")
STIFFNESSES_N_MM = (1.0, 3.0, 10.0)
AT_M, AT_N, UP_M = 1.2e-3, 2.4, 1e-3
APPROACHES_M = 1e-3
LASTS_S, TRIES = 40.0, 5
STAGES: dict[str, Any] = {"grbl": grbl, "zaber": zaber, "pi": pi, "tmcl": tmcl}
RIG = """
face_mm2 = 100.0
[stage]
driver = "{name}"
port = "{stage}"
simulated = true
limits_mm = [[-5.0, 70.0], [-5.0, 5.0], [-4.0, 40.0]]
max_speed_mm_s = 25.0
{axes}
[[sensor]]
driver = "lines"
port = "{cell}"
simulated = true
pattern = "(?P<time>[0-9]+) (?P<force>[-+0-9.eE]+) N"
time_unit_s = 0.001
rate_hz = 200.0
channel = [{{ name = "force", unit = "N", role = "force" }}]
[scan]
start_mm = 32.0
stations = 1
indentation_mm = 2.4
ramp_s = 2.0
hold_s = 1.0
settle_s = 0.3
[safety]
max_force_n = 4.0
max_depth_mm = 3.0
silence_s = 0.5
max_speed_mm_s = 25.0
retract_mm = 2.0
workspace_mm = {{ x = [-5.0, 70.0], y = [-5.0, 5.0], z = [-4.0, 40.0] }}
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
    """A process and all that came of it."""
    done = subprocess.run(["pgrep", "-P", str(of)], capture_output=True, text=True, check=False)
    return [of, *(later for child in done.stdout.split() for later in children(int(child)))]


def all_dies(_scan: Scan, _stage: Served, family: list[int]) -> None:
    """Scan, guards and whatever they began; none sees another die."""
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for process in family:
            with suppress(ProcessLookupError):
                os.kill(process, number)


def begin(fault: str, lasts_s: float = LASTS_S) -> Callable[[Scan, Served, list[int]], None]:
    """A fault of the emulator, mended after ``lasts_s``."""

    def strike(scan: Scan, stage: Served, _family: list[int]) -> None:
        stage.fail(fault)
        end_s = time.monotonic() + lasts_s
        while scan.poll() is None and time.monotonic() < end_s:
            time.sleep(0.005)
        if lasts_s < LASTS_S:
            stage.fail(None)

    return strike


Faults = dict[str, Callable[[Scan, Served, list[int]], None]]
BOTH: Faults = {"all dies": all_dies, "plug pulled": begin("drop")}
OF_GRBL: Faults = {
    "0x85 not heard": begin("seven bits"),
    "0x85 and ! not obeyed": begin("ignores 0x85 and !"),
    "door for 3 s": begin("door", 3.0),
    "door for 1 s in a jog": begin("door while jogging", 1.0),
    "reports freeze": begin("frozen reports"),
}
OF_OTHERS: Faults = {
    "stop not obeyed": begin("ignores stop"),
    "two stops not obeyed": begin("ignores stops"),
}
FAULTS = {name: BOTH | (OF_GRBL if name == "grbl" else OF_OTHERS) for name in STAGES}


def axes_of(name: str) -> str:
    """The stage's own keys in the rig file."""
    if name == "grbl":
        return f"origin_mm = {list(grbl.ORIGIN_MM)}"
    emulator = STAGES[name]
    inline = (
        f"{axis} = {{ {', '.join(f'{key} = {json.dumps(value)}' for key, value in keys.items())} }}"
        for axis, keys in emulator.RIG_AXES.items()
    )
    return "\n".join([f"origin_mm = {list(emulator.RIG_ORIGIN_MM)}", *inline])


def judge(device: str, fault: str, stiffness_n_mm: float) -> Row:
    """One scan that is struck; a busy machine may end one before."""
    for _ in range(TRIES):
        if (row := struck(device, fault, stiffness_n_mm)) is not None:
            return row
    raise RuntimeError(f"{device}: no scan pressed")


def struck(device: str, fault: str, stiffness_n_mm: float) -> Row | None:
    """What one scan did; None if it ended by itself before the fault."""
    clock, spring = WallClock(), Spring(stiffness_n_mm)
    phantom = Phantom(load_scene("TIHA"), clock, spring, home=(0.032, 0.0, 3e-3))

    def z_m() -> float:
        return phantom.tip.point(clock.now())[2]

    with (
        tempfile.TemporaryDirectory() as folder,
        STAGES[device].emulate(phantom, at="socket://127.0.0.1:0", homed=True) as stage,
        lines.emulate(phantom, at="socket://127.0.0.1:0", rate_hz=200.0) as cell,
    ):
        rig = Path(folder) / "rig.toml"
        keys = {"name": device, "stage": stage.address, "cell": cell.address}
        rig.write_text(RIG.format(**keys, axes=axes_of(device)))
        command = [sys.executable, "-c", "from probe.cli import main; raise SystemExit(main())"]
        scan = subprocess.Popen(
            [*command, "scan", str(rig), "--out", folder], stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, cwd=ROOT,
        )  # fmt: skip
        deep_m = min(AT_M, AT_N / spring.n_m)
        family: list[int] = []
        while z_m() > -deep_m:
            time.sleep(0.001)
            if not family and z_m() < APPROACHES_M:
                family = children(scan.pid)
            if scan.poll() is not None:
                return None
        struck_s, at_m = clock.now(), z_m()
        FAULTS[device][fault](scan, stage, family)
        said, _ = scan.communicate(timeout=LASTS_S)
        while phantom.tip.moving(clock.now()):
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
            "program": "",
            "said": " / ".join(said.strip().splitlines()[-2:])[:300],
        }


def main() -> None:
    """Run what is not kept yet."""
    devices = sys.argv[1:] or list(STAGES)
    jobs = [(d, fault, k) for d in devices for fault in FAULTS[d] for k in STIFFNESSES_N_MM]
    fill(KEPT, KEYS, ANSWERS, jobs, judge)


if __name__ == "__main__":
    main()
