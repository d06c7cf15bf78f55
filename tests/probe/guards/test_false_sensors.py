"""Sensors that do not tell what they feel, in simulated time; judged by the bed's true force.

On the wall clock the fault campaign has such sensors.
"""

import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from springs import (
    HARD_N_M,
    LIMIT_N,
    SLOW,
    SOFT_N_M,
    SpringSensor,
    on_simulated_springs,
    run_springs,
    spring_rig,
)

import palpate
from drivers import Block
from probe.core.events import Event, Finish, Note, Phase, PhaseEntered, Samples, StationEnded
from probe.guards.commands import Control


def hold_n(events: list[Event], station: int) -> float:
    """Mean force that was stored of a station's hold."""
    here = False
    forces: list[float] = []
    for event in events:
        if isinstance(event, PhaseEntered):
            here = event.phase is Phase.HOLDING and event.station == station
        if here and isinstance(event, Samples) and event.device == "cell":
            forces += [float(force) for force in event.block.values[:, 0]]
    return float(np.mean(forces))


class Stuck(SpringSensor):
    def raw(self, _time_s: float) -> float:
        return 0.0123


class StuckSlowly(Stuck):
    """Has said less than a hundred equal things when the tare changes what it says."""

    rate_hz = 100.0


class Clips(SpringSensor):
    def raw(self, time_s: float) -> float:
        return min(super().raw(time_s), 0.9)


class Deaf(SpringSensor):
    """Fresh noise and nothing else: its cable to the probe is loose."""

    def raw(self, _time_s: float) -> float:
        return 0.5e-3 * float(self._rng.standard_normal())


class ClipsAndHums(SpringSensor):
    """Clips below its full scale without a word, and its amplifier adds the noise afterwards."""

    def raw(self, time_s: float) -> float:
        return min(self.bed.force_n(time_s), 0.6) + 0.5e-3 * float(self._rng.standard_normal())


class TurnsOver(SpringSensor):
    """A mount that gives way: the more it bends, the less it feels."""

    def raw(self, time_s: float) -> float:
        force = super().raw(time_s)
        return force if force < 0.6 else 1.2 - force


@pytest.mark.parametrize("sensor", [ClipsAndHums, TurnsOver])
@pytest.mark.parametrize(
    ("stiffness_n_m", "surface_m"),
    # the last is met already by the approach, and the press begins in it
    [(SOFT_N_M, 0.0), (HARD_N_M / 2, 0.0), (SOFT_N_M, 0.9e-3)],
)
def test_a_force_that_stops_to_rise_is_not_believed(
    sensor: Any, stiffness_n_m: float, surface_m: float
) -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=stiffness_n_m, surface_m=surface_m)
    ran = run_springs(bed, stage, [sensor(bed)], rig=SLOW)
    assert "the sensor clips or does not feel, or what is pressed gives way" in ran.reason
    # a quarter deeper than where it clipped, and what poses and stops take: 0.05 mm
    assert ran.force_n.max() < 1.25 * 0.6 + stiffness_n_m * 0.05e-3
    assert ran.lifted


def test_what_is_harder_than_was_said_is_not_pressed() -> None:
    bed, stage, sensor = on_simulated_springs(stiffness_n_m=6e3)
    rig = spring_rig(scan={"approach_mm_s": 2.0, "ramp_s": 1.0})
    ran = run_springs(bed, stage, [sensor], rig=rig)
    assert "harder than safety.hardest_n_mm = 1" in ran.reason
    assert ran.force_n.max() < LIMIT_N
    assert ran.lifted


@pytest.mark.parametrize(
    ("sensor", "said", "most_n"),
    [
        (Stuck, "stuck or clipped", 0.0),
        (StuckSlowly, "stuck or clipped", 0.3),
        (Clips, "stuck or clipped", LIMIT_N),
        (Deaf, "no force above the noise", 0.52),  # only a press shows that: 1.25 mm, and stopping
    ],
)
def test_a_sensor_that_does_not_feel_is_found_out(sensor: Any, said: str, most_n: float) -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=HARD_N_M if sensor is not Deaf else 400.0)
    ran = run_springs(bed, stage, [sensor(bed)], rig=SLOW)
    assert ran.ended is not None
    assert ran.ended.finish is Finish.FAULTED
    assert said in ran.reason
    assert ran.force_n.max() <= most_n
    assert ran.lifted


