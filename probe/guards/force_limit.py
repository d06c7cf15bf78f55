"""The limit of force and torque, checked on what each sensor reports, never on what was commanded.

Pure checks: each takes a reading and returns why the scan may not go on, or None. The safety
monitor calls them for every sample and acts; of a sensor that says nothing `silence` judges.
"""

import math
from collections import deque

import numpy as np

from drivers import Block, Channel
from drivers.core.arrays import columns_of
from probe.core.contact_stress import FORCE_ROLES
from probe.guards.low_pass import LowPass
from probe.guards.sample_times import SampleTimes
from probe.guards.stuck_sensor import Alive
from probe.planning.limits import LEVER_M, Limits

# Neither these nor `sample_times.FUTURE_S` are critical: halved or doubled together, with the
# monitor's own periods, all tests of false sensors, limits and ways out pass but one. With three
# readings in a mean, a sensor that clips in the last of a press stops it there and is not only
# noted at the lift.
LEVEL_MEMORY_S = 2.0  # twice `levels.MAX_LEVEL_S`, the furthest that a level looks back
SMOOTH = 5
# readings that say what a sensor's noise is, and how few may: known to a quarter, where a contact
# takes ten times as much (`press_guard.NOISE_SIGMAS`)
NOISE_OF, MIN_NOISE_READINGS = 50, 10
VECTORS = {"N": ("fx", "fy", "fz"), "Nm": ("mx", "my", "mz")}  # as all drivers name components


class SensorGuard:
    """Force, torque, saturation and timestamps of one sensor's samples.

    ``feels``: the force limit holds this sensor. ``force_n`` is its latest force, ``true_n`` that
    behind its own low pass of ``filter_s``, and ``smooth_n`` the mean of the latest `SMOOTH`.
    Components beside the normal force are judged from the first tare on (`tared`): before, a
    payload's weight is in them.
    """

    def __init__(
        self, channels: tuple[Channel, ...], limits: Limits, filter_s: float = 0.0
    ) -> None:
        face = limits.face_m2 or math.nan
        taxels = sum(channel.role == "taxel" for channel in channels)
        gain = {"force": 1.0, "pressure": face, "taxel": face / max(taxels, 1)}
        gains = np.array([gain.get(channel.role, math.nan) for channel in channels])
        used = np.flatnonzero(np.isfinite(gains)).tolist()
        self._gains = gains[used]
        self.feels = len(used) > 0
        self._used = columns_of(used)
        self.tared = False
        self.force_n = self.true_n = self.smooth_n = 0.0
        self._low_pass = LowPass(filter_s) if filter_s else None
        self._array = taxels > 0
        self._recent: deque[tuple[float, float]] = deque()
        self._newest: deque[float] = deque(maxlen=SMOOTH)
        self._alive = Alive(limits.same_readings)
        self._limit_n = limits.max_force_n
        torque_nm = limits.max_torque_nm or limits.max_force_n * LEVER_M
        self._norms = [
            (where, unit, limit)
            for unit, limit in (("N", limits.max_force_n), ("Nm", torque_nm))
            if (where := [n for n, c in enumerate(channels)
                          if c.unit == unit and c.name in VECTORS[unit]])
        ]  # fmt: skip
        clips = {n for n, c in enumerate(channels) if c.role in FORCE_ROLES}
        self._clips = sorted(clips.union(*(where for where, _, _ in self._norms)))
        self.times = SampleTimes()
        self._tared_s = -math.inf

    def tare(self) -> None:
        """The sensor has taken its present load as zero: what it said before has another zero."""
        self.tared = True
        self._tared_s = self.newest_s()
        self._newest = deque(maxlen=SMOOTH)  # the sensor's thread may be in the middle of the other
        self.smooth_n = 0.0
        if self._low_pass is not None:
            self._low_pass.forget()

    def level(self, from_s: float) -> tuple[float, float]:
        """Mean force [N] since ``from_s`` and its standard error (NaN, inf without readings)."""
        found = [force for time_s, force in list(self._recent) if time_s > from_s]
        if len(found) < 2:
            return math.nan, math.inf
        return float(np.mean(found)), float(np.std(found, ddof=1)) / math.sqrt(len(found))

    def newest_s(self) -> float:
        """When the latest force was read; minus infinity before the first."""
        return self._recent[-1][0] if self._recent else -math.inf

    def greatest_n(self, from_s: float, readings: int) -> float:
        """The greatest mean of ``readings`` forces [N] in a row since ``from_s``, `LEVEL_MEMORY_S`
        ago at most."""
        found = [force for time_s, force in list(self._recent) if time_s > from_s]
        each = range(len(found) - readings + 1)
        return max((sum(found[n : n + readings]) / readings for n in each), default=0.0)

    def noise_n(self, from_s: float) -> float:
        """Standard deviation [N] of the latest readings since ``from_s`` and the last tare, without
        what they follow; infinite if they are few.

        By the differences of neighbours, so that neither a drift nor a pulse counts as noise.
        """
        since_s = max(from_s, self._tared_s)
        found = [force for time_s, force in list(self._recent)[-NOISE_OF:] if time_s > since_s]
        if len(found) < MIN_NOISE_READINGS:
            return math.inf
        return float(np.std(np.diff(found))) / math.sqrt(2)

    def _keep(self, time_s: list[float], force_n: list[float]) -> None:
        newest = self._newest
        newest.extend(force_n[-SMOOTH:])
        self.smooth_n = sum(newest) / len(newest)
        self._recent.extend(zip(time_s, force_n, strict=True))
        while self._recent[0][0] < time_s[-1] - LEVEL_MEMORY_S:
            self._recent.popleft()

    def check(self, block: Block) -> str | None:
        """Why a block with samples breaks a limit; a lift is always right then."""
        if np.count_nonzero(block.saturated) and block.saturated[:, self._clips].any():
            return "the sensor is saturated: the true force is unknown"
        if self.feels:
            values = block.values[:, self._used]
            # lists: blocks are short, and numpy is slow on those
            used: list[list[float]] = values.tolist()
            each: list[list[float]] = (values * self._gains).tolist()
            force = [sum(one) for one in each] if self._array else [one[0] for one in each]
            self.force_n = self.true_n = force[-1]
            if (dead := self._alive.check(used)) is not None:
                return dead
            self._keep(block.time_s.tolist(), force)
            loads = force if self._array else [load for one in each for load in one]
            if self._low_pass is not None:
                read = np.array(loads)
                true = self._low_pass.behind(block.time_s, read.reshape(len(block.time_s), -1))
                self.true_n = float(true[-1, 0])
                loads = true.ravel().tolist()
            if not all(abs(load) <= self._limit_n for load in loads):  # nor is not-a-number
                greatest = float(np.abs(loads).max())
                behind = " behind the sensor's low pass" if self._low_pass is not None else ""
                return f"force {greatest:.3f} N{behind}; the limit is {self._limit_n:g} N"
        for where, unit, limit in self._norms if self.tared else ():
            norm = float(np.linalg.norm(block.values[:, where], axis=1).max())
            if not norm <= limit:
                what = "force in all directions" if unit == "N" else "torque"
                return f"{what} {norm:.3f} {unit}; the limit is {limit:g} {unit}"
        return None
