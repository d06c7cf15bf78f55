"""A UR's rest is what the controller says; its watchdog is whoever checks the force."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import cast

import pytest
from emulated_ur import Arm, arm_with, until

from drivers import DeviceFault, MotionFault, Pose, SimulatedClock
from drivers.core.reader import LineSensor
from drivers.ur.client import State
from drivers.ur.link import Link
from drivers.ur.sensor import open_sensor
from drivers.ur.settings import UrSensorSettings, UrStageSettings
from drivers.ur.stage import UrStage


@pytest.mark.parametrize(("slider", "fault"), [(1.0, ""), (0.2, ""), (1.0, "late readings")])
def test_a_slow_press_is_no_rest(arm: Arm, slider: float, fault: str) -> None:
    """0.2 mm/s moves the pose by 4 um in the 20 ms over which it was once called still; and moves
    are told of by another stream than poses, which may be the earlier one."""
    arm.robot.slide(slider)
    if fault:
        arm.fail(fault)
    target = Pose(0.03, 0.0, 0.004 - 1e-4)
    began_s = arm.clock.now()
    arm.stage.move(target, 0.2e-3)
    arm.arrive(8.0)
    assert arm.clock.now() - began_s > 0.9 * 0.5 / slider
    assert math.dist(arm.stage.pose()[:3], target[:3]) < 1e-5


def test_a_slider_at_zero_is_no_rest_and_no_fault(arm: Arm) -> None:
    arm.stage.move(Pose(0.03, 0.0, 0.002), 2e-3)
    time.sleep(0.2)
    arm.robot.slide(0.0)
    time.sleep(0.1)
    assert arm.stage.pace == 0.0
    end_s = arm.clock.now() + 0.8
    while arm.clock.now() < end_s:
        assert arm.stage.moving()
        time.sleep(0.01)
    arm.robot.slide(1.0)
    arm.arrive()
    assert arm.stage.pose().z == pytest.approx(0.002, abs=1e-5)


def test_an_arm_that_rests_elsewhere_can_still_be_lifted(arm: Arm) -> None:
    arm.stage.move(Pose(0.03, 0.0, -0.002), 2e-3)
    time.sleep(0.3)
    arm.phantom.tip.halt(arm.clock.now(), 10.0)
    with pytest.raises(MotionFault, match="came to rest"):
        arm.arrive()
    assert not arm.stage.moving()  # told once: it rests, and may be lifted
    arm.go(Pose(0.03, 0.0, 0.004), 0.02)


@arm_with(keys={"watchdog_s": 0.5})
def test_the_robot_stops_when_nobody_checks_the_force(arm: Arm) -> None:
    arm.stage.move(Pose(0.05, 0.0, 0.004), 0.01)
    for _ in range(30):
        arm.stage.keep_alive()
        time.sleep(0.02)
    assert arm.robot.playing
    checked_s = arm.clock.now()
    while arm.robot.playing:  # this process lives on, and its client too
        assert arm.clock.now() - checked_s < 2.0
        time.sleep(0.005)
    time.sleep(0.1)
    assert not arm.tip_moves


def until_moved(made: Arm, to: Pose) -> None:
    """Ask until the driver has heard that the other program has ended."""

    def moved() -> bool:
        try:
            made.stage.move(to, 0.01)
        except DeviceFault as fault:
            assert "another program runs" in str(fault)
            return False
        return True

    until(moved)


@pytest.mark.parametrize(
    ("arm", "ends"),
    [
        ({"keys": {"watchdog_s": 0.5}}, UrStage.keep_alive),  # and then no more
        # a robot that does not answer is stopped by the dashboard, which ends the program
        ({"keys": {"stop_s": 1e-6}}, UrStage.stop),
    ],
    indirect=["arm"],
    ids=["by the watchdog", "by the driver"],
)
def test_a_program_that_was_ended_from_here_is_started_again_for_the_lift(
    arm: Arm, ends: Callable[[UrStage], None]
) -> None:
    ends(arm.stage)
    arm.until_said("control program has stopped")
    arm.stage.start_again()
    arm.go(Pose(0.03, 0.0, 0.006), 0.01)
    assert arm.stage.pose().z == pytest.approx(0.006, abs=1e-4)


@arm_with(enable=False)
@pytest.mark.parametrize(("ended", "cut"), [(True, False), (True, True), (False, True)])
def test_what_a_person_ended_or_what_was_only_read_is_left_alone(
    ended: bool, cut: bool, arm: Arm
) -> None:
    """Also after a connection that was cut."""
    if ended:
        arm.stage.enable()
        arm.stage.keep_alive()
        arm.fail("lost program")
        arm.until_said("control program has stopped")
    if cut:
        arm.fail("blink")
        arm.until_said("connection lost")
    else:
        arm.stage.stop()  # by the dashboard, for the program does not answer
    arm.stage.start_again()
    arm.until_said("connection lost" if cut else "control program has stopped")
    assert arm.robot.uploads == ended


@arm_with(keys={"watchdog_s": 60.0})
def test_a_connection_that_was_cut_is_made_again_for_the_lift(arm: Arm) -> None:
    arm.stage.keep_alive()
    arm.fail("blink")
    arm.until_said("connection lost")
    arm.stage.start_again()
    with pytest.raises(DeviceFault, match="another program runs"):
        arm.stage.move(Pose(0.03, 0.0, 0.006), 0.01)  # ours from before the cut
    arm.robot.end_program()  # as its watchdog does in the end
    until_moved(arm, Pose(0.03, 0.0, 0.006))
    arm.arrive()
    assert arm.stage.pose().z == pytest.approx(0.006, abs=1e-4)


STILL = (0.0,) * 6
REST = State(1.0, 0.0, STILL, STILL, STILL, 1, 7, 2, 1.0, False)


class Told:
    """A link that has only the state that it was given."""

    controls = True

    def __init__(self) -> None:
        self.newest = self.before = REST._replace(arrival_s=time.monotonic())
        self.asked: tuple[float, ...] = ()

    def state(self) -> State:
        return self.newest

    def earlier(self, _by_s: float) -> State:
        return self.before

    def command(self, _name: str, pose: tuple[float, ...], *_more: float, **_how: float) -> None:
        self.asked = pose


def told(**keys: float) -> tuple[Told, UrStage]:
    link, stage = Told(), UrStage(UrStageSettings(host="nowhere", **keys))
    stage._link = cast(Link, link)
    return link, stage


def test_a_state_from_before_a_short_move_is_no_arrival() -> None:
    """The newest state is still that of the rest before when the controller accepts the move."""
    link, stage = told()
    here = stage.pose()
    stage.move(here._replace(x=here.x + 0.05e-3), 1e-3)
    assert stage.moving()
    link.newest = link.before = REST._replace(arrival_s=time.monotonic(), pose=link.asked)
    assert not stage.moving()


@pytest.mark.parametrize("top_mm_s", [0.9, 6.5, 18.0, 250.0])
def test_its_own_top_speed_is_allowed_and_more_is_the_devices_to_refuse(top_mm_s: float) -> None:
    """A lift may go as fast as the stage says that it can: 18 mm/s are 0.018 m/s, times 1,000 more
    than 18."""
    link, stage = told(max_speed_mm_s=top_mm_s)
    here = stage.pose()
    stage.move(here._replace(z=here.z + 1e-3), stage.max_speed_m_s)
    assert link.asked
    with pytest.raises(DeviceFault, match="max_speed_mm_s"):
        stage.move(here, 1.001 * stage.max_speed_m_s)


def test_a_tip_that_still_moves_does_not_rest_though_nothing_is_asked_of_it() -> None:
    """The joints follow their targets a little later."""
    link, stage = told()
    link.before = link.newest._replace(pose=(0.05e-3, *STILL[1:]))
    assert stage.moving()
    link.before = link.newest
    assert not stage.moving()


class Drifted:
    """A robot's sensor that reads 3 N until it is zeroed, which takes it 0.1 s."""

    controls = True

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock, self.zeroed_s = clock, math.inf

    def command(self, _name: str) -> None:
        self.zeroed_s = self.clock.now() + 0.1

    def force_n(self) -> float:
        return 3.0 if self.clock.now() < self.zeroed_s else 0.0


def test_a_tare_waits_until_the_robot_has_zeroed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimulatedClock()
    link, taken = Drifted(clock), list[float]()
    monkeypatch.setattr(LineSensor, "tare", lambda _self: taken.append(link.force_n()))
    sensor = open_sensor(clock, UrSensorSettings(host="nowhere"))
    sensor.link = cast(Link, link)
    sensor.tare()
    assert taken == [0.0]


def test_a_robot_that_is_silent_after_its_program_has_started_is_reported() -> None:
    """While the library starts it, nothing comes and nothing is wrong."""
    link = object.__new__(Link)
    link.name, link._starting, link._gone = "ur", False, "cut"
    link._fresh, link._samples, link._state = threading.Condition(), deque(), None
    with pytest.raises(KeyError), link._silent_while_starting():
        assert link.samples(0.0) == []
        raise KeyError
    with pytest.raises(DeviceFault, match="connection lost: cut"):
        link.samples(0.0)
