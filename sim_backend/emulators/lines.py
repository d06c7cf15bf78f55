"""A load cell that prints a line of text per reading, as a microcontroller's sketch does."""

from contextlib import AbstractContextManager

import numpy as np

from sim_backend.emulators.serving import Served, served
from sim_backend.phantom.phantom import Phantom


class LoadCell:
    """Prints ``MILLISECONDS FORCE N``, ``rate_hz`` times a second; 0 waits for a ``?`` instead."""

    def __init__(self, phantom: Phantom, rate_hz: float, noise_n: float, seed: int) -> None:
        self._phantom = phantom
        self._period_s = 1 / rate_hz if rate_hz else np.inf
        self._noise_n = self._usual_noise_n = noise_n
        self._rng = np.random.default_rng(seed)
        self._start_s = phantom.clock.now()
        self._next_s = self._start_s + self._period_s

    @property
    def faults(self) -> tuple[str, ...]:
        """``nan``: it prints "nan" in place of a number; ``restart``: its clock starts anew."""
        return ("nan", "restart")

    def fail(self, fault: str) -> None:
        """Begin a fault."""
        if fault == "nan":
            self._noise_n = np.nan
        else:
            self._start_s = self._phantom.clock.now()

    def mend(self) -> None:
        """Print numbers again."""
        self._noise_n = self._usual_noise_n

    def received(self, data: bytes) -> bytes:
        """One line per ``?``."""
        return self._line(self._phantom.clock.now()) * data.count(b"?")

    def due(self) -> bytes:
        """The lines that are due."""
        now, lines = self._phantom.clock.now(), b""
        while self._next_s <= now:
            lines += self._line(self._next_s)
            self._next_s += self._period_s
        return lines

    def _line(self, time_s: float) -> bytes:
        force = self._phantom.force_at(time_s)
        force += self._noise_n * self._rng.standard_normal()
        return f"{1e3 * (time_s - self._start_s):.0f} {force:.4f} N\r\n".encode()


def emulate(
    phantom: Phantom,
    *,
    at: str = "pty",
    rate_hz: float = 80.0,
    noise_n: float = 0.002,
    seed: int = 0,
) -> AbstractContextManager[Served]:
    """Serve a load cell; 80 lines a second is an HX711 amplifier's fast rate."""
    return served(LoadCell(phantom, rate_hz, noise_n, seed), at, "lines")
