"""The LSL driver and publisher against the real liblsl, over the loopback."""

import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from uuid import uuid4

import numpy as np
import pytest
from running import running
from waiting import until

from drivers import Block, Channel, DeviceAbsent, DeviceFault, WallClock
from drivers.lines import TextChannel
from drivers.lsl import clock_offset_s, open_sensor
from probe.core.events import Phase, PhaseEntered, RunStarted, Samples

pylsl = pytest.importorskip("pylsl", reason="the extra `lsl` is not installed")

RATE_HZ = 200.0
PPG = TextChannel(name="ppg", unit="mV", role="reference")
FORCE = TextChannel(name="force", unit="mN", role="force", full_scale=5000.0)


def outlet(name: str, channels: int) -> "pylsl.StreamOutlet":
    info = pylsl.StreamInfo(name, "test", channels, RATE_HZ, pylsl.cf_double64, name)
    return pylsl.StreamOutlet(info)


def send(sender: "pylsl.StreamOutlet", clock: WallClock, count: int) -> list[float]:
    """Ramp samples at their due times; returns when each was stamped, on the scan's clock.

    Both clocks only run on; read one after the other they differ by whatever came between.
    """
    shift_s = clock_offset_s(clock)
    stamped = []
    for n in range(count):
        due_s = clock.now() + 1 / RATE_HZ
        clock.sleep_until(due_s)
        local_s = pylsl.local_clock()
        if n == 100:
            time.sleep(0.03)
        sender.push_sample([float(n), 1000.0 + n], local_s)
        stamped.append(local_s + shift_s)
    return stamped


@contextmanager
def sending(sender: "pylsl.StreamOutlet", value: float = -1.0) -> Iterator[None]:
    """Within: a sample every 10 ms, since a sensor is there once a first one has come."""
    stop = threading.Event()

    def send_on() -> None:
        while not stop.is_set():
            sender.push_sample([value, value])
            time.sleep(0.01)

    thread = threading.Thread(target=send_on)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.fixture
def name() -> Iterator[str]:
    """A stream that no other test has; skips where liblsl finds no stream of its own machine."""
    probe_name = f"palpate-{uuid4()}"
    sender = outlet(probe_name, 2)
    if not pylsl.resolve_byprop("name", probe_name, timeout=5.0):
        pytest.skip("this machine does not let LSL streams be found (no multicast, no loopback)")
    del sender
    yield f"palpate-{uuid4()}"


def test_times_and_values_survive_the_round_trip(name: str) -> None:
    clock, sender = WallClock(), outlet(name, 2)
    sensor = open_sensor(clock, stream=name, channel=[PPG, FORCE], rate_hz=RATE_HZ)
    with closing(sensor):
        with sending(sender):
            sensor.connect()
        time.sleep(0.1)
        sensor.start()
        stamped = send(sender, clock, 200)
        time.sleep(0.2)
        block = sensor.read()
    assert block.values[:, 0] == pytest.approx(np.arange(200.0))  # mV is not SI's: as it is
    assert block.values[:, 1] == pytest.approx(1.0 + 1e-3 * np.arange(200.0))
    error_s = np.abs(block.time_s - np.array(stamped))
    assert np.median(error_s) < 1e-4
    assert error_s.max() < 1e-3
    assert (np.diff(block.time_s) > 0).all()
    assert block.lost == 0  # however late a busy sender was


def test_a_stream_that_is_not_there_is_absent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.lsl.RESOLVE_S", 0.3)
    sensor = open_sensor(WallClock(), stream="nobody", channel=[PPG], rate_hz=100.0)
    with pytest.raises(DeviceAbsent, match="no LSL stream 'nobody'"):
        sensor.connect()


def test_a_stream_of_other_channels_is_refused(name: str) -> None:
    sender = outlet(name, 2)
    sensor = open_sensor(WallClock(), stream=name, channel=[PPG], rate_hz=100.0)
    with pytest.raises(DeviceAbsent, match="has 2 channels, the rig 1"):
        sensor.connect()
    del sender


