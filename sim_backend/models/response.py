"""A force model of one place, as curves over depth and lumen pressure: what the phantom feels."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array
from sim_backend.models.curve import HermiteCurve
from sim_backend.models.force_model import ForceSlope, Range
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.waves import PA_PER_MMHG

PRESSURE_SLACK = 0.02
"""Share of the wave's span that a pressure may lie outside it: a wave is sampled."""


class Left(NamedTuple):
    """Shares that may be missed of the resting force, of the change from it, of the deepest force
    (what lies between the depths solved), and of the force by a change however ``faint``."""

    rest: float
    change: float
    between: float
    faint: float = 0.0


@dataclass(frozen=True)
class StationResponse:
    """A `sim_backend.models.force_model.ForceModel` of one place ``x_m`` down to ``max_depth_m``.

    ``bulge_m``: how far the resting pressure lifts the surface; contact begins there. ``share``
    is F(d, rest) / (d + bulge) and its slope by pressure; both with the stress.
    """

    x_m: float
    max_depth_m: float
    length_m: float
    bulge_m: float
    force: "Curve"
    stress: "Curve"
    left: "Left"

    @property
    def range(self) -> Range:
        """One place, any height above it, the wave with a little room for sampling; without a
        vessel any pressure."""
        low, high = self.force.low_pa, self.force.high_pa
        slack = PRESSURE_SLACK * (high - low)
        pressures = (low - slack, high + slack) if high > low else (-np.inf, np.inf)
        return Range((self.x_m, self.x_m), (-np.inf, self.max_depth_m), pressures)

    def force_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Normal force [N] on the whole finger, 0 out of contact."""
        return self.length_m * self._at(self.force, x_m, depth_m, pressure_pa)

    def von_mises_pa(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        """Von Mises stress [Pa] at the surface under the finger."""
        return self._at(self.stress, x_m, depth_m, pressure_pa)

    def slope(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> ForceSlope:
        touched = self.force_n(x_m, depth_m, pressure_pa) > 0
        sunk, pressure = np.broadcast_arrays(np.asarray(depth_m) + self.bulge_m, pressure_pa)
        by_depth = self.force.rest.derivative(sunk)
        by_depth = by_depth + self.force.slope.derivative(sunk) * self.force.gain(pressure)
        by_pressure = self.force.slope(sunk) * self.force.gain_slope(pressure)
        return ForceSlope(
            np.where(touched, self.length_m * by_depth, 0.0),
            np.where(touched, self.length_m * by_pressure, 0.0),
        )

    def error_n(self, x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike) -> Array:
        rest_pa, force = self.force.rest_pa, self.force_n(x_m, depth_m, pressure_pa)
        rest = self.force_n(x_m, depth_m, rest_pa)
        deepest = self.force_n(x_m, self.max_depth_m, rest_pa)
        off = self.left.rest * rest + self.left.change * np.abs(force - rest)
        off += self.left.between * deepest
        return np.asarray(np.where(force > 0, off, 0.0))

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike
    ) -> Array:
        """Of the change itself, and of how far it is from that at the full depth, where the curve
        over pressure is the solved one."""
        low, high = (self.force_n(x_m, depth_m, p) for p in (low_pa, high_pa))
        full = (self.force_n(x_m, self.max_depth_m, p) for p in (low_pa, high_pa))
        change, least = np.abs(high - low), np.abs(np.subtract(*full))
        faint = np.where(change > 0, self.left.faint * np.maximum(high, low), 0.0)
        return np.asarray(self.left.change * np.maximum(change, least) + faint)

    def _at(
        self, curve: "Curve", x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike
    ) -> Array:
        self.range.check(x_m, depth_m, pressure_pa)
        sunk = np.maximum(np.asarray(depth_m, dtype=float) + self.bulge_m, 0.0)
        value = curve.rest(sunk) + curve.slope(sunk) * curve.gain(np.asarray(pressure_pa))
        return np.asarray(np.where(sunk > 0, np.maximum(value, 0.0), 0.0))


@dataclass(frozen=True)
class Curve:
    """A quantity over sunk depth at rest, its slope by pressure, and the gain g(p): a polynomial of
    the pressure over rest [Pa], highest power first. ``low_pa`` to ``high_pa`` is the wave."""

    rest: HermiteCurve
    slope: HermiteCurve
    rest_pa: float
    low_pa: float
    high_pa: float
    powers: Array

    def gain(self, pressure_pa: Array) -> Array:
        return np.asarray(np.polyval(self.powers, pressure_pa - self.rest_pa))

    def gain_slope(self, pressure_pa: Array) -> Array:
        over = np.asarray(pressure_pa - self.rest_pa)
        return np.asarray(np.polyval(np.polyder(self.powers), over))


def levels_pa(scene: Scene) -> tuple[float, float, float]:
    """Resting pressure, then the ends of the wave [Pa]."""
    low, high = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
    rest = low + 0.25 * (high - low)
    return rest * PA_PER_MMHG, low * PA_PER_MMHG, high * PA_PER_MMHG
