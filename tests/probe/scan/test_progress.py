"""How long a scan will take, as it is said while it runs."""

import pytest

from probe.core.events import StationStarted
from probe.scan import progress
from probe.scan.progress import StationCount


def test_the_time_left_counts_from_the_first_station(monkeypatch: pytest.MonkeyPatch) -> None:
    """Homing, and what a simulation solves first, take as long as many stations."""
    clock_s = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock_s[0])
    count = StationCount(total=5)
    clock_s[0] = 60.0
    for station in range(2):
        count.begun(StationStarted(0.0, station, 1, 0.004 * station, 0.0))
        clock_s[0] += 10.0
        count.ended()
    assert count.left() == "30 s left"


def test_some_stations_of_a_plan_are_counted_beside_their_own_number() -> None:
    count = StationCount(total=4)
    assert count.begun(StationStarted(0.0, 5, 1, 0.024, 0.0)).startswith("station 6, 1 of 4, ")
    first = StationCount(total=4).begun(StationStarted(0.0, 0, 1, 0.004, 0.0))
    assert first.startswith("station 1 of 4, ")
