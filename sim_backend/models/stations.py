"""A station solved: the answer at one place for any depth and lumen pressure, of any kind of body.

One ramp is solved at the resting pressure; at the full depth the ends of the wave are solved as
well, as far as they are needed. Between them
    F(d, p) = F(d, rest) + s(d) g(p),
g being the full depth's and s what is known of the pressure at depth d: its exact slope, or the end
of the wave that is solved there too. Where g bends much, as near the pressure at which a wall
inflates without bound, both ends are solved at each depth. Time does not enter: relaxation and the
beat are the phantom's.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import ceil, inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sim_backend.arrays import Array
from sim_backend.fem.body import Body
from sim_backend.fem.continuation import continuation, judged, stable_branch
from sim_backend.fem.finite_strain import down, filled
from sim_backend.fem.model import build_section, usual_grading
from sim_backend.fem.newton import CannotSolve, Load, Solution, Unstable
from sim_backend.fem.section import Section
from sim_backend.fem.sensitivity import Slope, slopes
from sim_backend.fem.solid.body import SolidBody
from sim_backend.fem.solid.build import build_body, half_width_m
from sim_backend.fem.solid.solve import STEP
from sim_backend.models.curve import from_nothing, monotone
from sim_backend.models.kept_tables import kept_table
from sim_backend.models.kinds import SECTION, SOLID, BodyKind
from sim_backend.models.response import Curve, Left, Station, StationResponse, levels_pa
from sim_backend.models.solid_meshes import SHARES
from sim_backend.models.station_taxels import TAXELS, taxel_table
from sim_backend.models.taxel_shares import TaxelShares
from sim_backend.scene.scene_file import Scene

DEPTHS = np.array([0.04, 0.2, 0.55, 1.0])
"""Shares of the greatest depth at which a section is solved. Between them forces of TIHA and TIT
are within 0.09 % of the greatest, nearly as with seven shares and no slopes (0.06 %)."""
SOLID_DEPTHS = np.array([0.2, 0.4, 0.6, 0.8, 1.0])
"""Those of a solid. The first is 0.5 mm of the usual 2.5: a contact that is narrower than two
elements is resolved too roughly."""
TAXEL_DEPTHS = np.array([0.04, 0.1, 0.2, 0.38, 0.55, 0.7, 0.85, 1.0])
"""Those at which a section's taxels are read. Between them taxels of 1.25 mm over TIHA are within
1.2 % of the largest of the deepest press (four depths: 6 %, ten: 0.8 %)."""
AT_SYSTOLE = (0, 2, 4)
"""Numbers of those at which systole is solved too."""
BEND, MUCH = 0.05, 0.2
"""Share of a pulse from rest to systole by which it may bend before diastole is solved too, and
from which both ends are solved at each depth, for half as much time again. A bend of 0.03 (TIHA)
leaves 0.2 % of the pulse. Of 50 random presses over soft walls (benchmarks/soft_walls.py at
c51866cd) pulses that bend less than `MUCH` are up to 5.4 % off at half the depth; those that bend
more would be up to 20 %, 2.5 times what is stated, and are up to 6 %, 0.5 times."""
PROBE_PA, PROBE_M = 10.0, 1e-6
"""Steps of the stress's slopes by pressure and depth, along the exact displacement slopes."""
RELATIVE_SIZE = 0.1
"""Element size over the finger's half width: 0.3 % of force, 2 % of pulse on the paper's scenes."""
GROWTH, COARSEST = 0.6, 0.24
"""How fast elements grow away from contact and vessels, and the largest over the height: that saves
a third of the time of `usual_grading`, for 0.15 % of the force at most."""
LEFT = Left(rest=0.006, change=0.03, between=0.0015)
"""The figures above, added. The change's grows with the square of how flat a lumen is pressed, as
that of `sim_backend.models.section_meshes`."""
SOLID_LEFT = Left(rest=0.05, change=0.05, between=0.01, faint=0.0015)
"""TIHA under a ball: from this mesh to the next the force changes by 1.7 %, which leaves 3.8 % at
the rate of `refine.ORDER`, and the pulse by 0.1 %, which one scene cannot promise to others;
between depths 0.2 % of the deepest. 20 mm beside TIHA's vessel under the cylinder the pulse is
0.9 mN of 8.3 off at 0.87 N, 0.11 % of the force."""
ARRAYS = ("sunk", "values", "by_depth", "powers", "bulge", "flat")
"""What `solve_station` answers."""


