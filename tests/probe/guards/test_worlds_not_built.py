"""Devices that misbehave in ways the guards were not written for, on the wall clock.

The bed of springs shares nothing with the phantom, and what is judged is its true force and the
tip's true place.
"""

import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable

import numpy as np
import pytest
from paths import ROOT
from springs import (
    HARD_N_M,
    LIMIT_N,
    SLOW,
    Bed,
    SpringSensor,
    SpringStage,
    on_simulated_springs,
    on_springs,
    run_springs,
    spring_rig,
)

from drivers import Block, DeviceFault, Pose
from probe.core.events import Event, Phase, PhaseEntered, Samples, StationEnded

APPROACH_M_S = 10e-3


def empty(channels: int = 1) -> Block:
    return Block(np.empty(0), np.empty((0, channels)), np.empty((0, channels), bool))


class Below(SpringSensor):
    """Once the tip is below ``at_m``, what it reads becomes what ``then`` makes of it."""

    def __init__(self, bed: Bed, at_m: float, then: Callable[[Block], Block]) -> None:
        super().__init__(bed)
        self.at_m, self.then = at_m, then

    def read(self) -> Block:
        block = super().read()
        below = self.bed.tip.point(self.bed.clock.now())[2] < self.at_m
        return self.then(block) if below else block


def hang(block: Block) -> Block:
    time.sleep(8)
    return block


def test_a_force_sensor_that_falls_silent_in_the_hold_ends_it() -> None:
    bed, stage, _ = on_springs()
    silent = Below(bed, -2.49e-3, lambda _block: empty())
    ran = run_springs(bed, stage, [silent], rig=spring_rig(scan={"hold_s": 3.0}))
    assert "cell: silent for 0." in ran.reason
    assert ran.lifted
    assert ran.ended is not None
    assert ran.ended.time_s < 6.0


def test_a_force_sensor_that_hangs_stops_the_stage() -> None:
    bed, stage, _ = on_springs(stiffness_n_m=HARD_N_M)
    ran = run_springs(bed, stage, [Below(bed, 1e-3, hang)], rig=SLOW)
    assert "cell: silent for 0." in ran.reason
    assert ran.force_n.max() < LIMIT_N
    assert ran.lifted


class Reference(SpringSensor):
    """A second sensor that feels no force and fails at 0.9 s: ``how``."""

    def __init__(self, bed: Bed, how: str) -> None:
        super().__init__(bed, "ecg", "reference", "V")
        self._how = how

    def read(self) -> Block:
        if self.bed.clock.now() > 0.9:
            if self._how == "hangs":
                time.sleep(8)
            if self._how == "ends":
                sys.exit(1)
            return empty()
        return super().read()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("how", ["hangs", "ends", "falls silent"])
def test_one_sensor_that_fails_hides_nothing_and_lifts(how: str) -> None:
    bed, stage, sensor = on_springs(stiffness_n_m=HARD_N_M)
    ran = run_springs(bed, stage, [sensor, Reference(bed, how)], rig=SLOW)
    assert ran.force_n.max() < 2 * LIMIT_N
    assert ran.raised is not None or ran.ended is not None
    assert ran.lifted


def test_a_station_waits_for_what_its_sensor_says_late() -> None:
    bed, stage, _ = on_springs()

    class Late(SpringSensor):
        """Each reading arrives 80 ms late."""

        def read(self) -> Block:
            if len((block := super().read()).time_s):
                kept.append(block)
            said = kept and kept[0].time_s[-1] < self.bed.clock.now() - 0.08
            return kept.popleft() if said else empty()

    kept: deque[Block] = deque()

    ran = run_springs(bed, stage, [Late(bed)])
    assert ran.complete == [0]
    at = next(n for n, e in enumerate(ran.events) if isinstance(e, StationEnded))
    before = [e for e in ran.events[:at] if isinstance(e, Samples) and e.device == "cell"]
    assert before[-1].block.time_s[-1] > ran.events[at].time_s - 0.01


def test_a_stage_that_comes_to_rest_elsewhere_presses_nothing() -> None:
    bed, _, sensor = on_springs()

    class Short(SpringStage):
        def move(self, target: Pose, speed_m_s: float) -> None:
            super().move(target._replace(x=target.x + 0.5e-3), speed_m_s)

    ran = run_springs(bed, Short(bed), [sensor])
    assert "came to rest 0.50 mm from its target" in ran.reason
    assert ran.force_n.max() == 0.0


def test_a_tare_does_not_blind_the_guards() -> None:
    bed, stage, _ = on_springs()
    began: list[float] = []

    class Slow(SpringSensor):
        def tare(self) -> None:
            began.append(self.bed.clock.now())
            time.sleep(0.6)
            super().tare()

    class Hit(SpringSensor):
        def raw(self, time_s: float) -> float:
            return 20.0 if began and time_s > began[0] else super().raw(time_s)

    ran = run_springs(bed, stage, [Slow(bed, "slow"), Hit(bed)])
    assert "cell: force 20." in ran.reason
    stops = [t for t, what in stage.orders if what == "stop" and t > began[0]]
    assert stops[0] - began[0] < 0.2


