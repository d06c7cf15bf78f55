"""Frames in a stream of bytes: a header, numbers, and a check sum over all before it."""

import struct
from collections.abc import Callable
from typing import Literal

from pymodbus.framer import FramerRTU

Check = Literal["none", "sum8", "crc16-modbus", "crc16-x25"]


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
    """Cuts a byte stream into frames of ``layout`` between ``header`` and check sum.

    What is not a frame is skipped and counted.
    """

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