@dataclass(frozen=True)
class Way:
    """How stations of a plane are solved, as a ``kind`` of body and named as presses' ``model``.

    ``body_for`` is the mesh of a place for all depths down to one; ``depths`` are shares of the
    greatest, solved in steps of ``longest_m``, and for an array at ``taxel_depths`` too. With
    ``exact`` slopes by depth and pressure are the tangent's; else elements are too coarse for
    those, and by depth they are powers'. ``ends`` are the states at each depth at other pressures
    than at rest. ``left`` is what may be missed; answers that take long are ``kept`` on disk.
    """

    model: str
    kind: BodyKind
    body_for: Callable[[Scene, float, float], Any]
    depths: Array
    taxel_depths: Array
    longest_m: Callable[[Scene], float]
    exact: bool
    ends: Callable[..., list[list[Solution]]]
    left: Left
    kept: bool


def solved(one: Station) -> StationResponse:
    """The answer of a station. Raises `CannotSolve` where physics ends, and `SceneError` where
    elements cannot be made."""
    way = WAYS[one.scene.plane]
    names = ARRAYS + (TAXELS if one.array is not None else ())
    tables = [
        kept_table(path, names, partial(solve_station, part)) if way.kept else solve_station(part)
        for part, path in one.parts
    ]
    table = {key: np.mean([part[key] for part in tables], axis=0) for key in names}
    rest, low, high = levels_pa(one.scene)
    touched = np.append(0.0, table["sunk"])

    def curve(which: int) -> Curve:
        powers = (
            monotone(touched[np.append(True, at)], np.append(0.0, power[at]))
            for power in table["powers"][which]
            for at in [np.isfinite(power)]
        )
        at_rest = from_nothing(table["sunk"], table["values"][which], table["by_depth"][which])
        beats = bool(one.scene.arteries)
        return Curve(at_rest, tuple(powers), *((rest, low, high) if beats else (0.0, 0.0, 0.0)))

    left = way.left._replace(change=way.left.change * float(table["flat"]) ** 2)
    return StationResponse(
        one.x_m, one.max_depth_m, way.kind.length_m(one.scene), float(table["bulge"]), curve(0),
        curve(1), left, TaxelShares(*(table[key] for key in TAXELS)) if one.array else None,
    )  # fmt: skip


def solve_station(one: Station) -> dict[str, Array]:
    """Of force [N/m], or [N] in space, and stress [Pa]: ``values`` (2, d) and their slopes
    ``by_depth`` at rest, ``sunk`` (d,) [m] into the surface that rest lifts by the ``bulge``, and
    what each of k ``powers`` (2, k, d) of the pressure over rest adds, NaN where it was not solved.
    ``flat``: how flat lumens are pressed. With an array `TAXELS`. Raises `CannotSolve`."""
    scene, x_m, deepest_m, array = one
    way = WAYS[scene.plane]
    body = way.body_for(scene, x_m, deepest_m)
    rest, low, high = levels_pa(scene) if body.lumens else (0.0, 0.0, 0.0)
    start, bulge = filled(body, rest, deepest_m)
    # beside a lone vessel the first step is in the air
    depths = [float(d) for d in deepest_m * way.depths if d + bulge > 0]
    if not depths:
        nothing = np.zeros((2, 1))
        found = _arrays([deepest_m], nothing, nothing, np.zeros((2, 0, 1)), bulge, 1.0)
        return found | (taxel_table(one, way.kind, body, bulge, [], [], []) if array else {})
    ramp: list[Solution] = []
    seen: list[Solution] = []
    tilts: list[tuple[Slope, Slope]] = []
    stops = [float(d) for d in deepest_m * way.taxel_depths if array and d + bulge > 0]
    stops = sorted({*depths, *stops})
    steps = [Load(d, rest) for d in _steps(stops, way.longest_m(scene))]
    for state, load in zip(down(body, start, steps), steps, strict=True):
        seen.append(state)
        if load.depth_m in depths:
            ramp.append(state)
            if way.exact:  # cheapest just after it
                tilts.append(slopes(body, state))
    ramp[-1] = seen[-1] = _stable(body, ramp[-1], way.left.rest, x_m)
    ends = way.ends(body, ramp, tilts, low, high) if body.lumens else [[] for _ in ramp]
    sunk = np.array(depths) + bulge

    def read(state: Solution) -> Array:
        return np.array([state.force, way.kind.von_mises_pa(body, state.displacement)])

    def along(state: Solution, slope: Slope, step: float) -> Array:
        ahead = replace(state, displacement=state.displacement + step * slope.displacement)
        return np.array([slope.force, (read(ahead) - read(state))[1] / step])

    values = np.array([read(state) for state in ramp])
    if way.exact:
        by_depth, by_pressure = (
            np.array([along(state, both[k], step) for state, both in zip(ramp, tilts, strict=True)])
            for k, step in enumerate((PROBE_M, PROBE_PA))
        )
    else:
        by_depth = np.stack([_slopes_of_powers(sunk, value) for value in values.T], axis=1)
        by_pressure = np.full_like(values, np.nan)
    over = [np.array([end.load.pressure_pa - rest for end in some]) for some in ends]
    changes = [
        np.reshape([read(end) - value for end in some], (-1, 2))
        for some, value in zip(ends, values, strict=True)
    ]
    powers = [
        _powers(over, [change[:, k] for change in changes], by_pressure[:, k])
        for k in range(2) if body.lumens
    ]  # fmt: skip
    flat = 1.0
    if scene.tissue is not None:
        deepest = (ramp[-1], *ends[-1])
        flat = max(way.kind.flatness(body.lumens, state.displacement) for state in deepest)
    found = _arrays(sunk, values.T, by_depth.T, powers or np.zeros((2, 0, 1)), bulge, flat)
    if array is None:
        return found
    crests = [next((end for end in some if end.load.pressure_pa == high), None) for some in ends]
    if way.exact and body.lumens:
        crests = [
            crest or _at(body, state, slope, high)
            for crest, state, (_, slope) in zip(crests, ramp, tilts, strict=True)
        ]
    return found | taxel_table(one, way.kind, body, bulge, seen, ramp, crests)


