"""Processes that compute for this one, and end with it."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from threading import Thread
from types import ModuleType
from typing import Any

from drivers.core.child import no_ctrl_c


class Workers(ProcessPoolExecutor):
    """A pool of ``count`` fresh interpreters, as a context: what they compute when it is left by
    an exception is for nobody, and they are killed."""

    def __init__(self, count: int) -> None:
        super().__init__(count, mp_context=get_context("spawn"), initializer=leave_with_parent)

    def __exit__(self, kind: type[BaseException] | None, *raised: Any) -> bool | None:
        if kind is not None:
            self.kill()
        return super().__exit__(kind, *raised)

    def kill(self) -> None:
        """End all now (as `kill_workers` of Python 3.14): what they compute is for nobody."""
        for process in list((self._processes or {}).values()):
            process.kill()
        self.shutdown(cancel_futures=True)

    def submit(self, do: Callable[..., Any], /, *arguments: Any, **keywords: Any) -> Future[Any]:
        """As `ProcessPoolExecutor.submit`."""
        with starting_workers():
            return super().submit(do, *arguments, **keywords)


def leave_with_parent() -> None:
    """End this worker when its parent is killed: a pool's workers would wait for ever. It comes
    first before nobody, as a process of guards may.

    A terminal's Ctrl-C reaches the worker too and ends it without a traceback: what was broken off
    is for the parent to say.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):  # Windows has no masks
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    with suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def starting_workers() -> Iterator[None]:
    """Workers that are started inside do not run the caller's script again, nor stop at Ctrl-C
    before `leave_with_parent`, their initializer, runs: they would print where they were.

    A spawned worker imports the script it comes from, since what it shall do may be defined there.
    Ours is not: a script that calls us would only be run again in each worker, from its first line.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    with no_ctrl_c():
        try:
            yield
        finally:
            sys.modules["__main__"] = main
