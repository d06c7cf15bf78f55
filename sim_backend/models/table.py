"""The table of models of a press, cheapest first, and the choice among them.

Each entry says what it costs and what it may be off by. A press that turns out rougher than it was
asked for is solved again by the next entry.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.newton import PAIRS_WITH_OPEN_LUMENS, CannotSolve
from sim_backend.models.bodies import REVOLVED, SECTION, SOLID, BodyKind, body_of
from sim_backend.models.refine import Asked, Refined, refine
from sim_backend.models.round_press import holds_a_round_block, refine_axisymmetric
from sim_backend.models.section_meshes import SectionMeshes
from sim_backend.models.solid_meshes import SHARES, SolidMeshes, need_wide_taxels
from sim_backend.models.solved import Solved
from sim_backend.scene.scene_file import Scene, SceneError

SMALL_PCT, SMALL_POWER = 45.0, 1.35
"""Bound of what small strain misses of the force, over the depth in half widths of the finger. Over
TI and TIT, 0.4 to 1.6 mm deep, the bound is 2.0 to 3.9 times what is missed."""
SMALL_LIMIT_PCT = 10.0
"""Small strain that misses more of the force is refused."""
SMALL_PULSE_PCT = 75.0
"""What small strain is said to miss of a pulse. Of TIHA's over its middle, 80 to 120 mmHg, it
misses 46 % at 0.05 mm, 50 % at 0.5 mm, 59 % at 1.5 mm and 68 % at 2.5 mm."""
SELF_CONTACT_PCT = 3.0
"""Error of a pulse where a lumen's walls touch: elements differ by up to 6 % there."""


@dataclass(frozen=True)
class Model:
    """An entry: a ``name``, the kind ``of`` the scenes that it solves as a ``kind`` of body, and
    its ``cost``, the time of a usual press over that of a section at finite strain; ``usual_pct``
    is the error of the force that usual presses reach. ``gradient``: derivatives of its forces are
    known.

    ``solve`` is given the errors that meshes may leave. ``why`` says to a person why it is chosen
    for what is ``offered``. ``own_pct`` is what it misses of (force, pulse) on any mesh, and raises
    where it is nonsense.
    """

    name: str
    of: BodyKind
    kind: BodyKind
    cost: float
    usual_pct: float
    gradient: bool
    solve: Callable[[Asked, Array], Refined]
    why: str = ""
    offered: Callable[[Asked], bool] = lambda _: True
    own_pct: Callable[[Asked], tuple[float, float]] = lambda _: (0.0, 0.0)

    def solved(self, asked: Asked, why: str) -> Solved:
        """The press by this model. Raises `CannotSolve`, and `SceneError` where it cannot be."""
        own_pct = np.array(self.own_pct(asked))
        left_pct = np.maximum(asked.accuracy_pct - own_pct, asked.accuracy_pct / 2)
        refined = self.solve(asked, left_pct)
        body, states = refined.solved
        closed = any(len(state.multiplier) > PAIRS_WITH_OPEN_LUMENS for state in states)
        least_pct = SELF_CONTACT_PCT if closed and len(states) > 1 else 0.0
        error_pct = np.maximum(own_pct + refined.error_pct, [0.0, least_pct])
        return Solved(
            asked.scene, asked.x_m, self.name, self.kind, body, tuple(states), error_pct, why,
            self.gradient,
        )  # fmt: skip


def choose(asked: Asked, name: str = "auto") -> Solved:
    """The press by the cheapest model that keeps the accuracy asked for, or by the one named.

    Raises `SceneError` for a model that the scene, or its gradient, cannot have, and `CannotSolve`,
    which names the limit that physics set.

    Examples
    --------
    >>> import palpate
    >>> solved = choose(Asked(palpate.load_scene("TI"), 0.032, 1e-3, accuracy_pct=5))
    >>> 0.2 < solved.force_n[0] < 0.4, solved.gradient["tissue.modulus_kpa"][0] > 0
    (True, True)
    """
    models, rougher = _models(asked, name), ""
    for model in models:
        why = "the cheapest model with a gradient for this scene" if asked.gradient else model.why
        solved = model.solved(asked, "as asked for" if name != "auto" else rougher or why)
        if model is models[-1] or (solved.error_pct <= asked.accuracy_pct).all():
            break
        rougher = f"{model.name} would leave an error of {solved.error_pct.max():.2g} %"
    return solved


