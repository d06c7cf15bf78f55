"""What each channel reads now: against sensors whose readings are known functions of time."""

from dataclasses import replace

import numpy as np
import pytest
from one_sensor import FunctionSensor

from drivers import SimulatedClock
from probe.checks.watch import Watch


def follow(clock, watched, until_s):
    readings = watched.readings()
    while clock.now() < until_s:
        clock.sleep_until(clock.now() + 0.1)
        readings = watched.readings()
    return readings


def test_value_rate_noise_drift_age_and_tare():
    clock = SimulatedClock()
    rng = np.random.default_rng(1)
    sensor = FunctionSensor(
        clock, lambda t: np.where(t < 5, 2.0, 3.0) + 0.01 * rng.standard_normal(len(t))
    )
    with Watch([sensor], clock) as watched:
        (before,) = follow(clock, watched, 0.5)
        assert before.tared is None  # nothing to tare against yet
        follow(clock, watched, 4.0)
        (now,) = follow(clock, watched, 8.0)
        assert (now.sensor, now.channel.name, now.fault) == ("gauge", "force", None)
        assert now.raw == pytest.approx(3.0, abs=0.005)
        assert now.tared == pytest.approx(1.0, abs=0.01)
        assert now.noise == pytest.approx(0.01, rel=0.4)
        assert now.rate_hz == pytest.approx(100)
        assert now.wanted_hz == 100
        assert now.age_s == pytest.approx(0.01, abs=0.02)
        assert now.row()[0] == "gauge.force"
        assert float(now.row()[1]) == pytest.approx(3.0, abs=0.006)
        watched.tare()
        (tared,) = follow(clock, watched, 8.5)
        assert tared.tared == pytest.approx(0.0, abs=0.01)
        assert tared.raw == pytest.approx(3.0, abs=0.01)
        assert not replace(tared, tared=-1e-5).row()[2].startswith("-"), "never -0.000"
    assert not sensor.running


def test_a_ramp_is_drift_not_noise():
    clock = SimulatedClock()
    with Watch([FunctionSensor(clock, lambda t: 0.5 * t)], clock) as watched:
        (now,) = follow(clock, watched, 3.0)
    assert now.drift == pytest.approx(0.5)
    assert now.noise == pytest.approx(0.0, abs=1e-9)
    assert "e" not in "".join(now.row()[4:6])  # never 5e-01


def test_a_silent_sensor_grows_old_and_a_lost_one_says_so_while_others_go_on():
    clock = SimulatedClock()
    silent = FunctionSensor(clock, lambda t: 0 * t + 7.0, silent_s=2.0)
    lost = FunctionSensor(clock, lambda t: 0 * t, fails_s=2.0)
    good = FunctionSensor(clock, np.sin)
    with Watch([silent, lost, good], clock) as watched:
        old, gone, live = follow(clock, watched, 6.0)
    assert old.age_s == pytest.approx(4.0, abs=0.2)
    assert old.raw == 7.0
    assert old.fault is None
    assert "unplugged" in gone.fault
    assert "unplugged" in gone.row()[-1]
    assert live.age_s < 0.05


def test_a_clipped_reading_is_marked():
    clock = SimulatedClock()
    with Watch([FunctionSensor(clock, lambda t: np.where(t > 1, 2e3, 1.0))], clock) as watched:
        assert not follow(clock, watched, 0.9)[0].clipped
        assert follow(clock, watched, 2.0)[0].row()[-1] == "clipped"


class Untimely(FunctionSensor):
    """Its samples carry ``stamp`` of their times."""

    stamp = staticmethod(lambda time_s: time_s)

    def read(self):
        block = super().read()
        return replace(block, time_s=self.stamp(block.time_s))


@pytest.mark.parametrize("stamp, why", [
    (lambda t: 1e3 * t, "sample times jump"),  # milliseconds
    (lambda t: 1.8e9 + t, "the scan's clock says"),  # since 1970
    (lambda t: t - 1e4, "late by their own times"),  # of a device that was just switched on
    (lambda t: -t, "sample times jump"),
])  # fmt: skip
def test_times_that_are_not_the_scans_are_a_fault(stamp, why):
    clock = SimulatedClock(50.0)
    odd, good = Untimely(clock, np.sin), FunctionSensor(clock, np.sin)
    odd.stamp = stamp
    with Watch([odd, good], clock) as watched:
        wrong, right = follow(clock, watched, 53.0)
    assert why in wrong.fault
    assert right.fault is None


def test_who_looks_seldom_finds_no_fault():
    clock = SimulatedClock()
    silent = FunctionSensor(clock, np.sin, silent_s=2.0)
    with Watch([silent, FunctionSensor(clock, np.sin)], clock) as watched:
        follow(clock, watched, 1.0)
        clock.sleep_until(60.0)
        assert [one.fault for one in watched.readings()] == [None, None]


class Mistaken(FunctionSensor):
    """A driver of others, with a mistake in ``start`` or ``read``."""

    wrong = "start"

    def start(self):
        super().start()
        if self.wrong == "start":
            raise ValueError("no such mode")

    def read(self):
        if self.wrong == "read":
            raise ValueError("no such mode")
        return super().read()


@pytest.mark.parametrize("wrong", ["start", "read"])
def test_a_drivers_mistake_is_its_fault_and_others_go_on(wrong):
    clock = SimulatedClock()
    bad, good = Mistaken(clock, np.sin), FunctionSensor(clock, np.sin)
    bad.wrong = wrong
    with Watch([bad, good], clock) as watched:
        gone, live = follow(clock, watched, 2.0)
    assert gone.fault == "gauge: driver: ValueError: no such mode"
    assert (live.fault, live.age_s < 0.05) == (None, True)
