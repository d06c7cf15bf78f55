"""The simplest model that a scene needs: what can be left out, and the error of leaving it out.

Bounds measured on usual scenes say what might be left out. Before it is, the effect itself is
measured: the press is solved with and without it on the first, coarse mesh.
"""

from dataclasses import dataclass, field
from math import exp

from sim_backend.fem.finite_strain import Solved
from sim_backend.fem.newton import CannotSolve
from sim_backend.models.refine import Solving, on_first_mesh
from sim_backend.scene.inclusion import Artery, Inclusion
from sim_backend.scene.scene_file import Scene, SceneError

SMALL_PCT, SMALL_POWER = 45.0, 1.35
"""Bound of what small strain misses of the force, over the depth in half widths of the finger. Over
TI and TIT, 0.4 to 1.6 mm deep, the bound is 2.0 to 3.9 times what is missed."""
SMALL_LIMIT_PCT = 10.0
"""Small strain that misses more of the force is refused."""
SMALL_PULSE_PCT = 75.0
"""What small strain is said to miss of a pulse. Of TIHA's over its middle, 80 to 120 mmHg, it
misses 46 % at 0.05 mm, 50 % at 0.5 mm, 59 % at 1.5 mm and 68 % at 2.5 mm."""
FAR_PCT, FAR_SHARE = 150.0, 0.121
"""Bound of what an unfilled inclusion changes of the force, by the distance from its edge over the
block's height. 2 to 14 mm beside the tumour of TIT and the vessel of TIHA, 2.5 mm deep, the bound
is at least 2.2 times the change. It only says what is worth trying: benchmarks/choice.py judges
what is chosen in the end."""
SAFETY = 2.0
"""What is left out costs at most this times its effect on a coarse mesh."""


@dataclass(frozen=True)
class Choice:
    """The ``model`` to solve (``finite``, ``small``, ``axisymmetric`` or ``solid``), the ``scene``
    that it must see, and the error of both [%], in force and in pulse; ``why`` is for a person.
    ``first`` is what the first mesh said of it, lumens empty, if that was asked."""

    model: str
    scene: Scene
    error_pct: float
    pulse_error_pct: float = 0.0
    why: str = "as asked for"
    first: Solved | None = None


def named(model: str, scene: Scene, depth_mm: float, pressures_mmhg: tuple[float, ...]) -> Choice:
    """The model that a user names for a section. Raises `CannotSolve` for small strain where it is
    nonsense, `SceneError` for a model of bodies of revolution or of solids."""
    if model in ("axisymmetric", "solid"):
        raise SceneError(
            f"model = {model!r}: scene {scene.name} is plane = {scene.plane!r}, to be solved by "
            "finite or small strain"
        )
    if model != "small":
        return Choice(model, scene, 0.0)
    if scene.indenter.bonded:
        raise CannotSolve("small strain", "a bonded finger needs the finite-strain model.")
    pct = small_strain_error_pct(scene, depth_mm)
    if pct > SMALL_LIMIT_PCT:
        half_mm = 1e3 * scene.indenter.profile.scale
        limit_mm = half_mm * (SMALL_LIMIT_PCT / SMALL_PCT) ** (1 / SMALL_POWER)
        raise CannotSolve(
            "small strain",
            f"small strain misses about {pct:.0f} % of the force {depth_mm:g} mm deep: press less "
            f"than {limit_mm:.2g} mm deep or take the finite-strain model.",
        )
    beats = bool(scene.arteries) and len(set(pressures_mmhg)) > 1
    return Choice(model, scene, pct, SMALL_PULSE_PCT if beats else 0.0)


