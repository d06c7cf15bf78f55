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
    Says,
    SpringSensor,
    as_it_is,
    clipped,
    on_simulated_springs,
    run_springs,
    spring_rig,
)

import palpate
from drivers import Block
from probe.core.events import Event, Finish, Phase, PhaseEntered, Samples, StationEnded
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


def turned_over(force_n: float, noise_n: float, _time_s: float) -> float:
    """Of a mount that gives way: the more it bends, the less it feels."""
    return force_n + noise_n if force_n + noise_n < 0.6 else 1.2 - force_n - noise_n


def beating(force_n: float, noise_n: float, time_s: float) -> float:
    """Of a vessel, a tenth of the force, at 1.2 Hz."""
    return (force_n + noise_n) * (1 + 0.05 * math.sin(2 * math.pi * 1.2 * time_s))


COARSE = spring_rig(safety={"same_readings": 10_000})
SAYS: dict[str, Says] = {
    "as it is": as_it_is,
    "stuck": lambda _force_n, _noise_n, _time_s: 0.0123,
    "clipped, and its noise": lambda force_n, noise_n, _time_s: min(force_n + noise_n, 0.9),
    "turned over": turned_over,
    "a tenth more with each beat": beating,
    "so noisy that contact is known at half of the force": (
        lambda force_n, noise_n, _time_s: force_n + 100 * noise_n
    ),
    "in twentieths of a newton, its noise far less": (
        lambda force_n, noise_n, _time_s: 0.05 * round((force_n + noise_n + 0.01) / 0.05)
    ),
    "drifting": lambda force_n, noise_n, time_s: force_n + noise_n + 0.1 * time_s,
    "far below zero": lambda force_n, noise_n, _time_s: force_n + noise_n - 0.3,
}


@pytest.mark.parametrize("says", [clipped(0.6), turned_over], ids=["clipped", "turned over"])
@pytest.mark.parametrize(
    ("stiffness_n_m", "surface_m"),
    # the last is met already by the approach, and the press begins in it
    [(SOFT_N_M, 0.0), (HARD_N_M / 2, 0.0), (SOFT_N_M, 0.9e-3)],
)
def test_a_force_that_stops_to_rise_is_not_believed(
    says: Says, stiffness_n_m: float, surface_m: float
) -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=stiffness_n_m, surface_m=surface_m)
    ran = run_springs(bed, stage, [SpringSensor(bed, says=says)], rig=SLOW)
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


@pytest.mark.parametrize("says, rate_hz, stiffness_n_m, said, most_n", [
    ("stuck", 500.0, HARD_N_M, "stuck or clipped", 0.0),
    # has said less than a hundred equal things when the tare changes what it says
    ("stuck", 100.0, HARD_N_M, "stuck or clipped", 0.3),
    ("clipped, and its noise", 500.0, HARD_N_M, "stuck or clipped", LIMIT_N),
])  # fmt: skip
def test_a_sensor_that_does_not_feel_is_found_out(
    says: str, rate_hz: float, stiffness_n_m: float, said: str, most_n: float
) -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=stiffness_n_m)
    ran = run_springs(bed, stage, [SpringSensor(bed, says=SAYS[says], rate_hz=rate_hz)], rig=SLOW)
    assert ran.finish is Finish.FAULTED
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
    assert ran.finish is Finish.FAULTED
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


@pytest.mark.parametrize("lasts_s", [0.7, 5.0])
def test_no_zero_is_taken_while_something_knocks_against_the_probe(lasts_s: float) -> None:
    """Unless it goes on for too long, which is reported."""
    bed, stage, _ = on_simulated_springs()
    shaken = Shaken(bed)
    shaken.lasts_s = lasts_s
    ran = run_springs(bed, stage, [shaken], rig=spring_rig(scan={"stations": 2}))
    assert ran.reason == "every station is complete"
    if lasts_s < 1.0:
        assert hold_n(ran.events, station=1) == pytest.approx(SOFT_N_M * 2.5e-3, abs=0.02)
    else:
        assert any("at rest in the air, where its zero is taken" in note for note in ran.notes)


