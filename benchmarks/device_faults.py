"""Every device: the contract of drivers, a whole scan, and every fault in every phase of a station.

    python benchmarks/device_faults.py [DEVICE...] [--workers N] [--contract]

Real drivers against emulated devices in one phantom. One real-time scan of a press 1.5 mm deep for
each fault and phase; a stage is tried with a virtual sensor, a sensor with a virtual stage. The
table says how long after the fault the run ended and the tip was at rest; a probe that cannot be
lifted is tried for `PATIENCE_S`. Rows are kept in `KEPT`, so that a run that is broken off goes on
where it was; delete one to run it again. Exit status 1 if a scan without a fault did not complete,
or with one the tip rested later than `SOON_S`, the run completed in spite of a lasting fault, took
`PATIENCE_S` and `SOON_S` to end, lost its samples or named another device.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

from kept import ROOT, Row, fill, read
from makers_peers import RATE_HZ, START_MM, LslStream, StandaAxes, lsl_stream, standa_axes

from drivers import Sensor, Stage, WallClock
from drivers.core.registry import open_driver
from probe.config.rig import Rig, Safety, Scan
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import Event, Finish, Phase, PhaseEntered, Samples
from probe.guards.retreat import PATIENCE_S
from probe.scan.engine import run_scan
from sim_backend import load_scene
from sim_backend.emulators import (
    ft300,
    grbl,
    lines,
    modbus,
    netft,
    pi,
    taxels,
    tmcl,
    ur,
    zaber,
)  # fmt: skip
from sim_backend.models.station_response import respond
from sim_backend.phantom.devices import virtual_sensor, virtual_stage
from sim_backend.phantom.phantom import Phantom, Response
from sim_backend.scene.taxels import TaxelArray

KEPT = ROOT / "docs" / "results" / "device-faults.csv"
PHASES = (Phase.TRAVELLING, Phase.APPROACHING, Phase.INDENTING, Phase.HOLDING, Phase.RETRACTING)
AFTER_S = 0.05  # the fault comes this long after the phase began
SOON_S = 2.0
HOME = (0.020, 0.0, 0.003)
RIG = Rig(
    scan=Scan(start_mm=32.0, stations=1, indentation_mm=1.5, ramp_s=0.6, hold_s=0.5, settle_s=0.15),
    safety=Safety(retract_mm=3.0, silence_s=1.0),  # the emulator shares its interpreter
)
PLAN = plan_for(RIG)
LIMITS = replace(limits_for(RIG, PLAN), face_m2=1e-4)  # of 28 taxels
LINE = ("silence", "drop", "garbage", "late")
ROLES = {"stages": "stage", "sensors": "sensor"}
_hosts = count()
Emulate = Callable[[Phantom, Path], AbstractContextManager[Any]]


@dataclass(frozen=True)
class Device:
    """An emulated device, its faults, and the keys by which its driver finds it."""

    kind: str
    driver: str
    emulate: Emulate
    keys: Callable[[Any], dict[str, Any]]
    faults: tuple[str, ...]
    harmless: tuple[str, ...] = ()
    """Faults that a scan may outlive."""
    carry: Callable[[Any, Any], None] = lambda _served, _opened: None
    """Ties what was opened to the phantom, where the peer cannot by itself."""


def on_pty(module: Any, **keys: Any) -> Emulate:
    return lambda phantom, folder: module.emulate(phantom, at=str(folder / "tty"), **keys)


def own_host() -> str:
    """An address of this machine that no other scan takes: all controllers listen at one port."""
    high, low = divmod(os.getpid() % 2**16, 256)
    return f"127.{1 + next(_hosts) % 255}.{high}.{max(low, 1)}"


def axes(module: Any) -> Callable[[Any], dict[str, Any]]:
    return lambda served: {
        "port": served.address, "origin_mm": module.RIG_ORIGIN_MM, "max_speed_mm_s": 25.0,
        "silent_s": 1.0,  # the emulator shares this machine
        **module.RIG_AXES,
    }  # fmt: skip


def at_port(**keys: Any) -> Callable[[Any], dict[str, Any]]:
    return lambda served: {"port": served.address, **keys}


FORCE = {"name": "force", "unit": "N", "role": "force"}
DEVICES = {
    "ur": Device(
        "stages", "ur",
        lambda phantom, _: ur.emulate(phantom, at=own_host()),
        lambda served: {"host": served.address},
        ("protective stop", "emergency stop", "lost program", "silence", "drop", "blink", "garbage",
         "late"),
    ),
    "grbl": Device(
        "stages", "grbl", on_pty(grbl, homed=True), at_port(origin_mm=grbl.ORIGIN_MM),
        (*LINE, "alarm", "limit", "restart"),
    ),
    "zaber": Device(
        "stages", "zaber", on_pty(zaber, homed=True), axes(zaber),
        (*LINE, "bad crc", "stall", "driver off", "restart"), ("stall",),
    ),
    "pi": Device(
        "stages", "pi", on_pty(pi, homed=True), axes(pi), (*LINE, "motion error", "restart"),
    ),
    "tmcl": Device(
        "stages", "tmcl", on_pty(tmcl, homed=True), axes(tmcl),
        (*LINE, "bad crc", "limit switch", "restart"), ("limit switch",),
    ),
    "ft300": Device(
        "sensors", "ft300", on_pty(ft300, noise_n=0.02), at_port(), (*LINE, "bad crc", "saturate"),
    ),
    "modbus": Device(
        "sensors", "modbus", on_pty(modbus),
        at_port(register=[{**FORCE, "address": 100, "type": "int32", "scale": 0.001}]),
        (*LINE, "bad crc"),
    ),
    "netft": Device(
        "sensors", "netft", lambda phantom, _: netft.emulate(phantom, rdt_port=0, http_port=0),
        lambda box: {"host": box.host, "rdt_port": box.rdt_port, "http_port": box.http_port,
                     "silence_s": 0.5},  # the emulator shares this machine
        LINE,
    ),
    "lines": Device(
        "sensors", "lines", on_pty(lines),
        at_port(
            pattern="(?P<time>[0-9]+) (?P<force>[-+0-9.eE]+) N", channel=[FORCE], rate_hz=80.0,
            time_unit_s=0.001,
        ),
        (*LINE, "nan", "restart"), ("restart",),
    ),
    "taxels": Device(
        "sensors", "taxels", on_pty(taxels),
        at_port(rows=4, columns=7, header="AA55", rate_hz=100.0, counter=True,
                check="crc16-modbus", scale=10.0),
        (*LINE, "bad crc"),
    ),
    "standa": Device(
        "stages", "standa", standa_axes,
        lambda axes: {**axes.keys, "max_speed_mm_s": 25.0,
                      "origin_mm": (-START_MM["x"], 0.0, -START_MM["z"])},
        StandaAxes.faults, carry=lambda axes, stage: axes.carry(stage),
    ),
    "lsl": Device(
        "sensors", "lsl", lambda phantom, _: lsl_stream(phantom),
        lambda stream: {"stream": stream.name, "rate_hz": RATE_HZ, "channel": [FORCE]},
        LslStream.faults, ("bunches",),
    ),
}  # fmt: skip
ELSEWHERE = {
    ("stages", "virtual"): "the phantom itself: it has no line and no faults of its own",
    ("sensors", "virtual"): "the phantom itself; `benchmarks/campaign` breaks what it reads",
    ("sensors", "ur"): "its readings come with the arm's states: the faults are those of `ur`",
}
"""Registered drivers without rows, and why."""


@dataclass
class Outcome:
    """What a fault (or none) did to a scan; times in seconds after the fault."""

    device: str
    fault: str
    phase: str
    ended_s: float
    rest_s: float
    finish: str
    reason: str
    samples: int
    deepest_mm: float

    @property
    def as_row(self) -> Row:
        """As `KEPT` has it."""
        times = {"ended_s": f"{self.ended_s:.3f}", "rest_s": f"{self.rest_s:.3f}"}
        found = {name: getattr(self, name) for name in ("finish", "reason", "samples")}
        return times | found | {"deepest_mm": f"{self.deepest_mm:.3f}"}

    @property
    def wrong(self) -> bool:
        completed = self.finish == Finish.COMPLETED
        if not self.fault:
            return not completed or abs(self.deepest_mm - 1.5) > 0.01
        over = self.phase == Phase.RETRACTING or self.fault in DEVICES[self.device].harmless
        named = self.finish == Finish.FAULTED and self.device in self.reason
        if completed:
            return not over
        late = self.rest_s > SOON_S or self.ended_s > PATIENCE_S + SOON_S
        return late or self.samples == 0 or not named


def outcomes() -> dict[tuple[str, ...], Outcome]:
    """The rows of `KEPT`."""
    found = {}
    for row in read(KEPT):
        key = (row["device"], row["fault"], row["phase"])
        found[key] = Outcome(
            *key, float(row["ended_s"]), float(row["rest_s"]), row["finish"], row["reason"],
            int(row["samples"]), float(row["deepest_mm"]),
        )  # fmt: skip
    return found


@cache
def solved(array: TaxelArray | None = None) -> Response:
    """The one station's section."""
    return respond(load_scene("TIHA"), 0.032, 3e-3, array)


