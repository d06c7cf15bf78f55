"""What is left of a UR's driver where its process dies, the line stalls or the robot disobeys.

The press is 2.4 mm at 1.2 mm/s; places are the emulated arm's own.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from emulated_ur import ORIGIN_MM, Arm, arm_with, connected, fresh_host, until
from true_tip import HasTip

from drivers import DeviceAbsent, DeviceFault, Pose, WallClock
from drivers.ur.settings import LOST_SEGMENT_S, SILENCE_S, WATCHDOG_S
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.emulators.ur.robot import Robot
from sim_backend.phantom.phantom import Phantom, Respond

X_M, TOP_M, SPEED_M_S = 0.03, 4e-3, 1.2e-3
BOTTOM = Pose(X_M, 0.0, -2.4e-3)
BUSY_S = 0.3  # in which a busy machine looks late at what has happened
PRESS = """
import sys, time
from drivers import Pose, WallClock
from drivers.ur.settings import UrStageSettings
from drivers.ur.stage import open_stage
host, says = sys.argv[1:]
keys = UrStageSettings(host=host, origin_mm={origin}, silence_s=5.0, answer_s=5.0, watchdog_s=0.6,
                       roll_deg=90.0)
stage = open_stage(WallClock(), keys)
stage.connect()
if says == "where to":
    stage.lift_when_alone({top}, 0.01)
stage.enable()
here = stage.pose()
stage.move(Pose({x}, 0.0, -2.4e-3), 1.2e-3)
print("pressing", flush=True)
while True:
    stage.keep_alive()
    time.sleep(0.01)
