"""Who watches a scan: each in a thread of its own, so that a slow one delays nothing.

An observer that hung the engine would hang the readings with it, and what is read would be
committed late: 1.6 s late, when one was measured.
"""

import threading
from collections.abc import Callable
from queue import SimpleQueue

from probe.core.events import Event, Samples

MAX_WAITING = 4000  # events that wait for one observer: more than a minute of a scan
CLOSE_S = 2.0


class Observer:
    """One observer; ``trouble`` says what it raised, or that it does not keep up. Never raises."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        self.trouble: str | None = None
        self._publish = publish
        self._ended = self._behind = False

    def __call__(self, event: Event) -> None:
        """Publish it now."""
        if self._ended:
            return
        try:
            self._publish(event)
        except Exception as error:  # noqa: BLE001 - a viewer's bug must not end a scan
            self._ended = True
            self.trouble = f"{type(error).__name__}: {error}"

    def close(self) -> None:
        """There is nothing more to publish."""


class ObserverThread(Observer):
    """The same, later: samples that it cannot keep up with are left out for it alone."""

    def __init__(self, publish: Callable[[Event], None]) -> None:
        super().__init__(publish)
        self._waiting: SimpleQueue[Event | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="palpate observer", daemon=True)
        self._thread.start()

    def __call__(self, event: Event) -> None:
        """Publish it soon."""
        if isinstance(event, Samples) and self._waiting.qsize() > MAX_WAITING:
            if not self._behind:
                self._behind = True
                self.trouble = "an observer does not keep up with the scan; it misses samples"
            return
        self._waiting.put(event)

    def close(self) -> None:
        """Let it hear the rest, unless it hangs."""
        self._waiting.put(None)
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        while (event := self._waiting.get()) is not None:
            super().__call__(event)
