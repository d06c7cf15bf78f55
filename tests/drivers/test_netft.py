"""The Net F/T driver: pynetft itself against an emulated box on loopback."""

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from drivers import Block, DeviceAbsent, DeviceFault, WallClock
from drivers.core.reader import LineSensor
from drivers.netft import RateCheck, open_sensor
from sim_backend.arrays import Array
from sim_backend.emulators import netft
from sim_backend.phantom.phantom import Phantom


@pytest.fixture
def box(phantom: Phantom) -> Iterator[netft.NetFtBox]:
    pytest.importorskip("pynetft")
    with netft.emulate(phantom, rdt_port=0, http_port=0, noise_n=0.0) as running:
        yield running


def opened(
    box: netft.NetFtBox, clock: WallClock, rate_hz: float = 1000.0, silence_s: float = 5.0
) -> LineSensor:
    """By default the emulator, which shares this process, may be slow."""
    sensor = open_sensor(
        clock, host=box.host, rdt_port=box.rdt_port, http_port=box.http_port, rate_hz=rate_hz,
        silence_s=silence_s,
    )  # fmt: skip
    sensor.connect()
    sensor.start()
    return sensor


def read_until(sensor: LineSensor, enough: Callable[[Block], bool]) -> Block:
    """All that it read until ``enough``, or a fault."""
    blocks = [sensor.read()]
    while not enough(block := joined(blocks)):
        time.sleep(0.02)
        blocks.append(sensor.read())
    return block


def joined(blocks: list[Block]) -> Block:
    """As if they had been read at once."""
    return Block(
        *(np.concatenate([getattr(block, name) for block in blocks])
          for name in ("time_s", "values", "saturated")),
        lost=sum(block.lost for block in blocks),
    )  # fmt: skip


def test_a_thousand_readings_a_second_in_newtons_and_in_time(
    box: netft.NetFtBox, phantom: Phantom, clock: WallClock
) -> None:
    sensor = opened(box, clock)
    phantom.tip.move(clock.now() + 0.1, (0.032, 0.0, -0.0025), 0.02, 1.0)
    block = read_until(sensor, lambda block: len(block.time_s) + block.lost > 600)
    sensor.close()
    time_s, values = block.time_s, block.values
    in_all = len(time_s) + block.lost
    assert in_all / (time_s[-1] - time_s[0]) == pytest.approx(1000.0, rel=0.05)
    np.testing.assert_array_equal(values[:, 0], -values[:, 3])
    # 10 N/s: 0.1 N is 10 ms.
    off_n = np.abs(values[:, 0] - phantom.force_n(time_s))
    assert np.percentile(off_n, 95) < 0.1  # the first to arrive may be late


def test_records_that_the_network_loses_are_counted(box: netft.NetFtBox, clock: WallClock) -> None:
    sensor = opened(box, clock)
    read_until(sensor, lambda block: len(block.time_s) > 100)  # the first to arrive may be late
    box.fail("lossy")
    block = read_until(sensor, lambda block: block.lost > 80)
    sensor.close()
    assert block.lost == pytest.approx(len(block.time_s) / 4, rel=0.2)
    assert (np.diff(block.time_s) > 0.5e-3).all()


@pytest.mark.parametrize("fault", ["doubled", "swapped"])
def test_records_that_come_twice_or_late_are_no_fault(
    box: netft.NetFtBox, clock: WallClock, fault: str
) -> None:
    """The library ends its stream at one; what is missing until the next counts as lost."""
    sensor = opened(box, clock)
    box.fail(fault)
    block = read_until(sensor, lambda block: block.lost > 0 and len(block.time_s) > 300)
    sensor.close()
    span_s = block.time_s[-1] - block.time_s[0]
    assert (np.diff(block.time_s) > 0).all()
    assert box.asked == 1  # a real box's page is slow: what it says is known from the first time
    assert len(block.time_s) + block.lost == pytest.approx(1000.0 * span_s, rel=0.1)


