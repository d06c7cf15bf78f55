"""Any Modbus sensor whose registers the rig file names: RTU over a serial line, or TCP.

All registers are read in one request, so that one sample's values belong together. There are no
retries: on a serial line a reply that comes late would be taken for the answer to the next
request. So after a request that nothing answered the line is left alone for `LATE_S`, and after
every failed one it is opened anew.
"""

import logging
import math
import time
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerType
from pymodbus.pdu import ModbusPDU

from drivers.errors import ConfigError, DeviceAbsent, DeviceFault
from drivers.ports import SOCKET, tcp_address
from drivers.protocols import Channel, Clock
from drivers.reader import LineSensor, Sample
from drivers.units import to_si

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # what matters, faults tell
MAX_REGISTERS = 125
MAX_FAILED = 3
LATE_S = 0.5
Client = ModbusTcpClient | ModbusSerialClient
Kind = Literal["int16", "uint16", "int32", "uint32", "float32"]
Role = Literal["force", "pressure", "taxel", "reference", "other"]


class Register(BaseModel):
    """One channel: ``scale`` x the register's number is in ``unit``, and stored in SI.

    ``full_scale`` is in ``unit`` too.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    name: str
    address: Annotated[int, Field(ge=0, le=65535)]
    unit: str
    type: Kind = "int16"
    scale: float = 1.0
    role: Role = "other"
    full_scale: float | None = None

    @property
    def words(self) -> int:
        return 1 if self.type.endswith("16") else 2


class ModbusSource:
    """A polled map of registers; see `drivers.reader.Source`."""

    def __init__(
        self,
        clock: Clock,
        name: str,
        client: Client,
        registers: Sequence[Register],
        device_id: int,
        table: Literal["holding", "input"],
        word_order: Literal["big", "little"],
        period_s: float,
        latency_s: float,
    ) -> None:
        self._clock = clock
        self._name = name
        self._client = client
        self._heard = 0
        client.transaction.trace_packet = self._trace
        self._registers = registers
        self._device_id = device_id
        self._word_order = word_order
        self._period_s = period_s
        self._latency_s = latency_s
        self._first = min(r.address for r in registers)
        self._count = max(r.address + r.words for r in registers) - self._first
        tables = {"holding": client.read_holding_registers, "input": client.read_input_registers}
        self._ask = tables[table]
        self._due_s = clock.now()
        self._failed = 0
        if not client.connect():
            _close(client)
            raise DeviceAbsent(name, f"nothing to connect to at {client.comm_params.host}")

    def read(self) -> list[Sample]:
        """One poll. Raises `DeviceFault` after `MAX_FAILED` failures in a row."""
        wait_s = self._due_s - self._clock.now()
        if wait_s > 0:
            time.sleep(min(wait_s, 0.1))
            if wait_s > 0.1:
                return []
        self._heard = 0
        asked_s = self._clock.now()
        missed = max(math.floor((asked_s - self._due_s) / self._period_s), 0)
        self._due_s += (1 + missed) * self._period_s
        try:
            reply = self._ask(self._first, count=self._count, device_id=self._device_id)
        except (ModbusException, OSError) as error:
            self._recover(str(error))
            return []
        if (why := self._wrong(reply)) is not None:
            self._recover(why)
            return []
        lost, self._failed = missed + self._failed, 0
        middle_s = (asked_s + self._clock.now()) / 2  # the device answered somewhere in between
        values = [self._value(reply.registers, register) for register in self._registers]
        return [Sample(middle_s - self._latency_s, values, lost)]

    def close(self) -> None:
        """Close the line."""
        _close(self._client)

    def _trace(self, sending: bool, data: bytes) -> bytes:
        """Hook of pymodbus: what passes on the line."""
        if not sending:
            self._heard += len(data)
        return data

    def _wrong(self, reply: ModbusPDU) -> str | None:
        if reply.isError():
            code = getattr(reply, "exception_code", 0)
            if code in (1, 2, 3):  # it will never answer otherwise
                first, last = self._first, self._first + self._count - 1
                raise DeviceFault(
                    self._name, f"refuses registers {first} to {last} (Modbus exception {code})"
                )
            return f"Modbus exception {code}"
        if len(reply.registers) != self._count:
            return f"{len(reply.registers)} registers instead of {self._count}"
        return None

    def _value(self, words: Sequence[int], register: Register) -> float:
        start = register.address - self._first
        number = self._client.convert_from_registers(
            list(words[start : start + register.words]),
            self._client.DATATYPE[register.type.upper()],
            word_order=self._word_order,
        )
        assert isinstance(number, int | float)
        return register.scale * to_si(register.unit)[1] * number

    def _recover(self, why: str) -> None:
        """Let a reply that may still come pass, then start afresh."""
        self._failed += 1
        if self._failed >= MAX_FAILED:
            raise DeviceFault(self._name, f"{MAX_FAILED} polls in a row failed: {why}")
        if not self._heard:
            time.sleep(LATE_S)
        _close(self._client)
        if not self._client.connect():
            raise DeviceFault(self._name, f"connection lost ({why})")


def _channel(register: Register) -> Channel:
    unit, factor = to_si(register.unit)
    full = None if register.full_scale is None else factor * register.full_scale
    return Channel(register.name, unit, register.role, full_scale=full)


def _close(client: Client) -> None:
    client.close()  # type: ignore[no-untyped-call]  # pymodbus gives it no types


def connect_rtu(port: str, baud: int, parity: str, stopbits: int, timeout_s: float) -> Client:
    """A client on a serial line, or on ``socket://host:port`` in front of one; not connected."""
    if port.startswith(SOCKET):
        host, tcp_port = tcp_address(port)
        return ModbusTcpClient(
            host, port=tcp_port, framer=FramerType.RTU, timeout=timeout_s, retries=0
        )
    return ModbusSerialClient(
        port, baudrate=baud, parity=parity, stopbits=stopbits, timeout=timeout_s, retries=0
    )


