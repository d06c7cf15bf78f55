"""The guards that look after clocks and after each other."""

import threading
import time

import pytest
from springs import (
    LIMIT_N,
    SpringSensor,
    SpringStage,
    monitor_of,
    on_springs,
    run_springs,
    spring_rig,
)

from drivers import Block, DeviceFault, Pose
from probe.guards.clock_guard import ClockGuard
from probe.guards.guard_process import Service
from probe.guards.interface import Status, WayOut
from probe.guards.safety_monitor import DEAD_S, SUPERVISOR, SafetyMonitor
from probe.planning.limits import Limits

LIMITS = Limits(1.0, 3e-3, ((-1.0, 1.0),) * 3, 25e-3, clock_jump_s=0.25)


@pytest.mark.parametrize(
    ("jump_s", "said"),
    [(0.0, None), (0.2, None), (0.4, "jumped by +0.400 s"), (-0.2, None), (-0.4, "stood")],
)
def test_a_clock_is_held_to_another(jump_s: float, said: str | None) -> None:
    times = iter((0.0, 1.0, 2.0 + jump_s))
    others = iter((5.0, 6.0, 7.0))
    guard = ClockGuard(LIMITS, lambda: next(times), lambda: next(others))
    assert guard.check() is None
    why = guard.check()
    assert why is None if said is None else why is not None and said in why


def test_the_engine_misses_a_supervisor_that_died() -> None:
    _, stage, sensor = on_springs()
    monitor = monitor_of(stage, sensor, threaded=True)
    hangs, go_on = threading.Event(), threading.Event()

    def hang() -> None:
        hangs.set()
        go_on.wait(10.0)

    monitor._supervise = hang  # type: ignore[method-assign]
    monitor.start()
    try:
        assert hangs.wait(2.0)
        end_s = time.monotonic() + DEAD_S + 2.0
        while monitor.trip is None and time.monotonic() < end_s:
            monitor.engine_heartbeat()
            time.sleep(0.01)
    finally:
        go_on.set()
        monitor.finish()
    assert monitor.trip is not None
    assert f"its {SUPERVISOR} has done nothing" in monitor.trip.reason
    assert "stop" in {what for _, what in stage.orders}


def test_a_guard_that_fails_stops_lifts_and_is_a_fault_of_the_program() -> None:
    bed, stage, _ = on_springs()

    class Broken(SpringSensor):
        def read(self) -> Block:
            if self.bed.tip.point(self.bed.clock.now())[2] < -1e-3:
                raise ZeroDivisionError("a driver's mistake")
            return super().read()

    ran = run_springs(bed, stage, [Broken(bed)])
    assert isinstance(ran.raised, ZeroDivisionError)
    assert any("ZeroDivisionError: a driver's mistake" in text for text in ran.notes)
    assert ran.lifted


def test_a_trip_ends_a_long_hold() -> None:
    bed, stage, _ = on_springs()

    class Knocked(SpringSensor):
        def raw(self, time_s: float) -> float:
            held = self.bed.tip.point(time_s)[2] < -2.4e-3
            return super().raw(time_s) + (20.0 if held else 0.0)

    began_s = bed.clock.now()
    ran = run_springs(bed, stage, [Knocked(bed)], rig=spring_rig(scan={"hold_s": 30.0}))
    assert f"limit is {LIMIT_N:g} N" in ran.reason
    assert ran.lifted
    assert bed.clock.now() - began_s < 15.0


class Astray(SpringStage):
    """Amid its homing it tells a pose from before, far out of the workspace."""

    def pose(self) -> Pose:
        return super().pose()._replace(x=1.0)


def test_who_takes_over_amid_a_homing_does_not_lift_for_what_the_pose_says() -> None:
    bed, _, sensor = on_springs()
    stage = Astray(bed)
    lift_z_m = SpringStage.pose(stage).z + 1e-3
    monitor = monitor_of(stage, sensor, threaded=True, lift_z_m=lift_z_m)
    start = monitor.start

    def start_where_the_guards_look_first(*, homes: bool) -> Status:
        status = start(homes=homes)
        time.sleep(0.1)
        return status

    monitor.start = start_where_the_guards_look_first  # type: ignore[method-assign,assignment]
    status = left(stage, monitor, lift=False)
    assert status.trip is not None and not status.trip.can_retract
    assert "move" not in {what for _, what in stage.orders}


