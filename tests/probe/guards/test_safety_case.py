"""What the safety case says of the guards and nothing else would notice if it were false."""

import math
import threading
import time
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from springs import (
    LIMIT_N,
    Bed,
    SpringSensor,
    SpringStage,
    monitor_of,
    on_simulated_springs,
    on_springs,
    run_springs,
    spring_rig,
)

from drivers import Block, DeviceFault, Pose, SimulatedClock
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.core.events import Phase, PhaseEntered
from probe.guards.safety_monitor import PAUSE_S, SafetyMonitor


class SlowToStop(SpringStage):
    """Takes 0.3 s to stop, and takes any order meanwhile, as a controller that blends moves."""

    acceleration = 8e-3

    def __init__(self, bed: Bed) -> None:
        super().__init__(bed)
        self.set_off_m_s: list[float] = []

    def move(self, target: Pose, speed_m_s: float) -> None:
        now = self.bed.clock.now()
        self.orders.append((now, "move"))
        self.set_off_m_s.append(math.hypot(*self.bed.tip.velocity(now)))
        self.bed.tip.move(now, target[:3], speed_m_s, self.acceleration)


class Denies(SlowToStop):
    """Says that it rests as soon as a stop was ordered."""

    def moving(self) -> bool:
        return super().moving() and self.orders[-1][1] != "stop"


@pytest.mark.parametrize("kind", [SlowToStop, Denies])
def test_a_lift_begins_at_rest(kind: type[SlowToStop]) -> None:
    """Which is what is seen, 20 um in 30 ms, whatever the stage says of itself."""
    bed, _, sensor = on_simulated_springs(stiffness_n_m=1000.0)
    stage = kind(bed)
    ran = run_springs(bed, stage, [sensor], rig=spring_rig(scan={"ramp_s": 1.5}))
    assert f"limit is {LIMIT_N:g} N" in ran.reason
    assert ran.lifted
    assert stage.set_off_m_s == pytest.approx([0.0] * len(stage.set_off_m_s), abs=1e-3)


class Refuses(SpringStage):
    """Refuses what is faster than it allows."""

    max_speed_m_s = 4e-3

    def move(self, target: Pose, speed_m_s: float) -> None:
        if speed_m_s > self.max_speed_m_s * (1 + 1e-9):
            raise DeviceFault(self.name, f"refuses {1e3 * speed_m_s:g} mm/s")
        super().move(target, speed_m_s)


def test_a_lift_is_no_faster_than_its_stage_allows() -> None:
    bed, _, sensor = on_simulated_springs(stiffness_n_m=1000.0)
    slow = {"travel_mm_s": 4.0, "approach_mm_s": 4.0}
    rig = spring_rig(scan=slow, safety={"max_speed_mm_s": 25.0})
    ran = run_springs(bed, Refuses(bed), [sensor], rig=rig)
    assert f"limit is {LIMIT_N:g} N" in ran.reason
    assert ran.lifted


class HangsAt(SpringSensor):
    """Its `read` does not return from a moment on."""

    def __init__(self, bed: Bed) -> None:
        super().__init__(bed)
        self.hangs, self.go_on = threading.Event(), threading.Event()

    def read(self) -> Block:
        if self.hangs.is_set():
            self.go_on.wait(10.0)
        return super().read()


class Watched(SpringStage):
    """Has a watchdog, and may hang too."""

    def __init__(self, bed: Bed) -> None:
        super().__init__(bed)
        self.kept_alive_s: list[float] = []
        self.hangs, self.go_on = threading.Event(), threading.Event()

    def keep_alive(self) -> None:
        self.kept_alive_s.append(time.monotonic())

    def pose(self) -> Pose:
        if self.hangs.is_set():
            self.go_on.wait(10.0)
        return super().pose()


@pytest.mark.parametrize("whose", ["sensor", "stage"])
def test_a_watchdog_is_not_fed_while_a_guard_hangs(whose: str) -> None:
    bed, _, _ = on_springs()
    stage, sensor = Watched(bed), HangsAt(bed)
    monitor = monitor_of(stage, sensor, threaded=True, lift_z_m=5e-3)
    device = sensor if whose == "sensor" else stage
    monitor.start()
    try:
        time.sleep(0.3)
        assert stage.kept_alive_s
        device.hangs.set()
        hung_s = time.monotonic()
        time.sleep(PAUSE_S + 0.5)
        last_s = max(stage.kept_alive_s)
        device.go_on.set()
    finally:
        device.go_on.set()
        monitor.finish()
    assert last_s - hung_s < PAUSE_S + 0.1


