"""Open a serial port, a pty or a TCP bridge to one, and say in words why that cannot be done."""

import re
import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Annotated, Protocol

import serial
from pydantic import AfterValidator
from serial.tools import list_ports

from drivers.core.errors import DeviceAbsent

READ_S = 0.02  # a read returns after this long at the latest, so that its thread can be ended
WRITE_S = 0.5
SOCKET = "socket://"
HOST_AND_PORT = re.compile(r"[\w.-]+:\d+")
CHUNK = 4096
HIGHEST_TCP_PORT = 65535


class Port(Protocol):
    """What is used of pyserial's ports, real or over TCP."""

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def write(self, data: bytes, /) -> int | None: ...
    def reset_input_buffer(self) -> None: ...
    def close(self) -> None: ...


class TcpPort:
    """``socket://host:port`` read and written like a serial port.

    pyserial's own reads one byte at a time and leaves the socket of a lost line open.
    """

    def __init__(self, url: str) -> None:
        self._socket = socket.create_connection(tcp_address(url), timeout=WRITE_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def in_waiting(self) -> int:
        return CHUNK if select.select([self._socket], [], [], 0)[0] else 0

    def read(self, size: int = 1, /) -> bytes:
        """Up to ``size`` bytes, none after `READ_S`. Raises `OSError` when the peer has left."""
        if not select.select([self._socket], [], [], READ_S)[0]:
            return b""
        if not (data := self._socket.recv(size)):
            raise ConnectionResetError("closed by the other side")
        return data

    def write(self, data: bytes, /) -> int:
        """Send all of it."""
        self._socket.sendall(data)
        return len(data)

    def reset_input_buffer(self) -> None:
        """Forget what has arrived."""
        while self.in_waiting:
            self.read(CHUNK)

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class SerialPort:
    """A port of pyserial whose every failure is an `OSError`.

    Of a device that was just unplugged, termios raises an error of its own, which is none.
    """

    def __init__(self, port: serial.SerialBase) -> None:
        self._port = port

    @property
    def in_waiting(self) -> int:
        with _as_os_error():
            return int(self._port.in_waiting)  # type: ignore[attr-defined]  # left out of its stubs

    def read(self, size: int = 1, /) -> bytes:
        """Up to ``size`` bytes, none after `READ_S`. Raises `OSError` when the line is gone."""
        with _as_os_error():
            return bytes(self._port.read(size))

    def write(self, data: bytes, /) -> int | None:
        """Send. Raises `OSError` when the line is gone."""
        with _as_os_error():
            return self._port.write(data)

    def reset_input_buffer(self) -> None:
        """Forget what has arrived. Raises `OSError` when the line is gone."""
        with _as_os_error():
            self._port.reset_input_buffer()  # type: ignore[attr-defined]  # left out of its stubs

    def close(self) -> None:
        """Release the port."""
        with suppress(OSError), _as_os_error():
            self._port.close()


@contextmanager
def _as_os_error() -> Iterator[None]:
    """termios' error as an `OSError`; there is none on Windows."""
    try:
        yield
    except Exception as error:
        if type(error).__module__ == "termios":
            raise OSError(*error.args) from None
        raise


def tcp_address(url: str) -> tuple[str, int]:
    """Host and port of ``socket://host:port``. Raises `ValueError`."""
    host, _, port = url.removeprefix(SOCKET).rpartition(":")
    if not host or not port.isdigit() or not 1 <= int(port) <= HIGHEST_TCP_PORT:
        raise ValueError(f"must be socket://host:port, with a port of 1 to {HIGHEST_TCP_PORT}")
    return host, int(port)


def _port_name(port: str) -> str:
    """As it was written. Raises `ValueError` for what can be no port on any machine."""
    if port.startswith(SOCKET):
        tcp_address(port)
    elif not port.strip():
        raise ValueError(f"must be a path such as /dev/ttyUSB0, COM3, or {SOCKET}host:port")
    return port


PortName = Annotated[str, AfterValidator(_port_name)]
"""A port as a rig file gives it; whether there is one shows when it is opened."""


def nobody_else(port: str) -> str:
    """What else may be where nothing answers: an address can be opened twice, a port cannot."""
    return "; or another program is connected to it: end that first" if "://" in port else ""


def open_port(device: str, port: str, baud: int) -> Port:
    """The open port; ``port`` is a path, ``COM3`` (untested) or ``socket://host:port``.

    A character has 8 bits, no parity and one stop bit.

    A serial port is this program's alone: two that command one stage would move it unasked.

    Raises `DeviceAbsent` for ``device`` with the reason and, if it helps, the ports there are.
    """
    try:
        if port.startswith(SOCKET):
            return TcpPort(port)
        opened = serial.serial_for_url(
            port,
            baud,
            timeout=READ_S,
            write_timeout=WRITE_S,
            exclusive=True,
        )
        return SerialPort(opened)
    except (serial.SerialException, OSError, ValueError) as error:
        raise DeviceAbsent(device, f"port = {port!r}: {_why(error, port)}") from None


def read_some(line: Port) -> bytes:
    """What has arrived, after at most `READ_S`. Raises `OSError` if the line is gone."""
    return line.read(max(1, min(line.in_waiting, CHUNK)))


def _why(error: Exception, port: str) -> str:
    text = re.sub(r"\[Errno -?\d+\] ", "", str(error))
    if "Permission denied" in text:
        return "no permission; add yourself to the group that owns it (`dialout` on Debian)"
    if "exclusively lock" in text:
        return "another program has it open; close that first"
    if ("No such file" in text or "could not open" in text) and HOST_AND_PORT.fullmatch(port):
        return f"no such port; for a device on the network write {SOCKET}{port}"
    if "No such file" in text or "could not open" in text:
        there = ", ".join(sorted(found.device for found in list_ports.comports()))
        return f"no such port; serial ports here: {there or 'none'}"
    return text
