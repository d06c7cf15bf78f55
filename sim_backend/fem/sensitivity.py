"""Exact derivatives of a solved press by every number of its scene, at the contact that it has.

Forces R(u, m, s) and gaps g(u, m, s) of the displacements, the contact forces m and a number s are
zero. Along s the answer changes by K du - N dm = -dR/ds and N' du + C dm = -dg/ds, N being the
active gaps' gradients and C a skin's compliance: one back-substitution with the factors of a Newton
step each, and as many more as the penalty's springs leave a part of the gap (Uzawa 1958). The right
sides are central differences of forces and gaps at the same u and m: no press is solved again.
A number moves the mesh as `sim_backend.fem.redrawn` says.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.assembly import Factors, gather
from sim_backend.fem.contact.pairs import ContactPairs
from sim_backend.fem.lumen import unit_pressure
from sim_backend.fem.newton import (
    Load,
    Solution,
    as_solved,
    forces_and_gaps,
    pairs_of,
    tangent,
)
from sim_backend.fem.redrawn import redrawn
from sim_backend.fem.section import Section
from sim_backend.scene.numbers import numbers, with_number
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.waves import PA_PER_MMHG

STEP = 1e-5
"""Step of a number over itself, or over how far it is from its `MOST`."""
MOST = {"poisson": 0.5, "fraction": 1.0}
"""Where a body becomes incompressible, and a lumen is none."""
ROUNDS, LEFT = 8, 1e-3
"""Most back-substitutions of a number, and the last one's share of the contact forces' change at
which they end: each leaves 1e-4 of the one before, so that two leave 1e-8."""

LOADS = ("x_mm", "depth_mm", "pressure_mmhg")
"""How a scene is pressed: numbers that are not in its file."""
End = tuple[Section, Load]
Moved = Callable[[float], End]
"""The press with a number changed by so much."""


@dataclass(frozen=True)
class Slope:
    """``displacement`` (n, 2) and force ``force_n_per_m`` by a number; ``multiplier`` (s,) is
    the change of the finger's contact forces [N/m]."""

    displacement: Array
    force_n_per_m: float
    multiplier: Array


class Tangent:
    """A solved press, linearised; its factors hold until the section is solved again.

    Raises `SingularMatrix`.
    """

    def __init__(self, section: Section, solution: Solution) -> None:
        self.section, self.solution = as_solved(section, solution), solution
        blocks = tangent(self.section, solution).blocks
        self._factors: Factors = self.section.assembly.factor(blocks)
        self._pairs: list[ContactPairs] = pairs_of(self.section, solution.load, solution)
        self._active = [
            (m > 0) | t.bonded for t, m in zip(self._pairs, solution.multiplier, strict=True)
        ]
        penalty = self.section.rules.penalty
        self._springs = [
            np.where(on, t.stiffness(penalty), 0.0)
            for t, on in zip(self._pairs, self._active, strict=True)
        ]

    def slope(self, moved: Moved, step: float) -> Slope:
        """By the number that ``moved`` changes by a ``step`` either way."""
        ends = moved(step), moved(-step)
        by_force = self._by_force(*ends) / (2 * step)
        pairs = zip(*(pairs_of(*end, self.solution) for end in ends), strict=True)
        multiplier = self.solution.multiplier
        gaps, turns = [], []
        for (a, b), m in zip(pairs, multiplier, strict=True):
            turned = replace(a, gradient=(a.gradient - b.gradient) / (2 * step))
            turned.add_force(-m, by_force)
            turns.append(turned.gradient)
            gaps.append((a.open(m) - b.open(m)) / (2 * step))
        du, change = self._solved(by_force, gaps)
        if self.section.self_contact:
            du, change = self._corrected(ends, step, du, change)
        finger, m = self._pairs[0], multiplier[0]
        along = du[self.section.mesh.surface]
        across = along[:, 1] - finger.gradient[:, 1] * (finger.gradient * along).sum(axis=1)
        turned_y = turns[0][:, 1] + finger.turning * across
        force = -float(change[0] @ finger.gradient[:, 1] + m @ turned_y)
        return Slope(du, force, change[0])

    def _corrected(
        self, ends: tuple[End, End], step: float, du: Array, change: list[Array]
    ) -> tuple[Array, list[Array]]:
        """Displacements and contact forces by what they leave out of balance: in the tangent the
        normals of a lumen's walls do not turn."""
        for _ in range(ROUNDS):
            forces, gaps = zip(
                *(
                    forces_and_gaps(*end, self._along(sign * step, du, change))
                    for sign, end in zip((1, -1), ends, strict=True)
                ),
                strict=True,
            )
            by_gap = [(a - b) / (2 * step) for a, b in zip(*gaps, strict=True)]
            more, more_change = self._solved((forces[0] - forces[1]) / (2 * step), by_gap)
            du = du + more
            change = [a + b for a, b in zip(change, more_change, strict=True)]
            if np.abs(more).max() <= LEFT * LEFT * np.abs(du).max():
                break
        return du, change

    def _along(self, by: float, du: Array, change: list[Array]) -> Solution:
        """The solution moved along a slope."""
        forces = zip(self.solution.multiplier, change, strict=True)
        return replace(
            self.solution,
            displacement=self.solution.displacement + by * du,
            multiplier=tuple(m + by * c for m, c in forces),
        )

    def _by_force(self, ahead: End, behind: End) -> Array:
        """Difference (2n,) [N/m] of what body and lumens are out of balance by."""
        u, (section, load) = self.solution.displacement, ahead
        if section.cells is not behind[0].cells or section.shear is not behind[0].shear:
            a, b = (one.forces(u, load.pressure_pa)[0] for one, load in (ahead, behind))
            return np.asarray(a - b)
        difference = np.zeros(section.size)
        if pressure_pa := load.pressure_pa - behind[1].pressure_pa:
            for sides in section.lumens:
                force = pressure_pa * unit_pressure(sides, u)[0]
                difference -= gather(section.size, sides.dofs, force)
        return difference

    def _solved(self, by_force: Array, by_gap: list[Array]) -> tuple[Array, list[Array]]:
        """How displacements (n, 2) and contact forces follow."""
        groups = list(zip(self._pairs, self._springs, by_gap, strict=True))
        change = [np.zeros(len(one)) for one in by_gap]
        for _ in range(ROUNDS):
            load = -by_force
            for (t, k, g), m in zip(groups, change, strict=True):
                t.add_force(np.where(k > 0, m - k * (t.compliance * m + g), 0.0), load)
            load[self.section.fixed] = 0.0
            du = self._factors.solve(load).reshape(-1, 2)
            before = np.concatenate(change)
            change = [
                np.where(k > 0, m - k * (t.opening(du) + t.compliance * m + g), 0.0)
                for (t, k, g), m in zip(groups, change, strict=True)
            ]
            after = np.concatenate(change)
            if np.abs(after - before).max() <= LEFT * np.abs(after).max():
                break
        return du, change