def test_a_load_is_not_taken_as_zero() -> None:
    bed, stage, sensor = on_simulated_springs(
        stiffness_n_m=600.0, surface_m=4.4e-3, home=(0.0, 0.0, 10e-3)
    )
    ran = run_springs(bed, stage, [sensor])
    assert "presses on something where the force is taken as zero" in ran.reason
    assert ran.force_n.max() < LIMIT_N
    assert not any(
        isinstance(event, PhaseEntered) and event.phase is Phase.APPROACHING for event in ran.events
    )


def test_a_drift_is_taken_as_zero_once_it_is_seen_to_be_one() -> None:
    bed, stage, _ = on_simulated_springs()

    class Drifts(SpringSensor):
        def raw(self, time_s: float) -> float:
            return super().raw(time_s) + 0.1 * time_s

    ran = run_springs(bed, stage, [Drifts(bed)], rig=spring_rig(scan={"stations": 2}))
    assert ran.reason == "every station is complete"


class DriftsFast(SpringSensor):
    """From the first hold on, so that it passes the limit before the next tare."""

    since_s = math.inf

    def raw(self, time_s: float) -> float:
        if self.bed.tip.point(time_s)[2] < -2.4e-3:
            self.since_s = min(self.since_s, time_s)
        return super().raw(time_s) - 0.55 * max(time_s - self.since_s, 0.0)


def test_a_press_whose_zero_is_never_seen_again_is_noted() -> None:
    """Its forces are off by the drift, and the fault that ends the scan comes after it."""
    bed, stage, _ = on_simulated_springs()
    rig = spring_rig(scan={"stations": 2, "travel_mm_s": 2.0})
    ran = run_springs(bed, stage, [DriftsFast(bed)], rig=rig)
    assert ran.ended is not None
    assert ran.ended.finish is Finish.FAULTED
    assert sum(isinstance(e, StationEnded) and e.complete for e in ran.events) == 1
    assert any("whether its zero moved in the last press is not known" in n for n in ran.notes)


class Shaken(SpringSensor):
    """Something knocks against the probe for `lasts_s` from its rest over the second station."""

    lasts_s, knock_n, since_s = 0.7, 0.25, math.inf

    def raw(self, time_s: float) -> float:
        x_m, _, z_m = self.bed.tip.point(time_s)
        above = x_m > 3.9e-3 and z_m > 1.9e-3
        if above and not self.bed.tip.moving(time_s):
            self.since_s = min(self.since_s, time_s)
        knocked = above and 0 <= time_s - self.since_s < self.lasts_s and int(20 * time_s) % 2
        return super().raw(time_s) + (self.knock_n if knocked else 0.0)


class ShakenForLong(Shaken):
    lasts_s = 5.0


def test_no_zero_is_taken_while_something_knocks_against_the_probe() -> None:
    bed, stage, _ = on_simulated_springs()
    ran = run_springs(bed, stage, [Shaken(bed)], rig=spring_rig(scan={"stations": 2}))
    assert ran.reason == "every station is complete"
    assert hold_n(ran.events, station=1) == pytest.approx(SOFT_N_M * 2.5e-3, abs=0.02)


def test_a_zero_that_was_taken_while_something_knocked_is_reported() -> None:
    bed, stage, _ = on_simulated_springs()
    ran = run_springs(bed, stage, [ShakenForLong(bed)], rig=spring_rig(scan={"stations": 2}))
    assert ran.reason == "every station is complete"
    assert any("at rest in the air, where its zero is taken" in note for note in ran.notes)


