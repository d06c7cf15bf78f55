"""A section's answer at one place, for any depth and lumen pressure: what the phantom feels.

One ramp is solved at the resting pressure, with the exact slope by pressure along it; at the full
depth a few pressures are solved as well. Between them
    F(d, p) = F(d, rest) + dF/dp(d) g(p),   g(p) = (F(D, p) - F(D, rest)) / dF/dp(D),
which is exact at the full depth D and to first order elsewhere. Time does not enter: relaxation
and the beat are the phantom's.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.continuation import continuation, unloaded
from sim_backend.fem.model import Section, build_section, usual_grading
from sim_backend.fem.newton import Load, Solution, pressure_slope
from sim_backend.fem.stress import under_finger_pa
from sim_backend.scene.scene_file import Scene, mirrored
from sim_backend.scene.waves import PA_PER_MMHG

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

DEPTHS = np.array([0.04, 0.12, 0.25, 0.42, 0.6, 0.8, 1.0])
"""Shares of the greatest depth that are solved."""
PRESSURE_SLACK = 0.02
"""Share of the wave's span that a pressure may lie outside it: a wave is sampled."""
PROBE_PA = 10.0
"""Pressure step of the stress's slope, along the exact displacement slope."""
RELATIVE_SIZE = 0.1
"""Element size over the finger's half width: 0.3 % of force, 2 % of pulse on the paper's scenes."""
GROWTH, COARSEST = 0.6, 0.24
"""How fast elements grow away from contact and vessels, and the largest over the height: that saves
a third of the time of `usual_grading`, for 0.15 % of the force at most."""


@dataclass(frozen=True)
class StationResponse:
    """Answers at one place down to ``max_depth_m``.

    ``bulge_m``: how far the resting pressure lifts the surface; contact begins there. ``share``
    is F(d, rest) / (d + bulge) and its slope by pressure; both with the stress.
    """

    x_m: float
    max_depth_m: float
    length_m: float
    bulge_m: float
    force: "_Curve"
    stress: "_Curve"

    def force_n(self, depth_m: Array, pressure_pa: Array) -> Array:
        """Normal force [N] on the whole finger; both arguments broadcast, 0 out of contact.

        Raises ValueError deeper than ``max_depth_m`` or for pressures outside the wave.
        """
        return self.length_m * self._at(self.force, depth_m, pressure_pa)

    def von_mises_pa(self, depth_m: Array, pressure_pa: Array) -> Array:
        """Von Mises stress [Pa] at the surface under the finger; arguments as `force_n`."""
        return self._at(self.stress, depth_m, pressure_pa)

    def _at(self, curve: "_Curve", depth_m: Array, pressure_pa: Array) -> Array:
        depth = np.asarray(depth_m, dtype=float)
        if np.any(depth > self.max_depth_m * (1 + 1e-9)):
            raise ValueError(
                f"depth {1e3 * depth.max():.4g} mm is beyond the {1e3 * self.max_depth_m:.4g} mm "
                "that were solved"
            )
        sunk = np.maximum(depth + self.bulge_m, 0.0)
        pressure = np.asarray(pressure_pa)
        if curve.beyond(pressure):
            raise ValueError(
                f"a pressure of {pressure.min() / PA_PER_MMHG:.4g} to "
                f"{pressure.max() / PA_PER_MMHG:.4g} mmHg is beyond the wave that was solved"
            )
        value = curve.rest(sunk) + curve.slope(sunk) * curve.gain(pressure)
        return np.asarray(np.where(sunk > 0, np.maximum(value, 0.0), 0.0))


@dataclass(frozen=True)
class _Curve:
    """A quantity over sunk depth at rest, its slope by pressure, and the gain g(p)."""

    rest: "PchipInterpolator"
    slope: "PchipInterpolator"
    pressures: Array
    gains: Array

    def beyond(self, pressure_pa: Array) -> bool:
        """Whether any pressure lies clearly outside what was solved."""
        if len(self.pressures) == 1:
            return False
        low, high = self.pressures.min(), self.pressures.max()
        slack = PRESSURE_SLACK * (high - low)
        return bool((pressure_pa < low - slack).any() or (pressure_pa > high + slack).any())

    def gain(self, pressure_pa: Array) -> Array:
        if len(self.pressures) == 1:
            return np.zeros_like(pressure_pa)
        scale = self.pressures[0]
        through = np.polyfit(self.pressures / scale, self.gains, len(self.pressures) - 1)
        return np.asarray(np.polyval(through, pressure_pa / scale))


