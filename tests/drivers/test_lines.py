"""Load cells that print lines: patterns, units, their own clock, and text that is no reading."""

import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from peer import Peer
from running import running
from waiting import until

from drivers import (
    Block,
    Clock,
    ConfigError,
    DeviceAbsent,
    DeviceFault,
    SimulatedClock,
    WallClock,
)
from drivers.core.reader import LineSensor
from drivers.lines import LinePattern, LineSource, TextChannel, number_reader, open_sensor
from drivers.testing.awake import AwakeTime
from sim_backend import load_scene
from sim_backend.emulators import lines
from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom, Respond

FORCE = TextChannel(name="force", unit="N", role="force")
STAMPED = r"(?P<time>[0-9]+) (?P<force>[-+0-9.eE]+|nan) N"


class Says(Peer):
    """Prints what the test says."""

    def __init__(self) -> None:
        self._text: deque[bytes] = deque()
        self.asked = b""

    def say(self, text: bytes) -> None:
        self._text.append(text)

    def received(self, data: bytes) -> bytes:
        self.asked += data
        return b"Load: -12.5 g; 3.0 V\r\n" * data.count(b"\r")

    def due(self) -> bytes:
        return self._text.popleft() if self._text else b""


def opened(clock: WallClock, device: Served, **keys: Any) -> LineSensor:
    """A cell that prints a force in N, unless ``keys`` say otherwise."""
    usual = {"pattern": "(?P<force>[-0-9.]+) N", "channel": [FORCE], "rate_hz": 80}
    return open_sensor(clock, port=device.address, **(usual | keys))


def connect_while(sensor: LineSensor, says: Says, text: bytes) -> None:
    """What is said before the line is open is lost: it is said until the sensor is connected."""
    with ThreadPoolExecutor(1) as other:
        connected = other.submit(sensor.connect)
        while not connected.done():
            says.say(text)
            time.sleep(0.01)
        connected.result()


@pytest.fixture
def line(tmp_path: Path) -> Iterator[tuple[Says, Served]]:
    says = Says()
    with served(says, str(tmp_path / "cell"), "cell") as device:
        yield says, device


@pytest.fixture
def cell(clock: WallClock, winkler: Respond, tmp_path: Path) -> Iterator[tuple[Served, Phantom]]:
    phantom = Phantom(load_scene("TIHA"), clock, winkler, home=(0.032, 0.0, 0.002))
    with lines.emulate(phantom, at=str(tmp_path / "cell"), noise_n=0.0) as device:
        yield device, phantom


def gather(sensor: LineSensor, seconds: float) -> Block:
    time.sleep(seconds)
    return sensor.read()


def hear(sensor: LineSensor, count: int) -> tuple[list[float], int]:
    """The next ``count`` readings of the first channel, and how many were lost among them."""
    values: list[float] = []
    lost = 0
    until_s = time.monotonic() + 10
    while len(values) < count and time.monotonic() < until_s:
        block = gather(sensor, 0.005)
        values += block.values[:, 0].tolist()
        lost += block.lost
    assert len(values) >= count, "the device went silent"
    return values, lost


def settled(sensor: LineSensor) -> float:
    """Wait until the stamps of 20 lines follow their clock; the last one's.

    On a busy machine it takes a while until a line arrives as early as it can.
    """
    times: list[float] = []
    while len(times) < 21 or np.diff(times[-21:]).min() < 0.0115:
        times += gather(sensor, 0.02).time_s.tolist()
    return times[-1]


def test_force_and_time_are_the_devices(cell: tuple[Served, Phantom], clock: WallClock) -> None:
    device, phantom = cell
    sensor = opened(clock, device, pattern=STAMPED, time_unit_s=1e-3)
    sensor.connect()
    sensor.start()
    settled(sensor)
    phantom.tip.move(clock.now() + 0.1, (0.032, 0.0, -0.002), 0.02, 1.0)
    block = gather(sensor, 0.6)
    sensor.close()
    # 10 N/s: 0.05 N is 5 ms
    np.testing.assert_allclose(block.values[:, 0], phantom.force_n(block.time_s), atol=0.05)
    steps = np.diff(block.time_s)
    assert steps.min() > 0.010
    assert steps.max() < 0.016


