"""The states that the fast model is trained on: of plane sections and of solids.

A section is solved on a grid of places, depths and lumen pressures. Of a solid each place is a
`sim_backend.models.solid_response`, kept on disk, which a scan of the same scene uses too. Where
nothing but the block's ends varies along z, few symmetric blocks stand for all z: what an end takes
from a press falls nearly as exp(-`END_DECAY` distance / height). Where more varies, every place of
the grid is solved.
"""

import logging
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from sim_backend.arrays import Array
from sim_backend.fem.contact.finger_gaps import finger_over
from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import solve_finite
from sim_backend.fem.model import build_section, half_contact
from sim_backend.fem.newton import CannotSolve, Load, unloaded
from sim_backend.fem.solid.build import half_width_m
from sim_backend.fem.solid.layers import graded_edges
from sim_backend.fem.solid.solve import solve_solid
from sim_backend.fem.solid.stress import under_finger_pa as under_solid_finger_pa
from sim_backend.fem.stress import under_finger_pa
from sim_backend.models import solid_response
from sim_backend.models.plane_response import element_size_m
from sim_backend.models.response import levels_pa
from sim_backend.models.second_process import all_answers, processors
from sim_backend.models.solid_press import SHARES
from sim_backend.models.station_response import Station, station
from sim_backend.scene.inclusion import Artery, Inclusion, Tumour
from sim_backend.scene.scene_file import Scene, mirrored
from sim_backend.scene.slicing import section_at

LOGGER = logging.getLogger("palpate")

SHALLOWEST_M = 0.4e-3
DEPTH_NODES = 7
FAR_STEP_M, NEAR_STEP_M, NEAR_M = 2e-3, 1.75e-3, 10e-3
"""Between places of a section at most: far from inclusions, and nearer to them than the third."""
PRESSURES = (0.5, 1.1)
"""Shares of the lowest and highest pressure of the wave: an empty vessel is not what beats."""
PRESSURE_NODES = 3
COARSER = 1.4
"""Element size over the usual one: 0.15 % of the force for a fifth of the time."""
FINER = 1.5
"""Element size over that of validation states."""

NEAR_SHARE, END_SHARE, FAR_SHARE, STEP_GROWTH = 0.25, 0.2, 1 / 3, 0.3
"""Between places of a solid: at an inclusion over its depth, at a side, an end and far from all
over the block's height, and how fast they grow."""
BUMP_SHARE = 0.25
"""Between places of a section over an inclusion, over the width of its influence: 1 mm over a lump
of 0.6 mm, 0.15 mm below the surface, and 25 mm over TIHA's vessel."""
LEAST_SHARE = 0.25
"""A step that would leave less of itself to go goes on to the end: through two places that all but
meet a spline would swing."""
MOST_PLACES = 200
"""Of a section that are solved, at 0.2 to 1 s each: steps over the narrowest bumps are longer, and
the validation states say what that leaves."""
SHALLOWEST = 1
"""First of `solid_response.DEPTHS` that a solid's model knows. Above it contact is narrow for the
mesh: 0.65 mm deep in TIHA-solid, 11 mm beside the vessel, three first meshes give a pulse 2 % below
to 22 % above a finer one's, and 1 mm deep all within 2 % of each other."""
CLEAR_SHARE = 0.8
"""Least distance from the finger's middle to an end over its breadth. In a block of 30 x 28 mm over
TIHA's vessel the mean of two symmetric blocks is 0.1, 0.8, 2.3 and 3.3 % above the whole block's
force where the end is 10, 8, 6 and 5.2 mm from the middle of a cylinder of 10 mm."""
ENDS = 4
"""Symmetric blocks that are solved, from the shortest to the scene's own."""
END_DECAY = 3.0
"""Under TIHA-solid's finger the part that an end takes, 61, 38, 18, 6.7 and 2.2 hundredths of 1.5 N
5, 7, 10, 14 and 20 mm away, falls by 2.5 to 3.4 times the distance over the height."""
Z_NODES = 33
"""Places along z at which the means of two symmetric blocks are taken."""
LONG_S = 1200.0
"""Training that will take longer says so."""


VALIDATION_STATES = 10
"""States that measure the error of a section's model; of a solid's, which take longer, half."""
VALIDATION_NEAR = 0.4
"""Share of as many that lie over each inclusion at least, else there are more states: ten over
64 mm rarely meet a bump 1 mm wide, which was off by 12 % where 0.7 % was stated."""


