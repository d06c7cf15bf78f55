"""The way out when the first lift does not succeed: refused, or met by a patient who moves."""

import math
from collections.abc import Callable

import pytest
from springs import Bed, SpringSensor, SpringStage, run_springs

from drivers import DeviceFault, Pose, SimulatedClock
from drivers.core.abilities import StopMeans
from probe.core.events import Event, Note, Phase, PhaseEntered, RunEnded
from probe.guards.levels import no_force
from probe.guards.retreat import LIFTS, Retreat
from probe.scan.engine import BY_HAND

STEP_S, UP_M, DOWN_M = 0.01, 2e-3, -2e-3


class Stage:
    """A stage that lifts at the speed it is told, unless ``refuses`` more orders than that."""

    def __init__(self, force_n: Callable[[float, float], float], refuses: int = 0) -> None:
        self.now_s, self.z_m = 0.0, DOWN_M
        self.lifts: list[float] = []
        self.refuses = refuses
        self.says_m: float | None = None  # whatever is true
        self.asleep = self.wakes = False  # halted by its watchdog; can be started again
        self.lowest_m = DOWN_M
        self.x_m = self.slips_m_s = 0.0
        self._force = force_n
        self._target_m, self._speed_m_s = DOWN_M, 0.0

    def step(self, retreat: Retreat) -> None:
        self.now_s += STEP_S
        way = self._target_m - self.z_m
        self.z_m += max(min(way, self._speed_m_s * STEP_S), -self._speed_m_s * STEP_S)
        self.lowest_m = min(self.lowest_m, self.z_m)
        self.x_m += self.slips_m_s * STEP_S * self.moving()
        pose = None if self.asleep else Pose(self.x_m, 0.0, self.says_m or self.z_m)
        retreat.step(self.now_s, pose, "its program has ended" if self.asleep else "")

    def start_again(self) -> None:
        if not self.wakes:
            raise DeviceFault("stage", "cannot be started again")
        self.asleep = False

    def stop(self) -> None:
        self._target_m = self.z_m

    def stop_means(self) -> tuple[StopMeans, ...]:
        return (StopMeans("stop", lambda: self.stop(), math.inf),)

    def moving(self) -> bool:
        return abs(self._target_m - self.z_m) > 1e-9

    def start(self, target: Pose, speed_m_s: float) -> None:
        if self.refuses > 0:
            self.refuses -= 1
            raise DeviceFault("stage", "busy")
        self.lifts.append(self.now_s)
        self._target_m, self._speed_m_s = target.z, speed_m_s

    def force_n(self) -> float:
        return self._force(self.now_s, self.z_m)

    def out(self, most_s: float = 30.0, *, led_down: bool = False) -> Retreat:
        """Go the way out to its end."""
        retreat = Retreat(
            self.stop_means(), self.start_again, self.moving, self.start, self.force_n, UP_M, 6e-3,
            self.now_s, 1.6, led_down,
        )  # fmt: skip
        while not retreat.done and self.now_s < most_s:
            self.step(retreat)
        return retreat


def spring(_now_s: float, z_m: float) -> float:
    return max(-500.0 * z_m, 0.0)


def test_a_lift_that_was_refused_is_tried_again() -> None:
    stage = Stage(spring, refuses=3)
    retreat = stage.out()
    assert retreat.why_not is None
    assert stage.z_m == pytest.approx(UP_M, abs=1e-4)


def test_a_stage_that_does_not_stop_is_ordered_again_but_not_flooded() -> None:
    """50 times a second, on a step every 10 ms: a controller's buffer holds that."""
    stage, stops = Stage(spring), []
    stage.stop = lambda: stops.append(stage.now_s)  # type: ignore[method-assign]
    stage.moving = lambda: True  # type: ignore[method-assign]
    retreat = stage.out()
    assert retreat.why_not == "the stage: it does not come to rest"
    assert 30 < len(stops) / stage.now_s < 51


def test_a_stage_that_its_watchdog_has_halted_is_started_again_and_lifted() -> None:
    stage = Stage(spring)
    stage.asleep = stage.wakes = True
    assert stage.out().up
    assert stage.z_m == pytest.approx(UP_M, abs=1e-4)


def test_a_stage_that_cannot_be_started_again_is_left_with_the_reason() -> None:
    stage = Stage(spring)
    stage.asleep = True
    retreat = stage.out()
    assert not retreat.up
    assert retreat.why_not == "the stage: its program has ended"


def test_a_lift_that_met_a_cough_is_tried_again() -> None:
    def cough(now_s: float, z_m: float) -> float:
        rises_m = 3e-3 if 0.05 < now_s < 0.35 else 0.0
        return max(500.0 * (rises_m - z_m), 0.0)

    stage = Stage(cough)
    retreat = stage.out()
    assert len(stage.lifts) > 1
    assert retreat.why_not is None
    assert stage.z_m == pytest.approx(UP_M, abs=1e-4)


def test_a_lift_that_makes_it_worse_again_and_again_is_given_up_with_the_reason() -> None:
    stage = Stage(lambda _now_s, z_m: 1.0 + 800.0 * (z_m - DOWN_M))  # hooked under something
    retreat = stage.out()
    assert len(stage.lifts) == LIFTS
    assert retreat.done
    assert retreat.why_not is not None
    assert "lifting raised the force" in retreat.why_not
    assert not stage.moving()


