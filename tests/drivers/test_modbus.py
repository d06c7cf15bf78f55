"""The Modbus driver against pymodbus' own server, an independent peer, and an emulated device."""

import asyncio
import itertools
import os
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from peer import Peer
from pydantic import ValidationError
from pymodbus.framer import FramerRTU
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from running import running
from waiting import until

from drivers import DeviceAbsent, DeviceFault, WallClock
from drivers.core.reader import LineSensor
from drivers.modbus import ModbusSettings, ModbusSource, Register, open_sensor, rtu_bus
from sim_backend.emulators.modbus import ModbusSlave
from sim_backend.emulators.serving import Served, served

FLOAT = struct.unpack(">HH", struct.pack(">f", 2.5))


@pytest.fixture(scope="module")
def server_port() -> Iterator[int]:
    """A server of pymodbus in a thread; holding registers 100 to 106 of device 7."""
    started: list[Any] = []
    ready = threading.Event()

    async def serve() -> None:
        words = [123, 65531, 0, 40000, 0xFFFF, 0xFFFE, *FLOAT]
        data = SimData(100, values=words, datatype=DataType.REGISTERS)
        server = ModbusTcpServer(SimDevice(7, simdata=[data]), address=("127.0.0.1", 0))
        await server.listen()
        started.append((asyncio.get_running_loop(), server))
        ready.set()
        await server.serving

    def run() -> None:
        try:
            asyncio.run(serve())
        except asyncio.CancelledError:
            return  # the end of a server of pymodbus

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(5)
    loop, server = started[0]
    yield server.transport.sockets[0].getsockname()[1]
    asyncio.run_coroutine_threadsafe(server.shutdown(), loop)
    thread.join(timeout=5)


REGISTERS = [
    Register(name="a", address=100, unit="mN", scale=10.0, role="force", full_scale=2000.0),
    Register(name="b", address=101, unit="V"),
    Register(name="c", address=102, unit="kPa", type="uint32", scale=0.001, role="pressure"),
    Register(name="d", address=104, unit="N", type="int32"),
    Register(name="e", address=106, unit="K", type="float32"),
]


def opened(**keys: Any) -> LineSensor:
    return open_sensor(WallClock(), ModbusSettings.model_validate(keys))


ONE = Register(name="n", address=0, unit="-")


def on_register(device: Served, **keys: Any) -> LineSensor:
    return opened(port=device.address, **({"register": [ONE]} | keys))


def first_row(sensor: LineSensor) -> list[float]:
    with running(sensor):
        while not len((block := sensor.read()).time_s):
            pass
    return [float(v) for v in block.values[0]]


def test_every_type_and_unit_of_an_independent_server(server_port: int) -> None:
    sensor = opened(host="127.0.0.1", tcp_port=server_port, device_id=7, register=REGISTERS)
    assert [c.unit for c in sensor.channels] == ["N", "V", "Pa", "N", "K"]
    assert sensor.channels[0].full_scale == 2.0
    assert first_row(sensor) == pytest.approx([1.23, -5.0, 40000.0, -2.0, 2.5])
    swapped = opened(
        host="127.0.0.1", tcp_port=server_port, device_id=7, byte_order="CDAB",
        register=[Register(name="c", address=102, unit="Pa", type="uint32")],
    )  # fmt: skip
    assert first_row(swapped) == [40000 * 65536.0]


def test_a_register_that_is_not_there_is_named(server_port: int) -> None:
    register = [Register(name="x", address=5000, unit="N")]
    sensor = opened(host="127.0.0.1", tcp_port=server_port, device_id=7, register=register)
    with pytest.raises(DeviceAbsent, match=r"refuses registers 5000 to 5000 \(Modbus exception 2"):
        sensor.connect()


def test_nobody_there_is_absence() -> None:
    sensor = opened(host="127.0.0.1", tcp_port=1, register=REGISTERS)
    with pytest.raises(DeviceAbsent, match="nothing to connect to at 127"):
        sensor.connect()


def test_a_late_reply_is_not_taken_for_the_next_one() -> None:
    """Each answer counts up: one that is read late would show a number too small for its time."""
    counted = itertools.count(1)
    slave = ModbusSlave({0: lambda: next(counted)}, 1, "rtu")
    with (
        served(slave, "socket://127.0.0.1:0", "modbus") as device,
        running(on_register(device)) as sensor,
    ):
        device.fail("late")
        time.sleep(0.05)  # what was already on its way
        sensor.read()
        with pytest.raises(DeviceFault, match="3 polls in a row failed"):
            while True:
                assert len(sensor.read().time_s) == 0, "a late reply was accepted"
                time.sleep(0.01)


