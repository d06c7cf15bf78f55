"""A plane section's answer at one place, for any depth and lumen pressure.

One ramp is solved at the resting pressure, with the exact slopes by depth and by pressure along it;
at the full depth the ends of the wave are solved as well, as far as they are needed. Between them
    F(d, p) = F(d, rest) + dF/dp(d) g(p),   g(p) = (F(D, p) - F(D, rest)) / dF/dp(D),
which is exact at the full depth D and to first order elsewhere. Where g bends much, as near the
pressure at which a wall inflates without bound, the ends are solved at each depth of the ramp. Time
does not enter: relaxation and the beat are the phantom's.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import down, filled
from sim_backend.fem.lumen import flatness
from sim_backend.fem.model import build_section, usual_grading
from sim_backend.fem.newton import CannotSolve, Load, Solution
from sim_backend.fem.section import Section
from sim_backend.fem.sensitivity import Slope, slopes
from sim_backend.fem.stress import under_finger_pa
from sim_backend.models.curve import from_nothing, monotone
from sim_backend.models.response import Curve, Left, StationResponse, levels_pa
from sim_backend.scene.scene_file import Scene

DEPTHS = np.array([0.04, 0.2, 0.55, 1.0])
"""Shares of the greatest depth that are solved. Between them forces of TIHA and TIT are within
0.09 % of the greatest, nearly as with seven shares and no slopes (0.06 %)."""
BEND = 0.05
"""Share of a pulse from rest to systole by which it may bend before diastole is solved too. A bend
of 0.03 (TIHA) leaves 0.2 % of the pulse."""
PROBE_PA, PROBE_M = 10.0, 1e-6
"""Steps of the stress's slopes by pressure and depth, along the exact displacement slopes."""
MUCH = 0.2
"""The same from which the ends are solved at each depth, for half as much time again. Of 50 random
presses over soft walls (benchmarks/soft_walls.py at c51866cd) pulses that bend less are up to 5.4 %
off at half the depth; those that bend more would be up to 20 %, 2.5 times what is stated, and are
up to 6 %, 0.5 times."""
RELATIVE_SIZE = 0.1
"""Element size over the finger's half width: 0.3 % of force, 2 % of pulse on the paper's scenes."""
GROWTH, COARSEST = 0.6, 0.24
"""How fast elements grow away from contact and vessels, and the largest over the height: that saves
a third of the time of `usual_grading`, for 0.15 % of the force at most."""
LEFT = Left(rest=0.006, change=0.03, between=0.0015)
"""The figures above, added. The change's grows with the square of how flat a lumen is pressed, as
that of `sim_backend.models.refine`."""


def element_size_m(scene: Scene) -> float:
    """Element size that keeps force within about 0.3 % and pulse within 2 % [m]."""
    return RELATIVE_SIZE * scene.indenter.profile.scale


def section_for(scene: Scene, x_m: float, max_depth_m: float) -> Section:
    """The mesh that stations, their pictures and touch tables are solved on."""
    size_m = element_size_m(scene)
    usual = usual_grading(size_m)
    grading = usual._replace(growth=GROWTH, coarsest_m=COARSEST * 1e-3 * scene.surface_mm)
    return build_section(scene, x_m, depth_m=max_depth_m, size_m=size_m, grading=grading)