def test_a_pause_shorter_than_silence_s_is_lost_samples(
    box: netft.NetFtBox, clock: WallClock
) -> None:
    sensor = opened(box, clock)
    box.fail("silence")
    time.sleep(0.3)
    box.fail(None)
    block = read_until(sensor, lambda block: block.lost > 0)
    sensor.close()
    assert block.lost > 200


def test_a_silent_box_is_a_fault(box: netft.NetFtBox, clock: WallClock) -> None:
    sensor = opened(box, clock, silence_s=0.1)
    box.fail("silence")
    with pytest.raises(DeviceFault, match="netft: timeout"):
        for _ in range(200):
            sensor.read()
            time.sleep(0.01)
    sensor.close()


def test_a_rate_other_than_the_rig_says_is_reported(box: netft.NetFtBox, clock: WallClock) -> None:
    sensor = opened(box, clock, rate_hz=500.0)
    with pytest.raises(DeviceFault, match="records a second; rate_hz = 500"):
        for _ in range(1000):
            sensor.read()
            time.sleep(0.01)
    sensor.close()


def arrivals(sent_hz: float, stall_s: float = 0.0, catch_up: float = 2.0) -> Iterator[float]:
    """Of 4 s of records. From 1.2 s on nothing comes for ``stall_s``; what was kept meanwhile
    comes ``catch_up`` times as fast as it was sent, while more is sent."""
    arrival_s = 0.0
    for count in range(1, int(4 * sent_hz)):
        sent_s = count / sent_hz
        if sent_s >= 1.2:
            arrival_s = max(arrival_s + 1 / (catch_up * sent_hz), 1.2 + stall_s)
        arrival_s = max(arrival_s, sent_s)
        yield arrival_s


def seen_hz(arrivals_s: Iterator[float]) -> float | None:
    check = RateCheck(1000.0, 0.0)
    found = (check.other_hz(count, at) for count, at in enumerate(arrivals_s, 1))
    return next((hz for hz in found if hz is not None), None)


@pytest.mark.parametrize("sent_hz", [500.0, 950.0, 1050.0, 2000.0])
def test_another_rate_is_seen_as_what_it_is(sent_hz: float) -> None:
    assert seen_hz(arrivals(sent_hz)) == pytest.approx(sent_hz, rel=0.01)


@pytest.mark.parametrize("stall_s", [0.0, 0.3, 0.9, 1.7])
@pytest.mark.parametrize("catch_up", [1.5, 2.0, 20.0])
def test_a_machine_that_stands_still_and_catches_up_has_no_other_rate(
    stall_s: float, catch_up: float
) -> None:
    assert seen_hz(arrivals(1000.0, stall_s, catch_up)) is None


def test_a_sender_that_stumbles_has_no_other_rate(
    box: netft.NetFtBox, phantom: Phantom, clock: WallClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four times a second all is 0.1 s late; then what was due comes at once."""
    stumbled, force_n = [0.0], phantom.force_n

    def slow(time_s: Array) -> Array:
        if time.monotonic() > stumbled[0] + 0.25:
            time.sleep(0.1)
            stumbled[0] = time.monotonic()
        return force_n(time_s)

    monkeypatch.setattr(phantom, "force_n", slow)
    sensor = opened(box, clock)
    block = read_until(sensor, lambda block: len(block.time_s) > 2000)
    sensor.close()
    assert block.lost == 0


@pytest.mark.parametrize(
    ("port", "words"), [(1, "sensor configuration"), (9, r"box at 127\.0\.0\.1")]
)
def test_a_box_that_is_off_is_named_by_its_address(port: int, words: str, clock: WallClock) -> None:
    pytest.importorskip("pynetft")
    sensor = open_sensor(clock, host="127.0.0.1", rdt_port=port, http_port=port)
    with pytest.raises((DeviceAbsent, DeviceFault), match=words):
        sensor.connect()
    sensor.close()
