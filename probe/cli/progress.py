"""Where a scan is and how long it will take, written to standard error."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Lock, Timer
from time import monotonic
from typing import TYPE_CHECKING, Self

from probe.cli.say import inform
from probe.core.events import Event, Phase, PhaseEntered, RunStarted, StationEnded, StationStarted
from probe.scan.progress import StationCount

if TYPE_CHECKING:  # where there is no terminal, there is no bar to import it for
    from rich.progress import Progress, ProgressColumn

PATIENCE_S = 2.0
"""Who waits longer for an answer wants to know what for."""
LINE_EVERY_S = 10.0
"""Between two lines of progress in a log: of an hour 360."""


class ScanProgress:
    """An observer of a scan: a bar in a terminal, one plain line per station elsewhere.

    ``total`` and ``done`` as `StationCount` has them.
    """

    def __init__(self, total: int, done: int = 0) -> None:
        self._count = StationCount(total, done)
        self._bar: Progress | None = None
        if sys.stderr.isatty():
            from rich.progress import BarColumn, TextColumn

            self._bar = _bar(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.fields[phase]:<11} {task.fields[left]}"),
            )
            self._task = self._bar.add_task(
                "starting", total=total, completed=done, phase="", left=""
            )

    def __enter__(self) -> Self:
        if self._bar is not None:
            _try(self._bar.start)
        return self

    def __exit__(self, *_error: object) -> None:
        if self._bar is not None:
            _try(self._bar.stop)

    def __call__(self, event: Event) -> None:
        """Take one event of the scan."""
        match event:
            case RunStarted():
                self._count.started(event)
            case StationStarted():
                self._show(self._count.begun(event), self._count.left())
            case StationEnded(complete=True):
                self._count.ended()
                if self._bar is not None:
                    done, left = self._count.done, self._count.left()
                    self._bar.update(self._task, completed=done, left=left)
            case PhaseEntered() if self._bar is not None:
                self._bar.update(self._task, phase=event.phase.value)
                if event.phase is Phase.PAUSED:
                    self._bar.update(self._task, left="paused")

    def _show(self, text: str, left: str) -> None:
        if self._bar is not None:
            self._bar.update(self._task, description=text, left=left)
        else:
            inform(f"{text}, {left}" if left else text)


@contextmanager
def solving(after_s: float | None = None) -> Iterator[Callable[[str], None]]:
    """Yields what is to be called with each thing that is solved. It shows them, a line each, from
    ``after_s`` on, by default `PATIENCE_S`; what is over before shows nothing."""
    lock, latest = Lock(), ""
    patience_s = PATIENCE_S if after_s is None else after_s
    late = patience_s <= 0

    def begin() -> None:
        nonlocal late
        with lock:
            late = True
            if latest:
                inform(f"solving {latest}")

    def show(what: str) -> None:
        nonlocal latest
        with lock:
            latest = what
            if late:
                inform(f"solving {what}")

    timer = Timer(patience_s, begin)
    timer.daemon = True
    timer.start()
    try:
        yield show
    finally:
        timer.cancel()


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar for ``done`` of ``total`` things, with the time left; into a file or a pipe a plain
    line at most every `LINE_EVERY_S`. What is over within `PATIENCE_S` writes none."""
    if not sys.stderr.isatty():  # a bar that is off ends with an empty line where rich is before 15
        yield _Lines(what)
        return
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

    done_words = "{task.completed:.0f} of {task.total:.0f} " + what
    bar = _bar(TextColumn(done_words), BarColumn(), TimeRemainingColumn())
    task = bar.add_task(what)
    _try(bar.start)
    try:
        yield lambda done, total: bar.update(task, completed=done, total=total)
    finally:
        _try(bar.stop)


class _Lines:
    """``3 of 12 points, about 40 s left``: what a log can keep of a bar."""

    def __init__(self, what: str) -> None:
        self._what, self._began_s, self._said_s = what, monotonic(), monotonic()
        self._first: int | None = None  # done before: an interrupted sweep has some

    def __call__(self, done: int, total: int) -> None:
        now_s = monotonic()
        if self._first is None:
            self._first = done
        wait_s = LINE_EVERY_S if self._said_s > self._began_s else PATIENCE_S
        if now_s - self._said_s < wait_s or done == self._first:
            return
        self._said_s = now_s
        left_s = (now_s - self._began_s) / (done - self._first) * (total - done)
        inform(f"{done} of {total} {self._what}, about {left_s:.0f} s left")


def _bar(*columns: "ProgressColumn") -> "Progress":
    from rich.console import Console
    from rich.progress import Progress

    return Progress(*columns, console=Console(stderr=True), transient=True)


def _try(draw: Callable[[], None]) -> None:
    with suppress(OSError):  # the terminal is gone: what was found is still to be said
        draw()
