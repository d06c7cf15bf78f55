"""The GRBL driver against an emulated board in the phantom: moves, stops, alarms, probing."""

import math
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
import pytest
from waiting import OnlyWaits, until

from drivers import DeviceAbsent, DeviceFault, MotionFault, Pose, WallClock
from drivers.core.ports import READ_S
from drivers.grbl.line import Conversation
from drivers.grbl.stage import GrblSettings, GrblStage, open_stage
from sim_backend.emulators import grbl
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom

HOME = (0.032, 0.0, 0.004)
PATIENT = {"answer_s": 3.0, "silent_s": 3.0}  # the emulator shares this machine with other tests


@pytest.fixture
def home() -> tuple[float, float, float]:
    return HOME


def stage_at(board: Served, **keys: Any) -> GrblStage:
    keys = {"port": board.address, "origin_mm": grbl.ORIGIN_MM} | PATIENT | keys
    return open_stage(WallClock(), GrblSettings(**keys))


@contextmanager
def connected(board: Served, **keys: Any) -> Iterator[GrblStage]:
    with closing(stage_at(board, **keys)) as made:
        made.connect()
        yield made


@pytest.fixture
def stage(board: Served) -> Iterator[GrblStage]:
    with connected(board) as made:
        yield made


def go(stage: GrblStage, target: Pose) -> None:
    """Move and arrive."""
    stage.move(target, 0.02)
    until(lambda: not stage.moving())


def test_closing_ends_a_move(stage: GrblStage, phantom: Phantom, clock: WallClock) -> None:
    stage.move(Pose(0.002, 0.0, 0.004), 0.005)
    stage.close()
    until(lambda: not phantom.tip.moving(clock.now()))
    assert phantom.tip.point(clock.now())[0] > 0.015


def test_a_second_move_is_refused_while_the_first_runs(stage: GrblStage) -> None:
    stage.move(Pose(0.030, 0.0, 0.004), 0.005)
    with pytest.raises(DeviceFault, match="still moving"):
        stage.move(Pose(0.032, 0.0, 0.004), 0.005)


def test_a_target_outside_the_travel_is_refused_in_words(stage: GrblStage) -> None:
    with pytest.raises(DeviceFault, match="error 15: the target is outside"):
        stage.move(Pose(0.2, 0.0, 0.004), 0.02)
    assert not stage.moving()


@pytest.mark.parametrize("fault, words", [
    ("alarm", "emergency stop"),
    ("limit", "hard limit switch"),
    ("restart", "restarted by itself|alarm"),
    ("silence", "no status|silent"),
    ("drop", "connection lost"),
    ("garbage", "no status|silent"),
])  # fmt: skip
def test_a_fault_in_a_move_is_reported_in_words(
    board: Served, phantom: Phantom, clock: WallClock, fault: str, words: str
) -> None:
    quiet = fault in ("silence", "garbage")
    with connected(board, silent_s=0.25 if quiet else 3.0) as stage:
        stage.move(Pose(0.012, 0.0, 0.004), 0.02)
        board.fail(fault)
        with pytest.raises(DeviceFault, match=words):
            until(lambda: stage.pose() is None, 0.6)
        if fault != "drop":
            stage.stop()  # never raises; the board still hears
            until(lambda: not phantom.tip.moving(clock.now()), 0.5)


def test_probing_latches_where_the_contact_closed(stage: GrblStage) -> None:
    touched = stage.probe(0.006, 0.004)
    depth_mm = -1e3 * touched.z
    assert depth_mm == pytest.approx(1e3 * 0.05 / 480, abs=5e-3)  # 0.05 N on 480 N/m
    assert stage.pose().z < touched.z  # the machine stops a little later


def test_a_probe_can_be_stopped(stage: GrblStage) -> None:
    threading.Timer(0.3, stage.stop).start()
    with pytest.raises(DeviceFault, match="reset"):
        stage.probe(0.0039, 0.001)
    assert until(lambda: not stage.moving()) < 0.3
    assert stage.pose().z > 0.001


def test_a_locked_board_must_be_homed(phantom: Phantom, clock: WallClock) -> None:
    with grbl.emulate(phantom) as board:
        with pytest.raises(DeviceFault, match="home = true"):
            stage_at(board).connect()
        with connected(board, home=True) as homing:
            assert phantom.tip.point(clock.now()) == pytest.approx(HOME)  # connecting moves nothing
            homing.home()
            assert homing.pose()[:3] == pytest.approx((0.079, 0.019, 0.051), abs=2e-6)


@pytest.mark.parametrize("after_s", [0.05, 0.4, 1.2])
def test_homing_can_be_stopped_at_any_instant(
    after_s: float, phantom: Phantom, clock: WallClock
) -> None:
    with (
        grbl.emulate(phantom) as board,
        connected(board, home=True, park_mm=(0.0, 0.0, 40.0)) as homing,
    ):
        threading.Timer(after_s, homing.stop).start()
        with pytest.raises(DeviceFault, match=r"reset|stopped on the way"):
            homing.home()
        until(lambda: not phantom.tip.moving(clock.now()))
        rests = phantom.tip.point(clock.now())
        time.sleep(0.2)
        assert phantom.tip.point(clock.now()) == rests


def test_inches_are_understood(board: Served) -> None:
    with connected(board) as made:
        made._line()[0].command("$13=1", 5.0)
        made.close()
        made.connect()
        assert made.pose()[:3] == pytest.approx(HOME, abs=2e-5)
        go(made, Pose(0.031, 0.0, 0.004))
        assert made.pose().x == pytest.approx(0.031, abs=2e-5)


