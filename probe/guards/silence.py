"""Every device has been seen lately: the later, the less while the stage moves, and on the way down
no later than the hardest thing beneath needs to raise the force to its limit."""

from collections.abc import Iterator, Sequence

import numpy as np

from drivers import Sensor
from probe.guards.force_limit import SensorGuard
from probe.guards.press_guard import PERIODS, ForceReading, check_blind
from probe.guards.readings import STAGE, Readings
from probe.planning.limits import Limits


class Silence:
    """How long each device has not been seen, without what the whole program paused."""

    def __init__(
        self,
        stage: str,
        sensors: Sequence[tuple[Sensor, SensorGuard]],
        readings: Readings,
        limits: Limits,
    ) -> None:
        self._stage, self._sensors, self._limits = stage, sensors, limits
        self._readings = readings
        self._excused_s = -np.inf

    def excuse(self, now_s: float) -> None:
        """The whole program paused until now: nobody else is to blame."""
        self._excused_s = now_s

    def check(self, now_s: float, *, in_motion: bool, down_m_s: float) -> Iterator[tuple[str, str]]:
        """Each device that was silent for too long, and why that is."""
        limits, key = self._limits, "late_s" if in_motion else "silence_s"
        for sensor, _ in self._sensors:
            most_s = max(getattr(limits, key), PERIODS / sensor.rate_hz)
            if silent_s := self._longer(sensor.name, now_s, most_s):
                yield sensor.name, _words(silent_s, most_s, key)
        if silent_s := self._longer(STAGE, now_s, limits.silence_s):
            yield self._stage, _words(silent_s, limits.silence_s, "silence_s")
        if in_motion and down_m_s > 0:
            readings = [
                ForceReading(s.name, self._silent_s(s.name, now_s), g.true_n, s.rate_hz)
                for s, g in self._sensors
                if g.feels
            ]
            if (blind := check_blind(limits, down_m_s, readings)) is not None:
                yield blind

    def _silent_s(self, whose: str, now_s: float) -> float:
        return now_s - max(self._readings.seen_s[whose], self._excused_s)

    def _longer(self, whose: str, now_s: float, most_s: float) -> float:
        """How long it was silent, if longer than that; else 0."""
        silent_s = self._silent_s(whose, now_s)
        return silent_s if silent_s > most_s else 0.0


def _words(silent_s: float, most_s: float, key: str) -> str:
    return f"silent for {silent_s:.2f} s; allowed: {most_s:g} s (safety.{key})"