def slopes(section: Section, solution: Solution) -> tuple[Slope, Slope]:
    """By depth [m] and by pressure [Pa], the contact staying as it is; cheapest just after
    ``solution``. Raises `SingularMatrix`."""
    here = Tangent(section, solution)
    (by_depth, depth_step), (by_pressure, pressure_step) = (
        loaded(here.section, solution.load, key) for key in ("depth_mm", "pressure_mmhg")
    )
    return (
        _per(here.slope(by_depth, depth_step), 1e-3),
        _per(here.slope(by_pressure, pressure_step), PA_PER_MMHG),
    )


def gradients(
    section: Section, solution: Solution, scene: Scene, keys: Iterable[str] | None = None
) -> dict[str, float]:
    """How much the finger's force [N/m] of ``solution`` changes by each number of ``scene``, of
    which ``section`` is, in the unit of its key.

    ``keys`` are of `sim_backend.scene.numbers.numbers`, or `LOADS`; all without them. A pulse's
    gradient is the difference of two states'. The contact stays as it is. Raises `SingularMatrix`,
    KeyError for an unknown key, and `SceneError` where something sticks: where it does hangs on
    the way there. (Held where it is, HAOT's wall 1.5 mm deep would be 40 % off.)

    Examples
    --------
    >>> import palpate
    >>> from sim_backend.fem.finite_strain import solve_finite
    >>> scene = palpate.load_scene("TIT")
    >>> section, (solution,) = solve_finite(scene, 0.032, 2e-3, [0.0], 2e-3)
    >>> found = gradients(section, solution, scene, ["tissue.modulus_kpa", "depth_mm"])
    >>> found["tissue.modulus_kpa"] > 0, found["depth_mm"] > 0
    (True, True)
    """
    if any(at is not None and np.isfinite(at).any() for at in solution.bonded_at_m):
        raise SceneError(
            f"{scene.name}: what sticks to a bonded finger or support holds on where it touched, "
            "so that the gradient hangs on the way there, and is not known. Take "
            'indenter.bonded = false and support.contact = "frictionless"'
        )
    here = Tangent(section, solution)
    found = {}
    for key in (*LOADS, *numbers(scene)) if keys is None else keys:
        by = loaded if key in LOADS else renumbered
        moved, step = by(here.section, solution.load, key, scene)
        found[key] = here.slope(moved, step).force_n_per_m
    return found


def loaded(section: Section, load: Load, key: str, _scene: object = None) -> tuple[Moved, float]:
    """The press at another place, depth or pressure, and a step of that."""

    def moved(by: float) -> End:
        if key == "x_mm":
            finger = replace(section.finger, x=section.finger.x + 1e-3 * by)
            return replace(section, finger=finger), load
        depth_m, pressure_pa = load.depth_m, load.pressure_pa
        if key == "depth_mm":
            return section, Load(depth_m + 1e-3 * by, pressure_pa)
        return section, Load(depth_m, pressure_pa + PA_PER_MMHG * by)

    return moved, STEP


def renumbered(section: Section, load: Load, key: str, scene: Scene) -> tuple[Moved, float]:
    """The press into a scene of which the number ``key`` is another, and a step of that."""
    value = numbers(scene)[key]

    def moved(by: float) -> End:
        return redrawn(section, scene, with_number(scene, key, value + by)), load

    most = MOST.get(key.rpartition(".")[2], np.inf)
    return moved, STEP * min(abs(value) or 1.0, most - value)


def _per(slope: Slope, units: float) -> Slope:
    return Slope(slope.displacement / units, slope.force_n_per_m / units, slope.multiplier / units)
