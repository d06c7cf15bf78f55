"""Whether a sensor that sends readings still measures: a stuck one repeats the same value."""

import math

from probe.planning.limits import Limits

MAX_CHANCE = 1e-9  # how unlikely a run of equal readings must be before it counts as stuck
MIN_PAIRS = 100  # readings before the sensor's own rate of repetitions is believed
MIN_CHANGES = 10  # and so many changes: a tare changes what a stuck sensor says, too
MIN_RUN = 20  # a shorter run is never taken for one


class Alive:
    """Real readings differ by noise. How often two in a row are equal is learned from the sensor.

    A coarse sensor repeats itself; one that has changed at every reading and then stays the same
    is stuck or clipped, whatever it says of itself. ``most_same``: that many readings that never
    differed at all are no sensor's noise. Who says more than usual knows the sensor to be coarse:
    at rest it repeats itself for longer than it does in a press, from which it would be learned.
    """

    def __init__(self, most_same: int) -> None:
        self._most_same = most_same
        self._last: list[float] | None = None
        self._pairs = self._equal = self._run = 0

    def check(self, readings: list[list[float]]) -> str | None:
        """Why readings that follow the last ones, each of some channels, are not those of a live
        sensor."""
        for reading in readings:
            equal = reading == self._last
            self._last = reading
            self._run = self._run + 1 if equal else 0
            if equal and self._run >= self._longest():
                return (
                    f"the last {self._run + 1} readings are all {reading[0]:.6g}: stuck or "
                    "clipped (a coarse sensor: safety.same_readings)"
                )
            self._pairs += 1
            self._equal += equal
        return None

    def _longest(self) -> float:
        """The run of equal pairs that chance does not explain."""
        if self._pairs < MIN_PAIRS or self._pairs - self._equal < MIN_CHANGES:
            return self._most_same
        share = (self._equal + 1) / (self._pairs + 2)
        coarse = self._most_same > Limits.same_readings
        least = self._most_same if coarse else MIN_RUN
        return max(least, math.log(MAX_CHANCE) / math.log(share))
