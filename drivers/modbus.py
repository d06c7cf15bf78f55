"""Any Modbus sensor whose registers the rig file names: RTU over a serial line, or TCP.

All registers are read in one request, so that one sample's values belong together. There are no
retries, and after every failed request the line is opened anew, where nothing was heard after
`LATE_S`. An answer on a serial line does not say which registers it has: it may come at any time
later, and to another table of the same device. Devices answer in order. So after a failed request
a device is first asked for a number of registers that no table on its line has: once this is
answered, nothing that was asked before can still come.
"""

import logging
import math
import threading
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Annotated, Literal, Self
from weakref import WeakValueDictionary

from pydantic import Field, model_validator
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerType
from pymodbus.pdu import ModbusPDU

from drivers.core.channel_table import ChannelTable
from drivers.core.errors import DeviceAbsent, DeviceFault
from drivers.core.ports import SOCKET, PortName, tcp_address
from drivers.core.protocols import Clock
from drivers.core.reader import LineSensor, Sample
from drivers.core.settings import Baud, NonNegative, Positive, Settings

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # faults say what matters
MAX_REGISTERS = 125
LEAST = 1e-30
"""No sensor measures so little: whole numbers that are read as floats are from 1e-45 on."""
MAX_FAILED = 3
LATE_S = 0.5
REFUSED = (1, 2, 3)  # function, address, count: it will never answer otherwise
BUSY = {5: "acknowledged, not done yet", 6: "busy"}
BUSY_S = 0.2  # a scan ends sooner than this only for a line or an answer that is wrong
SHOWN_BYTES = 12
FUNCTIONS = {"holding": 3, "input": 4}
Client = ModbusTcpClient | ModbusSerialClient
Kind = Literal["int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
Order = Literal["ABCD", "BADC", "CDAB", "DCBA"]


class Register(ChannelTable):
    """One channel: ``scale`` x the register's number is in ``unit``, and stored in SI.

    ``full_scale`` is in ``unit`` too.
    """

    address: Annotated[int, Field(ge=0, le=65535)]
    type: Kind = "int16"

    @property
    def words(self) -> int:
        return int(self.type[-2:]) // 16


class ModbusSettings(Settings):
    """``[[sensor]] driver = "modbus"``: at a serial ``port`` (RTU) or a ``host`` (TCP).

    ``register``: one table per channel. ``byte_order``: how the bytes of a number lie on the line,
    A the highest; ``CDAB`` has its low 16-bit word first, ``BADC`` swaps the bytes of each word.
    """

    name: str = "modbus"
    registers: Annotated[tuple[Register, ...], Field(alias="register", min_length=1)]
    port: PortName | None = None
    host: str | None = None
    tcp_port: Annotated[int, Field(ge=1, le=65535)] = 502
    baud: Baud = 19200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    device_id: Annotated[int, Field(ge=0, le=247)] = 1
    table: Literal["holding", "input"] = "holding"
    byte_order: Order = "ABCD"
    rate_hz: Positive = 50.0
    timeout_ms: Positive = 100.0
    latency_ms: NonNegative = 0.0

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.port is None) == (self.host is None):
            raise ValueError("port or host: give one of them, port for RTU, host for TCP")
        last = max(r.address + r.words for r in self.registers)
        if (span := last - min(r.address for r in self.registers)) > MAX_REGISTERS:
            raise ValueError(
                f"register: addresses span {span}; one request reads up to {MAX_REGISTERS}"
            )
        return self


class Bus:
    """A line with one device or several: one request at a time; closed by its last user."""

    def __init__(self, client: Client) -> None:
        self.client = client
        self.turn = threading.Lock()
        self.counts: defaultdict[int, set[int]] = defaultdict(set)  # registers asked, by device
        self.owing: set[int] = set()  # devices that may still answer an earlier request
        self._users = 0

    def enter(self) -> bool:
        """Open it for its first user; False if that cannot be done."""
        with self.turn:
            if self._users == 0 and not self.client.connect():
                _close(self.client)
                return False
            self._users += 1
            return True

    def leave(self) -> None:
        """Close it after its last user."""
        with self.turn:
            self._users -= 1
            if self._users <= 0:
                _close(self.client)


