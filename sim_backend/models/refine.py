"""Meshes refined until force and pulse converge, and the error that remains."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.axisymmetric import solve_axisymmetric
from sim_backend.fem.finite_strain import Solved, solve_finite
from sim_backend.fem.gaps import GAP_SHARE
from sim_backend.fem.lumen import flatness
from sim_backend.fem.model import Grading, meshed_size_m
from sim_backend.fem.newton import PAIRS_WITH_OPEN_LUMENS, CannotSolve, Solution
from sim_backend.fem.section import Section
from sim_backend.fem.sensitivity import slopes
from sim_backend.fem.small_strain import solve_small
from sim_backend.scene.scene_file import Scene

FIRST_SHARE, SECOND_SHARE, SMALLEST_SHARE = 0.5, 0.35, 0.01
"""Element size over the finger's half width: of the first mesh, the second at most, the last."""
LEAST_FINER, MOST_FINER = 1.4, 2.0
"""How much finer each mesh is than the one before."""
SECOND_FINER, SECOND_SAFETY = 3.3, 3.0
"""The second mesh may be finer than `MOST_FINER`, since it is known to be needed, whatever the
first says. What the difference of two such meshes shows of the error is then taken
three times (Roache 1994, of two meshes), so that it is not where even that mesh would not do;
where walls fold the second would not carry over from the first."""
ORDER = 1.6
"""The error falls at least as this power of the size."""
LONE_ORDER = 1.0
"""As `ORDER`, of a lone vessel on its support, where nodes touch and stick one by one: what two of
its meshes show is taken `SECOND_SAFETY` times too. With 36, 72 and 144 elements round it the vessel
of press 61 of benchmarks/random_presses.py carries 38.49, 38.66 and 37.94 N/m."""
FLOOR_PCT = np.array([6.0, 20.0])
"""What a mesh misses of force and pulse at least, over the square of the element size over the
finger's half width: two meshes may agree by chance. The pulse's grows with the square of how flat a
lumen in tissue is pressed, as its ends bend so much more sharply: TIHA 7.5 mm deep, pressed to
0.47 of its height, has pulses within 1 % of each other on shares of 0.5 and 0.35, and both miss 8 %
(benchmarks/flat_lumens.py at c51866cd)."""
FEW_PCT = {"axisymmetric": 12.0, "finite": 6.0, "small": 6.0}
"""What contact at nodes misses of the force in tissue at most, over how many are pressed, of a body
of revolution along a radius: up to 8, there 15, of ten nodes or fewer
(benchmarks/shallow_presses.py at c51866cd)."""
SMALL_PULSE = 1e-3
"""A pulse below this share of the force is judged against the share: no sensor feels it."""
ENTERING_PCT = 1.0
"""How much nodes that enter the contact one by one change the force, in per cent of the mean force
of one node in contact: peak to peak over depth 0.4 to 1.6 %, median 0.9
(benchmarks/entering_nodes.py at c51866cd). It falls so slowly that no finer mesh is made for it,
nor for less: it is stated."""
WORTHLESS_PCT = 50.0
"""A force that meshes disagree on by more is no answer."""
MAX_UNKNOWNS = 20_000
"""No mesh is made that would have more, by the square of how much finer it is: where the coarser
one's answer does not carry over, and the finger has to go all the way down again, that is a minute.
"""
CONTACT_SHARE, WALL_SHARE, GROWTH = 0.1, 0.5, 0.45
"""Sizes in the contact and at inclusions over the mesh's, and how fast they grow from there. Far
from its vessel the error of a pulse is dominated by nodes that enter the contact one by one."""
FIRST_WALL = (0.25, 0.5)
"""Bounds of the size at an inclusion over its radius, on the first mesh."""
COARSEST, COARSEST_POWER = 0.3, 0.5
"""Largest size over the block's height on the first mesh; it falls as this power of the others."""

Solving = Callable[[str], None]
"""Receives a line about what is to be solved next."""
MODEL_WORDS = {
    "finite": "finite strain", "small": "small strain", "axisymmetric": "a body of revolution",
}  # fmt: skip


@dataclass(frozen=True)
class Refined:
    """What was solved on the finest mesh, and the error left [%] of (force, pulse)."""

    solved: Solved
    error_pct: Array


def mesh_in_words(model: str, contact_m: float, error_pct: Array) -> str:
    """What is solved next, for a person; ``error_pct`` (force, pulse) is not finite before two
    meshes are known."""
    words = f"{model} on elements of {1e3 * contact_m:.2g} mm under the finger"
    if np.isinf(error_pct).any():
        return words
    pulse = f", the pulse {error_pct[1]:.2g} %" if error_pct[1] else ""
    return f"{words}; so far the force is within {error_pct[0]:.2g} %{pulse}"


