"""The table of models of a press, cheapest first, and the choice among them.

Each entry says what it costs and what it may be off by. Bounds measured on usual scenes say what
might be left out. Before it is, the effect itself is measured: the press is solved with and without
it on the first, coarse mesh. A press that turns out rougher than it was asked for is solved again
by the next entry.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import exp

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.axisymmetric import is_round
from sim_backend.fem.body import Body
from sim_backend.fem.newton import PAIRS_WITH_OPEN_LUMENS, CannotSolve, Solution
from sim_backend.models.kinds import REVOLVED, SECTION, SOLID, BodyKind
from sim_backend.models.quick import solve_quick
from sim_backend.models.refine import Meshed, Solving, refine
from sim_backend.models.round_press import holds_a_round_block, refine_axisymmetric
from sim_backend.models.section_meshes import SectionMeshes
from sim_backend.models.solid_meshes import SHARES, SolidMeshes, need_wide_taxels
from sim_backend.models.solved import Solved
from sim_backend.scene.inclusion import Artery, Inclusion
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.taxels import TaxelArray

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
SELF_CONTACT_PCT = 3.0
"""Error of a pulse where a lumen's walls touch: elements differ by up to 6 % there."""


@dataclass(frozen=True)
class Asked:
    """A press ``depth_m`` deep at ``x_m`` [m], one state per lumen pressure, and what is wanted of
    it. ``solving`` receives a line about what is solved next."""

    scene: Scene
    x_m: float
    depth_m: float
    pressures_pa: Sequence[float]
    accuracy_pct: float = 1.0
    gradient: bool = False
    taxels: TaxelArray | None = None
    solving: Solving = lambda _what: None
    _coarse: dict[tuple[str, Scene], Meshed] = field(default_factory=dict)

    @property
    def filled(self) -> bool:
        """Whether there is pressure in a lumen."""
        return any(p > 0 for p in self.pressures_pa)

    def coarse(self, model: str, scene: Scene) -> Meshed:
        """What the first mesh says of a section, lumens empty: what is filled is kept."""
        if (model, scene) not in self._coarse:
            meshes = SectionMeshes(model, scene, self.x_m, self.depth_m, [0.0])
            self._coarse[model, scene] = meshes.solve(meshes.first_share, None, stated=False)
        return self._coarse[model, scene]

    def first(self, model: str, scene: Scene) -> Meshed | None:
        """The same where it is known, and is what was asked for."""
        return self._coarse.get((model, scene)) if list(self.pressures_pa) == [0.0] else None

    def effect_pct(self, whole: tuple[str, Scene], less: tuple[str, Scene]) -> float:
        """How much force the lesser model misses, taken `SAFETY` times [%]."""
        force = [self.coarse(*one)[1][0].force for one in (whole, less)]
        return SAFETY * 100 * abs(force[1] / force[0] - 1)

    @cached_property
    def without_far(self) -> tuple[Scene, float]:
        """The scene without what is too far away to matter, and what that costs of the force [%].
        A filled vessel is always kept: its pressure acts tens of millimetres away."""
        if self.gradient:
            return self.scene, 0.0
        near, far_pct = [], 0.0
        for one in self.scene.inclusion:
            pct = far_error_pct(self.scene, one, 1e3 * self.x_m)
            pulsing = self.filled and isinstance(one, Artery)
            if self.scene.tissue is None or pulsing or far_pct + pct > self.accuracy_pct / 4:
                near.append(one)
            else:
                far_pct += pct
        kept = self.scene.model_copy(update={"inclusion": tuple(near)})
        if kept == self.scene:
            return self.scene, 0.0
        self.solving("what far inclusions do to the force, on a coarse mesh")
        effect_pct = self.effect_pct(("finite", self.scene), ("finite", kept))
        if effect_pct > self.accuracy_pct / 4:
            return self.scene, 0.0
        return kept, max(far_pct, effect_pct)


@dataclass(frozen=True)
class Choice:
    """The ``scene`` that a model must see, the errors (force, pulse) [%] of model and scene before
    any mesh's, and why it is this model, for a person."""

    scene: Scene
    error_pct: tuple[float, float] = (0.0, 0.0)
    why: str = "as asked for"


