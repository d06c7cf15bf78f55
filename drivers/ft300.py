"""Robotiq FT-300(-S): its stream of 100 frames a second, or polled by Modbus RTU.

A frame is 16 bytes: ``20 4E``, six little-endian int16 (forces in 0.01 N, torques in 0.001 Nm)
and the Modbus CRC16 of all before it, low byte first. The stream starts when 0x0200 is written to
register 410 and ends with fifty 0xFF.
"""

import time
from contextlib import suppress
from typing import Literal

from drivers.core.frame_cutter import FrameCutter
from drivers.core.ports import Port, PortName, open_port, read_some
from drivers.core.protocols import Channel, Clock
from drivers.core.reader import LineSensor, Sample, Source
from drivers.core.settings import NonNegative, Settings
from drivers.core.timestamps import FrameTime
from drivers.modbus import ModbusSource, Register, rtu_bus

BAUD = 19200
DEVICE_ID = 9
STREAM_HZ = 100.0
POLL_HZ = 50.0
HEADER = b"\x20\x4e"
START = bytes.fromhex("0910019A0001020200CDCA")
STOP = b"\xff" * 50
FULL_SCALE_N, FULL_SCALE_NM = 300.0, 30.0
AXES = ("fx", "fy", "fz", "mx", "my", "mz")
SCALES = (0.01, 0.01, 0.01, 0.001, 0.001, 0.001)
UNITS = ("N", "N", "N", "Nm", "Nm", "Nm")
FIRST_REGISTER = 180
POLL_TIMEOUT_S = 0.1
Normal = Literal["+fx", "-fx", "+fy", "-fy", "+fz", "-fz"]


class StreamSource:
    """The stream; see `drivers.core.reader.Source`."""

    def __init__(
        self, clock: Clock, name: str, port: str, normal: Normal, latency_s: float
    ) -> None:
        self._clock = clock
        self._line: Port = open_port(name, port, BAUD)
        self._normal = normal
        self._frames = FrameCutter(HEADER, "<6h", "crc16-modbus")
        self._time = FrameTime(1 / STREAM_HZ, latency_s)
        try:
            self._line.write(STOP)  # a stream left on by someone else deafens the sensor
            time.sleep(0.05)
            self._line.reset_input_buffer()
            self._line.write(START)
        except OSError:
            self._line.close()
            raise

    def read(self) -> list[Sample]:
        """The frames that have arrived."""
        data = read_some(self._line)
        now = self._clock.now()
        samples = []
        for counts, skipped in self._frames.feed(data):
            time_s, lost = self._time.stamp(now, round(skipped / self._frames.frame_bytes))
            samples.append(Sample(time_s, _channels(counts, self._normal), lost))
        return samples

    def close(self) -> None:
        """End the stream and close the line."""
        with suppress(OSError):  # unplugged: nothing to end
            self._line.write(STOP)
        self._line.close()


def _channels(counts: tuple[float, ...], normal: Normal) -> list[float]:
    values = [scale * count for scale, count in zip(SCALES, counts, strict=True)]
    sign = 1.0 if normal[0] == "+" else -1.0
    return [sign * values[AXES.index(normal[1:])], *values]


class Ft300Settings(Settings):
    """``[[sensor]] driver = "ft300"``: at ``port`` (a path, ``COM3``: untested, ``socket://…``).

    The channel ``force`` is the normal force, positive when pressed: ``normal`` says which of the
    sensor's axes that is, ``-fz`` for a probe on its face, pressing along the sensor's +z.
    """

    name: str = "ft300"
    port: PortName
    mode: Literal["stream", "poll"] = "stream"
    normal: Normal = "-fz"
    latency_ms: NonNegative = 0.0


def open_sensor(clock: Clock, settings: Ft300Settings) -> LineSensor:
    """An FT-300, not yet connected."""
    keys, full = settings, {"N": FULL_SCALE_N, "Nm": FULL_SCALE_NM}
    axes = zip(AXES, UNITS, strict=True)
    channels = (
        Channel("force", "N", "force", full_scale=FULL_SCALE_N),
        *(Channel(axis, unit, full_scale=full[unit]) for axis, unit in axes),
    )
    latency_s = 1e-3 * keys.latency_ms
    rate_hz = STREAM_HZ if keys.mode == "stream" else POLL_HZ

    def open_source() -> Source:
        if keys.mode == "stream":
            return StreamSource(clock, keys.name, keys.port, keys.normal, latency_s)
        bus = rtu_bus(keys.port, BAUD, "N", 1, POLL_TIMEOUT_S)
        registers = _registers(keys.normal)
        return ModbusSource(
            clock, keys.name, bus, registers, DEVICE_ID, "holding", "ABCD", 1 / POLL_HZ,
            latency_s,
        )  # fmt: skip

    return LineSensor(clock, keys.name, channels, rate_hz, open_source, simulated=keys.simulated)


def _registers(normal: Normal) -> list[Register]:
    address = {axis: FIRST_REGISTER + n for n, axis in enumerate(AXES)}
    pressed = SCALES[0] if normal[0] == "+" else -SCALES[0]
    force = Register(name="force", address=address[normal[1:]], unit="N", scale=pressed)
    return [force] + [
        Register(name=axis, address=address[axis], unit=unit, scale=scale)
        for axis, scale, unit in zip(AXES, SCALES, UNITS, strict=True)
    ]
