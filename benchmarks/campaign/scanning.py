"""The real `palpate scan` in a process of its own, at a terminal of its own, as a shell starts it.

The process is forked from one that has imported everything, so that a run costs milliseconds. Its
parent is a session leader that does nothing, which a closed terminal ends: then the kernel sends
SIGHUP to the scan's process group, as it does for anybody's terminal.
"""

import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from campaign.guard_fork import Spare

PR_SET_CHILD_SUBREAPER = 36
HELD_US = 1_000_000
LOST = 255
HANDLED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)


@dataclass
class Scan:
    """A scan that runs: its process, its terminal and a pipe for what strikes inside it."""

    pid: int
    leader: int
    terminal: int | None
    inside: int
    said: bytes = b""

    def drain(self) -> None:
        """Take what was written to the terminal, as a terminal does."""
        if self.terminal is not None:
            with suppress(OSError):
                self.said += os.read(self.terminal, 65536)

    def close_terminal(self) -> None:
        """As if its window were closed."""
        if self.terminal is not None:
            os.close(self.terminal)
            self.terminal = None

    def status(self) -> int | None:
        """The exit status, 128 + n after signal n; None while it runs."""
        with suppress(ChildProcessError):
            found, status = os.waitpid(self.leader, os.WNOHANG)
            if not found:
                return None
            if (code := os.waitstatus_to_exitcode(status)) >= 0:
                return code
        try:  # the leader was ended; what it left is ours
            found, status = os.waitpid(self.pid, os.WNOHANG)
        except ChildProcessError:
            return LOST
        return _shell_status(status) if found else None


def _shell_status(status: int) -> int:
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


@dataclass(frozen=True)
class Resumed:
    """How ``palpate resume`` went after a kill; ``kept``: complete stations have their bytes."""

    status: int | None
    said: str
    kept: bool


def adopt_orphans() -> None:
    """Become the parent of whatever a dead leader leaves."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def start(arguments: Sequence[str], folder: Path, answer: Path) -> Scan:
    """``palpate ARGUMENTS`` in ``folder``, its standard output to the file ``answer``."""
    terminal, far = os.openpty()
    reported, tell = os.pipe()
    heard, inside = os.pipe()
    leader = os.fork()
    if leader == 0:
        try:
            os.close(terminal)
            _lead(far, tell, heard, arguments, folder, answer)
        finally:
            os._exit(LOST)
    os.close(far)
    os.close(tell)
    os.close(heard)
    os.set_blocking(terminal, False)
    pid = int(os.read(reported, 20) or b"0")
    os.close(reported)
    return Scan(pid, leader, terminal, inside)


def _lead(
    far: int, tell: int, heard: int, arguments: Sequence[str], folder: Path, answer: Path
) -> None:
    os.setsid()
    fcntl.ioctl(far, termios.TIOCSCTTY, 0)
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    for number in HANDLED:
        signal.signal(number, signal.SIG_DFL)
    pid = os.fork()
    if pid == 0:
        os.setpgid(0, 0)
        os.tcsetpgrp(far, os.getpid())
        os.write(tell, str(os.getpid()).encode())
        os.close(tell)
        _scan(far, heard, arguments, folder, answer)
    for number in (signal.SIGINT, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    _, status = os.waitpid(pid, 0)
    os._exit(_shell_status(status))


def _scan(far: int, heard: int, arguments: Sequence[str], folder: Path, answer: Path) -> None:
    from probe.cli import command
    from probe.guards import guard_client

    out = os.open(answer, os.O_WRONLY | os.O_CREAT, 0o600)
    for descriptor, number in ((far, 0), (out, 1), (far, 2)):
        os.dup2(descriptor, number)
    os.chdir(folder)
    sys.stdin, sys.stdout, sys.stderr = (
        os.fdopen(n, mode, buffering=1) for n, mode in ((0, "r"), (1, "w"), (2, "w"))
    )
    os.environ["TERM"] = "dumb"
    sys.argv = ["palpate", *arguments]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # as a program of its own starts
    guard_client.subprocess = SimpleNamespace(  # type: ignore[assignment]
        Popen=Spare(), DEVNULL=subprocess.DEVNULL, TimeoutExpired=subprocess.TimeoutExpired
    )
    threading.Thread(target=_strike_inside, args=(heard,), daemon=True).start()
    status = LOST
    try:
        status = command()
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else LOST
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)


def _strike_inside(heard: int) -> None:
    """What only code within the process can do to it."""
    while word := os.read(heard, 1):
        match word:
            case b"b":  # a thread that never rests
                with suppress(RuntimeError):  # a scan without memory has none for it
                    threading.Thread(target=_burn, daemon=True).start()
            case b"h":  # an extension that holds the interpreter's lock
                ctypes.PyDLL(None).usleep(HELD_US)
            case b"d":  # the administrator sets the date
                time.time = partial(_later, time.time)


def _later(real: Callable[[], float]) -> float:
    return real() + 3600.0


def _burn() -> None:
    while True:
        sum(range(1000))
