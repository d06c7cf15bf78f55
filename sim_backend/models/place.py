"""One place of a scene, and what the finger meets there."""

from collections.abc import Sequence
from typing import NamedTuple

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


def place(scene: Scene, x_m: float, z_m: float = 0.0) -> Place:
    """Where a finger presses: ``x_m`` along the surface, ``z_m`` along the vessels. Raises
    `SceneError` beyond a solid's ends."""
    return Place(section_at(scene, 1e3 * z_m) if z_m else scene, x_m)