def test_missing_lines_and_a_restarted_clock_are_seen(
    cell: tuple[Served, Phantom], clock: WallClock
) -> None:
    device, _ = cell
    sensor = opened(clock, device, pattern=STAMPED, time_unit_s=1e-3)
    sensor.connect()
    sensor.start()
    times, lost = [settled(sensor)], 0
    device.fail("silence")
    with AwakeTime() as awake:  # in which the emulator has its turns too
        silent_s = awake.now()
        until(lambda: awake.now() > silent_s + 0.4, 30.0)
    device.fail(None)
    while not lost:
        block = gather(sensor, 0.01)
        times, lost = times + block.time_s.tolist(), block.lost
    said = round((times[-1] - times[0]) * 80) + 1
    assert lost == pytest.approx(said - len(times), abs=1)
    assert lost > 10
    device.fail("restart")
    hear(sensor, 20)
    again = gather(sensor, 0.1)
    assert again.time_s[0] > times[-1]
    assert (np.diff(again.time_s) > 0).all()
    device.fail("nan")
    with pytest.raises(DeviceFault, match=r"the last is '[0-9]+ nan N'"):
        while True:  # not a number is not a reading
            assert np.isfinite(gather(sensor, 0.01).values).all()
    sensor.close()


def test_a_gauge_that_speaks_when_asked_in_grams(
    clock: WallClock, line: tuple[Says, Served]
) -> None:
    says, device = line
    load = TextChannel(name="load", unit="g", role="force", scale=-1.0, full_scale=12.0)
    battery = TextChannel(name="battery", unit="V", full_scale=12.0)
    pattern = r"Load: (?P<load>[-+0-9.]+) g; (?P<battery>[0-9.]+) V"
    sensor = opened(clock, device, rate_hz=50, ask="?\r", pattern=pattern, channel=[load, battery])
    assert [c.unit for c in sensor.channels] == ["N", "V"]
    with running(sensor):
        while not len((block := gather(sensor, 0.01)).time_s):
            pass
        asked = says.asked.count(b"?")
        assert until(lambda: says.asked.count(b"?") > asked + 20) < 0.8  # 50 a second
    assert block.values[0] == pytest.approx([12.5 * 9.80665e-3, 3.0])
    assert block.saturated[0].tolist() == [True, False]


def test_half_lines_wait_for_the_rest_and_chatter_is_counted(
    clock: WallClock, line: tuple[Says, Served]
) -> None:
    says, device = line
    sensor = opened(clock, device, pattern="(?P<force>[-0-9.e]+)", rate_hz=10)
    connect_while(sensor, says, b"7.7\n1.0\n")  # the first may be half a line
    sensor.start()
    says.say(b"0.5\n")
    while hear(sensor, 1)[0][-1] != 0.5:
        pass
    says.say(b"2.0\r\n-3.")
    assert hear(sensor, 1)[0] == [2.0]
    says.say(b"5\n")
    assert hear(sensor, 1)[0] == [-3.5]
    says.say(b"HX711 ready\n\xff\xfe\n" + b"x" * 5000 + b"\n4.0\n")
    values, lost = hear(sensor, 1)
    assert values == [4.0]
    assert lost >= 3
    says.say(b"1e999\n6.0\n")  # beyond all numbers: no reading
    assert hear(sensor, 1)[0] == [6.0]
    device.fail("drop")
    with pytest.raises(DeviceFault, match="connection lost"):
        while True:
            gather(sensor, 0.01)
    sensor.close()


class Arrives:
    """A port at which bytes arrive in these pieces."""

    def __init__(self, *pieces: bytes) -> None:
        self.pieces = deque(pieces)

    in_waiting = 1

    def read(self, _size: int = 1) -> bytes:
        return self.pieces.popleft()


def source_at(
    port: Arrives, clock: Clock, pattern: str, monkeypatch: pytest.MonkeyPatch
) -> LineSource:
    monkeypatch.setattr("drivers.lines.open_port", lambda *_: port)
    number = number_reader(".", "")
    return LineSource(
        clock, "cell", "-", 9600, LinePattern(pattern), [FORCE], b"", 0.1, 1e-3, 0.0, number
    )


def test_the_half_line_that_is_heard_first_is_no_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    """12.5 N cut in the middle is 2.5 N."""
    port = Arrives(b"2.5", b" N\n12.5 N\n")
    source = source_at(port, SimulatedClock(), "(?P<force>[0-9.]+) N", monkeypatch)
    assert source.read() == []
    assert [s.values for s in source.read()] == [[12.5]]