def respond_plane(scene: Scene, x_m: float, max_depth_m: float) -> StationResponse:
    """The answer of ``scene`` at ``x_m`` [m] down to ``max_depth_m`` [m].

    Raises `sim_backend.fem.newton.CannotSolve` where physics ends.
    """
    section = section_for(scene, x_m, max_depth_m)
    beats = bool(section.lumens)
    rest, low, high = levels_pa(scene) if beats else (0.0, 0.0, 0.0)
    start, bulge = filled(section, rest, max_depth_m)
    loads = [Load(max_depth_m * share, rest) for share in DEPTHS]
    if max_depth_m * DEPTHS[0] + bulge <= 0:  # beside a lone vessel: its first step is in the air
        loads = [load for load in loads if load.depth_m + bulge > 0]
    if not loads:
        return _untouched(scene, x_m, max_depth_m, bulge)
    ramp, along = zip(
        *((state, slopes(section, state)) for state in down(section, start, loads)),
        strict=True,
    )
    by_depth, by_pressure = zip(*along, strict=True)
    ends = _ends(section, ramp, by_pressure, low, high) if beats else [[] for _ in ramp]
    sunk = np.array([load.depth_m + bulge for load in loads])

    def curve(
        of: Callable[[Solution], float], values: list[float], over_depth: list[float],
        over_pressure: list[float],
    ) -> Curve:  # fmt: skip
        powers = _powers(values, over_pressure, [
            [(s.load.pressure_pa - rest, of(s)) for s in some] for some in ends
        ])  # fmt: skip
        return Curve(
            from_nothing(sunk, np.array(values), np.array(over_depth)),
            tuple(monotone(np.append(0.0, sunk), np.append(0.0, one)) for one in powers),
            rest, low, high,
        )  # fmt: skip

    def stress_pa(state: Solution) -> float:
        return under_finger_pa(section, state.displacement)

    force = curve(
        lambda state: state.force_n_per_m,
        [state.force_n_per_m for state in ramp],
        [one.force for one in by_depth],
        [one.force for one in by_pressure],
    )

    on_ramp = [stress_pa(state) for state in ramp]

    def stress_slopes(along: tuple[Slope, ...], step: float) -> list[float]:
        return [
            (under_finger_pa(section, state.displacement + step * slope.displacement) - here) / step
            for state, slope, here in zip(ramp, along, on_ramp, strict=True)
        ]

    stress = curve(
        stress_pa,
        on_ramp,
        stress_slopes(by_depth, PROBE_M),
        stress_slopes(by_pressure, PROBE_PA),
    )
    length_m = 1e-3 * scene.indenter.length_mm
    deepest = [ramp[-1], *ends[-1]]
    flat = max(flatness(section.lumens, state.displacement) for state in deepest)
    left = LEFT._replace(change=LEFT.change * flat**2) if scene.tissue else LEFT
    return StationResponse(x_m, max_depth_m, length_m, bulge, force, stress, left)


def _untouched(scene: Scene, x_m: float, max_depth_m: float, bulge_m: float) -> StationResponse:
    """Of a place at which the finger, as deep as it goes, touches nothing."""
    flat = from_nothing(np.array([max_depth_m]), np.zeros(1), np.zeros(1))
    _, low, high = levels_pa(scene)
    nothing = Curve(flat, (), low, low, high)
    length_m = 1e-3 * scene.indenter.length_mm
    return StationResponse(x_m, max_depth_m, length_m, bulge_m, nothing, nothing, LEFT)


def _ends(
    section: Section, ramp: Sequence[Solution], slopes: Sequence[Slope], low_pa: float,
    high_pa: float,
) -> list[list[Solution]]:  # fmt: skip
    """The deepest state at systole; and at diastole, where the pulse bends on the way up or a lumen
    seems to close on the way down. Where it bends `MUCH`, all states at both."""
    deepest, slope = ramp[-1], slopes[-1]
    rest_pa = deepest.load.pressure_pa
    high = _at(section, deepest, slope, high_pa)
    straight = slope.force * (high_pa - rest_pa)
    bend = abs(high.force_n_per_m - deepest.force_n_per_m - straight)
    low_u = deepest.displacement + (low_pa - rest_pa) * slope.displacement
    above: list[list[Solution]] = [[] for _ in ramp[:-1]]
    if bend > MUCH * abs(straight):
        above = [
            [_at(section, *one, pressure_pa) for pressure_pa in (high_pa, low_pa)]
            for one in zip(ramp[:-1], slopes[:-1], strict=True)
        ]
    elif bend <= BEND * abs(straight) and not section.walls_cross(low_u):
        return [*above, [high]]
    return [*above, [high, _at(section, deepest, slope, low_pa)]]


def _at(section: Section, state: Solution, slope: Slope, pressure_pa: float) -> Solution:
    """The state at another pressure, begun where the exact slope points, which saves one
    factorisation of four."""
    ahead = state.displacement + (pressure_pa - state.load.pressure_pa) * slope.displacement
    load = Load(state.load.depth_m, pressure_pa)
    try:
        (found,) = continuation(section, replace(state, displacement=ahead), [load])
    except CannotSolve:  # the slope points far off: then step by step from the state itself
        (found,) = continuation(section, state, [load])
    return found


def _powers(
    values: list[float], slopes: list[float], ends: list[list[tuple[float, float]]]
) -> list[Array]:
    """What each power of the pressure over rest adds at each depth: the first its slope there, the
    others what leads through the ``ends``, (pressure over rest, value). Where there are none, the
    first's share is the deepest's."""
    found = []
    for value, slope, some in zip(values, slopes, ends, strict=True):
        p, at = np.array(some).reshape(-1, 2).T
        bends = np.linalg.solve(np.vander(p, increasing=True), (at - value - slope * p) / p**2)
        found.append(np.append(slope, bends))
    deepest = found[-1]
    shares = deepest / deepest[0] if deepest[0] else np.eye(len(deepest))[0]
    return list(np.array([
        one if len(one) == len(deepest) else one[0] * shares for one in found
    ]).T)  # fmt: skip
