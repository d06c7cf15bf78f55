"""Waiting for something in time in which this machine kept up."""

import time
from collections.abc import Callable

from drivers.testing.awake import AwakeTime


def until(ready: Callable[[], bool], timeout_s: float = 3.0) -> float:
    """Wait until ``ready``; how long it took [s]."""
    with AwakeTime() as awake:
        began_s = awake.now()
        while not ready():
            assert awake.now() - began_s < timeout_s, "took too long"
            time.sleep(0.002)
        return awake.now() - began_s