def _arrays(*of: ArrayLike) -> dict[str, Array]:
    return {name: np.asarray(one, dtype=float) for name, one in zip(ARRAYS, of, strict=True)}


def _steps(depths: Sequence[float], longest_m: float) -> list[float]:
    """The depths, and as many between as no step is longer than from one to the next."""
    between = max(1, ceil(depths[0] / longest_m))
    return [
        b if k == between else a + (b - a) * k / between
        for a, b in pairwise([0.0, *depths]) for k in range(1, between + 1)
    ]  # fmt: skip


def _stable(body: Body, deepest: Solution, most: float, x_m: float) -> Solution:
    """The deepest state, or the stable one that it falls to, where that changes the force by no
    more than the share ``most``: a node that slides over an edge of the finger."""
    if deepest.stable is not None or judged(body, deepest).stable is not False:
        return deepest
    with suppress(Unstable):
        stable = stable_branch(body, deepest)
        if abs(stable.force / deepest.force - 1) <= most:
            return stable
    raise CannotSolve(
        "stability",
        f"{1e3 * deepest.load.depth_m:g} mm deep at x = {1e3 * x_m:g} mm the body is unstable: it "
        "would give way sideways. Press less deep.",
    )


def _bending_ends(
    body: Body, ramp: Sequence[Solution], along: Sequence[tuple[Slope, Slope]], low_pa: float,
    high_pa: float,
) -> list[list[Solution]]:  # fmt: skip
    """The deepest state at systole; and at diastole, where the pulse bends on the way up or a lumen
    seems to close on the way down. Where it bends `MUCH`, all states at both."""
    both = [(state, slope) for state, (_, slope) in zip(ramp, along, strict=True)]
    deepest, slope = both[-1]
    rest_pa = deepest.load.pressure_pa
    high = _at(body, deepest, slope, high_pa)
    straight = slope.force * (high_pa - rest_pa)
    bend = abs(high.force - deepest.force - straight)
    low_u = deepest.displacement + (low_pa - rest_pa) * slope.displacement
    above: list[list[Solution]] = [[] for _ in ramp[:-1]]
    if bend > MUCH * abs(straight):
        above = [[_at(body, *one, end_pa) for end_pa in (high_pa, low_pa)] for one in both[:-1]]
    elif bend <= BEND * abs(straight) and not body.walls_cross(low_u):
        return [*above, [high]]
    return [*above, [high, _at(body, deepest, slope, low_pa)]]


