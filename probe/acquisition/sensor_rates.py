"""Whether sensors send as many readings as the rig says: all that is planned counts on them."""

from collections.abc import Sequence

from drivers import Block, Sensor

ENOUGH = 0.8
"""Of the stated rate: the noise of a mean is then at most an eighth above what was planned with."""


class SensorRates:
    """How many readings each of ``sensors`` has sent, and over which time."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        self._stated_hz = {sensor.name: sensor.rate_hz for sensor in sensors}
        self._seen: dict[str, tuple[int, float, float]] = {}

    def add(self, readings: Sequence[tuple[str, Block]]) -> None:
        """Count blocks of devices; those of a stage are not counted."""
        for name, block in readings:
            if block.jumped_s:  # a device stood still: what it sent before says nothing now
                self._seen.pop(name, None)
            elif name in self._stated_hz:
                count, first_s, _ = self._seen.get(name, (0, float(block.time_s[0]), 0.0))
                sent = len(block.time_s) + block.lost
                self._seen[name] = count + sent, first_s, float(block.time_s[-1])

    def slow(self) -> list[tuple[str, str]]:
        """Each sensor that is slower than stated, and the words for it; each is judged once."""
        found = []
        for name, (count, first_s, last_s) in self._seen.items():
            stated_hz, span_s = self._stated_hz.pop(name, 0.0), last_s - first_s
            if 0 < count - 1 < ENOUGH * stated_hz * span_s:
                found.append((name, f"sends {(count - 1) / span_s:.3g} readings a second, and the "
                                    f"rig says rate_hz = {stated_hz:g}: noise, holds and pulses "
                                    "are planned with that"))  # fmt: skip
        return found