def on_first_mesh(model: str, scene: Scene, x_m: float, depth_m: float) -> Solved:
    """The press on the first mesh of `refine`, lumens empty. Raises `CannotSolve`."""
    size_m = FIRST_SHARE * scene.indenter.profile.scale
    solve = solve_small if model == "small" else solve_finite
    grading = mesh_grading(scene, size_m, FIRST_SHARE)
    return solve(scene, x_m, depth_m, [0.0], size_m, grading=grading)


def refine(
    model: str,
    scene: Scene,
    x_m: float,
    depth_m: float,
    pressures_pa: Sequence[float],
    budget_pct: Array,
    near: Solved | None = None,
    *,
    first: Solved | None = None,
    solving: Solving = lambda _what: None,
) -> Refined:
    """Solve on ever finer meshes until the errors left are within ``budget_pct`` (force, pulse).

    With ``model`` axisymmetric, ``x_m`` is the radius of the round block, and the first mesh begins
    at what was solved for one ``near`` to it. ``first`` is what the first mesh says, where that is
    known. A mesh too fine to be solved, or to be worth it, ends the refinement too. ``solving``
    receives a line about each mesh before it is solved. Raises `CannotSolve`.
    """
    half_m = scene.indenter.profile.scale
    if scene.tissue is None:  # a wide finger says nothing of the vessel's own size
        half_m = min(half_m, 1e-3 * scene.inclusion[0].outer_radius_mm)
    floor_pct = FLOOR_PCT * [1.0, len(pressures_pa) > 1]
    in_tissue = scene.tissue is not None  # else all that two meshes show is taken three times

    def solve(share: float, coarser: Solved | None) -> Solved:
        place = scene, x_m, depth_m, pressures_pa, share * half_m
        grading = mesh_grading(scene, share * half_m, share)
        solving(mesh_in_words(MODEL_WORDS[model], grading.contact_m, error_pct))
        if model == "axisymmetric":
            return solve_axisymmetric(scene, x_m, depth_m, grading, coarser)
        if model == "small":
            return solve_small(*place, grading=grading)
        # not all the way down again where walls fold: a finer mesh may find no way past the folds
        # in a minute, and no pulse is stated better there than two meshes tell it
        must_carry = bool(np.isfinite(error_pct).all()) and coarser is not None and _folded(coarser)
        return solve_finite(*place, grading=grading, coarser=coarser, must_carry=must_carry)

    order = ORDER if in_tissue else LONE_ORDER
    share = meshed_size_m(scene, FIRST_SHARE * half_m) / half_m
    error_pct = np.full(2, np.inf)
    solved = first or solve(share, near)
    wanted = float(np.sqrt((budget_pct / np.maximum(floor_pct, 1e-9)).min()))
    finer = share / min(wanted, SECOND_SHARE)
    enough_pct = budget_pct
    while (error_pct > enough_pct).any() and share > SMALLEST_SHARE:
        room = float(np.sqrt(MAX_UNKNOWNS / len(solved[0].assembly.free)))
        if room < LEAST_FINER and np.isfinite(error_pct).all():
            break
        reaches = finer <= min(SECOND_FINER, room)
        far_apart = np.isinf(error_pct).any() and not _folded(solved) and reaches
        most = SECOND_FINER if far_apart else MOST_FINER
        finer = float(np.clip(finer, LEAST_FINER, max(min(most, room), LEAST_FINER)))
        finer, share = _finer(scene, half_m, share, finer)
        coarser = solved
        try:
            solved = solve(share, coarser)
        except CannotSolve:
            if np.isinf(error_pct).any():
                raise
            error_pct = error_pct * finer**order  # the mesh before, whose answer is kept
            break
        changed_pct = changes_pct(_forces(coarser[1]), _forces(solved[1]))
        left_pct = changed_pct / (finer**order - 1)
        if finer > MOST_FINER or not in_tissue:
            left_pct = SECOND_SAFETY * left_pct
        flat = max(flatness(solved[0].lumens, state.displacement) for state in solved[1])
        pressure_pct = FLOOR_PCT[1] * share**2 * (flat**2 if in_tissue else 1.0)
        least_pct = np.maximum(
            [floor_pct[0] * share**2, 0.0], pressure_pct * _steepness(model, *solved, pressures_pa)
        )
        few_pct = np.array([FEW_PCT[model] / _pressed(solved[1]) if in_tissue else 0.0, 0.0])
        error_pct = np.max([left_pct, least_pct, few_pct], axis=0)
        enough_pct = np.maximum(budget_pct, [0.0, _entering_pct(solved[1])])
        over, least_over = (left_pct / enough_pct).max(), (least_pct / enough_pct).max()
        few_over = float((few_pct / enough_pct).max())
        finer = max(float(over) ** (1 / order), float(least_over) ** 0.5, few_over)
    if error_pct[0] > WORTHLESS_PCT:
        raise CannotSolve(
            "mesh",
            f"forces differ by {error_pct[0]:.0f} % between meshes: walls fold so sharply that no "
            f"mesh of up to {MAX_UNKNOWNS} unknowns settles it; press less deep",
        )
    return Refined(solved, np.maximum(error_pct, [0.0, _entering_pct(solved[1])]))