def _chosen_ends(
    body: Body, ramp: Sequence[Solution], _along: object, low_pa: float, high_pa: float
) -> list[list[Solution]]:
    """The deepest state at diastole, and those of `AT_SYSTOLE` there."""
    ends: list[list[Solution]] = [[] for _ in ramp]
    for k, pressure_pa in ((-1, low_pa), *((k, high_pa) for k in AT_SYSTOLE[::-1])):
        load = Load(ramp[k].load.depth_m, pressure_pa)
        ends[k].insert(0, next(continuation(body, ramp[k], [load])))
    return ends


def _at(body: Body, state: Solution, slope: Slope, pressure_pa: float) -> Solution:
    """The state at another pressure, begun where the exact slope points, which saves one
    factorisation of four."""
    ahead = state.displacement + (pressure_pa - state.load.pressure_pa) * slope.displacement
    load = Load(state.load.depth_m, pressure_pa)
    try:
        return next(continuation(body, replace(state, displacement=ahead), [load]))
    except CannotSolve:  # the slope points far off: then step by step from the state itself
        return next(continuation(body, state, [load]))


def _powers(over: Sequence[Array], changes: Sequence[Array], slopes: Array) -> Array:
    """What each power of the pressure over rest adds at each depth (k, d): what leads through the
    ``changes`` that are known ``over`` rest there, and the slope (d,) if that is. Where less is
    known than at the deepest, that one's are scaled; NaN where nothing is."""

    def through(p: Array, change: Array, slope: float) -> Array:
        known = [] if np.isnan(slope) else [slope]
        rest = (change / p - (slope if known else 0.0)) / p ** len(known)
        return np.append(known, np.linalg.solve(np.vander(p, increasing=True), rest))

    *_, deepest = map(through, over, changes, slopes)
    powers = np.full((len(deepest), len(slopes)), np.nan)
    for k, (p, change, slope) in enumerate(zip(over, changes, slopes, strict=True)):
        here = through(p, change, slope)
        if 0 < len(here) < len(deepest):  # by the secant to the first that is known, at 0 the slope
            secant = np.polyval(deepest[::-1], p[0] if np.isnan(slope) else 0.0)
            here = here[0] * (deepest / secant if secant else np.eye(len(deepest))[0])
        if len(here):
            powers[:, k] = here
    return powers


def _slopes_of_powers(x: Array, y: Array) -> Array:
    """Of ``y`` (n,) at ``x`` (n,), n > 2: the exponent of the power of x between two of them, and
    at them a parabola's through three (a ball's first is 3/2: Hertz; Johnson 1985, eq. 4.22)."""
    exponent = np.gradient(np.log(np.maximum(y, 1e-12)), np.log(x), edge_order=2)
    return np.asarray(np.maximum(exponent, 0.0) * y / x)


def element_size_m(scene: Scene) -> float:
    """Element size that keeps force within about 0.3 % and pulse within 2 % [m]."""
    return RELATIVE_SIZE * scene.indenter.profile.scale


def section_for(scene: Scene, x_m: float, max_depth_m: float) -> Section:
    """The mesh that a section's stations, their pictures and touch tables are solved on."""
    size_m = element_size_m(scene)
    usual = usual_grading(size_m)
    grading = usual._replace(growth=GROWTH, coarsest_m=COARSEST * 1e-3 * scene.surface_mm)
    return build_section(scene, x_m, depth_m=max_depth_m, size_m=size_m, grading=grading)


def solid_for(scene: Scene, x_m: float, max_depth_m: float) -> SolidBody:
    """The mesh that a solid's stations and their pictures are solved on: the first of a press."""
    size_m = SHARES[0] * half_width_m(scene)
    return build_body(scene, x_m, depth_m=max_depth_m, size_m=size_m)


def _solid_step_m(scene: Scene) -> float:
    return STEP * half_width_m(scene)


_OF_SECTIONS = Way(
    "finite", SECTION, section_for, DEPTHS, TAXEL_DEPTHS, lambda _: inf, True, _bending_ends, LEFT,
    kept=False,
)  # fmt: skip
WAYS = {
    "stress": _OF_SECTIONS,
    "strain": _OF_SECTIONS,
    "solid": Way("solid", SOLID, solid_for, SOLID_DEPTHS, SOLID_DEPTHS, _solid_step_m, False,
                 _chosen_ends, SOLID_LEFT, kept=True),
}  # fmt: skip
"""By the scene's plane."""
