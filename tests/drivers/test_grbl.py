"""The GRBL driver against an emulated board in the phantom: moves, stops, alarms, probing."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers import DeviceAbsent, DeviceFault, Pose, WallClock
from drivers.grbl import GrblStage, open_stage
from sim_backend import load_scene
from sim_backend.emulators import grbl
from sim_backend.emulators.serving import Served
from sim_backend.phantom import Phantom, Respond

HOME = (0.032, 0.0, 0.004)


@pytest.fixture
def clock() -> WallClock:
    return WallClock()


@pytest.fixture
def phantom(clock: WallClock, winkler: Respond) -> Phantom:
    return Phantom(load_scene("TIHA"), clock, winkler, home=HOME)


@pytest.fixture
def board(phantom: Phantom, tmp_path: Path) -> Iterator[Served]:
    with grbl.emulate(phantom, at=str(tmp_path / "tty"), homed=True) as served:
        yield served


@pytest.fixture
def stage(board: Served, clock: WallClock) -> Iterator[GrblStage]:
    made = open_stage(clock, port=board.address, origin_mm=grbl.ORIGIN_MM)
    made.connect()
    yield made
    made.close()


def until(ready: Callable[[], bool], timeout_s: float = 3.0) -> float:
    began = time.monotonic()
    while not ready():
        assert time.monotonic() - began < timeout_s, "took too long"
        time.sleep(0.002)
    return time.monotonic() - began


def test_moves_without_blocking_and_arrives(stage: GrblStage) -> None:
    assert stage.pose()[:3] == pytest.approx(HOME, abs=1e-6)
    began = time.monotonic()
    stage.move(Pose(0.030, 0.0, 0.004), 0.01)
    assert time.monotonic() - began < 0.15
    assert stage.moving()
    assert until(lambda: not stage.moving()) == pytest.approx(0.2, abs=0.12)
    assert stage.pose()[:3] == pytest.approx((0.030, 0.0, 0.004), abs=2e-6)


def test_stop_from_another_thread_ends_a_move_at_once(stage: GrblStage) -> None:
    stage.move(Pose(0.002, 0.0, 0.004), 0.02)
    time.sleep(0.2)
    threading.Thread(target=stage.stop).start()
    assert until(lambda: not stage.moving()) < 0.2
    x = stage.pose().x
    assert 0.025 < x < 0.031
    stage.stop()
    stage.stop()
    assert not stage.moving()
    stage.move(Pose(x + 0.001, 0.0, 0.004), 0.02)  # and it goes on from there
    until(lambda: not stage.moving())
    assert stage.pose().x == pytest.approx(x + 0.001, abs=2e-6)


def test_a_second_move_is_refused_while_the_first_runs(stage: GrblStage) -> None:
    stage.move(Pose(0.030, 0.0, 0.004), 0.005)
    with pytest.raises(DeviceFault, match="still moving"):
        stage.move(Pose(0.032, 0.0, 0.004), 0.005)


def test_a_target_outside_the_travel_is_refused_in_words(stage: GrblStage) -> None:
    with pytest.raises(DeviceFault, match="error 15: the target is outside"):
        stage.move(Pose(0.2, 0.0, 0.004), 0.02)
    assert not stage.moving()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("alarm", "emergency stop"),
        ("limit", "hard limit switch"),
        ("restart", "restarted by itself|alarm"),
        ("silence", "no status|silent"),
        ("drop", "connection lost"),
        ("garbage", "no status|silent"),
    ],
)
def test_a_fault_in_a_move_is_told_in_words(
    stage: GrblStage, board: Served, phantom: Phantom, clock: WallClock, fault: str, words: str
) -> None:
    stage.move(Pose(0.012, 0.0, 0.004), 0.02)
    time.sleep(0.05)
    board.fail(fault)
    began = time.monotonic()
    with pytest.raises(DeviceFault, match=words):
        until(lambda: stage.pose() is None)
    assert time.monotonic() - began < 0.6
    if fault not in ("drop",):
        stage.stop()  # never raises; the board still hears
        until(lambda: not phantom.tip.moving(clock.now()), 0.5)


def test_probing_latches_where_the_contact_closed(stage: GrblStage) -> None:
    touched = stage.probe(0.006, 0.004)
    depth_mm = -1e3 * touched.z
    assert depth_mm == pytest.approx(1e3 * 0.05 / 480, abs=0.03)  # 0.05 N on 480 N/m
    assert stage.pose().z < touched.z  # the machine stops a little later


def test_probing_air_or_an_open_circuit_is_told(stage: GrblStage) -> None:
    with pytest.raises(DeviceFault, match="alarm 5: probe: no contact"):
        stage.probe(0.002, 0.02)


def test_a_probe_can_be_stopped(stage: GrblStage) -> None:
    threading.Timer(0.3, stage.stop).start()
    with pytest.raises(DeviceFault, match="reset"):
        stage.probe(0.0039, 0.001)
    assert until(lambda: not stage.moving()) < 0.3
    assert stage.pose().z > 0.003


def test_a_locked_board_must_be_homed(phantom: Phantom, clock: WallClock) -> None:
    with grbl.emulate(phantom) as board:
        locked = open_stage(clock, port=board.address, origin_mm=grbl.ORIGIN_MM)
        with pytest.raises(DeviceFault, match="home = true"):
            locked.connect()
        homing = open_stage(clock, port=board.address, origin_mm=grbl.ORIGIN_MM, home=True)
        homing.connect()
        assert homing.pose()[:3] == pytest.approx((0.079, 0.019, 0.051), abs=2e-6)
        homing.close()


def test_inches_are_understood(board: Served, clock: WallClock) -> None:
    made = open_stage(clock, port=board.address, origin_mm=grbl.ORIGIN_MM)
    made.connect()
    made._line().command("$13=1", 1.0)
    made.close()
    made.connect()
    assert made.pose()[:3] == pytest.approx(HOME, abs=2e-5)
    made.move(Pose(0.031, 0.0, 0.004), 0.02)
    until(lambda: not made.moving())
    assert made.pose().x == pytest.approx(0.031, abs=2e-5)
    made.close()


def test_an_absent_port_names_what_there_is(clock: WallClock) -> None:
    with pytest.raises(DeviceAbsent, match="no such port; serial ports here"):
        open_stage(clock, port="/dev/ttyNOT").connect()


def test_something_else_at_the_port_is_no_stage(board: Served, clock: WallClock) -> None:
    board.fail("garbage")
    made = open_stage(clock, port=board.address)
    with pytest.raises(DeviceAbsent, match="no GRBL answers"):
        made.connect()
    assert not [t for t in threading.enumerate() if t.name == "palpate grbl"]


def test_unplugged_and_plugged_in_again(stage: GrblStage, board: Served) -> None:
    board.fail("drop")
    with pytest.raises(DeviceFault):
        until(lambda: stage.pose() is None)
    stage.close()
    with pytest.raises(DeviceFault, match="not connected"):
        stage.pose()
    board.fail(None)
    time.sleep(0.05)
    stage.connect()
    assert stage.pose()[:3] == pytest.approx(HOME, abs=1e-6)


def test_settings_of_any_kind_are_read(board: Served, clock: WallClock) -> None:
    """grblHAL lists addresses, names and floats among its numbers."""
    made = open_stage(clock, port=board.address)
    made.connect()
    talk = made._line()
    for line in ("$302=192.168.5.1", "$300=grbl.local", "$110=6000.000", "$5=", "$N0=G54"):
        talk._understand(line)
    assert talk.settings[110] == 6000.0
    assert not {5, 300, 302} & set(talk.settings)
    assert talk.gone is None
    made.close()


def test_a_slow_axis_is_told_at_connection(
    board: Served, clock: WallClock, caplog: pytest.LogCaptureFixture
) -> None:
    made = open_stage(clock, port=board.address, max_speed_mm_s=60.0)
    made.connect()
    made.close()
    assert "the board moves z at 50 mm/s at most ($112)" in caplog.text
    assert "moves x" not in caplog.text


def test_after_an_alarm_the_board_can_be_unlocked(stage: GrblStage) -> None:
    with pytest.raises(DeviceFault, match="alarm 5"):
        stage.probe(0.001, 0.02)
    with pytest.raises(DeviceFault, match="alarm 5"):
        stage.move(Pose(0.031, 0.0, 0.004), 0.02)
    stage.unlock()
    stage.move(Pose(0.031, 0.0, 0.004), 0.02)
    until(lambda: not stage.moving())