def strike(name: str, fault: str, phase: str) -> Outcome:
    """One scan."""
    device, clock = DEVICES[name], WallClock()
    phantom = Phantom(load_scene("TIHA"), clock, lambda *_, array=None: solved(array), home=HOME)
    phantom.prepare([(0.032, 0.0)])
    struck: list[float] = []
    events: list[Event] = []
    with tempfile.TemporaryDirectory() as folder, device.emulate(phantom, Path(folder)) as served:

        def fail() -> None:
            struck.append(clock.now())
            served.fail(fault)

        def sink(event: Event) -> None:
            events.append(event)
            if isinstance(event, PhaseEntered) and event.phase == phase and fault and not struck:
                threading.Timer(AFTER_S, fail).start()

        opened: Any = open_driver(device.kind, device.driver, clock, device.keys(served))  # type: ignore[arg-type]
        device.carry(served, opened)
        stage: Stage = opened if device.kind == "stages" else virtual_stage(clock, phantom=phantom)
        sensor: Sensor = (
            opened if device.kind == "sensors" else virtual_sensor(clock, phantom=phantom)
        )
        with closing(opened):
            ended = run_scan(PLAN, stage, [sensor], clock, sink, LIMITS)
            ended_s = clock.now()
            while phantom.tip.moving(clock.now()):
                time.sleep(0.01)
        if not struck:  # it ended before the fault: never counts as right
            struck.append(-100.0 if fault else ended_s)
        legs = phantom.tip.all_legs()
        return Outcome(
            name, fault, phase, ended_s - struck[0], max(legs[-1].end_s - struck[0], 0.0),
            ended.finish, ended.reason, sum(isinstance(e, Samples) for e in events),
            -1e3 * min(leg.point(float("inf"))[2] for leg in legs),
        )  # fmt: skip


