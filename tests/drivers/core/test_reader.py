"""The thread and the buffer that sensors on a line share."""

import math
import threading
import time
from collections.abc import Iterator

import pytest
from running import running

from drivers import Channel, DeviceAbsent, DeviceFault, WallClock
from drivers.core.reader import BUFFER_S, LineSensor, Sample


class Feed:
    """A line on which the test says what arrives."""

    def __init__(self) -> None:
        self.coming: list[Sample] = [Sample(0.0, [0.0])]
        self.error: Exception | None = None
        self.closed_by: threading.Thread | None = None
        self.reads = 0

    def read(self) -> list[Sample]:
        self.reads += 1
        if self.error is not None:
            raise self.error
        found, self.coming = self.coming, []
        time.sleep(0.002)
        return found

    def close(self) -> None:
        self.closed_by = threading.current_thread()


@pytest.fixture
def feed() -> Feed:
    return Feed()


@pytest.fixture
def sensor(feed: Feed) -> Iterator[LineSensor]:
    channel = Channel("force", "N", "force", full_scale=10.0)
    with running(LineSensor(WallClock(), "cell", (channel,), 100.0, lambda: feed)) as made:
        yield made


def send(feed: Feed, samples: list[Sample]) -> None:
    feed.coming = samples
    while feed.coming:
        time.sleep(0.001)
    reads = feed.reads  # the next one comes when these samples are kept
    while feed.reads == reads and feed.closed_by is None:
        time.sleep(0.001)


def test_what_is_not_read_is_dropped_oldest_first_and_counted(
    feed: Feed, sensor: LineSensor
) -> None:
    room = round(BUFFER_S * 100)
    send(feed, [Sample(0.01 * k, [float(k)], 1 if k == 3 else 0) for k in range(room + 20)])
    block = sensor.read()
    assert len(block.time_s) == room
    assert block.values[0, 0] == 20.0
    assert block.lost == 21  # twenty overrun, and the one that was missing before one of them
    assert sensor.read().lost == 0


def test_tare_is_subtracted_but_saturation_is_of_the_raw_reading(
    feed: Feed, sensor: LineSensor
) -> None:
    now = time.monotonic()
    send(feed, [Sample(0.0, [6.0])] * 20)
    sensor._clock = WallClock()  # the reading is of this moment
    sensor.tare()
    send(feed, [Sample(0.1, [9.0]), Sample(0.11, [10.0])])
    block = sensor.read()
    assert block.values[-2:, 0].tolist() == [3.0, 4.0]
    assert block.saturated[-2:, 0].tolist() == [False, True]
    assert time.monotonic() - now < 5


def test_a_tare_takes_nothing_from_before_a_gap(feed: Feed, sensor: LineSensor) -> None:
    send(feed, [Sample(0.01 * k, [100.0]) for k in range(-200, -193)])
    send(feed, [Sample(0.01 * k, [6.0]) for k in range(3)])
    sensor._clock = WallClock()  # the readings are of this moment
    sensor.tare()
    send(feed, [Sample(0.1, [7.0])])
    assert sensor.read().values[-1, 0] == 1.0


def test_an_old_reading_is_no_zero(sensor: LineSensor) -> None:
    sensor._clock = WallClock(start_s=10.0)
    with pytest.raises(DeviceFault, match="no fresh reading"):
        sensor.tare()


@pytest.mark.parametrize("error, words", [
    (OSError("unplugged"), "connection lost (unplugged)"),
    (DeviceFault("cell", "overheated"), "overheated"),
    (ZeroDivisionError("oops"), "driver: ZeroDivisionError: oops"),
])  # fmt: skip
def test_a_line_that_ends_is_reported_after_the_last_sample(
    error: Exception, words: str, feed: Feed, sensor: LineSensor
) -> None:
    send(feed, [Sample(1.0, [1.0])])
    feed.error = error
    time.sleep(0.02)
    assert len(sensor.read().time_s) == 1
    with pytest.raises(DeviceFault) as reported:
        sensor.read()
    assert reported.value.reason == words


def test_a_sample_that_is_no_number_is_lost(feed: Feed, sensor: LineSensor) -> None:
    bad = [Sample(1.0, [math.nan], 2), Sample(math.inf, [1.0]), Sample(3.0, [-math.inf])]
    send(feed, [*bad, Sample(4.0, [4.0], 1), Sample(5.0, [5.0])])
    block = sensor.read()
    assert block.time_s.tolist() == [4.0, 5.0]
    assert block.lost == 6


def test_a_reading_without_a_value_for_each_channel_is_a_fault_of_the_driver(
    feed: Feed, sensor: LineSensor
) -> None:
    send(feed, [Sample(1.0, [1.0, 2.0])])
    with pytest.raises(DeviceFault, match="cell: driver: a reading of 2 values for 1 channels"):
        sensor.read()


def test_the_line_is_closed_by_the_thread_that_reads_it(feed: Feed, sensor: LineSensor) -> None:
    sensor.close()
    assert feed.closed_by is not None
    assert feed.closed_by.name == "palpate cell"


def test_a_device_that_says_nothing_is_absent(feed: Feed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.core.reader.FIRST_S", 0.1)
    feed.coming = []
    channel = Channel("force", "N", "force")
    silent = LineSensor(WallClock(), "cell", (channel,), 100.0, lambda: feed)
    with pytest.raises(DeviceAbsent, match=r"no reading within 0\.1 s"):
        silent.connect()
