"""A section's answer at one place, for any depth and lumen pressure: what the phantom feels.

One ramp is solved at the resting pressure, with the exact slopes by depth and by pressure along it;
at the full depth the ends of the wave are solved as well, as far as they are needed. Between them
    F(d, p) = F(d, rest) + dF/dp(d) g(p),   g(p) = (F(D, p) - F(D, rest)) / dF/dp(D),
which is exact at the full depth D and to first order elsewhere. Time does not enter: relaxation
and the beat are the phantom's.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array
from sim_backend.fem.continuation import continuation, unloaded
from sim_backend.fem.model import Section, build_section, usual_grading
from sim_backend.fem.newton import Load, Solution
from sim_backend.fem.section_contact import walls_cross
from sim_backend.fem.sensitivity import Slope, slopes
from sim_backend.fem.stress import under_finger_pa
from sim_backend.models.curve import HermiteCurve, from_nothing, monotone
from sim_backend.models.force_model import ForceSlope, Range
from sim_backend.scene.scene_file import Scene, mirrored
from sim_backend.scene.waves import PA_PER_MMHG

DEPTHS = np.array([0.04, 0.2, 0.55, 1.0])
"""Shares of the greatest depth that are solved. Between them forces of TIHA and TIT are within
0.09 % of the greatest, nearly as with seven shares and no slopes (0.06 %)."""
BEND = 0.05
"""Share of a pulse from rest to systole by which it may bend before diastole is solved too. A bend
of 0.03 (TIHA) leaves 0.2 % of the pulse."""
PRESSURE_SLACK = 0.02
"""Share of the wave's span that a pressure may lie outside it: a wave is sampled."""
PROBE_PA, PROBE_M = 10.0, 1e-6
"""Steps of the stress's slopes by pressure and depth, along the exact displacement slopes."""
RELATIVE_SIZE = 0.1
"""Element size over the finger's half width: 0.3 % of force, 2 % of pulse on the paper's scenes."""
GROWTH, COARSEST = 0.6, 0.24
"""How fast elements grow away from contact and vessels, and the largest over the height: that saves
a third of the time of `usual_grading`, for 0.15 % of the force at most."""
FORCE_LEFT, PULSE_LEFT, BETWEEN = 0.006, 0.03, 0.0015
"""Shares that may be missed of the resting force, of the change from it, and of the deepest force
(what lies between the depths solved): the figures above, added."""


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
    force: "_Curve"
    stress: "_Curve"

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
        off = FORCE_LEFT * rest + PULSE_LEFT * np.abs(force - rest) + BETWEEN * deepest
        return np.asarray(np.where(force > 0, off, 0.0))

    def pulse_error_n(
        self, x_m: ArrayLike, depth_m: ArrayLike, low_pa: ArrayLike, high_pa: ArrayLike
    ) -> Array:
        """Of the change itself, and of how far it is from that at the full depth, where the curve
        over pressure is the solved one."""
        low, high = (self.force_n(x_m, depth_m, p) for p in (low_pa, high_pa))
        full = (self.force_n(x_m, self.max_depth_m, p) for p in (low_pa, high_pa))
        change, least = np.abs(high - low), np.abs(np.subtract(*full))
        return np.asarray(PULSE_LEFT * np.maximum(change, least))

    def _at(
        self, curve: "_Curve", x_m: ArrayLike, depth_m: ArrayLike, pressure_pa: ArrayLike
    ) -> Array:
        self.range.check(x_m, depth_m, pressure_pa)
        sunk = np.maximum(np.asarray(depth_m, dtype=float) + self.bulge_m, 0.0)
        value = curve.rest(sunk) + curve.slope(sunk) * curve.gain(np.asarray(pressure_pa))
        return np.asarray(np.where(sunk > 0, np.maximum(value, 0.0), 0.0))


@dataclass(frozen=True)
class _Curve:
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


