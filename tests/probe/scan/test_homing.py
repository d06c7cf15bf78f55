"""Moving to a home: a step of its own, announced, watched, and stoppable at any instant."""

import threading
import time
from collections.abc import Callable

import pytest
from springs import Bed, SpringSensor, SpringStage, on_springs, run_springs

from drivers import DeviceFault, Pose
from probe.core.events import Event, Finish, Phase, PhaseEntered
from probe.guards.commands import Control

HOME = (-20e-3, 0.0, 20e-3)


class Homing(SpringStage):
    """Has no pose until it is homed, which takes 1.5 s; a stop breaks it off."""

    homes = True

    def __init__(self, bed: Bed) -> None:
        super().__init__(bed)
        self._homed = False
        self._stopped = threading.Event()

    def pose(self) -> Pose:
        if not self._homed:
            raise DeviceFault(self.name, "alarm 11: homing required")
        return super().pose()

    def home(self) -> None:
        for there in (HOME, (0.0, 0.0, 5e-3)):
            self.bed.tip.move(self.bed.clock.now(), there, 40e-3, 1.0)
            while self.bed.tip.moving(self.bed.clock.now()):
                if self._stopped.wait(0.01):
                    raise DeviceFault(self.name, "stopped on the way to its home")
        self._homed = True

    def stop(self) -> None:
        self._stopped.set()
        super().stop()


def at_homing(do: Callable[[], None], after_s: float) -> Callable[[Event], None]:
    def look(event: Event) -> None:
        if isinstance(event, PhaseEntered) and event.phase is Phase.HOMING:
            threading.Timer(after_s, do).start()

    return look


def test_a_scan_homes_first_and_says_so() -> None:
    bed, _, sensor = on_springs()
    ran = run_springs(bed, Homing(bed), [sensor])
    assert ran.complete == [0]
    phases = [e.phase for e in ran.events if isinstance(e, PhaseEntered)]
    assert phases[:3] == [Phase.CONNECTING, Phase.HOMING, Phase.TRAVELLING]
    assert "moves to its limit switches and to its park" in ran.notes


@pytest.mark.parametrize("word", ["abort", "stop"])
@pytest.mark.parametrize("after_s", [0.02, 0.5])
def test_homing_ends_where_the_user_says_so(word: str, after_s: float) -> None:
    bed, _, sensor = on_springs()
    control, asked_s = Control(), list[float]()

    def ask() -> None:
        asked_s.append(bed.clock.now())
        getattr(control, word)()

    ran = run_springs(
        bed, Homing(bed), [sensor], control=control, observers=[at_homing(ask, after_s)]
    )
    assert ran.finish is Finish.ABORTED
    assert ran.ended.time_s - asked_s[0] < 1.0
    assert [text for text in ran.notes if "the probe was not lifted" in text]
    rest = bed.tip.point(asked_s[0] + 0.3)
    time.sleep(0.2)
    assert bed.tip.point(bed.clock.now()) == rest


def test_a_force_on_the_way_home_stops_it() -> None:
    bed, _, _ = on_springs()
    hit: list[float] = []

    class Hit(SpringSensor):
        def raw(self, time_s: float) -> float:
            return 20.0 if hit else super().raw(time_s)

    stage = Homing(bed)
    ran = run_springs(bed, stage, [Hit(bed)], observers=[at_homing(lambda: hit.append(1), 0.3)])
    assert "cell: force 20." in ran.reason
    time.sleep(0.2)
    assert not stage.moving()
    assert bed.tip.point(bed.clock.now()) != HOME


def test_a_homing_that_fails_ends_the_scan() -> None:
    """The stage tells a pose all the same, as one does that knows where it was switched on."""

    class Lost(Homing):
        def pose(self) -> Pose:
            return SpringStage.pose(self)

        def home(self) -> None:
            raise DeviceFault(self.name, "alarm 9: found no switch")

    bed, _, sensor = on_springs()
    stage = Lost(bed)
    ran = run_springs(bed, stage, [sensor])
    assert "alarm 9: found no switch" in ran.reason
    assert "move" not in {what for _, what in stage.orders}
