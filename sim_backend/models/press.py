"""One press into a scene, as accurate as asked for."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from time import perf_counter

from sim_backend import html
from sim_backend.arrays import Array
from sim_backend.fem.newton import CannotSolve, Solution
from sim_backend.models.press_range import check_asked
from sim_backend.models.refine import SMALL_PULSE, Asked, Solving
from sim_backend.models.solved import Solved
from sim_backend.models.table import choose
from sim_backend.notebook_line import notebook_line
from sim_backend.scene.scene_file import Scene, SceneError, load_scene
from sim_backend.scene.taxels import TaxelArray
from sim_backend.scene.waves import PA_PER_MMHG, load_wave

__all__ = ["CannotSolve", "Press", "State", "press"]


@dataclass(frozen=True)
class State:
    """The answer at one lumen pressure, from what was ``solution``. A solid has no
    ``force_n_per_mm``: NaN.

    ``force_n`` is the whole finger's. ``contact_error_mm``: what either end of ``contact_mm`` may
    be off by, between two nodes. ``stable``: the body would stay so if it were nudged;
    None where a solid's factors do not decide. ``gradient``, where it was asked for: how much
    ``force_n`` changes [N] for one more of each number of the scene, and of ``x_mm``,
    ``depth_mm`` and ``pressure_mmhg``, the contact as it is. ``taxels_n`` (rows, columns),
    where asked for: the part of ``force_n`` on each taxel.
    """

    pressure_mmhg: float
    force_n_per_mm: float
    force_n: float
    von_mises_pa: float
    contact_mm: tuple[float, float]
    contact_error_mm: float
    min_jacobian: float
    stable: bool | None
    solution: Solution = field(repr=False)
    gradient: Mapping[str, float] | None = field(default=None, repr=False)
    taxels_n: Array | None = field(default=None, repr=False)

    @property
    def displacement_m(self) -> Array:
        """Of the mesh's nodes (n, 2) [m]; (n, 3) in a solid."""
        return self.solution.displacement


