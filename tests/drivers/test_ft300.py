"""The FT-300 driver against an emulated sensor: stream, polling, broken frames, lost lines."""

import os
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU

from drivers import DeviceAbsent, DeviceFault, WallClock
from drivers.core.frame_cutter import FrameCutter
from drivers.core.reader import LineSensor
from drivers.ft300 import HEADER, Ft300Settings, open_sensor
from sim_backend.emulators import ft300
from sim_backend.emulators.serving import Served
from sim_backend.phantom.phantom import Phantom
from tests.support.waiting import until

PRESSED = (0.032, 0.0, -0.0025)


@pytest.fixture
def device(phantom: Phantom, tmp_path: Path) -> Iterator[Served]:
    with ft300.emulate(phantom, at=str(tmp_path / "tty"), noise_n=0.0) as served:
        yield served


@pytest.fixture(params=["stream", "poll"])
def sensor(
    device: Served, clock: WallClock, request: pytest.FixtureRequest
) -> Iterator[LineSensor]:
    made = open_sensor(clock, Ft300Settings(port=device.address, mode=request.param))
    made.connect()
    made.start()
    yield made
    made.close()


def gather(sensor: LineSensor, seconds: float) -> tuple[np.ndarray, np.ndarray, int]:
    times, values, lost = [], [], 0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        block = sensor.read()
        times.append(block.time_s)
        values.append(block.values)
        lost += block.lost
        time.sleep(0.005)
    return np.concatenate(times), np.concatenate(values), lost


def test_force_is_what_the_phantom_gives_when_it_gives_it(
    sensor: LineSensor, phantom: Phantom, clock: WallClock
) -> None:
    phantom.tip.move(clock.now() + 0.1, PRESSED, 0.02, 1.0)
    times, values, lost = gather(sensor, 0.7)
    assert lost <= 5  # a busy machine polls late, and counts what it missed
    assert len(times) >= 0.65 * sensor.rate_hz
    assert (np.diff(times) > 0).all()
    force = values[:, 0]
    np.testing.assert_array_equal(force, -values[:, 3])
    # the slope is 10 N/s: 0.1 N is 10 ms of a wrong time, plus the 0.01 N step
    np.testing.assert_allclose(force, phantom.force_n(times), atol=0.13)
    assert force[-1] == pytest.approx(phantom.force_n(times[-1:])[0], abs=0.011)


def test_tare_and_saturation(
    sensor: LineSensor, device: Served, phantom: Phantom, clock: WallClock
) -> None:
    phantom.tip.record(clock.now(), PRESSED)
    gather(sensor, 0.3)
    sensor.tare()
    until(lambda: reads_nothing(sensor))
    device.fail("saturate")
    until(lambda: len(full := sensor.read().saturated) > 0 and bool(full[:, 0].all()))
    device.fail(None)
    until(lambda: reads_nothing(sensor))


def reads_nothing(sensor: LineSensor) -> bool:
    """Some readings, and no force in any; a busy machine may wait long for the first."""
    _, values, _ = gather(sensor, 0.1)
    return len(values) > 0 and bool(np.abs(values[:, 0]).max() < 0.05)


@pytest.mark.parametrize("fault", ["silence", "garbage", "bad crc"])
def test_a_bad_line_gives_no_number(sensor: LineSensor, device: Served, fault: str) -> None:
    gather(sensor, 0.1)
    device.fail(fault)
    time.sleep(0.1)
    while len(sensor.read().time_s):
        pass
    try:
        times, _, _ = gather(sensor, 0.3)
    except DeviceFault:
        return  # polling says so itself; a silent stream is the guards' business
    assert len(times) == 0


def test_the_stream_comes_back_and_counts_what_was_lost(device: Served, clock: WallClock) -> None:
    made = open_sensor(clock, Ft300Settings(port=device.address))
    made.connect()
    made.start()
    before, _, _ = gather(made, 0.2)
    device.fail("bad crc")
    time.sleep(0.2)
    device.fail(None)
    after, _, lost = gather(made, 0.4)
    made.close()
    times = np.concatenate([before, after])
    assert 15 <= lost <= 25
    gap = float(np.diff(times).max())
    assert gap == pytest.approx(0.01 * (lost + 1), abs=0.012)


def frame(counts: tuple[int, ...]) -> bytes:
    body = HEADER + struct.pack("<6h", *counts)
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


Counts = st.tuples(*[st.integers(-32768, 32767)] * 6)


@given(st.lists(Counts, max_size=8), st.integers(1, 40), st.binary(max_size=20))
def test_frames_are_found_however_they_are_cut(
    sent: list[tuple[int, ...]], piece: int, before: bytes
) -> None:
    data = before + b"".join(frame(c) for c in sent) + frame((0,) * 6)
    cutter = FrameCutter(HEADER, "<6h", "crc16-modbus")
    found = [f for k in range(0, len(data), piece) for f in cutter.feed(data[k : k + piece])]
    assert [counts for counts, _ in found][-len(sent) - 1 :] == [*sent, (0,) * 6]
    assert sum(skipped for _, skipped in found) == len(before)


def test_unplugged_while_it_is_opened_is_absence(clock: WallClock) -> None:
    """termios raises an error of its own, which is no `OSError`."""
    master, slave = os.openpty()
    port = os.ttyname(slave)
    made = open_sensor(clock, Ft300Settings(port=port))

    def pull() -> None:
        os.read(master, 64)  # the driver has opened it and said stop
        os.close(slave)
        os.close(master)

    hand = threading.Thread(target=pull)
    hand.start()
    with pytest.raises(DeviceAbsent, match=r"lost|Input/output"):
        made.connect()
    hand.join()
