"""Axes that are led along a straight move, reading by reading, and what keeps them from it."""

import math
import time
from collections.abc import Mapping

from drivers.core.axes import Axes, Reading
from drivers.core.errors import DeviceFault
from drivers.core.line import NoAnswer
from drivers.core.segments import AHEAD_S, RESTS_S, Place, SegmentedMove
from drivers.core.stage_limits import AXES, STILL_MM


class Lead:
    """The move ``way`` [scan, mm] of axes whose places are the scan's plus ``origin_mm``.

    ``trouble`` says in words what has ended it on its way. `set_off` and `go_on` are for the thread
    that talks to the controller.
    """

    def __init__(
        self, way: SegmentedMove, names: str, origin_mm: Mapping[str, float], arrived_mm: float
    ) -> None:
        ways = zip(AXES, way.start, way.target, strict=True)
        self.going = [a for a, s, t in ways if a in names and abs(t - s) > STILL_MM]
        self.trouble = ""
        self._way, self._names, self._origin = way, names, origin_mm
        self._arrived_mm = arrived_mm
        self._on_s = 0.0  # when the axes were last on their way, or waited for us

    @property
    def whole(self) -> bool:
        """Whether the controller knows all of it."""
        return self._way.whole

    def set_off(self, axes: Axes) -> None:
        """The first segment. Raises `DeviceFault`."""
        way = self._way
        ways = zip(AXES, way.start, way.target, strict=True)
        shares = {a: abs(t - s) / way.length_mm for a, s, t in ways if a in self.going}
        speeds = {a: way.speed_mm_s * share for a, share in shares.items()}
        axes.move(self._places(way.next(way.start) or way.target), speeds)
        self._on_s = time.monotonic()

    def go_on(self, axes: Axes, reading: Reading, guarded_s: float | None) -> bool:
        """The next segment, if it is due; whether there was one. Raises `NoAnswer`.

        ``guarded_s``: when somebody last checked the force; None where nobody ever does.
        """
        way, now_s = self._way, time.monotonic()
        if self.trouble or reading.fault:
            return False
        x, y, z = (
            reading.places_mm[a] - self._origin[a] if a in self._names else at
            for a, at in zip(AXES, way.start, strict=True)
        )
        if reading.moving or way.way_mm((x, y, z)) > way.given_mm - self._arrived_mm:
            self._on_s = now_s
        elif now_s - self._on_s > RESTS_S and not way.whole:
            off_mm = math.dist((x, y, z), way.target)
            self.trouble = f"came to rest {off_mm:.2f} mm from its target: something holds it"
        alone = guarded_s is not None and now_s - guarded_s > AHEAD_S
        before_mm = way.given_mm
        if self.trouble or alone or (to := way.next((x, y, z))) is None:
            return False
        try:
            axes.move(self._places(to), {})
        except NoAnswer:
            way.given_mm = before_mm  # it may not know of it
            raise
        except DeviceFault as fault:
            self.trouble = fault.reason
        return True

    def _places(self, at: Place) -> dict[str, float]:
        return {a: mm + self._origin[a] for a, mm in zip(AXES, at, strict=True) if a in self.going}
