"""Fault campaign: random faults at random instants, each run checked against the true world.

    python benchmarks/faults.py [RUNS] [FIRST_SEED]

Every run scans five stations around an artery on the simulated clock; one fault strikes at a
random instant. What is checked does not come from the guards but from the phantom: the true depth
and force at every millisecond. A force guard may be exceeded only by the physics of stopping:

    k (2 v / rate + v^2 / 2a) + 5 sigma

(two samples at the speed v of contact, the way to rest at acceleration a, the sensor's noise),
with k the stiffest thing met. Depth likewise, plus the guard's slack for a jittering pose.
"""

import errno
import sys
import threading
import time
from collections import Counter, defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers import SimulatedClock
from probe.control import Control
from probe.devices import connect
from probe.engine import run_scan
from probe.events import Event, Finish, Phase, PhaseEntered, RunEnded, Samples, StationEnded
from probe.guards import POSE_SLACK_M
from probe.rig import Rig
from sim_backend.faults import SENSOR_FAULTS, STAGE_FAULTS, FaultySensor, FaultyStage
from sim_backend.phantom import Phantom, Respond
from sim_backend.scene import Scene, load_scene

Array = NDArray[np.float64]

USER_FAULTS = ("abort", "stop", "ctrl-c storm", "pause storm")
WORLD_FAULTS = ("hard lump", "surface higher", "physics fails")
HOUSE_FAULTS = ("disk full", "observer fails")
KINDS = STAGE_FAULTS + SENSOR_FAULTS + USER_FAULTS + WORLD_FAULTS + HOUSE_FAULTS

STIFFNESS_N_M, HARD = 400.0, 30.0
SENSOR_RATE_HZ, NOISE_N, ACCELERATION = 500.0, 0.5e-3, 1.0
RIG = Rig.model_validate(
    {
        "scan": {"start_mm": 24, "stations": 5},
        "safety": {"max_force_n": 1.6, "max_depth_mm": 3.0},
    }
)


@dataclass(frozen=True)
class Bed:
    """Springs with a vessel, the analytic answer of the campaign: F = k d (1 + c p)."""

    stiffness_n_m: float

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        """Normal force [N], 0 in the air."""
        force: Array = self.stiffness_n_m * np.maximum(depth_m, 0.0) * (1 + 3e-6 * pressure_pa)
        return force

    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array:
        """The force on 1 cm2."""
        return self.force_n(depth_m, pressure_pa) / 1e-4


@dataclass(frozen=True)
class Outcome:
    """One run: what struck when, how it ended, and what was wrong (empty: nothing)."""

    kind: str
    at_s: float
    finish: str
    stations: int
    force_n: float
    depth_m: float
    seconds: float
    wrong: tuple[str, ...]


def run_one(seed: int, kind: str | None = None) -> Outcome:
    """One scan struck by one fault, resumed until complete; all drawn from the seed."""
    rng = np.random.default_rng(seed)
    kind = kind or str(rng.choice(KINDS))
    at_s = float(rng.uniform(0.0, 13.0))
    began = time.perf_counter()
    ended, events, phantom = _scan(kind, at_s, seed, {}, set())
    struck_s = time.perf_counter() - began
    t = np.arange(0.0, ended.time_s + 0.1, 1e-3)
    force_n, depth_m = _truth(phantom, kind, t)
    wrong = _check(kind, ended, events, float(force_n), float(depth_m))
    complete = {e.station for e in events if isinstance(e, StationEnded) and e.complete}
    attempts = dict(Counter(e.station for e in events if isinstance(e, StationEnded)))
    resumed, after, _ = _scan("none", 0.0, seed, attempts, complete)
    again = {e.station for e in after if isinstance(e, StationEnded) and e.complete}
    if resumed.finish is not Finish.COMPLETED or complete | again != set(range(5)):
        wrong.append(f"not resumable: {resumed.reason}")
    if complete & again:
        wrong.append(f"stations {complete & again} pressed twice")
    if struck_s > 5.0:
        wrong.append(f"took {struck_s:.1f} s")
    return Outcome(
        kind, at_s, ended.finish, len(complete), float(force_n), float(depth_m), struck_s,
        tuple(wrong),
    )  # fmt: skip


