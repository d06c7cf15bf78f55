"""The meshes of a press into a section, plane or turned about an axis, and what each misses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.axisymmetric import solve_axisymmetric
from sim_backend.fem.finite_strain import Solved, solve_finite
from sim_backend.fem.gaps import GAP_SHARE
from sim_backend.fem.lumen import flatness
from sim_backend.fem.model import Grading, meshed_size_m
from sim_backend.fem.newton import PAIRS_WITH_OPEN_LUMENS, Solution
from sim_backend.fem.section import Section
from sim_backend.fem.sensitivity import slopes
from sim_backend.fem.small_strain import solve_small
from sim_backend.models.refine import ORDER, Floor, Meshed, Meshes, pulse
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
ENTERING_PCT = 1.0
"""How much nodes that enter the contact one by one change the force, in per cent of the mean force
of one node in contact: peak to peak over depth 0.4 to 1.6 %, median 0.9
(benchmarks/entering_nodes.py at c51866cd). This error decreases too slowly with
mesh size to be worth refining for; it is part of the stated error."""
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


@dataclass(frozen=True)
class SectionMeshes(Meshes):
    """Those of a press by a ``model``: finite or small; or axisymmetric, without pressure, and the
    place asked for being the radius [m] of the round block."""

    model: str

    @property
    def scene(self) -> Scene:
        return self.asked.scene

    @property
    def half_m(self) -> float:
        """What shares are of; a wide finger says nothing of a lone vessel's own size."""
        half_m = self.scene.indenter.profile.scale
        if self.scene.tissue is None:
            half_m = min(half_m, 1e-3 * self.scene.inclusion[0].outer_radius_mm)
        return half_m

    @property
    def name(self) -> str:
        return {"axisymmetric": "a body of revolution"}.get(self.model, f"{self.model} strain")

    @property
    def first_share(self) -> float:
        return meshed_size_m(self.scene, FIRST_SHARE * self.half_m) / self.half_m

    def contact_m(self, share: float) -> float:
        return CONTACT_SHARE * share * self.half_m

    def solve(self, share: float, coarser: Meshed | None, *, stated: bool) -> Solved:
        size_m = share * self.half_m
        grading = mesh_grading(self.scene, size_m, share)
        place = self.scene, self.asked.x_m, self.asked.depth_m
        if self.model == "axisymmetric":
            return solve_axisymmetric(*place, grading, coarser)
        if self.model == "small":
            return solve_small(*place, self.asked.pressures_pa, size_m, grading=grading)
        # not all the way down again where walls fold: a finer mesh may find no way past the folds
        # in a minute, and no pulse is stated better there than two meshes tell it
        must_carry = stated and coarser is not None and _folded(coarser)
        return solve_finite(
            *place, self.asked.pressures_pa, size_m, grading=grading, coarser=coarser,
            must_carry=must_carry,
        )  # fmt: skip

    def next_share(
        self, share: float, solved: Meshed, finer: float | None, budget_pct: Array
    ) -> float | None:
        room = float(np.sqrt(MAX_UNKNOWNS / len(solved[0].free)))
        if share <= SMALLEST_SHARE or (finer is not None and room < LEAST_FINER):
            return None
        most = MOST_FINER
        if finer is None:
            floor_pct = np.maximum(FLOOR_PCT * [1.0, len(self.asked.pressures_pa) > 1], 1e-9)
            finer = share / min(float(np.sqrt((budget_pct / floor_pct).min())), SECOND_SHARE)
            if not _folded(solved) and finer <= min(SECOND_FINER, room):
                most = SECOND_FINER
        asked = share / float(np.clip(finer, LEAST_FINER, max(min(most, room), LEAST_FINER)))
        # a lone vessel has whole steps of elements round it, and two meshes that are the same
        # would agree on anything
        while (next_share := self._meshed(asked)) > share / LEAST_FINER:
            asked /= LEAST_FINER
        return next_share

    def _meshed(self, share: float) -> float:
        return meshed_size_m(self.scene, share * self.half_m) / self.half_m

    def left_pct(self, changed_pct: Array, ratio: float) -> Floor:
        in_tissue = self.scene.tissue is not None
        order = ORDER if in_tissue else LONE_ORDER
        safety = SECOND_SAFETY if ratio > MOST_FINER or not in_tissue else 1.0
        return safety * changed_pct / (ratio**order - 1), order

    def floors_pct(self, share: float, solved: Meshed) -> list[Floor]:
        section, states = solved
        in_tissue = self.scene.tissue is not None
        flat = max(flatness(section.lumens, state.displacement) for state in states)
        by_pressure = FLOOR_PCT[1] * share**2 * (flat**2 if in_tissue else 1.0)
        if self.model == "finite":
            by_pressure = by_pressure * steepness(section, states, self.asked.pressures_pa)
        else:
            by_pressure = by_pressure * np.array([0.0, len(states) > 1])
        least_pct = np.maximum([FLOOR_PCT[0] * share**2, 0.0], by_pressure)
        few_pct = FEW_PCT[self.model] / _pressed(states) if in_tissue else 0.0
        return [(least_pct, 2.0), (np.array([few_pct, 0.0]), 1.0)]

    def rough_pct(self, solved: Meshed) -> float:
        return entering_pct(solved[1])