@pytest.mark.parametrize("ids", [("left", "right"), ("same", "same")])
def test_of_several_streams_of_a_name_none_is_read_by_chance(
    name: str, ids: tuple[str, str]
) -> None:
    senders = [
        pylsl.StreamOutlet(pylsl.StreamInfo(name, "test", 1, RATE_HZ, pylsl.cf_float32, own))
        for own in ids
    ]
    sensor = open_sensor(WallClock(), stream=name, channel=[FORCE], rate_hz=RATE_HZ)
    said = "several streams .* one of 'left', 'right'" if ids[0] != ids[1] else "2 outlets carry"
    for _ in range(3):
        with pytest.raises(DeviceAbsent, match=said):
            sensor.connect()
    del senders


def test_a_stream_is_found_by_its_source_id_among_others(name: str) -> None:
    senders = {
        own: pylsl.StreamOutlet(pylsl.StreamInfo(name, "t", 2, RATE_HZ, pylsl.cf_double64, own))
        for own in ("left", "right")
    }
    sensor = open_sensor(
        WallClock(), stream=name, source_id="right", channel=[PPG, FORCE], rate_hz=RATE_HZ
    )
    with sending(senders["left"], 500.0), sending(senders["right"], 5000.0), running(sensor):
        time.sleep(0.3)
        block = sensor.read()
    assert set(block.values[:, 1]) == {5.0}  # N, of `right`


def test_a_text_stream_is_refused_in_words(name: str) -> None:
    sender = pylsl.StreamOutlet(pylsl.StreamInfo(name, "test", 1, RATE_HZ, pylsl.cf_string, name))
    sensor = open_sensor(WallClock(), stream=name, channel=[FORCE], rate_hz=RATE_HZ)
    with pytest.raises(DeviceAbsent, match="are text; numbers needed"):
        sensor.connect()
    del sender


def test_a_sender_that_goes_is_a_fault(name: str) -> None:
    senders = [outlet(name, 2)]
    sensor = open_sensor(WallClock(), stream=name, channel=[PPG, FORCE], rate_hz=RATE_HZ)
    with closing(sensor):
        with sending(senders[0]):
            sensor.connect()
            sensor.start()
        senders.clear()  # nothing holds the outlet: the stream ends
        with pytest.raises(DeviceFault, match="the stream has ended"):
            until(lambda: sensor.read() is None, 10.0)


def test_a_scan_is_published_with_its_clock(name: str) -> None:
    from probe.scan.lsl_publisher import LslPublisher

    clock, publisher, device = WallClock(), LslPublisher(), name
    force = (Channel("force", "N", "force"),)
    publisher(RunStarted(clock.now(), "2026-01-01T00:00:00+00:00", {}, {device: force}))
    found = pylsl.resolve_byprop("name", f"palpate {device}", timeout=5.0)
    assert len(found) == 1
    inlet = pylsl.StreamInlet(found[0], processing_flags=pylsl.proc_clocksync)
    inlet.open_stream(timeout=5.0)
    for _ in range(20):  # one of them arrives at once, however busy the machine is
        publisher(PhaseEntered(clock.now(), Phase.HOLDING, 0))
    publisher(PhaseEntered(clock.now() - 0.2, Phase.HOLDING, 0))  # one that was kept waiting
    shift_s = clock_offset_s(clock)
    times = clock.now() + 0.002 * np.arange(50)
    values = np.linspace(0, 1, 50)[:, None]
    publisher(Samples(device, Block(times, values, np.zeros((50, 1), bool)), 0, 1))
    rows: list[list[float]] = []
    stamps: list[float] = []
    until_s = clock.now() + 5.0
    while len(rows) < 50 and clock.now() < until_s:
        got, at = inlet.pull_chunk(timeout=0.1)
        rows += got
        stamps += at
    assert np.array_equal(np.array(rows), values)
    assert np.abs(np.array(stamps) + shift_s - times).max() < 1e-3
    inlet.close_stream()
