"""GRBL where the line dies, a stop is not obeyed, a door opens: seen from the board's side.

The press is 2.4 mm at 1.2 mm/s; places are the emulated machine's own, not what it reports.
"""

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from true_tip import HasTip
from waiting import until

from drivers import DeviceFault, MotionFault, Pose, SimulatedClock, WallClock
from drivers.core.segments import AHEAD_S, SegmentedMove
from drivers.grbl.stage import GrblSettings, GrblStage, open_stage
from sim_backend import load_scene
from sim_backend.emulators import grbl
from sim_backend.emulators.grbl import GrblBoard
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom, Respond

TOP, BOTTOM = Pose(0.032, 0.0, 0.002), Pose(0.032, 0.0, -0.0024)
SPEED_M_S = 1.2e-3
PERIOD_S = 0.01
BOUND_M = SPEED_M_S * (AHEAD_S + PERIOD_S) + 10e-6
"""What the board knows, its braking and two of its steps."""
BUSY_M = 0.1e-3  # 80 ms in which a busy machine looks late at what has happened


@pytest.fixture
def home() -> tuple[float, float, float]:
    return (0.032, 0.0, 0.0)


@pytest.fixture
def stage(board: Served) -> Iterator[GrblStage]:
    keys = GrblSettings(
        port=board.address, origin_mm=grbl.ORIGIN_MM, status_hz=1 / PERIOD_S, answer_s=3.0,
        silent_s=3.0,
    )  # fmt: skip
    made = open_stage(WallClock(), keys)
    made.connect()
    yield made
    made.close()


@dataclass
class Tip(HasTip):
    """Where the machine truly is."""

    phantom: Phantom

    @property
    def z(self) -> float:
        return self.tip_m[2]


@pytest.fixture
def tip(phantom: Phantom) -> Tip:
    return Tip(phantom)


@pytest.fixture
def pressing(stage: GrblStage, tip: Tip) -> GrblStage:
    """A press half a millimetre deep."""
    stage.move(BOTTOM, SPEED_M_S)
    until(lambda: tip.z < -0.5e-3)
    return stage


def at_rest(stage: GrblStage) -> bool:
    """A board that is unlocked after its reset, or whose door is open, has a fault meanwhile."""
    try:
        return not stage.moving()
    except DeviceFault:
        return False


def lift(stage: GrblStage, tip: Tip) -> None:
    until(lambda: at_rest(stage))
    top = stage.pose()._replace(z=tip.z + 4e-3)
    stage.move(top, 5e-3)
    until(lambda: not stage.moving())
    assert tip.z == pytest.approx(top.z, abs=1e-5)


@pytest.mark.usefixtures("pressing")
@pytest.mark.parametrize("fault", ["silence", "frozen reports"])
def test_a_board_that_is_left_alone_comes_to_rest(fault: str, board: Served, tip: Tip) -> None:
    """Nothing is heard of it, or not where it is."""
    before = tip.z
    board.fail(fault)
    assert before - tip.rests_m() < BOUND_M + BUSY_M


NOT_OBEYED = {"seven bits": 1, "ignores 0x85": 1, "ignores 0x85 and !": 2}


@pytest.mark.parametrize("fault", NOT_OBEYED)
def test_where_a_stop_is_not_obeyed_the_next_means_is(
    fault: str, stage: GrblStage, board: Served, tip: Tip
) -> None:
    """In a lift, of which the board knows all: 30 mm in 3 s. The last means costs the place."""
    stage.move(TOP._replace(z=0.03), 0.01)
    until(lambda: tip.z > 2e-3)
    board.fail(fault)
    *deaf, heard = stage.stop_means()[: NOT_OBEYED[fault] + 1]
    for means in deaf:
        means.call()
        time.sleep(means.within_s)
        assert tip.tip_moves
    heard.call()
    assert until(lambda: not tip.tip_moves, 1.0) < heard.within_s + 0.1
    until(lambda: at_rest(stage))
    if "reset" in heard.name:
        for refused in (lambda: stage.move(TOP, SPEED_M_S), stage.enable):
            with pytest.raises(DeviceFault, match="reset while it moved"):
                refused()
    lift(stage, tip)


