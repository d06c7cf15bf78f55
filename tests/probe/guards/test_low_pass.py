"""A sensor with a low pass of its own: the force is ahead of what it reads."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from springs import Bed, SpringSensor, SpringStage, spring_rig

from drivers import Block, Channel, ConfigError, SimulatedClock
from probe.config.devices import Devices
from probe.config.rig import Rig
from probe.config.scan_limits import limits_for
from probe.config.scan_plan import plan_for
from probe.guards.force_limit import SensorGuard
from probe.guards.low_pass import WINDOW_SHARE, LowPass
from probe.guards.prepare import prepare
from probe.scan.engine import run_scan


class Slow(SpringSensor):
    """Behind a low pass of first order."""

    def __init__(self, bed: Bed, filter_s: float, noise_n: float = 0.5e-3, seed: int = 0) -> None:
        super().__init__(bed, seed=seed)
        self.filter_s, self.noise_n, self.read_n = filter_s, noise_n, 0.0

    def raw(self, time_s: float) -> float:
        share = 1 - math.exp(-1 / (self.rate_hz * self.filter_s))
        self.read_n += share * (self.bed.force_n(time_s) - self.read_n)
        return self.read_n + self.noise_n * float(self._rng.standard_normal())


def rig_of(speed_mm_s: float, filter_s: float, hardest_n_mm: float = 0.5) -> Rig:
    return spring_rig(
        scan={"indentation_mm": 2.4, "ramp_s": 2.4 / speed_mm_s, "approach_mm_s": speed_mm_s},
        safety={"max_force_n": 4.0, "hardest_n_mm": hardest_n_mm, "max_depth_mm": 4.0},
    ).model_copy(update={"sensor": (spring_sensor(filter_s),)})


def spring_sensor(filter_s: float) -> object:
    return Rig.model_validate(
        {"sensor": [{"driver": "virtual", "filter_s": filter_s}], "face_mm2": 100.0}
    ).sensor[0]


def greatest_n(sensor: Slow, rig: Rig) -> float:
    """The true force of one press."""
    bed, plan = sensor.bed, plan_for(rig)
    limits = replace(limits_for(rig, plan), filter_s={sensor.name: rig.sensor[0].filter_s})
    if not rig.sensor[0].filter_s:
        limits = replace(limits, filter_s={})
    run_scan(plan, SpringStage(bed), [sensor], bed.clock, lambda _event: None, limits)
    return float(bed.truth()[1].max())


def test_the_limit_holds_the_force_and_not_what_a_slow_cell_reads_of_it() -> None:
    """A spring of 3 N/mm at 1.2 mm/s behind half a second: 1.8 N are not read yet."""
    bed = Bed(SimulatedClock(), 3e3)
    assert greatest_n(Slow(bed, 0.5), rig_of(1.2, 0.0, 10.0)) > 5.5
    bed = Bed(SimulatedClock(), 3e3)
    assert 3.9 < greatest_n(Slow(bed, 0.5), rig_of(1.2, 0.5, 10.0)) < 4.25


@settings(max_examples=20, deadline=None)
@given(
    stiffness_n_mm=st.floats(2.0, 10.0),
    speed_mm_s=st.floats(0.5, 2.4),
    filter_s=st.floats(0.01, 1.0),
    noise_n=st.floats(0.2e-3, 2e-3),
    seed=st.integers(0, 2**16),
)
def test_the_stopping_distance_of_a_slow_cell(
    stiffness_n_mm: float, speed_mm_s: float, filter_s: float, noise_n: float, seed: int
) -> None:
    """A tenth of the filter's time is left, and its slope is as uncertain as the page says."""
    bed = Bed(SimulatedClock(), 1e3 * stiffness_n_mm)
    sensor = Slow(bed, filter_s, noise_n, seed)
    most_n = greatest_n(sensor, rig_of(speed_mm_s, filter_s, 1.2 * stiffness_n_mm))
    readings = max(WINDOW_SHARE * filter_s * sensor.rate_hz, 3)
    sigma_n = noise_n * math.sqrt(1 + 12 * (filter_s * sensor.rate_hz) ** 2 / readings**3)
    way_mm = speed_mm_s * (3 / sensor.rate_hz + filter_s / 10) + speed_mm_s**2 / 2e3
    assert 3.5 < most_n <= 4.0 + stiffness_n_mm * way_mm + 5 * sigma_n


def test_a_force_that_falls_is_judged_as_read() -> None:
    t = np.arange(100) / 100.0
    falls = np.exp(-t / 0.1)[:, None]
    assert LowPass(0.5).behind(t, falls) == pytest.approx(falls)


def test_a_guard_forgets_the_slope_at_a_tare() -> None:
    rig = rig_of(1.2, 0.5)
    guard = SensorGuard(
        (Channel("force", "N", "force"),), limits_for(rig, plan_for(rig)), filter_s=0.5
    )

    def check(first_s: float, force_n: float) -> str | None:
        time_s = first_s + np.arange(5) * 2e-3
        values = np.full((5, 1), force_n) + 1e-4 * np.arange(5)[:, None]
        return guard.check(Block(time_s, values, np.zeros((5, 1), bool)))

    assert check(0.0, -2.0) is None
    guard.tare()
    assert check(0.01, 0.05) is None
    assert "behind the sensor's low pass" in str(check(0.02, 2.0))  # which a tare does not explain


def prepared(filter_s: float, speed_mm_s: float) -> tuple[float, tuple[str, ...]]:
    bed, rig = Bed(SimulatedClock()), rig_of(speed_mm_s, filter_s, 10.0)
    rig = rig.model_copy(update={"face_mm2": 100.0})
    plan = plan_for(rig)
    devices = Devices(SpringStage(bed), (SpringSensor(bed),), None, ())
    ready = prepare(rig, plan, limits_for(rig, plan), None, devices, 0)
    assert ready.limits.filter_s == ({"cell": filter_s} if filter_s else {})
    return ready.plan.settle_s, ready.notes


def test_a_press_too_fast_for_a_slow_cell_is_refused_and_a_tare_waits_for_it() -> None:
    assert prepared(0.0, 2.4)[0] == 0.05
    settle_s, notes = prepared(0.1, 2.4)
    assert settle_s == pytest.approx(0.5)
    assert any("low pass of 0.1 s" in note and "is read at 80 %" in note for note in notes)
    with pytest.raises(ConfigError, match=r"low pass of 0.5 s \(filter_s\); at most 0.784 mm/s"):
        prepared(0.5, 2.4)
