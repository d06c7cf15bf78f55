"""The guards' process, forked from one that has imported everything instead of started anew.

Starting Python and importing takes seconds of a busy machine's time and nothing that the campaign
asks about. What runs, and over which lines, is the same: `probe.guards.guard_process.main`.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

POLL_S = 0.02
MOST_LINES = 16  # more than the client has to its guards


class Prepared:
    """Stands in for a process that `probe.guards.guard_client` starts."""

    def __init__(self) -> None:
        self._ours, theirs = socket.socketpair()
        self.pid = os.fork()
        if self.pid == 0:
            try:
                self._ours.close()
                os.setsid()
                _guard(theirs)
            finally:
                os._exit(1)
        theirs.close()

    def __call__(self, _command: Sequence[str], *, pass_fds: Sequence[int], **_: Any) -> "Prepared":
        """Begin to guard, over these descriptors."""
        socket.send_fds(self._ours, [b"g"], list(pass_fds))
        return self

    def kill(self) -> None:
        """End it."""
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def poll(self) -> int | None:
        """The exit status, None while it lives."""
        with suppress(ChildProcessError):
            found, status = os.waitpid(self.pid, os.WNOHANG)
            return os.waitstatus_to_exitcode(status) if found else None
        return 0

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end. Raises `subprocess.TimeoutExpired`."""
        until_s = time.monotonic() + (timeout or 1e9)
        while (status := self.poll()) is None:
            if time.monotonic() > until_s:
                raise subprocess.TimeoutExpired("guards", timeout or 0.0)
            time.sleep(POLL_S)
        return status


class Spare:
    """Stands in for `subprocess.Popen`: one process that guards, and two if that dies."""

    def __init__(self) -> None:
        self._prepared = [Prepared() for _ in range(3)]

    def __call__(self, command: Sequence[str], **given: Any) -> Prepared:
        """The next of them."""
        return self._prepared.pop(0)(command, **given)


def _guard(orders: socket.socket) -> None:
    word, numbers, _, _ = socket.recv_fds(orders, 1, MOST_LINES)
    if not word:  # the scan ended without devices
        os._exit(0)
    orders.close()
    os.dup2(2, 1)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    sys.argv = ["-c", *map(str, numbers)]
    from probe.guards.guard_process import main

    main()
    os._exit(0)
