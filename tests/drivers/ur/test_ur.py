"""The UR driver: the real ur-rtde client against an emulated controller."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from emulated_ur import ORIGIN_MM, Arm, arm_with, fresh_host, until

from drivers import DeviceAbsent, DeviceFault, Pose, WallClock
from drivers.testing.awake import AwakeTime
from drivers.ur.client import whole_state
from drivers.ur.link import leave_link, take_link
from sim_backend import load_scene
from sim_backend.emulators import ur
from sim_backend.emulators.ur.robot import Robot
from sim_backend.phantom.phantom import Phantom, Respond


@pytest.fixture
def host() -> str:
    """An address that no other test process uses."""
    return fresh_host()


QUICK = {"silence_s": 1.0, "stop_s": 1.0, "acceleration_mm_s2": 2000.0}  # rests in 10 ms


def test_every_sample_is_whole(
    winkler: Respond, host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Noise makes each cycle's force its own, so that a torn sample is like none that was sent."""
    sent: dict[float, dict[str, Any]] = {}
    outputs = Robot.outputs

    def noted(robot: Robot, cycle: int) -> dict[str, Any]:
        reported = outputs(robot, cycle)
        return sent.setdefault(reported["timestamp"], reported)

    monkeypatch.setattr(Robot, "outputs", noted)
    made = Arm(winkler, host)
    with ur.emulate(made.phantom, at=host, noise_n=0.001):
        link = take_link("ur", host, 500.0, 1.0)
        made.phantom.tip.move(made.clock.now(), (0.03, 0.0, -0.002), 0.003, 0.1)
        time.sleep(2.0)
        got = link.samples(1.0)
        leave_link(link)
    assert len(got) > 200  # of 1000; how many depends on what else this machine does
    for state in got:
        reported = sent[state.timestamp_s]
        assert state.wrench == reported["actual_TCP_force"]
        assert state.pose == reported["actual_TCP_pose"]


