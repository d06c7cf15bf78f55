"""Reading only reads; control is taken when it is asked for, and from nobody who runs."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from emulated_ur import Arm, arm_with, connected, fresh_host

from drivers import DeviceAbsent, DeviceFault, Pose
from drivers.ur.stops import why_stopped
from sim_backend.emulators import ur
from sim_backend.emulators.ur.robot import SET_TCP
from sim_backend.phantom.phantom import Respond

TCP = {"tcp_mm_rad": (0.0, 0.0, 120.0, 0.0, 0.0, 0.0), "payload_kg": 0.4}


@arm_with(enable=False, keys=TCP)
def test_reading_leaves_another_program_and_the_settings_alone(arm: Arm) -> None:
    arm.fail("other program")
    time.sleep(0.05)
    arm.stage.pose()
    arm.sensor.start()
    count = 0
    while count < 20:  # a robot that no longer tells is a fault
        time.sleep(0.02)
        count += len(arm.sensor.read().time_s)
    arm.sensor.tare()
    arm.close()
    assert arm.robot.foreign
    assert arm.robot.playing
    assert arm.robot.uploads == 0


@arm_with(enable=False)
def test_another_program_is_not_replaced(arm: Arm) -> None:
    arm.fail("other program")
    time.sleep(0.05)
    with pytest.raises(DeviceFault, match=r"another program runs.*replace_program"):
        arm.stage.enable()
    assert arm.robot.foreign


@arm_with(enable=False, keys={"replace_program": True})
def test_but_if_that_is_ordered(arm: Arm) -> None:
    arm.fail("other program")
    time.sleep(0.05)
    arm.stage.enable()
    assert not arm.robot.foreign
    assert arm.robot.uploads == 1


@arm_with(enable=False, keys=TCP)
def test_what_holds_is_reported(arm: Arm) -> None:
    arm.robot.slide(0.2)
    notes = " / ".join(arm.stage.enable())
    assert "tool centre 0.0, 0.0, 120.0 mm, payload 0.40 kg" in notes
    assert "PolyScope 5.11.0 at 500 Hz, safety mode normal, speed slider 20 %" in notes
    assert "slows every move to 20 %" in notes
    assert arm.stage.enable() == []  # nothing new


@arm_with(keys={"answer_s": 0.2})
def test_a_move_that_another_program_does_not_obey_says_so(arm: Arm) -> None:
    arm.fail("other program")
    x, y, z = arm.stage.pose()[:3]
    with pytest.raises(DeviceFault, match=r"move refused.*does another program run"):
        arm.stage.move(Pose(x, y, z - 1e-3), 5e-3)


@arm_with(enable=False, keys=TCP)
def test_a_refused_setting_is_a_fault(arm: Arm) -> None:
    arm.robot.refuses = frozenset({SET_TCP})
    with pytest.raises(DeviceFault, match="setTcp"):
        arm.stage.enable()


def test_a_cb3_is_read_at_its_own_rate(winkler: Respond) -> None:
    with connected(winkler, version=ur.CB3) as arm:
        assert arm.sensor.rate_hz == 125.0
        arm.sensor.start()
        time.sleep(0.5)
        block = arm.sensor.read()
        assert np.median(np.diff(block.time_s)) == pytest.approx(1 / 125, rel=0.01)
    arm = Arm(winkler, fresh_host(), frequency_hz=500.0)
    with (
        ur.emulate(arm.phantom, at=arm.host, version=ur.CB3),
        pytest.raises(DeviceAbsent, match=r"CB3, PolyScope 3\.15\.0.* sends up to 125"),
    ):
        arm.stage.connect()


@arm_with(enable=False, version=ur.POLYSCOPE_X)
def test_polyscope_x_is_reported_by_name(arm: Arm) -> None:
    arm.stage.pose()
    with pytest.raises(DeviceAbsent, match=r"PolyScope X 10\.7\.0.*only reading"):
        arm.stage.enable()
    assert arm.robot.uploads == 0


@pytest.mark.parametrize("safety, robot, words", [
    (1, 7, None),
    (3, 7, "protective stop"),
    (9, 7, "safety fault"),
    (1, 3, "power off"),
    (1, 5, "release the brakes"),
    (1, 6, "back-drive"),
    (1, 99, "(99)"),
])  # fmt: skip
def test_why_a_robot_does_not_work_is_said_in_words(
    safety: int, robot: int, words: str | None
) -> None:
    state = SimpleNamespace(safety_mode=safety, robot_mode=robot, runtime_state=0)
    said = why_stopped(state, controls=False)  # type: ignore[arg-type]
    assert (said is None) == (words is None)
    assert words is None or words in said