@pytest.mark.parametrize("stiffness_n_m", [SOFT_N_M, HARD_N_M])
@pytest.mark.parametrize("at_n, most_m", [
    (0.03, 0.65e-3),  # a fiftieth of the limit
    (0.012, 1.1e-3),  # 24 standard deviations of its noise
])  # fmt: skip
def test_a_sensor_that_clips_far_below_the_limit_does_not_pass_for_soft_tissue(
    at_n: float, most_m: float, stiffness_n_m: float
) -> None:
    bed, stage, _ = on_simulated_springs(stiffness_n_m=stiffness_n_m)
    ran = run_springs(bed, stage, [SpringSensor(bed, says=clipped(at_n))], rig=SLOW)
    assert "mm deeper" in ran.reason
    assert ran.force_n.max() < stiffness_n_m * most_m
    assert ran.lifted


def test_a_sensor_that_clips_at_the_end_of_a_press_is_found_out_in_the_hold() -> None:
    """In its last seventh."""
    bed, stage, _ = on_simulated_springs()
    ran = run_springs(
        bed, stage, [SpringSensor(bed, says=clipped(0.85 * 2.5e-3 * SOFT_N_M))], rig=SLOW
    )
    assert "the sensor clips or does not feel, or what is pressed gives way" in ran.reason
    assert not any(event.complete for event in ran.events if isinstance(event, StationEnded))
    assert ran.lifted


@pytest.mark.parametrize("says, stiffness_n_m, rig", [
    ("as it is", SOFT_N_M, spring_rig()),
    ("a tenth more with each beat", SOFT_N_M, spring_rig(scan={"stations": 12})),
    ("so noisy that contact is known at half of the force", SOFT_N_M, SLOW),
    ("so noisy that contact is known at half of the force", SOFT_N_M, spring_rig()),
    ("in twentieths of a newton, its noise far less", 60.0, COARSE),
    ("in twentieths of a newton, its noise far less", SOFT_N_M, COARSE),
    ("drifting", SOFT_N_M, spring_rig(scan={"stations": 2})),
])  # fmt: skip
def test_an_honest_sensor_is_believed(says: str, stiffness_n_m: float, rig: palpate.Rig) -> None:
    """A drift is taken as zero once it is seen to be one; what falls or what noise hides is not
    taken for a sensor that clips."""
    bed, stage, _ = on_simulated_springs(stiffness_n_m=stiffness_n_m)
    ran = run_springs(bed, stage, [SpringSensor(bed, says=SAYS[says])], rig=rig)
    assert ran.reason == "every station is complete"
    assert not [text for text in ran.notes if "clips" in text]


FAST = spring_rig(scan={"ramp_s": 0.1, "hold_s": 0.4}, safety={"retract_mm": 5.0})


def test_a_sensor_that_clips_in_the_last_of_a_press_is_noted_when_the_lift_begins() -> None:
    bed, stage, _ = on_simulated_springs()
    # over the last 0.1 mm of 2.5, in which a stage at 25 mm/s may be 0.2 mm from its pose
    ran = run_springs(bed, stage, [SpringSensor(bed, says=clipped(0.96))], rig=FAST)
    assert ran.reason == "every station is complete"
    (reported,) = [text for text in ran.notes if "the sensor clips there" in text]
    assert reported.startswith("cell: the force stayed at 0.960 N")
    assert "while the tip rose by 0.07 mm" in reported


def test_what_a_tare_changes_is_no_contact() -> None:
    bed, stage, _ = on_simulated_springs(home=(0.0, 0.0, 10e-3))
    rig = spring_rig(scan={"approach_mm_s": 2.0}, safety={"retract_mm": 5.0})
    sensor = SpringSensor(bed, says=SAYS["far below zero"], rate_hz=50.0)
    ran = run_springs(bed, stage, [sensor], rig=rig)
    assert ran.reason == "every station is complete"


def test_a_press_that_feels_next_to_nothing_is_reported_once() -> None:
    bed, stage, _ = on_simulated_springs()
    # at less than the guards can tell from noise
    ran = run_springs(bed, stage, [SpringSensor(bed, says=clipped(0.006))])
    (reported,) = [text for text in ran.notes if "a sensor that clips" in text]
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

    sensor = SpringSensor(bed, says=clipped(0.6))
    ran = run_springs(bed, stage, [sensor], rig=SLOW, observers=[stop], sink=stop, control=control)
    assert ran.lifted or any("was not lifted" in note for note in ran.notes)
    assert not ran.lifted
