"""Every fault of an emulated GRBL board and FT-300, in every phase of a station.

    python benchmarks/serial_faults.py [WORKERS]

One real-time scan of a press 1.5 mm deep for each: the real driver over a pty, one phantom behind
both devices. The table says how long after the fault the run ended and the tip was at rest, and
whether the reason names the device. About two minutes with three workers. Exit status 1 if a run
took more than 2 s to end, completed in spite of a lasting fault, or lost its samples.
"""

import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from drivers import WallClock, ft300, grbl
from probe.acquisition.engine import run_scan
from probe.config.rig import Rig, Safety, Scan
from probe.config.scan_plan import limits_for, plan_for
from probe.core.events import Event, Finish, Phase, PhaseEntered, Samples
from sim_backend import load_scene
from sim_backend.emulators import ft300 as ft300_device
from sim_backend.emulators import grbl as grbl_device
from sim_backend.models.station_response import respond
from sim_backend.phantom.phantom import Phantom

FAULTS = {
    "grbl": ("silence", "drop", "garbage", "late", "alarm", "limit", "restart"),
    "ft300": ("silence", "drop", "garbage", "bad crc", "late", "saturate"),
}
PHASES = (Phase.TRAVELLING, Phase.APPROACHING, Phase.INDENTING, Phase.HOLDING, Phase.RETRACTING)
AFTER_S = 0.05  # the fault comes this long after the phase began
SOON_S = 2.0
HOME = (0.020, 0.0, 0.003)
RIG = Rig(
    scan=Scan(start_mm=32.0, stations=1, indentation_mm=1.5, ramp_s=0.6, hold_s=0.5, settle_s=0.15),
    safety=Safety(retract_mm=3.0),
)
PLAN = plan_for(RIG)
LIMITS = limits_for(RIG, PLAN)


@dataclass
class Outcome:
    """What a fault did to a scan; times in seconds after the fault."""

    device: str
    fault: str
    phase: Phase
    ended_s: float
    rest_s: float
    finish: Finish
    reason: str
    samples: int
    up: bool

    @property
    def wrong(self) -> bool:
        harmless = self.phase is Phase.RETRACTING and self.finish is Finish.COMPLETED
        told = self.finish is Finish.FAULTED and self.device in self.reason
        return self.ended_s > SOON_S or self.samples == 0 or not (told or harmless)


def strike(device: str, fault: str, phase: Phase) -> Outcome:
    """One scan."""
    clock = WallClock()
    phantom = Phantom(load_scene("TIHA"), clock, respond, home=HOME)
    phantom.prepare([(0.032, 0.0)])
    struck: list[float] = []
    events: list[Event] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        grbl_device.emulate(phantom, at=str(Path(folder, "grbl")), homed=True) as board,
        ft300_device.emulate(phantom, at=str(Path(folder, "ft300")), noise_n=0.02) as cell,
    ):
        served = {"grbl": board, "ft300": cell}[device]

        def fail() -> None:
            struck.append(clock.now())
            served.fail(fault)

        def sink(event: Event) -> None:
            events.append(event)
            if isinstance(event, PhaseEntered) and event.phase is phase and not struck:
                threading.Timer(AFTER_S, fail).start()

        stage = grbl.open_stage(
            clock, grbl.GrblSettings(port=board.address, origin_mm=grbl_device.ORIGIN_MM)
        )
        sensor = ft300.open_sensor(clock, ft300.Ft300Settings(port=cell.address))
        try:
            stage.connect()
            sensor.connect()
            ended = run_scan(PLAN, stage, [sensor], clock, sink, LIMITS)
        finally:
            stage.close()
            sensor.close()
        ended_s = clock.now()
        while phantom.tip.moving(clock.now()):
            time.sleep(0.01)
        if not struck:  # it ended before the fault: never counts as right
            struck.append(-100.0)
        rest_s = phantom.tip.all_legs()[-1].end_s
        return Outcome(
            device, fault, phase, ended_s - struck[0], max(rest_s - struck[0], 0.0),
            ended.finish, ended.reason, sum(isinstance(e, Samples) for e in events),
            phantom.tip.point(clock.now())[2] > 0,
        )  # fmt: skip


def table(outcomes: list[Outcome], faults_of: Mapping[str, tuple[str, ...]] = FAULTS) -> str:
    """One row per fault, one cell per phase: seconds until the run ended / the tip was at rest."""
    lines = [
        "| device | fault | " + " | ".join(PHASES) + " | reason |",
        "|---" * (len(PHASES) + 3) + "|",
    ]
    for device, faults in faults_of.items():
        for fault in faults:
            found = {o.phase: o for o in outcomes if (o.device, o.fault) == (device, fault)}
            cells = [
                f"{o.ended_s:.2f} / {o.rest_s:.2f} {'up' if o.up else 'down'}"
                + ("" if o.finish is Finish.FAULTED else f" ({o.finish})")
                + (" WRONG" if o.wrong else "")
                for o in (found[phase] for phase in PHASES)
            ]
            reason = found[Phase.INDENTING].reason
            lines.append(f"| {device} | {fault} | {' | '.join(cells)} | {reason} |")
    return "\n".join(lines)


def main(workers: int) -> int:
    """Run all, print the table; the exit status."""
    jobs = [(d, f, p) for d, faults in FAULTS.items() for f in faults for p in PHASES]
    with ThreadPoolExecutor(workers) as pool:
        outcomes = list(pool.map(lambda job: strike(*job), jobs))
    print(table(outcomes))
    wrong = [o for o in outcomes if o.wrong]
    print(f"\n{len(outcomes)} scans, {len(wrong)} wrong; ended at most "
          f"{max(o.ended_s for o in outcomes):.2f} s after the fault")  # fmt: skip
    for one in wrong:
        print(one)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 3))
