"""What a board's settings say: its unit, its slowest axes, how it brakes, where its travel ends."""

import math
from collections.abc import Mapping

from drivers.core.protocols import Pose
from drivers.core.segments import Place
from drivers.core.stage_limits import AXES, ROUNDING_MM
from drivers.grbl.words import error_in_words

INCH_MM = 25.4
REPORT_MASK = 10
REPORT_INCHES, SOFT_LIMITS, HOMING = 13, 20, 22
STEPS, MAX_RATE, ACCELERATION, TRAVEL = 100, 110, 120, 130  # of x; y and z follow
COARSE_STEPS_MM = 80.0  # a belt with 20 teeth; what a board with no such setting is taken for
OUTSIDE = 15


class BoardSettings:
    """The numbers of ``$$`` by what they mean; lengths in mm. What a board does not say is free."""

    def __init__(self, numbers: Mapping[int, float]) -> None:
        self._numbers = numbers
        self.unit_mm = INCH_MM if numbers.get(REPORT_INCHES) else 1.0

    def slower_than(self, speed_mm_s: float) -> list[str]:
        """The board itself slows a move that is too fast for an axis, and says nothing."""
        rates = {a: self._numbers.get(MAX_RATE + n, math.inf) / 60 for n, a in enumerate(AXES)}
        return [
            f"the board moves {axis} at {rate:.4g} mm/s at most (${MAX_RATE + n})"
            for n, (axis, rate) in enumerate(rates.items())
            if rate < speed_mm_s * (1 - 1e-6)
        ]

    def braking_mm(self, speed_mm_s: float, way: Place) -> float:
        """From ``speed_mm_s`` to rest along ``way``."""
        return speed_mm_s**2 / (2 * self._brakes_mm_s2(way))

    def braking_s(self, speed_mm_s: float) -> float:
        """From ``speed_mm_s`` to rest along the slowest axis."""
        return speed_mm_s / self._brakes_mm_s2((1.0, 1.0, 1.0))

    def _brakes_mm_s2(self, way: Place) -> float:
        brakes = [self._numbers.get(ACCELERATION + n, math.inf) for n, w in enumerate(way) if w]
        return max(min(brakes, default=math.inf), 1.0)

    def two_steps_mm(self) -> float:
        """A way that every axis sees."""
        return 2 / min(self._numbers.get(STEPS + n) or COARSE_STEPS_MM for n in range(len(AXES)))

    def beyond_travel(self, here: Place, target: Place) -> str | None:
        """Why the board will refuse ``target``, in machine coordinates; None if it will not.

        Travel leads from 0 to minus the setting, or with another build to plus: to the side of
        ``here``.
        """
        if not (self._numbers.get(SOFT_LIMITS) and self._numbers.get(HOMING, 1.0)):
            return None
        for n, (axis, at, to) in enumerate(zip(AXES, here, target, strict=True)):
            travel_mm = self._numbers.get(TRAVEL + n, math.inf)
            low, high = (0.0 if at > 0 else -travel_mm), (0.0 if at < 0 else travel_mm)
            if not low - ROUNDING_MM <= to <= high + ROUNDING_MM:
                where = f"{axis} = {to:g} mm in machine coordinates, ${TRAVEL + n} = {travel_mm:g}"
                return f"{error_in_words(OUTSIDE)} ({where})"
        return None

    def notes(self) -> list[str]:
        """What a scan should know of its limits."""
        if not self._numbers.get(HOMING, 1.0):
            return ["homing is off ($22=0): the board does not know where its travel ends"]
        if not self._numbers.get(SOFT_LIMITS, 1.0):
            return ["soft limits are off ($20=0): nothing but limits_mm bounds the travel"]
        return []


def in_machine(pose: Pose, origin_mm: Place) -> Place:
    """A pose of the scan [m] in machine coordinates [mm]."""
    x, y, z = (1e3 * at + o for at, o in zip(pose, origin_mm, strict=False))
    return (x, y, z)
