"""An emulated gauge on the bench: the contract is tested without the device, plug pulled too."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from drivers.testing.contract import Bench
from sim_backend.emulators.serving import served

RATE_HZ = 100.0


class Emulated:
    """Streams what the gauge streams."""

    faults = ()

    def __init__(self) -> None:
        self.began_s = time.monotonic()
        self.sent = 0

    def received(self, _data: bytes) -> bytes:
        """The gauge does not listen."""
        return b""

    def due(self) -> bytes:
        """Every line whose time has come since the last call."""
        lines = b""
        while self.sent / RATE_HZ < time.monotonic() - self.began_s:
            body = b"%d %+.4f" % (1000 * self.sent / RATE_HZ, 0.1234)
            lines += body + b"*%02X\n" % (sum(body) % 256)
            self.sent += 1
        return lines

    def fail(self, fault: str | None) -> None:
        """No faults of its own; `served` knows how to drop a line."""


@contextmanager
def bench() -> Iterator[Bench]:
    """The served gauge, with the keys of the rig file and how to pull its plug."""
    with served(Emulated(), "socket://127.0.0.1:0", "my_gauge") as device:
        unplug, replug = partial(device.fail, "drop"), partial(device.fail, None)
        yield Bench("my_gauge", {"port": device.address}, unplug, replug)