@arm_with(keys=QUICK)
def test_stop_halts_within_100_ms_from_another_thread(arm: Arm) -> None:
    arm.stage.move(Pose(0.06, 0.0, 0.004), 0.02)
    time.sleep(0.3)
    with AwakeTime() as awake:
        began_s = awake.now()
        threads = [threading.Thread(target=arm.stage.stop) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        while arm.tip_moves:
            time.sleep(0.001)
        assert awake.now() - began_s < 0.1
    assert arm.tip_m[0] < 0.055


@arm_with(keys=QUICK | {"acceleration_mm_s2": 40.0})
def test_a_stop_is_as_hard_as_the_rig_says(arm: Arm) -> None:
    """From 20 mm/s at 40 mm/s2 the tip goes on for 5 mm, as a robot's would."""
    arm.stage.move(Pose(0.06, 0.0, 0.004), 0.02)
    set_off_m = arm.tip_m[0]
    until(lambda: arm.tip_m[0] > set_off_m + 0.007)  # at speed after 5 mm
    there_m = arm.tip_m[0]
    arm.stage.stop()
    until(lambda: not arm.tip_moves)
    assert 0.0048 < arm.tip_m[0] - there_m < 0.02


@pytest.mark.parametrize("fault, words", [
    ("protective stop", "protective stop"),
    ("emergency stop", "emergency stop"),
    ("lost program", "control program has stopped"),
    ("silence", "sent nothing"),
    ("drop", "sent nothing|connection lost"),
])  # fmt: skip
@arm_with(keys=QUICK)
def test_faults_are_seen_soon_in_the_robots_words(arm: Arm, fault: str, words: str) -> None:
    arm.stage.move(Pose(0.05, 0.0, 0.004), 0.01)
    time.sleep(0.1)
    with AwakeTime() as awake:
        began_s = awake.now()
        arm.fail(fault)
        with pytest.raises(DeviceFault, match=words):
            while awake.now() < began_s + 3:
                arm.stage.pose()
                time.sleep(0.002)
        took_s = awake.now() - began_s
    assert took_s < (0.3 if "stop" in fault or "lost" in fault else 1.5)
    arm.stage.stop()


@arm_with(keys=QUICK)
def test_connects_again_after_a_protective_stop_was_cleared(
    arm: Arm,
) -> None:
    arm.fail("protective stop")
    time.sleep(0.05)
    arm.sensor.close()
    arm.stage.close()
    arm.stage.connect()
    with pytest.raises(DeviceFault, match="protective stop"):
        arm.stage.enable()
    arm.fail(None)
    time.sleep(0.05)
    arm.stage.enable()
    arm.go(Pose(0.031, 0.0, 0.004), 0.02)


def test_nobody_there(winkler: Respond, host: str) -> None:
    made = Arm(winkler, host)
    with AwakeTime() as awake:
        with pytest.raises(DeviceAbsent, match=r"30004.*refused"):
            made.stage.connect()
        with pytest.raises(DeviceAbsent, match=r"30004.*refused"):
            made.sensor.connect()
        with ur.emulate(made.phantom, at=host) as robot:
            robot.fail("mute")
            with pytest.raises(DeviceAbsent, match="does not answer within 1 s"):
                made.stage.connect()
        assert awake.now() < 4
    with pytest.raises(DeviceFault, match="not connected"):
        made.stage.pose()
    made.stage.stop()
    made.stage.close()


class Receive:
    """A client's getters; a new cycle comes in after ``lasts`` of them."""

    def __init__(self, lasts: int) -> None:
        self._left = lasts
        self._cycle = 1

    def __getattr__(self, name: str) -> Callable[[], Any]:
        if self._left == 0:
            self._cycle += 1
        self._left -= 1
        values: dict[str, Any] = {
            "getTimestamp": 0.002 * self._cycle,
            "getActualTCPPose": [float(self._cycle)] * 6,
            "getActualTCPForce": [float(self._cycle)] * 6,
            "getTargetTCPSpeed": [0.0] * 6,
            "getSpeedScaling": 1.0,
            "getTargetSpeedFraction": 1.0,
        }
        return lambda: values.get(name, 1)


@pytest.mark.parametrize("lasts", range(1, 13))
def test_fields_of_two_cycles_are_no_sample(lasts: int) -> None:
    state = whole_state(Receive(lasts), -1.0)
    assert (state is None) == (lasts < 11)  # time, nine fields, time again
    if state is not None:
        assert state.pose[0] == state.wrench[0] == 1.0


def test_ctrl_c_at_a_terminal_is_not_for_the_client(winkler: Respond, host: str) -> None:
    """A terminal's signal reaches the whole process group; the client must outlive it to lift."""
    world = Phantom(load_scene("TIHA"), WallClock(), winkler, home=(0.03, 0.0, 0.004))
    with ur.emulate(world, at=host, origin_mm=ORIGIN_MM, noise_n=0.001):
        pressed = subprocess.Popen(
            [sys.executable, "-c", HIT_BY_CTRL_C, host],
            start_new_session=True, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert pressed.stdout is not None
        with pressed:
            assert pressed.stdout.readline() == "pressed\n"
            for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGHUP, signal.SIGTSTP):
                os.killpg(pressed.pid, number)
            time.sleep(0.3)
            assert pressed.stdout.readline() == "lifted\n"
        assert world.tip.point(world.clock.now())[2] == pytest.approx(0.004, abs=2e-4)


HIT_BY_CTRL_C = f"""
import sys, time
from drivers import DeviceFault, WallClock
from drivers.ur.settings import UrStageSettings
from drivers.ur.stage import open_stage
from probe.guards.commands import Control, RunCommand, ctrl_c
def go(stage, z_m):
    stage.move(stage.pose()._replace(z=z_m), 0.02)
    while stage.moving():
        time.sleep(0.005)
if __name__ == "__main__":
    control = Control()
    with ctrl_c(control):
        keys = dict.fromkeys(("silence_s", "watchdog_s", "stop_s"), 1.0)
        keys |= {{"host": sys.argv[1], "origin_mm": {ORIGIN_MM}}}
        stage = open_stage(WallClock(), UrStageSettings(**keys))
        for _ in range(5):  # beside other tests the first states may come late
            try:
                stage.connect()
                break
            except DeviceFault:
                continue
        go(stage, -0.001)
        print("pressed", flush=True)
        while control.command < RunCommand.ABORT:
            time.sleep(0.005)
        time.sleep(0.2)
        go(stage, 0.004)
        print("lifted", flush=True)
        stage.close()
"""


KILLED_WITH_ITS_ROBOT = f"""
import sys, time
from drivers import DeviceFault, WallClock
from drivers.ur.settings import UrStageSettings
from drivers.ur.stage import open_stage
keys = dict.fromkeys(("silence_s", "watchdog_s", "answer_s"), 5.0)
stage = open_stage(
    WallClock(), UrStageSettings(host=sys.argv[1], origin_mm={ORIGIN_MM}, **keys)
)
stage.connect()
stage.enable()
print("moves", flush=True)
while True:
    try:
        stage.stop()
        stage.move(stage.pose()._replace(z=0.003), 0.001)
    except DeviceFault:
        pass
    time.sleep(0.05)
"""


def test_a_client_outlives_neither_its_scan_nor_its_robot(winkler: Respond, host: str) -> None:
    world = Phantom(load_scene("TIHA"), WallClock(), winkler, home=(0.03, 0.0, 0.004))
    with ur.emulate(world, at=host, origin_mm=ORIGIN_MM, noise_n=0.001) as robot:
        scan = subprocess.Popen(
            [sys.executable, "-c", KILLED_WITH_ITS_ROBOT, host], stdout=subprocess.PIPE, text=True
        )
        with scan:
            assert scan.stdout is not None
            assert scan.stdout.readline() == "moves\n"
            children = ["pgrep", "-P", str(scan.pid), "-f", "drivers.core.child"]
            found = subprocess.run(children, capture_output=True, text=True, check=True).stdout
            client = Path(f"/proc/{int(found)}")
            robot.fail("drop")
            time.sleep(0.5)
            scan.kill()
        with AwakeTime() as awake:
            while client.exists():
                assert awake.now() < 20.0
                time.sleep(0.05)


@arm_with(keys=QUICK)
def test_a_client_that_hangs_holds_up_nobody(arm: Arm) -> None:
    """A guard that keeps telling it of checked forces, and a stop, go on without it."""
    arm.stage.move(Pose(0.05, 0.0, 0.004), 0.002)
    ours = ["pgrep", "-P", str(os.getpid()), "-f", "drivers.core.child"]
    (client,) = subprocess.run(ours, capture_output=True, text=True, check=True).stdout.split()
    os.kill(int(client), signal.SIGSTOP)
    with AwakeTime() as awake:
        for _ in range(20_000):
            arm.stage.keep_alive()
        arm.stage.stop()
        assert awake.now() < 5.0
    with pytest.raises(DeviceFault, match=r"sent nothing for .* allowed: silence_s = "):
        while arm.stage.moving():
            time.sleep(0.01)
    there = arm.tip_m
    time.sleep(0.1)
    assert arm.tip_m == there
