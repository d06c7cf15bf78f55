"""The Standa driver on libximc's own virtual axes."""

import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers import ConfigError, DeviceAbsent, DeviceFault, Pose, WallClock
from drivers.standa import StandaStage, open_stage


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[StandaStage]:
    pytest.importorskip("libximc.highlevel")
    made = open_stage(
        WallClock(),
        x_uri=f"xi-emu:///{tmp_path}/x.bin",
        z_uri=f"xi-emu:///{tmp_path}/z.bin",
        limits_mm=((-1.0, 20.0), (0.0, 0.0), (-5.0, 5.0)),
        max_speed_mm_s=10.0,
    )
    made.connect()
    yield made
    made.close()


def wait(stage: StandaStage) -> float:
    began = time.monotonic()
    while stage.moving():
        assert time.monotonic() - began < 5
        time.sleep(0.002)
    return time.monotonic() - began


def test_the_axes_arrive_together_on_a_straight_way(stage: StandaStage) -> None:
    target = Pose(0.004, 0.0, 0.001)
    stage.move(target, 0.008)
    off = []
    while stage.moving():
        at = stage.pose()
        off.append(abs(at.z - at.x / 4))
        time.sleep(0.01)
    assert len(off) > 20
    assert max(off) < 0.05e-3
    assert stage.pose() == pytest.approx(target, abs=1e-8)


@pytest.mark.parametrize("harder", [0, 1])
def test_a_stop_ends_all_axes_and_the_next_move_starts_from_there(
    stage: StandaStage, harder: int
) -> None:
    stage.move(Pose(0.010, 0.0, 0.002), 0.005)
    time.sleep(0.3)
    means = stage.stop_means()[harder]
    threading.Thread(target=means.call).start()
    time.sleep(means.within_s)
    assert not stage.moving()
    rested = stage.pose()
    assert 0.001 < math.hypot(rested.x, rested.z) < 0.003
    stage.move(Pose(0.0, 0.0, 0.0), 0.01)
    wait(stage)
    assert stage.pose()[:3] == pytest.approx((0, 0, 0), abs=1e-8)


def test_a_stop_reaches_the_axes_behind_one_that_is_lost(
    stage: StandaStage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unplugged() -> None:
        raise ConnectionError("unplugged")

    stage.move(Pose(0.0, 0.0, 0.004), 0.001)
    time.sleep(0.2)
    monkeypatch.setattr(stage._open["x"], "command_sstp", unplugged)
    stage.stop()
    time.sleep(0.1)
    assert not stage.moving()
    assert stage.pose().z < 0.0035


@pytest.mark.parametrize("target, speed, words", [
    (Pose(0.03, 0, 0), 0.01, "x = 30 mm; allowed: -1 to 20 mm"),
    (Pose(0, 0.001, 0), 0.01, "there is no y axis"),
    (Pose(0.001, 0, 0), 0.02, "speed 20 mm/s; allowed: above 0 up to max_speed_mm_s = 10"),
    (Pose(0.001, 0, 0, rx=0.1), 0.01, "no axes to tilt"),
])  # fmt: skip
def test_what_it_cannot_do_it_refuses(
    stage: StandaStage, target: Pose, speed: float, words: str
) -> None:
    with pytest.raises(DeviceFault, match=words):
        stage.move(target, speed)
    assert not stage.moving()


def test_a_controller_that_is_not_there_is_absent() -> None:
    pytest.importorskip("libximc.highlevel")
    stage = open_stage(WallClock(), x_uri="xi-com:/dev/ttyACM99")
    with pytest.raises(DeviceAbsent, match="x_uri = 'xi-com:/dev/ttyACM99'"):
        stage.connect()


def test_a_rig_without_axes_is_reported() -> None:
    pytest.importorskip("libximc.highlevel")
    with pytest.raises(ConfigError, match="name at least one axis"):
        open_stage(WallClock())