def _finer(scene: Scene, half_m: float, share: float, wanted: float) -> tuple[float, float]:
    """How much finer the next mesh truly is, and its share: a lone vessel has whole steps of
    elements round it, and two meshes that are the same would agree on anything."""
    asked = share / wanted
    while (found := meshed_size_m(scene, asked * half_m) / half_m) > share / LEAST_FINER:
        asked /= LEAST_FINER
    return share / found, found


def mesh_grading(scene: Scene, size_m: float, share: float) -> Grading:
    finer = share / FIRST_SHARE

    def at_wall(radius_m: float) -> float:
        first_m = WALL_SHARE * size_m / finer
        return finer * float(np.clip(first_m, FIRST_WALL[0] * radius_m, FIRST_WALL[1] * radius_m))

    coarsest_m = COARSEST * finer**COARSEST_POWER * 1e-3 * scene.surface_mm
    return Grading(CONTACT_SHARE * size_m, at_wall, GROWTH, coarsest_m, GAP_SHARE * finer)


def _folded(solved: Solved) -> bool:
    """Whether a lumen's walls touch."""
    return any(len(one.multiplier) > PAIRS_WITH_OPEN_LUMENS for one in solved[1])


def _forces(states: list[Solution]) -> Array:
    return np.array([one.force_n_per_m for one in states])


def changes_pct(coarse: Array, fine: Array) -> Array:
    """Largest change of the forces (n,), and that of their span over the pressures (2,) [%]."""
    largest = max(float(np.abs(fine).max()), 1e-12)
    of_span = abs(float(np.ptp(fine)) - float(np.ptp(coarse))) / _pulse(fine)
    return 100 * np.array([np.abs(coarse - fine).max() / largest, of_span])


def _pulse(forces: Array) -> float:
    """What a pulse's error is judged against."""
    return max(float(np.ptp(forces)), SMALL_PULSE * max(float(np.abs(forces).max()), 1e-12))


def _steepness(
    model: str, section: Section, states: list[Solution], pressures_pa: Sequence[float]
) -> Array:
    """How many per cent the largest force and the pulse change by if each lumen pressure does by
    1 %, as for a mesh that is off by 1 % of a wall's stiffness. The pulse's is 1 where forces are
    linear in the pressure, and ten and more where a wall is about to burst."""
    if model != "finite" or not section.lumens or max(pressures_pa) <= 0:
        return np.array([0.0, len(pressures_pa) > 1], float)
    forces, (low, high) = _forces(states), np.argsort(pressures_pa)[[0, -1]]
    least, pressure = pressures_pa[low], pressures_pa[high]
    slope = slopes(section, states[high])[1].force
    of_force = pressure * abs(slope) / max(float(np.abs(forces).max()), 1e-12)
    if pressure == least:
        return np.array([of_force, 0.0])
    straight = float(forces[high] - forces[low]) / (pressure - least)
    below = 2 * straight - slope  # at the least pressure, of a curve that bends evenly
    below = min(max(below, 0.0), straight) if straight > 0 else straight
    return np.array([of_force, max(abs(pressure * slope - least * below) / _pulse(forces), 1.0)])


def _pressed(states: list[Solution]) -> int:
    """How many nodes the finger presses in each at least, 1 or more."""
    return max(min(int(np.count_nonzero(one.multiplier[0] > 0)) for one in states), 1)


def _entering_pct(states: list[Solution]) -> float:
    """How much nodes that enter the contact between two pressures may change the pulse [%].

    The edge of the contact moves by a whole node if the contact force of one node moves from some
    nodes to others. If less force moves, the effect is that much smaller.
    """
    forces = _forces(states)
    low, high = states[int(forces.argmin())], states[int(forces.argmax())]
    contact_force = np.array([low.multiplier[0], high.multiplier[0]])
    largest = max(float(contact_force.sum(axis=1).max()), 1e-12)
    moved = float(np.abs(np.diff(contact_force, axis=0)).sum()) / largest
    return (
        ENTERING_PCT * min(moved, 1 / _pressed([low, high])) * float(forces.max()) / _pulse(forces)
    )
