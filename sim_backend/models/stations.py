"""A station solved: the answer at one place for any depth and lumen pressure, of any kind of body.

One ramp is solved at the resting pressure; at the full depth the ends of the wave are solved as
well, as far as they are needed. Between them
    F(d, p) = F(d, rest) + s(d) g(p),
g being the full depth's and s what is known of the pressure at depth d: its exact slope, or the end
of the wave that is solved there too. Where g bends much, as near the pressure at which a wall
inflates without bound, both ends are solved at each depth. Time does not enter: relaxation and the
beat are the phantom's.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import ceil

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.body import Body
from sim_backend.fem.continuation import continuation, judged, stable_branch
from sim_backend.fem.finite_strain import down, filled
from sim_backend.fem.newton import CannotSolve, Load, Solution, Unstable
from sim_backend.fem.sensitivity import Slope, slopes
from sim_backend.models.bodies import BodyKind, body_of
from sim_backend.models.curve import from_nothing, monotone
from sim_backend.models.kept_tables import kept_table
from sim_backend.models.response import Curve, Station, StationResponse, levels_pa
from sim_backend.models.solved import Solved
from sim_backend.models.taxel_shares import TaxelShares, at_depths
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray

AT_SYSTOLE = (0, 2, 4)
"""Numbers of a solid's depths at which systole is solved too."""
BEND, MUCH = 0.05, 0.2
"""Share of a pulse from rest to systole by which it may bend before diastole is solved too, and
from which both ends are solved at each depth, for half as much time again. A bend of 0.03 (TIHA)
leaves 0.2 % of the pulse. Of 50 random presses over soft walls (benchmarks/soft_walls.py at
c51866cd) pulses that bend less than `MUCH` are up to 5.4 % off at half the depth; those that bend
more would be up to 20 %, 2.5 times what is stated, and are up to 6 %, 0.5 times."""
PROBE_PA, PROBE_M = 10.0, 1e-6
"""Steps of the stress's slopes by pressure and depth, along the exact displacement slopes."""
ARRAYS = ("sunk", "values", "by_depth", "powers", "bulge", "flat")
TAXELS = ("taxel_sunk", "taxel_rest", "taxel_by_pressure")
"""What `solve_station` answers, and with an array the fields of `TaxelShares`, too."""


def solved(one: Station) -> StationResponse:
    """The answer of a station. Raises `CannotSolve` where physics ends, and `SceneError` where
    elements cannot be made."""
    kind = body_of(one.scene)
    names = ARRAYS + (TAXELS if one.array is not None else ())
    tables = [
        kept_table(path, names, partial(solve_station, part)) if kind.kept else solve_station(part)
        for part, path in one.parts
    ]
    table = {key: np.mean([part[key] for part in tables], axis=0) for key in names}
    touched = np.append(0.0, table["sunk"])
    levels = levels_pa(one.scene) if one.scene.arteries else (0.0, 0.0, 0.0)

    def curve(which: int) -> Curve:
        powers = (
            monotone(touched[np.append(True, at)], np.append(0.0, power[at]))
            for power in table["powers"][which]
            for at in [np.isfinite(power)]
        )
        at_rest = from_nothing(table["sunk"], table["values"][which], table["by_depth"][which])
        return Curve(at_rest, tuple(powers), *levels)

    left = kind.left._replace(change=kind.left.change * float(table["flat"]) ** 2)
    return StationResponse(
        one.x_m, one.max_depth_m, kind.length_m(one.scene), float(table["bulge"]), curve(0),
        curve(1), left, TaxelShares(*(table[key] for key in TAXELS)) if one.array else None,
    )  # fmt: skip


