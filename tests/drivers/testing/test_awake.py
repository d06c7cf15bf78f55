"""Time in which the machine stood still for us does not count; what we waited for does."""

import sys
import time

import pytest

from drivers.testing.awake import AwakeTime


def test_time_that_was_taken_from_us_does_not_count() -> None:
    before_s = sys.getswitchinterval()
    with AwakeTime() as awake:
        sys.setswitchinterval(10.0)  # nobody else of this process runs
        try:
            lived_s, began_s = awake.now(), time.monotonic()
            while time.monotonic() < began_s + 0.3:
                pass
            lived_s = awake.now() - lived_s
        finally:
            sys.setswitchinterval(before_s)
    assert lived_s < 0.1


def test_time_that_was_waited_for_does() -> None:
    with AwakeTime() as awake:
        lived_s, began_s = awake.now(), time.monotonic()
        while awake.now() < lived_s + 0.2:
            time.sleep(0.02)
        assert time.monotonic() - began_s > 0.2 - 0.02


def test_it_counts_between_with_only() -> None:
    awake = AwakeTime()
    with awake:
        pass
    lived_s = awake.now()
    time.sleep(0.1)
    with awake:
        assert awake.now() - lived_s == pytest.approx(0.0, abs=0.05)
