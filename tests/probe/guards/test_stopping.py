"""Stops that are acknowledged and not obeyed: the next way to stop is taken in its time."""

import math
from collections.abc import Sequence

import pytest
from springs import LIMIT_N, Bed, Ran, SpringSensor, SpringStage, run_springs, spring_rig

from drivers import DeviceFault, Pose, SimulatedClock
from drivers.core.abilities import StopMeans
from probe.core.events import Note
from probe.guards.retreat import Retreat
from probe.guards.stopping import LOOK_S, SEEN_S

STIFFNESS_N_M = 1000.0
WITHIN_S = 0.1
SPEED_M_S = 2.4e-3


class Deaf(SpringStage):
    """Acknowledges every stop, and obeys only the way named ``obeys``."""

    def __init__(self, bed: Bed, names: Sequence[str], obeys: str, *, lifts: bool = True) -> None:
        super().__init__(bed)
        self.names, self.obeys, self.lifts = names, obeys, lifts
        self.said: list[tuple[float, str]] = []

    def stop_means(self) -> list[StopMeans]:
        last = self.names[-1]
        return [
            StopMeans(name, lambda name=name: self.say(name), WITHIN_S, self.lifts or name != last)
            for name in self.names
        ]

    def say(self, name: str) -> None:
        self.said.append((self.bed.clock.now(), name))
        if name == self.obeys:
            super().stop()

    def stop(self) -> None:
        self.say("stop")

    def first_s(self, name: str) -> float:
        return next(time_s for time_s, said in self.said if said == name)


def press(stage: Deaf) -> Ran:
    rig = spring_rig(
        scan={"indentation_mm": 2.4, "ramp_s": 1.0, "approach_mm_s": 2.4},
        safety={"hardest_n_mm": 2.0},
    )
    return run_springs(stage.bed, stage, [SpringSensor(stage.bed)], rig=rig)


def test_each_way_to_stop_has_its_time_until_one_is_seen_to_work() -> None:
    stage = Deaf(Bed(SimulatedClock(), STIFFNESS_N_M), ["stop", "hold", "reset"], "reset")
    ran = press(stage)
    each_s = WITHIN_S + SEEN_S
    assert stage.first_s("hold") - stage.first_s("stop") == pytest.approx(each_s, abs=0.02)
    assert stage.first_s("reset") - stage.first_s("hold") == pytest.approx(each_s, abs=0.02)
    beyond_n = STIFFNESS_N_M * SPEED_M_S * (2 * (each_s + 0.02) + 0.02)
    assert LIMIT_N < ran.force_n.max() < LIMIT_N + beyond_n < STIFFNESS_N_M * 2.4e-3
    assert ran.lifted
    assert any("not seen to stop by stop, nor by hold" in text for text in ran.notes)


def test_a_stop_that_works_is_the_only_one() -> None:
    stage = Deaf(Bed(SimulatedClock(), STIFFNESS_N_M), ["stop", "hold", "reset"], "stop")
    ran = press(stage)
    assert {name for _, name in stage.said} == {"stop"}
    assert ran.lifted
    assert not any("not seen to stop" in text for text in ran.notes)


def test_what_cannot_be_moved_after_its_last_stop_is_not_and_the_run_says_so() -> None:
    stage = Deaf(Bed(SimulatedClock(), STIFFNESS_N_M), ["stop", "reset"], "reset", lifts=False)
    ran = press(stage)
    assert not ran.lifted
    assert "obeyed no stop but reset, after which the program cannot move it" in ran.reason
    assert any(
        "THE PROBE WAS NOT LIFTED" in e.text and e.level == "fault"
        for e in ran.events
        if isinstance(e, Note)
    )


class Blind:
    """A way out without poses, on a time of its own."""

    def __init__(self, *, lifts: bool) -> None:
        self.said: list[str] = []
        means = [
            StopMeans("stop", lambda: self.said.append("stop"), WITHIN_S),
            StopMeans("reset", lambda: self.said.append("reset"), WITHIN_S, lifts),
        ]
        self.retreat = Retreat(
            means,
            lambda: None,
            lambda: False,
            self._start,
            lambda: 0.0,
            2e-3,
            6e-3,
            0.0,
            1.6,
            False,
        )

    def _start(self, _target: Pose, _speed_m_s: float) -> None:
        raise DeviceFault("stage", "is not asked without a pose")

    def step(self, until_s: float, *, every_s: float = 0.01) -> None:
        now_s = 0.0
        while now_s < until_s and not self.retreat.done:
            now_s += every_s
            self.retreat.step(now_s, None, "does not answer")


def test_where_no_pose_comes_only_a_stop_that_ends_no_lift_is_taken() -> None:
    blind = Blind(lifts=True)
    blind.step(0.5)
    assert "reset" in blind.said
    blind = Blind(lifts=False)
    blind.step(5.0)
    assert set(blind.said) == {"stop"}


def test_whoever_gives_up_has_ordered_every_stop() -> None:
    """A stage that is silent now may go on later, when nobody looks any more."""
    blind = Blind(lifts=False)
    blind.step(60.0)
    assert blind.retreat.done
    assert blind.said[-1] == "reset"
    assert blind.retreat.why_not == "the stage: does not answer"


def test_a_pause_of_the_program_is_no_stop_that_was_not_obeyed() -> None:
    blind, looks = Blind(lifts=True), math.floor((WITHIN_S + SEEN_S) / LOOK_S)
    blind.step(5.0 * looks, every_s=5.0)
    assert "reset" not in blind.said
