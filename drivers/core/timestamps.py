"""When a sample was taken, on the scan's clock, from when the device says and when it arrived.

A sample arrives late by a delay that varies but is never below some least one, so the lower
envelope of (arrival - device time) is the offset between the two clocks (the minimum-delay filter
of network time protocols). The offset follows a fall at once and a rise by `DRIFT`, so that two
crystals that run apart stay together.
"""

import math
from collections import deque
from statistics import median
from typing import NamedTuple

DRIFT = 5e-4  # far more than crystals differ, far less than a line's jitter
INSTANT_S = 1e-6  # times ascend by at least this; half or twice of it changes nothing
STOOD_S = 0.01  # a smaller loss heals by `DRIFT` within 20 s
MAX_LATENESS_SPREAD = 0.25
"""Spread of the lateness, (median - least) / least, above which it is jitter and not a clock that
stood still. 0.03 was seen in a stall of 60 ms; at 0.5 a busy second is taken for a stop of the
clock (benchmarks/time_stamps.py at c51866cd)."""
LASTING_S = 0.25  # at half of it too; twice of it finds the same stops

# Of frames without a time of their own. What half or twice of each does to the error of the times
# and to the count of lost frames is measured by benchmarks/time_stamps.py at c51866cd.
BLOCK_READS = 32
"""Reads in a row that must all be late before frames count as lost: one that is not, ends it."""
LATE_PERIODS = 0.65
"""How late they are, in periods, between jitter and one whole lost frame. Where the jitter is four
periods (20 ms at 200 Hz) a count may be off by one: in 8 of 12 streams it was."""
PERIOD_SLACK = 0.03
"""Share by which a period may differ from the nominal one: a device's own clock may be 2 % off its
data sheet. Half of it loses those; with twice a device that loses frames passes for a slow one."""
PERIOD_BLOCKS, PERIOD_LAG = 80, 4
OFFSET_BLOCKS = 8


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


class _Block(NamedTuple):
    """The earliest frame of some reads: its number among those counted on the line, when it came,
    and how many were known by then to have vanished unseen."""

    number: int
    arrival_s: float
    lost: int

    def offset_s(self, period_s: float) -> float:
        return self.arrival_s - (self.number + self.lost) * period_s


class FrameTime:
    """Scan time of frames that come at a fixed rate and carry no time.

    A frame arrives late by a delay that is never below some least one, so of each `BLOCK_READS`
    reads only the earliest frame counts. The period, within `PERIOD_SLACK` of the nominal one, is
    the median slope between such frames as they were counted on the line, never as they were
    repaired: a loss is one steep slope among many. Frames that vanished unseen show as a whole
    block that is later than every recent one, by `LATE_PERIODS` at least.
    """

    def __init__(self, period_s: float, latency_s: float = 0.0) -> None:
        self._nominal_s = self._period_s = period_s
        self._latency_s = latency_s
        self._number = self._lost = self._reads = 0
        self._offset_s = math.inf
        self._arrival_s = self._last_s = -math.inf
        self._earliest: tuple[float, int, float] | None = None
        self._blocks: deque[_Block] = deque(maxlen=PERIOD_BLOCKS)

    def stamp(self, arrival_s: float, skipped: int = 0) -> tuple[float, int]:
        """Scan time of the next frame, and how many frames are missing right before it: those
        ``skipped``, and those that vanished unseen up to some `BLOCK_READS` reads ago.

        Frames that were read together have the same ``arrival_s``.
        """
        missing = skipped
        if arrival_s != self._arrival_s:
            self._arrival_s = arrival_s
            if self._reads == BLOCK_READS:
                missing += self._end_block()
            self._reads += 1
        self._number += 1 + skipped
        index = self._number + self._lost
        offset_s = arrival_s - index * self._period_s
        self._offset_s = min(self._offset_s, offset_s)
        if self._earliest is None or offset_s < self._earliest[0]:
            self._earliest = offset_s, self._number, arrival_s
        time_s = index * self._period_s + self._offset_s - self._latency_s
        self._last_s = max(time_s, self._last_s + INSTANT_S)
        return self._last_s, missing

    def _end_block(self) -> int:
        """Learn from a block; how many frames vanished before it."""
        assert self._earliest is not None
        _, number, arrival_s = self._earliest
        self._reads, self._earliest = 0, None
        self._blocks.append(_Block(number, arrival_s, self._lost))
        self._period_s = self._nominal_s + self._slope_s()
        *before_s, now_s = [b.offset_s(self._period_s) for b in self._blocks][-OFFSET_BLOCKS:]
        vanished = 0
        if before_s and now_s - max(before_s) > LATE_PERIODS * self._period_s:
            vanished = round((now_s - median(before_s)) / self._period_s)
            self._lost += vanished
            self._blocks[-1] = _Block(number, arrival_s, self._lost)
            now_s -= vanished * self._period_s
        self._offset_s = min(now_s, *before_s) if before_s else now_s
        return vanished

    def _slope_s(self) -> float:
        """The period minus the nominal one; 0 where no two blocks lie within the slack."""
        blocks = list(self._blocks)
        lag = min(PERIOD_LAG, len(blocks) // 2)
        slack_s = PERIOD_SLACK * self._nominal_s
        slopes_s = (
            [
                (b.arrival_s - a.arrival_s) / (b.number - a.number) - self._nominal_s
                for a, b in zip(blocks[:-lag], blocks[lag:], strict=True)
            ]
            if lag
            else []
        )
        return median([s for s in slopes_s if abs(s) <= slack_s] or [0.0])
