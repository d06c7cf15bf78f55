"""One place of a scene, and what the finger meets there."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim_backend.fem.continuation import continuation
from sim_backend.fem.finite_strain import down, filled
from sim_backend.fem.newton import Load
from sim_backend.models.bodies import body_of
from sim_backend.models.refine import Solving
from sim_backend.models.solved import Solved
from sim_backend.models.table import Asked, choose
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.slicing import section_at
from sim_backend.scene.taxels import TaxelArray


class Place(NamedTuple):
    """``x_m`` [m] along the surface of ``scene``, which is pressed above its z = 0."""

    scene: Scene
    x_m: float

    def solve(
        self,
        depth_m: float,
        pressures_pa: Sequence[float] = (0.0,),
        *,
        model: str = "auto",
        accuracy_pct: float = 1.0,
        gradient: bool = False,
        taxels: TaxelArray | None = None,
        solving: Solving = lambda _what: None,
    ) -> Solved:
        """Press ``depth_m`` deep, with each of ``pressures_pa`` in the lumens.

        ``model`` is an entry of `sim_backend.models.table`; ``gradient`` and ``taxels`` say what
        will be asked of the answer. Raises `SceneError` for a press that cannot be meant, and
        `CannotSolve`, which names the limit that physics set.

        Examples
        --------
        >>> import palpate
        >>> solved = place(palpate.load_scene("TI"), 0.032).solve(1e-3, accuracy_pct=5)
        >>> 0.2 < solved.force_n[0] < 0.4, solved.gradient["tissue.modulus_kpa"][0] > 0
        (True, True)
        """
        asked = Asked(
            self.scene, self.x_m, depth_m, pressures_pa, accuracy_pct, gradient, taxels, solving
        )
        return choose(asked, model)

    def ramp(self, depths_m: Sequence[float], pressures_pa: Sequence[float]) -> list[Solved]:
        """At each of increasing depths the body with each of ``pressures_pa`` in the lumens, all on
        the mesh of the place's station and by the model of its presses at all depths; errors are
        not known (NaN). Raises `CannotSolve`."""
        deepest_m = float(depths_m[-1])
        kind = body_of(self.scene)
        body = kind.body_for(self.scene, self.x_m, deepest_m)
        levels = [float(p) for p in pressures_pa] if body.lumens else [0.0]
        start, _ = filled(body, levels[0], deepest_m)
        ramp = down(body, start, [Load(float(d), levels[0]) for d in depths_m])
        solved = []
        for state in ramp:
            more = continuation(body, state, [Load(state.load.depth_m, p) for p in levels[1:]])
            states = (state, *more) if body.lumens else (state,) * len(pressures_pa)
            solved.append(Solved(
                self.scene, self.x_m, kind.model, kind, body, states, np.full(2, np.nan),
                "on one mesh for all depths",
            ))  # fmt: skip
        return solved


def place(scene: Scene, x_m: float, z_m: float = 0.0) -> Place:
    """Where a finger presses: ``x_m`` along the surface, ``z_m`` along the vessels. Raises
    `SceneError` beyond a solid's ends."""
    return Place(section_at(scene, 1e3 * z_m) if z_m else scene, x_m)