@pytest.mark.parametrize("deaf_s", [0.02, 0.3])
def test_a_stop_is_repeated_until_it_is_heard(deaf_s: float) -> None:
    bed, _, sensor = on_springs()

    class HardOfHearing(SpringStage):
        first_s = np.inf

        def stop(self) -> None:
            now = self.bed.clock.now()
            self.first_s = min(self.first_s, now)
            self.orders.append((now, "stop"))
            if now >= self.first_s + deaf_s:
                self.bed.tip.halt(now, self.acceleration)

    stage = HardOfHearing(bed)
    ran = run_springs(bed, stage, [sensor], rig=spring_rig(safety={"max_force_n": 0.5}))
    assert "the limit is 0.5 N" in ran.reason
    assert ran.force_n.max() < 0.5 + 400 * 2.5e-3 * (deaf_s + 0.15)
    assert ran.lifted


def test_a_lift_that_goes_down_is_stopped() -> None:
    bed, _, sensor = on_springs(stiffness_n_m=1000.0)

    class Inverted(SpringStage):
        def move(self, target: Pose, speed_m_s: float) -> None:
            here = self.pose()
            if any(what == "stop" for _, what in self.orders):
                target = target._replace(z=here.z - (target.z - here.z))
            super().move(target, speed_m_s)

    stage = Inverted(bed)
    ran = run_springs(bed, stage, [sensor], rig=spring_rig(safety={"max_force_n": 1.0}))
    assert "the probe was not lifted: commanded to lift, the stage went another way" in ran.reason
    assert ran.force_n.max() < 1.0 + 1000 * 1.5e-3
    assert not stage.moving()


def test_a_stage_that_answers_again_is_lifted() -> None:
    bed, _, sensor = on_springs()

    class Away(SpringStage):
        """Does not answer for 1.2 s once it is 1 mm deep."""

        since_s = np.inf

        def pose(self) -> Pose:
            now = self.bed.clock.now()
            if self.bed.tip.point(now)[2] < -1e-3:
                self.since_s = min(self.since_s, now)
            if self.since_s <= now < self.since_s + 1.2:
                raise DeviceFault(self.name, "no answer")
            return super().pose()

    ran = run_springs(bed, Away(bed), [sensor])
    assert "no answer" in ran.reason
    assert ran.lifted