@dataclass(frozen=True)
class Model:
    """An entry: a ``name``, the ``planes`` of scenes that it solves as a ``kind`` of body, and its
    ``cost``, the time of a usual press over that of a section at finite strain; ``usual_pct`` is
    the error of the force that usual presses reach.

    ``offer`` is its choice within half of the accuracy asked for, or why it has none, if that is
    to be said; ``named`` is its choice where a person wants it, and raises where that is nonsense.
    ``solve`` gives body, states and the errors (force, pulse) [%] that meshes leave. ``gradient``:
    derivatives of its forces are known.
    """

    name: str
    planes: tuple[str, ...]
    kind: BodyKind
    cost: float
    usual_pct: float
    gradient: bool
    offer: Callable[[Asked], Choice | str]
    named: Callable[[Asked], Choice]
    solve: Callable[[Asked, Choice, Array], tuple[Body, Sequence[Solution], Array]]

    def solved(self, asked: Asked, choice: Choice) -> Solved:
        """The press by this model. Raises `CannotSolve`."""
        model_pct = np.array(choice.error_pct)
        left_pct = np.maximum(asked.accuracy_pct - model_pct, asked.accuracy_pct / 2)
        body, states, mesh_pct = self.solve(asked, choice, left_pct)
        closed = any(len(state.multiplier) > PAIRS_WITH_OPEN_LUMENS for state in states)
        least_pct = SELF_CONTACT_PCT if closed and len(states) > 1 else 0.0
        error_pct = np.maximum(model_pct + mesh_pct, [0.0, least_pct])
        return Solved(
            asked.scene, asked.x_m, self.name, self.kind, body, tuple(states), error_pct,
            choice.why, len(asked.scene.inclusion) - len(choice.scene.inclusion), self.gradient,
        )  # fmt: skip


def choose(asked: Asked, name: str = "auto") -> Solved:
    """The press by the cheapest model that keeps the accuracy asked for, or by the one named.

    Raises `SceneError` for a model that the scene, or its gradient, cannot have, and `CannotSolve`.
    """
    models = _models(asked, name)
    if name != "auto":
        return models[0].solved(asked, models[0].named(asked))
    why = f"the cheapest model {'with a gradient ' if asked.gradient else ''}for this scene"
    for model in models:
        offer = model.offer(asked)
        if isinstance(offer, str):
            why = offer or why
            continue
        solved = model.solved(asked, replace(offer, why=offer.why or why))
        if model is models[-1] or (solved.error_pct <= asked.accuracy_pct).all():
            return solved
        why = f"{model.name} would leave an error of {solved.error_pct.max():.2g} %"
    raise AssertionError("the last model of a plane makes an offer to every scene")


def steady(asked: Asked, name: str = "auto") -> Model:
    """The one model to take for presses of all depths down to the one asked for, or the one named:
    the cheapest that the deepest press may have. Raises `SceneError`."""
    models = _models(asked, name)
    offered = (m for m in models if not isinstance(m.offer(asked), str))
    return models[0] if name != "auto" else next(offered)


def names(scene: Scene) -> list[str]:
    """Of the models that there are for a scene, the dearest last."""
    return [model.name for model in MODELS if scene.plane in model.planes]


def _models(asked: Asked, name: str) -> list[Model]:
    """Those that there are for what is asked, the dearest last; the one named, if one is."""
    scene = asked.scene
    models = [model for model in MODELS if scene.plane in model.planes]
    if asked.gradient:
        models = [model for model in models if model.gradient]
        if any(one.path for one in scene.arteries):
            raise SceneError(f"{scene.name}: gradients of a vessel with a path are not known")
    if name in ("auto", *(model.name for model in models)):
        return [model for model in models if name in ("auto", model.name)]
    raise SceneError(
        f"model = {name!r}: scene {scene.name}, which is plane = {scene.plane!r}, is solved as "
        f"{' or '.join(model.name for model in models)}; take that, or leave model out"
        + (" (gradients are of finite strain)" if asked.gradient else "")
    )


def _small_offer(asked: Asked) -> Choice | str:
    """Small strain misses half or more of a filled vessel's pulse, and bends no lone vessel."""
    kept, far_pct = asked.without_far
    if asked.filled and kept.arteries:
        return "small strain would miss half or more of a filled vessel's pulse"
    if kept.tissue is None:
        return "a lone vessel bends too far for small strain"
    if kept.indenter.bonded:
        return "a bonded finger needs finite strain"
    missed_pct = small_strain_error_pct(kept, 1e3 * asked.depth_m)
    if missed_pct <= asked.accuracy_pct / 4:
        asked.solving("what finite strain does to the force, on a coarse mesh")
        effect_pct = asked.effect_pct(("finite", kept), ("small", kept))
        missed_pct = max(missed_pct, effect_pct)
        if effect_pct <= asked.accuracy_pct / 4:
            why = f"small strain misses about {missed_pct:.2g} % of the force here"
            return Choice(kept, (far_pct + missed_pct, 0.0), why)
    return f"small strain might miss {missed_pct:.2g} % of the force here"


