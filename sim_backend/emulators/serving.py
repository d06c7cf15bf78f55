"""Serve an emulated device on a pty or a loopback socket, with a line that fails on command."""

import os
import select
import socket
import sys
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from ipaddress import ip_address
from pathlib import Path
from typing import Protocol

import numpy as np

from drivers.core.errors import ConfigError

TICK_S = 0.001
LATE_S = 0.4
LINE_FAULTS = ("silence", "drop", "garbage", "bad crc", "noise", "late", "seven bits")
SEVEN_BITS = bytes(value & 0x7F for value in range(256))  # a bridge that drops the eighth


class Device(Protocol):
    """An emulated device: bytes in, bytes out. Called by one thread.

    One whose faults last has ``mend()``, which ends them; others need what a real one needs.
    """

    @property
    def faults(self) -> tuple[str, ...]: ...

    def received(self, data: bytes) -> bytes:
        """The answer to bytes that came in."""
        ...

    def due(self) -> bytes:
        """What the device has to say by itself now."""
        ...

    def fail(self, fault: str) -> None:
        """Begin one of ``faults``."""
        ...


class Line(Protocol):
    """One end of a line; ``read`` waits `TICK_S` at most."""

    address: str

    def read(self) -> bytes: ...
    def write(self, data: bytes) -> None: ...
    def drop(self) -> None: ...
    def close(self) -> None: ...


class PtyLine:
    """A pseudo-terminal; ``at`` is a path for a link to it, or "pty" for none."""

    def __init__(self, at: str) -> None:
        self._link = None if at == "pty" else Path(at)
        self._master = self._slave = -1
        self._open()
        self.address = str(self._link or self._name)

    def read(self) -> bytes:
        """What the client wrote."""
        if self._master < 0:
            self._open()
        if select.select([self._master], [], [], TICK_S)[0]:
            return os.read(self._master, 4096)
        return b""

    def write(self, data: bytes) -> None:
        """A client that does not read loses what no longer fits, as on a wire."""
        if self._master >= 0 and select.select([], [self._master], [], 0)[1]:
            os.write(self._master, data)

    def drop(self) -> None:
        """Vanish, as if unplugged."""
        for end in (self._master, self._slave):
            if end >= 0:
                os.close(end)
        self._master = self._slave = -1

    def close(self) -> None:
        """Vanish for good."""
        self.drop()
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def _open(self) -> None:
        # The slave end stays open here, so that a client may come and go.
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._name = os.ttyname(self._slave)
        if self._link is not None:
            if self._link.is_symlink():
                self._link.unlink()
            self._link.symlink_to(self._name)


def on_this_machine(host: str) -> str:
    """A loopback address. Raises `ConfigError` for any other.

    What is emulated has no password and obeys whoever connects.
    """
    with suppress(ValueError):
        if host == "localhost" or ip_address(host).is_loopback:
            return host
    raise ConfigError(f"address {host!r}: an emulated device is served on 127.0.0.1 only")


class TcpLine:
    """A server on ``socket://127.0.0.1:port`` (0: any free port) for one client at a time."""

    def __init__(self, at: str) -> None:
        host, _, port = at.removeprefix("socket://").rpartition(":")
        if not port.isdigit() or int(port) > 65535:
            raise ConfigError(f"address {at!r}: socket://127.0.0.1:PORT is needed")
        self._server = socket.create_server((on_this_machine(host), int(port)))
        self._client: socket.socket | None = None
        self.address = f"socket://{host}:{self._server.getsockname()[1]}"

    def read(self) -> bytes:
        """What the client sent."""
        if self._client is None:
            if select.select([self._server], [], [], TICK_S)[0]:
                self._client, _ = self._server.accept()
                self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return b""
        if not select.select([self._client], [], [], TICK_S)[0]:
            return b""
        try:
            data = self._client.recv(4096)
        except OSError:
            data = b""
        if not data:
            self.drop()
        return data

    def write(self, data: bytes) -> None:
        """Send, if there is a client."""
        if self._client is not None:
            try:
                self._client.sendall(data)
            except OSError:
                self.drop()

    def drop(self) -> None:
        """Close the connection."""
        if self._client is not None:
            self._client.close()
        self._client = None

    def close(self) -> None:
        """Close everything."""
        self.drop()
        self._server.close()