def test_an_absent_port_names_what_there_is(clock: WallClock) -> None:
    with pytest.raises(DeviceAbsent, match="no such port; serial ports here"):
        open_stage(clock, GrblSettings(port="/dev/ttyNOT")).connect()


def test_something_else_at_the_port_is_no_stage(board: Served) -> None:
    board.fail("garbage")
    with pytest.raises(DeviceAbsent, match="no GRBL answers"):
        stage_at(board).connect()
    assert not [t for t in threading.enumerate() if t.name == "palpate grbl"]


def test_a_slow_axis_is_reported_at_connection(
    board: Served, caplog: pytest.LogCaptureFixture
) -> None:
    with connected(board, max_speed_mm_s=60.0):
        pass
    assert "the board moves z at 50 mm/s at most ($112)" in caplog.text
    assert "moves x" not in caplog.text


def test_after_an_alarm_nothing_moves(stage: GrblStage) -> None:
    with pytest.raises(DeviceFault, match="alarm 5: probe: no contact"):
        stage.probe(0.001, 0.02)
    with pytest.raises(DeviceFault, match="alarm 5"):
        stage.move(Pose(0.031, 0.0, 0.004), 0.02)


def test_a_board_after_a_limit_alarm_can_be_connected_and_homed(phantom: Phantom) -> None:
    """It refuses `$$` until it was reset."""
    with grbl.emulate(phantom, homed=True) as board:
        board.fail("limit")
        time.sleep(0.05)
        with pytest.raises(DeviceFault, match=r"home = true"):
            stage_at(board).connect()
        with connected(board, home=True) as homing:
            homing.home()
            assert homing.pose().z == pytest.approx(0.051, abs=2e-6)
            go(homing, Pose(0.078, 0.019, 0.05))


@pytest.mark.parametrize("mask", [0.0, 2.0])
def test_work_positions_alone_are_no_place(
    phantom: Phantom, monkeypatch: pytest.MonkeyPatch, mask: float
) -> None:
    """With the work zero 7 mm aside, "4 mm down" would go 7 mm sideways."""
    monkeypatch.setitem(grbl.SETTINGS, 10, mask)
    with (
        grbl.emulate(phantom, homed=True, work_mm=(7.0, 0.0, -10.0)) as board,
        pytest.raises(DeviceFault, match=rf"work positions only.*\$10={mask:g}.*set \$10=1"),
    ):
        stage_at(board).connect()


def test_a_work_zero_changes_no_pose(phantom: Phantom, clock: WallClock) -> None:
    aside = {"homed": True, "work_mm": (7.0, 0.0, -10.0)}
    with grbl.emulate(phantom, **aside) as board, connected(board) as made:
        assert made.pose()[:3] == pytest.approx(HOME, abs=1e-6)
        go(made, Pose(0.03, 0.0, 0.001))
        assert phantom.tip.point(clock.now()) == pytest.approx((0.03, 0.0, 0.001), abs=1e-6)


@pytest.mark.parametrize("fault, words", [
    ("feed hold", "feed hold is active"),
    ("other program", "runs another program"),
    ("check mode", "check mode"),
    ("switch pressed", "limit switch of z"),
])  # fmt: skip
def test_who_else_commands_the_board_is_reported_before_the_first_move(
    stage: GrblStage, board: Served, fault: str, words: str
) -> None:
    board.fail(fault)
    time.sleep(0.05)
    with pytest.raises(DeviceFault, match=words):
        stage.enable()


def test_a_feed_hold_in_a_move_is_a_fault_of_motion(stage: GrblStage, board: Served) -> None:
    stage.move(Pose(0.05, 0.0, 0.004), 0.01)
    time.sleep(0.1)
    board.fail("feed hold")
    with pytest.raises(MotionFault, match="feed hold"):
        until(lambda: not stage.moving())


def test_an_unhomed_board_is_reported(phantom: Phantom, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(grbl.SETTINGS, 22, 0.0)
    with grbl.emulate(phantom, homed=True) as board, connected(board) as made:
        assert any("$22=0" in note for note in made.enable())


def test_homing_forgives_an_earlier_restart(stage: GrblStage, board: Served) -> None:
    board.fail("restart")
    with pytest.raises(DeviceFault, match=r"restarted by itself|alarm"):
        until(lambda: stage.pose() is None)
    stage.home()
    stage.pose()


class CountingLine:
    """Answers each `?` after 12 ms, as grblHAL does; reads wait as a serial port's do."""

    def __init__(self, clock: OnlyWaits) -> None:
        self.asked: list[float] = []
        self._clock = clock
        self._answers_s = math.inf

    @property
    def in_waiting(self) -> int:
        return int(self._answers_s <= self._clock.monotonic()) and 40

    def write(self, data: bytes, /) -> int:
        self.asked.append(self._clock.monotonic())
        self._answers_s = self._clock.monotonic() + 0.012
        return len(data)

    def read(self, _size: int = 1, /) -> bytes:
        if self._answers_s > self._clock.monotonic() + READ_S:
            self._clock.sleep(READ_S)
            return b""
        self._clock.sleep(max(self._answers_s - self._clock.monotonic(), 0.0))
        self._answers_s = math.inf
        return b"<Idle|MPos:0.000,0.000,0.000|Bf:100,1023|FS:0,0>\r\n"

    def reset_input_buffer(self) -> None: ...
    def close(self) -> None: ...


def test_status_is_asked_for_as_often_as_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """A read that waits 20 ms must not delay the next question."""
    clock = OnlyWaits()
    monkeypatch.setattr("drivers.grbl.line.time", clock)
    line = CountingLine(clock)
    talk = Conversation("grbl", line, 0.02)
    until(lambda: len(line.asked) > 50)
    talk.close()
    assert np.median(np.diff(line.asked)) == pytest.approx(0.02, abs=0.002)