@dataclass(frozen=True)
class Press:
    """A press with one state per pressure.

    ``pulse_error_estimate_pct`` is that of the span of forces, over the span or a thousandth of the
    force, whichever is larger; None at a single pressure.
    ``element`` is named as in `sim_backend.fem.elements`, and ``why`` says why this model.

    Examples
    --------
    >>> import palpate
    >>> pressed = palpate.press(
    ...     "TIHA", x_mm=32.0, depth_mm=1.0, pressures_mmhg=[80.0, 120.0], accuracy_pct=5
    ... )
    >>> len(pressed.states), pressed.pulse_n > 0, pressed.error_estimate_pct < 5
    (2, True, True)
    """

    scene: Scene
    x_mm: float
    depth_mm: float
    model: str
    dofs: int
    seconds: float
    force_error_estimate_pct: float
    pulse_error_estimate_pct: float | None
    states: tuple[State, ...]
    solved: Solved = field(repr=False)
    element: str
    why: str

    @property
    def error_estimate_pct(self) -> float:
        """The larger of those of force and of pulse."""
        return max(self.force_error_estimate_pct, self.pulse_error_estimate_pct or 0.0)

    @property
    def contact_stress_pa(self) -> list[float]:
        """The tactile signal of each state [Pa]: force over the finger's projected area."""
        return [s.force_n / (1e-6 * self.scene.face_mm2) for s in self.states]

    @property
    def pulse_pa(self) -> float | None:
        """Span of the contact stress over the pressures [Pa]; None at a single one."""
        return None if self.pulse_n is None else self.pulse_n / (1e-6 * self.scene.face_mm2)

    def __repr__(self) -> str:
        forces = ", ".join(f"{s.force_n:.4g}" for s in self.states)
        return (
            f"Press({self.scene.name}, x {self.x_mm:g} mm, depth {self.depth_mm:g} mm: {forces} "
            f"N, {self.model}, error {self.error_estimate_pct:.2g} %)"
        )

    def _repr_html_(self) -> str:
        """A table of the states and, for several, force over pressure, for notebooks."""
        rows = [
            (
                f"{s.pressure_mmhg:g}",
                f"{s.force_n:.5g}",
                f"{s.von_mises_pa:.0f}",
                f"{s.contact_mm[0]:.2f} to {s.contact_mm[1]:.2f} ± {s.contact_error_mm:.2g}",
            )
            for s in self.states
        ]
        head = ("pressure mmHg", "force N", "von Mises Pa", "contact mm")
        pressures = [s.pressure_mmhg for s in self.states]
        forces = {"force": [s.force_n for s in self.states]}
        picture = html.lines(pressures, forces, "pressure mmHg", "N") if len(rows) > 1 else ""
        return f"<code>{html.escape(repr(self))}</code>" + html.table(rows, head) + picture

    @property
    def pulse_n(self) -> float | None:
        """Span of the finger's force over the pressures [N]; None at a single one."""
        forces = [s.force_n for s in self.states]
        return max(forces) - min(forces) if len(forces) > 1 else None

    @property
    def pulse_gradient(self) -> dict[str, float] | None:
        """How much the pulse changes [N] for one more of each number; None where it was not asked,
        or there is no pulse. Its pressures rise together."""
        low, high = (pick(self.states, key=lambda s: s.force_n) for pick in (min, max))
        if self.pulse_n is None or low.gradient is None or high.gradient is None:
            return None
        return {key: by - low.gradient[key] for key, by in high.gradient.items()}

    @property
    def pulse_error_n(self) -> float | None:
        """What the pulse may be off by [N]; None at a single pressure."""
        if self.pulse_n is None or self.pulse_error_estimate_pct is None:
            return None
        largest_n = max(abs(s.force_n) for s in self.states)
        return 0.01 * self.pulse_error_estimate_pct * max(self.pulse_n, SMALL_PULSE * largest_n)

    def as_json(self) -> dict[str, object]:
        """The contract of ``palpate press --json``."""
        return {
            "scene": self.scene.name,
            "x_mm": self.x_mm,
            "depth_mm": self.depth_mm,
            "model": self.model,
            "element": self.element,
            "why": self.why,
            "dofs": self.dofs,
            "seconds": round(self.seconds, 4),
            "error_estimate_pct": _rounded(self.error_estimate_pct),
            "force_error_estimate_pct": _rounded(self.force_error_estimate_pct),
            "pulse_error_estimate_pct": _rounded(self.pulse_error_estimate_pct),
            "pulse_n": self.pulse_n,
            "pulse_error_n": self.pulse_error_n,
            "pulse_pa": self.pulse_pa,
            **({} if (change := self.pulse_gradient) is None else {"pulse_gradient": change}),
            "states": [
                {
                    "pressure_mmhg": s.pressure_mmhg,
                    "force_n_per_mm": s.force_n_per_mm if isfinite(s.force_n_per_mm) else None,
                    "force_n": s.force_n,
                    "contact_stress_pa": stress_pa,
                    "von_mises_pa": s.von_mises_pa,
                    "contact_mm": list(s.contact_mm),
                    "contact_error_mm": s.contact_error_mm,
                    "min_jacobian": s.min_jacobian,
                    "stable": s.stable,
                    **({} if s.gradient is None else {"gradient": dict(s.gradient)}),
                    **({} if s.taxels_n is None else {"taxels_n": s.taxels_n.tolist()}),
                }
                for s, stress_pa in zip(self.states, self.contact_stress_pa, strict=True)
            ],
        }


