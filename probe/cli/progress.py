"""Where a scan is and how long it will take, written to standard error."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Lock, Timer
from time import monotonic
from typing import TYPE_CHECKING

from probe.cli.say import inform
from probe.core.events import Event, Phase, PhaseEntered, RunStarted, StationEnded, StationStarted
from probe.scan.progress import StationCount, stations_said

if TYPE_CHECKING:  # where there is no terminal, there is no bar to import it for
    from rich.progress import Progress, ProgressColumn

PATIENCE_S = 2.0
"""Who waits longer for an answer wants to know what for."""
LINE_EVERY_S = 10.0
"""Between two lines of progress in a log: of an hour 360."""


@contextmanager
def scan_progress(total: int, done: int = 0) -> Iterator[Callable[[Event], None]]:
    """Yields an observer of a scan: a bar in a terminal, one plain line per station elsewhere.

    ``total`` and ``done`` as `StationCount` has them.
    """
    count = StationCount(total, done)
    if not sys.stderr.isatty():
        yield stations_said(count, inform)
        return
    from rich.progress import BarColumn, TextColumn

    bar = _bar(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[phase]:<11} {task.fields[left]}"),
    )
    task = bar.add_task("starting", total=total, completed=done, phase="", left="")

    def show(event: Event) -> None:
        match event:
            case RunStarted():
                count.started(event)
            case StationStarted():
                bar.update(task, description=count.begun(event), left=count.left())
            case StationEnded(complete=True):
                count.ended()
                bar.update(task, completed=count.done, left=count.left())
            case PhaseEntered(phase=phase):
                bar.update(task, phase=phase.value)
                if phase is Phase.PAUSED:
                    bar.update(task, left="paused")

    with _drawn(bar):
        yield show


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
    with _drawn(bar):
        yield lambda done, total: bar.update(task, completed=done, total=total)


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


@contextmanager
def _drawn(bar: "Progress") -> Iterator[None]:
    with suppress(OSError):  # the terminal is gone: what was found is still to be said
        bar.start()
    try:
        yield
    finally:
        with suppress(OSError):
            bar.stop()