class Bump(Bed):
    """From 2 mm sideways on the springs stand higher, up to where the probe travels."""

    def force_n(self, time_s: float) -> float:
        x_m, _, z_m = self.tip.point(time_s)
        surface_m = 2.8e-3 if x_m > 2e-3 else self.surface_m
        return self.stiffness_n_m * max(surface_m - z_m, 0.0)


def test_a_zero_that_has_changed_is_looked_at_at_every_station() -> None:
    bed = Bump(SimulatedClock())
    ran = run_springs(
        bed, SpringStage(bed), [SpringSensor(bed)], rig=spring_rig(scan={"stations": 2})
    )
    assert "presses on something where the force is taken as zero" in ran.reason
    assert ran.complete == [0]
    approaches = [
        e for e in ran.events if isinstance(e, PhaseEntered) if e.phase is Phase.APPROACHING
    ]
    assert len(approaches) == 1


def moved(monitor: SafetyMonitor) -> None:
    monitor.move(Pose(0.0, 0.0, 1e-3), 5e-3)


def homed(monitor: SafetyMonitor) -> None:
    monitor.home()


@pytest.mark.parametrize("order", [moved, homed])
def test_nothing_moves_after_a_trip_but_the_way_out(order: Callable[[SafetyMonitor], None]) -> None:
    _, stage, sensor = on_simulated_springs()
    monitor = monitor_of(stage, sensor, threaded=False, lift_z_m=5e-3)
    monitor.start()
    monitor.object("cell", "force 2 N; the limit is 1 N", can_retract=False)
    with pytest.raises(DeviceFault, match="force 2 N"):
        order(monitor)
    assert {what for _, what in stage.orders} == {"stop"}


class Rated(SpringSensor):
    """Of a rate and a noise."""

    def __init__(self, bed: Bed, rate_hz: float, noise_n: float, seed: int) -> None:
        super().__init__(bed, seed=seed)
        self.rate_hz, self.noise_n = rate_hz, noise_n

    def raw(self, time_s: float) -> float:
        return self.bed.force_n(time_s) + self.noise_n * float(self._rng.standard_normal())


@settings(max_examples=25, deadline=None)
@given(
    stiffness_n_mm=st.floats(1.0, 10.0),
    rate_hz=st.sampled_from([100.0, 200.0, 500.0, 1000.0]),
    ramp_s=st.floats(0.5, 3.0),
    acceleration_m_s2=st.floats(0.05, 10.0),
    noise_n=st.floats(0.0, 5e-3),
    seed=st.integers(0, 2**16),
)
def test_the_force_goes_no_further_than_the_stopping_distance(
    stiffness_n_mm: float, rate_hz: float, ramp_s: float, acceleration_m_s2: float,
    noise_n: float, seed: int,
) -> None:  # fmt: skip
    """k (v (2 / rate + wire) + v^2 / 2a) + 5 sigma, where in simulated time the guards look at two
    samples at once: the first beyond the limit is up to one period late, and seen two later."""
    bed = Bed(SimulatedClock(), 1e3 * stiffness_n_mm)
    stage, sensor = SpringStage(bed), Rated(bed, rate_hz, noise_n, seed)
    stage.acceleration = acceleration_m_s2
    speed_m_s = 2.5e-3 / ramp_s
    rig = spring_rig(
        scan={"ramp_s": ramp_s, "approach_mm_s": 1e3 * speed_m_s, "travel_mm_s": 5.0},
        safety={"hardest_n_mm": 1.2 * stiffness_n_mm, "max_force_n": 3.0, "max_depth_mm": 4.0},
    )
    ran = run_springs(bed, stage, [sensor], rig=rig)
    way_m = speed_m_s * 3 / rate_hz + speed_m_s**2 / (2 * acceleration_m_s2)
    assert ran.force_n.max() <= 3.0 + stiffness_n_mm * 1e3 * way_m + 5 * noise_n
    assert ran.lifted


def test_a_lift_is_given_up_ten_seconds_after_twice_its_time() -> None:
    class Weak(SpringStage):
        """Has no force left to lift."""

        def move(self, target: Pose, speed_m_s: float) -> None:
            if target.z > self.pose().z and self.orders and self.orders[-1][1] == "stop":
                return
            super().move(target, speed_m_s)

    bed, _, sensor = on_simulated_springs(stiffness_n_m=1000.0)
    stage = Weak(bed)
    ran = run_springs(bed, stage, [sensor])
    assert not ran.lifted
    tripped_s = next(time_s for time_s, what in stage.orders if what == "stop")
    assert ran.ended is not None
    rose_m = 2e-3 - bed.tip.point(bed.clock.now())[2]
    lift_m_s = 0.25 * limits_for(spring_rig(), plan_for(spring_rig())).max_speed_m_s
    assert ran.ended.time_s - tripped_s == pytest.approx(10.0 + 2 * rose_m / lift_m_s, abs=0.2)
