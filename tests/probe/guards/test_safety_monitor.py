"""The guards on the wall clock: in their own threads, also while the engine is blocked."""

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from springs import Bed, SpringSensor, SpringStage, monitor_of, on_simulated_springs

from drivers import Block, Channel, DeviceFault, Pose, WallClock
from probe.config.devices import Devices, connect
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import Event, Finish, Phase, PhaseEntered, RunEnded, Samples, StationEnded
from probe.guards.commands import Control
from probe.guards.force_limit import SensorGuard
from probe.guards.pose_guard import PoseGuard
from probe.guards.safety_monitor import SafetyMonitor
from probe.planning.limits import Limits
from probe.planning.surfaces import flat
from probe.scan.engine import run_scan
from sim_backend.scene.scene_file import load_scene

LIMITS = Limits(
    max_force_n=1.0,
    max_depth_m=3e-3,
    workspace_m=((0.0, 0.1), (-0.01, 0.01), (-5e-3, 0.02)),
    max_speed_m_s=25e-3,
    face_m2=1e-4,
)


def run(winkler: Any, sink: Any, *, control: Control | None = None, **safety: Any) -> RunEnded:
    """Two quick real-time presses; ``sink`` also gets the devices."""
    rig = Rig.model_validate(
        {
            "scan": {"stations": 2, "ramp_s": 0.2, "hold_s": 0.1, "indentation_mm": 2.0},
            "safety": {"max_speed_mm_s": 25, "hardest_n_mm": 0.5} | safety,
        }
    )
    clock = WallClock()
    with connect(rig, clock, load_scene("TI"), respond=winkler) as opened:
        plan = plan_for(rig)
        return run_scan(
            plan, opened.stage, opened.sensors, clock, lambda e: sink(e, opened),
            limits_for(rig, plan),
            control=control,
        )  # fmt: skip


def test_real_time_costs_little_more_than_its_physics(winkler: Any) -> None:
    events: list[Event] = []
    ended = run(winkler, lambda e, _: events.append(e))
    assert ended.finish is Finish.COMPLETED
    physical_s = 0.55 + 2 * (2e-3 / 10e-3 + 0.2 + 0.1 + 4e-3 / 20e-3 + 0.05) + 4e-3 / 20e-3
    assert ended.time_s < 1.5 * physical_s  # a shared machine; the benchmark has the real figure
    force = np.concatenate(
        [e.block.time_s for e in events if isinstance(e, Samples) and e.device == "force"]
    )
    assert np.diff(force) == pytest.approx(2e-3, abs=1e-9)


def test_a_guard_acts_while_the_engine_is_blocked(winkler: Any) -> None:
    forces: list[float] = []

    def sink(event: Event, opened: Devices) -> None:
        if isinstance(event, Samples) and event.device == "force":
            forces.append(float(event.block.values[:, 0].max()))
            if forces[-1] > 0.1 and len(blocked) == 0:
                blocked.append(opened.stage.pose().z)
                time.sleep(0.4)  # longer than the rest of the ramp
                blocked.append(opened.stage.pose().z)

    blocked: list[float] = []
    ended = run(winkler, sink, max_force_n=0.6)
    assert ended.finish is Finish.FAULTED
    assert "the limit is 0.6 N" in ended.reason
    # 10 mm/s on 0.4 N/mm is 8 mN per sample; scheduling on a shared machine may take some.
    assert max(forces) < 0.6 + 25 * 8e-3
    assert blocked[1] > -2.0e-3


def test_a_stop_acts_while_the_engine_is_blocked(winkler: Any) -> None:
    control = Control()
    heights: list[float] = []

    def sink(event: Event, opened: Devices) -> None:
        if isinstance(event, Samples) and event.device == "stage" and not heights:
            if event.block.values[-1, 2] > -0.5e-3:
                return
            control.stop()
            time.sleep(0.3)
            heights.append(opened.stage.pose().z)

    ended = run(winkler, sink, control=control)
    assert ended.finish is Finish.ABORTED
    assert heights[0] > -1.9e-3


