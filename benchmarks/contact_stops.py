"""How far a UR's search for the surface goes beyond the touch force, by who ends it.

    python benchmarks/contact_stops.py

Real-time scans of one press on an emulated UR in a process of its own, over springs. ``sensor``:
the scan's stop at `TOUCH_N` alone, as ever; ``controller X``: besides it the controller's contact
detection, whose threshold, which nobody can set on a real arm, is X N here. ``stopped``: the
process of scan and guards stands still for `STOPPED_S` from nine tenths of the touch force on, less
than the robot's watchdog waits. Rows are kept in `KEPT`; delete one to run it again.
"""

import math
import os
import signal
import sys
import time
from itertools import pairwise
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import NamedTuple

import numpy as np
from kept import ROOT, Row, fill, read

from drivers import WallClock
from drivers.core.arrays import Array
from drivers.ur.sensor import open_sensor
from drivers.ur.settings import UrSensorSettings, UrStageSettings
from drivers.ur.stage import open_stage
from probe.core.events import Finish
from probe.guards.guard_threads import come_first
from probe.planning.limits import Limits
from probe.planning.plan import Place, Plan
from probe.scan import engine, touching
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.phantom.phantom import Phantom
from sim_backend.phantom.trajectory import Leg

KEPT = ROOT / "docs" / "results" / "contact-stops.csv"
KEYS = ("way", "speed_mm_s", "stiffness_n_mm", "stopped")
ANSWERS = ("beyond_n", "beyond_mm", "to_rest_ms", "press_from_mm", "finish", "load")
WAYS = ("sensor", "controller 1.5")
SPEEDS_MM_S, STIFFNESSES_N_MM = (1.0, 2.0, 4.0), (1.0, 10.0)
TOUCH_N, STOPPED_S, STOPPED_FROM = 1.0, 0.15, 0.9
HOST, HOME = "127.77.0.1", (0.03, 0.0, 0.003)
TRIES = 5
REST_S = 0.015  # a way back begins at once, a press once the tip was seen at rest for 0.02 s
PLAN = Plan(
    places=(Place(0, 0.03, 0.0),), indentation_m=0.6e-3, ramp_s=0.4, hold_s=0.2,
    clearance_m=2e-3, travel_m_s=0.02, approach_m_s=0.01, touch_n=TOUCH_N, search_m=4e-3,
)  # fmt: skip
LIMITS = Limits(  # so wide that only the stops act
    20.0, 6e-3, ((-0.01, 0.07), (-0.01, 0.01), (-0.01, 0.05)), 0.03,
    silence_s=2.0, late_s=2.0, hardest_n_m=1e4,
)  # fmt: skip


class Spring(NamedTuple):
    """What lies under the probe."""

    stiffness_n_m: float

    def force_n(self, _x_m: float, depth_m: Array, pressure_pa: Array) -> Array:
        return np.asarray(self.stiffness_n_m * np.maximum(depth_m, 0.0) + 0.0 * pressure_pa)

    def von_mises_pa(self, x_m: float, depth_m: Array, pressure_pa: Array) -> Array:
        return self.force_n(x_m, depth_m, pressure_pa) / 1e-4


def serve(line: Connection, stiffness_n_m: float, contact_n: float) -> None:
    """The robot and the truth; stops the scan's process, if given its number."""
    come_first()
    spring = Spring(stiffness_n_m)
    phantom = Phantom(load_scene("TI"), WallClock(), lambda *_: spring, home=HOME)
    with ur.emulate(phantom, at=HOST, noise_n=0.001, contact_n=contact_n):
        line.send("ready")
        whom = line.recv()
        while whom and not line.poll():
            depth_m = -phantom.tip.point(phantom.clock.now())[2]
            if stiffness_n_m * depth_m >= STOPPED_FROM * TOUCH_N:
                os.kill(whom, signal.SIGSTOP)
                time.sleep(STOPPED_S)
                os.kill(whom, signal.SIGCONT)
                break
            time.sleep(0.5e-3)
        line.recv()
        line.send(phantom.tip.all_legs())


def scan(line: Connection, contact: str, speed_m_s: float) -> None:
    """One press; how it ended."""
    touching.TOUCH_M_S = speed_m_s
    clock = WallClock()
    stage = open_stage(clock, UrStageSettings(
        host=HOST, contact=contact, watchdog_s=0.4, stop_s=1.0, silence_s=2.0, answer_s=2.0,
    ))  # fmt: skip
    sensor = open_sensor(clock, UrSensorSettings(host=HOST, silence_s=2.0))
    line.recv()
    ended = engine.run_scan(PLAN, stage, [sensor], clock, lambda _event: None, LIMITS)
    line.send(ended.finish)
    sensor.close()
    stage.close()