def solve_station(one: Station) -> dict[str, Array]:
    """Of force [N/m], or [N] in space, and stress [Pa]: ``values`` (2, d) and their slopes
    ``by_depth`` at rest, ``sunk`` (d,) [m] into the surface that rest lifts by the ``bulge``, and
    what each of k ``powers`` (2, k, d) of the pressure over rest adds, NaN where it was not solved.
    ``flat``: how flat lumens are pressed. With an array `TAXELS`. Raises `CannotSolve`."""
    scene, x_m, deepest_m, array = one
    kind = body_of(scene)
    body = kind.body_for(scene, x_m, deepest_m)
    rest, low, high = levels_pa(scene) if body.lumens else (0.0, 0.0, 0.0)
    start, bulge = filled(body, rest, deepest_m)

    def touching(shares: Array) -> list[float]:
        """Beside a lone vessel the first depths are in the air, or all."""
        return [float(d) for d in deepest_m * shares if d + bulge > 0] or [deepest_m]

    depths = touching(kind.depths)
    stops = sorted({*depths, *(touching(kind.taxel_depths) if array else ())})
    steps = [Load(d, rest) for d in _steps(stops, kind.longest_m(scene))]
    seen: list[Solution] = []
    tilts: list[tuple[Slope, Slope]] = []
    for state, load in zip(down(body, start, steps), steps, strict=True):
        seen.append(state)
        if kind.exact and load.depth_m in depths:  # cheapest just after it
            tilts.append(slopes(body, state))
    seen[-1] = _stable(body, seen[-1], kind.left.rest, x_m)
    ramp = [state for state, load in zip(seen, steps, strict=True) if load.depth_m in depths]
    ends: list[list[Solution]] = [[] for _ in ramp]
    if body.lumens:
        ends = (_bending_ends if kind.exact else _chosen_ends)(body, ramp, tilts, low, high)
    sunk = np.array(depths) + bulge

    def read(state: Solution) -> Array:
        return np.array([state.force, kind.von_mises_pa(body, state.displacement)])

    def along(state: Solution, slope: Slope, step: float) -> Array:
        ahead = replace(state, displacement=state.displacement + step * slope.displacement)
        return np.array([slope.force, (read(ahead) - read(state))[1] / step])

    values = np.array([read(state) for state in ramp])
    if kind.exact:
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
        flat = max(kind.flatness(body.lumens, state.displacement) for state in deepest)
    arrays = sunk, values.T, by_depth.T, powers or np.zeros((2, 0, len(sunk))), bulge, flat
    table = {name: np.asarray(value) for name, value in zip(ARRAYS, arrays, strict=True)}
    if array is None:
        return table
    crests = [[end for end in some if end.load.pressure_pa == high] for some in ends]
    if kind.exact and body.lumens:
        crests = [
            crest or [_at(body, state, slope, high)]
            for crest, state, (_, slope) in zip(crests, ramp, tilts, strict=True)
        ]
    pairs = [(state, crest) for state, some in zip(ramp, crests, strict=True) for crest in some]
    return table | _taxels(one, array, kind, body, bulge, seen, pairs)


def _taxels(
    one: Station, array: TaxelArray, kind: BodyKind, body: Body, bulge: float,
    seen: Sequence[Solution], beats: Sequence[tuple[Solution, Solution]],
) -> dict[str, Array]:  # fmt: skip
    """`TAXELS` of the states that are ``seen`` at rest, and of ``beats``, states at rest and at
    systole."""
    edges_m, finger_m = array.edges_m(one.scene.indenter), 1e-3 * one.scene.indenter.length_mm

    def shares(state: Solution) -> Array:
        whole_n = kind.length_m(one.scene) * state.force
        return np.asarray(kind.taxels_n(body, state, *edges_m, finger_m) / whole_n)

    def sunk(states: Sequence[Solution]) -> Array:
        return np.array([state.load.depth_m for state in states]) + bulge

    seen = [state for state in seen if state.force > 0]
    if not seen:
        nothing = np.zeros((1, array.rows, array.columns))
        return dict(zip(TAXELS, (np.array([one.max_depth_m]), nothing, nothing), strict=True))
    rest = np.array([shares(state) for state in seen])
    by_pressure = np.zeros_like(rest)
    if beats := [(state, crest) for state, crest in beats if state.force > 0]:
        each = [(shares(crest) - shares(state)) / (crest.load.pressure_pa - state.load.pressure_pa)
                for state, crest in beats]  # fmt: skip
        by_pressure = at_depths(sunk([state for state, _ in beats]), np.array(each), sunk(seen))
    return dict(zip(TAXELS, (sunk(seen), rest, by_pressure), strict=True))


def ramp(
    scene: Scene, x_m: float, depths_m: Sequence[float], pressures_pa: Sequence[float]
) -> list[Solved]:
    """At each of increasing depths the body with each of ``pressures_pa`` in the lumens, all on the
    mesh of the place's station and by the model of its presses at all depths; errors are not known
    (NaN). Raises `CannotSolve`."""
    deepest_m, kind = float(depths_m[-1]), body_of(scene)
    body = kind.body_for(scene, x_m, deepest_m)
    levels = [float(p) for p in pressures_pa] if body.lumens else [0.0]
    start, _ = filled(body, levels[0], deepest_m)
    solved = []
    for state in down(body, start, [Load(float(d), levels[0]) for d in depths_m]):
        more = continuation(body, state, [Load(state.load.depth_m, p) for p in levels[1:]])
        states = (state, *more) if body.lumens else (state,) * len(pressures_pa)
        solved.append(Solved(
            scene, x_m, kind.model, kind, body, states, np.full(2, np.nan),
            "on one mesh for all depths",
        ))  # fmt: skip
    return solved


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
