"""A move that stands still, or is slowed, is said: by whoever holds it up, and soon."""

import pytest
from springs import Bed, Ran, SpringSensor, SpringStage, run_springs, spring_rig

from drivers import Pose, SimulatedClock
from probe.guards.pose_guard import SLOWEST_PACE, STILL_S, StandStill


class Held(SpringStage):
    """Once it is 1 mm deep something holds it up for ``held_s``, at ``pace`` of its speed."""

    why: str | None = None

    def __init__(self, bed: Bed, held_s: float, pace: float = 0.0) -> None:
        super().__init__(bed)
        self.held_s, self.held_pace = held_s, pace
        self.since_s: float | None = None
        self.order: tuple[Pose, float] | None = None
        self.goes_on = True

    @property
    def holds(self) -> bool:
        now = self.bed.clock.now()
        if self.since_s is None and self.bed.tip.point(now)[2] < -1e-3:
            self.since_s, self.goes_on = now, False
            self.bed.tip.halt(now, 1.0)
            if self.held_pace and self.order:
                target, speed_m_s = self.order
                self.bed.tip.move(now, target[:3], speed_m_s * self.held_pace, 1.0)
        held = self.since_s is not None and now < self.since_s + self.held_s
        if self.since_s is not None and not held and not self.goes_on and self.order:
            self.goes_on = True
            self.bed.tip.halt(now, 1.0)
            self.bed.tip.move(now, self.order[0][:3], self.order[1], 1.0)
        return held

    def move(self, target: Pose, speed_m_s: float) -> None:
        super().move(target, speed_m_s)
        self.order = target, speed_m_s

    def moving(self) -> bool:
        return (self.holds and self.order is not None) or super().moving()

    def stop(self) -> None:
        self.order, self.held_s = None, 0.0
        super().stop()

    def why_still(self) -> str | None:
        return self.why


class Slider(Held):
    """Says at what share of a speed it goes."""

    @property
    def pace(self) -> float:
        return self.held_pace if self.holds else 1.0


def press(stage: Held) -> Ran:
    rig = spring_rig(scan={"stations": 1, "ramp_s": 1.0})
    return run_springs(stage.bed, stage, [SpringSensor(stage.bed)], rig=rig)


@pytest.mark.parametrize("why", ["its safety door is open", None])
def test_a_move_that_stands_still_is_a_fault_in_the_devices_words(why: str | None) -> None:
    stage = Held(Bed(SimulatedClock()), 60.0)
    stage.why = why
    ran = press(stage)
    assert "has stood still for 2 s in a move, 1.4" in ran.reason
    assert ran.reason.endswith(why or "nothing says why")
    assert ran.lifted
    assert stage.since_s is not None
    stopped_s = next(time_s for time_s, what in stage.orders if what == "stop")
    assert stopped_s - stage.since_s == pytest.approx(STILL_S, abs=0.05)


def test_a_press_that_stood_still_for_a_second_is_noted_with_its_station() -> None:
    ran = press(Held(Bed(SimulatedClock()), 1.0))
    assert ran.complete == [0]
    (note,) = [text for text in ran.notes if "ramp_s" in text]
    assert note.startswith("station 1: the press took 2.0")
    assert not [text for text in press(Held(Bed(SimulatedClock()), 0.0)).notes if "ramp_s" in text]


def test_a_slider_that_is_moved_is_noted_at_once() -> None:
    stage = Slider(Bed(SimulatedClock()), 2.5, 0.2)
    ran = press(stage)
    assert ran.complete == [0]
    assert [text for text in ran.notes if "of a commanded speed" in text] == [
        "allows 20 % of a commanded speed, after 100 %",
        "allows 100 % of a commanded speed, after 20 %",
    ]


def test_a_slow_move_and_a_rest_are_no_stand_still() -> None:
    still, period_s = StandStill(), 0.008
    for speed_m_s in (1e-5, 1e-3):
        still.begin(Pose(0.0, 0.0, -10e-3), speed_m_s)
        for n in range(2500):
            slow_m = 2 * SLOWEST_PACE * speed_m_s * n * period_s if speed_m_s > 1e-4 else 0.0
            at_m = slow_m or speed_m_s * n * period_s
            assert still.check(Pose(0.0, 0.0, -at_m), n * period_s) is None
    still.end()
    assert not any(still.check(Pose(0.0, 0.0, 0.0), 100.0 + n) for n in range(10))
