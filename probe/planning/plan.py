"""Where to press: rows and serpentine grids over a surface, checked before anything moves.

The scan frame is right-handed, z up, in metres; the surface's height is a function of x and y.
Every press goes in along the surface's normal; a stage that can turn the tool turns it so.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from drivers import ConfigError, Pose
from probe.planning.press_direction import normal_of, pressed, turn_at
from probe.planning.surfaces import Surface, flat

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]

STEEPEST_DEG = 30.0
AWAY_M = 0.5e-3
"""At least this far up a probe is moved to see that it was in the air where its zero is taken."""
TOUCH_GAP_M = 0.5e-3
"""The slow search for a surface begins this far above where it is planned."""
TOUCH_M_S = 1e-3


@dataclass(frozen=True)
class Place:
    """One station; ``index`` from 0 in scanning order."""

    index: int
    x_m: float
    y_m: float


@dataclass(frozen=True)
class Plan:
    """All stations and one press, the same at each.

    The tip travels ``clearance_m`` above the highest station, approaches at
    ``approach_m_s``, then goes ``indentation_m`` down from the surface in ``ramp_s`` and stays
    ``hold_s``. With ``force_n`` a press ends where the force reaches it, if that is not deeper.
    On its way it stays ``step_hold_s`` at each of the depths ``steps_m`` or forces ``steps_n``.
    With ``touch_n`` the surface is not taken from ``surface`` but found: the approach
    goes on, at most ``search_m`` deep, until the force reaches it. ``settle_s`` of rest in the
    air precede each tare. A rig that yields by ``compliance_m_per_n`` is moved on by
    that much, at most ``max_deflection_m``, until the tip itself is deep enough.
    """

    places: tuple[Place, ...]
    indentation_m: float = 2.5e-3
    ramp_s: float = 1.0
    hold_s: float = 0.825
    clearance_m: float = 2e-3
    travel_m_s: float = 20e-3
    approach_m_s: float = 10e-3
    settle_s: float = 0.05
    force_n: float | None = None
    steps_m: tuple[float, ...] = ()
    steps_n: tuple[float, ...] = ()
    step_hold_s: float = 0.0
    touch_n: float | None = None
    search_m: float = 2e-3
    surface: Surface = flat
    compliance_m_per_n: float = 0.0
    max_deflection_m: float = 0.0

    @cached_property
    def travel_z_m(self) -> float:
        """The height of all travel."""
        return max(pose.z for pose in self._starts.values()) + self.clearance_m

    @property
    def rises_n(self) -> tuple[float, ...]:
        """By how much each step raises the force; none of a press to a depth."""
        forces_n = () if self.force_n is None else (*self.steps_n, self.force_n)
        return tuple(b - a for a, b in pairwise((0.0, *forces_n)))

    @property
    def steps(self) -> int:
        """How often a press stops on its way."""
        return len(self.steps_m) + len(self.steps_n)

    @property
    def deepest_m(self) -> float:
        """How far from the nominal surface, along its normal, a press may go."""
        search = self.search_m if self.touch_n is not None else 0.0
        return self.indentation_m + search + self.max_deflection_m

    @cached_property
    def deepest_below_m(self) -> float:
        """The same straight down, at the steepest station."""
        return self.deepest_m / min(normal_of(pose)[2] for pose in self._starts.values())

    def above(self, place: Place) -> Pose:
        """The travelling pose over a station."""
        return self.at_surface(place)._replace(z=self.travel_z_m)

    def away(self, above: Pose, top_m: float) -> Pose:
        """Where a probe from over a station is seen to be in the air, at most ``top_m`` high."""
        return above._replace(z=min(above.z + self.clearance_m, top_m))

    def at_surface(self, place: Place) -> Pose:
        """The pose at which a press at a station begins, turned to the surface's normal."""
        return self._starts[place.x_m, place.y_m]

    def upright(self, place: Place) -> bool:
        """Whether a station is pressed straight down."""
        pose = self.at_surface(place)
        return pose.rx == 0 == pose.ry

    @cached_property
    def _starts(self) -> dict[tuple[float, float], Pose]:
        return {
            (x, y): Pose(x, y, self.surface(x, y), *turn_at(self.surface, x, y))
            for x, y in dict.fromkeys((p.x_m, p.y_m) for p in self.places)
        }


def row(start_m: float, pitch_m: float, stations: int, *, y_m: float = 0.0) -> tuple[Place, ...]:
    """Stations along x."""
    return grid((start_m, y_m), (pitch_m, 0.0), (stations, 1))


def grid(
    start_m: tuple[float, float], pitch_m: tuple[float, float], stations: tuple[int, int]
) -> tuple[Place, ...]:
    """Stations in rows along x, every other row backwards, so that no way is long."""
    columns, rows = stations
    order = [(i if j % 2 == 0 else columns - 1 - i, j) for j in range(rows) for i in range(columns)]
    return tuple(
        Place(n, start_m[0] + i * pitch_m[0], start_m[1] + j * pitch_m[1])
        for n, (i, j) in enumerate(order)
    )


def repeated(places: Sequence[Place], repeats: int) -> tuple[Place, ...]:
    """Each place pressed ``repeats`` times in a row, each press a station of its own."""
    twice = [place for place in places for _ in range(repeats)]
    return tuple(Place(n, place.x_m, place.y_m) for n, place in enumerate(twice))


def check_reach(plan: Plan, workspace_m: Box) -> None:
    """Raise `ConfigError` unless every pose of the plan lies in the workspace [m]."""
    if not plan.places:
        raise ConfigError("the plan has no stations")
    for place in plan.places:
        top, surface = plan.above(place), plan.at_surface(place)
        steep_deg = math.degrees(math.hypot(surface.rx, surface.ry))
        if steep_deg > STEEPEST_DEG:
            raise ConfigError(
                f"station {place.index + 1} at x = {1e3 * place.x_m:g} mm, "
                f"y = {1e3 * place.y_m:g} mm: the surface is inclined by {steep_deg:.0f} degrees; "
                f"allowed are {STEEPEST_DEG:g}. Is it measured right?"
            )
        deepest = pressed(surface, plan.deepest_m)
        for pose in (top, deepest):
            for axis, at, (low, high) in zip("xyz", pose[:3], workspace_m, strict=True):
                if not low - 1e-9 <= at <= high + 1e-9:
                    raise ConfigError(
                        f"station {place.index + 1} at x = {1e3 * place.x_m:g} mm, "
                        f"y = {1e3 * place.y_m:g} mm needs {axis} = {1e3 * at:g} mm; "
                        f"the workspace allows {1e3 * low:g} to {1e3 * high:g} mm"
                    )
    highest_m = plan.travel_z_m + AWAY_M
    if highest_m > workspace_m[2][1] + 1e-9:
        raise ConfigError(
            f"safety.workspace_mm.z ends at {1e3 * workspace_m[2][1]:g} mm: before the first press "
            f"the probe is moved up to {1e3 * highest_m:g} mm at least, to see that it was in the "
            "air; allow that, or travel lower (safety.retract_mm)"
        )
