"""What every driver must do; collected by `drivers.testing.contract`, or imported by a test file.

A test file that imports these tests gives a fixture ``palpate_bench``. Upper limits count the
time in which this machine kept up (`drivers.testing.awake`), so that a busy one fails nobody.
"""

import math
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest

from drivers.core.abilities import enable
from drivers.core.arrays import Array
from drivers.core.errors import DeviceFault
from drivers.core.protocols import ROLES, UNIT_OF_ROLE, Block, Pose, Sensor, Stage
from drivers.testing.awake import AwakeTime
from drivers.testing.contract import Bench

PROMPT_S = 0.25  # no call may take longer, except connecting and closing
SOON_S = 3.0
ARRIVED_M = 0.1e-3
TRIES = 5
_awake = AwakeTime()


@pytest.fixture(autouse=True)
def machine_keeps_up() -> Iterator[None]:
    """Count the time in which it does."""
    with _awake:
        yield


@pytest.fixture
def stage(palpate_bench: Bench) -> Iterator[Stage]:
    """A connected stage, ready to move."""
    made = palpate_bench.open_stage()
    made.connect()
    enable(made)
    yield made
    made.close()


@pytest.fixture
def sensor(palpate_bench: Bench) -> Iterator[Sensor]:
    """A connected sensor, sampling."""
    made = palpate_bench.open_sensor()
    made.connect()
    made.start()
    yield made
    made.close()


# --- stages --------------------------------------------------------------------------------------


def test_stage_has_the_shape_of_one(stage: Stage) -> None:
    assert isinstance(stage, Stage)
    assert isinstance(stage.name, str)
    assert stage.name
    assert isinstance(stage.simulated, bool)
    stage.connect()  # a second time changes nothing
    assert all(math.isfinite(value) for value in stage.pose())


def test_stage_moves_without_blocking_in_metres_and_seconds(
    stage: Stage, palpate_bench: Bench
) -> None:
    here, there, speed = _way(stage, palpate_bench)
    expected_s = (there.z - here.z) / speed
    began, awake = time.monotonic(), _awake.now()
    stage.move(there, speed)
    assert _awake.now() - awake < PROMPT_S
    if time.monotonic() - began < 0.5 * expected_s:
        assert stage.moving()
    _until(lambda: not stage.moving(), expected_s + SOON_S)
    assert time.monotonic() - began > 0.7 * expected_s
    assert _awake.now() - awake < 1.3 * expected_s + 0.3
    assert math.dist(stage.pose()[:3], there[:3]) < ARRIVED_M
    stage.move(here, speed)
    _until(lambda: not stage.moving(), expected_s + SOON_S)
    assert math.dist(stage.pose()[:3], here[:3]) < ARRIVED_M


def test_stage_tells_where_it_is_promptly_while_it_moves(
    stage: Stage, palpate_bench: Bench
) -> None:
    here, there, speed = _way(stage, palpate_bench)
    seen: set[float] = set()
    for _ in range(TRIES):  # a busy machine looks a few times only on one way
        stage.move(there, speed)
        heights = [here.z]
        while stage.moving():
            began = _awake.now()
            heights.append(stage.pose().z)
            assert _awake.now() - began < PROMPT_S
        seen |= set(heights)
        assert (np.diff(heights) >= -ARRIVED_M).all()
        assert max(heights) <= there.z + ARRIVED_M
        stage.move(here, speed)
        _until(lambda: not stage.moving(), (there.z - here.z) / speed + SOON_S)
        if len(seen) > 5:
            return
    pytest.fail(f"{len(seen)} different positions on {TRIES} ways")


