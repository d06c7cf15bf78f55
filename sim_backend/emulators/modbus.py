"""A Modbus device that answers from the phantom: RTU on a pty or socket, or TCP.

``registers`` maps an address to a function that gives the register's 16 bits now. Function codes
3 and 4 read, 16 and 6 write; anything else gets a Modbus exception.
"""

import struct
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Literal

from pymodbus.framer import FramerRTU

from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom

Registers = Mapping[int, Callable[[], int]]
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, DEVICE_FAILURE = 1, 2, 4
REQUEST_BYTES = 8  # of every request but a write of many


class ModbusSlave:
    """Bytes in, bytes out; ``written`` is called with every register written."""

    def __init__(
        self,
        registers: Registers,
        device_id: int,
        framing: Literal["rtu", "tcp"],
        written: Callable[[int, int], None] = lambda _address, _value: None,
    ) -> None:
        self.broken = False
        self._registers = registers
        self._device_id = device_id
        self._framing = framing
        self._written = written
        self._buffer = b""

    @property
    def faults(self) -> tuple[str, ...]:
        """``exception``: every request is answered by a failure of the device."""
        return ("exception",)

    def fail(self, _fault: str) -> None:
        """Begin to answer with exceptions."""
        self.broken = True

    def mend(self) -> None:
        """Answer again."""
        self.broken = False

    def due(self) -> bytes:
        """A slave speaks only when spoken to."""
        return b""

    def received(self, data: bytes) -> bytes:
        """Answers to the whole requests so far."""
        self._buffer += data
        answers = b""
        while (cut := self._cut()) is not None:
            answers += cut
        return answers

    def _cut(self) -> bytes | None:
        return self._cut_tcp() if self._framing == "tcp" else self._cut_rtu()

    def _cut_tcp(self) -> bytes | None:
        if len(self._buffer) < 7:
            return None
        number, _, length, device = struct.unpack(">HHHB", self._buffer[:7])
        if len(self._buffer) < 6 + length:
            return None
        request, self._buffer = self._buffer[7 : 6 + length], self._buffer[6 + length :]
        if device != self._device_id:
            return b""
        reply = self._answer(request)
        return struct.pack(">HHHB", number, 0, len(reply) + 1, device) + reply

    def _cut_rtu(self) -> bytes | None:
        buffer = self._buffer
        if len(buffer) < REQUEST_BYTES:
            return None
        size = 9 + buffer[6] if buffer[1] == 16 else REQUEST_BYTES
        if len(buffer) < size:
            return None
        if buffer[0] != self._device_id or _crc(buffer[: size - 2]) != buffer[size - 2 : size]:
            self._buffer = buffer[1:]
            return b""
        self._buffer = buffer[size:]
        reply = bytes([self._device_id]) + self._answer(buffer[1 : size - 2])
        return reply + _crc(reply)

    def _answer(self, request: bytes) -> bytes:
        code = request[0]
        if self.broken:
            return bytes([code | 0x80, DEVICE_FAILURE])
        address, count = struct.unpack(">HH", request[1:5])
        if code in (3, 4):
            wanted = range(address, address + count)
            if not all(a in self._registers for a in wanted):
                return bytes([code | 0x80, ILLEGAL_ADDRESS])
            words = [self._registers[a]() & 0xFFFF for a in wanted]
            return bytes([code, 2 * count]) + struct.pack(f">{count}H", *words)
        if code == 16:
            values = struct.unpack(f">{count}H", request[6 : 6 + 2 * count])
            for n, value in enumerate(values):
                self._written(address + n, value)
            return request[:5]
        if code == 6:
            self._written(address, count)
            return request[:5]
        return bytes([code | 0x80, ILLEGAL_FUNCTION])


def _crc(data: bytes) -> bytes:
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


def force_n(phantom: Phantom) -> float:
    """What the tip feels now."""
    return phantom.force_at(phantom.clock.now())


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    framing: Literal["rtu", "tcp"] = "rtu",
    address: int = 100,
    scale_n: float = 0.001,
    device_id: int = 1,
) -> AbstractContextManager[Served]:
    """Serve the normal force as an int32 of ``scale_n`` newtons at ``address``, high word first.

    Three further registers hold 0, so that a map may be wider than one value.
    """

    def word(shift: int) -> Callable[[], int]:
        return lambda: round(force_n(phantom) / scale_n) >> shift

    registers: dict[int, Callable[[], int]] = {address: word(16), address + 1: word(0)}
    registers |= {address + n: (lambda: 0) for n in (2, 3, 4)}
    return served(ModbusSlave(registers, device_id, framing), at, "modbus")
