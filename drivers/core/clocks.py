"""Clocks: the wall clock, and a simulated one that takes no time."""

import threading
import time


class WallClock:
    """Monotonic seconds, ``start_s`` when the clock is made.

    Examples
    --------
    >>> import palpate
    >>> clock = palpate.WallClock(start_s=5.0)
    >>> clock.sleep_until(5.01)
    >>> clock.now() >= 5.01
    True
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._zero = time.monotonic() - start_s

    def now(self) -> float:
        """Seconds on this clock; not moved by steps of the system's time."""
        return time.monotonic() - self._zero

    def sleep_until(self, time_s: float) -> None:
        """Sleep until ``now() >= time_s``."""
        while (left := time_s - self.now()) > 0:
            time.sleep(left)


class SimulatedClock:
    """Time that passes only when someone sleeps; exactly repeatable.

    Examples
    --------
    >>> import palpate
    >>> clock = palpate.SimulatedClock()
    >>> clock.sleep_until(3600.0)
    >>> clock.now()
    3600.0
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s
        self._lock = threading.Lock()

    def now(self) -> float:
        """Seconds slept so far."""
        return self._now

    def sleep_until(self, time_s: float) -> None:
        """Jump to ``time_s`` (never back)."""
        with self._lock:
            self._now = max(self._now, time_s)
