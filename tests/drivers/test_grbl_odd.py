"""The GRBL driver on a board with odd habits, written from GRBL 1.1's own documents and source."""

import math
import re
import socket
import time
from collections.abc import Iterator

import pytest
from peer import Peer
from waiting import OnlyWaits, until

from drivers import DeviceAbsent, DeviceFault, Pose, WallClock
from drivers.grbl.board import BoardSettings
from drivers.grbl.line import Conversation
from drivers.grbl.stage import GrblSettings, GrblStage, open_stage
from sim_backend.emulators.serving import Served, served


class Board(Peer):
    """Jogs for ever, until 0x85; it heeds that only while it jogs, as GRBL's serial.c does."""

    def __init__(self) -> None:
        self.place, self.state, self.report = "0.000,0.000,0.000", "Idle", ""
        self.mute, self.late_s = False, 0.0
        self.jogs = self.cancelled = 0
        self._line, self._begins_s = b"", float("inf")

    def received(self, data: bytes) -> bytes:
        answer = b""
        for byte in () if self.mute else re.findall(rb"(?s).", data):
            if byte == b"?":
                report = self.report or f"<{self.state}|MPos:{self.place}|Bf:15,128>"
                answer += f"{report}\r\n".encode()
            elif byte == b"\x85":
                if self.state == "Jog":
                    self.state, self.cancelled = "Idle", self.cancelled + 1
            elif byte != b"\n":
                self._line += byte
            else:
                line, self._line = self._line, b""
                if line.startswith(b"$J="):
                    self._begins_s = time.monotonic() + self.late_s
                else:
                    answer += b"ok\r\n"
        return answer

    def due(self) -> bytes:
        if time.monotonic() < self._begins_s:
            return b""
        self._begins_s, self.state, self.jogs = float("inf"), "Jog", self.jogs + 1
        return b"ok\r\n"


@pytest.fixture
def board() -> Board:
    return Board()


@pytest.fixture
def line(board: Board) -> Iterator[Served]:
    with served(board, "pty", "grbl") as device:
        yield device


@pytest.fixture
def stage(line: Served) -> Iterator[GrblStage]:
    keys = GrblSettings(port=line.address, answer_s=0.2, silent_s=0.5)
    made = open_stage(WallClock(), keys)
    made.connect()
    yield made
    made.close()


@pytest.mark.parametrize("place", ["nan,nan,nan", "0.000,inf,0.000"])
def test_a_position_that_is_no_number_is_no_pose(
    stage: GrblStage, board: Board, place: str
) -> None:
    board.place = place
    with pytest.raises(DeviceFault, match="no status"):
        until(lambda: stage.pose() is None)


class Answers:
    """A port at which each line is answered the same; None: reading it is a mistake."""

    in_waiting = 1

    def __init__(self, answer: bytes | None) -> None:
        self._answer, self._due = answer, b""

    def write(self, data: bytes) -> None:
        if data != b"?":
            self._due = self._answer or b""

    def read(self, _size: int = 1) -> bytes:
        if self._answer is None:
            raise ZeroDivisionError("what")
        due, self._due = self._due, b""
        return due

    def close(self) -> None: ...
    def reset_input_buffer(self) -> None: ...


def test_a_mistake_while_listening_is_said_as_what_it_is() -> None:
    """And at once, not as the silence that follows."""
    talk = Conversation("mine", Answers(None), 0.1)
    with pytest.raises(DeviceFault, match=r"lost .driver: ZeroDivisionError: what"):
        talk.fresh(1.0)
    talk.close()


@pytest.mark.parametrize("number, words", [
    (8, "only possible when idle"),
    (9, "locked by an alarm or a jog"),
    (15, "outside the machine's travel"),
    (99, "see the controller manual"),
])  # fmt: skip
def test_why_the_board_refuses_is_said_in_words(number: int, words: str) -> None:
    talk = Conversation("mine", Answers(f"error:{number}\n".encode()), 0.1)
    with pytest.raises(DeviceFault, match=f"refused: error {number}: .*{words}"):
        talk.command("$J=X1", 2.0)
    talk.close()


SPACED = b"""$10 = 1    (Status report, mask)
$13 = 1    (Report in inches, boolean)
$110 = 500.000 (x max rate, mm/min)
$111=3000.000 (y)
$302=192.168.5.1
$300=grbl.local
$5=
$N0=G54
ok
"""


def test_settings_of_any_kind_are_read() -> None:
    """With blanks around the sign or not: a board that reports in inches must not be misread; of
    grblHAL's addresses and names only numbers are kept."""
    talk = Conversation("mine", Answers(SPACED), 0.1)
    talk.command("$$", 2.0)
    assert talk.settings == {10: 1.0, 13: 1.0, 110: 500.0, 111: 3000.0}
    assert BoardSettings(talk.settings).unit_mm == 25.4
    talk.close()