@pytest.mark.parametrize("obeys", [True, False])
def test_a_lift_that_frozen_reports_hide_is_told_by_the_force(obeys: bool) -> None:
    stage = Stage(spring)
    stage.says_m = DOWN_M
    if not obeys:
        stage.start = lambda _target, _speed_m_s: None  # type: ignore[method-assign]
    retreat = stage.out()
    assert retreat.unsure == obeys
    assert retreat.why_not == (
        "the stage was told to lift, and the place that it reports has not changed since; "
        f"the force went from 1.000 N to {0.0 if obeys else 1.0:.3f} N"
    )


def test_a_run_does_not_say_that_a_lift_was_none_where_it_does_not_know() -> None:
    class Frozen(SpringStage):
        """Reports where it was once it has been stopped, for ever."""

        froze: Pose | None = None

        def pose(self) -> Pose:
            return self.froze or super().pose()

        def stop(self) -> None:
            super().stop()
            self.froze = self.froze or super().pose()

    bed = Bed(SimulatedClock(), 1000.0)
    ran = run_springs(bed, Frozen(bed), [SpringSensor(bed)])
    assert ran.lifted
    assert not any("NOT LIFTED" in note for note in ran.notes)
    assert any(note.startswith("WHETHER THE PROBE WAS LIFTED IS NOT KNOWN") for note in ran.notes)
    assert "not known: the stage was told to lift" in ran.reason


def test_a_lift_never_goes_down() -> None:
    stage = Stage(lambda _now_s, _z_m: 0.0)
    stage.z_m = stage.lowest_m = high_m = UP_M + 5e-3
    assert stage.out(led_down=True).up
    assert stage.lowest_m == high_m


def test_a_lift_that_goes_sideways_is_broken_off() -> None:
    stage = Stage(spring)
    stage.slips_m_s = 6e-3  # at 45 degrees through what lies there
    retreat = stage.out()
    assert retreat.why_not == "commanded to lift, the stage went another way"
    assert stage.x_m < LIFTS * 0.7e-3  # half a millimetre each time, and a few steps
    assert not stage.moving()


def test_a_long_way_up_is_given_the_time_that_it_takes() -> None:
    stage = Stage(lambda _now_s, _z_m: 0.0)
    stage.z_m = -0.1  # 17 s at 6 mm/s
    retreat = stage.out(most_s=60.0)
    assert retreat.up
    assert retreat.why_not is None
    assert stage.z_m == pytest.approx(UP_M, abs=1e-4)


def test_a_lift_that_is_forbidden_while_it_is_ordered_ends_where_the_tip_is() -> None:
    """A second Ctrl-C comes on another thread, also between the order and what follows it."""
    stage = Stage(spring)

    def forbidden(target: Pose, speed_m_s: float) -> None:
        Stage.start(stage, target, speed_m_s)
        retreat.stay()

    retreat = Retreat(
        stage.stop_means(), stage.start_again, stage.moving, forbidden, stage.force_n, UP_M, 6e-3,
        stage.now_s, 1.6, False,
    )  # fmt: skip
    while not retreat.done and stage.now_s < 30.0:
        stage.step(retreat)
    assert len(stage.lifts) == 1
    assert retreat.done
    assert stage.z_m == pytest.approx(DOWN_M, abs=0.1e-3)
    assert not stage.moving()


@pytest.mark.parametrize("levels, felt", [
    ({"cell": (1.0, 0.01)}, True),
    ({"cell": (-1.0, 0.01)}, False),  # a probe that presses is never pulled
    ({"cell": (0.01, 0.01)}, False),
    ({"cell": (0.01, 0.001)}, False),  # 3 standard deviations of a reading, 0.2 % of the limit
    ({"cell": (0.06, 0.001)}, True),  # 19 of them
    ({"cell": (0.15, 0.01)}, True),  # 3 % of the limit
    ({"cell": (float("nan"), float("inf"))}, True),  # too few readings say nothing
    ({"cell": (-1.0, 0.01), "other": (1.0, 0.01)}, True),
    ({"cell": (0.0, 0.0)}, False),
    ({"cell": (0.5, 0.0)}, True),
    ({}, True),  # nothing that could feel: refused elsewhere
])  # fmt: skip
def test_a_press_is_felt_as_a_push(levels: dict[str, tuple[float, float]], felt: bool) -> None:
    assert (no_force(levels, {"cell": 100.0, "other": 100.0}, 5.0) is None) == felt


def test_an_interrupted_cell_says_if_the_probe_was_not_lifted() -> None:
    class Refuses(SpringStage):
        armed = False

        def move(self, target: Pose, speed_m_s: float) -> None:
            if self.armed:
                raise DeviceFault(self.name, "not now")
            super().move(target, speed_m_s)

    def interrupt(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOLDING:
            stage.armed = True
            raise KeyboardInterrupt

    stage = Refuses(Bed(SimulatedClock()))
    ran = run_springs(stage.bed, stage, [SpringSensor(stage.bed)], observers=[interrupt])
    assert isinstance(ran.raised, KeyboardInterrupt)
    (ended,) = [event for event in ran.events if isinstance(event, RunEnded)]
    assert "the probe was not lifted: the stage: stage of springs: not now" in ended.reason
    (said,) = [e.text for e in ran.events if isinstance(e, Note) and "NOT LIFTED" in e.text]
    assert said.endswith(f"stage of springs: not now; {BY_HAND}")