class ClipsLow(SpringSensor):
    """At a fiftieth of the limit."""

    most_n = 0.03

    def raw(self, time_s: float) -> float:
        noise_n = 0.5e-3 * float(self._rng.standard_normal())
        return min(self.bed.force_n(time_s), self.most_n) + noise_n


class ClipsFaintly(ClipsLow):
    """At 24 standard deviations of its noise."""

    most_n = 0.012


@pytest.mark.parametrize("stiffness_n_m", [SOFT_N_M, HARD_N_M])
@pytest.mark.parametrize(("sensor", "most_m"), [(ClipsLow, 0.65e-3), (ClipsFaintly, 1.1e-3)])
def test_a_sensor_that_clips_far_below_the_limit_does_not_pass_for_soft_tissue(
    sensor: Any, most_m: float, stiffness_n_m: float
) -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=stiffness_n_m)
    ran = run_springs(bed, stage, [sensor(bed)], rig=SLOW)
    assert "mm deeper" in ran.reason
    assert ran.force_n.max() < stiffness_n_m * most_m
    assert ran.lifted


class ClipsLate(SpringSensor):
    """In the last seventh of a press of 2.5 mm, and hums."""

    def raw(self, time_s: float) -> float:
        force = min(self.bed.force_n(time_s), 0.85 * 2.5e-3 * self.bed.stiffness_n_m)
        return force + 0.5e-3 * float(self._rng.standard_normal())


def test_a_sensor_that_clips_at_the_end_of_a_press_is_found_out_in_the_hold() -> None:
    bed, stage, _ = on_simulated_springs()
    ran = run_springs(bed, stage, [ClipsLate(bed)], rig=SLOW)
    assert "the sensor clips or does not feel, or what is pressed gives way" in ran.reason
    assert not any(event.complete for event in ran.events if isinstance(event, StationEnded))
    assert ran.lifted


class Noisy(SpringSensor):
    """So much that contact is known at half of the force."""

    def raw(self, time_s: float) -> float:
        return self.bed.force_n(time_s) + 0.05 * float(self._rng.standard_normal())


def test_a_noisy_sensor_on_a_short_way_is_believed() -> None:
    bed, stage, _ = on_simulated_springs()
    assert run_springs(bed, stage, [Noisy(bed)], rig=SLOW).reason == "every station is complete"


class Coarse(SpringSensor):
    """Tells twentieths of a newton, and its noise is far less."""

    def raw(self, time_s: float) -> float:
        return 0.05 * round((super().raw(time_s) + 0.01) / 0.05)


def test_a_coarse_sensor_on_soft_tissue_is_believed() -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=60.0)
    rig = spring_rig(safety={"same_readings": 10_000})
    assert run_springs(bed, stage, [Coarse(bed)], rig=rig).reason == "every station is complete"


class ClipsLast(ClipsLow):
    """Over the last 0.1 mm of 2.5, in which a stage at 25 mm/s may be 0.2 mm from its pose."""

    most_n = 0.96


class Beats(SpringSensor):
    """A vessel's, a tenth of the force, at 1.2 Hz."""

    def raw(self, time_s: float) -> float:
        return super().raw(time_s) * (1 + 0.05 * math.sin(2 * math.pi * 1.2 * time_s))


FAST = spring_rig(scan={"ramp_s": 0.1, "hold_s": 0.4}, safety={"retract_mm": 5.0})


def test_a_sensor_that_clips_in_the_last_of_a_press_is_noted_when_the_lift_begins() -> None:
    bed, stage, _ = on_simulated_springs()
    ran = run_springs(bed, stage, [ClipsLast(bed)], rig=FAST)
    assert ran.reason == "every station is complete"
    (reported,) = [text for text in ran.notes if "the sensor clips there" in text]
    assert reported.startswith("cell: the force stayed at 0.960 N")
    assert "while the tip rose by 0.07 mm" in reported


