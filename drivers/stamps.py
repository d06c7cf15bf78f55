"""When a sample was taken, on the scan's clock, from when the device says and when it arrived.

A sample arrives late by a delay that varies but is never below some least one, so the lower
envelope of (arrival - device time) is the offset between the two clocks (the minimum-delay filter
of network time protocols). The offset follows a fall at once and a rise by `DRIFT`, so that two
crystals that run apart stay together.
"""

from collections import deque

DRIFT = 5e-4  # far more than crystals differ, far less than a line's jitter
LATE_FRAMES = 5


class DeviceTime:
    """Scan time of samples whose device gives a time of its own [s].

    ``latency_s`` is what passes between the touch and the earliest possible arrival.
    """

    def __init__(self, latency_s: float = 0.0) -> None:
        self._latency_s = latency_s
        self._offset_s: float | None = None
        self._last_s = 0.0

    def stamp(self, device_s: float, arrival_s: float) -> float:
        """Scan time; ascending as long as ``device_s`` is."""
        seen_s = arrival_s - device_s
        if self._offset_s is None:
            self._offset_s = seen_s
        else:
            step_s = max(device_s - self._last_s, 0.0)
            risen_s = min(seen_s, self._offset_s + DRIFT * step_s)
            self._offset_s = max(risen_s, self._offset_s - 0.5 * step_s)  # time never turns back
        self._last_s = device_s
        return device_s + self._offset_s - self._latency_s


class FrameTime:
    """Scan time of frames that come at a fixed rate and carry no time.

    A frame known to be lost is told by ``skipped``; frames that vanished unseen show as a lateness
    that none of `LATE_FRAMES` frames makes up for.
    """

    def __init__(self, period_s: float, latency_s: float = 0.0) -> None:
        self._period_s = period_s
        self._time = DeviceTime(latency_s)
        self._latency_s = latency_s
        self._index = 0
        self._late: deque[float] = deque(maxlen=LATE_FRAMES)

    def stamp(self, arrival_s: float, skipped: int = 0) -> tuple[float, int]:
        """Scan time of the next frame, and how many frames are missing right before it."""
        self._index += 1 + skipped
        time_s = self._time.stamp(self._index * self._period_s, arrival_s)
        self._late.append(arrival_s - self._latency_s - time_s)
        behind_s = min(self._late)
        if len(self._late) < LATE_FRAMES or behind_s < 0.75 * self._period_s:
            return time_s, skipped
        unseen = round(behind_s / self._period_s)
        self._late.clear()
        self._index += unseen
        return self._time.stamp(self._index * self._period_s, arrival_s), skipped + unseen
