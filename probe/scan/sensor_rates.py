"""Whether sensors send as many readings as the rig says: all that is planned counts on them."""

from collections.abc import Sequence

from drivers import Block, Sensor
from probe.guards.device_facts import SensorFacts

ENOUGH = 0.8
"""Of the stated rate: the noise of a mean is then at most an eighth above what was planned with."""


class SensorRates:
    """How many readings each of ``sensors`` has sent, and over which time."""

    def __init__(self, sensors: Sequence[Sensor | SensorFacts]) -> None:
        self._stated_hz = {sensor.name: sensor.rate_hz for sensor in sensors}
        self._seen: dict[str, tuple[int, int, float, float]] = {}

    def add(self, readings: Sequence[tuple[str, Block]]) -> None:
        """Count blocks of devices; those of a stage are not counted."""
        for name, block in readings:
            if block.jumped_s:  # a device stood still: what it sent before says nothing now
                self._seen.pop(name, None)
            elif name in self._stated_hz:
                start = 0, 0, float(block.time_s[0]), 0.0
                count, lost, first_s, _ = self._seen.get(name, start)
                count, lost = count + len(block.time_s), lost + block.lost
                self._seen[name] = count, lost, first_s, float(block.time_s[-1])

    def slow(self) -> list[tuple[str, str]]:
        """Each sensor that gives less than stated, and the words for it; each is judged once.

        A driver whose rig states too high a rate counts as lost what never was.
        """
        found = []
        for name, (count, lost, first_s, last_s) in self._seen.items():
            stated_hz, span_s = self._stated_hz.pop(name, 0.0), last_s - first_s
            if not 0 < count - 1 < ENOUGH * stated_hz * span_s:
                continue
            words = (
                f"gives {(count - 1) / span_s:.3g} readings a second, and the rig says "
                f"rate_hz = {stated_hz:g}: noise, holds and pulses are planned with that"
            )
            if count + lost - 1 >= ENOUGH * stated_hz * span_s:
                words += f"; or {lost} of {count + lost} readings were lost on the way"
            found.append((name, words))
        return found
