"""When a sample was taken, on the scan's clock, from when the device says and when it arrived.

A sample arrives late by a delay that varies but is never below some least one, so the lower
envelope of (arrival - device time) is the offset between the two clocks (the minimum-delay filter
of network time protocols). The offset follows a fall at once and a rise by `DRIFT`, so that two
crystals that run apart stay together.
"""

import math
from collections import deque
from statistics import median

DRIFT = 5e-4  # far more than crystals differ, far less than a line's jitter
FRAME_DRIFT = 2e-3  # while a device's period is still being learnt
INSTANT_S = 1e-6  # times ascend by at least this; half or twice of it changes nothing
STOOD_S = 0.01  # a smaller loss heals by `DRIFT` within 20 s
MAX_LATENESS_SPREAD = 0.25
"""Spread of the lateness, (median - least) / least, above which it is jitter and not a clock that
stood still. 0.03 was seen in a stall of 60 ms; at 0.5 a busy second is taken for a stop of the
clock (benchmarks/time_stamps.py)."""
LASTING_S = 0.25  # at half of it too; twice of it finds the same stops

# Of frames without a time of their own. What half or twice of each does to the error of the times
# and to the count of lost frames is measured by benchmarks/time_stamps.py.
LATE_READS = 5
"""Late reads in a row that mean lost frames, not a busy reader: with 2 most counts are wrong, with
10 as many as with 5."""
LATE_PERIODS = 0.75
"""How late they are, in periods, between jitter and one whole lost frame: with half most counts are
wrong, with 0.9 as many as with 0.75."""
PERIOD_SLACK = 0.03
"""Share by which a period may differ from the nominal one: a device's own clock may be 2 % off its
data sheet. Half of it loses those; with twice a device that loses frames passes for a slow one."""
WINDOW_FRAMES = 10
"""Half or twice of it makes the times up to twice as wrong, and half as many counts again."""
WINDOWS = 80
"""Half or twice of it changes nothing."""


class DeviceTime:
    """Scan time of samples whose device gives a time of its own [s].

    ``latency_s`` is what passes between the touch and the earliest possible arrival. With
    ``stands_still`` the device's clock may lose time (a controller that misses cycles does
    not count the missed ones): where every sample of `LASTING_S` came later than its stamp by more
    than `STOOD_S`, and all by about the same, the stamps are anchored anew, and ``jumped_s`` says
    how early the ones before were. A machine that is late itself is so by ever different times, and
    catches up.
    """

    def __init__(
        self, latency_s: float = 0.0, drift: float = DRIFT, *, stands_still: bool = False
    ) -> None:
        self.jumped_s = 0.0
        self._latency_s = latency_s
        self._drift = drift
        self._stands_still = stands_still
        self._late_since_s = 0.0
        self._late_s: list[float] = []
        self._offset_s = 0.0
        self._device_s = math.inf
        self._last_s = -math.inf

    def stamp(self, device_s: float, arrival_s: float) -> float:
        """Scan time, not after the arrival; ascending as long as ``device_s`` is."""
        seen_s = arrival_s - device_s
        if device_s < self._device_s:  # the first sample, or a device that started anew
            self._offset_s = seen_s
        else:
            risen_s = self._offset_s + self._drift * (device_s - self._device_s)
            self._offset_s = min(seen_s, risen_s)
        self._device_s = device_s
        if self._stands_still:
            self._anchor(arrival_s, seen_s - self._offset_s)
        self._last_s = max(device_s + self._offset_s - self._latency_s, self._last_s + INSTANT_S)
        return self._last_s

    def _anchor(self, arrival_s: float, late_s: float) -> None:
        self.jumped_s = 0.0
        if late_s < STOOD_S:
            self._late_s.clear()
            return
        if not self._late_s:
            self._late_since_s = arrival_s
        self._late_s.append(late_s)
        if arrival_s - self._late_since_s > LASTING_S:
            least_s = min(self._late_s)
            if median(self._late_s) - least_s < MAX_LATENESS_SPREAD * least_s:
                self.jumped_s = least_s
                self._offset_s += least_s
            self._late_s.clear()


class FrameTime:
    """Scan time of frames that come at a fixed rate and carry no time.

    Their true period, within `PERIOD_SLACK` of the nominal one, is learnt from the arrivals. A
    frame known to be lost is given by ``skipped``; frames that vanished unseen show as a lateness
    that none of `LATE_READS` reads makes up for.
    """

    def __init__(self, period_s: float, latency_s: float = 0.0) -> None:
        self._nominal_s = self._period_s = period_s
        self._time = DeviceTime(latency_s, FRAME_DRIFT)
        self._latency_s = latency_s
        self._index = 0
        self._device_s = 0.0
        self._arrival_s = -math.inf
        self._late: deque[float] = deque(maxlen=LATE_READS)
        self._least_s = math.inf
        self._earliest: deque[tuple[int, float]] = deque(maxlen=WINDOWS)

    def stamp(self, arrival_s: float, skipped: int = 0) -> tuple[float, int]:
        """Scan time of the next frame, and how many frames are missing right before it.

        Frames that were read together have the same ``arrival_s``.
        """
        missing = skipped
        if arrival_s != self._arrival_s:
            missing += self._unseen()
            self._arrival_s = arrival_s
            self._late.append(math.inf)
        self._index += 1 + missing
        self._device_s += (1 + missing) * self._period_s
        time_s = self._time.stamp(self._device_s, arrival_s)
        self._late[-1] = arrival_s - self._latency_s - time_s  # of the read's freshest frame
        self._learn(arrival_s)
        return time_s, missing

    def _unseen(self) -> int:
        behind_s = min(self._late, default=0.0)
        if len(self._late) < LATE_READS or behind_s < LATE_PERIODS * self._period_s:
            return 0
        self._late.clear()
        return round(behind_s / self._period_s)

    def _learn(self, arrival_s: float) -> None:
        """The slope of the earliest arrivals of each window is the period's error."""
        self._least_s = min(self._least_s, arrival_s - self._index * self._nominal_s)
        first = self._earliest[-1][0] if self._earliest else 0
        if self._index - first < WINDOW_FRAMES:
            return
        self._earliest.append((self._index, self._least_s))
        self._least_s = math.inf
        (a, then_s), (b, now_s) = self._earliest[0], self._earliest[-1]
        if b > a:
            slack_s = PERIOD_SLACK * self._nominal_s
            slope_s = (now_s - then_s) / (b - a)
            self._period_s = self._nominal_s + min(max(slope_s, -slack_s), slack_s)