def test_stage_stops_from_another_thread_however_often(stage: Stage, palpate_bench: Bench) -> None:
    here, there, speed = _way(stage, palpate_bench)
    expected_s = (there.z - here.z) / speed
    for _ in range(TRIES):
        began = time.monotonic()
        stage.move(there, speed)
        time.sleep(0.3 * expected_s)
        others = [threading.Thread(target=stage.stop) for _ in range(3)]
        for other in others:
            other.start()
        for other in others:
            _until(partial(_ended, other), PROMPT_S)
        in_time = time.monotonic() - began < 0.7 * expected_s  # of a machine that is not too busy
        _until(lambda: not stage.moving(), 1.0)
        rested = stage.pose()
        stage.stop()
        time.sleep(0.2)
        assert math.dist(stage.pose()[:3], rested[:3]) < ARRIVED_M
        assert not stage.moving()
        stage.move(here, speed)  # and it can go on from there
        _until(lambda: not stage.moving(), expected_s + SOON_S)
        assert math.dist(stage.pose()[:3], here[:3]) < ARRIVED_M
        if in_time:
            assert here.z - ARRIVED_M <= rested.z < there.z - ARRIVED_M
            return
    pytest.fail(f"stop takes longer than {0.4 * expected_s:.2f} s in each of {TRIES} tries")


def test_stage_that_is_closed_answers_nothing_and_leaves_no_thread(palpate_bench: Bench) -> None:
    stage = palpate_bench.open_stage()
    stage.stop()  # even before it is connected
    before = set(threading.enumerate())
    stage.connect()
    here = stage.pose()
    stage.close()
    stage.close()
    stage.stop()
    _no_new_thread(before)
    if palpate_bench.connected:
        for call in (stage.pose, stage.moving, lambda: stage.move(here, 1e-3)):
            with pytest.raises(DeviceFault):
                call()
    stage.connect()
    assert math.dist(stage.pose()[:3], here[:3]) < ARRIVED_M
    stage.close()


def test_stage_unplugged_says_so_and_plugged_in_again_works(palpate_bench: Bench) -> None:
    if palpate_bench.unplug is None:
        pytest.skip("nobody here to pull the plug")
    stage = palpate_bench.open_stage()
    before = set(threading.enumerate())
    stage.connect()
    palpate_bench.unplug()
    _until_raises(lambda: (stage.pose(), stage.moving()))
    stage.stop()
    stage.close()
    _no_new_thread(before)
    if palpate_bench.replug is not None:
        palpate_bench.replug()
        _until_connected(stage)
        stage.pose()
        stage.close()


# --- sensors -------------------------------------------------------------------------------------


def test_sensor_has_the_shape_of_one(sensor: Sensor) -> None:
    assert isinstance(sensor, Sensor)
    assert isinstance(sensor.name, str)
    assert sensor.name
    assert math.isfinite(sensor.rate_hz)
    assert sensor.rate_hz > 0
    names = [channel.name for channel in sensor.channels]
    assert names
    assert len(set(names)) == len(names)
    for channel in sensor.channels:
        assert channel.role in ROLES
        assert channel.unit == UNIT_OF_ROLE.get(channel.role, channel.unit)
    sensor.connect()  # a second time changes nothing


def test_sensor_samples_in_order_on_the_scan_clock_at_its_rate(
    sensor: Sensor, palpate_bench: Bench
) -> None:
    duration_s = max(1.0, 10 / sensor.rate_hz)
    began_s, awake = palpate_bench.clock.now(), _awake.now()
    block = _gather(sensor, duration_s)
    awake_s = _awake.now() - awake
    took_s = palpate_bench.clock.now() - began_s
    times = block.time_s
    assert (np.diff(times) > 0).all(), "times must ascend, also from block to block"
    assert times[0] > began_s - 0.5
    assert palpate_bench.clock.now() + 0.01 > times[-1] > began_s + 0.5 * duration_s
    arrived = len(times) + block.lost
    assert 0.75 * awake_s * sensor.rate_hz - 3 <= arrived <= 1.25 * took_s * sensor.rate_hz + 3
    assert np.isfinite(block.values).all()


def test_sensor_read_never_blocks(sensor: Sensor) -> None:
    for _ in range(20):
        began = _awake.now()
        sensor.read()
        assert _awake.now() - began < PROMPT_S