@pytest.mark.parametrize(("device_ms", "lost"), [(100, 0), (400, 3), (9000, 3)])
def test_no_more_lines_are_missing_than_can_have_been_sent(
    device_ms: int, lost: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One comes each 0.1 s. 0.2 s have passed, and the last line may have been a period late."""
    clock = SimulatedClock()
    port = Arrives(b"-\n1000 1.0 N\n", f"{1000 + device_ms} 1.0 N\n".encode())
    source = source_at(port, clock, STAMPED, monkeypatch)
    source.read()
    clock.sleep_until(0.2)
    assert [s.lost for s in source.read()] == [lost]


@pytest.mark.parametrize("keys, words", [
    ({"pattern": "("}, "pattern = '\\('"),
    ({"pattern": "(?P<f>.*)"}, r"has groups \['f'\]"),
    ({"pattern": r"(?P<force>[0-9]+)(?=N)"}, "no look-around"),
    ({"pattern": "(?P<force>([0-9.]{1,30}){1,30})"}, "at most 500 are allowed"),
    ({"decimal": ",", "thousands": ","}, "must differ from decimal"),
])  # fmt: skip
def test_wrong_keys_are_named(clock: WallClock, keys: dict[str, Any], words: str) -> None:
    good = {"port": "x", "pattern": "(?P<force>.*)", "channel": [FORCE], "rate_hz": 10.0}
    with pytest.raises(ConfigError, match=words):
        open_sensor(clock, **(good | keys))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "pattern", [r"(?P<force>[-+]?([0-9]+\.?)+) N", r"(?P<force>([0-9]?){95}[0-9]{95}) N"]
)
def test_a_damaged_line_cannot_hold_up_the_guards(pattern: str) -> None:
    compiled = LinePattern(pattern)
    for length in (27, 250, 1_000_000):  # 27 digits took the backtracking matcher 11 s
        began_s = time.process_time()
        assert compiled.match(b"0" * length + b"?") is None
        assert time.process_time() - began_s < 0.1


@pytest.mark.parametrize("decimal, thousands, text, value", [
    (".", "", "-1234.5e-1", -123.45), (",", "", "3,25", 3.25), (",", ".", "1.234,5", 1234.5),
    (".", ",", "12,345,678.25", 12345678.25), (".", "'", "1'234", 1234.0),
    (",", " ", "-1 234,5", -1234.5), (".", ",", "1234.5", 1234.5),
    (".", "", "3,25", None), (",", "", "3.25", None), (".", ",", "1,5", None),
    (",", ".", "1.5", None), (".", ",", "1,2345", None), (".", "", "nan", None),
    (".", "", "", None), (".", "", "1.2.3", None), (".", "", "\xb2", None),
])  # fmt: skip
def test_numbers_as_they_are_written_elsewhere(
    decimal: str, thousands: str, text: str, value: float | None
) -> None:
    """One that is written otherwise is none: 1,5 with a comma of thousands is not 15."""
    read = number_reader(decimal, thousands)
    if value is None:
        with pytest.raises(ValueError):
            read(text.encode("latin-1"))
    else:
        assert read(text.encode()) == value


def test_a_board_that_starts_when_its_port_is_opened_is_waited_for(
    clock: WallClock, line: tuple[Says, Served]
) -> None:
    """An Arduino is silent while it starts, prints what it is, tares, and then prints readings."""
    says, device = line
    sensor = opened(clock, device)
    with ThreadPoolExecutor(1) as other:
        connected = other.submit(sensor.connect)
        time.sleep(1.3)
        says.say(b"\nHX711\nscale 1\noffset 2\nset up\ntare\n")
        time.sleep(0.9)
        says.say(b"done\n")
        while not connected.done():
            says.say(b"1.0 N\n")
            time.sleep(0.01)
        connected.result()
    sensor.start()
    says.say(20 * b"1.5 N\n")
    values, _ = hear(sensor, 10)
    sensor.close()
    assert values[-1] == 1.5


def test_what_does_not_match_is_shown(
    clock: WallClock, line: tuple[Says, Served], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.lines.GREETING_S", 0.1)
    says, device = line
    sensor = opened(clock, device)
    with pytest.raises(DeviceAbsent, match="do not match the pattern; the last is 'F= 1,0"):
        connect_while(sensor, says, b"F= 1,0 kN\n")


@pytest.mark.parametrize("pattern, words", [
    ("(?P<force>[-0-9.]+) (?P<unit>[a-zA-Z]+)", "sends lbf now, not unit = 'N'"),
    ("(?P<force>[-0-9.]+) N", "do not match the pattern; the last is '1.0 lbf'"),
])  # fmt: skip
def test_a_gauge_that_is_switched_to_another_unit_is_a_fault(
    clock: WallClock, line: tuple[Says, Served], pattern: str, words: str
) -> None:
    says, device = line
    sensor = opened(clock, device, pattern=pattern)
    connect_while(sensor, says, b"1.0 N\n")
    sensor.start()
    says.say(b"1.0 N\n")  # all that was said before is read by now
    hear(sensor, 1)
    says.say(b"3.0 X\n2.0 N\n")  # damage: no reading, and no other unit
    values, lost = hear(sensor, 1)
    assert (values[-1], lost) == (2.0, 1)
    with pytest.raises(DeviceFault, match=words):
        for _ in range(1000):
            says.say(b"1.0 lbf\n")
            assert set(gather(sensor, 0.01).values[:, 0].tolist()) <= {1.0, 2.0}
    sensor.close()
