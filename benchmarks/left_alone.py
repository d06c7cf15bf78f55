"""What a press does to what lies under it when its program dies, or its stage does not obey.

    python benchmarks/left_alone.py [DEVICE...]

`palpate scan` presses with an emulated UR, or with an emulated stage on a line and a load cell, on
a spring, 2.4 mm at 1.2 mm/s with a limit of 4 N; the fault comes at 1.2 mm or 2.4 N on the way
down. Force and place are the phantom's. One row for each device, fault and spring is kept in
`KEPT`; delete one to run it again.
"""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from kept import ROOT, Row, fill, run

from drivers import WallClock
from drivers.core.arrays import Array
from probe.guards.guard_threads import come_first
from sim_backend import load_scene
from sim_backend.emulators import grbl, lines, pi, tmcl, ur, zaber
from sim_backend.phantom.phantom import Phantom
from sim_backend.scene.scene_file import Scene

KEPT = ROOT / "docs" / "results" / "left-alone.csv"
KEYS = ("device", "fault", "stiffness_n_mm")
ANSWERS = ("at_mm", "deeper_mm", "most_n", "rest_s", "up_s", "left_mm", "program", "said")
STIFFNESSES_N_MM = (1.0, 3.0, 10.0)
HOST, X_M = "127.78.0.1", 0.032
AT_M, AT_N, UP_M = 1.2e-3, 2.4, 1e-3
APPROACHES_M = 1e-3
LASTS_S, TRIES = 40.0, 5
WORDS = re.compile("fault: |palpate: |THE PROBE")
STAGES: dict[str, Any] = {"grbl": grbl, "zaber": zaber, "pi": pi, "tmcl": tmcl}
RIG = """
face_mm2 = 100.0
{devices}
[scan]
start_mm = 32.0
stations = 1
indentation_mm = 2.4
ramp_s = 2.0
hold_s = 1.0
settle_s = 0.3
{approach}
[safety]
max_force_n = 4.0
max_depth_mm = 3.0
max_speed_mm_s = 25.0
retract_mm = 2.0
workspace_mm = {{ x = [-5.0, 70.0], y = [-5.0, 5.0], z = [-4.0, {ceiling_mm}] }}
{silence}
[scene]
name = "TIHA"
"""
ARM = f"""
[stage]
driver = "ur"
host = "{HOST}"
simulated = true
acceleration_mm_s2 = 1000.0
[[sensor]]
driver = "ur"
host = "{HOST}"
simulated = true
"""
LINE = """
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
"""


class Spring:
    """What lies under the probe."""

    def __init__(self, stiffness_n_mm: float) -> None:
        self.n_m = 1e3 * stiffness_n_mm

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        return np.asarray(np.maximum(depth_m + 0.0 * np.asarray(pressure_pa), 0.0) * self.n_m)

    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array:
        return self.force_n(depth_m, pressure_pa) / 1e-4

    def __call__(self, _scene: Scene, _x_m: float, _depth_m: float) -> "Spring":
        return self


@dataclass
class Struck:
    """What a fault may strike: the scan, its ``family`` of processes, the emulated stage."""

    scan: subprocess.Popen[str]
    family: list[int]
    stage: Any


Strike = Callable[[Struck], None]


def children(of: int) -> list[int]:
    """A process and all that came of it, the eldest first."""
    done = subprocess.run(["pgrep", "-P", str(of)], capture_output=True, text=True, check=False)
    return [of, *(later for child in done.stdout.split() for later in children(int(child)))]


def die(which: slice) -> Strike:
    """Of the scan, what guards, and a robot's client; none sees another die."""

    def strike(struck: Struck) -> None:
        for number in (signal.SIGSTOP, signal.SIGKILL):
            for process in struck.family[which]:
                with suppress(ProcessLookupError):
                    os.kill(process, number)

    return strike


def begin(fault: str, lasts_s: float = LASTS_S) -> Strike:
    """A fault of the emulator, mended after ``lasts_s``."""

    def strike(struck: Struck) -> None:
        struck.stage.fail(fault)
        end_s = time.monotonic() + lasts_s
        while struck.scan.poll() is None and time.monotonic() < end_s:
            time.sleep(0.005)
        if fault == "paused":
            struck.stage.robot.resume()  # by a person, once the program has given up
        elif lasts_s < LASTS_S:
            struck.stage.fail(None)

    return strike


