"""The force behind a sensor's own low pass: what it reads and how fast that rises."""

from collections import deque

import numpy as np

from drivers.core.arrays import Array

WINDOW_SHARE = 0.2
"""Of the filter's time, over which the slope is taken. While the force begins to rise the slope is
late by half of it: a tenth of the filter's own delay is left. A shorter one sees more noise:
sigma sqrt(1 + 12 / (WINDOW_SHARE^2 n)) with n readings in it."""
MIN_READINGS = 3


class LowPass:
    """Inverts ``filter_s y' + y = true`` for the readings ``y`` of a sensor.

    Parameters
    ----------
    filter_s
        The time constant [s]: after a step of the force so long the sensor reads 63 % of it. For a
        moving average it is half of the time that is averaged.
    """

    def __init__(self, filter_s: float) -> None:
        self._filter_s = filter_s
        self._recent: deque[tuple[float, Array]] = deque()

    def forget(self) -> None:
        """The zero has changed, and readings before have nothing to do with those after. Another
        thread may be in the middle of these."""
        self._recent = deque()

    def behind(self, time_s: Array, readings: Array) -> Array:
        """The true loads (n, k) at ``time_s`` (n,) of ``readings`` (n, k), where they are further
        from zero than what is read; else the reading: a force that falls is judged as read."""
        return np.array(
            [self._true(float(t), y) for t, y in zip(time_s, readings, strict=True)]
        ).reshape(readings.shape)

    def _true(self, time_s: float, reading: Array) -> Array:
        recent = self._recent
        recent.append((time_s, reading))
        while len(recent) > MIN_READINGS and recent[1][0] < time_s - WINDOW_SHARE * self._filter_s:
            recent.popleft()
        if len(recent) < MIN_READINGS:
            return reading
        t = np.array([at for at, _ in recent])
        t -= t.mean()
        squares = float(t @ t)
        if squares == 0.0:
            return reading
        true = reading + self._filter_s * (t @ np.array([y for _, y in recent])) / squares
        outward = (true * reading > 0) & (np.abs(true) > np.abs(reading))
        return np.where(outward, true, reading)