def respond(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    """The answer of ``scene`` at ``x_m`` [m] down to ``max_depth_m`` [m].

    A scene that is its own mirror image is solved on its left half only. Raises
    `sim_backend.fem.newton.CannotSolve` where physics ends.
    """
    half_m = round(x_m, 9)
    if scene.tissue is not None and mirrored(scene) == scene:
        width = 1e-3 * scene.tissue.width_mm
        half_m = round(min(half_m, width - half_m), 9)
    return replace(_respond(scene, half_m, round(max_depth_m, 9)), x_m=x_m)


def element_size_m(scene: Scene) -> float:
    """Element size that keeps force within about 0.3 % and pulse within 2 % [m]."""
    return RELATIVE_SIZE * 0.5e-3 * scene.indenter.width_mm_projected


def section_for(scene: Scene, x_m: float, max_depth_m: float) -> Section:
    """The mesh that a station is solved on."""
    size_m = element_size_m(scene)
    usual = usual_grading(size_m)
    grading = usual._replace(growth=GROWTH, coarsest_m=COARSEST * 1e-3 * scene.surface_mm)
    return build_section(scene, x_m, depth_m=max_depth_m, size_m=size_m, grading=grading)


@lru_cache(maxsize=256)
def _respond(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    section = section_for(scene, x_m, max_depth_m)
    beats = bool(section.lumens)
    rest, low, high = levels_pa(scene) if beats else (0.0, 0.0, 0.0)
    start = unloaded(section)
    bulge = 0.0
    if beats:
        (start,) = continuation(section, start, [Load(-max_depth_m, rest)])
        bulge = _surface_m(section, start)
    loads = [Load(max_depth_m * share, rest) for share in DEPTHS]
    if max_depth_m * DEPTHS[0] + bulge <= 0:  # beside a lone vessel: its first step is in the air
        loads = [load for load in loads if load.depth_m + bulge > 0]
    if not loads:
        return _untouched(scene, x_m, max_depth_m, bulge)
    ramp = list(continuation(section, start, loads))
    by_depth, by_pressure = zip(*(slopes(section, state) for state in ramp), strict=True)
    ends = _ends(section, ramp[-1], by_pressure[-1], low, high) if beats else []
    sunk = np.array([load.depth_m + bulge for load in loads])

    def curve(
        values: list[float], over_depth: list[float], over_pressure: list[float], at: list[float]
    ) -> _Curve:
        powers = _gain([s.load.pressure_pa - rest for s in ends], values[-1], over_pressure[-1], at)
        return _Curve(
            from_nothing(sunk, np.array(values), np.array(over_depth)),
            monotone(np.append(0.0, sunk), np.append(0.0, over_pressure)),
            rest, low, high, powers,
        )  # fmt: skip

    force = curve(
        [s.force_n_per_m for s in ramp],
        [one.force_n_per_m for one in by_depth],
        [one.force_n_per_m for one in by_pressure],
        [s.force_n_per_m for s in ends],
    )
    stress = curve(
        [under_finger_pa(section, s.displacement) for s in ramp],
        [_stress_slope(section, *one, PROBE_M) for one in zip(ramp, by_depth, strict=True)],
        [_stress_slope(section, *one, PROBE_PA) for one in zip(ramp, by_pressure, strict=True)],
        [under_finger_pa(section, s.displacement) for s in ends],
    )
    length_m = 1e-3 * scene.indenter.length_mm
    return StationResponse(x_m, max_depth_m, length_m, bulge, force, stress)


def _untouched(scene: Scene, x_m: float, max_depth_m: float, bulge_m: float) -> StationResponse:
    """Of a place at which the finger, as deep as it goes, touches nothing."""
    flat = from_nothing(np.array([max_depth_m]), np.zeros(1), np.zeros(1))
    _, low, high = levels_pa(scene)
    nothing = _Curve(flat, flat, low, low, high, np.zeros(1))
    length_m = 1e-3 * scene.indenter.length_mm
    return StationResponse(x_m, max_depth_m, length_m, bulge_m, nothing, nothing)


def levels_pa(scene: Scene) -> tuple[float, float, float]:
    """Resting pressure, then the ends of the wave [Pa]."""
    low, high = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
    rest = low + 0.25 * (high - low)
    return rest * PA_PER_MMHG, low * PA_PER_MMHG, high * PA_PER_MMHG


def _ends(
    section: Section, deepest: Solution, slope: Slope, low_pa: float, high_pa: float
) -> list[Solution]:
    """The deepest state at systole; and at diastole, where the pulse bends much on the way up or a
    lumen seems to close on the way down."""
    depth_m, rest_pa = deepest.load.depth_m, deepest.load.pressure_pa
    (high,) = continuation(section, deepest, [Load(depth_m, high_pa)])
    straight = slope.force_n_per_m * (high_pa - rest_pa)
    bent = abs(high.force_n_per_m - deepest.force_n_per_m - straight) > BEND * abs(straight)
    low_u = deepest.displacement + (low_pa - rest_pa) * slope.displacement
    if not bent and not walls_cross(section, low_u):
        return [high]
    return [high, *continuation(section, deepest, [Load(depth_m, low_pa)])]


def _gain(over_rest_pa: list[float], value: float, slope: float, at: list[float]) -> Array:
    """Coefficients of the polynomial that is 0 with slope 1 at rest, and gives ``value`` plus
    ``slope`` times it at pressures ``over_rest_pa``, where the quantity is ``at``."""
    if not at or slope == 0:
        return np.array([1.0, 0.0])
    p = np.array(over_rest_pa)
    bends = np.linalg.solve(np.vander(p, len(p)), ((np.array(at) - value) / slope - p) / p**2)
    return np.concatenate([bends, [1.0, 0.0]])


def _surface_m(section: Section, solution: Solution) -> float:
    """How far the surface rises under the finger, on which it will first touch."""
    surface = section.mesh.surface
    gap, _, _ = section.finger.gap(section.mesh.nodes[surface] + solution.displacement[surface])
    return float(-gap.min())


def _stress_slope(section: Section, solution: Solution, slope: Slope, step: float) -> float:
    ahead = under_finger_pa(section, solution.displacement + step * slope.displacement)
    return (ahead - under_finger_pa(section, solution.displacement)) / step
