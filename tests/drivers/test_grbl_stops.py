"""The GRBL driver's stops and refusals, against a board written apart from palpate's emulator.

The board is the fault campaign's: it can lose stops, fall silent and lie, and notes every order to
stop that came over the wire.
"""

import time
from collections.abc import Iterator
from contextlib import closing

import pytest
from campaign.board import ORIGIN_MM, Board
from campaign.world import Bed, World
from peer import Peer
from waiting import until

from drivers import DeviceFault, Pose, WallClock
from drivers.grbl.stage import GrblSettings, GrblStage, open_stage
from sim_backend.emulators.serving import Served, served

HOME = (0.010, 0.0, 0.008)
FAR = Pose(0.060, 0.0, 0.008)
PATIENT = {"answer_s": 3.0, "silent_s": 0.5}  # the board shares this machine with other tests
LIMITS_MM = ((-5.0, 70.0), (-5.0, 5.0), (-4.0, 50.0))


class Bench(Peer):
    """The board as a device of `served`."""

    def __init__(self, board: Board) -> None:
        self.board = board

    def received(self, data: bytes) -> bytes:
        self.board.received(data)
        return self.due()

    def due(self) -> bytes:
        self.board.world.advance(time.monotonic())
        return self.board.due()


@pytest.fixture
def board() -> Board:
    return Board(World(Bed(), time.monotonic(), HOME))


@pytest.fixture
def line(board: Board) -> Iterator[Served]:
    with served(Bench(board), "pty", "grbl") as device:
        yield device


@pytest.fixture
def stage(line: Served, request: pytest.FixtureRequest) -> Iterator[GrblStage]:
    settings = GrblSettings(
        port=line.address, origin_mm=ORIGIN_MM, limits_mm=LIMITS_MM,
        status_hz=getattr(request, "param", 100.0), **PATIENT,
    )  # fmt: skip
    with closing(open_stage(WallClock(), settings)) as made:
        made.connect()
        yield made


def set_off(stage: GrblStage, board: Board) -> None:
    stage.move(FAR, 0.02)
    until(lambda: board.world.speed_m_s > 0)


@pytest.mark.parametrize("stage", [5.0], indirect=True)
def test_a_stop_does_not_wait_for_the_next_status(stage: GrblStage, board: Board) -> None:
    set_off(stage, board)
    stage.stop()
    assert until(lambda: bool(board.stops)) < 0.1  # of 0.2 s from status to status


def test_a_board_without_homing_that_restarted_is_not_believed(
    stage: GrblStage, board: Board
) -> None:
    """It is not locked then, and counts from where it stands."""
    set_off(stage, board)
    board.restart(homing=False)
    with pytest.raises(DeviceFault, match="restarted by itself"):
        until(lambda: stage.pose() is None)


@pytest.mark.parametrize("lost", [1, 5, 12])
def test_a_stop_that_is_not_heard_is_repeated(lost: int, stage: GrblStage, board: Board) -> None:
    """In a move straight up, of which the board knows all."""
    board.ills.lost_stops = lost
    stage.move(Pose(*HOME)._replace(z=0.045), 0.02)
    until(lambda: board.world.speed_m_s > 0)
    stage.stop()
    until(lambda: not board.world.moving, 1.0)
    assert len(board.stops) > lost


def test_a_stop_while_the_board_thinks_about_a_move_is_not_lost(
    stage: GrblStage, board: Board
) -> None:
    """The order reaches a board at rest; the move that it was meant for is accepted after it."""
    command = stage._line()[0].command

    def stopped_meanwhile(text: str, timeout_s: float) -> None:
        stage.stop()
        until(lambda: not stage._line()[1].stopping)
        command(text, timeout_s)

    stage._line()[0].command = stopped_meanwhile  # type: ignore[method-assign]
    stage.move(FAR, 0.02)
    until(lambda: bool(board.jogs))
    until(lambda: not board.world.moving, 0.5)
    assert board.world.place[0] < 0.02


def test_a_target_beyond_the_rigs_limits_is_not_sent(stage: GrblStage, board: Board) -> None:
    with pytest.raises(DeviceFault, match=r"z = -4\.5 mm"):
        stage.move(Pose(0.010, 0.0, -4.5e-3), 0.01)
    assert not board.jogs


@pytest.mark.parametrize("speed_m_s", [0.026, 0.0, -0.01, float("nan")])
def test_a_speed_beyond_the_stages_is_not_sent(
    speed_m_s: float, stage: GrblStage, board: Board
) -> None:
    with pytest.raises(DeviceFault, match="speed"):
        stage.move(FAR, speed_m_s)
    assert not board.jogs
