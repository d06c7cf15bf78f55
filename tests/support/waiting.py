"""Waiting for something in time in which this machine kept up."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from drivers.testing.awake import AwakeTime
from probe.guards.guard_threads import come_first


def until(ready: Callable[[], bool], timeout_s: float = 3.0) -> float:
    """Wait until ``ready``; how long it took [s]."""
    with AwakeTime() as awake:
        began_s = awake.now()
        while not ready():
            assert awake.now() - began_s < timeout_s, "took too long"
            time.sleep(0.002)
        return awake.now() - began_s


@contextmanager
def first_of_all() -> Iterator[None]:
    """Threads begun within keep their time, however busy other tests keep the machine."""
    come_first()
    try:
        yield
    finally:
        with suppress(AttributeError, OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class OnlyWaits:
    """Stands for the module `time`: it goes on only where somebody sleeps, ``least_s`` or more."""

    def __init__(self, least_s: float = 0.0) -> None:
        self._now_s, self._least_s = 0.0, least_s

    def monotonic(self) -> float:
        return self._now_s

    def sleep(self, wait_s: float) -> None:
        self._now_s += max(wait_s, self._least_s)
