"""One press as all sensors measure it: each has a guard, and one at least must measure it."""

from collections.abc import Sequence

from drivers import Pose, Sensor
from probe.guards.force_limit import SensorGuard
from probe.guards.press_guard import PressGuard
from probe.planning.limits import Limits
from probe.planning.surfaces import Surface


class Presses:
    """The guards of all sensors that feel a force, for each move of the tip.

    A sensor that reads its own noise and nothing else cannot be distinguished from one in the
    air, but for the place of the tip: beneath ``surface`` there is tissue, and its force must be
    measured before the press is `Limits.contact_within_m` deep.
    """

    def __init__(
        self, sensors: Sequence[tuple[Sensor, SensorGuard]], surface: Surface, limits: Limits
    ) -> None:
        self._guards = {s.name: PressGuard(g, limits, s.rate_hz) for s, g in sensors if g.feels}
        self._surface = surface
        self._asked = not limits.in_the_air
        self._within_m = limits.contact_within_m
        self._searches = False

    def begin(self, start: Pose, target: Pose, speed_m_s: float, *, search: bool) -> None:
        """A move has been ordered. One that ``search``es may find no surface."""
        self._searches = search
        for guard in self._guards.values():
            guard.begin(start, target, speed_m_s)

    def end(self) -> None:
        """The tip rests."""
        for guard in self._guards.values():
            guard.end()

    def check(self, pose: Pose, now: float) -> tuple[str, str] | None:
        """Which sensor's force does not belong to the pose, and why; None if all do."""
        odd = None
        for name, guard in self._guards.items():  # each sees every pose
            why = guard.check(pose, now)
            if why is not None and odd is None:
                odd = name, why
        return odd or self._unfelt(pose)

    def _unfelt(self, pose: Pose) -> tuple[str, str] | None:
        if not self._asked or self._searches:
            return None
        if any(guard.in_contact() for guard in self._guards.values()):
            return None
        surface_m = self._surface(pose.x, pose.y)
        for name, guard in self._guards.items():
            if (deep_m := guard.in_air_m(surface_m)) > self._within_m:
                return name, (
                    f"no force above the noise {1e3 * deep_m:.2f} mm deep: the surface is lower "
                    "than planned, or the sensor does not measure force; search for the surface "
                    "with scan.touch_n, plan it with scan.surface_mm, or set "
                    "safety.contact_within_mm if a press may feel nothing for so long"
                )
        return None
