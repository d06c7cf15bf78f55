"""A press to a force: how well it is met, whatever lies beneath, and what ends it otherwise."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from springs import Bed, Ran, SpringSensor, SpringStage, clipped, run_springs, spring_rig

from drivers import Block, SimulatedClock
from probe.config.rig import Rig
from probe.core.events import Event, Finish, Phase, PhaseEntered
from probe.guards.commands import Control
from probe.scan.resume import resume
from probe.scan.session import scan
from probe.storage.run import open_run

SENSOR_LATE_S = 0.02  # as much as emulated sensors, with what an engine needs to see it


class Hertz(Bed):
    """A bed whose force is as a power of the depth; ``stiffness_n_m`` is that at 2 mm."""

    power = 1.0

    def force_n(self, time_s: float) -> float:
        return float(self.force_at(self.tip.point(time_s)[2]))

    def force_at(self, height_m: Any) -> Any:
        deep_m = np.maximum(self.surface_m - height_m, 0.0)
        return self.stiffness_n_m * deep_m * (deep_m / 2e-3) ** (self.power - 1)


class LateSensor(SpringSensor):
    """What it says is `SENSOR_LATE_S` old."""

    noise_n = 0.5e-3

    def raw(self, time_s: float) -> float:
        noise_n = self.noise_n * float(self._rng.standard_normal())
        return self.says(self.bed.force_n(time_s - SENSOR_LATE_S), noise_n, time_s)


class LostSensor(LateSensor):
    """Nothing comes any more from 0.3 N on."""

    def read(self) -> Block:
        block = super().read()
        return block if self.bed.force_n(self.bed.clock.now()) < 0.3 else self.block([], [])


class SlowerSensor(LateSensor):
    """It gives a quarter of the readings that it says, as an arm's older controller does."""

    def read(self) -> Block:
        block = super().read()
        given = np.round(block.time_s * self.rate_hz).astype(int) % 4 == 0
        return self.block(block.time_s[given], block.values[given])


class Braking(SpringStage):
    """As slow to stop as line stages are, 50 mm/s2."""

    acceleration = 0.05


def pressed(
    force_n: float, bed: Bed | None = None, sensor: SpringSensor | None = None, **scan: Any
) -> tuple[Ran, Bed]:
    """One press to a force, 2.5 mm deep at most, on what may be as hard as 5 N/mm."""
    bed = bed or Hertz(SimulatedClock())
    keys = {"force_n": force_n, **scan}
    rig = spring_rig(scan=keys, safety={"max_force_n": 5.0, "hardest_n_mm": 5.0})
    return run_springs(bed, Braking(bed), [sensor or LateSensor(bed)], rig=rig), bed


@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("stiffness_n_m, force_n", [
    (40.0, 0.08), (400.0, 0.1), (400.0, 0.8), (4000.0, 0.1), (4000.0, 0.8), (4000.0, 4.0),
])  # fmt: skip
def test_a_force_is_met_to_5_per_cent_and_not_exceeded_by_more(
    stiffness_n_m: float, force_n: float, power: float
) -> None:
    """Springs as the paper's finger has them on 5 to 500 kPa."""
    bed = Hertz(SimulatedClock(), stiffness_n_m)
    bed.power = power
    ran, _ = pressed(force_n, bed)
    assert ran.finish is Finish.COMPLETED, ran.reason
    assert bed.force_at(ran.height_m).max() == pytest.approx(force_n, rel=0.05)
    assert ran.complete == [0]
    assert ran.lifted


def test_a_surface_that_lies_deeper_than_planned_is_met_as_well() -> None:
    ran, bed = pressed(0.8, Hertz(SimulatedClock(), 4000.0, surface_m=-1e-3))
    assert ran.finish is Finish.COMPLETED, ran.reason
    assert bed.force_at(ran.height_m).max() == pytest.approx(0.8, rel=0.05)


def test_where_the_depth_ends_first_the_press_is_held_there_and_says_so() -> None:
    ran, _ = pressed(2.0)  # of springs that give 1 N
    assert ran.finish is Finish.COMPLETED, ran.reason
    assert ran.height_m.min() == pytest.approx(-2.5e-3, abs=1e-6)
    (note,) = (note for note in ran.notes if "asked for" in note)
    assert note.startswith("station 1: pressed to 1 N, 2.50 mm deep, and not to the 2 N asked for")