"""


@dataclass
class Press(HasTip):
    """A process that presses, and the world it presses in."""

    phantom: Phantom
    robot: Robot
    process: subprocess.Popen[str]

    def client(self) -> int:
        found = subprocess.run(
            ["pgrep", "-P", str(self.process.pid)], capture_output=True, text=True, check=True
        )
        return int(found.stdout)

    def last_words(self) -> str:
        assert self.process.stderr is not None
        return self.process.stderr.read()


@pytest.fixture
def press(winkler: Respond, request: pytest.FixtureRequest) -> Iterator[Press]:
    """A millimetre deep. The arm's base is mounted on a wall: up is none of its axes' z."""
    clock, host, says = WallClock(), fresh_host(), getattr(request, "param", "where to")
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=(X_M, 0.0, 1e-4))
    script = PRESS.format(origin=ORIGIN_MM, top=TOP_M, x=X_M)
    with ur.emulate(phantom, at=host, origin_mm=ORIGIN_MM, rotation_deg=(90.0, 0.0, 0.0)) as robot:
        process = subprocess.Popen(
            [sys.executable, "-c", script, host, says],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            made = Press(phantom, robot.robot, process)
            until(lambda: process.poll() is not None or made.tip_m[2] < -1e-3)
            assert process.poll() is None, made.last_words()
            yield made
        finally:
            process.kill()
            process.communicate()


def test_the_client_lifts_where_the_process_that_guards_dies(press: Press) -> None:
    before_m = press.tip_m[2]
    press.process.send_signal(signal.SIGKILL)
    until(lambda: not press.robot.playing)
    assert press.tip_m[2] == pytest.approx(TOP_M, abs=2e-4)
    assert before_m - press.deepest_m < BUSY_S * SPEED_M_S
    assert "what guards the robot has died; the probe was lifted by" in press.last_words()


@pytest.mark.parametrize("press", ["nothing"], indirect=True)
def test_a_client_that_was_not_told_where_to_lifts_nothing(press: Press) -> None:
    press.process.send_signal(signal.SIGKILL)
    until(lambda: not press.robot.playing)
    time.sleep(0.3)
    assert -2e-3 < press.tip_m[2] < -1e-3
    assert "it was not said where to lift the probe to" in press.last_words()


def test_a_client_that_cannot_lift_says_so(press: Press) -> None:
    press.robot.ignores = frozenset({33})  # stopL
    press.process.send_signal(signal.SIGKILL)
    until(lambda: not press.robot.playing)
    assert "THE PROBE WAS NOT LIFTED" in press.last_words()
    assert press.tip_m[2] < -1e-3


def test_a_client_leaves_a_program_alone_that_came_after_its_own(press: Press) -> None:
    """Another process has taken over, which lifts by itself."""
    press.robot.ignores = frozenset({33})
    press.process.send_signal(signal.SIGKILL)
    time.sleep(0.1)
    press.robot.end_program()
    until(lambda: "died" in press.last_words())
    press.robot.upload()
    time.sleep(0.5)
    assert press.robot.playing


def test_where_nobody_is_left_the_watchdog_halts_the_arm(press: Press) -> None:
    before_m, client = press.tip_m[2], press.client()
    for process in (client, press.process.pid):
        os.kill(process, signal.SIGKILL)
    until(lambda: not press.robot.playing)
    assert before_m - press.deepest_m < (0.6 + BUSY_S) * SPEED_M_S


def test_the_watchdog_outlives_a_lost_segment() -> None:
    """A reset that is lost is sent again 0.2 s later, and may be late by what is no silence."""
    assert WATCHDOG_S * (1 - 1 / 8) >= LOST_SEGMENT_S + SILENCE_S


@pytest.fixture
def going_down(winkler: Respond) -> Iterator[Arm]:
    """Half a millimetre on the way down, by a stage of this process."""
    with connected(winkler, keys={"watchdog_s": 0.6}) as made:
        made.stage.enable()
        made.go(Pose(X_M, 0.0, 0.1e-3), 0.05)
        made.stage.move(BOTTOM, SPEED_M_S)
        until(lambda: made.tip_m[2] < -0.5e-3)
        yield made


def lift(arm: Arm) -> None:
    arm.go(Pose(X_M, 0.0, TOP_M), 0.02)
    assert arm.tip_m[2] == pytest.approx(TOP_M, abs=1e-4)


def test_a_short_stall_of_the_way_to_the_robot_does_no_harm(going_down: Arm) -> None:
    going_down.fail("uplink stalls")
    time.sleep(0.15)
    going_down.fail(None)
    going_down.arrive()
    assert going_down.robot.uploads == 1


def test_what_did_not_arrive_ended_the_program_and_it_is_started_again(going_down: Arm) -> None:
    """The robot goes on sending all the while: this side alone would not know."""
    going_down.fail("uplink stalls")
    going_down.until_said("it had heard nothing from here for watchdog_s")
    going_down.fail(None)
    going_down.stage.start_again()
    lift(going_down)


def test_a_stop_that_is_not_obeyed_is_followed_by_the_next_way_to_stop(going_down: Arm) -> None:
    going_down.fail("ignored stops")
    by_program, by_dashboard, _ = going_down.stage.stop_means()
    by_program.call()
    time.sleep(by_program.within_s)
    assert going_down.tip_moves
    by_dashboard.call()
    until(lambda: not going_down.tip_moves)
    going_down.until_said("was ended from here")
    going_down.stage.start_again()
    by_dashboard.call()  # repeated until the arm is seen at rest: it ends no second program
    assert going_down.robot.playing
    lift(going_down)


def test_the_brakes_close_only_on_an_arm_that_goes_on(going_down: Arm) -> None:
    going_down.fail("ignored stops")
    going_down.controller.deaf_to = frozenset({"stop"})
    *_, by_brakes = going_down.stage.stop_means()
    assert not by_brakes.lifts
    by_brakes.call()
    until(lambda: not going_down.tip_moves)
    going_down.until_said("power off")
    going_down.fail(None)
    time.sleep(0.3)
    by_brakes.call()
    time.sleep(0.2)
    assert going_down.robot.mode != 3


def test_a_paused_program_is_ended_and_does_not_go_on(going_down: Arm) -> None:
    going_down.fail("paused")
    going_down.until_said("paused on the pendant")
    before_m = going_down.tip_m[2]
    going_down.stage.stop_means()[1].call()
    until(lambda: not going_down.robot.playing)
    going_down.robot.resume()
    time.sleep(0.3)
    assert going_down.tip_m[2] == before_m
    going_down.stage.start_again()  # a person has paused it
    assert going_down.robot.uploads == 1


@pytest.mark.parametrize("fault, words", [
    ("paused", "paused on the pendant"),
    ("freedrive", "freedrive"),
    ("local", "switched to local control"),
    ("lost program", "somebody has ended it"),
])  # fmt: skip
def test_it_is_said_why_the_program_does_not_run(arm: Arm, fault: str, words: str) -> None:
    arm.fail(fault)
    arm.until_said(words)


def test_it_is_said_what_holds_a_move_up(going_down: Arm) -> None:
    assert going_down.stage.why_still() is None
    going_down.fail("slider at 0")
    until(lambda: going_down.stage.why_still() == "its speed slider is at 0 %")


@pytest.mark.parametrize(
    "arm",
    [{"enable": False, "version": v} for v in ((5, 5, 0, 1), (5, 4, 0, 1), (3, 10, 1, 1))],
    indirect=True,
)
def test_controllers_that_do_not_report_the_payload_are_used(arm: Arm) -> None:
    assert "payload not reported" in arm.stage.enable()[0]
    lift(arm)


@arm_with(enable=False, version=(5, 3, 1, 64192))
def test_a_controller_that_the_library_cannot_control_is_refused(arm: Arm) -> None:
    """It would connect again and again, and crash (`setupRecipes` of ur-rtde 1.6.5)."""
    arm.stage.pose()
    with pytest.raises(DeviceAbsent, match=r"moving needs PolyScope 5\.4"):
        arm.stage.enable()


@arm_with(enable=False)
def test_a_clock_that_is_set_ahead_loses_no_samples(arm: Arm) -> None:
    arm.sensor.start()
    time.sleep(0.3)
    lost = arm.sensor.read().lost
    arm.fail("clock ahead")
    end_s, times_s = arm.clock.now() + 0.5, list[float]()
    while arm.clock.now() < end_s:
        time.sleep(0.05)
        block = arm.sensor.read()
        times_s += block.time_s.tolist()
        lost += block.lost
    assert lost < 200  # of 400 samples, where a busy machine loses some; 5,000 were not sent
    assert times_s[-1] <= arm.clock.now()


@arm_with(enable=False)
def test_nothing_is_ordered_from_a_robot_that_was_only_read(arm: Arm) -> None:
    arm.robot.play_other()
    for means in arm.stage.stop_means():
        means.call()
    time.sleep(0.2)
    assert arm.robot.playing
    with pytest.raises(DeviceFault, match="another program"):
        arm.stage.move(BOTTOM, SPEED_M_S)
