"""How a solution of each kind of body is read: sections, bodies of revolution, solids."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from sim_backend.arrays import Array
from sim_backend.fem import stress
from sim_backend.fem.lumen import flatness
from sim_backend.fem.model import best_element
from sim_backend.fem.newton import Solution
from sim_backend.fem.picture import Picture, SectionPicture
from sim_backend.fem.solid import stress as solid_stress
from sim_backend.fem.solid.cut import Cut
from sim_backend.fem.taxels import section_taxels_n, solid_taxels_n
from sim_backend.scene.scene_file import Scene


@dataclass(frozen=True)
class BodyKind:
    """A row: ``element`` is the usual element's name. With ``per_length`` `Solution.force` is
    across a section, else the whole finger's. Of a body and displacements ``von_mises_pa`` is
    the stress under the finger, and of lumens and displacements ``flatness`` how flat the flattest
    is pressed. Of a body and a solution ``contact_m`` is what is touched to either side of the
    finger's middle, and ``taxels_n`` takes the edges across and along, and the finger's length
    [m], too.
    """

    element: Callable[[Scene], str]
    per_length: bool
    von_mises_pa: Callable[[Any, Array], float]
    flatness: Callable[[Any, Array], float]
    contact_m: Callable[[Any, Solution], tuple[float, float, float]]
    taxels_n: Callable[[Any, Solution, Array, Array, float], Array]
    picture: Callable[[Any], Picture]

    def length_m(self, scene: Scene) -> float:
        """What `Solution.force` is to be multiplied by: the finger's length [m], or nothing."""
        return 1e-3 * scene.indenter.length_mm if self.per_length else 1.0


def _wedges(_: Scene) -> str:
    return "wedge"


def _not_known(_lumens: object, _u: Array) -> float:
    return 1.0


# Functions with names: a press goes to other processes.
SECTION = BodyKind(
    best_element, True, stress.under_finger_pa, flatness, stress.contact_m, section_taxels_n,
    SectionPicture,
)  # fmt: skip
REVOLVED = replace(SECTION, per_length=False)
SOLID = BodyKind(
    _wedges, False, solid_stress.under_finger_pa, _not_known, solid_stress.contact_m,
    solid_taxels_n, Cut,
)  # fmt: skip