def left(stage: SpringStage, monitor: SafetyMonitor, *, lift: bool) -> Status:
    """The status in which the way out of guards has ended that take over from others."""
    status = Service(stage, monitor).take_over("the process that guarded has ended", lift)
    try:
        while status.way_out is None or not status.way_out.done:
            time.sleep(0.01)
            status = monitor.look()
    finally:
        monitor.finish()
    return status


def taken_over(sensor: SpringSensor, stage: SpringStage, *, lift: bool) -> WayOut:
    """How the way out ended, of guards that take over from others."""
    monitor = monitor_of(stage, sensor, threaded=True, lift_z_m=stage.pose().z + 1e-3)
    status = left(stage, monitor, lift=lift)
    assert status.way_out is not None
    return status.way_out


class Disabled(SpringStage):
    """As an arm whose control program ended with the process that had uploaded it."""

    enabled = False

    def enable(self) -> list[str]:
        self.enabled = True
        return []

    def move(self, target: Pose, speed_m_s: float) -> None:
        if not self.enabled:
            raise DeviceFault(self.name, "nobody has taken control")
        super().move(target, speed_m_s)


def test_who_takes_over_enables_the_stage_to_lift_it() -> None:
    bed, _, sensor = on_springs()
    stage = Disabled(bed)
    leaving = taken_over(sensor, stage, lift=True)
    assert leaving.up


class Lost(SpringStage):
    @property
    def pace(self) -> float:
        raise DeviceFault(self.name, "sends nothing")


def test_a_heartbeat_is_answered_also_when_the_stage_is_lost() -> None:
    """By it the scan learns that the way out is over, and how it ended."""
    bed, _, sensor = on_springs()
    stage = Lost(bed)
    assert monitor_of(stage, sensor, threaded=True).look().pace == 1.0


@pytest.mark.parametrize("lift", [True, False])
def test_who_takes_over_lifts_unless_the_stage_was_homing(lift: bool) -> None:
    """Amid a homing no position means anything: a lift might go anywhere."""
    _, stage, sensor = on_springs()
    leaving = taken_over(sensor, stage, lift=lift)
    assert ("move" in {what for _, what in stage.orders}) == lift == leaving.up


class Unplugged(SpringSensor):
    """Was there when it was opened."""

    def __init__(self, stage: SpringStage, error: Exception) -> None:
        super().__init__(stage.bed)
        self.error = error

    def start(self) -> None:
        raise self.error

    def read(self) -> Block:
        raise self.error


@pytest.mark.parametrize("error, said", [
    (DeviceFault("cell", "connection lost (unplugged)"), "connection lost (unplugged)"),
    (ValueError("no such mode"), "driver: ValueError: no such mode"),
])  # fmt: skip
def test_a_sensor_that_dies_before_the_guards_begin_has_the_probe_lifted(
    error: Exception, said: str
) -> None:
    """Guards that did not begin carry out no way out, and the stage seems not to answer."""
    _, stage, _ = on_springs(home=(0.0, 0.0, -2.5e-3))
    sensor = Unplugged(stage, error)
    monitor = monitor_of(stage, sensor, threaded=True, lift_z_m=2e-3)
    try:
        status, end_s = monitor.start(homes=False), time.monotonic() + 10.0
        assert status.trip is not None
        assert (status.trip.device, status.trip.reason) == ("cell", said)
        while not (status.way_out and status.way_out.done) and time.monotonic() < end_s:
            time.sleep(0.01)
            status = monitor.look()
    finally:
        monitor.finish()
    assert status.way_out is not None
    assert status.way_out.up
    assert stage.pose().z == pytest.approx(2e-3)
