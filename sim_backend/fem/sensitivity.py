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
from typing import NamedTuple

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.body import Body
from sim_backend.fem.contact.pairs import ContactPairs
from sim_backend.fem.newton import (
    Load,
    Solution,
    as_solved,
    forces_and_gaps,
    pairs_of,
    tangent,
)
from sim_backend.fem.redrawn import beside, redrawn
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

SETTLED = 1e-5
"""Change of displacements at which corrections end; each is a hundredth or less of the one before.
"""
LOADS = ("x_mm", "depth_mm", "pressure_mmhg")
"""How a scene is pressed: numbers that are not in its file."""
End = tuple[Body, Load]


class Number(NamedTuple):
    """A number of a press: the ``moved`` body and load with it changed by so much, a ``step`` for
    differences, and whether the body's own forces change with it."""

    moved: Callable[[float], End]
    step: float
    of_body: bool


@dataclass(frozen=True)
class Slope:
    """``displacement`` (n, d) and the finger's ``force`` by a number; ``multiplier`` (s,) is
    the change of the finger's contact forces. Forces as `sim_backend.fem.newton.Solution`'s."""

    displacement: Array
    force: float
    multiplier: Array

    def per(self, units: float) -> "Slope":
        """By another unit, so many of which are one of this."""
        return Slope(self.displacement / units, self.force / units, self.multiplier / units)


class Linearised:
    """A solved press and its tangent, which holds until the body is solved again.

    Raises `SingularMatrix`.
    """

    def __init__(self, body: Body, solution: Solution) -> None:
        self.body, self.solution = as_solved(body, solution), solution
        self.body.linear.linearise(tangent(self.body, solution), careful=False, rough=False)
        self._pairs: list[ContactPairs] = pairs_of(self.body, solution.load, solution)
        penalty = self.body.rules.penalty
        self._springs = [
            np.where((m > 0) | t.bonded, t.stiffness(penalty), 0.0)
            for t, m in zip(self._pairs, solution.multiplier, strict=True)
        ]

    def slope(self, number: Number) -> Slope:
        """By a number."""
        step = number.step
        ends = number.moved(step), number.moved(-step)
        by_force = np.zeros(self.body.size)
        if number.of_body:
            u = self.solution.displacement
            ahead, behind = (body.forces(u, load.pressure_pa)[0] for body, load in ends)
            by_force = (ahead - behind) / (2 * step)
        pairs = zip(*(pairs_of(*end, self.solution) for end in ends), strict=True)
        gaps, turns = [], []
        for (a, b), m in zip(pairs, self.solution.multiplier, strict=True):
            turned = replace(a, gradient=(a.gradient - b.gradient) / (2 * step))
            turned.add_force(-m, by_force)
            turns.append(turned.gradient)
            gaps.append((a.open(m) - b.open(m)) / (2 * step))
        du, change = self._solved(by_force, gaps)
        if self.body.self_contact or not self.body.linear.exact:
            du, change = self._corrected(ends, step, du, change)
        finger, m = self._pairs[0], self.solution.multiplier[0]
        along = du[self.body.surface]
        turned_y = turns[0][:, 1] - (finger.turned(np.ones(len(m)))[:, 1] * along).sum(axis=1)
        force = -float(change[0] @ finger.gradient[:, 1] + m @ turned_y)
        return Slope(du, force / self.body.share, change[0])

    def _corrected(
        self, ends: tuple[End, End], step: float, du: Array, change: list[Array]
    ) -> tuple[Array, list[Array]]:
        """Displacements and contact forces by what they leave out of balance: in the tangent the
        normals of a lumen's walls do not turn, and a solid's is solved in single precision."""
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
            if np.abs(more).max() <= SETTLED * np.abs(du).max():
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

    def _solved(self, by_force: Array, by_gap: list[Array]) -> tuple[Array, list[Array]]:
        """How displacements (n, d) and contact forces follow."""
        groups = list(zip(self._pairs, self._springs, by_gap, strict=True))
        change = [np.zeros(len(one)) for one in by_gap]
        for _ in range(ROUNDS if self.body.linear.exact else 1):
            load = -by_force
            for (t, k, g), m in zip(groups, change, strict=True):
                t.add_force(np.where(k > 0, m - k * (t.compliance * m + g), 0.0), load)
            load[self.body.fixed] = 0.0
            du = self.body.linear.step(load, 0.0).reshape(self.body.nodes.shape)
            before = np.concatenate(change)
            change = [
                np.where(k > 0, m - k * (t.opening(du) + t.compliance * m + g), 0.0)
                for (t, k, g), m in zip(groups, change, strict=True)
            ]
            after = np.concatenate(change)
            if np.abs(after - before).max() <= LEFT * np.abs(after).max():
                break
        return du, change


def slopes(body: Body, solution: Solution) -> tuple[Slope, Slope]:
    """By depth [m] and by pressure [Pa], the contact staying as it is; cheapest just after
    ``solution``. Raises `SingularMatrix`."""
    here = Linearised(body, solution)
    by_depth, by_pressure = (
        here.slope(loaded(here.body, solution.load, key)) for key in ("depth_mm", "pressure_mmhg")
    )
    return by_depth.per(1e-3), by_pressure.per(PA_PER_MMHG)


def gradients(
    body: Body, solution: Solution, scene: Scene, keys: Iterable[str] | None = None
) -> dict[str, float]:
    """How much the finger's force of ``solution``, [N/m] in a plane and else [N], changes by each
    number of ``scene``, of which ``body`` is, in the unit of its key.

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
    here = Linearised(body, solution)
    found = {}
    for key in (*LOADS, *numbers(scene)) if keys is None else keys:
        if key.endswith(".z_mm") and here.body.share < 1:
            found[key] = 0.0  # it is symmetric about z = 0
            continue
        by = loaded if key in LOADS else renumbered
        found[key] = here.slope(by(here.body, solution.load, key, scene)).force
    return found


def loaded(body: Body, load: Load, key: str, _scene: object = None) -> Number:
    """The press at another place, depth or pressure."""

    def moved(by: float) -> End:
        if key == "x_mm":
            return beside(body, 1e-3 * by), load
        depth_m, pressure_pa = load.depth_m, load.pressure_pa
        if key == "depth_mm":
            return body, Load(depth_m + 1e-3 * by, pressure_pa)
        return body, Load(depth_m, pressure_pa + PA_PER_MMHG * by)

    return Number(moved, STEP, of_body=key == "pressure_mmhg")


def renumbered(body: Body, load: Load, key: str, scene: Scene) -> Number:
    """The press into a scene of which the number ``key`` is another."""
    value = numbers(scene)[key]

    def moved(by: float) -> End:
        return redrawn(body, scene, with_number(scene, key, value + by)), load

    most = MOST.get(key.rpartition(".")[2], np.inf)
    return Number(moved, STEP * min(abs(value) or 1.0, most - value), of_body=True)
