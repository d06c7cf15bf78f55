"""What a device was sent and what it answered, byte by byte, as a file; and that file replayed.

A file is TOML: the driver and its settings, what was read, and ``pairs`` of [sent, received].
Bytes are written as the characters of the same number, so that text stays readable. A pair with
nothing sent is what the device said by itself at first.
"""

import socket
import threading
import time
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from drivers.core.errors import ConfigError
from drivers.core.registry import Kind

Pair = tuple[bytes, bytes]
CHUNK, PACE_S = 64, 0.005  # a replay is about as fast as 115200 baud


@dataclass(frozen=True)
class Exchange:
    """A recorded conversation.

    ``rows``: the values (sensor) or poses (stage) read meanwhile, in SI. ``move_m``: how far a
    stage was moved along z and back, 0 if it was not.
    """

    kind: Kind
    driver: str
    settings: Mapping[str, Any]
    device: str
    recorded: str
    pairs: tuple[Pair, ...]
    rows: tuple[tuple[float, ...], ...] = field(default_factory=tuple)
    move_m: float = 0.0


def save(exchange: Exchange, path: Path) -> None:
    """Write the file."""
    table = {
        "kind": exchange.kind,
        "driver": exchange.driver,
        "device": exchange.device,
        "recorded": exchange.recorded,
        "move_m": exchange.move_m,
        "pairs": [[part.decode("latin-1") for part in pair] for pair in exchange.pairs],
        "rows": exchange.rows,
        "settings": dict(exchange.settings),
    }
    path.write_text(tomli_w.dumps(table), encoding="utf-8", newline="")


def load(path: Path) -> Exchange:
    """Read a file. Raises `ConfigError`."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        pairs = tuple((a.encode("latin-1"), b.encode("latin-1")) for a, b in table.pop("pairs"))
        rows = tuple(tuple(float(v) for v in row) for row in table.pop("rows"))
        return Exchange(pairs=pairs, rows=rows, **table)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: not an exchange file ({error})") from None


class Replay:
    """The device of an exchange, on ``socket://127.0.0.1:port``.

    It answers as it did then. Pairs are taken in order; one that was sent several times (a poll)
    may be skipped, or asked for again. ``unexpected`` holds what the device never heard.
    """

    def __init__(self, exchange: Exchange) -> None:
        self.unexpected = b""
        self._pairs = exchange.pairs
        sent = [a for a, _ in self._pairs]
        self._polls = {a for a in sent if sent.count(a) > 1}
        self._known = sorted({a for a in sent if a}, key=len, reverse=True)
        self._next = 0
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(0.05)
        self.port: int = self._server.getsockname()[1]
        self.address = f"socket://127.0.0.1:{self.port}"
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="replayed device", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._end.set()
        self._thread.join(timeout=5.0)
        self._server.close()

    def answer(self, sent: bytes) -> bytes | None:
        """What the device answered to exactly these bytes; None if it never heard them now."""
        for n in range(self._next, len(self._pairs)):
            if self._pairs[n][0] == sent:
                self._next = n + 1
                return self._pairs[n][1]
            if self._pairs[n][0] not in self._polls:
                break
        for before in reversed(self._pairs[: self._next]):
            if before[0] == sent:
                return before[1]
        return None

    def _serve(self) -> None:
        while not self._end.is_set():
            try:
                client, _ = self._server.accept()
            except TimeoutError:
                continue
            with client:
                client.settimeout(0.02)
                self._next = 0
                try:
                    self._talk(client)
                except ConnectionError:
                    continue

    def _talk(self, client: socket.socket) -> None:
        heard = b""
        if self._pairs and not self._pairs[0][0]:
            self._next = 1
            self._say(client, self._pairs[0][1])
        while not self._end.is_set():
            try:
                data = client.recv(4096)
            except TimeoutError:
                continue
            if not data:
                return
            heard += data
            while heard and (cut := self._cut(heard)) is not None:
                reply = self.answer(cut)
                if reply is None:
                    self.unexpected += cut
                heard = heard[len(cut) :]
                self._say(client, reply or b"")

    def _cut(self, heard: bytes) -> bytes | None:
        """The longest known message at the start, one unknown byte, or None: wait for more."""
        for known in self._known:
            if heard.startswith(known):
                return known
        return None if any(known.startswith(heard) for known in self._known) else heard[:1]

    def _say(self, client: socket.socket, reply: bytes) -> None:
        for start in range(0, len(reply), CHUNK):
            client.sendall(reply[start : start + CHUNK])
            time.sleep(PACE_S)


@contextmanager
def replay(exchange: Exchange) -> Iterator[Replay]:
    """Serve the device of an exchange."""
    served = Replay(exchange)
    try:
        yield served
    finally:
        served.close()
