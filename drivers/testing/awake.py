"""Time that counts only while this machine keeps up: upper limits of tests that run beside others.

A thread asks to be woken every `TICK_S`. What passes beyond `LATE_TICKS` of them until it is woken
was taken by other programs, or by whoever holds the interpreter, and counts for nobody.
"""

import threading
import time
from types import TracebackType

TICK_S = 0.005
LATE_TICKS = 2


class AwakeTime:
    """A stopwatch, running inside ``with``."""

    def __init__(self) -> None:
        self._awake_s = 0.0
        self._seen_s = 0.0
        self._end = threading.Event()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def now(self) -> float:
        """Seconds lived through since an arbitrary zero."""
        with self._lock:
            now_s = time.monotonic()
            self._awake_s += min(now_s - self._seen_s, LATE_TICKS * TICK_S)
            self._seen_s = now_s
            return self._awake_s

    def __enter__(self) -> "AwakeTime":
        self._end.clear()
        self._seen_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, name="awake time", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        _type: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._end.set()
        assert self._thread is not None
        self._thread.join()

    def _run(self) -> None:
        while not self._end.wait(TICK_S):
            self.now()
