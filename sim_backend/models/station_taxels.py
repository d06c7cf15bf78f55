"""What the taxels of a station's array take, read off the states that its curves are made of."""

from collections.abc import Sequence

import numpy as np

from sim_backend.arrays import Array
from sim_backend.fem.body import Body
from sim_backend.fem.newton import Solution
from sim_backend.models.kinds import BodyKind
from sim_backend.models.response import Station
from sim_backend.models.taxel_shares import at_depths

TAXELS = ("taxel_sunk", "taxel_rest", "taxel_by_pressure")
"""The fields of `sim_backend.models.taxel_shares.TaxelShares`."""


def taxel_table(
    one: Station, kind: BodyKind, body: Body, bulge: float, seen: Sequence[Solution],
    ramp: Sequence[Solution], crests: Sequence[Solution | None],
) -> dict[str, Array]:  # fmt: skip
    """`TAXELS` of the states that are ``seen`` at rest, and of those of ``ramp`` whose ``crests``,
    the states at systole, are solved."""
    scene, array = one.scene, one.array
    assert array is not None
    edges_m, finger_m = array.edges_m(scene.indenter), 1e-3 * scene.indenter.length_mm

    def shares(state: Solution) -> Array:
        whole_n = kind.length_m(scene) * state.force
        return np.asarray(kind.taxels_n(body, state, *edges_m, finger_m) / whole_n)

    seen = [state for state in seen if state.force > 0]
    if not seen:
        nothing = np.zeros((1, array.rows, array.columns))
        return dict(zip(TAXELS, (np.array([one.max_depth_m]), nothing, nothing), strict=True))
    sunk = np.array([state.load.depth_m for state in seen]) + bulge
    rest = np.array([shares(state) for state in seen])
    by_pressure = np.zeros_like(rest)
    solved = [(state, crest) for state, crest in zip(ramp, crests, strict=True)
              if crest is not None and state.force > 0]  # fmt: skip
    if solved:
        known = np.array([state.load.depth_m for state, _ in solved]) + bulge
        each = [(shares(crest) - shares(state)) / (crest.load.pressure_pa - state.load.pressure_pa)
                for state, crest in solved]  # fmt: skip
        by_pressure = at_depths(known, np.array(each), sunk)
    return dict(zip(TAXELS, (sunk, rest, by_pressure), strict=True))
