"""The signal of one press: of all taxels in its hold, and thinned, so that a window can show any
station's again."""

import numpy as np

from drivers.core.arrays import Array, Bools
from probe.core.taxel_image import beat_ends

MAX_POINTS = 2000
"""What a plot can show beside each other; a station then takes at most 32 kB."""

NEAR_TOP_SHARE = 0.9
"""To draw only: detection finds the hold more carefully, see `probe.detection`."""


class HeldTaxels:
    """What each taxel read in the hold of the press that is under way: nothing of the air."""

    def __init__(self) -> None:
        self._time_s: list[Array] = []
        self._stress_pa: list[Array] = []
        self._count = 0
        self._total: Array | float = 0.0

    def add(self, time_s: Array, stress_pa: Array) -> None:
        """Take in the next samples of the hold: times (n,) and stresses (n, k) [Pa]."""
        self._time_s.append(time_s)
        self._stress_pa.append(stress_pa)
        self._count += len(time_s)
        self._total = self._total + stress_pa.sum(axis=0)

    @property
    def mean_pa(self) -> Array:
        """Of each taxel (k,)."""
        return np.asarray(self._total / max(self._count, 1))

    def pulse_pa(self, period_s: float) -> Array:
        """From the lowest to the highest of each taxel's mean beat (k,); NaN before a whole one."""
        if not self._count:
            return np.empty(0)
        ends = beat_ends(np.concatenate(self._time_s), np.concatenate(self._stress_pa), period_s)
        return np.asarray(ends[1] - ends[0])


class PressTrace:
    """Mean stress over a station's last press, at most `MAX_POINTS` samples spread evenly."""

    def __init__(self) -> None:
        self.hold_from_s, self.hold_to_s = np.inf, np.inf
        self._time_s, self._stress_pa = np.empty(0), np.empty(0)
        self._stride, self._skip = 1, 0

    def add(self, time_s: Array, stress_pa: Array) -> None:
        """Take in the next samples: times (n,) and stresses (n,) [Pa]."""
        self._time_s = np.append(self._time_s, time_s[self._skip :: self._stride])
        self._stress_pa = np.append(self._stress_pa, stress_pa[self._skip :: self._stride])
        self._skip = (self._skip - len(time_s)) % self._stride
        while len(self._time_s) > MAX_POINTS:
            last = len(self._time_s) - 1
            self._time_s, self._stress_pa = self._time_s[::2], self._stress_pa[::2]
            self._skip += self._stride * (last % 2 == 0)
            self._stride *= 2

    def whole(self) -> tuple[Array, Array]:
        """Times (n,) since the hold began, or else since the first sample, and stresses (n,)."""
        if not len(self._time_s):
            return self._time_s, self._stress_pa
        zero_s = self.hold_from_s if np.isfinite(self.hold_from_s) else self._time_s[0]
        return self._time_s - zero_s, self._stress_pa

    def held(self, time_s: Array) -> Bools:
        """Which of ``time_s`` (n,) are in the hold."""
        return np.asarray((time_s >= self.hold_from_s) & (time_s < self.hold_to_s))

    def hold(self, *, marked: bool) -> tuple[Array, Array]:
        """Times (n,) and stresses (n,) [Pa] of the hold alone; of a record whose phases are not
        ``marked``, what is near its highest."""
        if marked:
            held = self.held(self._time_s)
        else:
            held = self._stress_pa >= NEAR_TOP_SHARE * self._stress_pa.max(initial=0.0)
        return self._time_s[held], self._stress_pa[held]