@pytest.mark.parametrize("fault", NOT_OBEYED)
def test_a_press_whose_stop_is_not_obeyed_ends_soon_and_is_lifted(
    fault: str, pressing: GrblStage, board: Served, tip: Tip
) -> None:
    board.fail(fault)
    before = tip.z
    pressing.stop()
    assert before - tip.rests_m() < BOUND_M + BUSY_M
    lift(pressing, tip)


@pytest.mark.parametrize(
    ("fault", "words"), [("door", "safety door is open"), ("door while jogging", "safety door"),
                         ("sleep", "the board sleeps")]
)  # fmt: skip
def test_what_holds_a_press_is_said(
    fault: str, words: str, pressing: GrblStage, board: Served, tip: Tip
) -> None:
    board.fail(fault)
    with pytest.raises(MotionFault, match=words):
        until(lambda: not pressing.moving())
    pressing.stop()
    time.sleep(0.1)
    with pytest.raises(MotionFault, match=words):  # as long as it lasts: nobody lifts it
        pressing.moving()
    assert tip.z < -0.4e-3


@pytest.mark.parametrize("fault", ["door", "door while jogging"])
def test_a_press_is_lifted_once_the_door_is_shut(
    fault: str, pressing: GrblStage, board: Served, tip: Tip
) -> None:
    board.fail(fault)
    with pytest.raises(MotionFault):
        until(lambda: not pressing.moving())
    pressing.stop()
    time.sleep(0.1)
    board.fail(None)
    lift(pressing, tip)


def test_a_press_that_goes_on_after_the_door_has_failed(pressing: GrblStage, board: Served) -> None:
    board.fail("door while jogging")
    time.sleep(0.3)
    board.fail(None)
    time.sleep(0.1)
    with pytest.raises(MotionFault, match="safety door"):
        pressing.moving()


def test_a_jog_that_somebody_else_cancels_has_failed(pressing: GrblStage) -> None:
    """As a hold button does: GRBL 1.1 forgets the jog, and says Idle."""
    pressing._line()[0].realtime(b"\x85")
    words = r"came to rest 1\.\d\d mm from its target: somebody held it"
    with pytest.raises(MotionFault, match=words):
        until(lambda: not pressing.moving())


@pytest.mark.parametrize("late_s", [0.0, 0.02, 0.05])
def test_segments_leave_no_ripple_in_a_ramp(late_s: float, winkler: Respond) -> None:
    """A report every 20 ms, and each segment as late as a busy machine may make it.

    A touch is seen in the force as soon as it stands out of noise: a board that slowed at each
    joint would draw 40 of them.
    """
    clock = SimulatedClock()
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=(0.032, 0.0, 0.0))
    board = GrblBoard(phantom, grbl.ORIGIN_MM, 1e6, True, (0.0, 0.0, 0.0))
    start, speed = (-48.0, -20.0, -52.0), 1e3 * SPEED_M_S
    move = SegmentedMove(
        start, (-48.0, -20.0, -54.4), speed, ahead_mm=(AHEAD_S + 0.02) * speed, shortest_mm=0.025
    )
    segments = 0
    while clock.now() < 3.0:
        report = board.received(b"?").decode()
        found = re.search(r"MPos:([-\d.]+),([-\d.]+),([-\d.]+)", report)
        assert found is not None
        x, y, z = map(float, found.groups())
        clock.sleep_until(clock.now() + late_s)
        while (to := move.next((x, y, z))) is not None:
            words = "".join(f"{a}{v:.4f}" for a, v in zip("XYZ", to, strict=True))
            assert board.received(f"$J=G53{words}F{60 * speed:.3f}\n".encode()) == b"ok\r\n"
            segments += 1
        clock.sleep_until(clock.now() + 0.02)
        board.due()
    assert segments == 38  # the first is as long as three
    times = late_s + np.arange(0.01, 1.99, 1e-3)
    assert phantom.tip.point(3.0)[2] == pytest.approx(-2.4e-3, abs=1e-6)
    force = phantom.force_n(times)
    even = np.interp(times, times[[0, -1]], force[[0, -1]])
    assert np.abs(force - even).max() < 1e-5  # of 1.15 N; a report is rounded to a micrometre