@pytest.mark.parametrize("sensor", [SpringSensor, Beats, Noisy, Coarse])
def test_a_force_that_falls_or_that_noise_hides_is_not_taken_for_one_that_clips(
    sensor: Any,
) -> None:
    bed, stage, _ = on_simulated_springs()
    stations = 12 if sensor is Beats else 1
    rig = spring_rig(scan={"stations": stations}, safety={"same_readings": 10_000})
    ran = run_springs(bed, stage, [sensor(bed)], rig=rig)
    assert ran.reason == "every station is complete"
    assert not [text for text in ran.notes if "clips" in text]


class BelowZero(SpringSensor):
    """Slow, and far below zero before its tare."""

    rate_hz = 50.0

    def raw(self, time_s: float) -> float:
        return super().raw(time_s) - 0.3


def test_what_a_tare_changes_is_no_contact() -> None:
    bed, stage, _ = on_simulated_springs(home=(0.0, 0.0, 10e-3))
    rig = spring_rig(scan={"approach_mm_s": 2.0}, safety={"retract_mm": 5.0})
    ran = run_springs(bed, stage, [BelowZero(bed)], rig=rig)
    assert ran.reason == "every station is complete"


class ClipsAtOnce(SpringSensor):
    """At less than the guards can tell from noise."""

    def raw(self, time_s: float) -> float:
        return min(self.bed.force_n(time_s), 0.006) + 0.5e-3 * float(self._rng.standard_normal())


def test_a_press_that_feels_next_to_nothing_is_reported_once() -> None:
    bed, stage, _ = on_simulated_springs()
    ran = run_springs(bed, stage, [ClipsAtOnce(bed)])
    notes = [event.text for event in ran.events if isinstance(event, Note)]
    (reported,) = [text for text in notes if "a sensor that clips" in text]
    assert reported.startswith("cell 0.0")
    assert "N in a hold, at max_force_n = 1.6" in reported


class SlowAfterThePress(SpringSensor):
    """Skips all but one reading in 1.2 s once the probe is up again."""

    pressed, next_s = False, 0.0

    def block(self, time_s: Any, force: Any) -> Block:
        height_m = self.bed.tip.point(self.bed.clock.now())[2]
        self.pressed = self.pressed or height_m < -1e-3
        given = np.full(len(time_s), True)
        if self.pressed and height_m > 1.9e-3:
            for k, t in enumerate(time_s):
                given[k] = t >= self.next_s
                self.next_s = t + 1.2 if given[k] else self.next_s
        return super().block(np.asarray(time_s)[given], np.asarray(force)[given])


def test_a_zero_that_cannot_be_looked_at_after_the_last_press_spoils_no_scan() -> None:
    bed, stage, _ = on_simulated_springs()
    ran = run_springs(bed, stage, [SlowAfterThePress(bed)], rig=spring_rig(safety={"silence_s": 2}))
    assert ran.raised is None
    assert ran.reason == "every station is complete"
    assert any("whether its zero moved in the last press is not known" in n for n in ran.notes)


@pytest.mark.parametrize("ramp_s", [1.0, 5.0])
def test_a_lone_vessel_that_beats_against_the_finger_is_no_sensor_that_clips(
    ramp_s: float, tmp_path: Path
) -> None:
    text = (files("sim_backend.scene") / "builtin" / "HAOT.toml").read_text(encoding="utf-8")
    scene = tmp_path / "beating.toml"
    scene.write_text(text.replace('start = "hold"', 'start = "free"'))
    press = {"start_mm": 32.0, "stations": 1, "ramp_s": ramp_s, "hold_s": 0.3}
    ended = palpate.scan(palpate.Rig(scan=press), scene, tmp_path, seed=3).ended
    assert ended.reason == "every station is complete"


def test_a_stop_amid_the_lift_after_a_fault_leaves_no_probe_pressed_unsaid() -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=HARD_N_M / 2)
    control = Control()

    def stop(event: Any) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.STOPPING:
            control.stop()

    ran = run_springs(
        bed, stage, [ClipsAndHums(bed)], rig=SLOW, observers=[stop], sink=stop, control=control
    )
    assert ran.lifted or any("was not lifted" in note for note in ran.notes)
    assert not ran.lifted
