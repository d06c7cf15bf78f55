"""Every fault of an emulated UR controller, at connection and in every phase of a station.

    python benchmarks/ur_faults.py [WORKERS]

One real-time scan of a press for each: the real ur-rtde client, the finite-element phantom. A
cell says how long after the fault the run ended and the tip was at rest. Exit status 1 if a run
took more than 2 s to end, completed in spite of the fault, or lost its samples.
"""

import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count

from serial_faults import AFTER_S, HOME, LIMITS, PHASES, PLAN, SOON_S, Outcome, table

from drivers import DeviceFault, WallClock
from drivers.ur.sensor import open_sensor
from drivers.ur.settings import UrSensorSettings, UrStageSettings
from drivers.ur.stage import open_stage
from probe.acquisition.engine import run_scan
from probe.core.events import Event, Phase, PhaseEntered, Samples
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.models.station_response import respond
from sim_backend.phantom.phantom import Phantom

FAULTS = ("protective stop", "emergency stop", "lost program", "silence", "drop", "blink",
          "garbage", "late")  # fmt: skip
AT_CONNECTION = ("refused", "mute", "no start", "emergency stop", "drop")
_hosts = count(2)


def host() -> str:
    """An address of its own for each controller."""
    return f"127.0.1.{next(_hosts)}"


def phantom_of(clock: WallClock) -> Phantom:
    """Solved where the press will be."""
    phantom = Phantom(load_scene("TIHA"), clock, respond, home=HOME)
    phantom.prepare([(0.032, 0.0)])
    return phantom


def strike(fault: str, phase: Phase) -> Outcome:
    """One scan."""
    clock = WallClock()
    phantom = phantom_of(clock)
    struck: list[float] = []
    events: list[Event] = []
    with ur.emulate(phantom, at=host()) as robot:

        def fail() -> None:
            struck.append(clock.now())
            robot.fail(fault)

        def sink(event: Event) -> None:
            events.append(event)
            if isinstance(event, PhaseEntered) and event.phase is phase and not struck:
                threading.Timer(AFTER_S, fail).start()

        stage = open_stage(clock, UrStageSettings(host=robot.address))
        sensor = open_sensor(clock, UrSensorSettings(host=robot.address))
        try:
            stage.connect()
            sensor.connect()
            ended = run_scan(PLAN, stage, [sensor], clock, sink, LIMITS)
            ended_s = clock.now()
        finally:
            stage.close()
            sensor.close()
        while phantom.tip.moving(clock.now()):
            time.sleep(0.01)
        if not struck:  # it ended before the fault: never counts as right
            struck.append(-100.0)
        rest_s = phantom.tip.all_legs()[-1].end_s
        return Outcome(
            "ur", fault, phase, ended_s - struck[0], max(rest_s - struck[0], 0.0),
            ended.finish, ended.reason, sum(isinstance(e, Samples) for e in events),
            phantom.tip.point(clock.now())[2] > 0,
        )  # fmt: skip


def connect(fault: str) -> tuple[float, str]:
    """Seconds until the driver gives up connecting, and its reason."""
    clock = WallClock()
    address = host()
    stage = open_stage(clock, UrStageSettings(host=address))
    began = time.monotonic()

    def attempt() -> tuple[float, str]:
        try:
            stage.connect()
        except DeviceFault as found:
            return time.monotonic() - began, str(found)
        finally:
            stage.close()
        return time.monotonic() - began, "CONNECTED"

    if fault == "refused":
        return attempt()
    with ur.emulate(phantom_of(clock), at=address) as robot:
        robot.fail(fault)
        return attempt()


def main(workers: int) -> int:
    """Run all, print the tables; the exit status."""
    print("| at connection | gives up after | reason |\n|---|---|---|")
    refused = [(fault, *connect(fault)) for fault in AT_CONNECTION]
    for fault, took_s, reason in refused:
        print(f"| {fault} | {took_s:.2f} s | {reason} |")
    jobs = [(fault, phase) for fault in FAULTS for phase in PHASES]
    with ThreadPoolExecutor(workers) as pool:
        outcomes = list(pool.map(lambda job: strike(*job), jobs))
    print("\n" + table(outcomes, {"ur": FAULTS}))
    wrong = [o for o in outcomes if o.wrong]
    longest_s = max(o.ended_s for o in outcomes)
    print(f"\n{len(outcomes)} scans, {len(wrong)} wrong")
    print(f"ended at most {longest_s:.2f} s after the fault (allowed: {SOON_S:g})")
    for one in wrong:
        print(one)
    return 1 if wrong or any(reason == "CONNECTED" for *_, reason in refused) else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1))
