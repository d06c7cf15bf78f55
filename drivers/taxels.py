"""A taxel array that sends binary frames over a serial line.

A frame is ``header``, an optional counter byte, the taxels row by row, and an optional check sum
over all before it. What is not a frame is skipped and counted.
"""

from typing import Literal

import numpy as np

from drivers.core.array_layout import taxel_names
from drivers.core.errors import ConfigError
from drivers.core.frame_cutter import Check, FrameCutter
from drivers.core.ports import PortName, open_port, read_some
from drivers.core.protocols import Channel, Clock
from drivers.core.reader import LineSensor, Sample
from drivers.core.settings import Baud, NonNegative, Positive
from drivers.core.timestamps import FrameTime
from drivers.core.units import to_si

Number = Literal["u8", "i8", "u16", "i16", "u32", "i32", "f32"]
MAX_TAXELS = 4096  # a slip of the pen beyond: 64 x 64 of 16 bits take 0.7 s at 115,200 baud
CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f"}


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
    port: PortName,
    rows: int,
    columns: int,
    header: str,
    rate_hz: Positive,
    baud: Baud = 115200,
    number: Number = "u16",
    byte_order: Literal["big", "little"] = "big",
    counter: bool = False,
    check: Check = "none",
    unit: str = "Pa",
    scale: float = 1.0,
    offset: float = 0.0,
    full_scale: float | None = None,
    latency_ms: NonNegative = 0.0,
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
    si, factor = to_si(unit)
    if si != "Pa":
        raise ConfigError(f"unit = {unit!r}: taxels measure a pressure; Pa, kPa, mbar, mmHg, psi …")
    order = ">" if byte_order == "big" else "<"
    layout = f"{order}{'B' if counter else ''}{rows * columns}{CODES[number]}"
    full_pa = None if full_scale is None else factor * full_scale
    channels = tuple(
        Channel(name, "Pa", "taxel", full_scale=full_pa) for name in taxel_names(rows, columns)
    )

    def open_source() -> TaxelSource:
        cutter = FrameCutter(start, layout, check)
        return TaxelSource(
            clock, name, port, baud, cutter, counter, factor * scale, factor * offset,
            1 / rate_hz, 1e-3 * latency_ms,
        )  # fmt: skip

    return LineSensor(clock, name, channels, rate_hz, open_source, simulated=simulated)