def judge(way: str, speed_mm_s: float, stiffness_n_mm: float, stopped: str) -> Row:
    """`one`, again where a guard ended it before the touch force, as on a busy machine."""
    for _ in range(TRIES):
        row = one(way, speed_mm_s, stiffness_n_mm, stopped)
        if row is not None:
            return row
    raise RuntimeError(f"{TRIES} scans ended before the touch force was reached")


def one(way: str, speed_mm_s: float, stiffness_n_mm: float, stopped: str) -> Row | None:
    """One scan's row: beyond `TOUCH_N` until the tip first rested, and where the press began; None
    if it ended before."""
    contact, _, threshold_n = way.partition(" ")
    contact_n = float(threshold_n or math.inf)
    context = get_context("fork")
    ours, theirs = context.Pipe()
    ours_too, theirs_too = context.Pipe()
    robot = context.Process(target=serve, args=(theirs, 1e3 * stiffness_n_mm, contact_n))
    client = context.Process(target=scan, args=(theirs_too, contact, 1e-3 * speed_mm_s))
    robot.start()
    client.start()
    assert ours.recv() == "ready"
    ours.send(client.pid if stopped else 0)
    ours_too.send("go")
    finish = ours_too.recv()
    ours.send("end")
    legs = ours.recv()
    client.join(10)
    robot.join(10)
    found = search(legs, 1e-3 * TOUCH_N / stiffness_n_mm)
    if found is None:
        return None
    touch_s, rest_s, deepest_m, from_m = found
    beyond_mm = 1e3 * deepest_m - TOUCH_N / stiffness_n_mm
    return {
        "beyond_n": f"{stiffness_n_mm * beyond_mm:.3f}",
        "beyond_mm": f"{beyond_mm:.4f}",
        "to_rest_ms": f"{1e3 * (rest_s - touch_s):.1f}",
        "press_from_mm": f"{1e3 * from_m:.4f}",
        "finish": finish,
        "load": f"{os.getloadavg()[0]:.1f}",
    }


def search(legs: tuple[Leg, ...], touch_m: float) -> tuple[float, float, float, float] | None:
    """When the touch force was reached and the tip then rested; its depths then and in the end."""
    first = next((
        n for n, leg in enumerate(legs)
        if math.isclose(leg.origin[2], touching.TOUCH_GAP_M, abs_tol=1e-6) and leg.direction[2] < 0
    ), None)  # fmt: skip
    if first is None:
        return None
    part = [legs[first]]
    for last, leg in pairwise(legs[first:]):
        if leg.start_s > last.end_s + REST_S:
            break
        part.append(leg)
    down = [leg for leg in part if leg.direction[2] < 0]
    rest_s = down[-1].end_s
    times_s = np.arange(part[0].start_s, rest_s, 0.1e-3)
    ends_s = [*(leg.start_s for leg in down[1:]), math.inf]
    depths = np.concatenate([
        -leg.points(times_s[(times_s >= leg.start_s) & (times_s < end_s)])[:, 2]
        for leg, end_s in zip(down, ends_s, strict=True)
    ])  # fmt: skip
    if depths.max() < touch_m:
        return None
    touch_s = float(times_s[np.argmax(depths >= touch_m)])
    return touch_s, rest_s, -down[-1].point(math.inf)[2], -part[-1].point(math.inf)[2]


def main() -> int:
    """Run what is not kept yet, print the table."""
    jobs = [
        (way, speed, stiffness, stopped)
        for way in WAYS for speed in SPEEDS_MM_S for stiffness in STIFFNESSES_N_MM
        for stopped in ("", "stopped")
    ]  # fmt: skip
    fill(KEPT, KEYS, ANSWERS, jobs, judge)
    print("| ended by | mm/s | N/mm | beyond 1 N: N | mm | ms to rest | stopped: N | mm | ms |")
    print("|---" * 9 + "|")
    rows = {tuple(row[key] for key in KEYS): row for row in read(KEPT)}
    for way, speed, stiffness in dict.fromkeys(job[:3] for job in jobs):
        cells = [way, f"{speed:g}", f"{stiffness:g}"]
        for stopped in ("", "stopped"):
            row = rows[(way, str(speed), str(stiffness), stopped)]
            faulted = "" if row["finish"] == Finish.COMPLETED else " (faulted)"
            cells += [f"{float(row['beyond_n']):.2f}", f"{float(row['beyond_mm']):.3f}",
                      f"{float(row['to_rest_ms']):.0f}{faulted}"]  # fmt: skip
        print("| " + " | ".join(cells) + " |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