def _scan(
    kind: str, at_s: float, seed: int, attempts: dict[int, int], completed: set[int]
) -> tuple[RunEnded, list[Event], Phantom]:
    clock, control = SimulatedClock(), Control()
    opened = connect(RIG, clock, load_scene("TIHA"), seed=seed, respond=_respond(kind, at_s, clock))
    assert opened.phantom is not None
    if kind == "surface higher":
        opened.phantom.surface = lambda x, _y: 1.2e-3 if x > 27e-3 else 0.0
    stage = FaultyStage(opened.stage, clock, kind, at_s)
    sensors = [FaultySensor(s, clock, kind, at_s) for s in opened.sensors]
    events: list[Event] = []

    def sink(event: Event) -> None:
        struck = clock.now() >= at_s
        if kind == "disk full" and struck:
            raise OSError(errno.ENOSPC, "No space left on device")
        events.append(event)
        if struck and isinstance(event, Samples | PhaseEntered):
            _wish(kind, control, event)

    def observer(_event: Event) -> None:
        if kind == "observer fails" and clock.now() >= at_s:
            raise RuntimeError("window closed")

    try:
        with opened:
            ended = run_scan(
                RIG.plan, stage, sensors, clock, sink, RIG.limits, control=control,
                observers=[observer], attempts=attempts, completed=completed,
            )  # fmt: skip
    except ArithmeticError as error:
        ended = RunEnded(clock.now(), Finish.FAULTED, str(error))
    return ended, events, opened.phantom


def _respond(kind: str, at_s: float, clock: SimulatedClock) -> Respond:
    def respond(_scene: Scene, x_m: float, _depth_m: float) -> Bed:
        if kind == "physics fails" and clock.now() >= at_s:
            raise ArithmeticError("the section could not be solved")
        hard = kind == "hard lump" and x_m > 27e-3
        return Bed(STIFFNESS_N_M * (HARD if hard else 1.0))

    return respond


def _wish(kind: str, control: Control, event: Event) -> None:
    """What an impatient person does."""
    if kind in ("abort", "ctrl-c storm"):
        control.abort()
    if kind in ("stop", "ctrl-c storm"):
        control.stop()
    if kind == "pause storm" and isinstance(event, PhaseEntered):
        if event.phase is Phase.PAUSED:
            threading.Timer(0.005, control.resume).start()
        elif event.station is not None and event.station % 2 and event.phase is Phase.HOLDING:
            control.pause(now=len(_storm) % 2 == 0)
            _storm.append(event.station)


_storm: list[int] = []


def _truth(phantom: Phantom, kind: str, t: Array) -> tuple[float, float]:
    """Greatest true force, and depth below the planned surface, whatever the sensor said."""
    if kind == "physics fails":
        return 0.0, float(-min(leg.points(t[s])[:, 2].min() for leg, _, s in phantom.tip.legs(t)))
    depth = -min(float(leg.points(t[span])[:, 2].min()) for leg, _, span in phantom.tip.legs(t))
    return float(phantom.force_n(t).max()), depth


def _check(
    kind: str, ended: RunEnded, events: list[Event], force_n: float, depth_m: float
) -> list[str]:
    wrong = []
    scan, limits = RIG.scan, RIG.limits
    speed = 1e-3 * (scan.approach_mm_s if kind == "surface higher" else 2.5)
    over_m = 2 * speed / SENSOR_RATE_HZ + speed**2 / (2 * ACCELERATION)
    stiffness = STIFFNESS_N_M * 1.05 * (HARD if kind == "hard lump" else 1.0)
    if force_n > limits.max_force_n + stiffness * over_m + 5 * NOISE_N:
        wrong.append(f"force {force_n:.3f} N")
    if depth_m > limits.max_depth_m + POSE_SLACK_M + over_m:
        wrong.append(f"depth {1e3 * depth_m:.3f} mm")
    if kind != "disk full" and (not events or events[-1] is not ended) and kind != "physics fails":
        wrong.append("the last event is not the run's end")
    last: dict[str, float] = defaultdict(lambda: -1.0)
    for event in events:
        if isinstance(event, Samples) and not kind.startswith("sensor clock"):
            times = [last[event.device], *event.block.time_s.tolist()]
            if any(b <= a for a, b in pairwise(times)):
                wrong.append(f"{event.device}: samples twice or out of order")
            last[event.device] = times[-1]
    return wrong


def main() -> None:
    """Run the campaign and print one row per kind of fault; exit status 1 if any run was wrong."""
    runs, first = (int(a) for a in (*sys.argv[1:], *("500", "1")[len(sys.argv) - 1 :]))
    rows: dict[str, list[Outcome]] = defaultdict(list)
    failures = []
    for seed in range(first, first + runs):
        one = run_one(seed)
        rows[one.kind].append(one)
        failures += [f"seed {seed}: {one.kind} at {one.at_s:.3f} s: {w}" for w in one.wrong]
    print(f"{runs} runs, seeds {first} to {first + runs - 1}; limits 1.6 N, 3 mm")
    print(
        "| fault | runs | completed | aborted | faulted | max force N | max depth mm | slowest s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for kind in KINDS:
        if found := rows[kind]:
            ends = Counter(o.finish for o in found)
            print(
                f"| {kind} | {len(found)} | {ends['completed']} | {ends['aborted']} | "
                f"{ends['faulted']} | {max(o.force_n for o in found):.3f} | "
                f"{max(1e3 * o.depth_m for o in found):.3f} | {max(o.seconds for o in found):.2f} |"
            )
    print(*failures, f"{len(failures)} violations", sep="\n")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