def steady(asked: Asked, name: str = "auto") -> Model:
    """The one model to take for presses of all depths down to the one asked for, or the one named:
    the cheapest that the deepest press may have. Raises `SceneError`."""
    return _models(asked, name)[0]


def names(scene: Scene) -> list[str]:
    """Of the models that there are for a scene, the dearest last."""
    return [model.name for model in _offered(scene)]


def _offered(scene: Scene) -> list["Model"]:
    return [model for model in MODELS if model.of is body_of(scene)]


def _models(asked: Asked, name: str) -> list[Model]:
    """Those that are offered for what is asked, the dearest last; the one named, if one is."""
    scene = asked.scene
    models = _offered(scene)
    if asked.gradient:
        models = [model for model in models if model.gradient]
        if any(one.path for one in scene.arteries):
            raise SceneError(f"{scene.name}: gradients of a vessel with a path are not known")
    if name == "auto":
        return [model for model in models if model.why and model.offered(asked)]
    if named := [model for model in models if model.name == name]:
        return named
    raise SceneError(
        f"model = {name!r}: scene {scene.name}, which is plane = {scene.plane!r}, is solved as "
        f"{' or '.join(model.name for model in models)}; take that, or leave model out"
        + (" (gradients are of finite strain)" if asked.gradient else "")
    )


def _small_pct(asked: Asked) -> tuple[float, float]:
    """What small strain misses of the force over a scene without pressure, by depth over the
    finger's half width, and of a pulse. Raises `CannotSolve` where that is nonsense."""
    finger, depth_mm = asked.scene.indenter, 1e3 * asked.depth_m
    if finger.bonded:
        raise CannotSolve("small strain", "a bonded finger needs the finite-strain model.")
    half_mm = 1e3 * finger.profile.scale
    pct = SMALL_PCT * (depth_mm / half_mm) ** SMALL_POWER
    if pct > SMALL_LIMIT_PCT:
        limit_mm = half_mm * (SMALL_LIMIT_PCT / SMALL_PCT) ** (1 / SMALL_POWER)
        raise CannotSolve(
            "small strain",
            f"small strain misses about {pct:.0f} % of the force {depth_mm:g} mm deep: press less "
            f"than {limit_mm:.2g} mm deep or take the finite-strain model.",
        )
    beats = bool(asked.scene.arteries) and len(set(asked.pressures_pa)) > 1
    return float(pct), SMALL_PULSE_PCT if beats else 0.0


def _refined_section(model: str, asked: Asked, left_pct: Array) -> Refined:
    return refine(SectionMeshes(asked, model), left_pct)


def _refined_round(asked: Asked, _left_pct: Array) -> Refined:
    return refine_axisymmetric(asked)


def _refined_solid(asked: Asked, left_pct: Array) -> Refined:
    if asked.taxels:
        need_wide_taxels(asked.scene, asked.taxels, SHARES[1])
    return refine(SolidMeshes(asked), left_pct)


MODELS = (
    Model("small", SECTION, SECTION, 0.2, 0.2, False, partial(_refined_section, "small"),
          own_pct=_small_pct),
    Model("finite", SECTION, SECTION, 1.0, 0.2, True, partial(_refined_section, "finite"),
          "the cheapest model for this scene"),
    Model("axisymmetric", SOLID, REVOLVED, 0.3, 1.0, False, _refined_round,
          "finger and block are round, and nothing lies aside of them", holds_a_round_block),
    Model("solid", SOLID, SOLID, 30.0, 3.0, True, _refined_solid,
          "finger, block and what lies below are not round about one axis"),
)  # fmt: skip
"""Cheapest first of each plane; the last of each is offered for every scene. What has no ``why`` is
solved on request only: small strain on presses so shallow that it is within 1 % takes as long as
finite strain."""