def judge(*job: str) -> Row:
    """One scan's row."""
    return strike(*job).as_row


def contract(name: str) -> str:
    """The outcome of the contract's tests, in pytest's words."""
    tests = "tests/drivers/testing/test_contract.py"
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", tests, "-k", name],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return ran.stdout.strip().splitlines()[-1]


def table(outcomes: list[Outcome], contracts: dict[str, str]) -> str:
    """One row per fault, one cell per phase: seconds until the run ended / the tip was at rest."""
    lines = ["| device | fault | " + " | ".join(PHASES) + " | reason |", "|---" * 8 + "|"]
    by = {(o.device, o.fault, o.phase): o for o in outcomes}
    for name in dict.fromkeys(o.device for o in outcomes):
        whole = by.get((name, "", ""))
        if whole is not None:
            said = "WRONG: " + whole.reason if whole.wrong else "completed"
            lines.append(f"| {name} | none: {said} | | | | | | {contracts.get(name, '')} |")
        for fault in dict.fromkeys(o.fault for o in outcomes if o.device == name and o.fault):
            found = [by.get((name, fault, phase)) for phase in PHASES]
            cells = [
                ""
                if o is None
                else f"{o.ended_s:.2f} / {o.rest_s:.2f}"
                + ("" if o.finish == Finish.FAULTED else f" ({o.finish})")
                + (" WRONG" if o.wrong else "")
                for o in found
            ]
            reason = next((o.reason for o in found if o is not None and o.reason), "")
            lines.append(f"| {name} | {fault} | {' | '.join(cells)} | {reason} |")
    return "\n".join(lines)


def main() -> int:
    """Run what is not kept yet, print the table; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("devices", nargs="*", default=list(DEVICES), metavar="DEVICE")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--contract", action="store_true", help="run the contract's tests too")
    given = parser.parse_args()
    jobs = [(n, "", "") for n in given.devices]
    jobs += [(n, f, str(p)) for n in given.devices for f in DEVICES[n].faults for p in PHASES]
    for array in (None, TaxelArray(4, 7)):  # once, for all that are forked from here
        solved(array)
    fill(KEPT, ("device", "fault", "phase"),
         ("ended_s", "rest_s", "finish", "reason", "samples", "deepest_mm"), jobs, judge,
         given.workers)  # fmt: skip
    have = outcomes()
    done = [have[job] for job in jobs]
    print(table(done, {n: contract(n) for n in given.devices} if given.contract else {}))
    wrong = [o for o in done if o.wrong]
    faults = [o.ended_s for o in done if o.fault]
    print(f"\n{len(done)} scans, {len(wrong)} wrong; ended at most {max(faults):.2f} s after "
          "the fault")  # fmt: skip
    for one in wrong:
        print(one)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
