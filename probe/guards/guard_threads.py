"""The guards' threads: each repeats one step, and each one's heartbeat is seen by the others."""

import os
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress

# A busy Python thread may keep the interpreter this long before a guard gets it. Python's own 5 ms
# are 2.5 samples at 500 Hz (measured: benchmarks/guards.py at c51866cd).
GIL_SWITCH_INTERVAL_S = 0.2e-3


class GuardThreads:
    """Steps that are repeated, each in a thread of its own, until `finish`.

    ``beaten(name)`` is called by a thread after each of its steps. What a step raises ends its
    thread, so a step catches what it can.
    """

    def __init__(self, beaten: Callable[[str], None]) -> None:
        self._beaten = beaten
        self._beats: dict[str, float] = {}
        self._threads: list[threading.Thread] = []
        self._end = threading.Event()
        self._switch_s = sys.getswitchinterval()

    @property
    def running(self) -> bool:
        """Begun, and not finished."""
        return bool(self._threads) and not self._end.is_set()

    def run(self, name: str, step: Callable[[], None], period_s: float) -> None:
        """Begin to repeat a step."""
        if not self._threads:
            sys.setswitchinterval(GIL_SWITCH_INTERVAL_S)
        self._beats[name] = time.monotonic()
        thread = threading.Thread(
            target=self._repeat, args=(name, step, period_s), name=f"palpate {name}", daemon=True
        )
        self._threads.append(thread)
        thread.start()

    def finish(self) -> None:
        """End all threads; one that hangs is left."""
        self._end.set()
        for thread in self._threads:
            thread.join(timeout=1.0)
        if self._threads:
            sys.setswitchinterval(self._switch_s)

    def late_s(self, name: str) -> float:
        """How long ago a thread beat last; minus infinity for one that never began."""
        return time.monotonic() - self._beats.get(name, float("inf"))

    def latest_s(self) -> float:
        """How long ago the one beat last that did so longest ago."""
        return time.monotonic() - min(self._beats.values())

    def excuse(self) -> None:
        """After a pause of the whole program: all beat now."""
        self._beats = dict.fromkeys(self._beats, time.monotonic())

    def _repeat(self, name: str, step: Callable[[], None], period_s: float) -> None:
        come_first()
        while not self._end.wait(period_s):
            step()
            self._beats[name] = time.monotonic()
            self._beaten(name)


def come_first() -> None:
    """Let this thread, and those it begins, run before all others, where the system permits it."""
    with suppress(AttributeError, OSError):  # Linux only; root, or a limit on `rtprio`
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