class Validation(NamedTuple):
    """Validation states: how many; what is stated of force and pulse at least [%]; and the
    share of the force against which a smaller pulse is judged."""

    states: int
    least_pct: tuple[float, float]
    small_pulse: float


def validation(scene: Scene) -> Validation:
    """A section's mesh misses 0.2 % of force and 2 % of pulse; a solid's what `solid_response`
    says, and far from TIHA-solid's vessel 1 mN of a pulse of 8 mN and a force of 0.9 N."""
    if scene.plane != "solid":
        return Validation(VALIDATION_STATES, (0.2, 2.0), 0.01)
    left = solid_response.LEFT
    return Validation(VALIDATION_STATES // 2, (100 * left.rest, 100 * left.change), 0.02)


def solve_grid(scene: Scene, max_depth_m: float) -> dict[str, Array]:
    """Places ``x`` and ``z`` [m], ``depth`` [m], ``pressure`` [Pa], and ``solved`` (x, z, depth,
    pressure, 2): force [N] and stress [Pa].

    Raises `CannotSolve`.
    """
    x, depth = places(scene, max_depth_m), depths(scene, max_depth_m)
    pressure = pressures(scene)
    blocks, whole = _blocks(scene)
    asked = [[station(block, float(one), max_depth_m) for block in blocks] for one in x]
    tasks = list(dict.fromkeys(one for row in asked for one in row))
    answers = dict(zip(tasks, _all_solved(tasks, depth, pressure), strict=True))
    z, solved = whole(np.array([[answers[one] for one in row] for row in asked]))
    return {"x": x, "z": z, "depth": depth, "pressure": pressure, "solved": solved}


def column(one: Station, depth: Array, pressure: Array) -> Array:
    """Force [N] and stress [Pa] (depths, pressures, 2) of a station."""
    if one.scene.plane != "solid":
        return section_column(one.scene, one.x_m, depth, pressure, COARSER)
    found = solid_response.respond_solid(*one)
    at = one.x_m, depth[:, None], pressure
    return np.stack([found.force_n(*at), found.von_mises_pa(*at)], axis=-1)


def states(
    scene: Scene, x_m: float, z_m: float, depth_m: float, pressure: Array, finer: bool
) -> Array:
    """Force [N] and stress [Pa] (pressures, 2) of one press, solved by itself; ``finer``: on
    smaller elements than any that the fast model was trained on, where they are not too many."""
    here = section_at(scene, 1e3 * z_m)
    if here.plane == "solid":
        parts = solid_response.symmetric_parts(here)
        solved = [_solid_states(one, x_m, depth_m, pressure, finer) for one in parts]
        return np.asarray(np.mean(solved, axis=0))
    if not finer:
        return np.asarray(section_column(here, x_m, np.array([depth_m]), pressure)[0])
    size_m = element_size_m(here) / FINER
    section, solutions = solve_finite(here, x_m, depth_m, pressure.tolist(), size_m)
    length_m = 1e-3 * here.indenter.length_mm
    return np.array([
        (length_m * one.force_n_per_m, under_finger_pa(section, one.displacement))
        for one in solutions
    ])  # fmt: skip


def places(scene: Scene, max_depth_m: float) -> Array:
    """Places across the vessels to solve [m]: close to each other near inclusions."""
    assert scene.tissue is not None  # the fast model refuses a lone vessel
    width = 1e-3 * scene.tissue.width_mm
    low = min(4e-3, width / 8)
    symmetric = mirrored(scene) == scene
    high = width / 2 if symmetric else width - low
    if scene.plane == "solid":
        spots = [_across(one) for one in scene.inclusion]
        x = _graded(scene, low, high, spots, [0.0, width])
    else:
        bumps = influences(scene, max_depth_m)
        while len(x := _stepped(scene, low, high, bumps)) > MOST_PLACES:
            bumps = [one._replace(width=COARSER * one.width) for one in bumps]
    return np.concatenate([x, (width - x)[-2::-1]]) if symmetric else x


def depths(scene: Scene, max_depth_m: float) -> Array:
    """Depths that are solved [m]."""
    if scene.plane == "solid":
        return max_depth_m * solid_response.DEPTHS[SHALLOWEST:]
    return np.geomspace(SHALLOWEST_M, max_depth_m, DEPTH_NODES)


def pressures(scene: Scene) -> Array:
    """Lumen pressures that are solved [Pa]."""
    if not scene.arteries:
        return np.zeros(1)
    _, low, high = levels_pa(scene)
    if scene.plane != "solid":
        low, high = PRESSURES[0] * low, PRESSURES[1] * high
    return np.linspace(low, high, PRESSURE_NODES)


def section_column(
    scene: Scene, x_m: float, depth: Array, pressure: Array, coarser: float = 1.0
) -> Array:
    """Force [N] and stress [Pa] (depths, pressures, 2) of a section at one place.

    All pressures at each depth, there and back: a change of pressure takes fewer Newton steps than
    a change of depth.
    """
    size_m = coarser * element_size_m(scene)
    section = build_section(scene, x_m, depth_m=float(depth[-1]), size_m=size_m)
    down = range(len(pressure))[::-1]
    path = [(i, j) for i in range(len(depth)) for j in (down if i % 2 == 0 else down[::-1])]
    loads = [Load(float(depth[i]), float(pressure[j])) for i, j in path]
    start = unloaded(section)
    if loads[0].pressure_pa > 0:
        (start,) = continuation(section, start, [Load(-float(depth[-1]), loads[0].pressure_pa)])
    result = np.empty((len(depth), len(pressure), 2))
    length_m = 1e-3 * scene.indenter.length_mm
    for at, solution in zip(path, continuation(section, start, loads), strict=True):
        stress = under_finger_pa(section, solution.displacement)
        result[at] = length_m * solution.force_n_per_m, stress
    return result


def _solid_states(
    scene: Scene, x_m: float, depth_m: float, pressure: Array, finer: bool
) -> Array:  # fmt: skip
    levels, half_m = pressure.tolist(), half_width_m(scene)
    try:
        body, found = solve_solid(scene, x_m, depth_m, levels, SHARES[int(finer)] * half_m)
    except CannotSolve as limit:
        if not (finer and limit.limit == "mesh"):
            raise
        body, found = solve_solid(scene, x_m, depth_m, levels, SHARES[0] * half_m)
    return np.array([(one.force_n, under_solid_finger_pa(body, one.displacement)) for one in found])


def _all_solved(tasks: list[Station], depth: Array, pressure: Array) -> list[Array]:
    """`column` of each. What will take long is said after the first, which shows how long."""
    todo = [one for one in tasks if one.scene.plane == "solid" and not solid_response.is_kept(*one)]
    if todo:
        began_s = perf_counter()
        column(todo[0], depth, pressure)
        left_s = (perf_counter() - began_s) * (len(todo) - 1) / min(processors(), 2)
        if left_s > LONG_S:
            LOGGER.warning(
                "the fast model of %s solves %d more places, about %.0f min; what is solved is "
                "kept, so that it may be interrupted",
                todo[0].scene.name, len(todo) - 1, left_s / 60,
            )  # fmt: skip
    return all_answers(column, [(one, depth, pressure) for one in tasks])


Whole = Callable[[Array], tuple[Array, Array]]
"""From what the blocks answer (x, blocks, ...) to places along z and the scene's (x, z, ...)."""


def _blocks(scene: Scene) -> tuple[list[Scene], Whole]:
    """What is pressed above its z = 0 at each place across."""
    tissue = scene.tissue
    if scene.plane != "solid" or tissue is None or tissue.length_mm is None:
        return [scene], lambda solved: (np.zeros(1), solved)
    half, middle = 0.5e-3 * tissue.length_mm, 1e-3 * (tissue.z_mm or 0.0)
    reach = half - CLEAR_SHARE * 1e-3 * scene.indenter.breadth_mm_projected
    if solid_response.is_straight(scene):
        return _straight_blocks(scene, half, middle, max(reach, 0.0))
    reach = max(reach, abs(middle))
    spots = [spot for one in scene.inclusion for spot in _along(one)]
    low, high = middle - reach, middle + reach
    z = _graded(scene, low, high, spots, [middle - half, middle + half]) if reach else np.zeros(1)

    return [section_at(scene, round(1e3 * float(one), 9)) for one in z], lambda solved: (z, solved)


def _straight_blocks(
    scene: Scene, half: float, middle: float, reach: float
) -> tuple[list[Scene], Whole]:
    """Symmetric blocks, ``ends`` [m] long on either side, whose means are the whole block's."""
    tissue = scene.tissue
    assert tissue is not None
    ends = np.geomspace(half - reach, half, ENDS) if reach else np.array([half])
    blocks = [
        scene.model_copy(update={"tissue": tissue.model_copy(
            update={"length_mm": round(2e3 * float(end), 9), "z_mm": None})})
        for end in ends
    ]  # fmt: skip

    def left(end: Array) -> Array:
        return np.exp(-END_DECAY * end / (1e-3 * tissue.height_mm))

    def whole(solved: Array) -> tuple[Array, Array]:
        if len(ends) == 1:
            return np.array([middle]), solved
        z = np.linspace(-reach, reach, Z_NODES)
        over = make_interp_spline(left(ends[::-1]), solved[:, ::-1], k=2, axis=1)
        return z + middle, np.asarray(over(left(half - z)) + over(left(half + z))) / 2

    return blocks, whole


class Influence(NamedTuple):
    """Where along x and z [m] an inclusion changes the force, and over which width it does."""

    low: float
    high: float
    along: tuple[float, float]
    width: float


def influences(scene: Scene, max_depth_m: float) -> list[Influence]:
    """Of each inclusion, with its path: as wide as it is seen from the surface, and within half of
    the finger's contact of that."""
    touched_m = half_contact(finger_over(scene.indenter, 0.0, 0.0), max_depth_m)
    found = []
    for one in scene.inclusion:
        low, high, _ = _across(one)
        # to where a line from the surface over its middle just meets its outline
        width_m = 1e-3 * float(np.sqrt(one.depth_mm**2 - one.outer_radius_mm**2))
        reach_m = touched_m + width_m
        along = -np.inf, np.inf
        if isinstance(one, Tumour):
            along = tuple(1e-3 * (one.z_mm or 0.0) + reach_m * np.array([-1, 1]))
        found.append(Influence(low - reach_m, high + reach_m, along, width_m))
    return found


def _stepped(scene: Scene, low: float, high: float, bumps: Sequence[Influence]) -> Array:
    """From ``low`` to ``high``; steps grow from narrow bumps on."""
    x = [low]
    while x[-1] < high - 1e-9:
        beyond_m = [abs(1e-3 * one.x_mm - x[-1]) - NEAR_M for one in scene.inclusion]
        near = bool(beyond_m) and min(beyond_m) < 0
        step = min([NEAR_STEP_M if near else FAR_STEP_M, *(_step(one, x[-1]) for one in bumps)])
        reached = x[-1] + step
        x.append(high if high - reached < LEAST_SHARE * step else reached)
    return np.array(x)


def _step(bump: Influence, x_m: float) -> float:
    """To the next place [m]: no further than a bump ahead or around allows."""
    share_m = BUMP_SHARE * bump.width
    if x_m < bump.low:  # what is allowed where the step ends
        return (share_m + STEP_GROWTH * (bump.low - x_m)) / (1 + STEP_GROWTH)
    return share_m + STEP_GROWTH * max(x_m - bump.high, 0.0)


Spot = tuple[float, float, float]
"""From, to [m], and the step between places there [m]."""


def _across(one: Inclusion) -> Spot:
    x_mm = [x for _, x, _ in one.path] if isinstance(one, Artery) and one.path else [one.x_mm]
    return 1e-3 * min(x_mm), 1e-3 * max(x_mm), NEAR_SHARE * 1e-3 * one.depth_mm


def _along(one: Inclusion) -> list[Spot]:
    """Where an inclusion varies along z."""
    if not isinstance(one, Artery):
        stretches = [(one.z_mm or 0.0,) * 2]
    else:
        stretches = [one.stenosis.z_mm] if one.stenosis and one.stenosis.z_mm else []
        stretches += [(one.path[0][0], one.path[-1][0])] if one.path else []
    return [(1e-3 * low, 1e-3 * high, NEAR_SHARE * 1e-3 * one.depth_mm) for low, high in stretches]


def _graded(
    scene: Scene, low: float, high: float, spots: Sequence[Spot], walls: Sequence[float]
) -> Array:
    """Places from ``low`` to ``high`` [m], close to each other at ``spots`` and ``walls``."""
    assert scene.tissue is not None
    height = 1e-3 * scene.tissue.height_mm
    near = [*spots, *((wall, wall, END_SHARE * height) for wall in walls)]

    def step(at: Array) -> Array:
        away = [s + STEP_GROWTH * np.maximum(np.maximum(a - at, at - b), 0) for a, b, s in near]
        return np.asarray(np.minimum(np.min(away, axis=0), FAR_SHARE * height))

    middles = {(a + b) / 2 for a, b, _ in spots}
    return graded_edges([low, *sorted(m for m in middles if low < m < high), high], step)