def test_a_force_within_the_noise_is_a_fault_and_no_press() -> None:
    bed = Hertz(SimulatedClock())
    sensor = LateSensor(bed, rate_hz=100.0)
    sensor.noise_n = 0.1
    ran, _ = pressed(0.5, bed, sensor)
    assert ran.finish is Finish.FAULTED
    assert "0.5 N are too little to press to by cell" in ran.reason
    assert ran.height_m.min() > -1e-6


def test_noise_ends_no_press_far_from_its_force() -> None:
    """Neither too late, nor by a step after a stiffness that noise made too small."""
    reached_n = []
    for seed in range(12):
        bed = Hertz(SimulatedClock(), 1040.0)
        bed.power = 1.2
        sensor = LateSensor(bed, rate_hz=100.0, seed=seed)
        sensor.noise_n = 0.02
        ran, _ = pressed(0.5, bed, sensor)
        assert ran.finish is Finish.COMPLETED, ran.reason
        reached_n.append(bed.force_at(ran.height_m).max())
    error_n = 0.02 * np.sqrt(2 / 10)  # of the level and its zero
    assert np.abs(np.array(reached_n) - 0.5).max() < 0.05 * 0.5 + 2 * error_n


def test_a_sensor_that_is_slower_than_it_says_ends_a_press_as_well() -> None:
    bed = Hertz(SimulatedClock(), 1200.0)
    sensor = SlowerSensor(bed)
    sensor.noise_n = 0.014  # 3 of its readings show the force, and one or two are there
    ran, _ = pressed(0.5, bed, sensor)
    assert ran.finish is Finish.COMPLETED, ran.reason
    assert bed.force_at(ran.height_m).max() == pytest.approx(0.5, rel=0.08)


@pytest.mark.parametrize("stiffness_n_m, at_n", [
    (2000.0, 1.0), (2000.0, 1.3), (2000.0, 1.4), (4000.0, 0.8),
])  # fmt: skip
def test_a_sensor_that_clips_just_below_the_force_takes_no_press_to_its_depth(
    stiffness_n_m: float, at_n: float
) -> None:
    """The steps after the way down are too short for a guard to judge any of them."""
    bed = Hertz(SimulatedClock(), stiffness_n_m)
    bed.power = 1.2
    ran, _ = pressed(1.5, bed, LateSensor(bed, says=clipped(at_n)))
    assert ran.finish is Finish.FAULTED
    assert "cell: the force changed by" in ran.reason
    assert ran.lifted
    assert bed.force_at(ran.height_m).max() < 1.3 * 1.5


@pytest.mark.parametrize("sensor, said", [
    (LostSensor, "silent for"),
    (lambda bed: LateSensor(bed, says=clipped(0.6)), "the sensor clips"),
])  # fmt: skip
def test_a_sensor_that_fails_on_the_way_to_a_force_lifts_the_probe(sensor: Any, said: str) -> None:
    bed = Hertz(SimulatedClock(), 1200.0)
    ran, _ = pressed(1.5, bed, sensor(bed))
    assert ran.finish is Finish.FAULTED
    assert said in ran.reason
    assert ran.lifted
    assert ran.complete == []
    assert bed.force_at(ran.height_m).max() < 1.5


def test_a_resumed_scan_presses_to_the_same_force(tmp_path: Path, winkler: Any) -> None:
    control = Control()

    def impatient(event: Event) -> None:
        if isinstance(event, PhaseEntered) and (event.station, event.phase) == (1, Phase.HOLDING):
            control.abort()

    rig = {"scan": {"stations": 2, "force_n": 0.5}, "safety": {"hardest_n_mm": 1.0}}
    begun = scan(Rig.model_validate(rig), "TI", tmp_path, control=control, observers=[impatient],
                 respond=winkler)  # fmt: skip
    run = open_run(resume(begun.path, respond=winkler).path)
    assert run.config["plan"]["force_n"] == 0.5
    levels_pa = [station.hold_level_pa for station in run.recording().stations]
    face_m2 = run.recording().face_m2
    assert np.array(levels_pa) * face_m2 == pytest.approx([0.5, 0.5], rel=0.05)
