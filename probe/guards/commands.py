"""What a person can ask of a running scan, from any thread: pause, resume, abort, stop."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType

ENDING = tuple(  # Windows has the first two
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")
    if hasattr(signal, name)
)

STOPPED = "stopped by the user"  # how a run ends: of the guards, the rules and the engine alike


class RunCommand(IntEnum):
    """What was asked for, the most urgent last; only `Control.resume` takes a command back."""

    RESUME = 0
    PAUSE_AFTER_STATION = 1
    PAUSE_NOW = 2
    ABORT = 3
    STOP = 4


class Control:
    """What whoever watches the scan asks for. Every method may be called from any thread.

    Plain flags and no lock: a signal handler may interrupt any of these methods, itself included.

    Examples
    --------
    A scan that was ordered to end before its first station stores an aborted run:

    >>> import palpate
    >>> control = palpate.Control()
    >>> control.abort()
    >>> palpate.scan(scene="TIHA", control=control).ended.finish.value
    'aborted'
    """

    def __init__(self) -> None:
        self._asked = dict.fromkeys(list(RunCommand)[1:], False)

    @property
    def command(self) -> RunCommand:
        """The most urgent command."""
        if True not in self._asked.values():  # at nearly every tick
            return RunCommand.RESUME
        return max((w for w, asked in self._asked.items() if asked), default=RunCommand.RESUME)

    def pause(self, *, now: bool = False) -> None:
        """Pause after this station, or ``now``: retract, and repeat the station on `resume`."""
        self._asked[RunCommand.PAUSE_NOW if now else RunCommand.PAUSE_AFTER_STATION] = True

    def resume(self) -> None:
        """Go on after a pause; an abort or a stop stays."""
        self._asked[RunCommand.PAUSE_NOW] = False
        self._asked[RunCommand.PAUSE_AFTER_STATION] = False

    def abort(self) -> None:
        """Retract and end the run."""
        self._asked[RunCommand.ABORT] = True

    def stop(self) -> None:
        """Halt where the probe is and end the run."""
        self._asked[RunCommand.STOP] = True


@contextmanager
def ctrl_c(control: Control) -> Iterator[None]:
    """Within: any signal of `ENDING` aborts, which lifts; Ctrl-C after that stops the probe there.

    Only a person types Ctrl-C. A terminal that closes, a computer that shuts down and a Ctrl-Z may
    come after each other, and none of them may leave the probe in the tissue. A hangup that whoever
    started the scan has had ignored, as nohup does, stays ignored. Call it in the main thread.
    """

    def asked(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT and control.command >= RunCommand.ABORT:
            control.stop()
        else:
            control.abort()

    heard = [number for number in ENDING if not _is_ignored_hangup(number)]
    before = {number: signal.signal(number, asked) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_ignored_hangup(number: int) -> bool:
    hangup = number == getattr(signal, "SIGHUP", None)
    return hangup and signal.getsignal(number) is signal.SIG_IGN