@pytest.mark.parametrize("keys, words", [
    ({"register": REGISTERS}, "port or host"),
    ({"host": "a", "port": "b", "register": REGISTERS}, "port or host"),
    ({"host": "a", "register": []}, "at least 1 item"),
    (
        {"host": "a", "register": [*REGISTERS, Register(name="z", address=900, unit="N")]},
        "span 801",
    ),
])  # fmt: skip
def test_wrong_keys_are_named(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        opened(**keys)


def slave_of(number: bytes, order: str) -> ModbusSlave:
    """Holding registers from 0 on whose bytes spell ``number`` in an order (of 4 or 8 bytes)."""
    pairs = [number[n : n + 2] for n in range(0, len(number), 2)]
    if order in ("CDAB", "DCBA"):
        pairs.reverse()
    if order in ("BADC", "DCBA"):
        pairs = [pair[::-1] for pair in pairs]
    words = [int.from_bytes(pair, "big") for pair in pairs]
    return ModbusSlave({n: lambda w=w: w for n, w in enumerate(words)}, 1, "rtu")  # type: ignore[misc]


@pytest.mark.parametrize("order", ["ABCD", "BADC", "CDAB", "DCBA"])
@pytest.mark.parametrize(
    ("kind", "form", "value"),
    [("float32", ">f", -1234.5), ("int32", ">i", -70000), ("uint32", ">I", 4_000_000_000),
     ("float64", ">d", 1e-7), ("int64", ">q", -(2**40)), ("uint64", ">Q", 2**50)],
)  # fmt: skip
def test_every_order_of_bytes(order: str, kind: str, form: str, value: float) -> None:
    slave = slave_of(struct.pack(form, value), order)
    with served(slave, "socket://127.0.0.1:0", "modbus") as device:
        register = [ONE.model_copy(update={"type": kind})]
        sensor = on_register(device, byte_order=order, register=register)
        assert first_row(sensor) == [pytest.approx(value, rel=1e-7)]


@pytest.mark.parametrize("odd", [float("nan"), 1.14e-42])  # an integer's bits, read as a float
def test_not_a_number_is_a_lost_reading_and_then_a_fault(odd: float) -> None:
    reported = [2.5]

    def word(n: int) -> int:
        return struct.unpack(">HH", struct.pack(">f", reported[0]))[n]

    slave = ModbusSlave({0: lambda: word(0), 1: lambda: word(1)}, 1, "rtu")
    with served(slave, "socket://127.0.0.1:0", "modbus") as device:
        register = [ONE.model_copy(update={"type": "float32"})]
        with running(on_register(device, timeout_ms=1000, register=register)) as sensor:
            time.sleep(0.2)
            assert (sensor.read().values == 2.5).all()
            reported[0] = odd
            with pytest.raises(DeviceFault, match=r"n: not a number, 3 times in a row.*byte_order"):
                while True:
                    assert set(sensor.read().values.ravel()) <= {2.5}
                    time.sleep(0.01)


class TwoOnALine(Peer):
    """Devices 1 and 2 on one RS-485 line: each hears all, and answers its own."""

    def __init__(self) -> None:
        self._slaves = [ModbusSlave({0: lambda n=n: 100 * n}, n, "rtu") for n in (1, 2)]

    def received(self, data: bytes) -> bytes:
        return b"".join(slave.received(data) for slave in self._slaves)


def test_two_sensors_on_one_line_take_turns() -> None:
    with served(TwoOnALine(), "pty", "modbus") as device:
        sensors = [
            on_register(device, name=f"s{n}", device_id=n, timeout_ms=1000.0) for n in (1, 2)
        ]
        for sensor in sensors:
            sensor.connect()
            sensor.start()
        seen: list[list[float]] = [[], []]
        end_s = time.monotonic() + 10.0
        while min(map(len, seen)) < 20:
            assert time.monotonic() < end_s
            for values, sensor in zip(seen, sensors, strict=True):
                values += sensor.read().values[:, 0].tolist()
        assert [set(values) for values in seen] == [{100.0}, {200.0}]
        sensors[0].close()  # and the other goes on
        sensors[1].read()
        while not len(sensors[1].read().time_s):
            assert time.monotonic() < end_s
        sensors[1].close()
        sensors[0].connect()  # and the line can be opened again
        sensors[0].close()


def frame(body: bytes) -> bytes:
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


class Answers(Peer):
    """Answers each request for one register of device 1 with what the test has. Where that is a
    reading, requests for more are refused."""

    def __init__(self, *answers: bytes) -> None:
        self.answers, self.asked = list(answers), 0

    def received(self, data: bytes) -> bytes:
        if data[5] != 1 and READING in self.answers:
            return frame(b"\x01\x83\x02")
        self.asked += 1
        return self.answers[(self.asked - 1) % len(self.answers)] or data


class Slow(Peer):
    """Answers in order, what was asked last ``late_s`` late once: register 0 is 1, 10 is 7."""

    def __init__(self, late_s: float) -> None:
        self.late_s, self.queue = late_s, list[tuple[float, bytes]]()

    def received(self, data: bytes) -> bytes:
        first, count = struct.unpack(">HH", data[2:6])
        words = struct.pack(f">{count}H", *([7 if first else 1] * count))
        ready_s = time.monotonic() + self.late_s
        self.late_s = 0.0
        if self.queue:
            ready_s = max(ready_s, self.queue[-1][0])
        self.queue.append((ready_s, frame(bytes([1, 3, 2 * count]) + words)))
        return self.due()

    def due(self) -> bytes:
        answer = b""
        while self.queue and self.queue[0][0] <= time.monotonic():
            answer += self.queue.pop(0)[1]
        return answer


@pytest.mark.parametrize("late_s", [0.4, 0.95, 1.7])
def test_two_tables_on_one_port_never_have_each_others_numbers(late_s: float) -> None:
    """An answer that came later than the line was left alone was another table's force."""
    slow = Slow(0.0)
    with served(slow, "pty", "modbus") as device:
        bus = rtu_bus(device.address, 19200, "N", 1, 0.3)
        tables = {
            value: ModbusSource(
                WallClock(), "m", bus, [ONE.model_copy(update={"address": at})], 1, "holding",
                "ABCD", 0.02, 0.0,
            )
            for at, value in ((0, 1.0), (10, 7.0))
        }  # fmt: skip
        for late in (0.0, late_s):
            slow.late_s = late
            heard: dict[float, list[float]] = {1.0: [], 7.0: []}
            end_s = time.monotonic() + 0.5 + 2 * late
            while time.monotonic() < end_s:
                for value, source in tables.items():
                    with suppress(DeviceFault):
                        heard[value] += [v for sample in source.read() for v in sample.values]
            assert all(set(values) == {value} for value, values in heard.items())
        for source in tables.values():
            source.close()


READING, ECHO = frame(b"\x01\x03\x02\x00\x07"), b""
BUSY = frame(b"\x01\x83\x06")


@pytest.mark.parametrize("wrong", [
    frame(b"\x01\x04\x02\x22\x22"), frame(b"\x01\x03\x04\x22\x22\x22\x22"), frame(b"\x01\x83\x05"),
])  # fmt: skip
def test_an_answer_to_another_question_is_no_reading(wrong: bytes) -> None:
    with (
        served(Answers(READING, READING, wrong), "pty", "modbus") as device,
        running(on_register(device, timeout_ms=1000.0)) as sensor,
    ):
        values: set[float] = set()
        lost, end_s = 0, time.monotonic() + 20.0
        while lost < 3 and time.monotonic() < end_s:
            block = sensor.read()
            values |= set(block.values[:, 0].tolist())
            lost += block.lost
            time.sleep(0.01)
        assert lost >= 3
        assert values == {7.0}


def test_a_busy_device_is_waited_for_but_not_for_long() -> None:
    peer = Answers(READING, BUSY, BUSY, BUSY, BUSY)
    with (
        served(peer, "pty", "modbus") as device,
        running(on_register(device, rate_hz=50.0, timeout_ms=1000.0)) as sensor,
    ):
        until(lambda: sensor.read().lost >= 4, 20.0)  # four in a row, 80 ms
        peer.answers = [BUSY]
        with pytest.raises(DeviceFault, match="polls in a row failed: Modbus exception 6: busy"):
            until(lambda: sensor.read() is None, 20.0)


@pytest.mark.parametrize("answer, words", [
    (ECHO, "what is sent comes back: switch off the adapter's echo"),
    (b"\x00\xff" + READING, r"00 ff 01 03 02 00 07 .* is no answer: see baud, parity"),
])  # fmt: skip
def test_what_comes_instead_of_an_answer_is_reported(
    answer: bytes, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.modbus.LATE_S", 0.0)
    with (
        served(Answers(answer), "pty", "modbus") as device,
        pytest.raises(DeviceAbsent, match=words),
    ):
        on_register(device, timeout_ms=200.0).connect()


def test_what_a_serial_line_does_not_answer_is_not_asked_again() -> None:
    """A second request within one poll would have its answer taken for that to the next."""
    tty = pytest.importorskip("tty")
    device, host = os.openpty()
    tty.setraw(host)
    bus = rtu_bus(os.ttyname(host), 19200, "N", 1, 0.02)
    source = ModbusSource(WallClock(), "m", bus, REGISTERS[:1], 9, "holding", "big", 0.001, 0.0)
    with suppress(DeviceFault):
        source.read()
    assert len(os.read(device, 100)) == 8
    source.close()
    os.close(device)
    os.close(host)