def respond(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    """The answer of ``scene`` at ``x_m`` [m] down to ``max_depth_m`` [m].

    A scene that is its own mirror image is solved on its left half only. Raises
    `sim_backend.fem.newton.CannotSolve` where physics ends.
    """
    x_m = round(x_m, 9)
    if scene.tissue is not None and mirrored(scene) == scene:
        width = 1e-3 * scene.tissue.width_mm
        x_m = round(min(x_m, width - x_m), 9)
    return _respond(scene, x_m, round(max_depth_m, 9))


def element_size_m(scene: Scene) -> float:
    """Element size that keeps force within about 0.3 % and pulse within 2 % [m]."""
    return RELATIVE_SIZE * 0.5e-3 * scene.indenter.width_mm_projected


@lru_cache(maxsize=256)
def _respond(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    size_m = element_size_m(scene)
    usual = usual_grading(size_m)
    grading = usual._replace(growth=GROWTH, coarsest_m=COARSEST * 1e-3 * scene.surface_mm)
    section = build_section(scene, x_m, depth_m=max_depth_m, size_m=size_m, grading=grading)
    beats = bool(section.lumens)
    levels = _pressures(scene) if beats else np.zeros(1)
    rest = float(levels[0])
    loads = [Load(max_depth_m * share, rest) for share in DEPTHS]
    start = unloaded(section)
    bulge = 0.0
    if beats:
        (start,) = continuation(section, start, [Load(-max_depth_m, rest)])
        bulge = _surface_m(section, start)
    if max_depth_m * DEPTHS[0] + bulge <= 0:  # beside a lone vessel: its first step is in the air
        loads = [load for load in loads if load.depth_m + bulge > 0]
    if not loads:
        return _untouched(scene, x_m, max_depth_m, bulge)
    ramp = list(continuation(section, start, loads))
    deepest = list(continuation(section, ramp[-1], [Load(max_depth_m, p) for p in levels[1:]]))
    sunk = np.array([0.0, *(load.depth_m + bulge for load in loads)])
    slopes = [pressure_slope(section, s) for s in ramp] if beats else []
    force = _curve(
        sunk,
        [s.force_n_per_m for s in ramp],
        [slope for _, slope in slopes],
        levels,
        [s.force_n_per_m for s in deepest],
    )
    stress = _curve(
        sunk,
        [under_finger_pa(section, s.displacement) for s in ramp],
        [_stress_slope(section, s, du) for s, (du, _) in zip(ramp, slopes, strict=False)],
        levels,
        [under_finger_pa(section, s.displacement) for s in deepest],
    )
    length_m = 1e-3 * scene.indenter.length_mm
    return StationResponse(x_m, max_depth_m, length_m, bulge, force, stress)


def _untouched(scene: Scene, x_m: float, max_depth_m: float, bulge_m: float) -> StationResponse:
    """Of a place at which the finger, as deep as it goes, touches nothing."""
    nothing = _curve(np.array([0.0, max_depth_m]), [0.0], [], np.zeros(1), [])
    length_m = 1e-3 * scene.indenter.length_mm
    return StationResponse(x_m, max_depth_m, length_m, bulge_m, nothing, nothing)


def _pressures(scene: Scene) -> Array:
    """Resting pressure first, then the ends of the wave [Pa]."""
    low, high = scene.pulse.diastolic_mmhg, scene.pulse.systolic_mmhg
    rest = low + 0.25 * (high - low)
    return np.array([rest, low, high]) * PA_PER_MMHG


def _surface_m(section: Section, solution: Solution) -> float:
    """How far the surface rises under the finger, on which it will first touch."""
    surface = section.mesh.surface
    gap, _, _ = section.finger.gap(section.mesh.nodes[surface] + solution.displacement[surface])
    return float(-gap.min())


def _stress_slope(section: Section, solution: Solution, slope: Array) -> float:
    ahead = under_finger_pa(section, solution.displacement + PROBE_PA * slope)
    return (ahead - under_finger_pa(section, solution.displacement)) / PROBE_PA


def _curve(
    sunk: Array, values: list[float], slopes: list[float], levels: Array, deepest: list[float]
) -> _Curve:
    from scipy.interpolate import PchipInterpolator  # here: the import takes as long as a press

    rest = PchipInterpolator(sunk, [0.0, *values])
    if not slopes:
        return _Curve(rest, PchipInterpolator(sunk, np.zeros_like(sunk)), levels, np.zeros(1))
    gains = (np.array([values[-1], *deepest]) - values[-1]) / slopes[-1]
    return _Curve(rest, PchipInterpolator(sunk, [0.0, *slopes]), levels, gains)