@pytest.mark.parametrize("way_m", [(8e-3, 0.0, 0.0), (0.0, 0.0, -0.4e-3)])
def test_a_probe_that_somebody_else_moves_is_noticed(way_m: tuple[float, float, float]) -> None:
    bed, stage, sensor = on_springs()

    def push(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING:
            here = bed.tip.point(bed.clock.now())
            there = tuple(a + b for a, b in zip(here, way_m, strict=True))
            bed.tip.move(bed.clock.now(), there, APPROACH_M_S, 1.0)

    ran = run_springs(bed, stage, [sensor], rig=spring_rig(scan={"hold_s": 1.5}), observers=[push])
    assert "mm from where it was commanded to be" in ran.reason
    assert ran.complete == []
    assert ran.lifted


@pytest.mark.parametrize("up_m", [0.7e-3, 2e-3, 4e-3])
def test_a_probe_that_is_pulled_up_in_a_press_is_not_blamed_on_the_sensor(up_m: float) -> None:
    bed, _, sensor = on_simulated_springs(stiffness_n_m=600.0)

    class Pulled(SpringStage):
        pulled = False

        def moving(self) -> bool:
            now = self.bed.clock.now()
            x_m, y_m, z_m = self.bed.tip.point(now)
            if not self.pulled and z_m < -1.5e-3:
                self.pulled = True
                self.bed.tip.halt(now, 1.0)
                self.bed.tip.move(now, (x_m, y_m, z_m + up_m), 20e-3, 1.0)
            return super().moving()

    ran = run_springs(bed, Pulled(bed), [sensor])
    assert ran.reason.startswith("stage of springs: went back 0.")
    assert "something else moves it" in ran.reason
    assert ran.lifted


class Bursts(SpringSensor):
    """Speaks once in ``every_s``."""

    due_s, every_s = 0.0, 0.04

    def read(self) -> Block:
        if self.bed.clock.now() < self.due_s:
            return empty()
        self.due_s = self.bed.clock.now() + self.every_s
        return super().read()


@pytest.mark.parametrize("every_s", [0.08, 0.24, 0.4])
def test_a_sensor_that_speaks_in_bursts_does_not_get_near_the_tissue(every_s: float) -> None:
    """What could grow to the limit between two bursts, on something this hard, is not waited for:
    1.6 N at 12 N/mm and 10 mm/s are 13 ms."""
    bed, stage, _ = on_springs(stiffness_n_m=HARD_N_M, surface_m=1.2e-3)
    sensor = Bursts(bed)
    sensor.every_s = every_s
    ran = run_springs(bed, stage, [sensor], rig=spring_rig(safety={"hardest_n_mm": 12.0}))
    assert "cell: silent for 0." in ran.reason
    assert ran.force_n.max() == 0.0


def test_a_sensor_that_is_silent_beside_another_is_not_waited_for() -> None:
    """Another that is heard does not excuse it: while the stage moves, each has `late_s`."""
    bed, stage, sensor = on_springs()

    class Silent(SpringSensor):
        since_s = np.inf

        def read(self) -> Block:
            now = self.bed.clock.now()
            if self.bed.tip.point(now)[2] < 1.9e-3:
                self.since_s = min(self.since_s, now)
            return empty() if self.since_s <= now < self.since_s + 0.6 else super().read()

    rig = spring_rig(safety={"silence_s": 2.0, "late_s": 0.2}, scan={"approach_mm_s": 2.0})
    ran = run_springs(bed, stage, [sensor, Silent(bed, name="other", seed=1)], rig=rig)
    assert "other: silent for" in ran.reason
    assert ran.lifted


def test_bursts_that_hide_little_are_let_pass() -> None:
    """On something soft and slow the same bursts cannot hide the limit."""
    bed, stage, _ = on_springs()
    ran = run_springs(bed, stage, [Bursts(bed)], rig=spring_rig(scan={"approach_mm_s": 5.0}))
    assert ran.reason == "every station is complete"


def test_a_blocked_engine_s_probe_is_lifted_also_out_of_a_move() -> None:
    bed, stage, sensor = on_springs()

    def block(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.INDENTING:
            time.sleep(4.0)

    rig = spring_rig(scan={"ramp_s": 5.0}, safety={"engine_s": 0.5})
    ran = run_springs(bed, stage, [sensor], rig=rig, sink=block)
    assert "engine: blocked for 0.5 s" in ran.reason
    # lifted long before the engine came back
    assert ran.height_m[-1500:].min() == pytest.approx(2e-3, abs=1e-4)


def test_a_slow_observer_delays_nothing_and_hears_everything() -> None:
    bed, stage, sensor = on_springs()
    late_s: list[float] = []
    heard: list[Event] = []

    def store(event: Event) -> None:
        if isinstance(event, Samples) and event.device == "cell":
            late_s.append(bed.clock.now() - float(event.block.time_s[0]))

    def dawdle(event: Event) -> None:
        heard.append(event)
        if isinstance(event, PhaseEntered) and event.phase is Phase.INDENTING:
            time.sleep(1.5)

    ran = run_springs(bed, stage, [sensor], observers=[dawdle], sink=store)
    assert ran.reason == "every station is complete"
    assert max(late_s) < 0.75  # it was 1.5 s and more
    assert heard == ran.events


PAUSED = """
import sys, time
from springs import on_springs, run_springs, spring_rig
from probe.core.events import PhaseEntered
def say(event):
    if isinstance(event, PhaseEntered):
        print(event.phase.value, flush=True)
bed, stage, sensor = on_springs()
ran = run_springs(bed, stage, [sensor], rig=spring_rig(scan={"hold_s": 5.0}), observers=[say])
print("END", ran.reason, "LIFTED" if ran.lifted else "PRESSED", flush=True)
"""


def test_a_pause_of_the_whole_program_is_blamed_on_nobody_and_lifts() -> None:
    paths = os.pathsep.join((str(ROOT), str(ROOT / "tests/support")))
    with subprocess.Popen(
        [sys.executable, "-c", PAUSED], stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": paths},
    ) as scanning:  # fmt: skip
        assert scanning.stdout is not None
        for line in scanning.stdout:
            if line == "holding\n":
                time.sleep(0.3)
                scanning.send_signal(signal.SIGSTOP)
                time.sleep(0.8)
                scanning.send_signal(signal.SIGCONT)
            if line.startswith("END"):
                assert "computer: this program did not run for" in line
                assert "LIFTED" in line
                break
        else:
            pytest.fail("the scan said nothing of its end")


def test_a_computer_that_slept_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    bed, stage, sensor = on_springs()
    asleep_s = [0.0]
    monkeypatch.setattr(
        "probe.guards.clock_guard._since_boot", lambda: time.monotonic() + asleep_s[0]
    )

    def sleep(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING:
            asleep_s[0] = 3600.0

    ran = run_springs(bed, stage, [sensor], observers=[sleep])
    assert "the computer slept" in ran.reason
    assert ran.lifted
