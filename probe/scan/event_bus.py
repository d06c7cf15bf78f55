"""How a scan publishes what happens: every event goes to the sink first, then to the observers.

Readings arrive after the fact, so samples are labelled with the station they belong to by their
time, not by when they were read.
"""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import pairwise

from drivers import Block, Clock
from probe.core.events import Event, Note, RunEnded, Samples
from probe.core.log import log_event
from probe.scan.observers import Observer, ObserverThread

EventSink = Callable[[Event], None]


class EventBus:
    """``sink_error`` says why the sink gets nothing more; whoever scans must then stop.

    An observer that raises is noted and not called again. ``threaded``: observers hear of events
    in threads of their own, later; without it, when they happen, so that a run is repeatable.
    """

    def __init__(
        self, clock: Clock, sink: EventSink, observers: Sequence[EventSink], *, threaded: bool
    ) -> None:
        self.sink_error: str | None = None
        self._clock = clock
        self._sink: EventSink | None = sink
        self._observers = [ObserverThread(o) if threaded else Observer(o) for o in observers]
        self._labels: list[tuple[float, int | None, int | None]] = [(-math.inf, None, None)]

    def publish(self, event: Event) -> None:
        """One event to all; never raises."""
        if self._sink is not None:
            try:
                self._sink(event)
            except Exception as error:  # noqa: BLE001 - whatever broke, the probe must be lifted
                self._sink = None
                self.sink_error = f"the run can no longer be stored: {error}"
        for observer in self._observers:
            observer(event)
        if isinstance(event, RunEnded):  # a run's last event: `close` says the rest
            return
        for observer in self._observers:
            if (trouble := observer.trouble) is not None:
                observer.trouble = None
                self.note("warning", "observer", trouble)

    def close(self) -> None:
        """Let the observers hear the rest; what goes wrong then is logged, as the run has ended."""
        for observer in self._observers:
            observer.close()
            if observer.trouble is not None:
                log_event(Note(self._clock.now(), "warning", "observer", observer.trouble))

    def note(self, level: str, device: str, text: str) -> None:
        """Something a person should know."""
        self.publish(Note(self._clock.now(), level, device, text))

    def label(self, from_s: float, station: int | None, attempt: int | None) -> None:
        """Samples taken from ``from_s`` on belong to this attempt at this station."""
        self._labels = [*self._labels[-3:], (from_s, station, attempt)]

    def samples(self, readings: Sequence[tuple[str, Block]]) -> None:
        """Blocks of devices, cut where the station changes."""
        starts = [from_s for from_s, _, _ in self._labels]
        for device, block in readings:
            times = block.time_s
            edges = [0, *(bisect_left(times, from_s) for from_s in starts[1:]), len(times)]
            for (_, station, attempt), (a, b) in zip(self._labels, pairwise(edges), strict=True):
                if b > a:
                    self.publish(Samples(device, _part(block, a, b), station, attempt))


def _part(block: Block, first: int, end: int) -> Block:
    if end - first == len(block.time_s):
        return block
    part = slice(first, end)
    lost = block.lost if first == 0 else 0
    return Block(block.time_s[part], block.values[part], block.saturated[part], lost)