ON_A_LINE = {"all dies": die(slice(None)), "plug pulled": begin("drop")}
NOT_OBEYED = ON_A_LINE | {
    "stop not obeyed": begin("ignores stop"),
    "two stops not obeyed": begin("ignores stops"),
}
FAULTS: dict[str, dict[str, Strike]] = {
    "ur": {
        "guard dies": die(slice(1, 2)),
        "scan and guard die": die(slice(0, 2)),
        "all dies": die(slice(0, 3)),
        "uplink stalls for 0.15 s": begin("uplink stalls", 0.15),
        "uplink stalls for 1 s": begin("uplink stalls", 1.0),
        "stopL not obeyed": begin("ignored stops"),
        "paused, then resumed": begin("paused"),
        "slider to 0": begin("slider at 0"),
    },
    "grbl": ON_A_LINE
    | {
        "0x85 not heard": begin("seven bits"),
        "0x85 and ! not obeyed": begin("ignores 0x85 and !"),
        "door for 3 s": begin("door", 3.0),
        "door for 1 s in a jog": begin("door while jogging", 1.0),
        "reports freeze": begin("frozen reports"),
    },
    "zaber": NOT_OBEYED,
    "pi": NOT_OBEYED,
    "tmcl": NOT_OBEYED,
}


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


@contextmanager
def emulated(device: str, phantom: Phantom) -> Iterator[tuple[Any, str]]:
    """The stage, and the rig file that finds it."""
    if device == "ur":
        with ur.emulate(phantom, at=HOST) as robot:
            yield robot, RIG.format(devices=ARM, approach="approach_mm_s = 2.0", ceiling_mm=50.0,
                                    silence="")  # fmt: skip
        return
    at = "socket://127.0.0.1:0"
    with (
        STAGES[device].emulate(phantom, at=at, homed=True) as stage,
        lines.emulate(phantom, at=at, rate_hz=200.0) as cell,
    ):
        devices = LINE.format(
            name=device, stage=stage.address, cell=cell.address, axes=axes_of(device)
        )
        yield stage, RIG.format(devices=devices, approach="", ceiling_mm=40.0,
                                silence="silence_s = 0.5")  # fmt: skip


def judge(device: str, fault: str, stiffness_n_mm: float) -> Row:
    """One scan that is struck; a busy machine may end one before."""
    for _ in range(TRIES):
        if (row := struck(device, fault, stiffness_n_mm)) is not None:
            return row
    raise RuntimeError(f"{device}: no scan pressed")


def struck(device: str, fault: str, stiffness_n_mm: float) -> Row | None:
    """What one scan did; None if it ended by itself before the fault."""
    clock, spring = WallClock(), Spring(stiffness_n_mm)
    phantom = Phantom(load_scene("TIHA"), clock, spring, home=(X_M, 0.0, 3e-3))

    def z_m() -> float:
        return phantom.tip.point(clock.now())[2]

    with tempfile.TemporaryDirectory() as folder, emulated(device, phantom) as (stage, text):
        rig = Path(folder) / "rig.toml"
        rig.write_text(text)
        command = [sys.executable, "-c", "from probe.cli import main; raise SystemExit(main())"]
        scan = subprocess.Popen(
            [*command, "scan", str(rig), "--out", folder], stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, cwd=ROOT,
        )  # fmt: skip
        family: list[int] = []
        while z_m() > -min(AT_M, AT_N / spring.n_m):
            time.sleep(0.001)
            if not family and z_m() < APPROACHES_M:
                family = children(scan.pid)
            if scan.poll() is not None:
                print(scan.communicate()[0], file=sys.stderr)
                return None
        struck_s, at_m = clock.now(), z_m()
        FAULTS[device][fault](Struck(scan, family, stage))
        said, _ = scan.communicate(timeout=LASTS_S)
        while device == "ur" and stage.robot.playing and clock.now() < struck_s + 10.0:
            time.sleep(0.01)
        while phantom.tip.moving(clock.now()):
            time.sleep(0.01)
        time.sleep(1.0)
        times_s = np.arange(struck_s, clock.now(), 1e-3)
        heights_m = np.array([phantom.tip.point(float(time_s))[2] for time_s in times_s])
        up = times_s[heights_m > UP_M]
        program = "" if device != "ur" else "runs" if stage.robot.playing else "ended"
        return {
            "at_mm": f"{-1e3 * at_m:.3f}",
            "deeper_mm": f"{1e3 * max(at_m - heights_m.min(), 0.0):.3f}",
            "most_n": f"{spring.n_m * max(-heights_m.min(), 0.0):.2f}",
            "rest_s": f"{times_s[heights_m.argmin()] - struck_s:.3f}",
            "up_s": f"{up[0] - struck_s:.2f}" if len(up) else "",
            "left_mm": f"{-1e3 * heights_m[-1]:.3f}",
            "program": program,
            "said": " / ".join(line for line in said.splitlines() if WORDS.match(line))[:400],
        }


def main(*devices: str) -> None:
    """Run what is not kept yet, of all devices unless some are named."""
    come_first()  # the emulated controller keeps its time
    jobs = [(d, fault, k) for d in devices or FAULTS for fault in FAULTS[d]
            for k in STIFFNESSES_N_MM]  # fmt: skip
    fill(KEPT, KEYS, ANSWERS, jobs, judge)


if __name__ == "__main__":
    run(main)
