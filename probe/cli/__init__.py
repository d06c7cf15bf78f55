"""The command ``palpate``: one small file per group of commands.

Imported at the top is only what can end it quietly while all the rest is being imported.
"""

import gc
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

ABORTED = 5
"""Exit status of what a user stopped."""
ORDERS = ("SIGTERM", "SIGHUP", "SIGQUIT")
"""Ask a command to end as Ctrl-C does, also before and after a scan, which hears them itself."""
GARBAGE_THRESHOLDS = (200_000, 20, 20)
"""When Python looks for garbage. By its own rule a scan of 1.5 s spends 0.07 s on looking through
the 160,000 objects that imports make, and finds nothing; at 20,000 it is 0.04 s."""


def command() -> int:
    """The program ``palpate``: `main`, after which no order to end takes back its status."""
    gc.set_threshold(*GARBAGE_THRESHOLDS)
    status = main()
    for number in _orders():
        signal.signal(number, signal.SIG_IGN)
    for place, stream in enumerate((sys.stdout, sys.stderr), 1):
        try:
            stream.flush()
        except OSError:  # said by now; Python would try again as it ends, and end with 120
            os.dup2(os.open(os.devnull, os.O_WRONLY), place)
    gc.freeze()  # else Python looks through all that was imported for garbage as it ends
    return status


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    before = signal.getsignal(signal.SIGINT)
    # whoever calls this from a program has a way of their own with Ctrl-C
    ours = before is signal.default_int_handler and _in_main_thread()
    if not ours:
        from probe.cli.command_line import run

        return run(given)
    signal.signal(signal.SIGINT, lambda _number, _frame: _leave("--json" in given))
    try:
        from probe.cli.command_line import run
    finally:
        signal.signal(signal.SIGINT, before)
    heard = [number for number in _orders() if signal.getsignal(number) is signal.SIG_DFL]
    for number in heard:
        signal.signal(number, signal.default_int_handler)
    try:
        return run(given)
    finally:
        for number in heard:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Within, no order to end is heard: what has ended says so whole, and once."""
    orders = _orders() if _in_main_thread() else []
    before = {number: signal.signal(number, signal.SIG_IGN) for number in orders}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # Python cannot give back what was set without it
                signal.signal(number, handler)


def _orders() -> list[signal.Signals]:
    return [getattr(signal, name) for name in ("SIGINT", *ORDERS) if hasattr(signal, name)]


def _in_main_thread() -> bool:
    """Where alone Python takes signals."""
    return threading.current_thread() is threading.main_thread()


def _leave(as_json: bool) -> None:
    """End at once: an exception amid an import may be swallowed, or printed by Python itself."""
    os.write(2, b"stopped\n")
    if as_json:
        os.write(1, b'{"error": "stopped", "status": 5}\n')
    os._exit(ABORTED)