def test_a_hanging_stage_is_noticed_by_the_other_thread(
    winkler: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("probe.guards.retreat.PATIENCE_S", 1.0)
    stops: list[int] = []
    events: list[Event] = []

    def sink(event: Event, opened: Devices) -> None:
        events.append(event)
        if isinstance(event, PhaseEntered) and event.phase is Phase.INDENTING:
            stop = opened.stage.stop
            monkeypatch.setattr(opened.stage, "stop", lambda: (stops.append(1), stop()))

            def hang() -> Pose:  # far beyond the limit, but short enough to end with the test
                time.sleep(1.5)
                raise DeviceFault("virtual", "no answer")

            monkeypatch.setattr(opened.stage, "pose", hang)

    began = time.monotonic()
    ended = run(winkler, sink)
    assert ended.reason.startswith("virtual: ")
    assert "silent" in ended.reason or "does not answer" in ended.reason
    assert time.monotonic() - began < 8.0
    assert stops
    assert not any(isinstance(e, StationEnded) and e.complete for e in events)


def block(*force_n: float, start_s: float = 1.0, clipped: bool = False) -> Block:
    time_s = start_s + 2e-3 * np.arange(len(force_n))
    values = np.array(force_n)[:, None]
    return Block(time_s, values, np.full(values.shape, clipped))


@pytest.mark.parametrize("reading, said", [
    (block(0.1, 0.2, 0.3), None),
    (block(0.1, 1.2, 0.3), "force 1.200 N; the limit is 1 N"),
    (block(-1.2), "force 1.200 N"),
    (block(0.1, float("nan")), "force nan N"),
    (block(0.5, clipped=True), "saturated"),
    (replace(block(0.5, 0.4), saturated=np.array([[True], [False]])), "saturated"),
    (block(0.1, start_s=0.4), "sample times jump"),
    (block(0.1, start_s=3.0), "sample times jump"),
    (block(0.1, start_s=float("nan")), "sample times jump"),
])  # fmt: skip
def test_what_a_sensor_guard_objects_to(reading: Block, said: str | None) -> None:
    guard = SensorGuard((Channel("f", "N", "force"),), LIMITS)
    assert guard.times.check(block(0.0, start_s=0.5), 1.0) is None
    jump, why = guard.times.check(reading, 1.05), guard.check(reading)
    found = jump or why
    assert found is None if said is None else found is not None and said in found


def test_what_was_read_before_a_tare_is_in_no_mean_after_it() -> None:
    guard = SensorGuard((Channel("f", "N", "force"),), LIMITS)
    assert guard.check(block(-0.30, -0.31, -0.30, -0.31)) is None
    guard.tare()
    assert guard.smooth_n == 0.0
    assert guard.check(block(0.01, start_s=2.0)) is None
    assert guard.smooth_n == 0.01


def test_pressure_is_guarded_as_force_on_the_face() -> None:
    guard = SensorGuard((Channel("a", "Pa", "taxel"), Channel("b", "Pa", "taxel")), LIMITS)
    fine = Block(np.array([1.0]), np.array([[9e3, 9e3]]), np.zeros((1, 2), bool))
    hard = Block(np.array([1.1]), np.array([[9e3, 12e3]]), np.zeros((1, 2), bool))
    assert guard.check(fine) is None
    assert guard.check(hard) is not None


@pytest.mark.parametrize("pose, said", [
    (Pose(0.05, 0.0, -2.9e-3), None),
    (Pose(0.05, 0.0, -3.2e-3), "3.200 mm below the surface"),
    (Pose(0.11, 0.0, 0.0), "x = 110.000 mm; the workspace is 0 to 100 mm"),
    (Pose(0.05, float("nan"), 0.0), "not a number"),
])  # fmt: skip
def test_what_a_pose_guard_objects_to(pose: Pose, said: str | None) -> None:
    why = PoseGuard(flat, LIMITS).check(pose, 1.0)
    assert why is None if said is None else why is not None and said in why[0]


def test_only_above_the_workspace_is_a_lift_the_wrong_way() -> None:
    above = PoseGuard(flat, LIMITS).check(Pose(0.05, 0.0, 21e-3), 1.0)
    beside = PoseGuard(flat, LIMITS).check(Pose(0.11, 0.0, 0.0), 1.0)
    below = PoseGuard(flat, replace(LIMITS, max_depth_m=1.0)).check(Pose(0.05, 0.0, -6e-3), 1.0)
    reported = [why is not None and "the workspace is" in why[0] for why in (above, beside, below)]
    assert all(reported)
    assert [why is not None and why[1] for why in (above, beside, below)] == [False, True, True]


@pytest.mark.parametrize("z_m", [3e-3, -1e-3])
def test_a_way_ends_where_it_was_to_end(z_m: float) -> None:
    """1 mm before its beginning or beyond its end, and on its line."""
    guard = PoseGuard(flat, LIMITS)
    guard.expect(Pose(0.05, 0.0, 2e-3), Pose(0.05, 0.0, 0.0))
    assert guard.check(Pose(0.05, 0.0, 1e-3), 1.0) is None
    why = guard.check(Pose(0.05, 0.0, z_m), 2.0)
    assert why is not None
    assert "is 1.00 mm from where it was commanded to be" in why[0]


def test_where_the_surface_is_not_known_nothing_may_press() -> None:
    guard = PoseGuard(lambda _x, _y: float("nan"), LIMITS)
    why = guard.check(Pose(0.05, 0.0, 0.0), 1.0)
    assert why is not None
    assert "below the surface" in why[0]


WIDE = replace(LIMITS, workspace_m=((-1.0, 1.0),) * 3)


@given(st.floats(0, 25e-3), st.lists(st.tuples(st.floats(0, 0.1), st.floats(0, 0.2)), min_size=9))
def test_old_poses_and_slow_reads_make_no_speed(
    speed_m_s: float, ages_and_reads_s: list[tuple[float, float]]
) -> None:
    guard = PoseGuard(flat, WIDE)
    now_s, measured_s = 0.0, -1.0
    for age_s, read_s in ages_and_reads_s:
        asked_s = now_s + 8e-3
        now_s = asked_s + read_s
        measured_s = max(measured_s, asked_s - age_s)
        assert guard.check(Pose(speed_m_s * measured_s, 0, 0), now_s, asked_s) is None


@pytest.mark.parametrize(("speed_m_s", "within_s"), [(40e-3, 0.3), (60e-3, 0.1), (0.25, 0.02)])
def test_a_stage_that_is_too_fast_is_noticed(speed_m_s: float, within_s: float) -> None:
    guard = PoseGuard(flat, WIDE)
    reported = [guard.check(Pose(speed_m_s * t, 0, 0), t) for t in np.arange(0, within_s, 8e-3)]
    assert any(why is not None and "the limit is 25 mm/s" in why[0] for why in reported)


@pytest.mark.parametrize("before_m_s", [0.0, 20e-3])
def test_a_stage_that_becomes_too_fast_is_noticed_as_soon(before_m_s: float) -> None:
    """What it did in the 10 s before excuses nothing."""
    guard = PoseGuard(flat, WIDE)
    times = np.arange(0, 10.1, 8e-3)
    way_m = before_m_s * np.minimum(times, 10.0) + 60e-3 * np.maximum(times - 10.0, 0.0)
    reported = [guard.check(Pose(x, 0, 0), t) for x, t in zip(way_m, times, strict=True)]
    assert all(why is None for why, t in zip(reported, times, strict=True) if t < 10.0)
    assert any(why is not None and "the limit is 25 mm/s" in why[0] for why in reported)


def alone(stage: SpringStage, sensor: SpringSensor) -> SafetyMonitor:
    """A monitor that lifts to where the bed's tip begins, 5 mm high."""
    monitor = monitor_of(stage, sensor, limits=LIMITS, lift_z_m=5e-3)
    monitor.start()
    return monitor


def pass_time(monitor: SafetyMonitor, stage: SpringStage, for_s: float) -> None:
    clock = stage.bed.clock
    for _ in range(round(for_s / 4e-3)):
        clock.sleep_until(clock.now() + 4e-3)
        monitor.step()


def test_what_was_to_stay_is_not_lifted_by_the_next_objection() -> None:
    """The user has said stop: where the probe rests, only they know what holds it."""
    _, stage, sensor = on_simulated_springs()
    monitor = alone(stage, sensor)
    monitor.move(Pose(0.0, 0.0, 1e-3), 5e-3)
    pass_time(monitor, stage, 0.2)
    monitor.object("user", "stopped by the user", can_retract=False)
    pass_time(monitor, stage, 0.5)
    rests_m = stage.pose().z
    monitor.object("cell", "force 2 N; the limit is 1 N", can_retract=True, again=True)
    pass_time(monitor, stage, 2.0)
    assert monitor.retreat is not None and monitor.retreat.done
    assert stage.pose().z == rests_m < 4.5e-3


def test_a_tip_that_is_carried_off_after_its_way_out_is_lifted_again() -> None:
    _, stage, sensor = on_simulated_springs()
    monitor = alone(stage, sensor)
    monitor.move(Pose(0.0, 0.0, 1e-3), 5e-3)
    pass_time(monitor, stage, 0.5)
    monitor.object("cell", "silent for 0.25 s", can_retract=True)
    pass_time(monitor, stage, 2.0)
    assert monitor.retreat is not None and monitor.retreat.up
    stage.bed.tip.move(stage.bed.clock.now(), (0.0, 0.0, 3e-3), 5e-3, 1.0)  # by nobody's order
    pass_time(monitor, stage, 3.0)
    assert stage.pose().z == pytest.approx(5e-3, abs=1e-4)


def test_a_tip_that_was_sent_down_is_lifted_whatever_its_pose_says() -> None:
    class Frozen(SpringStage):
        def pose(self) -> Pose:
            return Pose(0.0, 0.0, 5e-3)

    _, stage, sensor = on_simulated_springs()
    stage = Frozen(stage.bed)
    monitor = alone(stage, sensor)
    monitor.move(Pose(0.0, 0.0, -1e-3), 5e-3)
    pass_time(monitor, stage, 0.5)
    assert stage.bed.tip.point(stage.bed.clock.now())[2] < 3e-3
    monitor.object("cell", "silent for 0.25 s", can_retract=True)
    pass_time(monitor, stage, 3.0)
    assert stage.bed.tip.point(stage.bed.clock.now())[2] == pytest.approx(5e-3, abs=1e-4)


class Beats:
    """Threads that beat last as long ago as the test says."""

    running = False

    def __init__(self, late_s: float) -> None:
        self._late_s = late_s

    def late_s(self, _name: str) -> float:
        return self._late_s

    def latest_s(self) -> float:
        return self._late_s

    def excuse(self) -> None:
        self._late_s = 0.0


@pytest.mark.parametrize(
    ("late_s", "why"),
    [(0.01, "silent for"), (0.15, None), (0.3, "this program did not run for 0.30 s")],
)
def test_a_pause_of_the_whole_program_is_nobody_else_s_silence(
    late_s: float, why: str | None
) -> None:
    """Nothing was read for 1 s and the engine gave no sign for 3 s, as it could not run."""
    stage, sensor = SpringStage(bed := Bed(WallClock())), SpringSensor(bed)
    monitor = alone(stage, sensor)
    monitor._threads = Beats(late_s)  # type: ignore[assignment]
    monitor._readings.all_seen(bed.clock.now() - 1.0)
    monitor._engine_s -= 3.0
    monitor._supervise()
    assert (monitor.trip is None) == (why is None)
    assert why is None or why in monitor.trip.reason
