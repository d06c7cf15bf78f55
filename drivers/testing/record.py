"""Record what a live device is sent and what it answers: the start of a test without the device.

The driver talks to the device through a relay that writes down every byte, so any driver with a
``port`` or with ``host`` and ``tcp_port`` can be recorded.
"""

import socket
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any

from drivers.core import abilities
from drivers.core.clocks import WallClock
from drivers.core.errors import ConfigError, DeviceFault
from drivers.core.ports import CHUNK, Port, open_port, read_some
from drivers.core.protocols import Sensor, Stage
from drivers.core.registry import Kind, find_driver, open_driver, settings_of
from drivers.testing.exchange import Exchange, Pair

MAX_ROWS = 500
SPEED_M_S = 2e-3


class Relay:
    """Between a driver and a device; ``pairs`` is what went through."""

    def __init__(self, upstream: Port) -> None:
        self.pairs: list[Pair] = []
        self._upstream = upstream
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.05)
        self.port: int = self._server.getsockname()[1]
        self.address = f"socket://127.0.0.1:{self.port}"
        self._client: socket.socket | None = None
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._threads = [
            threading.Thread(target=run, name="palpate relay", daemon=True)
            for run in (self._down, self._up)
        ]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """End it and close the device's port."""
        self._end.set()
        for thread in self._threads:
            thread.join(timeout=2.0)
        self._server.close()
        self._upstream.close()

    def _down(self) -> None:
        """From the driver to the device."""
        while not self._end.is_set():
            with suppress(TimeoutError):
                client, _ = self._server.accept()
                with client:
                    client.settimeout(0.05)
                    self._client = client
                    with suppress(ConnectionError):
                        self._pass_on(client)
                    self._client = None

    def _pass_on(self, client: socket.socket) -> None:
        while not self._end.is_set():
            try:
                data = client.recv(CHUNK)
            except TimeoutError:
                continue
            if not data:
                return
            with self._lock:
                self.pairs.append((data, b""))
            self._upstream.write(data)

    def _up(self) -> None:
        """From the device to the driver; ends with the line, which the driver then sees."""
        with suppress(OSError):
            while not self._end.is_set():
                if data := read_some(self._upstream):
                    self._note(data)
                    if (client := self._client) is not None:
                        client.sendall(data)
        if not self._end.is_set() and (client := self._client) is not None:
            client.close()

    def _note(self, data: bytes) -> None:
        with self._lock:
            sent, received = self.pairs.pop() if self.pairs else (b"", b"")
            self.pairs.append((sent, received + data))


def record(
    kind: Kind,
    driver: str,
    settings: Mapping[str, Any],
    *,
    seconds: float = 2.0,
    move_mm: float = 0.0,
    device: str = "",
    baud: int | None = None,
) -> Exchange:
    """Connect a device, read it for a while, move a stage ``move_mm`` up and back, and close.

    ``device`` says in words what it is. Raises `ConfigError`, `DeviceFault`.
    """
    keys = settings_of(kind, driver).model_fields
    wanted = baud or settings.get("baud") or _baud_of(kind, driver)
    if "port" in settings:
        relay = Relay(open_port(driver, settings["port"], wanted))
        through = {**settings, "port": relay.address}
    elif "host" in settings and "tcp_port" in keys:
        place = f"socket://{settings['host']}:{settings.get('tcp_port', 502)}"
        relay = Relay(open_port(driver, place, wanted))
        through = {**settings, "host": "127.0.0.1", "tcp_port": relay.port}
    else:
        raise ConfigError(
            f"driver = {driver!r}: only lines (port, or host and tcp_port) are recorded"
        )
    try:
        rows = exercise(kind, driver, through, seconds, 1e-3 * move_mm)
    finally:
        relay.close()
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return Exchange(
        kind, driver, dict(settings), device, now, _parted(relay.pairs), rows, 1e-3 * move_mm
    )


def exercise(
    kind: Kind,
    driver: str,
    settings: Mapping[str, Any],
    seconds: float,
    move_m: float,
) -> tuple[tuple[float, ...], ...]:
    """What is done with a device while it is recorded, and again at a replay; what was read."""
    made = open_driver(kind, driver, WallClock(), settings)
    try:
        made.connect()
        rows = _ride(made, move_m) if kind == "stages" else _listen(made, seconds)
    finally:
        made.close()
    return rows


def _ride(stage: Stage, move_m: float) -> tuple[tuple[float, ...], ...]:
    if move_m and abilities.homes(stage):
        stage.home()  # type: ignore[attr-defined]  # as `Stage` says
    here = stage.pose()
    rows = [tuple(here)]
    for target in (here._replace(z=here.z + move_m), here) if move_m else ():
        stage.move(target, SPEED_M_S)
        end = time.monotonic() + 2 * abs(move_m) / SPEED_M_S + 2.0
        while stage.moving():
            if time.monotonic() > end:
                raise DeviceFault(stage.name, "has not arrived")
            time.sleep(0.02)
        rows.append(tuple(stage.pose()))
    return tuple(rows)


def _listen(sensor: Sensor, seconds: float) -> tuple[tuple[float, ...], ...]:
    sensor.start()
    rows: list[tuple[float, ...]] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end and len(rows) < MAX_ROWS:
        rows += [tuple(row) for row in sensor.read().values.tolist()]
        time.sleep(0.02)
    return tuple(rows)


def _parted(pairs: list[Pair]) -> tuple[Pair, ...]:
    """Polls that were caught together with another message, cut off from it."""
    sent = [a for a, _ in pairs if a]
    polls = {a for a in sent if sent.count(a) > 2}
    parted: list[Pair] = []
    for message, received in pairs:
        rest = message
        while rest not in polls and (
            poll := next((p for p in polls if rest.startswith(p) and rest != p), None)
        ):
            parted.append((poll, b""))
            rest = rest[len(poll) :]
        parted.append((rest, received))
    return tuple(parted)


def _baud_of(kind: Kind, driver: str) -> int:
    """The driver's default, or its module's ``BAUD``."""
    key = settings_of(kind, driver).model_fields.get("baud")
    if key is not None and isinstance(key.default, int):
        return key.default
    return int(getattr(sys.modules[find_driver(kind, driver).__module__], "BAUD", 115200))
