"""The table of bodies: how each kind is meshed for all depths of a place, and how it is read.

Nothing else of the simulation asks what kind of body a scene is: it asks `body_of`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem import stress
from sim_backend.fem.lumen import flatness
from sim_backend.fem.model import best_element, build_section, usual_grading
from sim_backend.fem.newton import Solution
from sim_backend.fem.picture import Picture, SectionPicture
from sim_backend.fem.section import Section
from sim_backend.fem.solid import stress as solid_stress
from sim_backend.fem.solid.body import STEP, SolidBody
from sim_backend.fem.solid.build import build_body, half_width_m
from sim_backend.fem.solid.cut import Cut
from sim_backend.fem.taxels import section_taxels_n, solid_taxels_n
from sim_backend.models.response import Left
from sim_backend.models.solid_meshes import SHARES, need_wide_taxels
from sim_backend.scene.scene_file import Scene
from sim_backend.scene.taxels import TaxelArray

DEPTHS = np.array([0.04, 0.2, 0.55, 1.0])
"""Shares of the greatest depth at which a section is solved. Between them forces of TIHA and TIT
are within 0.09 % of the greatest, nearly as with seven shares and no slopes (0.06 %)."""
SOLID_DEPTHS = np.array([0.2, 0.4, 0.6, 0.8, 1.0])
"""Those of a solid. The first is 0.5 mm of the usual 2.5: a contact that is narrower than two
elements is resolved too roughly."""
TAXEL_DEPTHS = np.array([0.04, 0.1, 0.2, 0.38, 0.55, 0.7, 0.85, 1.0])
"""Those at which a section's taxels are read. Between them taxels of 1.25 mm over TIHA are within
1.2 % of the largest of the deepest press (four depths: 6 %, ten: 0.8 %)."""
RELATIVE_SIZE = 0.1
"""Element size over the finger's half width: 0.3 % of force, 2 % of pulse on the paper's scenes."""
GROWTH, COARSEST = 0.6, 0.24
"""How fast elements grow away from contact and vessels, and the largest over the height: that saves
a third of the time of `usual_grading`, for 0.15 % of the force at most."""
LEFT = Left(rest=0.006, change=0.03, between=0.0015)
"""The figures above, added. The change's grows with the square of how flat a lumen is pressed, as
that of `sim_backend.models.section_meshes`."""
SOLID_LEFT = Left(rest=0.05, change=0.05, between=0.01, faint=0.0015)
"""TIHA under a ball: from this mesh to the next the force changes by 1.7 %, which leaves 3.8 % at
the rate of `refine.ORDER`, and the pulse by 0.1 %, which one scene cannot promise to others;
between depths 0.2 % of the deepest. 20 mm beside TIHA's vessel under the cylinder the pulse is
0.9 mN of 8.3 off at 0.87 N, 0.11 % of the force."""


@dataclass(frozen=True)
class BodyKind:
    """A row, whose presses of all depths are named as by ``model``.

    ``element`` is the usual element's name. With ``per_length`` `Solution.force` is across a
    section, else the whole finger's. Of a body and displacements ``von_mises_pa`` is the stress
    under the finger, and of lumens and displacements ``flatness`` how flat the flattest is pressed.
    Of a body and a solution ``contact_m`` is what is touched to either side of the finger's middle,
    and ``taxels_n`` takes the edges across and along, and the finger's length [m], too.

    ``body_for`` is the mesh of a place [m] for all depths down to one [m]. A station is solved at
    ``depths``, shares of the greatest, in steps of ``longest_m``, and for an array at
    ``taxel_depths`` too, of which ``need_taxels`` refuses those that are too narrow. With ``exact``
    its slopes by depth and pressure are the tangent's; else elements are too coarse for those.
    ``left`` is what it may miss; answers that take long are ``kept`` on disk.
    """

    model: str
    element: Callable[[Scene], str]
    per_length: bool
    von_mises_pa: Callable[[Any, Array], float]
    flatness: Callable[[Any, Array], float]
    contact_m: Callable[[Any, Solution], tuple[float, float, float]]
    taxels_n: Callable[[Any, Solution, Array, Array, float], Array]
    picture: Callable[[Any], Picture]
    body_for: Callable[[Scene, float, float], Any]
    depths: Array
    taxel_depths: Array
    longest_m: Callable[[Scene], float]
    need_taxels: Callable[[Scene, TaxelArray], None]
    exact: bool
    left: Left
    kept: bool

    def length_m(self, scene: Scene) -> float:
        """What `Solution.force` is to be multiplied by: the finger's length [m], or nothing."""
        return 1e-3 * scene.indenter.length_mm if self.per_length else 1.0


def element_size_m(scene: Scene) -> float:
    """Element size that keeps force within about 0.3 % and pulse within 2 % [m]."""
    return RELATIVE_SIZE * scene.indenter.profile.scale


def section_for(scene: Scene, x_m: float, max_depth_m: float) -> Section:
    """The mesh that a section's stations, their pictures and touch tables are solved on."""
    size_m = element_size_m(scene)
    usual = usual_grading(size_m)
    grading = usual._replace(growth=GROWTH, coarsest_m=COARSEST * 1e-3 * scene.surface_mm)
    return build_section(scene, x_m, depth_m=max_depth_m, size_m=size_m, grading=grading)


def solid_for(scene: Scene, x_m: float, max_depth_m: float) -> SolidBody:
    """The mesh that a solid's stations and their pictures are solved on: the first of a press."""
    size_m = SHARES[0] * half_width_m(scene)
    return build_body(scene, x_m, depth_m=max_depth_m, size_m=size_m)


# Functions with names: a press goes to other processes.
def _wedges(_: Scene) -> str:
    return "wedge"


def _not_known(_lumens: object, _u: Array) -> float:
    return 1.0


def _any_step(_: Scene) -> float:
    return inf


def _solid_step_m(scene: Scene) -> float:
    return STEP * half_width_m(scene)


def _any_taxels(_scene: Scene, _taxels: TaxelArray) -> None:
    """A section's elements under a finger are finer than any array."""


def _solid_taxels(scene: Scene, taxels: TaxelArray) -> None:
    need_wide_taxels(scene, taxels, SHARES[0])


SECTION = BodyKind(
    "finite", best_element, True, stress.under_finger_pa, flatness, stress.contact_m,
    section_taxels_n, SectionPicture, section_for, DEPTHS, TAXEL_DEPTHS, _any_step, _any_taxels,
    exact=True, left=LEFT, kept=False,
)  # fmt: skip
REVOLVED = replace(SECTION, model="axisymmetric", per_length=False)
SOLID = BodyKind(
    "solid", _wedges, False, solid_stress.under_finger_pa, _not_known, solid_stress.contact_m,
    solid_taxels_n, Cut, solid_for, SOLID_DEPTHS, SOLID_DEPTHS, _solid_step_m, _solid_taxels,
    exact=False, left=SOLID_LEFT, kept=True,
)  # fmt: skip
_OF_PLANES = {"stress": SECTION, "strain": SECTION, "solid": SOLID}


def body_of(scene: Scene) -> BodyKind:
    """The kind that can solve any press into a scene."""
    return _OF_PLANES[scene.plane]