_buses: WeakValueDictionary[tuple[object, ...], Bus] = WeakValueDictionary()
"""Serial lines that are in use, by port and settings."""
_looking_up = threading.Lock()


def rtu_bus(port: str, baud: int, parity: str, stopbits: int, timeout_s: float) -> Bus:
    """The line at ``port``, which sensors with the same settings share."""
    key = (port, baud, parity, stopbits, timeout_s)
    with _looking_up:
        bus = _buses.get(key)
        if bus is None:
            bus = _buses[key] = Bus(connect_rtu(*key))
        return bus


class ModbusSource:
    """A polled map of registers; see `drivers.core.reader.Source`."""

    def __init__(
        self,
        clock: Clock,
        name: str,
        bus: Bus,
        registers: Sequence[Register],
        device_id: int,
        table: Literal["holding", "input"],
        byte_order: Order,
        period_s: float,
        latency_s: float,
    ) -> None:
        self._clock = clock
        self._name = name
        self._bus = bus
        self._client = client = bus.client
        self._serial = isinstance(client.transaction.framer, FramerRTU)  # no number of a request
        self._sent = self._heard = b""
        self._good_s = clock.now()
        self._registers = registers
        self._device_id = device_id
        self._byte_order = byte_order
        self._period_s = period_s
        self._latency_s = latency_s
        self._first = min(r.address for r in registers)
        self._count = max(r.address + r.words for r in registers) - self._first
        tables = {"holding": client.read_holding_registers, "input": client.read_input_registers}
        self._ask, self._table = tables[table], table
        self._due_s = clock.now()
        self._failed = 0
        bus.counts[device_id].add(self._count)
        if not bus.enter():
            raise DeviceAbsent(name, f"nothing to connect to at {client.comm_params.host}")

    def read(self) -> list[Sample]:
        """One poll. Raises `DeviceFault` after `MAX_FAILED` failures in a row."""
        wait_s = self._due_s - self._clock.now()
        if wait_s > 0:
            time.sleep(min(wait_s, 0.1))
            if wait_s > 0.1:
                return []
        with self._bus.turn:
            self._client.transaction.trace_packet = self._trace
            return self._poll()

    def _poll(self) -> list[Sample]:
        self._sent = self._heard = b""
        asked_s = self._clock.now()
        missed = max(math.floor((asked_s - self._due_s) / self._period_s), 0)
        self._due_s += (1 + missed) * self._period_s
        try:
            if self._owed():
                self._recover("late answers to earlier requests")
                return []
            reply = self._ask(self._first, count=self._count, device_id=self._device_id)
        except (ModbusException, OSError) as error:
            self._recover(self._no_answer(str(error)))
            return []
        if (busy := BUSY.get(getattr(reply, "exception_code", 0))) is not None:
            return self._busy(f"Modbus exception {reply.exception_code}: {busy}")
        if (why := self._wrong(reply)) is not None:
            self._recover(why)
            return []
        middle_s = (asked_s + self._clock.now()) / 2  # the device answered somewhere in between
        values = [self._value(reply.registers, register) for register in self._registers]
        if not all(map(math.isfinite, values)):
            return self._no_number(values)
        lost, self._failed = missed + self._failed, 0
        self._good_s = middle_s
        return [Sample(middle_s - self._latency_s, values, lost)]

    def _owed(self) -> bool:
        """Whether the device may still answer an earlier request, after asking it what no table
        on its line asks."""
        if self._device_id not in self._bus.owing:
            return False
        others = self._bus.counts[self._device_id]
        count = next(n for n in range(1, len(others) + 2) if n not in others)
        reply = self._ask(self._first, count=count, device_id=self._device_id)
        refused = getattr(reply, "exception_code", 0) in REFUSED
        if refused or (not reply.isError() and len(reply.registers) == count):
            self._bus.owing.discard(self._device_id)
            return False
        return True

    def _no_number(self, values: list[float]) -> list[Sample]:
        """A device that has no reading says not-a-number: the line is well, the sample lost."""
        self._failed += 1
        if self._failed >= MAX_FAILED:
            names = [r.name for r, v in zip(self._registers, values, strict=True)
                     if not math.isfinite(v)]  # fmt: skip
            raise DeviceFault(
                self._name,
                f"{', '.join(names)}: not a number, {MAX_FAILED} times in a row; are the "
                "register's type and byte_order right?",
            )
        return []

    def _busy(self, why: str) -> list[Sample]:
        """A device that is busy says so: the line is well, the sample lost."""
        self._failed += 1
        if self._failed >= MAX_FAILED and self._clock.now() - self._good_s > BUSY_S:
            raise DeviceFault(self._name, f"{self._failed} polls in a row failed: {why}")
        return []

    def close(self) -> None:
        """Leave the line."""
        self._bus.leave()

    def _trace(self, sending: bool, data: bytes) -> bytes:
        """Hook of pymodbus: what passes on the line."""
        if sending:
            self._sent = data
        else:
            self._heard += data
        return data

    def _no_answer(self, why: str) -> str:
        """What came instead of an answer, since that says what is wrong with a line."""
        if not self._heard:
            return why
        if self._heard.startswith(self._sent):
            return "what is sent comes back: switch off the adapter's echo"
        shown = self._heard[:SHOWN_BYTES].hex(" ")
        return f"{shown} is no answer: see baud, parity, device_id and the line's termination"

    def _wrong(self, reply: ModbusPDU) -> str | None:
        if reply.isError():
            code = getattr(reply, "exception_code", 0)
            if code in REFUSED:
                first, last = self._first, self._first + self._count - 1
                raise DeviceFault(
                    self._name, f"refuses registers {first} to {last} (Modbus exception {code})"
                )
            return f"Modbus exception {code}"
        if reply.function_code != FUNCTIONS[self._table]:  # an answer to somebody else
            return f"an answer of function {reply.function_code}"
        if len(reply.registers) != self._count:
            return f"{len(reply.registers)} registers instead of {self._count}"
        return None

    def _value(self, words: Sequence[int], register: Register) -> float:
        start = register.address - self._first
        own = list(words[start : start + register.words])
        if self._byte_order in ("BADC", "DCBA"):
            own = [(word & 0xFF) << 8 | word >> 8 for word in own]
        number = self._client.convert_from_registers(
            own,
            self._client.DATATYPE[register.type.upper()],
            word_order="big" if self._byte_order in ("ABCD", "BADC") else "little",
        )
        assert isinstance(number, int | float)
        if register.type.startswith("float") and 0 < abs(number) < LEAST:
            return math.nan
        return register.si_per_number * number

    def _recover(self, why: str) -> None:
        """Let a reply that may still come pass, then start afresh."""
        self._failed += 1
        if self._failed >= MAX_FAILED:
            raise DeviceFault(self._name, f"{MAX_FAILED} polls in a row failed: {why}")
        late = self._device_id in self._bus.owing
        if self._serial:
            self._bus.owing.add(self._device_id)
        if late or not self._heard:
            time.sleep(LATE_S)
        _close(self._client)
        if not self._client.connect():
            raise DeviceFault(self._name, f"connection lost ({why})")


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


def open_sensor(clock: Clock, settings: ModbusSettings) -> LineSensor:
    """A Modbus sensor, not yet connected."""
    keys = settings
    channels = tuple(r.channel() for r in keys.registers)

    def open_source() -> ModbusSource:
        timeout_s = 1e-3 * keys.timeout_ms
        if keys.host is not None:
            bus = Bus(ModbusTcpClient(keys.host, port=keys.tcp_port, timeout=timeout_s, retries=0))
        else:
            assert keys.port is not None
            bus = rtu_bus(keys.port, keys.baud, keys.parity, keys.stopbits, timeout_s)
        return ModbusSource(
            clock, keys.name, bus, keys.registers, keys.device_id, keys.table, keys.byte_order,
            1 / keys.rate_hz, 1e-3 * keys.latency_ms,
        )  # fmt: skip

    return LineSensor(
        clock, keys.name, channels, keys.rate_hz, open_source, simulated=keys.simulated
    )
