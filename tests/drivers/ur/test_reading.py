"""Reading only reads; control is taken when it is asked for, and from nobody who runs."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from emulated_ur import Rig, connected, fresh_host

from drivers import DeviceAbsent, DeviceFault, Pose
from drivers.ur.stops import why_stopped
from sim_backend.emulators import ur
from sim_backend.emulators.ur.robot import SET_TCP
from sim_backend.phantom.phantom import Respond

TCP = {"tcp_mm_rad": (0.0, 0.0, 120.0, 0.0, 0.0, 0.0), "payload_kg": 0.4}


def test_reading_leaves_another_program_and_the_settings_alone(winkler: Respond) -> None:
    with connected(winkler, keys=TCP) as (made, robot):
        robot.fail("other program")
        time.sleep(0.05)
        made.stage.pose()
        made.sensor.start()
        count = 0
        while count < 20:  # a robot that no longer tells is a fault
            time.sleep(0.02)
            count += len(made.sensor.read().time_s)
        made.sensor.tare()
        made.close()
        assert robot.robot.foreign
        assert robot.robot.playing
        assert robot.robot.uploads == 0


def test_another_program_is_replaced_only_if_ordered(winkler: Respond) -> None:
    with connected(winkler) as (made, robot):
        robot.fail("other program")
        time.sleep(0.05)
        with pytest.raises(DeviceFault, match=r"another program runs.*replace_program"):
            made.stage.enable()
        assert robot.robot.foreign
    with connected(winkler, keys={"replace_program": True}) as (made, robot):
        robot.fail("other program")
        time.sleep(0.05)
        made.stage.enable()
        assert not robot.robot.foreign
        assert robot.robot.uploads == 1


def test_what_holds_is_reported(winkler: Respond) -> None:
    with connected(winkler, keys=TCP) as (made, robot):
        robot.robot.slide(0.2)
        notes = " / ".join(made.stage.enable())
        assert "tool centre 0.0, 0.0, 120.0 mm, payload 0.40 kg" in notes
        assert "PolyScope 5.11.0 at 500 Hz, safety mode normal, speed slider 20 %" in notes
        assert "slows every move to 20 %" in notes
        assert made.stage.enable() == []  # nothing new


def test_a_move_that_another_program_does_not_obey_says_so(winkler: Respond) -> None:
    with connected(winkler, keys={"answer_s": 0.2}) as (made, robot):
        made.stage.enable()
        robot.fail("other program")
        x, y, z = made.stage.pose()[:3]
        with pytest.raises(DeviceFault, match=r"move refused.*does another program run"):
            made.stage.move(Pose(x, y, z - 1e-3), 5e-3)


def test_a_refused_setting_is_a_fault(winkler: Respond) -> None:
    with connected(winkler, keys=TCP) as (made, robot):
        robot.robot.refuses = frozenset({SET_TCP})
        with pytest.raises(DeviceFault, match="setTcp"):
            made.stage.enable()


def test_a_cb3_is_read_at_its_own_rate(winkler: Respond) -> None:
    with connected(winkler, version=ur.CB3) as (made, _):
        assert made.sensor.rate_hz == 125.0
        made.sensor.start()
        time.sleep(0.5)
        block = made.sensor.read()
        assert np.median(np.diff(block.time_s)) == pytest.approx(1 / 125, rel=0.01)
    made = Rig(winkler, fresh_host(), frequency_hz=500.0)
    with (
        ur.emulate(made.phantom, at=made.host, version=ur.CB3),
        pytest.raises(DeviceAbsent, match=r"CB3, PolyScope 3\.15\.0.* sends up to 125"),
    ):
        made.stage.connect()


def test_polyscope_x_is_reported_by_name(winkler: Respond) -> None:
    with (
        connected(winkler, version=ur.POLYSCOPE_X) as (made, robot),
        pytest.raises(DeviceAbsent, match=r"PolyScope X 10\.7\.0.*only reading"),
    ):
        made.stage.pose()
        made.stage.enable()
    assert robot.robot.uploads == 0


@pytest.mark.parametrize(
    ("safety", "robot", "words"),
    [
        (1, 7, None),
        (3, 7, "protective stop"),
        (9, 7, "safety fault"),
        (1, 3, "power off"),
        (1, 5, "release the brakes"),
        (1, 6, "back-drive"),
        (1, 99, "(99)"),
    ],
)
def test_why_a_robot_does_not_work_is_said_in_words(
    safety: int, robot: int, words: str | None
) -> None:
    state = SimpleNamespace(safety_mode=safety, robot_mode=robot, runtime_state=0)
    said = why_stopped(state, controls=False)  # type: ignore[arg-type]
    assert (said is None) == (words is None)
    assert words is None or words in said
