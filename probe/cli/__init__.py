"""The command ``palpate``: one small file per group of commands.

Imported at the top is only what can end it quietly while all the rest is being imported.
"""

import os
import signal
import sys
import threading
from collections.abc import Sequence

ABORTED = 5
"""Exit status of what a user stopped."""
ORDERS = ("SIGTERM", "SIGHUP", "SIGQUIT")
"""Ask a command to end as Ctrl-C does, also before and after a scan, which hears them itself."""


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
    orders = [getattr(signal, name) for name in ORDERS if hasattr(signal, name)]
    heard = [number for number in orders if signal.getsignal(number) is signal.SIG_DFL]
    for number in heard:
        signal.signal(number, signal.default_int_handler)
    try:
        return run(given)
    finally:
        for number in heard:
            signal.signal(number, signal.SIG_DFL)


def _in_main_thread() -> bool:
    """Where alone Python takes signals."""
    return threading.current_thread() is threading.main_thread()


def _leave(as_json: bool) -> None:
    """End at once: an exception amid an import may be swallowed, or printed by Python itself."""
    os.write(2, b"stopped\n")
    if as_json:
        os.write(1, b'{"error": "stopped", "status": 5}\n')
    os._exit(ABORTED)
