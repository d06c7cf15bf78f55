"""The scan's clock compared with another: has the computer slept, was the clock set?"""

import time
from collections.abc import Callable

from probe.planning.limits import Limits


class ClockGuard:
    """The scan's clock against another that also runs while the computer sleeps.

    Linux stops its monotonic clock in a suspend; the one since boot goes on. Where there is no
    such clock, ``other`` is the monotonic one and only a clock that is set is noticed.
    """

    def __init__(
        self, limits: Limits, now: Callable[[], float], other: Callable[[], float] | None = None
    ) -> None:
        self._now, self._other = now, other or _since_boot
        self._lag_s = self._now() - self._other()
        self._limit_s = limits.clock_jump_s

    def check(self) -> str | None:
        """Why the clock cannot be trusted."""
        lag_s = self._now() - self._other()
        jump_s, self._lag_s = lag_s - self._lag_s, lag_s
        if jump_s < -self._limit_s:
            return f"the clock stood for {-jump_s:.3f} s: the computer slept, or it was set"
        if jump_s > self._limit_s:
            return f"the clock jumped by {jump_s:+.3f} s"
        return None


def _since_boot() -> float:
    """Seconds since boot, those asleep included where the system counts those."""
    number = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if number is None else time.clock_gettime(number)