def test_sensor_tare_makes_the_present_load_zero(sensor: Sensor) -> None:
    settle_s = max(0.3, 5 / sensor.rate_hz)
    _gather(sensor, settle_s)
    sensor.tare()
    sensor.read()
    after = _gather(sensor, settle_s).values
    spread = after.std(axis=0)
    assert (np.abs(after.mean(axis=0)) <= 5 * spread + 1e-9 + 1e-3 * np.abs(after).max()).all()


def test_sensor_stops_and_starts_again(sensor: Sensor) -> None:
    sensor.stop()
    sensor.stop()
    sensor.read()
    time.sleep(max(0.1, 3 / sensor.rate_hz))
    assert len(sensor.read().time_s) == 0
    sensor.start()
    assert len(_gather(sensor, max(0.3, 5 / sensor.rate_hz)).time_s) > 0


def test_sensor_that_is_closed_answers_nothing_and_leaves_no_thread(palpate_bench: Bench) -> None:
    sensor = palpate_bench.open_sensor()
    sensor.stop()  # even before it is connected
    before = set(threading.enumerate())
    sensor.connect()
    sensor.start()
    sensor.close()
    sensor.close()
    sensor.stop()
    _no_new_thread(before)
    if palpate_bench.connected:
        with pytest.raises(DeviceFault):
            sensor.read()
    sensor.connect()
    sensor.start()
    assert len(_gather(sensor, max(0.3, 5 / sensor.rate_hz)).time_s) > 0
    sensor.close()


def test_sensor_unplugged_says_so_and_plugged_in_again_works(palpate_bench: Bench) -> None:
    if palpate_bench.unplug is None:
        pytest.skip("nobody here to pull the plug")
    sensor = palpate_bench.open_sensor()
    before = set(threading.enumerate())
    sensor.connect()
    sensor.start()
    palpate_bench.unplug()
    _until_raises(sensor.read)
    sensor.stop()
    sensor.close()
    _no_new_thread(before)
    if palpate_bench.replug is not None:
        palpate_bench.replug()
        _until_connected(sensor)
        sensor.start()
        assert len(_gather(sensor, max(0.3, 5 / sensor.rate_hz)).time_s) > 0
        sensor.close()


# --- helpers -------------------------------------------------------------------------------------


def _way(stage: Stage, bench: Bench) -> tuple[Pose, Pose, float]:
    here = stage.pose()
    return here, here._replace(z=here.z + 1e-3 * bench.travel_mm), 1e-3 * bench.speed_mm_s


def _ended(thread: threading.Thread) -> bool:
    return not thread.is_alive()


def _until(ready: Callable[[], bool], timeout_s: float) -> None:
    end = _awake.now() + timeout_s
    while not ready():
        assert _awake.now() < end, f"not within {timeout_s:.1f} s"
        time.sleep(0.005)


def _until_raises(call: Callable[[], object]) -> None:
    end = _awake.now() + SOON_S
    with pytest.raises(DeviceFault):
        while _awake.now() < end:
            call()
            time.sleep(0.01)


def _until_connected(device: Stage | Sensor) -> None:
    """A device that is plugged in needs a moment to be found."""
    end = _awake.now() + SOON_S
    while True:
        try:
            device.connect()
        except DeviceFault:
            if _awake.now() > end:
                raise
            time.sleep(0.1)
        else:
            return


def _gather(sensor: Sensor, duration_s: float) -> Block:
    blocks: list[Block] = []
    end = time.monotonic() + duration_s
    while time.monotonic() < end:
        block = sensor.read()
        shape = (len(block.time_s), len(sensor.channels))
        assert block.values.shape == block.saturated.shape == shape
        blocks.append(block)
        time.sleep(0.01)
    times: Array = np.concatenate([b.time_s for b in blocks])
    return Block(
        times,
        np.concatenate([b.values for b in blocks]),
        np.concatenate([b.saturated for b in blocks]),
        sum(b.lost for b in blocks),
    )


def _no_new_thread(before: set[threading.Thread]) -> None:
    _until(lambda: not set(threading.enumerate()) - before, SOON_S)