@pytest.mark.parametrize("report, words", [
    ("<Idle|MPos:0.000,0.000|Bf:15,128>", "two axes, x and y, and the probe is pressed along"),
    ("<Idle,MPos:0.000,0.000,0.000,WPos:0.000,0.000,0.000>", r"GRBL 0\.9 or older.*no jogs"),
])  # fmt: skip
def test_a_board_that_answers_and_cannot_be_used_is_told_why(
    line: Served, board: Board, report: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And is not called absent: a rig that falls back on a virtual stage keeps to it."""
    monkeypatch.setattr("drivers.grbl.stage.HELLO_S", 1.0)
    board.report = report
    with pytest.raises(DeviceFault, match=words) as fault:
        open_stage(WallClock(), GrblSettings(port=line.address)).connect()
    assert not isinstance(fault.value, DeviceAbsent)


def test_one_damaged_report_is_no_other_board(stage: GrblStage, board: Board) -> None:
    board.report = "<Idle|MPos:0.000,0.000|Bf:15,128>"
    until(lambda: stage._line()[0]._puzzled > 0)
    board.report = ""
    assert stage.pose().z == 0.0


@pytest.mark.parametrize("numbers, at_mm, to_mm, refused", [
    ({20: 1, 22: 1, 132: 60}, -10.0, -61.0, r"z = -61 mm in machine.*\$132 = 60"),
    ({20: 1, 22: 1, 132: 60}, -10.0, 1.0, "error 15: the target is outside"),
    ({20: 1, 22: 1, 132: 60}, 10.0, 59.0, None),  # built to count from 0 upwards
    ({20: 1, 22: 1, 132: 60}, 10.0, -1.0, "error 15"),
    ({20: 0, 22: 1, 132: 60}, -10.0, -61.0, None),
    ({}, -10.0, -1e4, None),
])  # fmt: skip
def test_what_a_board_would_refuse_in_mid_move_is_known_before(
    numbers: dict[int, float], at_mm: float, to_mm: float, refused: str | None
) -> None:
    why = BoardSettings(numbers).beyond_travel((0.0, 0.0, at_mm), (0.0, 0.0, to_mm))
    if refused is None:
        assert why is None
    else:
        assert re.search(refused, str(why))


def test_a_work_position_is_a_place_once_its_zero_is_reported() -> None:
    said = b"<Idle|WPos:1.000,2.000,3.000|WCO:10.000,20.000,-30.000>\nok\n"
    talk = Conversation("mine", Answers(said), 0.1)
    talk.command("$X", 2.0)
    assert talk.status is not None
    assert talk.status.position == (11.0, 22.0, -27.0)
    talk.close()


@pytest.mark.parametrize("arrives_s", [15.0, math.inf])
def test_a_long_way_to_the_park_is_given_its_time(
    arrives_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """100 mm at 10 mm/s."""
    clock = OnlyWaits(least_s=0.1)
    stage = GrblStage(GrblSettings(port="-", park_mm=(100.0, 0.0, 0.0), max_speed_mm_s=10.0))
    monkeypatch.setattr("drivers.grbl.stage.time", clock)
    monkeypatch.setattr(stage, "pose", lambda: Pose(0.0, 0.0, 0.0))
    monkeypatch.setattr(stage, "move", lambda _target, _speed_m_s: None)
    monkeypatch.setattr(stage, "moving", lambda: clock.monotonic() < arrives_s)
    if arrives_s < math.inf:
        stage._park(0)
        assert clock.monotonic() >= arrives_s
    else:
        with pytest.raises(DeviceFault, match="has not reached park_mm"):
            stage._park(0)


def test_a_board_that_a_limit_alarm_has_silenced_is_reported(
    line: Served, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GRBL 1.1 loops until it is reset, and answers no `?` meanwhile."""
    monkeypatch.setattr("drivers.grbl.stage.HELLO_S", 0.2)
    board.mute = True
    with pytest.raises(DeviceAbsent, match="silent after a limit alarm until it is reset"):
        open_stage(WallClock(), GrblSettings(port=line.address)).connect()


def test_a_silent_address_may_serve_another_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board that another scan moves is not to be reset."""
    monkeypatch.setattr("drivers.grbl.stage.HELLO_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = f"socket://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(DeviceAbsent, match="or another program is connected to it: end that"):
            open_stage(WallClock(), GrblSettings(port=port)).connect()


@pytest.mark.parametrize("ends", ["stop", "close"])
def test_a_move_that_is_taken_late_is_stopped_all_the_same(
    stage: GrblStage, board: Board, ends: str
) -> None:
    """The stop comes before the board has begun, and is not heeded then."""
    board.late_s = 0.8
    with pytest.raises(DeviceFault, match="no answer"):
        stage.move(Pose(0.05, 0.0, 0.0), 0.01)
    assert board.jogs == 0
    getattr(stage, ends)()
    until(lambda: board.jogs == 1)
    until(lambda: board.cancelled == 1)


def test_a_move_after_one_that_was_never_answered_is_not_stopped(
    stage: GrblStage, board: Board
) -> None:
    """Such as the lift after a line that was lost."""
    board.late_s = 1e6
    with pytest.raises(DeviceFault, match="no answer"):
        stage.move(Pose(0.0, 0.0, -0.001), 0.01)
    stage.stop()
    board.late_s = 0.0
    stage.move(Pose(0.0, 0.0, 0.005), 0.01)
    until(lambda: board.jogs == 1)
    time.sleep(0.3)
    assert (board.state, board.cancelled) == ("Jog", 0)