def _small_named(asked: Asked) -> Choice:
    scene, depth_mm = asked.scene, 1e3 * asked.depth_m
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
    beats = bool(scene.arteries) and len(set(asked.pressures_pa)) > 1
    return Choice(scene, (pct, SMALL_PULSE_PCT if beats else 0.0))


def _finite_offer(asked: Asked) -> Choice | str:
    kept, far_pct = asked.without_far
    return Choice(kept, (far_pct, 0.0), why="")


def _as_it_is(asked: Asked) -> Choice:
    return Choice(asked.scene)


def _refined_section(
    model: str, asked: Asked, choice: Choice, left_pct: Array
) -> tuple[Body, Sequence[Solution], Array]:
    meshes = SectionMeshes(model, choice.scene, asked.x_m, asked.depth_m, asked.pressures_pa)
    first = asked.first(model, choice.scene)
    refined = refine(meshes, left_pct, first=first, solving=asked.solving)
    return *refined.solved, refined.error_pct


def _on_the_mesh_of_scans(
    asked: Asked, choice: Choice, _left_pct: Array
) -> tuple[Body, Sequence[Solution], Array]:
    return solve_quick(choice.scene, asked.x_m, asked.depth_m, asked.pressures_pa)


def _round_offer(asked: Asked) -> Choice | str:
    place = asked.scene, asked.x_m
    if not (is_round(*place) and holds_a_round_block(*place, asked.depth_m)):
        return "finger, block and what lies below are not round about one axis"
    why = "finger and block are round, and nothing lies aside of them"
    return Choice(asked.scene, why=why)


def _round_named(asked: Asked) -> Choice:
    if not is_round(asked.scene, asked.x_m):
        raise SceneError(
            f"model = 'axisymmetric': scene {asked.scene.name} is a solid, to be solved as solid, "
            "or as axisymmetric under a sphere or a round flat, over nothing or over one ball "
            "right below"
        )
    return Choice(asked.scene)


def _refined_round(
    asked: Asked, _choice: Choice, _left_pct: Array
) -> tuple[Body, Sequence[Solution], Array]:
    body, state, force_pct = refine_axisymmetric(
        asked.scene, asked.x_m, asked.depth_m, asked.accuracy_pct, asked.solving
    )
    return body, [state] * len(asked.pressures_pa), np.array([force_pct, 0.0])


def _refined_solid(
    asked: Asked, choice: Choice, left_pct: Array
) -> tuple[Body, Sequence[Solution], Array]:
    if asked.taxels:
        need_wide_taxels(asked.scene, asked.taxels, SHARES[1])
    meshes = SolidMeshes(choice.scene, asked.x_m, asked.depth_m, asked.pressures_pa)
    refined = refine(meshes, left_pct, solving=asked.solving)
    return *refined.solved, refined.error_pct


SECTIONS, SOLIDS = ("stress", "strain"), ("solid",)
MODELS = (
    Model("small", SECTIONS, SECTION, 0.2, 0.2, False,
          _small_offer, _small_named, partial(_refined_section, "small")),
    Model("quick", SECTIONS, SECTION, 0.3, 0.7, True,
          lambda _: "", _as_it_is, _on_the_mesh_of_scans),
    Model("finite", SECTIONS, SECTION, 1.0, 0.2, True,
          _finite_offer, _as_it_is, partial(_refined_section, "finite")),
    Model("axisymmetric", SOLIDS, REVOLVED, 0.3, 1.0, False,
          _round_offer, _round_named, _refined_round),
    Model("solid", SOLIDS, SOLID, 30.0, 3.0, True,
          lambda asked: Choice(asked.scene, why=""), _as_it_is, _refined_solid),
)  # fmt: skip
"""Cheapest first of each plane; the last of each makes an offer to every scene."""


def small_strain_error_pct(scene: Scene, depth_mm: float) -> float:
    """Of the force over a scene without pressure, by depth over the finger's half width."""
    return float(SMALL_PCT * (1e-3 * depth_mm / scene.indenter.profile.scale) ** SMALL_POWER)


def far_error_pct(scene: Scene, one: Inclusion, x_mm: float) -> float:
    """Of the force when an unfilled inclusion is left out: it fades with distance over height."""
    distance_mm = max(abs(one.x_mm - x_mm) - one.outer_radius_mm, 0.0)
    return FAR_PCT * exp(-distance_mm / (FAR_SHARE * scene.surface_mm))