def entering_pct(states: Sequence[Solution]) -> float:
    """How much nodes that enter the contact between two pressures may change the pulse [%].

    The edge of the contact moves by a whole node if the contact force of one node moves from some
    nodes to others. If less force moves, the effect is that much smaller.
    """
    forces = np.array([state.force for state in states])
    ends = [states[k] for k in (int(forces.argmin()), int(forces.argmax()))]
    contact_force = np.array([state.multiplier[0] for state in ends])
    largest = max(float(contact_force.sum(axis=1).max()), 1e-12)
    moved = float(np.abs(np.diff(contact_force, axis=0)).sum()) / largest
    return ENTERING_PCT * min(moved, 1 / _pressed(ends)) * float(forces.max()) / pulse(forces)


def mesh_grading(scene: Scene, size_m: float, share: float) -> Grading:
    """Sizes of the mesh of a ``share`` of a press."""
    finer = share / FIRST_SHARE

    def at_wall(radius_m: float) -> float:
        first_m = WALL_SHARE * size_m / finer
        return finer * float(np.clip(first_m, FIRST_WALL[0] * radius_m, FIRST_WALL[1] * radius_m))

    coarsest_m = COARSEST * finer**COARSEST_POWER * 1e-3 * scene.surface_mm
    return Grading(CONTACT_SHARE * size_m, at_wall, GROWTH, coarsest_m, GAP_SHARE * finer)


def steepness(section: Section, states: Sequence[Solution], pressures_pa: Sequence[float]) -> Array:
    """How many per cent the largest force and the pulse change by if each lumen pressure does by
    1 %, as for a mesh that is off by 1 % of a wall's stiffness. The pulse's is 1 where forces are
    linear in the pressure, and ten and more where a wall is about to burst."""
    if not section.lumens or max(pressures_pa) <= 0:
        return np.array([0.0, len(pressures_pa) > 1], float)
    forces = np.array([state.force for state in states])
    low, high = np.argsort(pressures_pa)[[0, -1]]
    least, pressure = pressures_pa[low], pressures_pa[high]
    slope = slopes(section, states[high])[1].force
    of_force = pressure * abs(slope) / max(float(np.abs(forces).max()), 1e-12)
    if pressure == least:
        return np.array([of_force, 0.0])
    straight = float(forces[high] - forces[low]) / (pressure - least)
    below = 2 * straight - slope  # at the least pressure, of a curve that bends evenly
    below = min(max(below, 0.0), straight) if straight > 0 else straight
    return np.array([of_force, max(abs(pressure * slope - least * below) / pulse(forces), 1.0)])


def _folded(solved: Meshed) -> bool:
    """Whether a lumen's walls touch."""
    return any(len(state.multiplier) > PAIRS_WITH_OPEN_LUMENS for state in solved[1])


def _pressed(states: Sequence[Solution]) -> int:
    """How many nodes the finger presses in each at least, 1 or more."""
    return max(min(int(np.count_nonzero(one.multiplier[0] > 0)) for one in states), 1)
