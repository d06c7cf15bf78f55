"""A sensor that reads a known function of time, for tests of who listens."""

from collections.abc import Callable

import numpy as np

from drivers import Block, Channel, DeviceFault

FORCE = (Channel("force", "mV", "force"),)


class FunctionSensor:
    """``reading`` gives the value at times (n,); ``fails_s`` is when it is lost, ``silent_s`` when
    it falls silent."""

    name = "gauge"
    simulated = False

    def __init__(
        self,
        clock,
        reading: Callable[[np.ndarray], np.ndarray],
        rate_hz: float = 100.0,
        channels=FORCE,
        fails_s: float = np.inf,
        silent_s: float = np.inf,
    ) -> None:
        self.clock, self.reading, self.rate_hz = clock, reading, rate_hz
        self.channels = channels
        self.fails_s, self.silent_s = fails_s, silent_s
        self.running = False
        self._next = 0.0

    def connect(self) -> None: ...

    def start(self) -> None:
        self.running, self._next = True, self.clock.now()

    def read(self) -> Block:
        if self.clock.now() >= self.fails_s:
            raise DeviceFault(self.name, "unplugged")
        until = min(self.clock.now(), self.silent_s)
        count = max(round((until - self._next) * self.rate_hz), 0)
        time_s = self._next + np.arange(count) / self.rate_hz
        self._next += count / self.rate_hz
        values = np.asarray(self.reading(time_s), float).reshape(count, len(self.channels))
        return Block(time_s, values, np.abs(values) > 1e3)

    def tare(self) -> None:
        raise AssertionError("listening tares no device")

    def stop(self) -> None:
        self.running = False

    def close(self) -> None: ...
