"""Progress of a scan in words, for the command and for notebooks."""

import time
from collections.abc import Callable

from probe.core.events import Event, RunEnded, RunStarted, StationEnded, StationStarted
from probe.core.places import place_words, plans_rows, presses_all
from sim_backend import notebook_line


class StationCount:
    """Counts the stations of a scan and measures how long one takes.

    ``total`` stations, of which ``done`` are complete already.
    """

    def __init__(self, total: int, done: int = 0) -> None:
        self.done = done
        self._total = total
        self._each_s: float | None = None
        self._measured = 0
        self._in_grid = False
        self._at_most = ""
        self._began_s: float | None = None

    def started(self, run: RunStarted) -> None:
        """The run begins: a grid's stations are named by x and y; a planner may leave out some."""
        self._in_grid = plans_rows(run.config)
        self._at_most = "" if presses_all(run.config) else "at most "

    def ended(self) -> None:
        """A station is complete."""
        self.done += 1
        self._measured += 1
        assert self._began_s is not None, "a station ends that has begun"
        self._each_s = (time.monotonic() - self._began_s) / self._measured

    def begun(self, station: StationStarted) -> str:
        """A station begins: which, of how many, and where. Where only some stations are pressed,
        its number is not its place among them.

        Stations are timed from the first of them: homing and what a simulation solves come before.
        """
        if self._began_s is None:
            self._began_s = time.monotonic()
        place = place_words(station.x_m, station.y_m, in_grid=self._in_grid)
        number, nth = station.station + 1, self.done + 1
        which = f"station {number}" if number == nth else f"station {number}, {nth}"
        return f"{which} of {self._at_most}{self._total}, {place}"

    def left(self) -> str:
        """The time that the rest will take; empty while nothing is known of it."""
        if self._each_s is None:
            return ""
        left_s = round(self._each_s * (self._total - self.done))
        if left_s > 99:
            return f"{self._at_most or 'about '}{left_s // 60} min {left_s % 60} s left"
        return f"{self._at_most}{left_s} s left"


def stations_said(count: StationCount, say: Callable[[str], object]) -> Callable[[Event], None]:
    """An observer that says each station as it begins, and the time left."""

    def show(event: Event) -> None:
        match event:
            case RunStarted():
                count.started(event)
            case StationStarted():
                say(", ".join(filter(None, (count.begun(event), count.left()))))
            case StationEnded(complete=True):
                count.ended()

    return show


def in_notebook(total: int, done: int) -> tuple[Callable[[Event], None], ...]:
    """Observers that write over one line below a notebook's cell; none elsewhere."""
    if not notebook_line.in_notebook():
        return ()
    count, say = StationCount(total, done), notebook_line.rewritten()

    def ended(event: Event) -> None:
        if isinstance(event, RunEnded):
            say(f"{count.done} of {total} stations: {event.finish.value}", "\n")

    return stations_said(count, say), ended