class Served:
    """A running emulator. ``address`` is what a rig file gives as ``port``.

    ``spoilt`` counts the answers that the fault ``noise`` has damaged.
    """

    def __init__(self, device: Device, line: Line, name: str, seed: int = 0) -> None:
        self.address = line.address
        self.spoilt = 0
        self.faults = (*LINE_FAULTS, *device.faults)
        self._name, self._device, self._line = name, device, line
        self._fault: str | None = None
        self._held: list[tuple[float, bytes]] = []
        self._rng = np.random.default_rng(seed)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"emulated {name}", daemon=True)
        self._thread.start()

    def fail(self, fault: str | None) -> None:
        """Begin a fault of ``faults``; None: mend line and device. Raises `ValueError`."""
        if fault is not None and fault not in self.faults:
            raise ValueError(f"fault {fault!r}: known are {', '.join(self.faults)}")
        if fault in self._device.faults:
            self._device.fail(fault)
        else:
            self._fault = fault
        if fault is None and (mend := getattr(self._device, "mend", None)) is not None:
            mend()

    def close(self) -> None:
        """End the thread and the line."""
        self._end.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        try:
            while not self._end.is_set():
                self._step()
        except RuntimeError as error:  # what it is to feel cannot be solved, and is not made up
            print(f"{self._name}: its line is closed: {error}", file=sys.stderr)
        finally:
            self._line.close()

    def _step(self) -> None:
        if self._fault == "drop":
            self._line.drop()
            self._device.due()  # it goes on with what it has
            self._end.wait(TICK_S)
            return
        data = self._line.read()
        if self._fault == "seven bits":
            data = data.translate(SEVEN_BITS)
        answer = (self._device.received(data) if data else b"") + self._device.due()
        now = time.monotonic()
        if answer:
            late_s = LATE_S if self._fault == "late" else 0.0
            self._held.append((now + late_s, self._spoilt(answer)))
        while self._held and self._held[0][0] <= now:
            self._line.write(self._held.pop(0)[1])

    def _spoilt(self, answer: bytes) -> bytes:
        match self._fault:
            case "silence":
                return b""
            case "garbage":
                return self._rng.bytes(len(answer))
            case "bad crc":
                last = len(answer) - 1
                return bytes(
                    b ^ 0x55 if n % 8 == 7 or n == last else b for n, b in enumerate(answer)
                )
            case "noise":
                self.spoilt += 1
                return damaged(answer, self._rng)
            case "seven bits":
                return answer.translate(SEVEN_BITS)
        return answer


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """``data`` with one random damage: a byte changed, lost, added, doubled, or a burst."""
    at = int(rng.integers(len(data)))
    match rng.integers(6):
        case 0:
            return data[:at] + bytes([data[at] ^ int(rng.integers(1, 256))]) + data[at + 1 :]
        case 1:
            return data[:at] + data[at + 1 :]
        case 2:
            return data[:at] + rng.bytes(1) + data[at:]
        case 3:
            return data[: at + 1] + data[at:]
        case 4:
            return data[:at] + data[at + int(rng.integers(1, 8)) :]
        case _:
            burst = rng.bytes(int(rng.integers(1, 5)))
            return data[:at] + burst + data[at + len(burst) :]


@contextmanager
def served(device: Device, at: str, name: str) -> Iterator[Served]:
    """Serve a device on "pty", a path for a link to a pty, or ``socket://127.0.0.1:port``."""
    line: Line = TcpLine(at) if at.startswith("socket://") else PtyLine(at)
    running = Served(device, line, name)
    try:
        yield running
    finally:
        running.close()
