"""The meshes of a press into a solid, and what each misses."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.solid.build import MOST_UNKNOWNS, half_width_m
from sim_backend.fem.solid.solve import SolvedSolid, solve_solid
from sim_backend.models.refine import Floor, Meshed, Meshes
from sim_backend.scene.scene_file import Scene, SceneError
from sim_backend.scene.taxels import TaxelArray

SHARES = (0.36, 0.25, 0.18)
"""Element sizes in the contact over the finger's smaller half width, one mesh after the other."""
GROWTH = (2.7, 1.6)
"""Powers of the elements in the contact by which unknowns grow from mesh to mesh: 2.0 to 2.7 and
0.8 to 2.0 of eleven scenes."""
FLOOR_PCT = 30.0
"""What a mesh misses of force and of pulse at least, over the square of its share: two meshes may
agree by chance. Two meshes of an earlier commit did, under a cylinder of 5 x 10 mm over TIHA's
vessel: within 0.1 % of force and 0.4 % of pulse, both 1.7 and 2.0 % above a finer one. In a block
of 24 x 20 mm the third mesh's pulse, like CalculiX', is 1.6 % above the second's.
"""
TAXEL_ELEMENTS = 1.5
"""Narrowest taxel of a solid over its elements. Under a ball of 4 mm on a block
of 24 x 24 x 12 mm, 1 mm deep, taxels of 1.5 to 3 elements are within 3.3 % of the largest of those
of the body of revolution, and of 1 element they are 4.4 % lopsided."""


@dataclass(frozen=True)
class SolidMeshes(Meshes):
    """Those of a press at z = 0."""

    name: ClassVar[str] = "a solid in three dimensions"
    first_share: ClassVar[float] = SHARES[0]

    def contact_m(self, share: float) -> float:
        return share * half_width_m(self.asked.scene)

    def solve(self, share: float, coarser: Meshed | None, *, stated: bool) -> SolvedSolid:  # noqa: ARG002
        # no first mesh without a second, which shows its error; how large finer ones are is
        # foreseen
        first = coarser is None
        most = MOST_UNKNOWNS * (SHARES[1] / SHARES[0]) ** GROWTH[0] if first else np.inf
        asked = self.asked
        return solve_solid(
            asked.scene, asked.x_m, asked.depth_m, asked.pressures_pa, self.contact_m(share),
            coarser=coarser, most_unknowns=most, judge=not first,
        )  # fmt: skip

    def next_share(
        self, share: float, solved: Meshed, finer: float | None, budget_pct: Array  # noqa: ARG002
    ) -> float | None:  # fmt: skip
        k = SHARES.index(share)
        if k + 1 == len(SHARES):
            return None
        foreseen = len(solved[0].free) * (share / SHARES[k + 1]) ** GROWTH[k]
        return SHARES[k + 1] if foreseen <= MOST_UNKNOWNS else None

    def floors_pct(self, share: float, solved: Meshed) -> list[Floor]:
        return [(FLOOR_PCT * share**2 * np.array([1.0, len(solved[1]) > 1]), 2.0)]


def need_wide_taxels(scene: Scene, taxels: TaxelArray, share: float) -> None:
    """Raise `SceneError` for taxels narrower than a solid's elements of this `SHARES` can tell
    apart."""
    across_m, along_m = taxels.edges_m(scene.indenter)
    narrowest_m = min(float(across_m[1] - across_m[0]), float(along_m[1] - along_m[0]))
    least_m = TAXEL_ELEMENTS * share * half_width_m(scene)
    if narrowest_m < least_m:
        raise SceneError(
            f"{scene.name}: taxels of {1e3 * narrowest_m:.2g} mm are finer than a solid's elements "
            f"can tell apart under this finger; take a pitch of {1e3 * least_m:.2g} mm or more, or "
            'press a plane section (plane = "strain")'
        )
