"""A UR's rest is what the controller says; its watchdog is whoever checks the force."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import cast

import pytest
from emulated_ur import Rig, connected, until_said

from drivers import DeviceFault, MotionFault, Pose, SimulatedClock
from drivers.core.reader import LineSensor
from drivers.ur.client import State
from drivers.ur.link import Link
from drivers.ur.sensor import open_sensor
from drivers.ur.settings import UrSensorSettings, UrStageSettings
from drivers.ur.stage import UrStage
from sim_backend.phantom.phantom import Respond


@pytest.mark.parametrize(("slider", "fault"), [(1.0, ""), (0.2, ""), (1.0, "late readings")])
def test_a_slow_press_is_no_rest(winkler: Respond, slider: float, fault: str) -> None:
    """0.2 mm/s moves the pose by 4 um in the 20 ms over which it was once called still; and moves
    are told of by another stream than poses, which may be the earlier one."""
    with connected(winkler) as (made, robot):
        made.stage.enable()
        robot.robot.slide(slider)
        if fault:
            robot.fail(fault)
        target = Pose(0.03, 0.0, 0.004 - 1e-4)
        began_s = made.clock.now()
        made.stage.move(target, 0.2e-3)
        made.arrive(8.0)
        assert made.clock.now() - began_s > 0.9 * 0.5 / slider
        assert math.dist(made.stage.pose()[:3], target[:3]) < 1e-5


def test_a_slider_at_zero_is_no_rest_and_no_fault(winkler: Respond) -> None:
    with connected(winkler) as (made, robot):
        made.stage.enable()
        made.stage.move(Pose(0.03, 0.0, 0.002), 2e-3)
        time.sleep(0.2)
        robot.robot.slide(0.0)
        time.sleep(0.1)
        assert made.stage.pace == 0.0
        end_s = made.clock.now() + 0.8
        while made.clock.now() < end_s:
            assert made.stage.moving()
            time.sleep(0.01)
        robot.robot.slide(1.0)
        made.arrive()
        assert made.stage.pose().z == pytest.approx(0.002, abs=1e-5)


def test_an_arm_that_rests_elsewhere_can_still_be_lifted(winkler: Respond) -> None:
    with connected(winkler) as (made, _):
        made.stage.enable()
        made.stage.move(Pose(0.03, 0.0, -0.002), 2e-3)
        time.sleep(0.3)
        made.phantom.tip.halt(made.clock.now(), 10.0)
        with pytest.raises(MotionFault, match="came to rest"):
            made.arrive()
        assert not made.stage.moving()  # told once: it rests, and may be lifted
        made.stage.move(Pose(0.03, 0.0, 0.004), 0.02)
        made.arrive()


def test_the_robot_stops_when_nobody_checks_the_force(winkler: Respond) -> None:
    with connected(winkler, keys={"watchdog_s": 0.5}) as (made, robot):
        made.stage.enable()
        made.stage.move(Pose(0.05, 0.0, 0.004), 0.01)
        for _ in range(30):
            made.stage.keep_alive()
            time.sleep(0.02)
        assert robot.robot.playing
        checked_s = made.clock.now()
        while robot.robot.playing:  # this process lives on, and its client too
            assert made.clock.now() - checked_s < 2.0
            time.sleep(0.005)
        time.sleep(0.1)
        assert not made.phantom.tip.moving(made.clock.now())


def until_moved(made: Rig, to: Pose) -> None:
    """Ask until the driver has heard that the other program has ended."""
    end_s = time.monotonic() + 5.0
    while True:
        try:
            return made.stage.move(to, 0.01)
        except DeviceFault as fault:
            assert "another program runs" in str(fault)
            assert time.monotonic() < end_s
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("keys", "ends"),
    [
        ({"watchdog_s": 0.5}, lambda stage: stage.keep_alive()),  # and then no more
        # a robot that does not answer is stopped by the dashboard, which ends the program
        ({"stop_s": 1e-6}, lambda stage: stage.stop()),
    ],
    ids=["by the watchdog", "by the driver"],
)
def test_a_program_that_was_ended_from_here_is_started_again_for_the_lift(
    keys: dict[str, float], ends: Callable[[UrStage], None], winkler: Respond
) -> None:
    with connected(winkler, keys=keys) as (made, _):
        made.stage.enable()
        ends(made.stage)
        until_said(made, "control program has stopped")
        made.stage.start_again()
        made.stage.move(Pose(0.03, 0.0, 0.006), 0.01)
        made.arrive()
        assert made.stage.pose().z == pytest.approx(0.006, abs=1e-4)


@pytest.mark.parametrize(("ended", "cut"), [(True, False), (True, True), (False, True)])
def test_what_a_person_ended_or_what_was_only_read_is_left_alone(
    ended: bool, cut: bool, winkler: Respond
) -> None:
    """Also after a connection that was cut."""
    with connected(winkler) as (made, robot):
        if ended:
            made.stage.enable()
            made.stage.keep_alive()
            robot.fail("lost program")
            until_said(made, "control program has stopped")
        if cut:
            robot.fail("blink")
            until_said(made, "connection lost")
        else:
            made.stage.stop()  # by the dashboard, for the program does not answer
        made.stage.start_again()
        until_said(made, "connection lost" if cut else "control program has stopped")
        assert robot.robot.uploads == ended


def test_a_connection_that_was_cut_is_made_again_for_the_lift(winkler: Respond) -> None:
    with connected(winkler, keys={"watchdog_s": 60.0}) as (made, robot):
        made.stage.enable()
        made.stage.keep_alive()
        robot.fail("blink")
        until_said(made, "connection lost")
        made.stage.start_again()
        with pytest.raises(DeviceFault, match="another program runs"):
            made.stage.move(Pose(0.03, 0.0, 0.006), 0.01)  # ours from before the cut
        robot.robot.end_program()  # as its watchdog does in the end
        until_moved(made, Pose(0.03, 0.0, 0.006))
        made.arrive()
        assert made.stage.pose().z == pytest.approx(0.006, abs=1e-4)


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
