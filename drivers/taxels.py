"""A taxel array that sends binary frames over a serial line.

A frame is ``header``, an optional counter byte, the taxels row by row, and an optional check sum
over all before it. What is not a frame is skipped and counted.
"""

import math
import struct
from collections.abc import Callable
from typing import Literal

import numpy as np
from pymodbus.framer import FramerRTU

from drivers.core.errors import ConfigError
from drivers.core.ports import open_port, read_some
from drivers.core.protocols import Channel, Clock
from drivers.core.reader import LineSensor, Sample
from drivers.core.timestamps import FrameTime
from drivers.core.units import to_si

Number = Literal["u8", "i8", "u16", "i16", "u32", "i32", "f32"]
Check = Literal["none", "sum8", "crc16-modbus", "crc16-x25"]
MAX_TAXELS = 4096  # a slip of the pen beyond: 64 x 64 of 16 bits take 0.7 s at 115,200 baud
CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f"}


def sum8(data: bytes) -> bytes:
    """The sum of all bytes, modulo 256."""
    return bytes([sum(data) & 0xFF])


def crc16_modbus(data: bytes) -> bytes:
    """CRC-16/MODBUS, low byte first."""
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")  # pymodbus returns it swapped


def crc16_x25(data: bytes) -> bytes:
    """CRC-16/X-25 (polynomial 0x1021 reflected, start and end inverted), low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return (crc ^ 0xFFFF).to_bytes(2, "little")


CHECKS: dict[Check, tuple[int, Callable[[bytes], bytes]]] = {
    "none": (0, lambda _data: b""),
    "sum8": (1, sum8),
    "crc16-modbus": (2, crc16_modbus),
    "crc16-x25": (2, crc16_x25),
}


class FrameCutter:
    """Cuts a byte stream into frames of ``layout`` between ``header`` and check sum."""

    def __init__(self, header: bytes, layout: str, check: Check) -> None:
        self._header = header
        self._layout = struct.Struct(layout)
        self._check_bytes, self._check = CHECKS[check]
        self.frame_bytes = len(header) + self._layout.size + self._check_bytes
        self._buffer = b""
        self._skipped = 0

    def feed(self, data: bytes) -> list[tuple[tuple[float, ...], int]]:
        """Whole frames as numbers, each with the bytes skipped right before it."""
        self._buffer += data
        found: list[tuple[tuple[float, ...], int]] = []
        while True:
            start = self._buffer.find(self._header)
            if start < 0:  # the end may be part of a header
                start = max(len(self._buffer) - len(self._header) + 1, 0)
            self._skip(start)
            if len(self._buffer) < self.frame_bytes:
                return found
            end = self.frame_bytes - self._check_bytes
            body, check = self._buffer[:end], self._buffer[end : self.frame_bytes]
            if self._check(body) != check:
                self._skip(1)
                continue
            found.append((self._layout.unpack(body[len(self._header) :]), self._skipped))
            self._skipped = 0
            self._buffer = self._buffer[self.frame_bytes :]

    def _skip(self, count: int) -> None:
        self._skipped += count
        self._buffer = self._buffer[count:]


class TaxelSource:
    """An open line; see `drivers.core.reader.Source`."""

    def __init__(
        self,
        clock: Clock,
        name: str,
        port: str,
        baud: int,
        cutter: FrameCutter,
        counted: bool,
        factor: float,
        offset: float,
        period_s: float,
        latency_s: float,
    ) -> None:
        self._clock = clock
        self._line = open_port(name, port, baud)
        self._cutter = cutter
        self._counted = counted
        self._factor, self._offset = factor, offset
        self._time = FrameTime(period_s, latency_s)
        self._counter: int | None = None
        self._lost = 0

    def read(self) -> list[Sample]:
        """The frames that have arrived."""
        data = read_some(self._line)
        now = self._clock.now()
        samples = []
        for numbers, skipped in self._cutter.feed(data):
            missing, taxels = round(skipped / self._cutter.frame_bytes), numbers
            if self._counted:
                count, taxels = int(numbers[0]), numbers[1:]
                if self._counter is not None:
                    missing = (count - self._counter - 1) % 256
                self._counter = count
            time_s, lost = self._time.stamp(now, missing)
            self._lost += lost
            values = self._factor * np.array(taxels) + self._offset
            if not np.isfinite(values).all():  # a damaged float is a lost sample, never a reading
                self._lost += 1
                continue
            samples.append(Sample(time_s, values.tolist(), self._lost))
            self._lost = 0
        return samples

    def close(self) -> None:
        """Close the line."""
        self._line.close()


def open_sensor(
    clock: Clock,
    *,
    port: str,
    rows: int,
    columns: int,
    header: str,
    rate_hz: float,
    baud: int = 115200,
    number: Number = "u16",
    byte_order: Literal["big", "little"] = "big",
    counter: bool = False,
    check: Check = "none",
    unit: str = "Pa",
    scale: float = 1.0,
    offset: float = 0.0,
    full_scale: float | None = None,
    latency_ms: float = 0.0,
    name: str = "taxels",
    simulated: bool = False,
) -> LineSensor:
    """An array of ``rows`` x ``columns`` taxels at a serial ``port``.

    ``header`` in hexadecimal (``"AA55"``); pressure = ``scale`` x number + ``offset`` in ``unit``,
    stored in Pa, in channels ``r0c0``, ``r0c1``, … ``full_scale``: the pressure in ``unit``, after
    ``scale`` and ``offset``, from which on a taxel counts as saturated. ``counter``: one byte after
    the header counts frames modulo 256. ``check``: the check sum at a frame's end. ``latency_ms``:
    from the touch to the frame's earliest arrival. Raises `ConfigError`.
    """
    try:
        start = bytes.fromhex(header)
    except ValueError:
        start = b""
    if not start:
        raise ConfigError(f"header = {header!r}: must be hexadecimal bytes such as 'AA55'")
    if not (rows >= 1 and columns >= 1 and rows * columns <= MAX_TAXELS):
        raise ConfigError(
            f"rows = {rows}, columns = {columns}: 1 to {MAX_TAXELS} taxels are possible"
        )
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        raise ConfigError(f"rate_hz = {rate_hz:g}: must be above 0")
    si, factor = to_si(unit)
    if si != "Pa":
        raise ConfigError(f"unit = {unit!r}: taxels measure a pressure; Pa, kPa, mbar, mmHg, psi …")
    order = ">" if byte_order == "big" else "<"
    layout = f"{order}{'B' if counter else ''}{rows * columns}{CODES[number]}"
    full_pa = None if full_scale is None else factor * full_scale
    channels = tuple(
        Channel(f"r{row}c{column}", "Pa", "taxel", full_scale=full_pa)
        for row in range(rows)
        for column in range(columns)
    )

    def open_source() -> TaxelSource:
        cutter = FrameCutter(start, layout, check)
        return TaxelSource(
            clock, name, port, baud, cutter, counter, factor * scale, factor * offset,
            1 / rate_hz, 1e-3 * latency_ms,
        )  # fmt: skip

    return LineSensor(clock, name, channels, rate_hz, open_source, simulated=simulated)
