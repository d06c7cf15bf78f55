"""One thousand random damages of the bytes of each checked protocol: never a wrong number.

`docs/results/corruption.csv` has the same over live lines and for protocols without a check sum.
"""

import struct
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest

from drivers import DeviceFault, WallClock
from drivers.core.frame_cutter import Check, FrameCutter, crc16_modbus, crc16_x25, sum8
from drivers.core.reader import Sample
from drivers.modbus import ModbusSource, Register, rtu_bus
from sim_backend.emulators.modbus import ModbusSlave
from sim_backend.emulators.serving import damaged, served

DAMAGES = 1000


@pytest.mark.parametrize(
    ("check", "of"), [("crc16-modbus", crc16_modbus), ("crc16-x25", crc16_x25), ("sum8", sum8)]
)
def test_frames(check: Check, of: Callable[[bytes], bytes]) -> None:
    rng = np.random.default_rng(4)
    cutter = FrameCutter(b"\xaa\x55", ">B28H", check)
    sent: set[tuple[float, ...]] = set()
    read: list[tuple[float, ...]] = []
    for n in range(DAMAGES):
        numbers = (n % 256, *rng.integers(0, 65536, 28).tolist())
        body = b"\xaa\x55" + struct.pack(">B28H", *numbers)
        frame = body + of(body)
        sent.add(numbers)
        at = int(rng.integers(len(frame)))
        one_byte = frame[:at] + bytes([frame[at] ^ int(rng.integers(1, 256))]) + frame[at + 1 :]
        # a sum of bytes sees any one wrong byte; a CRC also every other damage
        spoilt = one_byte if check == "sum8" else damaged(frame, rng)
        read += [c for c, _ in cutter.feed(spoilt)]
        read += [c for c, _ in cutter.feed(frame)]
    if check == "sum8":  # out of step, a sum of 8 bits is right by chance once in 256
        assert len(set(read) - sent) < DAMAGES / 100
    else:
        assert set(read) <= sent
    assert len(read) > 0.9 * DAMAGES


def test_crc16_x25_is_the_published_one() -> None:
    assert crc16_x25(b"123456789") == (0x906E).to_bytes(2, "little")
    assert crc16_modbus(b"123456789") == (0x4B37).to_bytes(2, "little")


def test_modbus_rtu_over_a_live_line() -> None:
    """A hundred here, since each costs two time-outs; the benchmark does a thousand."""
    rng = np.random.default_rng(5)
    truth = rng.integers(0, 65536, 6).tolist()
    slave = ModbusSlave({180 + n: (lambda n=n: truth[n]) for n in range(6)}, 9, "rtu")
    registers = [Register(name=f"r{n}", address=180 + n, unit="N", type="uint16") for n in range(6)]
    read: list[Sample] = []
    with served(slave, "socket://127.0.0.1:0", "modbus") as device:
        bus = rtu_bus(device.address, 19200, "N", 1, 0.01)
        source = ModbusSource(WallClock(), "m", bus, registers, 9, "holding", "big", 0.001, 0.0)
        while device.spoilt < 100:
            for fault in ("noise", None):
                device.fail(fault)
                with suppress(DeviceFault):  # after three failures in a row, each
                    read += source.read()
        source.close()
    assert len(read) > 20
    assert {tuple(sample.values) for sample in read} == {tuple(truth)}
