"""The force on the way down, over as many of the latest readings as tell it from noise."""

import math

from probe.checks.touch_noise import least_touch_n, touch_readings
from probe.guards.levels import LEVEL_S
from probe.scan.run_loop import RunLoop


def noise_of(loop: RunLoop) -> tuple[str, float, float]:
    """The first sensor that feels: its name, its rms noise [N] in the air and its rate [Hz]."""
    name, (_, error_n) = next(iter((loop.known_levels or {"": (0.0, 0.0)}).items()))
    rate_hz = next((s.rate_hz for s in loop.sensors if s.name == name), 1 / LEVEL_S)
    return name, error_n * math.sqrt(LEVEL_S * rate_hz), rate_hz


class MeanForce:
    """The mean of the latest ``readings`` since ``since_s``, the fewest that show ``least_n``.

    A single reading that stands out of the noise by itself is not averaged with those before it.
    """

    def __init__(self, loop: RunLoop, least_n: float, since_s: float) -> None:
        self._name, noise_n, self.rate_hz = noise_of(loop)
        self._loop, self.since_s = loop, since_s
        self.readings = touch_readings(noise_n, self.rate_hz, least_n)
        self._alone_n = least_touch_n(noise_n, self.rate_hz, 1)

    def force_n(self) -> float:
        """The force now; 0.0 where there are too few readings for a mean."""
        latest_n, loop = self._loop.status.force_n, self._loop
        from_s = loop.status.seen_s - self.readings / self.rate_hz
        if latest_n >= self._alone_n or self.readings == 1:
            return latest_n
        mean_n = loop.monitor.levels(from_s)[self._name][0] if from_s >= self.since_s else 0.0
        return 0.0 if math.isnan(mean_n) else mean_n
