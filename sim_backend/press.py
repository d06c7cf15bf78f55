"""One press into a scene, as accurate as asked for and no more."""

from collections.abc import Iterable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from sim_backend.choose import choose, named
from sim_backend.fem.internal import smallest_area_ratio
from sim_backend.fem.newton import OPEN_TOUCHES, CannotSolve, Solution
from sim_backend.fem.section import Section
from sim_backend.fem.stress import contact_m, nodal_von_mises, under_finger_pa
from sim_backend.refine import refine
from sim_backend.scene import Scene, SceneError
from sim_backend.waves import PA_PER_MMHG

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

__all__ = ["CannotSolve", "Press", "PressMesh", "State", "check_press", "press"]

MODELS = ("auto", "finite", "small")
SHUT_PCT = 3.0
"""What is left open of a pulse where a lumen's walls touch: elements differ by up to 6 % there."""
HALVES = ([0, 1, 2], [0, 2, 3])


@dataclass(frozen=True)
class State:
    """The answer at one lumen pressure; ``displacement_m`` (n, 2) of the mesh's nodes."""

    pressure_mmhg: float
    force_n_per_mm: float
    von_mises_pa: float
    contact_mm: tuple[float, float]
    min_jacobian: float
    displacement_m: Array


@dataclass(frozen=True)
class PressMesh:
    """The undeformed section: ``nodes`` (n, 2) [m] and, for pictures, ``triangles`` (m, 3)."""

    section: Section

    @property
    def nodes(self) -> Array:
        return self.section.mesh.nodes

    @property
    def triangles(self) -> Ints:
        """Each six-node cell as four triangles, each quadrilateral as two."""
        cells = self.section.mesh.cells
        four = ([0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5])
        return np.vstack([cells[:, c] for c in (four if cells.shape[1] == 6 else HALVES)])

    def von_mises(self, state: State) -> Array:
        """Von Mises stress (n,) [Pa] at the nodes."""
        return nodal_von_mises(self.section, state.displacement_m)


@dataclass(frozen=True)
class Press:
    """A press with one state per pressure.

    ``error_estimate_pct`` is the larger of those of force and of pulse;
    ``pulse_error_estimate_pct`` that of the span of forces alone, None at a single pressure.
    """

    scene: Scene
    x_mm: float
    depth_mm: float
    model: str
    dofs: int
    seconds: float
    error_estimate_pct: float
    pulse_error_estimate_pct: float | None
    states: tuple[State, ...]
    mesh: PressMesh

    def as_json(self) -> dict[str, object]:
        """The contract of ``palpate press --json``."""
        return {
            "scene": self.scene.name,
            "x_mm": self.x_mm,
            "depth_mm": self.depth_mm,
            "model": self.model,
            "dofs": self.dofs,
            "seconds": round(self.seconds, 4),
            "error_estimate_pct": _rounded(self.error_estimate_pct),
            "pulse_error_estimate_pct": _rounded(self.pulse_error_estimate_pct),
            "states": [
                {
                    "pressure_mmhg": s.pressure_mmhg,
                    "force_n_per_mm": s.force_n_per_mm,
                    "von_mises_pa": s.von_mises_pa,
                    "contact_mm": list(s.contact_mm),
                    "min_jacobian": s.min_jacobian,
                }
                for s in self.states
            ],
        }


def press(
    scene: Scene,
    x_mm: float,
    depth_mm: float,
    pressures_mmhg: Iterable[float] = (),
    *,
    model: str = "auto",
    accuracy_pct: float = 1.0,
) -> Press:
    """Press ``depth_mm`` deep at ``x_mm``; one state per pressure, at 0 mmHg when none is given.

    Model and mesh are the cheapest that keep force and pulse within ``accuracy_pct``, unless
    ``model`` names one, ``finite`` or ``small`` strain. Meshes are refined until what changes is
    small enough; where that cannot be reached, the stated error is above ``accuracy_pct``. Raises
    `SceneError` for a press that cannot be meant and `CannotSolve` where physics ends.
    """
    pressures = tuple(float(p) for p in pressures_mmhg) or (0.0,)
    _check(scene, x_mm, depth_mm, pressures, model, accuracy_pct)
    began = perf_counter()
    if model == "auto":
        choice = choose(scene, x_mm, depth_mm, pressures, accuracy_pct)
    else:
        choice = named(model, scene, depth_mm, pressures)
    levels_pa = [p * PA_PER_MMHG for p in pressures]
    model_pct = np.array([choice.error_pct, choice.pulse_error_pct])
    left_pct = np.maximum(accuracy_pct - model_pct, accuracy_pct / 2)
    place = 1e-3 * x_mm, 1e-3 * depth_mm
    refined = refine(choice.model, choice.scene, *place, levels_pa, left_pct)
    section, solutions = refined.solved
    states = tuple(_state(section, s, p) for s, p in zip(solutions, pressures, strict=True))
    left_out = len(scene.inclusion) - len(choice.scene.inclusion)
    name = choice.model + (f", {left_out} far inclusions left out" if left_out else "")
    error_pct = model_pct + refined.error_pct
    if len(pressures) > 1 and any(len(s.push) > OPEN_TOUCHES for s in solutions):
        error_pct[1] = max(error_pct[1], SHUT_PCT)
    pulse_pct = float(error_pct[1]) if len(pressures) > 1 else None
    return Press(
        scene, x_mm, depth_mm, name, len(section.assembly.free), perf_counter() - began,
        float(error_pct.max()), pulse_pct, states, PressMesh(section),
    )  # fmt: skip


def _rounded(pct: float | None) -> float | None:
    return None if pct is None else float(f"{pct:.3g}")


def _state(section: Section, solution: Solution, pressure_mmhg: float) -> State:
    u = solution.displacement
    left, right = contact_m(section, solution)
    return State(
        pressure_mmhg,
        1e-3 * solution.force_n_per_m,
        under_finger_pa(section, u),
        (1e3 * left, 1e3 * right),
        smallest_area_ratio(section, u)[0],
        u,
    )


def _check(
    scene: Scene,
    x_mm: float,
    depth_mm: float,
    pressures: tuple[float, ...],
    model: str,
    accuracy_pct: float,
) -> None:
    if model not in MODELS:
        raise SceneError(f"model = {model!r}: must be one of {', '.join(MODELS)}")
    if not 0.01 <= accuracy_pct <= 50:
        raise SceneError(f"accuracy = {accuracy_pct:g} %: must lie between 0.01 and 50")
    check_press(scene, x_mm, depth_mm)
    for p in pressures:
        if not 0 <= p <= 1000:
            raise SceneError(f"pressure = {p:g} mmHg: must lie between 0 and 1000")


def check_press(scene: Scene, x_mm: float, depth_mm: float) -> None:
    """Raises `SceneError` for a press that cannot be meant."""
    if not 0 < depth_mm < scene.surface_mm:
        raise SceneError(
            f"depth_mm = {depth_mm:g}: must lie between 0 and the {scene.surface_mm:g} mm "
            f"of {scene.name}"
        )
    left, right = reach_mm(scene)
    if not left <= x_mm <= right:
        raise SceneError(f"x_mm = {x_mm:g}: the finger must stay between {left:g} and {right:g}")


def reach_mm(scene: Scene) -> tuple[float, float]:
    """Where a press can begin: over the block, or over the middle half of a lone vessel."""
    if scene.tissue is not None:
        return 0.0, scene.tissue.width_mm
    one = scene.inclusion[0]
    return one.x_mm - one.outer_radius_mm / 2, one.x_mm + one.outer_radius_mm / 2