def press(
    scene: Scene | str | Path,
    x_mm: float,
    depth_mm: float,
    pressures_mmhg: float | Iterable[float] | None = None,
    *,
    model: str = "auto",
    accuracy_pct: float = 1.0,
    gradient: bool = False,
    taxels: TaxelArray | None = None,
    solving: Solving | None = None,
) -> Press:
    """Press a finger into a scene by finite elements.

    Parameters
    ----------
    scene
        A `Scene`, a built-in name or a scene file.
    x_mm
        Where along the surface.
    depth_mm
        How deep the finger goes below the surface.
    pressures_mmhg
        The pressures in the lumen, one state each, in order. By default the scene's
        diastolic and systolic ones if it has a vessel, otherwise 0.
    model
        ``finite`` or ``small`` strain in a plane; ``axisymmetric`` or ``solid`` in space; ``auto``
        takes the cheapest model and mesh that keep ``accuracy_pct``.
    accuracy_pct
        How far force and pulse may be off [%]. Meshes are refined until this is reached;
        where it cannot be, the stated error is larger.
    gradient
        Let each state say what its force changes with: exactly on its mesh, at finite
        strain, nothing of the scene left out.
    taxels
        An array in the finger: let each state say how its force is spread over that.
    solving
        Given a line about each mesh before it is solved; without it a notebook shows them
        below the cell.

    Returns
    -------
    Press
        The states, their force, contact and stress, and the error estimate.

    Raises
    ------
    SceneError
        A press that cannot be meant.
    CannotSolve
        Where physics ends, and which limit was met.

    Examples
    --------
    >>> import palpate
    >>> pressed = palpate.press("TI", x_mm=32.0, depth_mm=1.0, accuracy_pct=5)
    >>> 0.2 < pressed.states[0].force_n < 0.4
    True
    """
    if solving is None:
        with notebook_line() as line:
            return press(
                scene, x_mm, depth_mm, pressures_mmhg, model=model, accuracy_pct=accuracy_pct,
                gradient=gradient, taxels=taxels, solving=lambda what: line(f"solving {what}"),
            )  # fmt: skip
    if not isinstance(scene, Scene):  # what cannot beat can be solved, as a stored run's may be
        scene = load_scene(scene)
        load_wave(scene.pulse)
    if pressures_mmhg is None:
        pressures_mmhg = scene_pressures_mmhg(scene)
    elif isinstance(pressures_mmhg, str):
        raise SceneError(f"pressures_mmhg = {pressures_mmhg!r}: must be a number, or several")
    elif not isinstance(pressures_mmhg, Iterable):
        pressures_mmhg = (pressures_mmhg,)
    pressures = tuple(float(p) for p in pressures_mmhg) or (0.0,)
    check_asked(scene, x_mm, depth_mm, pressures, accuracy_pct)
    began = perf_counter()
    pressures_pa = tuple(p * PA_PER_MMHG for p in pressures)
    asked = Asked(
        scene, 1e-3 * x_mm, 1e-3 * depth_mm, pressures_pa, accuracy_pct, gradient, taxels, solving
    )
    solved = choose(asked, model)
    force_pct, pulse_pct = (float(pct) for pct in solved.error_pct)
    states = _states(solved, pressures, gradient=gradient, taxels=taxels)
    return Press(
        scene, x_mm, depth_mm, solved.model, len(solved.body.free),
        perf_counter() - began, force_pct, pulse_pct if len(pressures) > 1 else None, states,
        solved, solved.kind.element(scene), solved.why,
    )  # fmt: skip


def scene_pressures_mmhg(scene: Scene) -> tuple[float, ...]:
    """Diastolic and systolic where there is a vessel, else 0."""
    pulse = scene.pulse
    return (pulse.diastolic_mmhg, pulse.systolic_mmhg) if scene.arteries else (0.0,)


def _rounded(pct: float | None) -> float | None:
    return None if pct is None else float(f"{pct:.3g}")


def _states(
    solved: Solved, pressures: Sequence[float], *, gradient: bool, taxels: TaxelArray | None
) -> tuple[State, ...]:
    per_mm, contact_mm = 1e-3 * solved.force_n_per_m, 1e3 * solved.contact_m
    by = solved.gradient if gradient else {}
    on_taxels = solved.taxels_n(taxels) if taxels else None
    return tuple(
        State(
            pressure_mmhg, float(per_mm[k]), float(solved.force_n[k]),
            float(solved.von_mises_pa[k]), (float(contact_mm[k, 0]), float(contact_mm[k, 1])),
            float(contact_mm[k, 2]),
            float(solved.least_volume_ratio[k]), solution.stable, solution,
            {key: float(value[k]) for key, value in by.items()} if gradient else None,
            None if on_taxels is None else on_taxels[k],
        )
        for k, (solution, pressure_mmhg) in enumerate(zip(solved.states, pressures, strict=True))
    )  # fmt: skip