def open_sensor(
    clock: Clock,
    *,
    register: list[Register],
    port: str | None = None,
    host: str | None = None,
    tcp_port: int = 502,
    baud: int = 19200,
    parity: Literal["N", "E", "O"] = "N",
    stopbits: Literal[1, 2] = 1,
    device_id: int = 1,
    table: Literal["holding", "input"] = "holding",
    word_order: Literal["big", "little"] = "big",
    rate_hz: float = 50.0,
    timeout_ms: float = 100.0,
    latency_ms: float = 0.0,
    name: str = "modbus",
    simulated: bool = False,
) -> LineSensor:
    """A Modbus sensor at a serial ``port`` (RTU) or a ``host`` (TCP).

    ``register``: a list of `Register` tables. ``word_order`` is that of 32-bit values.
    Raises `ConfigError`.
    """
    if (port is None) == (host is None):
        raise ConfigError("port or host: give one of them, port for RTU, host for TCP")
    if not register:
        raise ConfigError("register = []: name at least one [[sensor.register]]")
    span = max(r.address + r.words for r in register) - min(r.address for r in register)
    if span > MAX_REGISTERS:
        raise ConfigError(
            f"register: addresses span {span}; one request reads up to {MAX_REGISTERS}"
        )
    if not rate_hz > 0 or not timeout_ms > 0:
        raise ConfigError(f"rate_hz = {rate_hz:g}, timeout_ms = {timeout_ms:g}: must be above 0")
    channels = tuple(_channel(r) for r in register)

    def open_source() -> ModbusSource:
        timeout_s = 1e-3 * timeout_ms
        client: Client
        if host is not None:
            client = ModbusTcpClient(host, port=tcp_port, timeout=timeout_s, retries=0)
        else:
            assert port is not None
            client = connect_rtu(port, baud, parity, stopbits, timeout_s)
        return ModbusSource(
            clock, name, client, register, device_id, table, word_order, 1 / rate_hz,
            1e-3 * latency_ms,
        )  # fmt: skip

    return LineSensor(clock, name, channels, rate_hz, open_source, simulated=simulated)