def choose(
    scene: Scene,
    x_mm: float,
    depth_mm: float,
    pressures_mmhg: tuple[float, ...],
    budget_pct: float,
    solving: Solving = lambda _what: None,
) -> Choice:
    """Leave out what costs at most half of ``budget_pct``; the mesh may use the rest.

    Inclusions too far away to matter go first, then finite strain. A filled vessel is always
    kept, at finite strain: its pressure acts tens of millimetres away, and small strain misses
    about half of its pulse or more at any depth. ``solving`` receives what is solved to find
    out. Raises `CannotSolve`.
    """
    filled = any(p > 0 for p in pressures_mmhg)
    kept, far_pct = _without_far(scene, x_mm, filled, budget_pct)
    first = _FirstMesh(1e-3 * x_mm, 1e-3 * depth_mm)
    if kept != scene:
        solving("what far inclusions do to the force, on a coarse mesh")
        effect_pct = first.effect_pct(("finite", scene), ("finite", kept))
        if effect_pct > budget_pct / 4:
            kept, far_pct = scene, 0.0
        far_pct = max(far_pct, effect_pct) if kept != scene else 0.0
    small_pct = small_strain_error_pct(scene, depth_mm)
    effect_pct = 0.0
    stiff_only = not (filled and kept.arteries) and scene.tissue is not None
    if stiff_only and not scene.indenter.bonded and small_pct <= budget_pct / 4:
        solving("what finite strain does to the force, on a coarse mesh")
        effect_pct = first.effect_pct(("finite", kept), ("small", kept))
        if effect_pct <= budget_pct / 4:
            missed_pct = max(small_pct, effect_pct)
            why = f"small strain misses about {missed_pct:.2g} % of the force here"
            known = first.known[("small", kept)]
            return Choice("small", kept, far_pct + missed_pct, why=why, first=known)
    if filled and kept.arteries:
        why = "small strain would miss half or more of a filled vessel's pulse"
    elif scene.tissue is None:
        why = "a lone vessel bends too far for small strain"
    elif scene.indenter.bonded:
        why = "a bonded finger needs finite strain"
    else:
        missed_pct = max(small_pct, effect_pct)
        why = f"small strain might miss {missed_pct:.2g} % of the force here"
    return Choice("finite", kept, far_pct, why=why, first=first.known.get(("finite", kept)))


@dataclass
class _FirstMesh:
    """What the first mesh of a press says of each model and scene that it was asked for. Lumens are
    empty: what is filled is kept."""

    x_m: float
    depth_m: float
    known: dict[tuple[str, Scene], Solved] = field(default_factory=dict)

    def effect_pct(self, whole: tuple[str, Scene], less: tuple[str, Scene]) -> float:
        """How much force the lesser model misses, taken `SAFETY` times [%]."""
        for one in (whole, less):
            if one not in self.known:
                self.known[one] = on_first_mesh(*one, self.x_m, self.depth_m)
        force = [self.known[one][1][0].force_n_per_m for one in (whole, less)]
        return SAFETY * 100 * abs(force[1] / force[0] - 1)


def _without_far(scene: Scene, x_mm: float, filled: bool, budget_pct: float) -> tuple[Scene, float]:
    """The scene without what may be too far away to matter, and what that costs [%]."""
    near, far_pct = [], 0.0
    for one in scene.inclusion:
        pct = far_error_pct(scene, one, x_mm)
        pulsing = filled and isinstance(one, Artery)
        if scene.tissue is None or pulsing or far_pct + pct > budget_pct / 4:
            near.append(one)
        else:
            far_pct += pct
    return scene.model_copy(update={"inclusion": tuple(near)}), far_pct


def small_strain_error_pct(scene: Scene, depth_mm: float) -> float:
    """Of the force over a scene without pressure, by depth over the finger's half width."""
    return float(SMALL_PCT * (1e-3 * depth_mm / scene.indenter.profile.scale) ** SMALL_POWER)


def far_error_pct(scene: Scene, one: Inclusion, x_mm: float) -> float:
    """Of the force when an unfilled inclusion is left out: it fades with distance over height."""
    distance_mm = max(abs(one.x_mm - x_mm) - one.outer_radius_mm, 0.0)
    return FAR_PCT * exp(-distance_mm / (FAR_SHARE * scene.surface_mm))
