"""What a person can ask of a running scan, from any thread: pause, resume, abort, stop."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType


class Wish(IntEnum):
    """What was asked for, the most urgent last; only `Control.resume` takes a wish back."""

    GO_ON = 0
    PAUSE_AFTER_STATION = 1
    PAUSE_NOW = 2
    ABORT = 3
    STOP = 4


class Control:
    """The wish of whoever watches the scan. Every method may be called from any thread.

    Plain flags and no lock: a signal handler may interrupt any of these methods, itself included.
    """

    def __init__(self) -> None:
        self._asked = dict.fromkeys(list(Wish)[1:], False)

    @property
    def wish(self) -> Wish:
        """The most urgent wish."""
        return max((w for w, asked in self._asked.items() if asked), default=Wish.GO_ON)

    def pause(self, *, now: bool = False) -> None:
        """Pause after this station, or ``now``: retract, and repeat the station on `resume`."""
        self._asked[Wish.PAUSE_NOW if now else Wish.PAUSE_AFTER_STATION] = True

    def resume(self) -> None:
        """Go on after a pause; an abort or a stop stays."""
        self._asked[Wish.PAUSE_NOW] = False
        self._asked[Wish.PAUSE_AFTER_STATION] = False

    def abort(self) -> None:
        """Retract and end the run."""
        self._asked[Wish.ABORT] = True

    def stop(self) -> None:
        """Halt where the probe is and end the run."""
        self._asked[Wish.STOP] = True


@contextmanager
def ctrl_c(control: Control) -> Iterator[None]:
    """Within: Ctrl-C and SIGTERM abort, a second one stops. Call it in the main thread."""

    def asked(_signal: int, _frame: FrameType | None) -> None:
        if control.wish >= Wish.ABORT:
            control.stop()
        else:
            control.abort()

    before = {number: signal.signal(number, asked) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
